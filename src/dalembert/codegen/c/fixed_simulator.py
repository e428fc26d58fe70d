"""The files of a simulator in C99 whose steps have a fixed size, and the operations of such a step.

In single precision the printed C has `float` in place of `double`, and its tests allow for the rounding of floats.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, final

from ...errors import CapabilityError
from ...ir.kernel import Assignment, Kernel
from ...methods.names import CLASSICAL, CORRECTIONS
from ...methods.status import Status
from ...reduction.starting import Start
from ...transforms.linear import SET_ASIDE
from ...transforms.runge_kutta import corrected_kernel, excess_kernel, finite_kernel, fixed_step_pieces
from ...transforms.taylor.nonsmooth import nonanalytic_operations, nonsmooth_values, pivot_comparisons
from ...transforms.taylor.step import STEP_ARGUMENTS
from ..rendering import render
from .descriptions import CSource
from .printing import SINGLE
from .simulator import Simulator
from .template_variables import STATUSES

_WORDS = {"double": "float", "DBL_MAX": "FLT_MAX", "FP_FAST_FMA": "FP_FAST_FMAF", **SINGLE}
_LARGEST, _SMALLEST = 3.4028234663852886e38, 1.1754943508222875e-38
_TOKEN = re.compile(
    r'(?P<kept>/\*.*?\*/|"(?:\\.|[^"\\])*")'
    r"|(?P<number>(?<![\w.])(?:\d+\.\d*|\d+(?=[eE]))(?:[eE][+-]?\d+)?(?![\w.]))"
    r"|(?P<word>[A-Za-z_]\w*)",
    re.DOTALL,
)


def in_single(text: str) -> str:
    """Return a text of C in single precision: types, literals, and functions of the C library.

    Raises
    ------
    CapabilityError
        For a literal that no float holds.
    """
    return _TOKEN.sub(_single, text)


def _single(token: re.Match[str]) -> str:
    if token["number"]:
        return single(float(token["number"]))
    return _WORDS.get(token[0], token[0]) if token["word"] else token[0]


def single(number: float) -> str:
    """Return the literal of a float next to a number that is not negative; one that is not 0 does not become 0.

    Raises
    ------
    CapabilityError
        For a number that no float holds.
    """
    if number > _LARGEST:
        raise CapabilityError(
            f'a constant of the equations, {number!r}, is beyond the range of float (3.4e38): leave precision="double",'
            " or choose other units"
        )
    return f"{max(number, _SMALLEST) if number else number!r}f"


# Tests, whose limits grow with rounding.

_ROUNDING = 2.0**29
"""Rounding of floats over that of doubles."""

_SET_ASIDE = 1e30
"""Pivot in place of one that counts as zero."""


def kernel_in_single(kernel: Kernel) -> Kernel:
    """Return a kernel that sets pivots aside where they are next to nothing beside the rounding of floats."""
    guards, body = pivot_comparisons(kernel), list[Assignment]()
    for line in kernel.body:
        args = tuple(_SET_ASIDE if arg == SET_ASIDE else arg for arg in line.args)
        if line.target in guards:  # of (least, pivot)
            body.append(Assignment(f"{line.target}_least_", "mul", (args[0], _ROUNDING)))
            args = (f"{line.target}_least_", *args[1:])
        body.append(replace(line, args=args))
    return replace(kernel, body=tuple(body))


_WIDER = {"positions": 1e3, "rates": 1e3, "coordinates changed": 1e2, "rates changed": 1e2}
"""Kind of a test of starts, and the factor of what may be left: of constraints then 1e-5 of their terms."""

_STRICTER = dict.fromkeys(("pivots", "inertia", "coordinates left out", "rates left out"), _ROUNDING)
"""Kind of a test of starts, and the factor of what the size of a pivot must exceed."""


def start_in_single(start: Start) -> Start:
    """Return a start whose tests pass what rounding to single precision leaves."""
    kernel, first = start.kernel, len(start.kernel.outputs) - 2 * len(start.labels)
    outputs, body = list(kernel.outputs), list(kernel.body)
    for number, (kind, _) in enumerate(start.labels):
        place = first + 2 * number + (kind in _WIDER)
        factor = _WIDER.get(kind, _STRICTER.get(kind))
        if factor is not None:
            body.append(Assignment(f"tested_{number}_", "mul", (outputs[place], factor)))
            outputs[place] = f"tested_{number}_"
    return replace(start, kernel=replace(kernel, body=tuple(body), outputs=tuple(outputs)))


_NO_END = (Status.MAX_STEPS, Status.STEP_TOO_SMALL)
"""Statuses of runs that choose their steps."""


@final
class FixedSimulator(Simulator):
    """A simulator in C99 whose steps have a fixed size.

    Attributes
    ----------
    calls : list of (Kernel, int)
        The kernels of a step, and how often it calls each.
    """

    statuses: ClassVar[tuple[Status, ...]] = tuple(status for status in STATUSES if status not in _NO_END)
    template: ClassVar[str] = "c/fixed_functions.c.j2"

    def __init__(self, source: CSource) -> None:
        self.calls: list[tuple[Kernel, int]] = []
        super().__init__(source)
        if source.single:
            for name in (f"{self.prefix}.h", f"{self.prefix}.c"):
                self.files[name] = in_single(self.files[name])

    def _print(self, what: str, kernel: Kernel, meaning: str, *, exact: bool = False) -> None:
        """See `Simulator`; sines and cosines of floats are those of the C library."""
        super()._print(what, self._adapted(kernel), meaning, exact=exact or self.source.single)

    def _adapted(self, kernel: Kernel) -> Kernel:
        return kernel_in_single(kernel) if self.source.single else kernel

    def _called(self, what: str, kernel: Kernel, meaning: str, times: int = 1) -> str:
        """Print a kernel that a step calls so often; return its name."""
        self._print(what, kernel, meaning)
        self.calls.append((self._adapted(kernel), times))
        return self._name(what)

    def _variables(self) -> dict[str, dict[str, Any]]:
        """See `Simulator`."""
        self.at |= {"constants": "constants", "time": "time", "now": "state", "evaluated": "steps"}
        self._start_kernels()
        self._state_kernels()
        locks = self._locks()
        self.calls += [] if locks is None else [(locks, 1)]
        functions = self._step_variables()
        self._finish(render("c/kernels.c.j2", {"kernels": self.kernels}))
        n_states, n_constants = len(self.layout.state), len(self.program.kernel("prepare").outputs)
        members = [f"double constants[{max(n_constants, 1)}];", f"double state[{n_states}];"]
        members += ["double t0;", "double time;", "int64_t steps; /* that have been taken */"]
        n_locks = len(self.source.locking)
        return {
            "header": self._header_variables(members) | {"n_locks": n_locks},
            "functions": functions | {"n_locks": n_locks},
            **self._state_variables(),
            **self._further_variables([], ""),
            "operations": self._operation_variables(),
        }

    def _operation_variables(self) -> dict[str, Any]:
        """Return the variables of ``c/operations.md.j2``."""
        corrections = [(name.removeprefix("project_"), n) for name, n in CORRECTIONS.items() if name in self.program]
        # besides kernels: the time, the tests of corrections and of the state, and two signs of each determinant
        tests = 1 + len(corrections) + 4 * len(self.source.locking)
        rows = operation_rows(self.calls, {"add": 1, "mul": 1, "less": tests}, single=self.source.single)
        return {
            "operations": rows,
            "angles": _TOGETHER in dict(rows),
            "corrections": corrections,
            "kinks": bool(nonsmooth_values(nonanalytic_operations(self.program.kernel("rhs")))),
        }

    def _step_variables(self) -> dict[str, Any]:
        """Print the kernels of a step, and return the variables of ``c/fixed_functions.c.j2``."""
        program, n = self.program, len(self.layout.state)
        assert self.source.step is not None
        pieces = fixed_step_pieces(program.kernel("rhs"), CLASSICAL, self.source.step)
        rates = replace(pieces.rhs, arguments=STEP_ARGUMENTS)
        self._called("rates", rates, "Rate of the state, from the components that it reads", len(pieces.stages))
        stages = [
            (
                self._called(f"stage_{stage}", kernel, f"Point and time of stage {stage}"),
                "slopes" if any(load.array == "k" for load in kernel.loads) else "NULL",
                stage * n,
            )
            for stage, kernel in pieces.stages
        ]
        self._called("end", pieces.finish, "State at the end of a step")
        corrections = [self._correction(name, count) for name, count in CORRECTIONS.items() if name in program]
        self._called("finite", finite_kernel(n), "Zero where the state is finite")
        return {
            "prefix": self.prefix,
            "upper": self.prefix.upper(),
            "n_states": n,
            "n_started": max(len(self.source.start.kernel.outputs), 1),
            "n_slopes": pieces.slopes,
            "n_point": len(pieces.moved) + 1,
            "n_moved": len(pieces.moved),
            "stages": stages,
            "corrections": corrections,
        }

    def _correction(self, name: str, count: int) -> tuple[str, str, list[int]]:
        """Print the kernels of so many corrections; return their names, and the numbers of the corrections."""
        correction, kind = replace(self.program.kernel(name), arguments=STEP_ARGUMENTS), name.removeprefix("project_")
        corrected = self._called(
            kind, corrected_kernel(correction), f"State after a correction onto the {kind} constraints", count
        )
        excess = self._called(
            f"{kind}_excess", excess_kernel(correction), "By how much the last correction is too large"
        )
        return corrected, excess, list(range(count))


_KINDS: dict[str, tuple[str, ...]] = {
    "additions and subtractions": ("add", "sub", "fma"),
    "multiplications": ("mul", "fma"),
    "divisions": ("div",),
    "square roots": ("sqrt",),
    "changes of sign, absolute values": ("neg", "abs", "sign"),
    "comparisons and choices": ("min", "max", "less", "less_equal", "select"),
}
"""Kinds of operations; others are calls of the C library."""

_TOGETHER = "sines and cosines of one angle together"


def operation_rows(
    calls: Sequence[tuple[Kernel, int]], further: Mapping[str, int], *, single: bool = False
) -> list[tuple[str, int]]:
    """Return how often each kind of operation occurs where kernels are called so often, and besides."""
    counts, known = Counter(further), {op for ops in _KINDS.values() for op in ops}
    for kernel, times in calls:
        paired = set() if single else {"sin", "cos"}
        for line in kernel.body:
            counts[line.op] += 0 if line.op in paired else times
        counts[_TOGETHER] += times * len({line.args for line in kernel.body if line.op in paired})
    rows = [(kind, sum(counts[op] for op in ops)) for kind, ops in _KINDS.items()]
    rows.append((_TOGETHER, counts[_TOGETHER]))
    names = SINGLE if single else {}
    rows += [(f"calls of `{names.get(op, op)}`", n) for op, n in counts.items() if op not in (*known, _TOGETHER)]
    return [(kind, count) for kind, count in rows if count]
