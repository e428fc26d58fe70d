"""What bounds Taylor steps: operations that are no multiply-adds, the chain of waiting ones, code, and calls.

    python benchmarks/bound.py             prints the tables that docs/speed.md is about
    python benchmarks/bound.py --write     writes those of single runs and of shares of peak into docs/speed.md

Times are in slots: a slot is the time of one multiply-add of a pack at the machine's measured peak, so that a step of F
operations a lane that takes S slots reaches the share F / (2 S) of the peak.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import re
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from batches import BATCHES, Batch
from cases import END, PROBLEMS
from contenders import absolute
from measure import machine
from peak import flops_of_step, multiply_adds
from report import describe_machine, fill_page
from sweeps import CASES

import dalembert as da
from dalembert.arrays import aligned
from dalembert.codegen.llvm.assembly import compile_object, instructions, load_object
from dalembert.codegen.llvm.target import native_lanes
from dalembert.codegen.subset import loop_assembly
from dalembert.ir.kernel import Kernel
from dalembert.starts.inputs import constants
from dalembert.subset.arguments import Address, Matrix
from dalembert.subset.compiled_subset import call_code, compiled_subset, row
from dalembert.subset.packing import address_of, pack
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import order_at, paired_step, step_kernel

TOLERANCES, ROUNDS = (1e-6, 1e-9, 1e-12), 40
PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
MARKS = ("<!-- single runs: benchmarks/bound.py --write -->", "<!-- end of single runs -->")
SHARES = ("<!-- shares of peak: benchmarks/bound.py --write -->", "<!-- end of shares of peak -->")

# Slots of what is no instruction itself, and how many cycles it waits: counted in what `vector_functions` prints and,
# for divisions, from Intel's tables for 512-bit packs (a division keeps its unit busy for 16 cycles).
_SLOTS = {"div": 32, "sqrt": 40, "sincos": 46, "rough_log2": 9, "rough_exp2": 15, "min": 1, "max": 1, "select": 2}
_CYCLES = {"div": 24, "sqrt": 32, "sin": 75, "cos": 75, "rough_log2": 17, "rough_exp2": 36, "abs": 1, "neg": 1}


def census(kernel: Kernel) -> Counter[str]:
    """Return how many operations of each kind a kernel has; a sine and a cosine of one angle count once."""
    pairs = {line.args[0] for line in kernel.body if line.op in ("sin", "cos")}
    counts = Counter(line.op for line in kernel.body if line.op not in ("sin", "cos"))
    counts["sincos"] = len(pairs)
    return counts


def slots_of(counts: Counter[str]) -> int:
    """Return the slots that the operations of a step take where nothing waits; signs and sizes are free."""
    free = ("neg", "abs")
    return sum(number * _SLOTS.get(kind, 1) for kind, number in counts.items() if kind not in free)


def chain(kernel: Kernel) -> float:
    """Return the cycles of the longest chain of operations that wait for each other, 4 for each but those listed."""
    ready: dict[Any, float] = {}
    for line in kernel.body:
        begun = max((ready.get(argument, 0.0) for argument in line.args if isinstance(argument, str)), default=0.0)
        ready[line.target] = begun + _CYCLES.get(line.op, 4)
    return max(ready.values())


class Stepping(NamedTuple):
    """Arguments of the loops below."""

    step: Address
    number: int
    clock: Matrix
    states: Matrix
    constants: Matrix
    settings: Matrix


@compiled_subset
def take_step(arguments: Stepping, first: int, second: int) -> None:
    """Take a step from one half of the states to the other."""
    clock, constants, settings = row(arguments.clock, 0), row(arguments.constants, 0), row(arguments.settings, 0)
    states = arguments.states
    call_code(arguments.step, clock, row(states, first), constants, settings, row(states, second))


@compiled_subset
def chained(arguments: Stepping) -> None:
    """Take steps, each from the end of that before."""
    half = arguments.states.shape[0] // 2
    for _i in range(arguments.number):
        take_step(arguments, 0, half)
        take_step(arguments, half, 0)


@compiled_subset
def apart(arguments: Stepping) -> None:
    """Take the same step again and again, so that one need not wait for another."""
    half = arguments.states.shape[0] // 2
    for _i in range(2 * arguments.number):
        take_step(arguments, 0, half)


def stepping(loop: Any, step: int, y: Any, c: Any, rtol: float, lanes: int) -> Callable[[], float]:
    """Return what gives the seconds of a step of a pack."""
    count = 1000
    code = load_object(compile_object(loop_assembly(loop), "loops"))
    n = len(y)
    clock, states, constants, settings = (aligned(k, lanes) for k in (1, 2 * (n + 2), len(c), 3))
    constants[:], settings[:] = c[:, None], np.array([0.05, 1.0, absolute(rtol) / rtol])[:, None]
    packed_args = pack(Stepping(step, count, clock, states, constants, settings))
    function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(code.address("entry"))

    def run() -> float:
        states[:n] = y[:, None]
        begin = time.thread_time()
        function(address_of(packed_args))
        return (time.thread_time() - begin) / (2 * count)

    run.held = code, packed_args, clock, states, constants, settings  # type: ignore[attr-defined]
    return run


def code_of(text: str) -> dict[str, int]:
    """Return what the assembly of a step has: vector instructions, of them arithmetic, and moves to and from memory."""
    lines = [line.strip() for line in instructions(text).splitlines() if re.match(r"\s+v\w+", line)]
    arithmetic = [line for line in lines if re.match(r"v(fn?m|add|sub|mul|div|sqrt)\w*p[ds]", line)]
    spills = [line for line in lines if re.match(r"vmov\w*", line) and "(%rsp)" in line]
    loads = [line for line in arithmetic if "(" in line and "(%rip)" not in line]
    return {"vector": len(lines), "arithmetic": len(arithmetic), "stack": len(spills), "with a load": len(loads)}


def first_case(batch: Batch, model: da.CompiledModel) -> tuple[Any, Any]:
    """Return the start and the constants of the first case of a batch."""
    parameters = {key: float(np.ravel(value)[0]) for key, value in batch.parameters.items()}
    start = {key: float(np.ravel(value)[0]) for key, value in batch.initial.items()}
    return model.state(start, parameters), constants(model.stages.program, model.parameter_vector(parameters))


def measured(name: str, rtol: float) -> tuple[list[str], list[str]]:
    """Return two rows: what a step consists of, and how long it takes."""
    batch = BATCHES[name](CASES[0])
    model = da.compile_model(PROBLEMS[name].build())
    program, steps = model.stages.program, model.engine.steps
    order = order_at(rtol, absolute(rtol))
    kernel = step_kernel(recurrences(program.kernel("rhs")), order, dense=False)
    counts, flops = census(kernel), flops_of_step(model, rtol)
    alone = counts["add"] + counts["sub"] + counts["mul"]
    rest = sum(counts.values()) - alone - sum(counts[kind] for kind in ("fma", "div", "sqrt", "sincos", "neg", "abs"))
    text = steps.step_text("step", recurrences(program.kernel("rhs")), order, native_lanes(), dense=False)
    looped = "br label" in text.split("@step(", 1)[1].split("slow", 1)[0]
    code = {} if looped else code_of(text)
    made = [f"{name}, {rtol:.0e}", *map(str, (order, flops, counts["fma"], alone, counts["div"] + counts["sqrt"]))]
    made += [str(counts["sincos"]), str(rest), str(slots_of(counts)), f"{chain(kernel):.0f}"]
    made += [str(code[key]) if code else "loop" for key in ("vector", "with a load", "stack")]

    y, c = first_case(batch, model)
    address = steps.taylor(order, native_lanes(), dense=False)
    options = {"method": "taylor", "rtol": rtol, "atol": absolute(rtol), "threads": 1}

    def sweep() -> float:
        begin = time.process_time()
        done = model.sweep((0.0, END), batch.initial, batch.parameters, **options)
        return (time.process_time() - begin) * native_lanes() / int(done.steps.sum())

    tasks = [
        sweep,
        *(stepping(loop, address, y, c, rtol, native_lanes()) for loop in (chained, apart)),
        *map(multiply_adds, (12, 1)),
    ]
    least = [math.inf] * len(tasks)
    for _ in range(ROUNDS):  # the least of many: what others do on the machine only adds
        least = [min(known, task()) for known, task in zip(least, tasks, strict=True)]
    whole, turn, independent, slot, wait = least
    issue, waiting = slots_of(counts) * slot, chain(kernel) * wait / 4
    shares = [flops / 2 * slot / t for t in (issue, waiting, independent, turn, whole)]
    return made, [f"{name}, {rtol:.0e}", *(f"{100 * share:.0f} %" for share in shares)]


def alone(name: str, rtol: float) -> list[str]:
    """Return what a step of one case consists of, how long it takes, and what a call takes besides its steps."""
    model = da.compile_model(PROBLEMS[name].build())
    batch, steps = BATCHES[name](CASES[0]), model.engine.steps
    order = order_at(rtol, absolute(rtol))
    kernel, pairs = paired_step(recurrences(model.stages.program.kernel("rhs")), order, dense=False)
    y, c = first_case(batch, model)
    code = steps.taylor(order, 1, dense=False)
    packed = model.parameter_vector({key: float(np.ravel(value)[0]) for key, value in batch.parameters.items()})
    options: dict[str, Any] = {"method": "taylor", "rtol": rtol, "atol": absolute(rtol)}
    runs = [model.prepare((0.0, end), **options) for end in (END, 1e-6)]

    def call(run: Callable[..., Any]) -> Callable[[], float]:
        def timed() -> float:
            begin = time.perf_counter()
            for _ in range(100):
                run(y, packed)
            return (time.perf_counter() - begin) / 100

        return timed

    tasks = [*(stepping(loop, code, y, c, rtol, 1) for loop in (chained, apart)), *map(call, runs), multiply_adds(1)]
    least = [math.inf] * len(tasks)
    for _ in range(ROUNDS):
        least = [min(known, task()) for known, task in zip(least, tasks, strict=True)]
    turn, independent, whole, short, wait = least
    joined = len(kernel.body) - len(pairs) // 2
    row = [f"{name}, {rtol:.0e}", *map(str, (order, len(kernel.body), joined)), f"{chain(kernel):.0f}"]
    row += [f"{4 * seconds / wait:.0f}" for seconds in (turn, independent)]
    return [*row, f"{1e6 * whole:.1f}", f"{1e6 * (short - turn):.1f}"]


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows))


def main() -> None:
    """Print the tables, and write two of them where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write tables into docs/speed.md")
    write, where = parser.parse_args().write, describe_machine(machine())
    head = ["single run", "order", "operations", "with pairs as one", "longest chain, cycles", "step, cycles"]
    head += ["if steps were independent", "10 s, us", "of these, the call"]
    single = table(head, [alone(name, rtol) for name in BATCHES for rtol in TOLERANCES])
    print(single, end="\n\n")
    found = [measured(name, rtol) for name in BATCHES for rtol in TOLERANCES]
    head = ["step of", "order", "flops", "multiply-adds", "sums and products alone", "divisions", "sine pairs", "other"]
    head += ["slots", "chain, cycles", "vector instructions", "with a load", "stack moves"]
    print(table(head, [row for row, _ in found]), end="\n\n")
    head = ["share of peak", "if nothing waited", "if only the chain counted", "step, independent", "step, in turn"]
    shares = table([*head, "sweep, one thread"], [row for _, row in found])
    print(shares)
    if write:
        fill_page(PAGE, MARKS, f"{single}\n\n{where}")
        fill_page(PAGE, SHARES, f"{shares}\n\n{where}")


if __name__ == "__main__":
    main()
