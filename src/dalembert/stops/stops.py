"""Stops of compiled loops: times known before a run at which something is decided or done, passed in place.

These are changes of conditions on time, instants of controllers and knots of inputs. A step ends at each; the loop
writes what counts from there on, and the case continues in its lane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..methods.step_constants import SMALLEST_OF_TIME
from ..subset.arguments import NO_CODE, AddressTable, AddressVector, IntVector, Matrix, OwnedAddress, Vector
from ..subset.compiled_subset import call_code, compiled_subset, lowest, row
from ..subset.packing import constant_group
from .input_records import InputTable, begin_inputs, no_inputs, pass_knots, take_sides

if TYPE_CHECKING:
    from .input_records import InputRecords
    from .segments import Segments


class StopTable(NamedTuple):
    """The stops of cases, in so many lanes.

    Attributes
    ----------
    first, last : (k,) or (0,)
        Which of the stops are those of each case, in the order in which it meets them: from the first on, before the
        last. Cases may share them. Nothing where there are knots of inputs only.
    times, acts, middles : (n,)
        Times; which actions happen there, as bits; and at which time conditions are decided from there on, NaN where
        that does not change.
    place : int
        Parameter at whose value conditions are decided, -1 for none.
    actions : (n_actions,)
        Code of what each action sets, of time, state, constants, and `before` in place of settings.
    columns, places : (n_actions + 1,), (m,)
        Where the components of the state that each action sets begin, and their numbers.
    next, until, acting : (lanes,)
        The next stop of each lane and the end of its list, and which actions happen in it.
    before : (1 + n_c, lanes) or (1, lanes)
        1 for lanes in which the present action happens; then, where an action reads them, constants before the stop.
    acted, prepared : (m, lanes), (n_c, lanes)
        Are overwritten.
    inputs : InputTable
        Records of inputs, and the ends of the cases.
    """

    first: IntVector
    last: IntVector
    times: Vector
    acts: IntVector
    middles: Vector
    place: int
    actions: AddressVector
    columns: IntVector
    places: IntVector
    next: IntVector
    until: IntVector
    acting: IntVector
    before: Matrix
    acted: Matrix
    prepared: Matrix
    inputs: InputTable


def no_stops(inputs: InputTable | None = None) -> StopTable:
    """Return a table without stops but the knots of inputs."""
    return _NO_STOPS if inputs is None else _NO_STOPS._replace(inputs=inputs)


def _nothing() -> StopTable:
    none, nothing, room = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 1))
    about = none, none, nothing, none, nothing, -1, AddressTable(), none, none
    return StopTable(*about, *(none,) * 3, *(room,) * 3, no_inputs())


_NO_STOPS = constant_group(_nothing())


def table_of(stops: CaseStops | None, inputs: InputRecords | None, constants: int, remembered: int = 0) -> StopTable:
    """Return the table of a case that is alone, with so many constants, whose steps remember so many numbers."""
    table = None if inputs is None else inputs.table(1, remembered)
    return no_stops(table) if table is None or stops is None else stops.table(table, 1, constants)


@compiled_subset
def begin_stops(
    stops: StopTable, constants: FloatArray, lane: int, case: int, t: float, t1: float, forward: bool
) -> float:
    """Begin a case in a lane: find its first stop, and write its inputs; return where the first piece of these ends.

    ``t`` and ``t1`` are start and end of the case.
    """
    if stops.first.size > 0:
        stops.next[lane], stops.until[lane] = stops.first[case], stops.last[case]
    return begin_inputs(stops.inputs, constants, lane, case, t, t1, forward)


@compiled_subset
def end_of_steps(stops: StopTable, lane: int, end: float, forward: bool) -> float:
    """Return where the next steps of a lane end: at a knot or the end of its case, or at a stop before that."""
    if stops.first.size == 0 or stops.next[lane] == stops.until[lane]:
        return end
    time = stops.times[stops.next[lane]]
    return min(end, time) if forward else max(end, time)


@compiled_subset
def is_due(stops: StopTable, lane: int, t: float, forward: bool) -> bool:
    """Return whether a lane has reached its next stop."""
    if stops.first.size == 0 or stops.next[lane] == stops.until[lane]:
        return False
    time, close = stops.times[stops.next[lane]], SMALLEST_OF_TIME * abs(t)
    return (time - t if forward else t - time) <= close


@compiled_subset
def take_next(stops: StopTable, constants: FloatArray, lane: int) -> bool:
    """Take the next stop of a lane; return whether conditions are decided anew."""
    number = stops.next[lane]
    stops.next[lane], stops.acting[lane] = number + 1, stops.acts[number]
    middle = stops.middles[number]
    if stops.place < 0 or math.isnan(middle):
        return False
    constants[stops.place, lane] = middle
    return True


@compiled_subset
def act(stops: StopTable, clock: FloatArray, states: FloatArray, place: int, constants: FloatArray) -> None:
    """Let the actions that happen in lanes set their components of the state, whose rows begin at a place."""
    for a in range(stops.actions.size):
        some = False
        for lane in range(stops.acting.size):
            here = stops.acting[lane] >> a & 1 != 0
            stops.before[0, lane] = 1.0 if here else 0.0
            some = some or here
        if not some:
            continue
        before, acted = row(stops.before, 0), row(stops.acted, 0)
        call_code(stops.actions[a], row(clock, 0), row(states, place), row(constants, 0), before, acted)
        first = stops.columns[a]
        for lane in range(stops.acting.size):
            if stops.before[0, lane] != 0.0:
                for m in range(first, stops.columns[a + 1]):
                    states[place + stops.places[m], lane] = stops.acted[m - first, lane]


@compiled_subset
def prepare_lanes(stops: StopTable, prepare: int, constants: FloatArray, lanes: int) -> None:
    """Compute the constants of some lanes (a bit for each) from their parameters, the first of the constants."""
    left = lanes
    call_code(prepare, row(constants, 0), 0, 0, 0, row(stops.prepared, 0))
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        for m in range(constants.shape[0]):
            constants[m, lane] = stops.prepared[m, lane]


@compiled_subset
def take_stops(
    stops: StopTable,
    prepare: int,
    clock: FloatArray,
    states: FloatArray,
    place: int,
    constants: FloatArray,
    n: int,
    forward: bool,
) -> None:
    """Take the stops at the present time of a run that is alone, and move its state to the sides that it goes to.

    The `n` rows of its state begin at a place.
    """
    while is_due(stops, 0, clock[0, 0], forward):
        if take_next(stops, constants, 0):
            prepare_lanes(stops, prepare, constants, 1)
        act(stops, clock, states, place, constants)
    take_sides(stops.inputs, clock, states, place, constants, n, 1)


@compiled_subset
def pass_stops(
    stops: StopTable,
    prepare: int,
    clock: FloatArray,
    states: FloatArray,
    place: int,
    constants: FloatArray,
    n: int,
    forward: bool,
) -> float:
    """Pass the stops and knots at the present time of a run that is alone; return where its next steps end.

    Arguments are those of `take_stops`.
    """
    for m in range(stops.before.shape[0] - 1):
        stops.before[1 + m, 0] = constants[m, 0]
    end = pass_knots(stops.inputs, constants, 0, 0, clock[0, 0], forward)
    take_stops(stops, prepare, clock, states, place, constants, n, forward)
    return end_of_steps(stops, 0, end, forward)


# The stops of many cases, and their table for loops.

Landing = Callable[[float, FloatArray, FloatArray, FloatArray], FloatArray]
"""From a time, a state (n_y,) and the constants (n_c,) before and after it to the state after it."""


@final
@frozen(eq=False)
class StopAction:
    """An action at stops: a kernel of (t, y, c), or a Python function, that sets the components `places` of a state."""

    places: tuple[int, ...]
    kernel: Kernel | None = None
    function: Landing | None = None


@final
@frozen(eq=False)
class StopLists:
    """Lists of stops; see `StopTable` for the arrays."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    times: FloatArray
    acts: NDArray[np.int64]
    middles: FloatArray


@final
@frozen(eq=False)
class CaseStops:
    """The stops of many cases.

    Attributes
    ----------
    lists : StopLists
    place : int or None
        Parameter at whose value conditions are decided.
    actions : tuple of StopAction
        In the order in which they happen at one time; the bits of `lists` are their numbers.
    codes : tuple of OwnedAddress
        Actions as code for the lanes of a loop.
    along : Segments or None
        Constants along the run of a case that is alone.
    behind : bool
        Whether accepted steps of that run hold the states behind stops, not those before.
    prepare : OwnedAddress
        Code of the constants, for that run.
    failure : function without arguments
        Raises what Python functions among the actions have raised.
    """

    lists: StopLists
    place: int | None
    actions: tuple[StopAction, ...]
    codes: tuple[OwnedAddress, ...] = ()
    along: Segments | None = None
    behind: bool = False
    prepare: OwnedAddress = NO_CODE
    failure: Callable[[], None] | None = None

    def compiled(
        self,
        code: Callable[[StopAction], OwnedAddress],
        prepare: OwnedAddress = NO_CODE,
        failure: Callable[[], None] | None = None,
    ) -> CaseStops:
        """Return the stops with actions as code; for `prepare` and `failure` see above."""
        return replace(self, codes=tuple(map(code, self.actions)), prepare=prepare, failure=failure)

    def raise_failure(self) -> None:
        """Raise what Python functions among the actions have raised since the last call, if anything."""
        if self.failure is not None and self.calls:
            self.failure()

    @property
    def calls(self) -> bool:
        """Whether actions are Python functions, whose errors wait for `dalembert.codegen.host_code.raise_failure`."""
        return any(action.function is not None for action in self.actions)

    def table(self, inputs: InputTable, lanes: int, constants: int) -> StopTable:
        """Return the table of the stops, and of inputs, for a loop over lanes with so many constants."""
        sizes = [len(action.places) for action in self.actions]
        next_, until, acting = np.zeros((3, lanes), np.int64)
        return StopTable(
            first=self.lists.first,
            last=self.lists.last,
            times=self.lists.times,
            acts=self.lists.acts,
            middles=self.lists.middles,
            place=-1 if self.place is None else self.place,
            actions=AddressTable(self.codes),
            columns=np.cumsum([0, *sizes]).astype(np.int64),
            places=np.array([place for action in self.actions for place in action.places], np.int64),
            next=next_,
            until=until,
            acting=acting,
            before=np.zeros((1 + (constants if self.calls else 0), lanes)),
            acted=np.zeros((max(sizes, default=0), lanes)),
            prepared=np.zeros((constants, lanes)),
            inputs=inputs,
        )
