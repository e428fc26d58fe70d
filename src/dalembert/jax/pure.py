"""Pure functions of a model, for JAX programs of users."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, final

import jax
import jax.numpy as jnp

from ..codegen.printers import JAX
from ..errors import OptionError, list_names
from ..ir.program import DIRECTION, Program, decay_rate_among, directed_rates, representative
from ..methods.status import Status
from ..once import once
from ..options import NamedTolerances, SolveOptions, at_least, component_tolerances
from ..transforms.taylor.step import order_at, scale_floor
from .arguments import parameters_of, register_samples, times, vector
from .courses import Course, Courses
from .elapsed import in_elapsed_time, require_single, warn_below_single, warn_of_rounded_knots, with_tolerances
from .feedback import FeedbackKernels, register_feedback
from .modules import KeyedFunction, compile_kernel, kernels_of
from .pieces import SERVED, pieces_of, pieces_with
from .run_inputs import Given, failed, inputs_of, refuse_given
from .runs.derivatives import Steps, StepsRecord
from .runs.motion import TracedMotion, started
from .runs.precision import CONFIG, process_precision
from .runs.run_constants import ArrayKernels, RunConstants, stacked
from .runs.run_data import Limits, Reached, RunPieces, middles
from .solved import Dense, Solved, States, raise_failure, solved_of

if TYPE_CHECKING:
    from ..reduction.starting import Start
    from ..scene.symbol_table import InputSymbol


@final
class Solve(KeyedFunction):
    """``solve(t, initial, p, inputs=None)`` integrates from t[0] and returns a `Solved` at the times t.

    The arguments are JAX arrays or numbers, and every one may be differentiated: t (n_t,) sorted in either
    direction; `initial` a mapping of the names `given` to scalars, an array (n_given,) in their order, or the state
    y (n_y,) where nothing was named; p a mapping of all parameters, and inputs that are constant in time, to scalars,
    or an array (n_p,) as of ``model.parameter_vector``. `inputs` maps names or symbols of inputs to numbers, or to
    records ``da.samples(t, values, kind)``, at whose knots steps end; records are pytrees, and derivatives by their
    values are those of the run, those by their knots where the rates do not jump there (else they are rejected).
    Steps are chosen from the values alone: derivatives are those of the steps taken, at fixed sizes, and those by a
    time are rates. Derivatives of what a run did not reach are NaN.

    Nothing is checked inside a trace: an initial state that contradicts a constraint by more than rounding is
    projected where the formulation projects, and taken as it is elsewhere. Of times in no order, which are an error
    where they are known, all states are NaN, and the status reports it; this
    also holds for knots in no order and for records that are too short.

    The function has the precision of the process: double where ``jax_enable_x64`` is on, else single, in all of it.
    In single precision tolerances are 1e-5 and 1e-7 unless others are given, at least 1e-6 and 1e-8 (with a
    warning); what it does not support is rejected.

    Parameters
    ----------
    program : Program
        The compiled program.
    start : Start or None
        From given values to the state.
    options : SolveOptions
        As for `CompiledModel.solve_fn`.
    inputs : tuple of InputSymbol
        Inputs of the scene.
    dependence : Start or None
        How many constraints depend on others at a state: a run that starts where some do is not made.

    Attributes
    ----------
    given : tuple of str
        Names of what `initial` holds, in order.
    """

    def __init__(
        self,
        program: Program,
        start: Start | None,
        options: SolveOptions,
        inputs: tuple[InputSymbol, ...] = (),
        dependence: Start | None = None,
    ) -> None:
        if options.method not in SERVED:
            raise OptionError(f"solve_fn integrates by {list_names(SERVED)}, not by {options.method!r}")
        program = representative(program)  # so that comparing equal functions compares no code
        self._program, self._start, self._options, self._inputs = program, start, options, inputs
        super().__init__(program, start, options, inputs, dependence)
        register_samples()
        register_feedback()
        self.given = program.layout.state if start is None else start.given
        self._undirected = DIRECTION not in self.given
        self.given = tuple(name for name in self.given if name != DIRECTION)
        self._kernels = kernels_of(program)
        self._elapsed = _elapsed(program)
        in_elapsed = self._elapsed is not self._kernels
        self._courses = Courses(program, self._kernels, inputs, options.max_steps, in_elapsed=in_elapsed)
        self._begin = None if start is None else stacked(compile_kernel(start.kernel, JAX))
        self._dependent = None if dependence is None else stacked(compile_kernel(dependence.kernel, JAX))

    def __call__(self, t: Any, initial: Any, p: Any, inputs: Mapping[Any, Any] | None = None) -> Solved:
        """Return the motion; see the class."""
        t, layout = times(t), self._program.layout
        numbers, given = inputs_of(layout, self._inputs, inputs, t)
        self.check_precision(given)
        refuse_given(given, self._options)
        p = parameters_of(layout, p, numbers, given)
        start = vector("initial value", initial, self.given, layout.aliases)
        solved = solved_of(self, t, start, p, given)
        return raise_failure(solved, self._program.formulation, self._options.method) if self._options.throw else solved

    @property
    def program(self) -> Program:
        """The compiled program."""
        return self._program

    @property
    def options(self) -> SolveOptions:
        """The options as given."""
        return self._options

    def check_precision(self, given: Given) -> None:
        """Reject what single precision does not support, where the process has it, and warn of tolerances below it.

        Raises
        ------
        OptionError
        """
        if CONFIG.jax_enable_x64:
            return
        require_single(self._program, self._options.method)
        warn_below_single(self._options)
        warn_of_rounded_knots(given)

    def motion(self, t: Any, initial: Any, p: Any, given: Given | None = None) -> Solved:
        """Return the motion from arrays."""
        p = self._decaying(t, p)
        course = self._courses.with_inputs(t, p, given) if given else self._courses.of(t, p)
        y0 = initial
        if self._begin is not None:
            values = initial if self._undirected else jnp.append(initial, jnp.where(t[-1] < t[0], -1.0, 1.0))
            y0 = self._begin(t[0], values, course.first)[: len(self._program.layout.state)]
        dependent = None if self._dependent is None else self._dependent(t[0], y0, course.first)[0] > 0.0
        if dependent is not None:
            y0 = y0 * jnp.where(dependent, jnp.nan, 1.0)  # derivatives are NaN too
        reached, record = self._integrate(t, y0, course)
        q, qdot, outputs = self._expanded(t, reached.y, course.rows, course)
        status = reached.status
        if outputs.size:
            # Where states were not reached, the status says why outputs are not finite.
            spoiled = jnp.any(~jnp.isfinite(outputs)) & (status == int(Status.SUCCESS))
            status = jnp.where(spoiled, int(Status.NON_FINITE), status)
        steps, rejected = reached.steps, reached.attempts - reached.steps
        if course.wrong is not None:
            status = failed(status, course.wrong)
        if dependent is not None:
            status = jnp.where(dependent, int(Status.SINGULAR_CONFIGURATION), status)
        of_run = record, t[0], p, course.run, course.breaks
        dense = None if record is None else Dense(self, of_run, course.constants)
        return Solved(t, reached.y, q, qdot, outputs, status, steps, rejected, dense)

    def _decaying(self, t: Any, p: Any) -> Any:
        """Return parameters (n_p,) with which violations of constraints decay; see `dalembert.ir.program`."""
        names = self._program.layout.parameters
        rate = decay_rate_among(names)
        if rate is None:
            return p
        place = names.index(rate)
        return p.at[place].set(directed_rates(p[place], t[-1] < t[0], jnp))

    def _expanded(self, t: Any, y: Any, c: Any, course: Course | None = None) -> tuple[Any, Any, Any]:
        """Return coordinates, rates (n_t, n_q) and outputs (n_t, n_outputs) of states at times."""
        n, x = len(self._program.layout.coordinates), self._on_rows("expand", t, y, c)
        q, qdot = x[:, :n], x[:, n : 2 * n]
        if course is not None and course.constants is not None and course.feedback is not None:
            weights = course.run[len(course.run) - course.constants.weights :]
            c = course.feedback.at_times(t, q, qdot, c, weights)
        return q, qdot, self._on_rows("outputs", t, y, c)

    def states(self, dense: Dense, t: Any) -> States:
        """Return the motion at times t (n_t,) of a run that has been recorded; see `Dense`."""
        conditions, (record, start, p, c, breaks) = self._program.conditions, dense.run
        if dense.constants is not None:
            start = jax.lax.stop_gradient(start)
        rows = self._kernels.constants(p)
        if conditions is not None:
            start = jax.lax.stop_gradient(start)
            span = jnp.concatenate([jnp.zeros(1), jax.lax.stop_gradient(t) - start, record.reached[None]])
            elapsed = middles(span, breaks)[1:-1]
            rows = self._courses.decided(p, start + elapsed)
        if dense.constants is not None:
            rows = dense.constants.kernel_rows(rows, c, t - start)
        y = self._traced_motion(dense.constants).states(record, t - start, c)
        return States(t, y, *self._expanded(t, y, rows))

    def _on_rows(self, kernel: str, t: Any, y: Any, c: Any) -> Any:
        if kernel not in self._kernels:
            return jnp.zeros((len(t), 0))
        return jax.vmap(self._kernels[kernel], (0, 0, None if jnp.ndim(c) == 1 else 0))(t, y, c)

    def _integrate(self, t: Any, y0: Any, course: Course) -> tuple[Reached, StepsRecord | None]:
        """Return the states (n_t, n_y) at times t (n_t,), how the run went, and its record where it is kept."""
        options, c = self._effective, course.run
        start = t[0]
        if course.constants is not None:
            y0, start = self._started(t, y0, course), jax.lax.stop_gradient(start)
        elif self._program.conditions is not None:
            # Breaks stay where they are when the start moves: what moves is the state there.
            start, place = jax.lax.stop_gradient(start), self._program.conditions.place
            middle = middles(jax.lax.stop_gradient(t) - start, course.breaks)[0]
            fixed = c.at[place].set(start + middle)
            y0 = started(lambda elapsed, y, c: self._elapsed["rhs"](elapsed, y, c), y0, t[0] - start, fixed)
        t = t - start
        motion = self._traced_motion(course.constants, course.feedback)
        if not options.dense:
            return motion(t, y0, c, course.breaks, course.moved), None
        if motion.jumps:
            t, y0, c = (refusing(_JUMPS_IN_DENSE, value) for value in (t, y0, c))
        return motion.recorded(t, y0, c, course.breaks, course.moved)

    def _started(self, t: Any, y0: Any, course: Course) -> Any:
        """Return the first state of a run with inputs, which changes with the start; breaks stay where they are."""
        steps = self._pieces(course.constants, course.feedback).steps

        def rates(elapsed: Any, y: Any, c: Any) -> Any:
            """Return the rates (n_y,) with what the constants, all but the last, are at that time."""
            rows = steps.constants.rows(c[:-1], c[-1:])
            at = Steps(jnp.reshape(elapsed, 1), jnp.zeros(1), tuple(y[:, None]), rows)
            return jnp.concatenate(steps.rates(at)) if len(y) else y

        still = jax.lax.stop_gradient(t)
        middle = middles(still - still[0], course.breaks)[0] if len(course.breaks) else jnp.zeros_like(still[0])
        return started(rates, y0, t[0] - still[0], jnp.append(course.run, middle))

    @property
    def _effective(self) -> SolveOptions:
        """The options with the tolerances that a run takes in this process."""
        return with_tolerances(self._options, process_precision())

    def _traced_motion(self, constants: RunConstants | None, feedback: FeedbackKernels | None = None) -> TracedMotion:
        """Return runs by the method and its limits."""
        options = self._effective
        rtol, atol = options.tolerances
        least = at_least(atol, process_precision().smallest_scale)
        own = component_tolerances(least, self._program.layout.state)
        limits = Limits(
            rtol, least if own is None else own, scale_floor(rtol, atol), options.max_step, options.max_steps
        )
        return TracedMotion(self._pieces(constants, feedback), limits)

    def _pieces(self, constants: RunConstants | None, feedback: FeedbackKernels | None) -> RunPieces:
        """Return the pieces of the method, for runs whose constants are those of the program or others."""
        options = self._effective
        order = order_at(*options.tolerances) if options.method == "taylor" else 0
        given = self._elapsed.program, self._elapsed, options.method, order, constants
        weighted = isinstance(options.atol, NamedTolerances)
        pieces = pieces_of(*given, weighted) if feedback is None else pieces_with(*given, feedback, weighted=weighted)
        return replace(pieces, foreign=None) if options.portable else pieces


_JUMPS_IN_DENSE = (
    "the rates of this scene may jump with its state, or with parameters in time, and derivatives of its dense output"
    " would miss that: leave out dense=True and give solve the times, where derivatives are NaN behind a jump, or"
    " smooth the jump (tanh)"
)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def refusing(message: str, values: Any) -> Any:
    """Return values by which a run is not differentiated, for the reason in the message."""
    return values


@refusing.defjvp
def _(message: str, values: Any, tangents: Any) -> Any:
    raise OptionError(message)


@once
def _elapsed(program: Program) -> ArrayKernels:
    """Return the kernels of a program in the time since the start of a run."""
    counted = in_elapsed_time(program)
    if counted is program:
        return kernels_of(program)
    return ArrayKernels(counted, {kernel.name: compile_kernel(kernel, JAX) for kernel in counted})


@once
def register_static(kind: type) -> None:
    """Register a class as pytrees without leaves, so that ``jax.jit`` takes its instances as arguments."""
    jax.tree_util.register_static(kind)
