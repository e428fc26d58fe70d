"""Prepared runs, for people in a loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from ..codegen.base import FloatArray
from ..integrators.status import Status

__all__ = ["PreparedRun"]


@final
class PreparedRun:
    """A run of fixed span, method and tolerances: ``run(state, p)`` is the final state.

    The arrays are made by ``model.state(initial, parameters)`` and ``model.parameter_vector(parameters)``; what is in
    them is not checked. A prepared run keeps buffers of its own and is for one thread at a time.

    Attributes
    ----------
    status : Status
        How the last run ended.
    """

    def __init__(self, run: Callable[[FloatArray, FloatArray], tuple[FloatArray, Status]], method: str) -> None:
        self._run = run
        self.method = method
        self.status = Status.SUCCESS

    def __call__(self, state: FloatArray, p: FloatArray) -> FloatArray:
        """Return the final state (n_y,) from a state (n_y,) and parameters (n_p,)."""
        y, self.status = self._run(state, p)
        return y

    def __repr__(self) -> str:
        return f"<PreparedRun by {self.method}>"
