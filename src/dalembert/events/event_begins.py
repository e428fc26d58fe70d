"""Values, rates and rounding errors of watched expressions at one state of a case.

One kernel gives them where it is short. Else the partial derivatives that the rounding errors follow from
(`dalembert.reduction.state_reader`) are derivatives along one component of the state at a time, by a kernel that is as
long whatever their number, for as many components in a call as it has lanes.
"""

from __future__ import annotations

from ..lanes.workspace import SLOPE_LANES, EventKernels, EventWorkspace
from ..reduction.event_functions import ROUNDINGS
from ..subset.compiled_subset import call_code, compiled_subset, row


@compiled_subset
def take_begins(events: EventKernels, space: EventWorkspace, lane: int, one: int, t: float) -> None:
    """Write value, rate and noise of each expression to ``one_out``; the state is in the first row of ``one_point``.

    ``one`` is the address of the constants of the lane, which are those of its row of ``own``.
    """
    space.one_clock[0, 0] = t
    clock, point = row(space.one_clock, 0), row(space.one_point, 0)
    if events.slopes == 0:
        call_code(events.begins, clock, point, one, 0, row(space.one_out, 0))
        return
    call_code(events.begins, clock, point, one, 0, row(space.known, 0))
    n, count = space.series.shape[0], events.directions.size
    for k in range(SLOPE_LANES):
        space.spread[0, k] = t
        for m in range(space.own.shape[1]):
            space.spread[1 + m, k] = space.own[lane, m]
        for m in range(n):
            space.direction[m, k] = space.one_point[0, m]
    _add_components(events, space, t)
    _add_directions(events, space)
    for e in range(count):
        space.one_out[0, 3 * e] = space.known[0, e]
        space.one_out[0, 3 * e + 2] = ROUNDINGS * space.sizes[0, e] + space.known[0, count + e]


@compiled_subset
def _call_slopes(events: EventKernels, space: EventWorkspace) -> None:
    """Evaluate the derivatives along the directions of all lanes."""
    clock, constants = row(space.spread, 0), row(space.spread, 1)
    call_code(events.slopes, clock, row(space.direction, 0), constants, 0, row(space.slopes, 0))


@compiled_subset
def _add_components(events: EventKernels, space: EventWorkspace, t: float) -> None:
    """Add up the sizes of expressions and residuals over the components of the state and time."""
    n, first = space.series.shape[0], 0
    size = events.directions.size + events.residuals
    for e in range(size):
        space.sizes[0, e] = 0.0
    while first < events.varying.size:
        some = min(SLOPE_LANES, events.varying.size - first)
        for m in range(n + 1):
            for k in range(SLOPE_LANES):
                space.direction[n + m, k] = 0.0
        for k in range(some):
            place = events.varying[first + k]
            space.direction[n + place, k] = t if place == n else space.one_point[0, place]
        _call_slopes(events, space)
        for e in range(size):
            for k in range(some):
                space.sizes[0, e] += abs(space.slopes[e, k])
        first += SLOPE_LANES


@compiled_subset
def _add_directions(events: EventKernels, space: EventWorkspace) -> None:
    """Write the rates along the motion, and add what the residuals make of the expressions."""
    n, count, first = space.series.shape[0], events.directions.size, 0
    while first < 1 + events.residuals:
        some = min(SLOPE_LANES, 1 + events.residuals - first)
        for k in range(SLOPE_LANES):
            number = min(first + k, events.residuals)
            space.direction[2 * n, k] = 1.0 if number == 0 else 0.0
            for m in range(n):
                space.direction[n + m, k] = space.known[0, 2 * count + number * n + m]
        _call_slopes(events, space)
        for k in range(some):
            number = first + k
            for e in range(count):
                if number == 0:
                    space.one_out[0, 3 * e + 1] = space.slopes[e, k]
                else:
                    space.sizes[0, e] += abs(space.slopes[e, k]) * space.sizes[0, count + number - 1]
        first += SLOPE_LANES
