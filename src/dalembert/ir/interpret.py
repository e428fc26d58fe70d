"""The reference interpreter: what a kernel means, without printing or compiling it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .ops import ALL_OPERATIONS
from .program import Kernel

__all__ = ["ARRAY_OPERATIONS", "interpret", "interpret_rows"]


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
        What to run.
    arguments : mapping of str to number or sequence
        The arguments by name.
    operations : mapping of str to callable, optional
        Another meaning of the operations, for example in extended precision; Python floats by default.
    literal : callable, optional
        What a literal becomes.

    Returns
    -------
    list
        One number an output.
    """
    values: dict[str, Any] = {}
    for load in kernel.loads:
        source: Any = arguments[load.array]
        values[load.target] = source if load.index is None else source[load.index]

    def value(operand: str | float) -> Any:
        return values[operand] if isinstance(operand, str) else literal(operand)

    for line in kernel.body:
        operands: Sequence[Any] = [value(arg) for arg in line.args]
        function = ALL_OPERATIONS[line.op].evaluate if operations is None else operations[line.op]
        values[line.target] = function(*operands)
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
}
"""The operations on arrays of many states at once."""


def interpret_rows(
    kernel: Kernel, t: NDArray[np.float64], y: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the outputs (k, n_out) of a kernel at times t (k,), states y (k, n) and constants c (n_c,) or (k, n_c)."""
    with np.errstate(all="ignore"):
        columns = interpret(kernel, {"t": t, "y": y.T, "c": c.T}, ARRAY_OPERATIONS)
    out = np.empty((len(t), len(columns)))
    for i, column in enumerate(columns):
        out[:, i] = column
    return out
