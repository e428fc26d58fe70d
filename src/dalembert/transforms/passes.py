"""Passes from kernel to kernel. Each is checked by the verifier when `run` applies it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import final

from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.verify import verify
from ..naming import Namer

__all__ = ["eliminate_dead_code", "group_products", "hoist_parameters", "run", "share_equal", "share_reciprocals"]

Pass = Callable[[Kernel], Kernel]


def run(kernel: Kernel, passes: Sequence[Pass]) -> Kernel:
    """Return `kernel` after `passes`, verified before the first and after each."""
    return reduce(lambda current, step: verify(step(current)), passes, verify(kernel))


def _namer(kernel: Kernel) -> Namer:
    taken = {line.target for line in kernel.body} | {load.target for load in kernel.loads}
    return Namer(taken | set(kernel.arguments))


def _uses(kernel: Kernel) -> Counter[Operand]:
    counts: Counter[Operand] = Counter(arg for line in kernel.body for arg in line.args)
    counts.update(kernel.outputs)
    return counts


def eliminate_dead_code(kernel: Kernel) -> Kernel:
    """Drop assignments and loads that no output depends on."""
    live = {output for output in kernel.outputs if isinstance(output, str)}
    body: list[Assignment] = []
    for line in reversed(kernel.body):
        if line.target in live:
            body.append(line)
            live.update(arg for arg in line.args if isinstance(arg, str))
    loads = tuple(load for load in kernel.loads if load.target in live)
    return replace(kernel, body=tuple(reversed(body)), loads=loads)


def _parameter_values(kernel: Kernel) -> set[str]:
    """Return the values that depend on parameters alone."""
    fixed = {load.target for load in kernel.loads if load.array == "p"}
    for line in kernel.body:
        if all(not isinstance(arg, str) or arg in fixed for arg in line.args):
            fixed.add(line.target)
    return fixed


def group_products(kernel: Kernel) -> Kernel:
    """Gather the factors made of parameters in each product, so that they can be hoisted as one.

    ``(m*b*(u*w))/I`` becomes ``(m*b/I)*(u*w)``. Only products that are used once are taken apart.
    """
    fixed, uses = _parameter_values(kernel), _uses(kernel)
    lines = {line.target: line for line in kernel.body}
    namer = _namer(kernel)
    inner: set[str] = set()
    body: list[Assignment] = []

    def factors(operand: Operand, top: list[Operand], bottom: list[Operand], root: bool) -> None:
        line = lines.get(operand) if isinstance(operand, str) else None
        open_ = line is not None and operand not in fixed and (root or uses[operand] == 1)
        if line is None or not open_ or line.op not in ("mul", "div"):
            top.append(operand)
        else:
            factors(line.args[0], top, bottom, False)
            if line.op == "mul":
                factors(line.args[1], top, bottom, False)
            else:
                factors(line.args[1], bottom, top, False)

    def chain(op: str, operands: Sequence[Operand], target: str | None = None) -> Operand:
        result = operands[0]
        for place, operand in enumerate(operands[1:], 2):
            name = target if target is not None and place == len(operands) else namer("k")
            body.append(Assignment(name, op, (result, operand)))
            result = name
        return result

    def is_fixed(operand: Operand) -> bool:
        return not isinstance(operand, str) or operand in fixed

    for line in kernel.body:  # products inside larger products are rebuilt there
        for arg in line.args:
            child = lines.get(arg) if isinstance(arg, str) else None
            if child is not None and line.op in ("mul", "div") and child.op in ("mul", "div") and uses[arg] == 1:
                if line.target not in fixed and child.target not in fixed:
                    inner.add(child.target)
    for line in kernel.body:
        if line.op not in ("mul", "div") or line.target in fixed:
            body.append(line)
            continue
        if line.target in inner:
            continue
        top: list[Operand] = []
        bottom: list[Operand] = []
        factors(line.target, top, bottom, True)
        held = [f for f in top if is_fixed(f)]
        below = [f for f in bottom if is_fixed(f)]
        free, under = [f for f in top if not is_fixed(f)], [f for f in bottom if not is_fixed(f)]
        if held or below:
            factor = chain("mul", held) if held else 1.0
            if below:
                name = namer("k")
                body.append(Assignment(name, "div", (factor, chain("mul", below))))
                factor = name
            free.append(factor)  # last, so that equal factors meet in squares first
        target = line.target
        if not free:
            free = [1.0]
        if under:
            above = chain("mul", free)
            below_free = chain("mul", under)
            body.append(Assignment(target, "div", (above, below_free)))
        else:
            chain("mul", free, target)
    return replace(kernel, body=tuple(body))


def share_reciprocals(kernel: Kernel) -> Kernel:
    """Divide once by each divisor that is used three times or more, and multiply by the reciprocal.

    The series of two quotients need fewer products than those of a reciprocal and two products.
    """
    divisors: Counter[Operand] = Counter(
        line.args[1] for line in kernel.body if line.op == "div" and isinstance(line.args[1], str)
    )
    namer = _namer(kernel)
    reciprocal: dict[Operand, str] = {}
    body: list[Assignment] = []
    for line in kernel.body:
        if line.op != "div" or divisors[line.args[1]] < 3:
            body.append(line)
            continue
        divisor = line.args[1]
        if divisor not in reciprocal:
            reciprocal[divisor] = namer("inverse")
            body.append(Assignment(reciprocal[divisor], "div", (1.0, divisor)))
        body.append(Assignment(line.target, "mul", (line.args[0], reciprocal[divisor])))
    return replace(kernel, body=tuple(body))


def share_equal(kernel: Kernel) -> Kernel:
    """Compute once what other passes have come to write twice."""
    same: dict[Operand, Operand] = {}
    known: dict[tuple[str, tuple[str, ...]], str] = {}
    body: list[Assignment] = []
    for line in kernel.body:
        args = tuple(same.get(arg, arg) for arg in line.args)
        texts = [arg if isinstance(arg, str) else repr(arg) for arg in args]  # in which 0.0 and -0.0 differ
        if line.op in _COMMUTATIVE:
            texts.sort()
        key = line.op, tuple(texts)
        if key in known:
            same[line.target] = known[key]
        else:
            known[key] = line.target
            body.append(Assignment(line.target, line.op, args))
    return replace(kernel, body=tuple(body), outputs=tuple(same.get(o, o) for o in kernel.outputs))


_COMMUTATIVE = ("add", "mul", "min", "max")


@final
@dataclass(frozen=True)
class Hoisted:
    """Kernels that read constants c instead of parameters p, and the kernel that prepares c from p."""

    prepare: Kernel
    kernels: tuple[Kernel, ...]


def hoist_parameters(kernels: Sequence[Kernel], parameters: Sequence[str]) -> Hoisted:
    """Split what depends on parameters alone off every kernel.

    The first entries of c are the parameters themselves; equal expressions of different kernels share an entry.
    """
    namer = Namer()
    names = [namer(name) for name in parameters]
    loads = tuple(Load(name, "p", i) for i, name in enumerate(names))
    outputs: list[Operand] = list(names)
    body: list[Assignment] = []
    known: dict[tuple[str, tuple[Operand, ...]], str] = {}
    slots: dict[str, int] = {name: i for i, name in enumerate(names)}
    done = []
    for kernel in kernels:
        fixed = _parameter_values(kernel)
        meaning: dict[str, str] = {load.target: names[load.index or 0] for load in kernel.loads if load.array == "p"}
        for line in kernel.body:
            if line.target in fixed:
                args = tuple(meaning[a] if isinstance(a, str) else a for a in line.args)
                key = (line.op, args)
                if key not in known:
                    known[key] = namer(line.target)
                    body.append(Assignment(known[key], line.op, args))
                meaning[line.target] = known[key]
        rest = tuple(line for line in kernel.body if line.target not in fixed)
        needed = {a for line in rest for a in line.args} | set(kernel.outputs)
        new_loads = [load for load in kernel.loads if load.array != "p"]
        for local, name in meaning.items():
            if local in needed:
                if name not in slots:
                    slots[name] = len(outputs)
                    outputs.append(name)
                new_loads.append(Load(local, "c", slots[name]))
        arguments = tuple("c" if a == "p" else a for a in kernel.arguments)
        done.append(verify(replace(kernel, arguments=arguments, loads=tuple(new_loads), body=rest)))
    prepare = Kernel("prepare", ("p",), loads, tuple(body), tuple(outputs))
    return Hoisted(run(prepare, [eliminate_dead_code]), tuple(done))
