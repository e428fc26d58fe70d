"""Interval arithmetic on arrays as kernels: the operations of its rules on traced numbers, line by line.

So code that has no arrays computes the bounds of `dalembert.ir.intervals` by the same rules.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np

from ..ir.interpret import ARRAY_OPERATIONS, interpret
from ..ir.intervals import INTERVAL_OPERATIONS, Interval, interval_of
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..naming import Namer
from .passes import EliminateDeadCode

LARGEST = float(np.finfo(float).max)


def interval_kernel(kernel: Kernel) -> Kernel:
    """Return the kernel of the bounds of a function of (t, p), with one output and without tables.

    It has the arguments ``t``, the interval and the rate of time in it, 1, or 0 at a point (3,), and ``p``; its outputs
    are the bounds of the value and of its rate (4,).
    """
    tape = _Tape()
    time: list[Any] = [tape.load("t", place) for place in (0, 1, 2, 2)]
    arguments = {"t": Interval(*time), "p": _Array(tape, "p")}
    (found,) = interpret(kernel, arguments, INTERVAL_OPERATIONS)
    bounds = interval_of(found)
    return tape.kernel("bounds", ("t", "p"), (bounds.low, bounds.high, bounds.rate_low, bounds.rate_high))


def traced_kernel(function: Callable[..., Any], name: str, count: int) -> Kernel:
    """Return the kernel of a function of so many numbers, one array ``t``, on arrays of which it was written."""
    tape = _Tape()
    return tape.kernel(name, ("t",), function(*(tape.load("t", place) for place in range(count))))


@final
class _Tape:
    """The lines of a kernel; each operation is there once."""

    def __init__(self) -> None:
        self._loads: dict[tuple[str, int], Load] = {}
        self._lines: dict[tuple[str, tuple[Operand, ...]], Assignment] = {}
        self._namer = Namer(set())

    def load(self, array: str, index: int) -> _Traced:
        """Return an element of an argument."""
        if (array, index) not in self._loads:
            self._loads[array, index] = Load(self._namer(f"{array}_{index}"), array, index)
        return _Traced(self, self._loads[array, index].target)

    def line(self, op: str, *values: Any) -> Any:
        """Return an operation; one on numbers that are known is a number."""
        args = tuple(value.operand if isinstance(value, _Traced) else float(value) for value in values)
        if op == "select" and (not isinstance(args[0], str) or args[1] == args[2]):
            return values[1] if args[0] else values[2]
        if not any(isinstance(arg, str) for arg in args):
            with np.errstate(all="ignore"):
                return float(ARRAY_OPERATIONS[op](*args))
        key = op, tuple(repr(arg) for arg in args)
        if key not in self._lines:
            self._lines[key] = Assignment(self._namer("z"), op, args)
        return _Traced(self, self._lines[key].target)

    def kernel(self, name: str, arguments: tuple[str, ...], outputs: Any) -> Kernel:
        """Return the kernel of some outputs."""
        found = tuple(value.operand if isinstance(value, _Traced) else float(value) for value in outputs)
        kernel = Kernel(name, arguments, tuple(self._loads.values()), tuple(self._lines.values()), found)
        return EliminateDeadCode()(kernel)


@final
class _Array:
    """An argument, whose elements are loaded where they are read."""

    def __init__(self, tape: _Tape, name: str) -> None:
        self._tape, self._name = tape, name

    def __getitem__(self, index: int) -> _Traced:
        return self._tape.load(self._name, index)


@final
class _Traced(np.lib.mixins.NDArrayOperatorsMixin):
    """A number of which only the operand of a kernel is known; truth is 1 or 0."""

    def __init__(self, tape: _Tape, operand: Operand) -> None:
        self.tape, self.operand = tape, operand

    def __array_ufunc__(self, function: Any, method: str, *args: Any, **options: Any) -> Any:
        if method != "__call__" or options or function not in _UFUNCS:
            return NotImplemented
        return _UFUNCS[function](self.tape.line, *args)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if options or function not in _FUNCTIONS:
            return NotImplemented
        return _FUNCTIONS[function](self.tape.line, *args)


Line = Callable[..., Any]
Rule = Callable[..., Any]


def _not(line: Line, a: Any) -> Any:
    return line("sub", 1.0, a)


def _is_nan(line: Line, a: Any) -> Any:
    return _not(line, line("less_equal", a, a))


def _first(line: Line, a: Any, b: Any, before: Any, other: Any) -> Any:
    """Return a where it is a number and before b, or is not a number as `other` says."""
    return line("select", before, a, line("select", _is_nan(line, a), other, b))


def _both(line: Line, a: Any, b: Any) -> Any:
    return line("mul", a, b)


def _direct(op: str) -> Rule:
    return lambda line, *args: line(op, *args)


_UFUNCS: dict[Any, Rule] = {
    **{function: _direct(op) for op, function in ARRAY_OPERATIONS.items() if isinstance(function, np.ufunc)},
    np.minimum: lambda line, a, b: _first(line, a, b, line("less_equal", a, b), a),
    np.maximum: lambda line, a, b: _first(line, a, b, line("less_equal", b, a), a),
    np.fmin: lambda line, a, b: line("select", _is_nan(line, b), a, line("select", line("less", a, b), a, b)),
    np.fmax: lambda line, a, b: line("select", _is_nan(line, b), a, line("select", line("less", b, a), a, b)),
    np.ceil: lambda line, a: line("neg", line("floor", line("neg", a))),
    np.mod: lambda line, a, b: line("sub", a, line("mul", b, line("floor", line("div", a, b)))),
    np.less: lambda line, a, b: line("less", a, b),
    np.less_equal: lambda line, a, b: line("less_equal", a, b),
    np.greater: lambda line, a, b: line("less", b, a),
    np.greater_equal: lambda line, a, b: line("less_equal", b, a),
    np.equal: lambda line, a, b: _both(line, line("less_equal", a, b), line("less_equal", b, a)),
    np.isnan: _is_nan,
    np.isfinite: lambda line, a: line("less_equal", line("abs", a), LARGEST),
    np.bitwise_and: _both,
    np.bitwise_or: lambda line, a, b: line("max", a, b),
    np.invert: _not,
}

_FUNCTIONS: dict[Any, Rule] = {
    np.where: lambda line, c, a, b: line("select", c, a, b),
    np.clip: lambda line, a, low, high: np.minimum(np.maximum(a, low), high),
    np.zeros_like: lambda line, a: 0.0,
    np.full_like: lambda line, a, value: float(value),
}
