"""Modes as compiled code runs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.runs import LoopCall
from ..contacts.equations.contact_laws import Mode, mode_parameters
from ..contacts.phase_tables import CaseTable, ThreadWorkspace
from ..events.event_code import Event
from ..frozen import frozen
from ..ir.program import DIRECTION, Layout
from ..lanes.cases import BlockResult, CaseColumns
from ..lanes.sweep_arguments import KeptStarts, PartSamples
from ..mechanics.equations import ContactRow
from ..options import StepOptions
from ..runs.reductions import Reduction
from ..subset.arguments import OwnedAddress

if TYPE_CHECKING:
    from ..model.model import CompiledModel


FIRST_PARAMETER = 2
"""First row of parameters in ``ThreadWorkspace.gathered``, behind start and end."""

FEWEST_ROWS, _MOST_ROWS, _ROOM = 16, 256, 2048
"""Rows for records of steps: at least, at most, and times the components of the state."""


@final
@frozen
class GatheredRows:
    """In which row of ``ThreadWorkspace.gathered`` each value of a case is; the last has the direction of time.

    Before it, there is a row of 0 and one of 1.
    """

    parameters: Mapping[str, int]
    states: Mapping[str, int]
    count: int

    def with_switches(self, switched: Mapping[str, float]) -> Mapping[str, int]:
        """Return the rows of parameters with those of switches, which are 0 or 1."""
        zero = self.count - 3
        return {**self.parameters, **{name: zero + int(value) for name, value in switched.items()}}

    def set_constants(self, gathered: FloatArray) -> None:
        """Write the rows of 0 and 1, which are two before the last."""
        gathered[self.count - 3], gathered[self.count - 2] = 0.0, 1.0

    @classmethod
    def of(cls, layout: Layout, contacts: Sequence[ContactRow]) -> GatheredRows:
        """Return the rows of a scene, start and end being the first two."""
        names = [*layout.parameters, *(name for contact in contacts for name in mode_parameters(contact))]
        first = FIRST_PARAMETER + len(names)
        parameters = {name: row for row, name in enumerate(names, FIRST_PARAMETER) if name}
        states = {name: row for row, name in enumerate(layout.variables, first)}
        return cls(parameters, states, first + len(states) + 3)


@final
@frozen(eq=False)
class ModeRunner:
    """A mode, what is watched in it, and a method: the loop over lanes, compiled.

    `number` is that of the mode, and `switched` has its switches in the common program. The events are those of users,
    then the guards of the mode. The states that it writes are those of the formulation, of which the code `expand`
    makes variables; the method is the one that it has.
    """

    number: int
    mode: Mode
    model: CompiledModel
    events: tuple[Event, ...]
    along: Mapping[str, Reduction]
    method: str
    options: StepOptions
    expand: OwnedAddress
    switched: Mapping[str, float]
    samples_inside: ClassVar[bool] = True
    taken: ClassVar[str] = ""

    def forget(self) -> None:
        """Do nothing: earlier motions leave nothing behind."""

    @property
    def size(self) -> int:
        """Components of the state."""
        return len(self.model.layout.state)

    def call(
        self, rows: GatheredRows, space: ThreadWorkspace, table: CaseTable, turn: NDArray[np.int64], recorded: int
    ) -> LoopCall:
        """Return the call that runs the cases that are gathered in the memory of a thread.

        Its next case is `turn` (1,). It records the motion of a case that is alone, with at least `recorded` rows
        for steps and for what occurs, if that is not 0. Where the table
        carries signs of events, cases continue where their last run has stopped.
        """
        model, gathered, k = self.model, space.gathered, space.gathered.shape[1]
        given, places = {**rows.states, DIRECTION: rows.count - 1}, rows.with_switches(self.switched)
        start = model.derived.start(given)
        columns = CaseColumns(
            count=k,
            spans=(gathered[0], gathered[1]),
            parameters=tuple(gathered[places[name]] for name in model.layout.parameters),
            given=tuple(gathered[given[name]] for name in start.given),
            start=start,
            t_eval=np.empty(0),
            watch=model.derived.events(self.events, self.along or None),
            rtol=self.options.rtol,
            atol=self.options.atol,
            max_step=self.options.max_step,
            max_steps=self.options.max_steps,
            carried=space.carried[: 2 * k * len(self.events)].reshape(k, -1) if len(table.carried) else None,
            recorded=max(recorded, min(_MOST_ROWS, _ROOM // max(self.size, 1))) if recorded else 0,
            part=self._part(space, table) if len(table.t_eval) else None,
        )
        happened = space.happened[: 3 * k * len(self.events)].reshape(k, -1)
        y = space.y[: k * self.size].reshape(k, self.size)
        result = BlockResult(y, space.ends, np.empty((k, 0, self.size)), happened, space.totals)
        engine = model.engine.for_segments
        run = engine.sweeper(columns, self.method, result, KeptStarts.nothing(), k)
        assert run is not None and run.call is not None
        return run.call(turn)

    def _part(self, space: ThreadWorkspace, table: CaseTable) -> PartSamples:
        """Return where the samples of the cases that are gathered are recorded."""
        overwritten = space.clock, space.states, space.posed
        return PartSamples(table.t_eval, space.chosen, space.sampled, table.samples.x, self.expand, *overwritten)
