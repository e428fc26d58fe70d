"""Records of the inputs of one run, or of many cases: coefficients at given times, knots, and their table for loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.kernel import Kernel
from ..ir.program import WIDTH, KnotSides
from ..methods.step_constants import SMALLEST_OF_TIME
from ..subset.addresses import NO_CODE, AddressTable, OwnedAddress
from ..subset.arguments import owned_address
from .input_steps import InputTable
from .samples import KINDS, Samples

IntArray = NDArray[np.intp]


@final
@dataclass(frozen=True, eq=False)
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
        `Program.knot_sides`: kernels of the state with which a motion goes on at a knot, None where it is the same.
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
