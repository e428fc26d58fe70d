"""Evaluation of mass matrix, forcing, constraint Jacobian and accelerations at given states and parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..errors import UnknownNameError, ValueInputError, list_names, nesting_named
from ..ir.input_parameters import coefficient_places, hidden_parameters
from ..ir.program import Layout
from ..once import once_property
from ..scene.model import InputSymbol
from ..values import array_of, times_of
from . import inputs as run_input
from .input_values import read_inputs
from .symbol_assumptions import ROUNDING, refuse_contradictions, rows_that_contradict
from .value_reader import ValueReader

__all__ = ["Evaluated", "rows_of"]


class Evaluated(ABC):
    """A model whose mass matrix, forcing and so on can be evaluated.

    Subclasses say how, and add the motions; those of `dalembert.runtime.model.CompiledModel` are generated kernels.
    """

    layout: Layout

    @property
    @abstractmethod
    def _inputs(self) -> tuple[InputSymbol, ...]:
        """The inputs of the scene."""

    @abstractmethod
    def _outputs(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray | None:
        """Return outputs (k, n_out) at times (k,), variables x (k, 2 n_q + n_z) and parameters (n_p,) or (k, n_p).

        The variables are coordinates, rates and first-order states. None stands for zeros.
        """

    @abstractmethod
    def _depends_on_states(self, kernel: str) -> bool:
        """Whether what a kernel returns depends on first-order states."""

    @nesting_named
    def parameter_vector(self, parameters: Mapping[Any, Any], *, inputs: Mapping[Any, Any] | None = None) -> FloatArray:
        """Return p (n_p,) in the order of ``layout.parameters`` from a mapping of names or symbols to numbers.

        It ends with what stands for the inputs, with the numbers `inputs`; without these it is NaN, for a prepared run
        that is given inputs with each call.

        Raises
        ------
        UnknownNameError, ValueInputError
            For input that is wrong, and for samples, which change along a run.
        """
        given = read_inputs(self.layout, self._inputs, inputs) if inputs is not None else None
        if given is not None and given.sampled:
            raise ValueInputError(
                "parameter_vector takes numbers as inputs, because it holds for a whole run, and samples change along"
                " one: give samples to simulate, sweep or prepare(t_span, inputs=...)"
            )
        if given is not None:
            return run_input.in_order(self.layout, self._read_parameters(given.parameters(parameters, 0.0)))
        if not self.layout.inputs or hidden_parameters(self.layout.inputs[0])[0] in parameters:
            return run_input.in_order(self.layout, self._read_parameters(parameters))
        free = dict.fromkeys((hidden for u in self.layout.inputs for hidden in hidden_parameters(u)), 0.0)
        p = run_input.in_order(self.layout, self._read_parameters({**parameters, **free}))
        for place in coefficient_places(self.layout.parameters, self.layout.inputs):
            p[place + 1] = np.nan
        return p

    def initial_values(self, initial: Mapping[Any, Any]) -> dict[str, float]:
        """Return initial values by name from a mapping of names or symbols to numbers.

        Raises
        ------
        UnknownNameError, ValueInputError
            For unknown names, and values that are not finite numbers or that their symbols exclude.
        """
        return self._read_initial(initial)

    @once_property
    def _read_parameters(self) -> ValueReader:
        layout = self.layout
        return ValueReader(lambda given: run_input.parameter_values(layout, given), layout.aliases, layout.assumptions)

    @once_property
    def _read_initial(self) -> ValueReader:
        layout = self.layout
        return ValueReader(
            lambda given: run_input.given_values(layout, given), layout.aliases, layout.assumptions, ROUNDING
        )

    @nesting_named
    def mass_matrix(
        self, q: Any, p: Any, *, t: Any = 0.0, inputs: Mapping[Any, Any] | None = None, states: Any = None
    ) -> FloatArray:
        """Return the mass matrix.

        Parameters
        ----------
        q : array_like (n_q,) or (k, n_q)
            Coordinates.
        p : mapping or array_like (n_p,)
            Parameters, by name or in the order of ``layout.parameters``.
        t : float or array_like (k,)
            Time [s], where the geometry depends on it.
        inputs : mapping, optional
            Values of the inputs, as for `simulate`; not needed where an array p has them.
        states : mapping or array_like (n_z,) or (k, n_z), optional
            First-order states, by name or in the order of ``layout.states``; no mass matrix depends on them.

        Returns
        -------
        ndarray (n_q, n_q) or (k, n_q, n_q)
        """
        point = t, q, None, p
        return self._evaluate("mass_matrix", point, (states, inputs), (len(self.layout.coordinates),) * 2)

    @nesting_named
    def forcing(
        self, t: Any, q: Any, qdot: Any, p: Any, *, inputs: Mapping[Any, Any] | None = None, states: Any = None
    ) -> FloatArray:
        """Return the given actions and bias terms, (n_q,) or (k, n_q): M q_ddot = forcing + reactions.

        Parameters are those of `mass_matrix`; `states` are the first-order states that they depend on.
        """
        return self._evaluate("forcing", (t, q, qdot, p), (states, inputs), (len(self.layout.coordinates),))

    @nesting_named
    def constraint_jacobian(
        self, t: Any, q: Any, p: Any, *, inputs: Mapping[Any, Any] | None = None, states: Any = None
    ) -> FloatArray:
        """Return the Jacobian of the velocity constraints, (n_c, n_q) or (k, n_c, n_q), holonomic rows first.

        Parameters are those of `mass_matrix`; `states` are the first-order states that it depends on.
        """
        shape = (len(self.layout.constraints), len(self.layout.coordinates))
        return self._evaluate("constraint_jacobian", (t, q, None, p), (states, inputs), shape)

    @nesting_named
    def accelerations(
        self, t: Any, q: Any, qdot: Any, p: Any, *, inputs: Mapping[Any, Any] | None = None, states: Any = None
    ) -> FloatArray:
        """Return the second rates of the coordinates, (n_q,) or (k, n_q), constraints included.

        Parameters are those of `mass_matrix`; `states` are the first-order states that they depend on.
        """
        return self._evaluate("accelerations", (t, q, qdot, p), (states, inputs), (len(self.layout.coordinates),))

    def _evaluate(
        self,
        kernel: str,
        point: tuple[Any, Any, Any, Any],
        further: tuple[Any, Mapping[Any, Any] | None],
        shape: tuple[int, ...],
    ) -> FloatArray:
        """Return a kernel's outputs at (t, q, qdot, p) with (states, inputs), as users give them."""
        (t, q, qdot, p), (states, inputs) = point, further
        size, at = len(self.layout.coordinates), times_of("t", t)
        q = rows_of("q", q, size)
        qdot = np.zeros_like(q) if qdot is None else rows_of("qdot", qdot, size)
        z = self._states(kernel, states)
        single = q.ndim == 1 and qdot.ndim == 1 and z.ndim == 1 and np.ndim(t) == 0
        q, qdot, z = np.atleast_2d(q), np.atleast_2d(qdot), np.atleast_2d(z)
        sizes = {"q": len(q), "qdot": len(qdot), "t": len(at), "states": len(z)}
        counts = set(sizes.values()) - {1}
        if len(counts) > 1:
            counted = ", ".join(f"{name}: {size}" for name, size in sizes.items())
            raise ValueInputError(f"arrays of states must have as many rows as each other, or one; given are {counted}")
        count = counts.pop() if counts else 1
        y = np.empty((count, 2 * size + z.shape[1]))
        y[:, :size], y[:, size : 2 * size], y[:, 2 * size :] = q, qdot, z
        times = np.ascontiguousarray(np.broadcast_to(at, (count,)))
        if isinstance(p, Mapping):
            p = self.parameter_vector(p)
        p = rows_of("p", p, len(self.layout.parameters))
        if p.ndim > 1:
            raise ValueInputError(
                f"p must have shape ({len(self.layout.parameters)},), not {p.shape}: one for all states"
            )
        self._refuse_contradictions(q, p)
        p = self._with_inputs(p, times, inputs)
        found = self._outputs(kernel, times, y, p)
        out = np.zeros((count, *shape)) if found is None else found.reshape(count, *shape)
        return out[0] if single else out

    def _with_inputs(self, p: FloatArray, t: FloatArray, inputs: Mapping[Any, Any] | None) -> FloatArray:
        """Return parameters (n_p,), or (k, n_p) at times (k,), with the values of inputs."""
        places = [place + 1 for place in coefficient_places(self.layout.parameters, self.layout.inputs)]
        if inputs is None and not np.any(np.isnan(p[places])):
            return p
        given = read_inputs(self.layout, self._inputs, inputs)
        if given is None:
            return p
        rows = np.tile(p, (len(t), 1))
        given.write(self.layout, rows, t)
        return rows if given.sampled else rows[0]

    def _states(self, kernel: str, given: Any) -> FloatArray:
        """Return first-order states (n_z,) or (k, n_z) for a kernel, zeros where nothing is given or needed."""
        names = self.layout.states
        if isinstance(given, Mapping):
            values = run_input.resolve("state", given, names, self.layout.aliases)
            missing = [name for name in names if name not in values]
            if missing:
                raise UnknownNameError(f"missing states: {list_names(missing)}. The scene has: {list_names(names)}")
            return np.array([values[name] for name in names])
        if given is not None:
            return rows_of("states", given, len(names))
        if names and self._depends_on_states(kernel):
            raise ValueInputError(
                f"{kernel} depends on the first-order states of the scene; give states={{...}} for {list_names(names)}"
            )
        return np.zeros(len(names))

    def _refuse_contradictions(self, q: FloatArray, p: FloatArray) -> None:
        """Refuse arrays of coordinates (k, n_q) and parameters (n_p,) with numbers that their symbols exclude."""
        layout = self.layout
        for names, table, rounding in ((layout.coordinates, q, ROUNDING), (layout.parameters, p[np.newaxis], 0.0)):
            for row in table[rows_that_contradict(layout.assumptions, names, table, rounding)]:
                refuse_contradictions(layout.assumptions, dict(zip(names, row.tolist(), strict=True)), rounding)


def rows_of(name: str, values: Any, size: int) -> FloatArray:
    """Return an array (size,) or (k, size) that a user gave.

    Raises
    ------
    ValueInputError
        For another shape, and for what are no numbers.
    """
    try:
        array = array_of(values)
    except ValueError as reason:
        raise ValueInputError(f"{name} = {values!r} {reason}") from None
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise ValueInputError(f"{name} must have shape ({size},) or (k, {size}), not {array.shape}")
    return array
