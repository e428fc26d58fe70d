"""Stops of the loop over phases: times at which conditions on time change, inputs have knots, and controllers act.

A stop ends a run of the loop over lanes, not a phase: the mode continues after it, with other parameters, and what has
changed its sign by that occurs at once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..ir.program import WIDTH
from ..methods.step_constants import SMALLEST_OF_TIME
from ..stops.input_records import begin_inputs, pass_knots
from ..stops.stops import StopTable, end_of_steps, is_due, no_stops
from ..subset.arguments import Matrix, Vector
from ..subset.compiled_subset import call_code, compiled_subset, row
from .slip_begins import forget_breaks

if TYPE_CHECKING:
    from .phase_tables import CaseTable, ThreadWorkspace

BEFORE_START = -1
"""In place of the next stop of a case, which is not found yet: the first at its time or behind it."""


class PhaseStops(NamedTuple):
    """Stops of all cases.

    Attributes
    ----------
    table : StopTable
        With a lane for each case, whose next stop may be `BEFORE_START`; actions are controllers, which set variables.
    edges : (k,)
        Where the first of the present pieces of inputs ends.
    coefficients : (n_p, k) or (0, 0)
        Parameters as inputs write them.
    """

    table: StopTable
    edges: Vector
    coefficients: Matrix


def no_phase_stops() -> PhaseStops:
    """Return a table without stops."""
    return PhaseStops(no_stops(), np.zeros(0), np.zeros((0, 0)))


@compiled_subset
def load_case(table: CaseTable, space: ThreadWorkspace, i: int, lane: int) -> None:
    """Write time, parameters and variables of a case to a lane, as arguments of kernels."""
    space.clock[0, lane] = table.cases.t[i]
    for m in range(table.cases.p.shape[1]):
        space.scene[m, lane] = table.cases.p[i, m]
    for m in range(table.cases.x.shape[1]):
        space.posed[m, lane] = table.cases.x[i, m]


@compiled_subset
def _write_inputs(table: CaseTable, i: int) -> None:
    """Copy the coefficients of the inputs of a case to its parameters."""
    inputs = table.stops.table.inputs
    for r in range(inputs.places.size):
        for m in range(WIDTH):
            place = inputs.places[r] + m
            table.cases.p[i, place] = table.stops.coefficients[place, i]


@compiled_subset
def begin_stops(table: CaseTable, i: int) -> None:
    """Find the next stop of a case, unless that is known, and take its inputs from its time on."""
    stops, edges, t, forward = table.stops.table, table.stops.edges, table.cases.t[i], table.t1[i] >= table.cases.t[i]
    if stops.first.size == 0 or stops.next[i] >= 0:
        return
    direction, place = 1.0 if forward else -1.0, stops.first[i]
    while place < stops.last[i] and (stops.times[place] - t) * direction < 0.0:
        place += 1
    stops.next[i], stops.until[i] = place, stops.last[i]
    if stops.inputs.knots.size > 0:
        edges[i] = begin_inputs(stops.inputs, table.stops.coefficients, i, i, t, table.t1[i], forward)
        _write_inputs(table, i)


@compiled_subset
def goes_to(table: CaseTable, i: int, goal: float) -> float:
    """Return where the next run of a case ends: at a goal, or at the first stop before that."""
    stops, forward = table.stops.table, table.t1[i] >= table.cases.t[i]
    if stops.first.size == 0:
        return goal
    goal = end_of_steps(stops, i, goal, forward)
    if stops.inputs.knots.size > 0:
        goal = min(goal, table.stops.edges[i]) if forward else max(goal, table.stops.edges[i])
    return goal


@compiled_subset
def _reach(table: CaseTable, i: int) -> tuple[int, float]:
    """Give a case the parameters behind the stops at its time.

    Return which controllers act there, and when conditions are decided for them: NaN where that is as behind the stops.
    """
    stops, t, forward = table.stops.table, table.cases.t[i], table.t1[i] >= table.cases.t[i]
    begun, acts, when, edges = stops.next[i], 0, math.nan, table.stops.edges
    while is_due(stops, i, t, forward):
        place = stops.next[i]
        acts += stops.acts[place]
        if stops.acts[place] != 0:
            when = stops.middles[place]
        if stops.place >= 0 and not math.isnan(stops.middles[place]):
            table.cases.p[i, stops.place] = stops.middles[place]
        stops.next[i] = place + 1
    passes = stops.next[i] > begun
    left = edges[i] - t if forward else t - edges[i]
    if stops.inputs.knots.size > 0 and left <= SMALLEST_OF_TIME * abs(t):
        edges[i] = pass_knots(stops.inputs, table.stops.coefficients, i, i, t, forward)
        _write_inputs(table, i)
        passes = True
    if passes:
        forget_breaks(table.cases, i)
    return acts, when


@compiled_subset
def pass_stops(table: CaseTable, space: ThreadWorkspace) -> None:
    """Continue the cases in ``reaching`` from the stops that they have reached, which get the controllers that act."""
    stops, reaching = table.stops.table, space.reaching
    if stops.first.size == 0:
        return
    for lane in range(reaching.shape[1]):
        reaching[1, lane] = 0
        if reaching[0, lane] >= 0:
            reaching[1, lane], when = _reach(table, reaching[0, lane])
            load_case(table, space, reaching[0, lane], lane)
            if stops.place >= 0 and not math.isnan(when):
                space.scene[stops.place, lane] = when
    for a in range(stops.actions.size):
        acting = False
        for lane in range(reaching.shape[1]):
            acting = acting or reaching[1, lane] >> a & 1 != 0
        if not acting:
            continue
        clock, posed, scene = row(space.clock, 0), row(space.posed, 0), row(space.scene, 0)
        call_code(stops.actions[a], clock, posed, scene, 0, row(space.acted, 0))
        for lane in range(reaching.shape[1]):
            if reaching[1, lane] >> a & 1 != 0:
                for m in range(stops.columns[a], stops.columns[a + 1]):
                    table.cases.x[reaching[0, lane], stops.places[m]] = space.acted[m - stops.columns[a], lane]
                    space.posed[stops.places[m], lane] = space.acted[m - stops.columns[a], lane]
    for lane in range(reaching.shape[1]):
        if reaching[1, lane] != 0:
            load_case(table, space, reaching[0, lane], lane)
