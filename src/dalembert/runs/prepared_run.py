"""`PreparedRun`: the function that `prepare` returns."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from threading import get_ident
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..codegen.llvm.prepared import CompiledRun
from ..codegen.runs import Prepared
from ..errors import ValueInputError, list_names, nesting_named
from ..ir.program import WIDTH, Layout, coefficient_places
from ..methods.status import Status
from ..starts.input_values import GivenInputs
from ..values import array_of


@final
class PreparedRun:
    """A run of fixed span, method and tolerances: ``run(state, p)`` or ``run(state, p, inputs)`` is the final state.

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
        given: GivenInputs | None = None,
        span: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._run, self._again = run, again
        self._state, self._parameters = layout.state, layout.parameters
        self._shapes = ((len(layout.state),), (len(layout.parameters),))
        self.method, self._inputs = method, layout.inputs
        self._given = None if given is None else given.rows(span[0], after=span[1] >= span[0]).ravel()
        places = coefficient_places(layout.parameters, layout.inputs)
        self._values = np.array(places, int) + 1  # of the inputs among the parameters, and of all their coefficients
        self._places = np.array([place + k for place in places for k in range(WIDTH)], int)
        self._direct, self._ended = None, dict[int, int]()
        if isinstance(run, CompiledRun):
            self._direct, self._ended = run.direct, run.ended

    def __call__(self, state: FloatArray, p: FloatArray, inputs: FloatArray | None = None) -> FloatArray:
        """Return the final state (n_y,) from a state (n_y,), parameters (n_p,) and inputs (n_u,), held over the run.

        Inputs have the order of ``layout.inputs``. Without them, they are those that `prepare` was given, or else those
        of ``parameter_vector(parameters, inputs=...)``.

        Raises
        ------
        ValueInputError
            For arrays of other shapes, and for inputs without values.
        """
        if inputs is not None or self._inputs:
            state, p = self._fitting(state, p)
            p = self._with_inputs(p, inputs)
        if self._direct and (final := self._direct(state, p)) is not None:
            if self._ended:
                self._ended.pop(get_ident(), None)
            return final
        return self._run(*self._fitting(state, p))

    def _fitting(self, state: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a state (n_y,) and parameters (n_p,) as arrays of these shapes."""
        if (getattr(state, "shape", None), getattr(p, "shape", None)) == self._shapes:
            return state, p
        return self._array("state", state, self._state), self._array("p", p, self._parameters)

    @nesting_named
    def _with_inputs(self, p: FloatArray, inputs: object) -> FloatArray:
        """Return parameters (n_p,) with the values of inputs."""
        if inputs is not None and not self._inputs:
            raise ValueInputError("the scene has no inputs, and the run is given some; declare them with add_inputs")
        if inputs is not None and self._given is not None:
            raise ValueInputError("the inputs of this run were given to prepare; leave them out there or here")
        p = np.array(p, float)
        if inputs is not None:
            if not isinstance(inputs, np.ndarray) or (inputs.shape, inputs.dtype) != (self._values.shape, float):
                inputs = self._array("inputs", inputs, self._inputs)
            p[self._places] = 0.0
            p[self._values] = inputs
        elif self._given is not None:
            p[self._places] = self._given
        if not all(map(isfinite, p[self._places].tolist())):
            rows = p[self._places].reshape(-1, WIDTH)
            lost = [name for name, row in zip(self._inputs, rows, strict=True) if not np.all(np.isfinite(row))]
            raise ValueInputError(
                f"missing inputs: {list_names(lost)}. Call run(state, p, inputs) with finite numbers in the order"
                f" {list_names(self._inputs)}, or give them to prepare(t_span, inputs=...)"
            )
        return p

    @property
    def status(self) -> Status:
        """The status of the last run of this thread."""
        return self._run.status()

    @staticmethod
    @nesting_named
    def _array(kind: str, given: object, names: tuple[str, ...]) -> FloatArray:
        """Return values as an array of the required shape."""
        try:
            array = array_of(given)
        except ValueError as reason:
            raise ValueInputError(f"{kind} = {given!r} {reason}") from None
        if array.shape != (len(names),):
            made = {"state": "state", "p": "parameter_vector"}.get(kind)
            remedy = "" if made is None else f"; make it with model.{made}(...)"
            raise ValueInputError(
                f"{kind} must have shape ({len(names)},), for {list_names(names)}, not {array.shape}{remedy}"
            )
        return array

    def __reduce__(self) -> tuple[Callable[[], PreparedRun], tuple[()]]:
        return self._again, ()

    def __repr__(self) -> str:
        return f"<PreparedRun by {self.method}>"
