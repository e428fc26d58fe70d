"""Methods of models that run one motion: `simulate`, `prepare` and `compare_formulations`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..errors import nesting_named
from ..options import PrepareOptions, simulate_options, tolerances
from ..progress import run_meter
from ..runs.capabilities import refuse_functions
from ..runs.component_tolerances import is_by_name, with_component_names
from ..runs.elapsed import begins_elsewhere, elapsed_times, in_elapsed_time, noted_from, with_offsets
from ..runs.events import with_event_parameters
from ..runs.simulate import simulate_in_own_time
from ..runs.small_motions import simulate_at_scale, warn_of_small_motion
from ..starts.input_values import read_inputs, run_span
from ..starts.inputs import span_of

if TYPE_CHECKING:
    from ..results.analyses import Comparison
    from ..results.trajectory import Trajectory
    from ..runs.prepared_run import PreparedRun
    from .model import CompiledModel


@nesting_named
def simulate(
    self: CompiledModel,
    t_span: tuple[float, float],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
    t_eval: Any = None,
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float | str | Mapping[Any, float] = 1e-10,
    first_step: float | None = None,
    max_step: float = np.inf,
    max_steps: int = 1_000_000,
    dense: bool = True,
    error_estimate: bool = False,
    events: Any = (),
    project_invariants: Any = False,
    progress: bool = False,
) -> Trajectory:
    """Simulate one trajectory.

    With contacts it has phases, and backwards in time ends where a contact changes. What `initial` leaves out is then
    fixed by the constraints with all contacts closed, `error_estimate` is NaN where the contacts of the run and of its
    twin do not do the same, and `project_invariants` is an error.

    Parameters
    ----------
    t_span : (float, float)
        Start and end [s]; the end may lie before the start. A run is computed in the time since its start, so that
        what is rounded of late times is no more than each ``t - t0`` as given, and the times of events, which are
        rounded to doubles: 2e-7 s where seconds are counted from 1970. A scene that contains time itself is
        compiled once more for runs whose times are more than 16 times as large as their spans.
    initial : mapping of symbols or names to numbers
        Coordinates and rates at the start. A rate is ``x.diff()`` or ``"x_dot"``. What the constraints fix may
        be left out.
    parameters : mapping of symbols or names to numbers
        Every parameter of the scene, and of the events.
    inputs : mapping of symbols or names to numbers, samples or functions, optional
        Every input of the scene: a number is constant in time, a record is made by `dalembert.samples`. A function
        f(t) -> number is sampled before the run, on every backend, as `samples` of kind "cubic": knots are added until
        the error between them is at most 0.1 `rtol` times its largest value, and where velocities follow the input, at
        most 0.1 `rtol` of its largest slope. The message of the run says how many they are. It is looked at 1024
        times at least, and once in every `max_step`; a function that jumps is an error.
    t_eval : array_like (n_t,), optional
        Times to record; without it, the accepted steps.
    method : str
        A name in `methods`, or "auto".
    rtol : float
        Relative tolerance of the local error of every component of the state.
    atol : float, mapping of symbols or names to float, or "auto"
        Absolute one, of all components or by name: ``{x: 1e-12, "x_dot": 1e-9}``. Components of ``layout.state`` that
        are left out take 1e-10. By one number, steps of "taylor" have an error of `rtol` times the largest component;
        by name, sizes are compared as multiples of the tolerances. "auto" takes a hundredth of `rtol` times the size of
        a small motion: its largest given initial value, or from rest its largest component in a first run at the
        default; where components are of very different sizes, that of each. The note of ``stats`` reports it.
    first_step, max_step : float, optional
        First and largest step [s].
    max_steps : int
        Attempted steps, accepted and rejected, after which the run ends with the status MAX_STEPS; on the backend
        "numpy" accepted ones. A run that is cut at breaks of functions of time, or at acts of controllers, has them
        for all its parts together.
    dense : bool
        Whether the trajectory can be evaluated between the recorded times.
    error_estimate : bool
        Whether to run a twin at a hundredth of the tolerances beside it, from which
        ``trajectory.error_estimate["x"]`` estimates the global error of anything at the recorded times.
    events : sequence of Event, SymPy expressions or names
        Expressions whose sign changes are all located, to rounding where they are simple roots; see `Event`. They
        are in ``trajectory.events``, by name. A sign change at the very start is none.
    project_invariants : bool, str or sequence of str
        First integrals to keep at their initial values by a correction after every step, together with the
        constraints: names as in ``trajectory.invariants``, or True for all that are conserved.
    progress : bool
        Whether to show a bar with the time that the run has reached (needs tqdm). It advances between blocks of
        steps, which stay as they are; on the backend "jax" at the end only.

    Returns
    -------
    Trajectory
        Numerical failure is its `status`, never an exception. With contacts its `phases` say what they did.

    Raises
    ------
    UnknownNameError, ValueInputError, InitialStateError, OptionError, ExpressionError
        For input that is wrong, each naming what, what is allowed and what to do.

    Examples
    --------
    The pendulum of `Scene`::

        run = model.simulate((0, 10), {theta: 1, theta.diff(): 0}, {m: 1, l: 1, g: 9.81}, rtol=1e-9)
        run["theta"], run["theta_dot"], run["energy"]  # arrays over run.t
        run(2.5)["theta"]  # at another time
    """
    options = simulate_options(
        method,
        rtol,
        atol,
        max_step,
        max_steps,
        first_step,
        dense,
        error_estimate,
        project_invariants,
        t_eval=t_eval,
        events=events,
        progress=progress,
    )
    if is_by_name(options.atol):
        options = with_component_names(self, options)
    t0, t1 = span = span_of(t_span)
    given = read_inputs(self.layout, self.inputs, inputs, run_span(inputs, t0, t1, options))
    options = options if given is None else replace(options, inputs=given)
    model = with_event_parameters(self, parameters, options.events)
    if options.inputs is not None:
        options.inputs.refuse_span(t0, t1)
        parameters = options.inputs.parameters(parameters, t0, after=t1 >= t0)
    times, elapsed = options.t_eval, None
    if begins_elsewhere(t0, t1):
        elapsed, events, _ = in_elapsed_time(model, t0, t1, options.events)
    if elapsed is not None:
        parameters = with_offsets(model, elapsed, t0, parameters)
        model, span = elapsed, (0.0, t1 - t0)
        options = replace(options, events=events, t_eval=elapsed_times(t0, t1, times), origin=t0)
        if options.inputs is not None:
            options = replace(options, inputs=options.inputs.counted_from(t0))
            parameters = options.inputs.parameters(parameters, 0.0, after=t1 >= t0)
    run_model: Callable[..., Trajectory] = simulate_in_own_time
    if model.modes is not None:
        from ..phases.given_values import run_motion

        run_model = run_motion
    begin: Callable[..., Trajectory] = partial(run_model, model, span, initial, parameters)
    if options.fits_atol:
        begin = partial(simulate_at_scale, begin, initial)
    if options.progress:
        with run_meter(*span) as show:
            run = begin(options)
            show(run.t_end)
    else:
        run = begin(options)
    if not options.fits_atol:
        warn_of_small_motion(run, options.rtol, options.atol)
    run = run if elapsed is None else run.counted_from(t0, times, noted_from(run.stats.note, t0))
    return run if given is None else run.with_note(given.note)


@nesting_named
def prepare(
    self: CompiledModel,
    t_span: tuple[float, float],
    *,
    inputs: Mapping[Any, Any] | None = None,
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float | Mapping[Any, float] = 1e-10,
    max_step: float = np.inf,
    max_steps: int = 1_000_000,
    project_invariants: Any = False,
) -> PreparedRun:
    """Return ``run(state, p)``, which gives the final state of many short runs with next to no overhead.

    A state that contradicts the constraints ends with the status INITIAL_STATE, a number that the declaration of its
    symbol excludes with ASSUMPTION; the state is then NaN. Residuals of constraints may be those of initial values, or
    `rtol` of the terms where that is more, and 1e-4 of them in formulations that do not project.

    With contacts, states are coordinates, rates and first-order states (2 n_q + n_z,), `max_steps` counts the steps of
    all phases together, a state that the contacts forbid is the status INITIAL_STATE, and `project_invariants` is an
    error. Contacts that touch are taken to be at rest, or struck, as where any motion starts: what they did before is
    not known.

    Parameters
    ----------
    t_span, method, rtol, atol, max_step, max_steps
        As for `simulate`, but for ``atol="auto"``.
    inputs : mapping of symbols or names to numbers, samples or functions, optional
        Every input of the scene, as for `simulate`, the same for all runs. Without it each run is given its own,
        ``run(state, p, inputs)`` with an array of numbers in the order of ``layout.inputs``, held over the run: so
        the loop around a controller of your own is closed.
    project_invariants : bool, str or sequence of str
        First integrals to keep, as for `simulate`: those that are conserved from the first state that the function
        is called with, which also compiles it. Their initial values are computed before each run, which takes some
        hundred microseconds.

    Raises
    ------
    OptionError, FormulationError, UnknownNameError
        For options that do not exist, and integrals that are not known or that the formulation cannot keep.

    Examples
    --------
    ::

        p = {m: 1, l: 1, g: 9.81}
        run = model.prepare((0, 10))
        end = run(model.state({theta: 1, theta.diff(): 0}, p), model.parameter_vector(p))
    """
    refuse_functions(self.controllers, "a prepared run")
    options = PrepareOptions(
        method=method,
        rtol=rtol,
        atol=cast(float, atol),
        max_step=max_step,
        max_steps=max_steps,
        project_invariants=project_invariants,
    )
    options = with_component_names(self, options)
    if inputs is not None:
        along = run_span(inputs, *span_of(t_span), options)
        options = replace(options, inputs=read_inputs(self.layout, self.inputs, inputs, along))
    from ..runs.prepare import prepare as prepare_model

    return prepare_model(self, t_span, options)


@nesting_named
def compare_formulations(
    self: CompiledModel,
    t_span: tuple[float, float],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
    formulations: Sequence[str] | None = None,
    method: str | Mapping[str, str] = "auto",
    rtol: float = 1e-8,
    atol: float | Mapping[Any, float] = 1e-10,
) -> Comparison:
    """Run one motion in every formulation and return a table of errors, violations, energy drift, steps and time.

    Parameters
    ----------
    t_span, initial, parameters, inputs, rtol, atol
        As for `simulate`, but for ``atol="auto"``; by name, each formulation takes those of its state.
    formulations : sequence of str, optional
        Which to compare; all by default.
    method : str or mapping of str to str
        The method for all formulations, or one each; a formulation that does not have it takes "auto".

    Returns
    -------
    Comparison
        One row a formulation, also for those that do not support the scene; ``print`` shows it.

    Raises
    ------
    OptionError
        For unknown formulations and methods, and as `simulate`.
    """
    from ..analysis.compare_formulations import compare

    run = t_span, initial, parameters, inputs
    return compare(self, run, tolerances(rtol, atol), formulations, method)
