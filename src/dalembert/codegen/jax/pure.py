"""Pure functions of a model, for JAX programs of users."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, final

import jax
import jax.numpy as jnp

from ...errors import OptionError, list_names, unknown_name
from ...integrators.jax.implicit import implicit_motion
from ...integrators.jax.kernels import Kernels, stacked
from ...integrators.jax.motion import Limits, Motion, middles
from ...integrators.jax.solvers import METHODS
from ...integrators.jax.starts import started
from ...ir.program import Program, representative
from ...methods.status import Status
from ...methods.step_constants import SMALLEST_SCALE
from ...once import once
from ...transforms.nonsmooth import decisions
from ...transforms.taylor import clipped_tolerance, order_for, scale_floor
from ..printers import JAX
from .arguments import parameters_of, times, vector
from .breaks import traced_breaks
from .elapsed import in_elapsed_time
from .kernels import compile_kernel
from .modules import kernels_of
from .pieces import SERVED, pieces_of

if TYPE_CHECKING:
    from ...reduction.starting import Start

__all__ = ["Solve", "Solved", "register_static"]

MODES = ("reverse", "forward")


@final
class Solved(NamedTuple):
    """Result of a traced run; rows after a failure are NaN.

    Attributes
    ----------
    t : Array (n_t,)
        Times, as given.
    y : Array (n_t, n_y)
        States, in the order of ``layout.state``.
    q, qdot : Array (n_t, n_q)
        Coordinates and rates, in the order of ``layout.coordinates``. First-order states are the last columns of y.
    outputs : Array (n_t, n_outputs)
        Requested outputs (reactions, for example), in the order of ``layout.outputs``.
    status : Array ()
        How the run ended, a number of `dalembert.methods.status.Status`; 0 is success. What is given and not finite is
        NON_FINITE, and so is a run whose outputs are not finite somewhere though its states are.
    """

    t: Any
    y: Any
    q: Any
    qdot: Any
    outputs: Any
    status: Any


@final
class _Course(NamedTuple):
    """Constants along a run: at the times (n_c,) or (n_t, n_c), at the first, in steps; breaks, and which move."""

    rows: Any
    first: Any
    run: Any
    breaks: Any
    moved: Any


@final
class Solve:
    """``solve(t, initial, p)`` integrates from t[0] and returns a `Solved` at the times t.

    The arguments are JAX arrays or numbers, and every one may be differentiated: t (n_t,) sorted in either
    direction; `initial` a mapping of the names `given` to scalars, an array (n_given,) in their order, or the state
    y (n_y,) where nothing was named; p a mapping of all parameters, and inputs that are constant in time, to scalars,
    or an array (n_p,) as of ``model.parameter_vector``. Steps are
    chosen from the values alone: derivatives are those of the steps taken, at fixed sizes, and those by a time are
    rates. Derivatives of what a run did not reach are NaN.

    Nothing is checked inside a trace: an initial state that contradicts a constraint by more than rounding is
    projected where the formulation projects, and taken as it is elsewhere. Of times in no order, which are an error
    where they are known, all states are NaN, and the status says so.

    The function is traced in double precision only: set ``jax.config.update("jax_enable_x64", True)``, or call inside
    ``with jax.enable_x64(True):``.

    Parameters
    ----------
    program : Program
        The compiled program.
    start : Start or None
        From given values to the state.
    method, mode, rtol, atol, max_step, max_steps
        As for `CompiledModel.solve_fn`.

    Attributes
    ----------
    given : tuple of str
        Names of what `initial` holds, in order.
    """

    def __init__(
        self,
        program: Program,
        start: Start | None,
        method: str,
        *,
        mode: str,
        rtol: float,
        atol: float,
        max_step: float,
        max_steps: int,
    ) -> None:
        if mode not in MODES:
            raise OptionError(unknown_name("mode", str(mode), MODES))
        if method not in SERVED:
            raise OptionError(f"solve_fn integrates by {list_names(SERVED)}, not by {method!r}")
        if program.conditions is not None and METHODS.get(method, METHODS["tsit5"]).ends:
            raise OptionError(
                f"solve_fn by {method!r} does not end steps where conditions on time change, and this scene has some:"
                ' take method="dopri8", "tsit5" or "taylor", or smooth the conditions (tanh)'
            )
        if not max_step > 0.0:
            raise OptionError(f"max_step must be a positive number of seconds, not {max_step!r}")
        self._options: dict[str, Any] = {
            "mode": mode,
            "rtol": float(rtol),
            "atol": float(atol),
            "max_step": float(max_step),
            "max_steps": int(max_steps),
        }
        program = representative(program)  # so that comparing equal functions compares no code
        self._program, self._start, self._method = program, start, method
        self._key = program, start, method, *self._options.items()
        self._hash = hash(self._key)
        self.given = program.layout.state if start is None else start.given
        self._kernels = kernels_of(program)
        self._elapsed = _elapsed(program)
        self._begin = None if start is None else stacked(compile_kernel(start.kernel, JAX))

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(Solve, **self._options), (self._program, self._start, self._method)

    def __call__(self, t: Any, initial: Any, p: Any) -> Solved:
        """Return the motion; see the class."""
        if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
            raise OptionError(
                "solve works in double precision, which is off in this process: set"
                ' jax.config.update("jax_enable_x64", True), or call inside "with jax.enable_x64(True):"'
            )
        p = parameters_of(self._program.layout, p)
        return _solved(self, times(t), vector("initial value", initial, self.given), p)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Solve) and self._key == other._key)

    def __hash__(self) -> int:
        return self._hash

    def _motion(self, t: Any, initial: Any, p: Any) -> Solved:
        """Return the motion from arrays."""
        course = self._course(t, p)
        y0 = initial
        if self._begin is not None:
            y0 = self._begin(t[0], initial, course.first)[: len(self._program.layout.state)]
        y, status = self._integrate(t, y0, course)
        q, outputs = self._on_rows("expand", t, y, course.rows), self._on_rows("outputs", t, y, course.rows)
        n = len(self._program.layout.coordinates)
        if outputs.size:
            # Where states were not reached, the status says why outputs are not finite.
            spoiled = jnp.any(~jnp.isfinite(outputs)) & (status == int(Status.SUCCESS))
            status = jnp.where(spoiled, int(Status.NON_FINITE), status)
        return Solved(t, y, q[:, :n], q[:, n : 2 * n], outputs, status)

    def _course(self, t: Any, p: Any) -> _Course:
        """Return the constants along a run."""
        conditions, constants = self._program.conditions, self._kernels.constants
        if conditions is None:
            c = constants(p)
            return _Course(c, c, c if self._elapsed is self._kernels else jnp.append(c, t[0]), (), ())
        start = jax.lax.stop_gradient(t[0])
        breaks, moved = traced_breaks(conditions, p, t, self._options["max_steps"])
        elapsed = middles(jax.lax.stop_gradient(t) - start, breaks)
        rows = jax.vmap(lambda time: constants(p.at[conditions.place].set(time)))(start + elapsed)
        return _Course(rows, rows[0], jnp.append(p, start), breaks, moved)

    def _on_rows(self, kernel: str, t: Any, y: Any, c: Any) -> Any:
        if kernel not in self._kernels:
            return jnp.zeros((len(t), 0))
        return jax.vmap(self._kernels[kernel], (0, 0, None if jnp.ndim(c) == 1 else 0))(t, y, c)

    def _integrate(self, t: Any, y0: Any, course: _Course) -> tuple[Any, Any]:
        """Return the states (n_t, n_y) at times t (n_t,), and the status."""
        options, c = self._options, course.run
        start = t[0]
        if self._program.conditions is not None:
            # Breaks stay where they are when the start moves: what moves is the state there.
            start, place = jax.lax.stop_gradient(start), self._program.conditions.place
            middle = middles(jax.lax.stop_gradient(t) - start, course.breaks)[0]
            fixed = c.at[place].set(start + middle)
            y0 = started(lambda elapsed, y, c: self._elapsed["rhs"](elapsed, y, c), y0, t[0] - start, fixed)
        t = t - start
        if METHODS.get(self._method, METHODS["tsit5"]).ends:
            if decisions(self._program) is not None:
                y0, c = _held(y0), _held(c)
            return implicit_motion(self._elapsed, self._method, t, y0, c, **options)
        rtol, atol = options["rtol"], options["atol"]
        limits = Limits(
            rtol, max(atol, SMALLEST_SCALE), scale_floor(rtol, atol), options["max_step"], options["max_steps"]
        )
        order = order_for(clipped_tolerance(rtol, atol)) if self._method == "taylor" else 0
        pieces = pieces_of(self._elapsed.program, self._elapsed, self._method, order)
        return Motion(pieces, limits)(t, y0, c, course.breaks, course.moved)


@partial(jax.jit, static_argnums=0)
def _solved(solve: Solve, t: Any, initial: Any, p: Any) -> Solved:
    """Return the motion: compiled once for equal functions, and a part of the program where one is traced."""
    return solve._motion(t, initial, p)


@jax.custom_jvp
def _held(values: Any) -> Any:
    """Return values by which the run of a method that takes no notice of jumps is not differentiated."""
    return values


@_held.defjvp
def _(values: Any, tangents: Any) -> Any:
    raise OptionError(
        "the rates of this scene may jump with its state, across which derivatives are not those of the steps, and"
        ' kvaerno5 does not tell where: take method="dopri8", "tsit5" or "taylor", whose derivatives are NaN behind a'
        " jump, or smooth the jump (tanh)"
    )


@once
def _elapsed(program: Program) -> Kernels:
    """Return the kernels of a program in the time since the start of a run."""
    counted = in_elapsed_time(program)
    if counted is program:
        return kernels_of(program)
    return Kernels(counted, {kernel.name: compile_kernel(kernel, JAX) for kernel in counted})


@once
def register_static(kind: type) -> None:
    """Let instances of a class pass through ``jax.jit`` as arguments: pytrees without leaves."""
    jax.tree_util.register_static(kind)
