"""Linearised map of a scene with sampled controllers over one period of theirs, from variational equations.

A state x with constraints g(x, u) = 0 is parametrised by independent components z as in `dalembert.analysis.linearize`.
The derivatives of x by z and by held inputs are where the variational equations start; they are integrated over the
period, with the controllers' actions differentiated at each instant, and end as derivatives of z.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, RunFailedError, list_names
from ..methods.status import Status
from ..reduction.sampling_kernels import sampling_kernels
from ..reduction.variational import weight_of
from ..results.linearization import DiscreteLinearization
from ..runs.elapsed import begins_elsewhere, in_elapsed_time, with_offsets
from ..runs.sampling import Sampling
from ..runs.simulate import ended_early
from ..starts.input_values import GivenInputs, input_places
from ..starts.segment_constants import starting_constants
from ..steps.problem import IntegrationProblem, SamplingClock
from .linearize import independent_states, output_names, regular_point

if TYPE_CHECKING:
    from ..model.model import CompiledModel
    from .linear_equations import LinearPoint

_RTOL, _ATOL = 1e-12, 1e-14
_WITH_MULTIPLIERS = 100.0
"""By how much tolerances are larger with multipliers in the stages, which reach no smaller ones."""

_MOST_PERIODS = 10_000
"""Largest number of periods of a controller in the period of all."""
_SAME = 1e-12
"""Relative difference of two periods that count as equal."""


class _Period(NamedTuple):
    """The period of all controllers.

    Attributes
    ----------
    length : float
        In s.
    clock : SamplingClock
        From which their instants count, so long ago that all have begun to act.
    at_start : int
        Which act at the beginning of the period, a bit each.
    """

    length: float
    clock: SamplingClock
    at_start: int


def linearize_period(
    model: CompiledModel,
    t: float,
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    inputs: GivenInputs | None,
    states: Sequence[str] | None,
    outputs: Iterable[Any] | None,
) -> DiscreteLinearization:
    """Return the linearised map over the period of the controllers from t on; see `CompiledModel.linearize`."""
    requested = None if outputs is None else output_names(model.layout, outputs)
    other = in_elapsed_time(model, t, t + 1.0)[0] if begins_elsewhere(t, t + 1.0) else None
    begin, given = t, parameters
    if other is not None:
        begin, given = 0.0, with_offsets(model, other, t, _with(inputs, parameters, t))
        model, inputs = other, None if inputs is None else inputs.counted_from(t)
    able, point = regular_point(model, begin, initial, _with(inputs, given, begin))
    period = _period(able, point, begin)
    if inputs is not None:
        inputs.refuse_span(begin, begin + period.length)
    found = _Map(able, point, period, inputs, states).derivatives(requested)
    return replace(found, t=t)


def _with(inputs: GivenInputs | None, parameters: Mapping[Any, Any], t: float) -> Mapping[Any, Any]:
    return parameters if inputs is None else inputs.parameters(parameters, t)


def _period(model: CompiledModel, point: LinearPoint, t: float) -> _Period:
    """Return the period of all controllers of a model, whose constants are those of a point.

    Raises
    ------
    OptionError
        Where they have no common period.
    """
    kernels = sampling_kernels(model.stages.reduced)
    assert kernels is not None
    sampling = Sampling.of(point.program, kernels)
    schedule = sampling.schedules(point.c[np.newaxis])[0]
    sampling.instants(schedule, t, t)  # what makes no sense is rejected there
    periods, offsets = np.split(schedule, 2)
    ratios = [Fraction(period / periods[0]).limit_denominator(_MOST_PERIODS) for period in periods]
    every = Fraction(math.lcm(*(r.numerator for r in ratios)), math.gcd(*(r.denominator for r in ratios)))
    off = [abs(float(r) * periods[0] - p) > _SAME * p for r, p in zip(ratios, periods, strict=True)]
    if any(off) or any(every / r > _MOST_PERIODS for r in ratios):
        named = list_names(
            f"{action.name} ({period:.9g} s)" for action, period in zip(kernels.actions, periods, strict=True)
        )
        raise OptionError(
            f"linearize: the controllers {named} have no common period of at most {_MOST_PERIODS} periods of each, so"
            " that no map from one period to the next exists: give them periods whose ratios are small whole numbers,"
            " or compile a copy() of the scene with the controllers of one rate and the inputs of the others given"
        )
    length = float(every) * float(periods[0])
    ago = math.ceil(float(np.max(offsets)) / length)
    clock = SamplingClock(t - ago * length)
    times, acts = sampling.instants(schedule, t, t + length, clock)
    return _Period(length, clock, int(acts[0]) if len(times) and times[0] == t else 0)


class _Map:
    """The derivatives of the map over a period.

    Parameters
    ----------
    model : CompiledModel
        With constraints that are independent at the point.
    point : Point
        Where the period begins.
    period : _Period
    inputs : GivenInputs or None
    states : sequence of str or None
        The independent components of the state; None picks them.
    """

    def __init__(
        self,
        model: CompiledModel,
        point: LinearPoint,
        period: _Period,
        inputs: GivenInputs | None,
        states: Sequence[str] | None,
    ) -> None:
        self.model, self.point, self.period, self.inputs = model, point, period, inputs
        layout, actions = point.program.layout, model.stages.equations.controllers
        self.set = {name for i, item in enumerate(actions) if period.at_start >> i & 1 for name in item.inputs}
        chosen = None if states is None else [*states, *(name for name in layout.states if name in self.set)]
        self.states = independent_states(point, chosen)
        self.free = [i for i in self.states.places if self.states.equations.names[i] not in self.set]
        self.names = tuple(self.states.equations.names[i] for i in self.free)

    def _first(self) -> FloatArray:
        """Return the derivatives (n_y, n + n_u) of the state of the formulation where the period begins."""
        states, layout = self.states, self.point.program.layout
        columns = [states.places.index(i) for i in self.free]
        own = states.equations.formulation_state()
        by_inputs = own.by_parameters + own.by_state @ states.shift
        places = np.array(input_places(layout), dtype=np.intp)
        return np.hstack([own.by_state @ states.tangent[:, columns], by_inputs[:, places]])

    def derivatives(self, requested: Sequence[str] | None) -> DiscreteLinearization:
        """Return the map; `requested` are the names of the outputs, None those of the states.

        Raises
        ------
        RunFailedError
            Where the motion does not reach the end of the period.
        """
        model, point, names = self.model, self.point, self.names
        layout, n, t = point.program.layout, len(names), point.t
        outputs = names if requested is None else tuple(requested)
        of = tuple(dict.fromkeys((*names, *outputs)))
        wrt = (*names, *layout.inputs)
        variation = model.derived.variation(layout.variables, of, wrt)
        wide = _WITH_MULTIPLIERS if "stages" in point.program else 1.0
        rtol, atol = wide * _RTOL, wide * _ATOL
        end = t + self.period.length
        p = point.c[: len(layout.parameters)]
        problem = IntegrationProblem(
            t0=t,
            t1=end,
            y0=point.y,
            constants=starting_constants(point.program, point.c, t, end),
            rtol=rtol,
            atol=atol,
            t_eval=np.array([t, end]),
            inputs=None if self.inputs is None else self.inputs.records(layout),
            sampled=replace(self.period.clock, requested=np.array([t, end])),
        )
        method = variation.engine.automatic(model.methods, rtol, atol)
        problem, ended = ended_early(model, problem)
        run = variation.run(problem, self._first(), p, method, self._weighed())
        if run.status is not Status.SUCCESS or ended is not None or len(run.t) < 2:
            raise RunFailedError(
                f"linearize: the motion from t = {t:.9g} does not reach the end of the period of the controllers,"
                f" {self.period.length:.9g} s later: {run.message if ended is None else ended.message}"
            )
        begun = self.states.equations.state[self.free].copy()
        seen = [_row(name, names, of, begun, run.values[0], run.jacobians[0]) for name in outputs]
        table = np.array([row for _, row in seen]).reshape(len(outputs), len(wrt))
        return DiscreteLinearization(
            t=t,
            dt=self.period.length,
            A=run.jacobians[-1, :n, :n].copy(),
            B=run.jacobians[-1, :n, n:].copy(),
            C=table[:, :n].copy(),
            D=table[:, n:].copy(),
            drift=run.values[-1, :n] - begun,
            states=names,
            inputs=layout.inputs,
            outputs=outputs,
            values=begun,
            output_values=np.array([value for value, _ in seen]),
        )

    def _weighed(self) -> GivenInputs | None:
        """Return the inputs, each with a held change added to it."""
        if self.inputs is None:
            return None
        return replace(self.inputs, values={**self.inputs.values, **{weight_of(u): 1.0 for u in self.inputs.values}})


def _row(
    name: str,
    names: Sequence[str],
    of: Sequence[str],
    begun: FloatArray,
    values: FloatArray,
    jacobian: FloatArray,
) -> tuple[float, FloatArray]:
    """Return the value of an output and its derivatives by states and inputs; states are outputs as they are."""
    if name in names:
        place = names.index(name)
        return float(begun[place]), np.eye(jacobian.shape[1])[place]
    place = of.index(name)
    return float(values[place]), jacobian[place]
