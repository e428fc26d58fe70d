"""Records of the inputs of runs: coefficients at given times, knots, and their table in compiled loops.

Each lane has a piece of every record, which only moves on from knot to knot: the search for the first is the only one.
Values are read in place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..ir.program import WIDTH, KnotSides
from ..methods.step_constants import SMALLEST_OF_TIME
from ..subset.arguments import NO_CODE, Address, AddressTable, AddressVector, IntMatrix, IntVector, Matrix, OwnedAddress
from ..subset.compiled_subset import call_code, compiled_subset, element, lowest, row
from ..subset.packing import owned_address
from .samples import KINDS, Samples

HOLD, LINEAR, CUBIC = range(3)
"""Kinds of records."""


class InputTable(NamedTuple):
    """Records of inputs, of so many cases, in so many lanes.

    Attributes
    ----------
    knots, counts : (n_records,)
        Addresses of the knots, and how many there are.
    values, slopes, strides : (n_records,)
        Addresses of the values and of the derivatives of the first case, and the distance from case to case: 0 where
        all share them.
    kinds, first, last, beyond, places : (n_records,)
        Kinds; numbers of the first and the last piece; whether the slope continues beyond the knots; and where the knot
        and the coefficients are among the constants.
    shift, shift_stride : address, int
        The time at which the clock of the first case is zero, and the distance from case to case.
    rows : (n_cases,) or (0,)
        Which row belongs to a case, where it is not that of its number.
    pieces, edges : (n_records, lanes)
        The present piece of each record, and the time at which it ends.
    ends : (1, lanes)
        End of the case; a piece may end before.
    remembered : (m, lanes)
        Is overwritten.
    near, sides : address
        `Program.knot_sides` as code for so many lanes: whether a state is on a knot of a table or a switch, and the
        state with which a motion continues; 0 where it is the same.
    sided : (k, lanes)
        Gets the outputs of these.
    """

    knots: AddressVector
    counts: IntVector
    values: AddressVector
    slopes: AddressVector
    strides: IntVector
    kinds: IntVector
    first: IntVector
    last: IntVector
    beyond: IntVector
    places: IntVector
    shift: Address
    shift_stride: int
    rows: IntVector
    pieces: IntMatrix
    edges: Matrix
    ends: Matrix
    remembered: Matrix
    near: Address
    sides: Address
    sided: Matrix


def no_inputs() -> InputTable:
    """Return the table of a run without records."""
    none = np.zeros(0, np.int64)
    nothing = np.zeros((0, 1))
    pieces = np.zeros((0, 1), np.int64)
    addresses = AddressTable()
    about = addresses, none, addresses, addresses, *(none,) * 6, NO_CODE, 0, none, pieces
    return InputTable(*about, *(nothing,) * 3, NO_CODE, NO_CODE, nothing)


@compiled_subset
def begin_inputs(
    inputs: InputTable, constants: FloatArray, lane: int, case: int, t: float, t1: float, forward: bool
) -> float:
    """Write the coefficients at the start of a case into the constants (n_c, lanes); return where the first piece ends.

    ``t`` and ``t1`` are start and end of the case.
    """
    number = _row(inputs, case)
    shift = _shift(inputs, number)
    for r in range(inputs.knots.size):
        low, high, knots = 0, inputs.counts[r], inputs.knots[r]
        while low < high:  # so many knots lie before the start
            middle = (low + high) // 2
            knot = element(knots, middle) - shift
            if knot < t or (forward and knot == t):
                low = middle + 1
            else:
                high = middle
        inputs.pieces[r, lane] = min(max(low - 1, inputs.first[r]), inputs.last[r])
        _load(inputs, constants, r, lane, number, shift)
        inputs.edges[r, lane] = _edge(inputs, r, lane, shift, forward)
    inputs.ends[0, lane] = t1
    return pass_knots(inputs, constants, lane, case, t, forward)


@compiled_subset
def pass_knots(inputs: InputTable, constants: FloatArray, lane: int, case: int, t: float, forward: bool) -> float:
    """Write the coefficients of the pieces that begin at a time; return where the first of the present pieces ends."""
    end, close = inputs.ends[0, lane], SMALLEST_OF_TIME * abs(t)
    number = _row(inputs, case)
    shift = _shift(inputs, number)
    first = end
    for r in range(inputs.knots.size):
        edge = inputs.edges[r, lane]
        moved = False
        while ((edge - t) if forward else (t - edge)) <= close:
            inputs.pieces[r, lane] = inputs.pieces[r, lane] + (1 if forward else -1)
            edge = _edge(inputs, r, lane, shift, forward)
            moved = True
        if moved:
            inputs.edges[r, lane] = edge
            _load(inputs, constants, r, lane, number, shift)
        first = min(first, edge) if forward else max(first, edge)
    return first if abs(end - first) > SMALLEST_OF_TIME * abs(end) else end


@compiled_subset
def take_sides(
    inputs: InputTable, clock: FloatArray, states: FloatArray, place: int, constants: FloatArray, n: int, lanes: int
) -> None:
    """Move the states of some lanes (a bit for each) to the sides of knots and switches that their motions go to.

    ``clock`` (k, lanes) begins with their times, the `n` rows of states begin at a place, and ``constants`` (n_c,
    lanes) are those of what follows.
    """
    if inputs.sides == 0 or lanes == 0:
        return
    now, y, c, sided = row(clock, 0), row(states, place), row(constants, 0), row(inputs.sided, 0)
    call_code(inputs.near, now, y, c, 0, sided)
    left, found = lanes, 0.0
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        found += inputs.sided[0, lane]
    if found == 0.0:
        return
    left = lanes
    call_code(inputs.sides, now, y, c, 0, sided)
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        first = 0 if inputs.ends[0, lane] >= clock[0, lane] else n
        for m in range(n):
            states[place + m, lane] = inputs.sided[first + m, lane]


@compiled_subset
def _row(inputs: InputTable, case: int) -> int:
    """Return the number of the row that belongs to a case."""
    return inputs.rows[case] if inputs.rows.size > 0 else case


@compiled_subset
def _shift(inputs: InputTable, number: int) -> float:
    """Return the time at which the clock of a case is zero, where there are records."""
    return element(inputs.shift, inputs.shift_stride * number) if inputs.knots.size > 0 else 0.0


@compiled_subset
def _edge(inputs: InputTable, r: int, lane: int, shift: float, forward: bool) -> float:
    """Return the time at which the present piece of a record ends in the direction of time."""
    piece = inputs.pieces[r, lane]
    if forward:
        return element(inputs.knots[r], piece + 1) - shift if piece < inputs.last[r] else np.inf
    return element(inputs.knots[r], piece) - shift if piece > inputs.first[r] else -np.inf


@compiled_subset
def _load(inputs: InputTable, constants: FloatArray, r: int, lane: int, number: int, shift: float) -> None:
    """Write knot and coefficients of the present piece of a record into the constants of a lane."""
    knots, kind, place = inputs.knots[r], inputs.kinds[r], inputs.places[r]
    piece, last = inputs.pieces[r, lane], inputs.counts[r] - 1
    values, slopes, offset = inputs.values[r], inputs.slopes[r], inputs.strides[r] * number
    at, left = max(piece, 0), min(max(piece, 0), last - 1)
    inside = 0 <= piece and piece < last
    goes_on = inside or inputs.beyond[r] != 0
    knot, value = element(knots, at), element(values, offset + at)
    rate, bend, twist = 0.0, 0.0, 0.0
    if kind != HOLD and last > 0 and goes_on:
        width = element(knots, left + 1) - element(knots, left)
        slope = (element(values, offset + left + 1) - element(values, offset + left)) / width
        rate = slope
        if kind == CUBIC:
            rate = element(slopes, offset + at)
            if inside:
                second = (rate + element(slopes, offset + at + 1) - 2.0 * slope) / width
                bend, twist = (slope - rate) / width - second, second / width
    constants[place, lane], constants[place + 1, lane] = knot - shift, value
    constants[place + 2, lane], constants[place + 3, lane], constants[place + 4, lane] = rate, bend, twist


IntArray = NDArray[np.intp]


@final
@frozen(eq=False)
class InputRecords:
    """The inputs of a program that have knots.

    Attributes
    ----------
    records : tuple of Samples
    places : tuple of int
        Where the parameters of each begin, among parameters and constants.
    shift : ndarray (1,) or (k,)
        Time [s] at which the clock of the run is zero, or that of each case.
    rows : ndarray (n_case,) or None
        Which rows of records and shifts belong to the cases; None where row i is that of case i.
    sides : KnotSides or None
        `Program.knot_sides`: kernels of the state with which a motion continues at a knot, None where it is the same.
    sides_code : (OwnedAddress, OwnedAddress)
        Addresses of these kernels as code for the lanes of a loop.
    """

    records: tuple[Samples, ...]
    places: tuple[int, ...]
    shift: FloatArray
    rows: NDArray[np.int64] | None = None
    sides: KnotSides | None = None
    sides_code: tuple[OwnedAddress, OwnedAddress] = (NO_CODE, NO_CODE)

    def compiled(self, code: Callable[[Kernel], OwnedAddress]) -> InputRecords:
        """Return the records with the addresses of the kernels of sides."""
        if self.sides is None:
            return self
        return replace(self, sides_code=(code(self.sides.near), code(self.sides.sides)))

    def part(self, cases: slice | IntArray, count: int) -> InputRecords:
        """Return the records of some of so many cases."""
        rows = np.arange(count) if self.rows is None else self.rows
        return replace(self, rows=np.ascontiguousarray(rows[cases], np.int64))

    def case(self, number: int) -> InputRecords:
        """Return the records of one case."""
        row = number if self.rows is None else int(self.rows[number])
        return replace(self, rows=np.array([row]))

    def write(
        self,
        constants: FloatArray,
        t: FloatArray,
        cases: IntArray | int = 0,
        after: bool | NDArray[np.bool_] = True,
    ) -> None:
        """Write knots and coefficients at times (m,) of cases (m,) into constants or parameters (m, n).

        At a knot they are those of the piece that follows in time; where not `after`, of the piece before it.
        """
        rows = np.asarray(cases) if self.rows is None else self.rows[cases]
        shift = self.shift if len(self.shift) == 1 else self.shift[rows]
        for record, place in zip(self.records, self.places, strict=True):
            found = record.coefficients(record.pieces(t + shift, after=after), rows)
            found[:, 0] -= shift
            constants[:, place : place + WIDTH] = found

    def knots(self, t0: float, t1: float, case: int = 0) -> FloatArray:
        """Return the knots (m,) strictly between two times of a case, in the direction from one to the other."""
        row = case if self.rows is None else int(self.rows[case])
        shift = float(self.shift[0] if len(self.shift) == 1 else self.shift[row])
        low, high = min(t0, t1), max(t0, t1)
        found = []
        for record in self.records:
            times = record.t[record.first + 1 : record.last + 1] - shift
            found.append(times[(times > low) & (times < high)])
        every = np.unique(np.concatenate([np.zeros(0), *found]))
        close = SMALLEST_OF_TIME * np.abs(every)
        every = every[(every - low > close) & (high - every > close)]
        apart = np.ones(len(every), bool)
        apart[1:] = np.diff(every) > SMALLEST_OF_TIME * np.abs(every[1:])
        return every[apart] if t1 >= t0 else every[apart][::-1]

    def table(self, lanes: int, remembered: int = 0) -> InputTable:
        """Return the table of the records for a loop over lanes whose steps have a memory of some size."""
        records, count = self.records, len(self.records)

        def each(numbers: list[int]) -> NDArray[np.int64]:
            return np.array(numbers, np.int64)

        return InputTable(
            knots=AddressTable(owned_address(record.t) for record in records),
            counts=each([len(record.t) for record in records]),
            values=AddressTable(owned_address(record.values) for record in records),
            slopes=AddressTable(
                NO_CODE if record.slopes is None else owned_address(record.slopes) for record in records
            ),
            strides=each([0 if record.cases is None else len(record.t) for record in records]),
            kinds=each([KINDS.index(record.kind) for record in records]),
            first=each([record.first for record in records]),
            last=each([record.last for record in records]),
            beyond=each([int(record.extrapolate == "linear") for record in records]),
            places=each(list(self.places)),
            shift=owned_address(self.shift),
            shift_stride=int(len(self.shift) > 1),
            rows=np.zeros(0, np.int64) if self.rows is None else self.rows,
            pieces=np.zeros((count, lanes), np.int64),
            edges=np.zeros((count, lanes)),
            ends=np.zeros((1, lanes)),
            remembered=np.zeros((remembered, lanes)),
            near=self.sides_code[0],
            sides=self.sides_code[1],
            sided=np.zeros((0 if self.sides is None else len(self.sides.sides.outputs), lanes)),
        )
