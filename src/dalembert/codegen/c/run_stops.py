"""Stops of exported runs inside of their span, and numbers in place of the addresses of their kernels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from ...frozen import frozen
from ...ir.conditions import Conditions
from ...stops.break_tables import breaks_of
from ...stops.input_records import no_inputs
from ...stops.instants import InstantTable, instants_of, no_instants, stops_at_instants
from ...stops.stops import StopTable, no_stops
from ...subset.arguments import NO_CODE, OwnedAddress


def kernel_addresses(names: Mapping[str, bool]) -> dict[str, OwnedAddress]:
    """Return a number in place of the address of each kernel; `NO_CODE` for those that there are not."""
    return {
        name: OwnedAddress(number, None) if there else NO_CODE for number, (name, there) in enumerate(names.items(), 1)
    }


SCHEDULE, LAW = "schedule", "law_{}"
"""Names of the kernels of controllers: their periods and offsets, and what each sets, by its number."""


PREPARE = "prepare"
"""Name of the kernel of constants, in scenes with conditions on time."""


@final
@frozen
class RunStops:
    """Stops of a run inside of its span: instants of controllers, and breaks of conditions on time.

    Attributes
    ----------
    acts : sequence of sequence of int
        Components of the state that each controller sets.
    conditions : Conditions or None
        Conditions on time, if there are any.
    parameters : int
        Number of parameters, on which the conditions depend.
    """

    acts: Sequence[Sequence[int]] = ()
    conditions: Conditions | None = None
    parameters: int = 0

    def tables(self, constants: int, code: Mapping[str, OwnedAddress]) -> tuple[StopTable, InstantTable]:
        """Return the stops of a run with so many constants, and the table of instants and breaks."""
        breaks = None if self.conditions is None else breaks_of(self.conditions, code, self.parameters, constants)
        if not self.acts and breaks is None:
            return no_stops(), no_instants()
        inputs = no_inputs()._replace(ends=np.zeros((1, 1)))
        laws = [code[LAW.format(number)] for number in range(len(self.acts))]
        stops = stops_at_instants(self.acts, laws, inputs, breaks)
        if not self.acts:
            return stops, no_instants(breaks)
        return stops, instants_of(code[SCHEDULE], len(self.acts), breaks)


NOWHERE = RunStops()
