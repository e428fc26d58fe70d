"""`PreparedRun`: the function that `prepare` returns."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from ..arrays import FloatArray
from ..codegen.base import Prepared
from ..errors import ValueInputError, list_names, nesting_named
from ..ir.program import Layout
from ..methods.status import Status
from ..values import array_of

__all__ = ["PreparedRun"]


@final
class PreparedRun:
    """A run of fixed span, method and tolerances: ``run(state, p)`` is the final state.

    The arrays are made by ``model.state(initial, parameters)`` and ``model.parameter_vector(parameters)``, which check
    what is in them; here only their shapes are checked. Threads may share a prepared run. `again` makes one more.

    Attributes
    ----------
    method : str
    """

    def __init__(
        self,
        run: Prepared,
        method: str,
        layout: Layout,
        again: Callable[[], PreparedRun],
    ) -> None:
        self._run, self._again = run, again
        self._state, self._parameters = layout.state, layout.parameters
        self._shapes = ((len(layout.state),), (len(layout.parameters),))
        self.method = method

    def __call__(self, state: FloatArray, p: FloatArray) -> FloatArray:
        """Return the final state (n_y,) from a state (n_y,) and parameters (n_p,).

        Raises
        ------
        ValueInputError
            For arrays of other shapes.
        """
        try:
            fits = (state.shape, p.shape) == self._shapes
        except AttributeError:
            fits = False
        if not fits:
            state, p = self._arrays(state, p)
        return self._run(state, p)

    @property
    def status(self) -> Status:
        """How the last run of this thread ended."""
        return self._run.status()

    @nesting_named
    def _arrays(self, state: object, p: object) -> tuple[FloatArray, FloatArray]:
        """Return what was given as arrays."""
        return self._array("state", state, self._state), self._array("p", p, self._parameters)

    @staticmethod
    def _array(kind: str, given: object, names: tuple[str, ...]) -> FloatArray:
        """Return what was given as an array, of the shape that it must have."""
        try:
            array = array_of(given)
        except ValueError as reason:
            raise ValueInputError(f"{kind} = {given!r} {reason}") from None
        if array.shape != (len(names),):
            raise ValueInputError(
                f"{kind} must have shape ({len(names)},), for {list_names(names)}, not {array.shape}; make it with"
                f" model.{'state' if kind == 'state' else 'parameter_vector'}(...)"
            )
        return array

    def __reduce__(self) -> tuple[Callable[[], PreparedRun], tuple[()]]:
        return self._again, ()

    def __repr__(self) -> str:
        return f"<PreparedRun by {self.method}>"
