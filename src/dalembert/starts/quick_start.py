"""State and constants at the start of single runs by compiled code, where runs from the same values are many."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import final

from ..arrays import FloatArray
from ..codegen.engine import Engine
from ..codegen.runs import StartCode
from ..once import once_property
from ..reduction.starting import Start

_INTERPRETED = 16
"""Runs that are interpreted first: a few do not wait until code is compiled, which takes some 20 ms."""


@final
class QuickStart:
    """Starts from values of the same names, which take the checks of the ordinary start.

    Parameters
    ----------
    engine : Engine
        Compiles the kernels.
    start : Start
        The kernel from given values to the state.
    states : int
        Number of components of the state.
    """

    def __init__(self, engine: Engine, start: Start, states: int) -> None:
        self.start, self._engine, self._states, self._uses = start, engine, states, 0

    @once_property
    def _code(self) -> StartCode | None:
        return self._engine.start_code(self.start)

    def __call__(self, t: float, values: Mapping[str, float], p: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the state (n_y,) and constants (n_c,) at time t from given values and parameters p (n_p,).

        None where code is not compiled yet, and where the ordinary start may refuse something and says what.
        """
        if self._uses < _INTERPRETED:
            self._uses += 1
            return None
        code = self._code
        if code is None:
            return None
        c, out = code(t, p, [values[name] for name in self.start.given])
        if not math.isfinite(sum(c.tolist())):
            return None
        found = out.tolist()
        if not math.isfinite(sum(found)):
            return None
        checks = iter(found[self._states :])
        if not all(abs(left) <= limit for left, limit in zip(checks, checks, strict=True)):
            return None
        return out[: self._states].copy(), c.copy()
