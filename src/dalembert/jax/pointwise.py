"""Functions of one state of a model, for JAX programs of users."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

import jax
import jax.numpy as jnp

from ..errors import OptionError, ValueInputError, list_names
from ..ir.program import Program, representative
from ..once import once
from ..scene.symbol_table import InputSymbol
from ..stops.feedback import Feedback
from ..values import common_rows
from .arguments import parameters_of, vector
from .modules import KeyedFunction, kernels_of
from .run_inputs import inputs_of, parameters_at
from .stepping import Stepper


def _checked(kind: str, values: Any, names: tuple[str, ...]) -> Any:
    """Return values (n,) in the order of `names` as an array of floating point numbers, its length checked."""
    array = jnp.asarray(values)
    if array.shape != (len(names),):
        raise OptionError(f"{kind} must have shape ({len(names)},), for {list_names(names)}, not {array.shape}")
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def _require_one(kind: str, value: Any) -> None:
    """Reject arrays where one number is required: a function is one of a single state.

    Raises
    ------
    OptionError
    """
    if jnp.shape(value) != ():
        shape = jnp.shape(value)
        raise OptionError(f"{kind} must be one number, not of shape {shape}: for several, vectorise by jax.vmap")


def _rows(name: str, values: Any, size: int) -> Any:
    """Return an array (size,) or (k, size) of what a user gave."""
    array = jnp.asarray(values, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise ValueInputError(f"{name} must have shape ({size},) or (k, {size}), not {array.shape}")
    return array


def _over_rows(function: Callable[..., Any], arguments: Mapping[str, tuple[Any, int]]) -> Any:
    """Return a function of arguments, given with their ranks, for all rows of those that have one rank more.

    Raises
    ------
    ValueInputError
        For numbers of rows that differ; one row serves all.
    """
    sizes = {name: len(value) for name, (value, rank) in arguments.items() if jnp.ndim(value) > rank}
    if not sizes:
        return function(*(value for value, _ in arguments.values()))
    count = common_rows(sizes)
    axes = [0 if sizes.get(name) == count else None for name in arguments]
    values = [value[0] if sizes.get(name, count) != count else value for name, (value, _) in arguments.items()]
    return jax.vmap(function, axes)(*values)


class _OfProgram(KeyedFunction):
    """Base class of functions of a program."""

    def __init__(self, program: Program) -> None:
        self._program = representative(program)
        super().__init__(self._program)
        self._kernels = kernels_of(self._program)

    def _constants(self, t: Any, p: Any) -> Any:
        """Return the constants of parameters (n_p,), conditions decided at t."""
        conditions = self._program.conditions
        return self._kernels.constants(p if conditions is None else p.at[conditions.place].set(t))


@final
class VectorField(_OfProgram):
    """``field(t, y, args)`` is dy/dt (n_y,) of the state y (n_y,) at parameters args (n_p,).

    Fields of equal programs are equal, so that what JAX compiled for one serves the other.

    Parameters
    ----------
    program : Program
        The compiled program.
    """

    def __call__(self, t: Any, y: Any, args: Any) -> Any:
        """Return the rates; see the class.

        Raises
        ------
        OptionError
            For a state or parameters of another length, and several times.
        """
        layout = self._program.layout
        _require_one("t", t)
        y, p = _checked("the state", y, layout.state), _checked("parameters", args, layout.parameters)
        return self._kernels["rhs"](t, y, self._constants(t, p))


@once
def _stepper(program: Program, method: str) -> Stepper:
    """Return the steps of a method, made once."""
    return Stepper.of(program, kernels_of(program).constants, method)


@final
class StateFunctions(_OfProgram):
    """Functions of a time t, a state y (n_y,) and parameters p, which JAX traces, vectorises and differentiates.

    p is a mapping of the names of parameters and inputs to scalars, or an array (n_p,) as of
    ``model.parameter_vector``. Conditions on time are decided at t. Functions of equal models are equal.

    Parameters
    ----------
    program : Program
        The compiled program.
    """

    def expand(self, t: Any, y: Any, p: Any) -> tuple[Any, Any]:
        """Return coordinates (n_q,) and rates (n_q,)."""
        n = len(self._program.layout.coordinates)
        x = self._point(t, y, p)[0]
        return x[:n], x[n : 2 * n]

    def outputs(self, t: Any, y: Any, p: Any) -> Any:
        """Return the requested outputs (n_outputs,), in the order of ``layout.outputs``."""
        _, y, c = self._point(t, y, p)
        return self._kernels["outputs"](t, y, c) if "outputs" in self._kernels else jnp.zeros(0)

    def energy(self, t: Any, y: Any, p: Any) -> Any:
        """Return the energy (), kinetic and potential."""
        return jnp.sum(self._of_scene("energy", (2,), t, y, p))

    def mass_matrix(self, t: Any, y: Any, p: Any) -> Any:
        """Return the mass matrix (n_q, n_q)."""
        n = len(self._program.layout.coordinates)
        return self._of_scene("mass_matrix", (n, n), t, y, p)

    def forcing(self, t: Any, y: Any, p: Any) -> Any:
        """Return the given actions and bias terms (n_q,): M q_ddot = forcing + reactions."""
        return self._of_scene("forcing", (len(self._program.layout.coordinates),), t, y, p)

    def constraint_jacobian(self, t: Any, y: Any, p: Any) -> Any:
        """Return the Jacobian (n_c, n_q) of the velocity constraints, holonomic rows first."""
        shape = len(self._program.layout.constraints), len(self._program.layout.coordinates)
        return self._of_scene("constraint_jacobian", shape, t, y, p)

    def accelerations(self, t: Any, y: Any, p: Any) -> Any:
        """Return the second rates of the coordinates (n_q,), constraints included."""
        return self._of_scene("accelerations", (len(self._program.layout.coordinates),), t, y, p)

    def project(self, t: Any, y: Any, p: Any) -> Any:
        """Return the state (n_y,) on the constraints, as steps end: NaN where that does not converge.

        Where the constraints hold by construction, it is y.
        """
        _, y, c = self._point(t, y, p)
        return self._kernels.project(t, y, c)

    def step(
        self, y: Any, control: Any, dt: Any, p: Any, *, t: Any = 0.0, method: str = "rk4", substeps: int = 1
    ) -> Any:
        """Return the state (n_y,) a time dt after y, under inputs that are constant meanwhile.

        The step is not controlled: its error is that of `substeps` equal steps of the method. States end on the
        constraints where the formulation projects, and are NaN where that does not converge.

        Parameters
        ----------
        y : array (n_y,)
            The state, as of ``model.state``.
        control : array (n_inputs,) or mapping
            The inputs, in the order of ``layout.inputs`` or by name; ``()`` where there are none.
        dt : scalar
            Length of the step [s], all substeps together.
        p : array (n_p,) or mapping
            Parameters, without inputs where they are given by name.
        t : scalar
            Time where the step begins; conditions on time are decided in the middle of each substep.
        method : str
            "rk4", "euler", "tsit5" or "dopri8".
        substeps : int
            How many steps are taken.

        Raises
        ------
        OptionError, UnknownNameError
            For methods, numbers of substeps, controls and parameters that do not exist or have another length, and for
            several times.
        """
        program, layout = self._program, self._program.layout
        _require_one("t", t)
        _require_one("dt", dt)
        if substeps != int(substeps) or substeps < 1:
            raise OptionError(f"substeps must be a whole number from 1 on, not {substeps!r}")
        y = _checked("the state", y, layout.state)
        given = dict(zip(layout.inputs, vector("input", control, layout.inputs, layout.aliases), strict=True))
        p = jnp.asarray(parameters_of(layout, p, given), dtype=y.dtype)
        return _stepper(program, method)(t, y, p, dt, int(substeps))

    def at_coordinates(
        self,
        kernel: str,
        shape: tuple[int, ...],
        point: tuple[Any, Any, Any, Any],
        further: tuple[Any, Mapping[Any, Any] | None],
        symbols: Sequence[InputSymbol],
    ) -> Any:
        """Return the outputs of a kernel of the scene at (t, q, qdot, p) with (states, inputs), some of them traced.

        Arguments are those of `dalembert.model.evaluation`; `symbols` are the inputs of the scene.
        """
        (t, q, qdot, p), (states, inputs), layout = point, further, self._program.layout
        t, q = jnp.asarray(t, dtype=float), _rows("q", q, len(layout.coordinates))
        qdot = jnp.zeros_like(q) if qdot is None else _rows("qdot", qdot, len(layout.coordinates))
        if isinstance(states, Mapping):
            states = vector("state", states, layout.states, layout.aliases)
        z = jnp.zeros(len(layout.states)) if states is None else _rows("states", states, len(layout.states))
        numbers, given = inputs_of(layout, symbols, inputs, t)
        functions = [name for name, value in given.items() if isinstance(value, Feedback)]
        if functions:
            raise OptionError(f"input {functions[0]!r} is a function, and a value is required here: give its value")
        p = parameters_of(layout, p, numbers, given)
        if given:
            p = parameters_at(layout, symbols, given, p, t.reshape(-1), 1.0)[0].reshape(*t.shape, -1)

        def one(t: Any, q: Any, qdot: Any, z: Any, p: Any) -> Any:
            return self._at(kernel, shape, t, jnp.concatenate([q, qdot, z]), self._constants(t, p))

        return _over_rows(one, {"t": (t, 0), "q": (q, 1), "qdot": (qdot, 1), "states": (z, 1), "inputs": (p, 1)})

    def _of_scene(self, kernel: str, shape: tuple[int, ...], t: Any, y: Any, p: Any) -> Any:
        """Return the outputs of a kernel of coordinates, rates and first-order states, zeros where there is none."""
        x, _, c = self._point(t, y, p)
        return self._at(kernel, shape, t, x, c)

    def _at(self, kernel: str, shape: tuple[int, ...], t: Any, x: Any, c: Any) -> Any:
        """Return the outputs of a kernel at coordinates, rates and first-order states x."""
        if kernel == "mass_matrix" and "momenta" in self._kernels:
            n = shape[0]

            def column(unit: Any) -> Any:
                return self._kernels["momenta"](t, x.at[n : 2 * n].set(unit), c)

            return jax.vmap(column)(jnp.eye(n, dtype=x.dtype))
        return self._kernels[kernel](t, x, c).reshape(shape) if kernel in self._kernels else jnp.zeros(shape)

    def _point(self, t: Any, y: Any, p: Any) -> tuple[Any, Any, Any]:
        """Return coordinates, rates and first-order states side by side, the state, and constants."""
        layout = self._program.layout
        _require_one("t", t)
        y, c = _checked("the state", y, layout.state), self._constants(t, parameters_of(layout, p, {}))
        return self._kernels["expand"](t, y, c), y, c
