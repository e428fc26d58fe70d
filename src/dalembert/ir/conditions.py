"""Conditions of a program on time and parameters, each constant within a segment of a run."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..frozen import frozen
from .kernel import Kernel
from .notation import Reader

CONDITION_TIME = "time of conditions"
"""The parameter [s] at whose value conditions on time are decided; runs set it for each of their segments."""


DECIDED = ("less", "less_equal", "sign", "floor")
"""Operations that are decided at `CONDITION_TIME`, where their operands depend on time and parameters alone."""


ZERO, WHOLE, NARROW = "zero", "whole", "narrow"
"""Kinds of conditions: the condition changes where its function vanishes, or passes a whole number. A narrow one
decides nothing: where its function vanishes, something smooth may happen within a short time."""


def weighted_select(condition: float, a: float, b: float) -> float:
    """Return a where a condition is 1, b where it is 0, and else their mean with that weight of a.

    For tests at random points with random weights in place of `DECIDED` operations: what is equal for every weight is
    equal on both sides of a jump, which random times may all miss.
    """
    if condition in (0.0, 1.0):
        return a if condition else b
    return b + condition * (a - b)


@final
@frozen
class Conditions:
    """The conditions of a program.

    Attributes
    ----------
    place : int
        Number of `CONDITION_TIME` among the parameters; None where nothing is decided, and it is none of them.
    functions : tuple of Kernel
        Of (t, p), with one output each. Conditions within a function come before it.
    kinds : tuple of str
        `ZERO` or `WHOLE`, one a function.
    nested : tuple of bool
        Whether a function contains others that are decided, so that it jumps where they do.
    sharpness : tuple of Kernel or None
        Of (t, p), of those that are narrow.
    """

    place: int | None
    functions: tuple[Kernel, ...]
    kinds: tuple[str, ...]
    nested: tuple[bool, ...]
    sharpness: tuple[Kernel | None, ...]

    def __str__(self) -> str:
        parts = ["conditions" if self.place is None else f"conditions decided at p[{self.place}]"]
        for function, kind, nested, sharpness in zip(
            self.functions, self.kinds, self.nested, self.sharpness, strict=True
        ):
            parts.append(f"condition {kind}{', nested' if nested else ''}\n{function}")
            if sharpness is not None:
                parts.append(f"sharpness\n{sharpness}")
        return "\n\n".join(parts)

    @classmethod
    def read(cls, reader: Reader) -> Conditions:
        """Read the conditions at the present place of the text of a program."""
        reader.require("conditions")
        place = None
        if reader.take("decided"):
            reader.require("at", "p", "[")
            place = reader.whole("the number of a parameter")
            reader.require("]")
        reader.end_line()
        rows: list[tuple[Kernel, str, bool, Kernel | None]] = []
        while reader.take("condition"):
            kind = next((kind for kind in (ZERO, WHOLE, NARROW) if reader.take(kind)), None)
            if kind is None:
                reader.fail(f"{ZERO!r}, {WHOLE!r} or {NARROW!r}")
            nested = reader.take(",")
            if nested:
                reader.require("nested")
            reader.end_line()
            function, sharpness = Kernel.read(reader), None
            if reader.take("sharpness"):
                reader.end_line()
                sharpness = Kernel.read(reader)
            rows.append((function, kind, nested, sharpness))
        functions, kinds, nests, sharp = zip(*rows, strict=True) if rows else ((), (), (), ())
        return cls(place, functions, kinds, nests, sharp)

    @property
    def decides(self) -> bool:
        """Whether any condition has breaks; narrow conditions have none."""
        return self.place is not None

    def decide_at(self, p: NDArray[np.float64], times: Any) -> None:
        """Set the time at which conditions are decided, () or (k,), in parameters p (n_p,) or (k, n_p)."""
        if self.place is not None:
            p[..., self.place] = times

    def deciding(self) -> Conditions | None:
        """Return the conditions that have breaks, None where there are none."""
        if not self.decides:
            return None
        kept = [i for i, kind in enumerate(self.kinds) if kind != NARROW]
        columns = (self.functions, self.kinds, self.nested, self.sharpness)
        return Conditions(self.place, *(tuple(column[i] for i in kept) for column in columns))  # type: ignore[arg-type]

    @property
    def kernels(self) -> tuple[Kernel, ...]:
        """All kernels."""
        return (*self.functions, *(kernel for kernel in self.sharpness if kernel is not None))

    @property
    def parameters(self) -> frozenset[int]:
        """Numbers of the parameters that the times of breaks depend on."""
        return frozenset(load.index or 0 for kernel in self.kernels for load in kernel.loads if load.array == "p")


NO_CONDITIONS = Conditions(None, (), (), (), ())
