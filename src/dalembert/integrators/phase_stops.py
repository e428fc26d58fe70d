"""Stops of the loop over phases: times at which conditions on time change, inputs have knots, and controllers act.

A stop ends a run of the loop over lanes, not a phase: the mode continues after it, with other parameters, and what has
changed its sign by that occurs at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.input_parameters import WIDTH
from ..methods.step_constants import SMALLEST_OF_TIME
from .arguments import IntVector, Matrix, Vector
from .compiled_subset import call_code, compiled_subset, row
from .contact_cases import ContactCases
from .input_steps import InputTable, begin_inputs, no_inputs, pass_knots

__all__ = ["BEFORE_START", "StopTable", "begin_stops", "goes_to", "no_stops", "pass_stops"]

BEFORE_START = -1
"""In place of the next stop of a case, which is not found yet: the first at its time or behind it."""


class StopTable(NamedTuple):
    """Stops of all cases.

    Attributes
    ----------
    first : (k + 1,) or (0,)
        Where the stops of each case begin; nothing where no case has any.
    times, acts, middles : (n,)
        Times in the direction of each case; which controllers act, as bits; and at which time conditions are decided
        from there on, NaN where that does not change.
    next : (k,)
        The next stop, or `BEFORE_START`.
    edges : (k,)
        Where the first of the present pieces of inputs ends.
    place : int
        Parameter at whose value conditions are decided.
    kernels : (n_controllers,)
        Code of what each controller sets.
    columns, places : (n_controllers + 1,), (m,)
        Where the variables that each controller sets begin, and their places.
    inputs : InputTable
        Records of inputs, a lane for each case.
    coefficients : (n_p, k) or (0, 0)
        Parameters as `inputs` writes them.
    """

    first: IntVector
    times: Vector
    acts: IntVector
    middles: Vector
    next: IntVector
    edges: Vector
    place: int
    kernels: IntVector
    columns: IntVector
    places: IntVector
    inputs: InputTable
    coefficients: Matrix


def no_stops() -> StopTable:
    """Return what stands where no case stops."""
    none, nothing = np.zeros(0, np.int64), np.zeros(0)
    about = none, nothing, none, nothing, none, nothing, 0, none, none, none
    return StopTable(*about, no_inputs(), np.zeros((0, 0)))


@compiled_subset
def _write_inputs(stops: StopTable, p: FloatArray, i: int) -> None:
    """Copy the coefficients of the inputs of a case to its parameters."""
    for r in range(stops.inputs.places.size):
        for m in range(WIDTH):
            place = stops.inputs.places[r] + m
            p[i, place] = stops.coefficients[place, i]


@compiled_subset
def begin_stops(stops: StopTable, p: FloatArray, i: int, t: float, t1: float) -> None:
    """Find the next stop of a case at a time, and let its inputs be those from there on."""
    if stops.first.size == 0 or stops.next[i] >= 0:
        return
    direction = 1.0 if t1 >= t else -1.0
    place = stops.first[i]
    while place < stops.first[i + 1] and (stops.times[place] - t) * direction < 0.0:
        place += 1
    stops.next[i] = place
    if stops.inputs.knots.size > 0:
        stops.edges[i] = begin_inputs(stops.inputs, stops.coefficients, i, i, t, t1, direction > 0.0)
        _write_inputs(stops, p, i)


@compiled_subset
def goes_to(stops: StopTable, i: int, goal: float, t1: float, t: float) -> float:
    """Return where the next run of a case ends: at a goal, or at the first stop before that."""
    if stops.first.size == 0:
        return goal
    direction = 1.0 if t1 >= t else -1.0
    if stops.next[i] < stops.first[i + 1] and (stops.times[stops.next[i]] - goal) * direction < 0.0:
        goal = stops.times[stops.next[i]]
    if stops.inputs.knots.size > 0 and (stops.edges[i] - goal) * direction < 0.0:
        goal = stops.edges[i]
    return goal


@compiled_subset
def _reach(stops: StopTable, p: FloatArray, i: int, t: float, t1: float) -> int:
    """Let the parameters of a case be those behind the stops at a time; return which controllers act there."""
    direction, close = 1.0 if t1 >= t else -1.0, SMALLEST_OF_TIME * abs(t)
    place, acts = stops.next[i], 0
    while place < stops.first[i + 1] and (stops.times[place] - t) * direction <= close:
        acts += stops.acts[place]
        if not math.isnan(stops.middles[place]):
            p[i, stops.place] = stops.middles[place]
        place += 1
    stops.next[i] = place
    if stops.inputs.knots.size > 0 and (stops.edges[i] - t) * direction <= close:
        stops.edges[i] = pass_knots(stops.inputs, stops.coefficients, i, i, t, direction > 0.0)
        _write_inputs(stops, p, i)
    return acts


@compiled_subset
def pass_stops(
    stops: StopTable,
    cases: ContactCases,
    t: FloatArray,
    t1: FloatArray,
    p: FloatArray,
    reaching: NDArray[np.int64],
    clock: FloatArray,
    posed: FloatArray,
    scene: FloatArray,
    acted: FloatArray,
) -> None:
    """Continue cases from the stops that they have reached.

    ``reaching`` (2, lanes) has a case for each lane, or -1, and gets the controllers that act. Their times, variables
    and parameters are in ``clock``, ``posed`` and ``scene``.
    """
    for lane in range(reaching.shape[1]):
        i = reaching[0, lane]
        acts = 0
        if i >= 0:
            acts = _reach(stops, p, i, t[i], t1[i])
            for m in range(p.shape[1]):
                scene[m, lane] = p[i, m]
            for m in range(cases.x.shape[1]):
                posed[m, lane] = cases.x[i, m]
        reaching[1, lane] = acts
    for a in range(stops.kernels.size):
        wanted = False
        for lane in range(reaching.shape[1]):
            wanted = wanted or reaching[1, lane] >> a & 1 != 0
        if not wanted:
            continue
        call_code(stops.kernels[a], row(clock, 0), row(posed, 0), row(scene, 0), 0, row(acted, 0))
        for lane in range(reaching.shape[1]):
            i = reaching[0, lane]
            if i < 0 or reaching[1, lane] >> a & 1 == 0:
                continue
            for m in range(stops.columns[a], stops.columns[a + 1]):
                cases.x[i, stops.places[m]] = acted[m - stops.columns[a], lane]
                posed[stops.places[m], lane] = acted[m - stops.columns[a], lane]
