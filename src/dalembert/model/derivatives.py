"""Methods of models that differentiate motions: `sensitivity`, `linearize` and `trim`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, cast

from ..errors import CapabilityError, OptionError, P, T, list_names, nesting_named, unknown_name
from ..options import SensitivityOptions, TrimOptions
from ..runs.capabilities import WITHOUT, refuse_functions, refuse_sampling
from ..runs.component_tolerances import with_component_names
from ..starts.input_values import read_inputs, run_span
from ..starts.inputs import span_of, with_inputs
from ..values import option

if TYPE_CHECKING:
    from ..results.analyses import OperatingPoint, Sensitivity
    from ..results.linearization import DiscreteLinearization, Linearization
    from .model import CompiledModel

_STEPS = " The steps follow from rtol and atol, and t_eval gives the times to record."
_INSTEAD = {
    "reduce": " Differentiate the states at the times of t_eval instead.",
    "grid": " One motion is differentiated: call it for each case.",
    "first_step": _STEPS,
    "max_step": _STEPS,
    "dense": " Results are at recorded times, which t_eval gives.",
    "error_estimate": " Compare the results with those of smaller rtol and atol.",
    "project_invariants": " Smaller rtol and atol keep first integrals more closely.",
}
"""Advice by name of an option that `simulate` or `sweep` has, and `sensitivity` has not."""


def _keywords_named(function: Callable[P, T]) -> Callable[P, T]:
    """Return `sensitivity` with a named error for options that it does not have."""
    parameters = inspect.signature(function).parameters
    options = [name for name, p in parameters.items() if p.kind is p.KEYWORD_ONLY]

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        unknown = [name for name in kwargs if name not in parameters]
        if "events" in unknown:
            raise CapabilityError(
                "sensitivity does not have events=, because derivatives across jumps of the state at events are not"
                " computed: take differences of two runs of simulate(events=...), or on the backend 'jax' derivatives"
                " of model.solve_fn(events=...) with events that do not change the state"
            )
        if unknown:
            lines = [f"sensitivity: {unknown_name('option', n, options)}{_INSTEAD.get(n, '')}" for n in unknown]
            raise OptionError("\n".join(lines))
        return function(*args, **kwargs)

    return call


@_keywords_named
@nesting_named
def sensitivity(
    self: CompiledModel,
    t_span: tuple[float, float],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    wrt: Iterable[Any],
    inputs: Mapping[Any, Any] | None = None,
    of: Iterable[Any] | None = None,
    t_eval: Any = None,
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float | str | Mapping[Any, float] = 1e-10,
    max_steps: int = 1_000_000,
) -> Sensitivity:
    """Simulate one trajectory with its derivatives.

    Generated variational equations are integrated beside the equations of motion, under the same control of
    error. The consistent start and the projection onto constraints are differentiated along.

    Parameters
    ----------
    t_span, initial, parameters, inputs, t_eval, method, rtol, atol, max_steps
        As for `simulate`; ``atol="auto"`` is the one of the motion alone.
    wrt : iterable of symbols or names
        Parameters, and values given in `initial`. Values that the constraints fix, if left out, vary with them.
        An input is the number that it is given, or the values of its samples, which are called "u[0]", "u[1]", ...;
        one of them alone may be named too.
    of : iterable of symbols or names, optional
        Coordinates, rates, states and their rates, components of the state and outputs that were compiled, energies
        too; by default all coordinates, rates and states.

    Returns
    -------
    Sensitivity
        ``.jacobian("x", "m")`` (n_t,) and so on.

    Raises
    ------
    UnknownNameError, ValueInputError, InitialStateError, OptionError
        For input that is wrong.
    CapabilityError
        For controllers that are Python functions, events, and scenes whose contacts change.

    Examples
    --------
    ::

        found = model.sensitivity((0, 10), {theta: 1, theta.diff(): 0}, {m: 1, l: 1, g: 9.81}, wrt=[l, theta])
        found.jacobian("theta", "l")  # the derivative of the angle by the length, over found.t
    """
    refuse_functions(self.controllers, "sensitivity")
    options = SensitivityOptions(
        method=method,
        rtol=rtol,
        atol=cast(float, atol),
        max_steps=max_steps,
        wrt=wrt,
        of=of,
        t_eval=t_eval,
    )
    options = with_component_names(self, options)
    along = run_span(inputs, *span_of(t_span), options)
    options = replace(options, inputs=read_inputs(self.layout, self.inputs, inputs, along))
    if self.modes is not None:
        raise CapabilityError(
            f"derivatives across changes of contacts ({list_names(self.contacts)}) are not computed: differentiate runs"
            f" of one mode, as model.mode({self.modes.automaton.example}).sensitivity(...), where contacts that"
            " are not named are closed and slip, or take differences of runs"
        )
    if options.fits_atol:
        simulate = partial(self.simulate, t_span, initial, parameters, inputs=inputs, t_eval=t_eval)
        motion = simulate(method=method, rtol=rtol, atol=atol, max_steps=max_steps)
        options = replace(options, atol=motion.stats.atol, fits_atol=False)
    from ..analysis.sensitivity import differentiate_run

    return differentiate_run(self, t_span, initial, parameters, options)


@nesting_named
def linearize(
    self: CompiledModel,
    t: float,
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
    states: Sequence[str] | None = None,
    outputs: Iterable[Any] | None = None,
) -> Linearization | DiscreteLinearization:
    """Linearise the motion about a state, in independent coordinates and speeds.

    The result holds on the constraints, nonholonomic ones too: its states are the directions that they leave free.
    With contacts it is that of the mode that they have there, and holds for changes that leave them in it.

    With sampled controllers it is the map from one instant to the next: the motion over the period of all controllers,
    which begin it at `t`, to first order in the states before they act and in the inputs that none of them sets.

    Parameters
    ----------
    t : float
        Time [s].
    initial, parameters : mapping of symbols or names to numbers
        The state and the parameters, as for `simulate`: what the constraints fix may be left out.
    inputs : mapping of symbols or names to numbers, samples or functions of time, optional
        Every input of the scene, the columns of `B` and `D`; with sampled controllers no functions.
    states : sequence of str, optional
        Names of the independent components to use, of coordinates and rates, or of ``layout.state``; by default
        the coordinates and rates that the constraints fix least, the same in every formulation (with unit
        quaternions, `minimal` takes angular velocities).
    outputs : iterable of symbols or names, optional
        Coordinates, rates, components of the state and compiled outputs, the rows of `C` and `D`; by default the
        independent components.

    Returns
    -------
    Linearization or DiscreteLinearization
        A, B, C and D with named rows and columns, `eigenvalues`, and `to_control()` for python-control. With
        controllers a `DiscreteLinearization`, with the period `dt`.

    Raises
    ------
    UnknownNameError, ValueInputError, InitialStateError, OptionError
        For wrong input, for states that contacts forbid or leave without a motion, and for controllers without a
        common period.
    CapabilityError
        For controllers that are Python functions.
    RunFailedError
        With controllers, where the motion does not reach the end of the period.

    Examples
    --------
    ::

        linear = model.linearize(0, {theta: 0, theta.diff(): 0}, {m: 1, l: 1, g: 9.81})
        linear.A, linear.eigenvalues
    """
    time = option("t", t)
    if self.controllers:
        refuse_functions(self.controllers, "linearize")
        if self.modes is not None:
            refuse_sampling(self.controllers, "linearize", f"in scenes whose contacts change {WITHOUT}")
        from ..analysis.linearize_period import linearize_period

        record = read_inputs(self.layout, self.inputs, inputs)
        return linearize_period(self, time, initial, parameters, record, states, outputs)
    given = with_inputs(self.layout, self.inputs, inputs, parameters, time)
    if self.modes is not None:
        from ..phases.at_state import linearize_mode

        return linearize_mode(self, time, initial, given, states, outputs)
    from ..analysis.linearize import linearize as linearize_model

    return linearize_model(self, time, initial, given, states, outputs)


@nesting_named
def trim(
    self: CompiledModel,
    guess: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    *,
    inputs: Mapping[Any, Any] | None = None,
    free: Iterable[Any] | None = None,
    steady: Iterable[Any] | None = None,
    t: float = 0.0,
    tolerance: float = 1e-12,
    max_iterations: int = 100,
) -> OperatingPoint:
    """Find an equilibrium or a steady motion near a guess, by Newton's method with exact derivatives.

    Values that are `free` change until the constraints hold and what is `steady` does not change in time. All
    other values are held. Where the conditions do not determine the free values, each Newton step takes the least
    change, and the result names what is undetermined. Angles that are free change by at most 0.5 rad in a step, and
    steps reduce forces where all accelerations must vanish, so that the nearest of several equilibria is found from
    guesses within about 1 rad of it. Where such steps do not arrive, others from the same guess are tried.

    With contacts it is looked for in the mode that the guess decides, where a gap that is not positive counts as
    closed. If the contacts are in another mode at what is found, it is looked for in that one from there; what they
    forbid is not converged.

    Parameters
    ----------
    guess : mapping of symbols or names to numbers
        Every coordinate and first-order state, and the rates: 0 for an equilibrium. Rates that the constraints fix
        may be left out.
    parameters : mapping of symbols or names to numbers
        Every parameter of the scene.
    inputs : mapping of symbols or names to numbers, optional
        Every input of the scene; it stays constant.
    free : iterable of symbols or names, optional
        Coordinates, rates, states, parameters and inputs that may change; their values above are where Newton's
        method starts. By default all coordinates and states.
    steady : iterable of symbols or names, optional
        Coordinates, rates and states that must not change in time: ``x.diff()`` stands for a vanishing
        acceleration, ``x`` for a vanishing rate. By default all rates and states, and in scenes with velocity
        constraints those rates that `guess` gives: in a steady turn the others keep changing.
    t : float
        Time [s], where the scene depends on it. The conditions hold at this time.
    tolerance : float
        Largest residual of a condition, as a share of the size of its terms.
    max_iterations : int
        Most Newton steps.

    Returns
    -------
    OperatingPoint
        Values by name, the residual of each condition, `converged` and a message: where conditions could not be
        met, it says which.

    Raises
    ------
    UnknownNameError, ValueInputError, InitialStateError
        For input that is wrong.
    OptionError
        For more conditions than free values, where not all of them can hold.

    Examples
    --------
    ::

        point = model.trim({x: 0, theta: 0.3, x.diff(): 0, theta.diff(): 0}, p, free=[theta, "F"])
        model.linearize(0.0, point.initial, point.parameters).eigenvalues
    """
    options = TrimOptions(free=free, steady=steady, t=t, tolerance=tolerance, max_iterations=max_iterations)
    given = with_inputs(self.layout, self.inputs, inputs, parameters, options.t)
    if self.modes is not None:
        from ..phases.at_state import trim_mode

        return trim_mode(self, guess, given, options)
    from ..analysis.trim import find_operating_point

    return find_operating_point(self, guess, given, options)
