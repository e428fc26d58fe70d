"""Methods of models that run motions: `simulate`, `sweep`, `prepare` and `compare_formulations`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ...errors import OptionError, nesting_named
from ...options import PrepareOptions, StoreOptions, SweepOptions, simulate_options
from ...values import tolerances
from ..capabilities import refuse_functions
from ..input_values import read_inputs
from ..simulate import simulate as simulate_model

if TYPE_CHECKING:
    from ...results.case_results import CaseResults
    from ...results.comparison import Comparison
    from ...results.motion import Motion
    from ...results.sampler import CaseSet
    from ..base import Model
    from ..model import CompiledModel
    from ..prepared import PreparedRun

__all__ = ["compare_formulations", "prepare", "simulate", "sweep"]

RunT = TypeVar("RunT", bound="Motion")
SweepT = TypeVar("SweepT", bound="CaseResults")


@nesting_named
def simulate(
    self: Model[RunT, SweepT],
    t_span: tuple[float, float],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
    t_eval: Any = None,
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float = 1e-10,
    first_step: float | None = None,
    max_step: float = np.inf,
    max_steps: int = 1_000_000,
    dense: bool = True,
    error_estimate: bool = False,
    events: Any = (),
    project_invariants: Any = False,
    progress: bool = False,
) -> RunT:
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
    inputs : mapping of symbols or names to numbers or samples, optional
        Every input of the scene: a number is constant in time, a record is made by `dalembert.samples`.
    t_eval : array_like (n_t,), optional
        Times to record; without it, the accepted steps.
    method : str
        A name in `methods`, or "auto".
    rtol, atol : float
        Tolerances of the local error of every component of the state.
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
        Expressions whose sign changes are located to rounding, all of them; see `Event`. They are in
        ``trajectory.events``, by name. A sign change at the very start is none.
    project_invariants : bool, str or sequence of str
        First integrals to keep at their initial values by a correction after every step, together with the
        constraints: names as in ``trajectory.invariants``, or True for all that are conserved.
    progress : bool
        Whether to show a bar with the time that the run has reached (needs tqdm). It advances between blocks of
        steps, which stay as they are; on the backend "jax" at the end only.

    Returns
    -------
    Trajectory
        Numerical failure is its `status`, never an exception. With contacts a `HybridTrajectory`, whose `phases` say
        what they did.

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
        inputs=read_inputs(self.layout, self._inputs, inputs),
        progress=progress,
    )
    return simulate_model(self, t_span, initial, parameters, options)


@nesting_named
def sweep(
    self: Model[RunT, SweepT],
    t_span: tuple[Any, Any],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
    grid: CaseSet | None = None,
    t_eval: Any = None,
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float = 1e-10,
    max_step: float = np.inf,
    max_steps: int = 1_000_000,
    threads: int | None = None,
    progress: bool = False,
    error_estimate: bool = False,
    events: Any = (),
    reduce: Any = None,
    project_invariants: Any = False,
    to: Any = None,
    chunk: int | None = None,
    client: Any = None,
    resume: bool = True,
    units: Mapping[Any, str] | None = None,
) -> SweepT | Any:
    """Simulate many cases, each with its own steps and status; one that fails never touches its neighbours.

    With contacts all cases that are in one mode run side by side, every time of `t_eval` ends a step, `max_steps`
    counts the steps of all phases together, and `project_invariants` is an error.

    Parameters
    ----------
    t_span : (float or array_like (n_case,), float or array_like (n_case,))
        Start and end [s], for all cases or one each. Late times lose no digits, as for `simulate`.
    initial, parameters : mapping of symbols or names to numbers or array_like (n_case,)
        Scalars serve all cases. A value that is not finite, or of an array one that its symbol excludes, is the
        status of its case, not an error.
    inputs : mapping of symbols or names to numbers, array_like (n_case,) or samples, optional
        Every input of the scene, as for `simulate`; records may have one row a case.
    grid : Grid or CaseSampler, optional
        From ``dalembert.grid(b=..., x_dot=...)``: every combination of some parameters and initial values; or
        random cases from `random_cases` or `sobol_cases`.
    t_eval : array_like (n_t,), optional
        Times to record for all cases; without it, final states only.
    method, rtol, atol, max_step
        As for `simulate`.
    max_steps : int
        As for `simulate`; but of a case that is cut at breaks or acts of controllers, the attempts within one part
        count, and then the accepted steps of all parts together.
    threads : int, optional
        Threads to use; by default as many as there are processors.
    progress : bool
        Whether to show a bar with cases per second (needs tqdm).
    error_estimate : bool
        Whether to run every case once more at a hundredth of the tolerances, from which
        ``sweep.error_estimate["x"]`` estimates the global errors; NaN where contacts of the two runs do not do the
        same.
    events : sequence of Event, SymPy expressions or names
        Events of every case, as for `simulate`. ``sweep.events["name"]`` has how often each occurred,
        and when first and last.
    reduce : mapping of str to reductions, or sequence of expressions or names
        Reductions of every motion: `dalembert.final`, `minimum`, `maximum`, `mean` and `first_crossing` of
        expressions as in `Event`; a sequence stands for final values. ``sweep.reduced["name"]`` has them, NaN
        for cases that failed.
    project_invariants : bool, str or sequence of str
        First integrals to keep, as for `simulate`: those that are conserved in the first case that can start.
    to : str, Path or zarr store, optional
        A store in which the results are kept, chunk by chunk (needs the extra ``dask``). The same call goes on
        where an earlier one ended.
    chunk : int, optional
        Cases of a chunk; by default as many as take some seconds or 128 MiB.
    client : distributed.Client, optional
        A cluster that computes the chunks; by default this process does.
    resume : bool
        Whether to continue a store of the same sweep; otherwise an existing store is an error.
    units : mapping of symbols or names to str, optional
        Units of what the store holds, and of parameters, as ``to_xarray(units=...)`` of a sweep takes them.

    Returns
    -------
    Sweep
        After Ctrl-C, with the cases that were finished; the others have the status INTERRUPTED. Where `to` is
        given, an ``xarray.Dataset`` in place of it, which reads the store when it is asked. With contacts a
        `HybridSweep`, or a dataset with ``phases`` and the mode of each contact.

    Raises
    ------
    UnknownNameError, ValueInputError, InitialStateError, OptionError
        For input that is wrong for all cases, and for a store that holds something else.
    MissingExtraError, StoredSweepError
        Where `to` is given: without the packages that it needs, and where chunks could not be computed.

    Examples
    --------
    The pendulum of `Scene`, from a thousand angles::

        angles = np.linspace(0.1, 3, 1000)
        sweep = model.sweep((0, 10), {theta: angles, theta.diff(): 0}, {m: 1, l: 1, g: 9.81})
        sweep.final["theta"], sweep.status  # arrays over the cases
    """
    refuse_functions(self._controllers, "a sweep")
    options = SweepOptions(
        method=method,
        rtol=rtol,
        atol=atol,
        max_step=max_step,
        max_steps=max_steps,
        grid=grid,
        t_eval=t_eval,
        threads=threads,
        progress=progress,
        error_estimate=error_estimate,
        events=events,
        reduce=reduce,
        project_invariants=project_invariants,
        inputs=read_inputs(self.layout, self._inputs, inputs, many=True) if to is None else None,
    )
    if to is None:
        if chunk is not None or client is not None:
            raise OptionError("chunk and client belong to sweeps that are stored: give to= too, or leave them out")
        if units is not None:
            raise OptionError(
                "units= are of sweeps that are stored (to=); give them to to_xarray(units=...) of this one"
            )
        from ..sweep import sweep as sweep_model

        return sweep_model(self, t_span, initial, parameters, options)
    where = StoreOptions(to=to, chunk=chunk, client=client, resume=resume, units=units)
    return self._stored_sweep((t_span, initial, parameters, inputs), options, where)


@nesting_named
def prepare(
    self: Model[Any, Any],
    t_span: tuple[float, float],
    *,
    inputs: Mapping[Any, Any] | None = None,
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float = 1e-10,
    max_step: float = np.inf,
    max_steps: int = 1_000_000,
    project_invariants: Any = False,
) -> PreparedRun:
    """Return ``run(state, p)``, which gives the final state of many short runs with next to no overhead.

    With contacts, states are coordinates, rates and first-order states (2 n_q + n_z,), `max_steps` counts the steps of
    all phases together, a state that the contacts forbid is the status INITIAL_STATE, and `project_invariants` is an
    error. Contacts that touch are taken to be at rest, or struck, as where any motion starts: what they did before is
    not known.

    Parameters
    ----------
    t_span, method, rtol, atol, max_step, max_steps
        As for `simulate`.
    inputs : mapping of symbols or names to numbers or samples, optional
        Every input of the scene, the same for all runs. Without it each run is given its own,
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
    refuse_functions(self._controllers, "a prepared run")
    options = PrepareOptions(
        method=method,
        rtol=rtol,
        atol=atol,
        max_step=max_step,
        max_steps=max_steps,
        project_invariants=project_invariants,
        inputs=None if inputs is None else read_inputs(self.layout, self._inputs, inputs),
    )
    from ..prepare import prepare as prepare_model

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
    atol: float = 1e-10,
) -> Comparison:
    """Run one motion in every formulation and return a table of errors, violations, energy drift, steps and time.

    Parameters
    ----------
    t_span, initial, parameters, inputs, rtol, atol
        As for `simulate`.
    formulations : sequence of str, optional
        Which to compare; all by default.
    method : str or mapping of str to str
        The method for all formulations, or one each; a formulation that does not have it takes "auto".

    Returns
    -------
    Comparison
        One row a formulation, also for those that cannot serve the scene; ``print`` shows it.

    Raises
    ------
    OptionError
        For unknown formulations and methods, and as `simulate`.
    """
    from ..compare_formulations import compare

    run = t_span, initial, parameters, inputs
    return compare(self, run, tolerances(rtol, atol), formulations, method)
