"""The reference interpreter of kernels."""

from __future__ import annotations

import operator
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..once import once_property
from . import ieee
from .calls import CALLS, array_call
from .kernel import Kernel
from .ops import ALL_OPERATIONS
from .tables import array_entry, array_piece

if TYPE_CHECKING:
    from .program import Program

Rows = Callable[[Kernel, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""Outputs (k, n_out) of a kernel at times (k,), states (k, n) and constants (k, n_c)."""


def interpret(
    kernel: Kernel,
    arguments: Mapping[str, Any],
    operations: Mapping[str, Callable[..., Any]] | None = None,
    literal: Callable[[float], Any] = float,
) -> list[Any]:
    """Return the outputs of `kernel`.

    Parameters
    ----------
    kernel : Kernel
        Kernel to evaluate.
    arguments : mapping of str to number or sequence
        The arguments by name.
    operations : mapping of str to callable, optional
        Another meaning of the operations, for example in extended precision; Python floats by default.
    literal : callable, optional
        Conversion of literals.

    Returns
    -------
    list
        One number an output.
    """
    if operations is None and literal is float:
        return _tape(kernel).run(_tape(kernel).numbers, arguments)
    values: dict[str, Any] = {}
    for load in kernel.loads:
        source: Any = arguments[load.array]
        values[load.target] = source if load.index is None else source[load.index]

    def value(operand: str | float) -> Any:
        return values[operand] if isinstance(operand, str) else literal(operand)

    for line in kernel.body:
        function = ALL_OPERATIONS[line.op].evaluate if operations is None else operations[line.op]
        values[line.target] = function(*[value(arg) for arg in line.args])
    return [value(output) for output in kernel.outputs]


ARRAY_OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sqrt": np.sqrt,
    "pow": np.power,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "exp": np.exp,
    "log": np.log,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "abs": np.abs,
    "sign": np.sign,
    "floor": np.floor,
    "min": np.minimum,
    "max": np.maximum,
    "less": lambda a, b: np.where(a < b, 1.0, 0.0),
    "less_equal": lambda a, b: np.where(a <= b, 1.0, 0.0),
    "select": lambda c, a, b: np.where(c != 0.0, a, b),
    "piece": array_piece,
    "entry": array_entry,
    **dict.fromkeys(CALLS, array_call),
}
"""The operations on arrays of many states at once; those on tables that kernels have are among them."""

_EXACT: dict[str, Callable[..., float]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": ieee.divide,
    "neg": operator.neg,
    "sqrt": ieee.sqrt,
    "abs": abs,
    "less": lambda a, b: 1.0 if a < b else 0.0,
    "less_equal": lambda a, b: 1.0 if a <= b else 0.0,
    "select": lambda c, a, b: a if c != 0.0 else b,
}
"""Operations on single numbers whose results IEEE 754 determines, in a tenth of the time that arrays take."""


def _of_one(name: str) -> Callable[..., float]:
    """Return an operation on single numbers, with the bits of arrays of one, which NumPy does not give to numbers."""
    if name in _EXACT:
        return _EXACT[name]
    function = ARRAY_OPERATIONS[name]
    return lambda *operands: float(function(*(np.array((number,)) for number in operands))[0])


Lines = Sequence[tuple[Callable[..., Any], tuple[int, ...], int]]
"""Operations on the places of their operands, each with the place of its result."""


@final
class _Tape:
    """A kernel on places of one list: loads, literals, and lines with one of three meanings of the operations."""

    def __init__(self, kernel: Kernel) -> None:
        places = {load.target: i for i, load in enumerate(kernel.loads)}
        self._start: list[Any] = [None] * len(places)

        def place(operand: str | float) -> int:
            key = operand if isinstance(operand, str) else repr(operand)  # no name; and -0.0 is not 0.0
            if key not in places:
                places[key] = len(self._start)
                self._start.append(None if isinstance(operand, str) else float(operand))
            return places[key]

        self._loads = tuple((places[load.target], load.array, load.index) for load in kernel.loads)
        self._lines = tuple(
            (line.op, tuple(place(arg) for arg in line.args), place(line.target)) for line in kernel.body
        )
        self.outputs = tuple(place(output) for output in kernel.outputs)

    @once_property
    def arrays(self) -> Lines:
        """Lines on columns, one number a state."""
        return [(ARRAY_OPERATIONS[op], args, target) for op, args, target in self._lines]

    @once_property
    def numbers(self) -> Lines:
        """Lines on Python floats."""
        return [(ALL_OPERATIONS[op].evaluate, args, target) for op, args, target in self._lines]

    @once_property
    def of_one(self) -> Lines | None:
        """Lines on single numbers with the bits of `arrays`; None where there are tables or functions of arrays."""
        if {"piece", "entry", *CALLS} & {op for op, *_ in self._lines}:
            return None
        return [(_of_one(op), args, target) for op, args, target in self._lines]

    def run(self, lines: Lines, arguments: Mapping[str, Any]) -> list[Any]:
        """Return the outputs."""
        values = list(self._start)
        for place, array, index in self._loads:
            source = arguments[array]
            values[place] = source if index is None else source[index]
        for function, args, target in lines:
            if len(args) == 2:
                values[target] = function(values[args[0]], values[args[1]])
            else:
                values[target] = function(*[values[arg] for arg in args])
        return [values[place] for place in self.outputs]


_TAPES: dict[int, _Tape] = {}
"""Tapes by the identity of their kernel, as long as it lives."""


def _tape(kernel: Kernel) -> _Tape:
    found = _TAPES.get(id(kernel))
    if found is None:
        found = _TAPES[id(kernel)] = _Tape(kernel)
        weakref.finalize(kernel, _TAPES.pop, id(kernel), None).atexit = False
    return found


def interpret_rows(
    kernel: Kernel, t: NDArray[np.float64], y: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the outputs (k, n_out) of a kernel at times t (k,), states y (k, n) and constants c (n_c,) or (k, n_c)."""
    tape = _tape(kernel)
    with np.errstate(all="ignore"):
        if len(t) == 1 and tape.of_one is not None:
            numbers = {"t": float(t[0]), "y": y[0].tolist(), "c": c.ravel().tolist()}
            return np.array([tape.run(tape.of_one, numbers)], dtype=float).reshape(1, len(tape.outputs))
        columns = tape.run(tape.arrays, {"t": t, "y": y.T, "c": c.T})
    return rows_of_columns(columns, len(t))


def mass_matrices(
    program: Program, t: NDArray[np.float64], x: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the mass matrices (k, n_q, n_q) of a program.

    At times t (k,), coordinates, rates and first-order states x (k, 2 n_q + n_z), and constants (n_c,) or (k, n_c).
    """
    n = len(program.layout.coordinates)
    if "mass_matrix" in program:
        return interpret_rows(program.kernel("mass_matrix"), t, x, c).reshape(-1, n, n)
    times, rows = unit_rates(n, t, x)
    constants = c if c.ndim == 1 else np.repeat(c, n, axis=0)
    return interpret_rows(program.kernel("momenta"), times, rows, constants).reshape(-1, n, n)


def unit_rates(
    n: int, t: NDArray[np.float64], x: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and variables (k n,) and (k n, 2 n_q + n_z) at which momenta are columns of mass matrices (k, n, n).

    Each coordinate in turn has the rate one there.
    """
    rows = np.repeat(x, n, axis=0)
    rows[:, n : 2 * n] = np.tile(np.eye(n), (len(x), 1))
    return np.repeat(t, n), rows


def rows_of_columns(columns: Sequence[Any], count: int) -> NDArray[np.float64]:
    """Return columns, each an array (count,) or one number for all rows, as an array (count, len(columns))."""
    out = np.empty((count, len(columns)))
    for i, column in enumerate(columns):
        out[:, i] = column
    return out
