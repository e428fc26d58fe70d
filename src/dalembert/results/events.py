"""Events of a trajectory, by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import UnknownNameError, unknown_name

if TYPE_CHECKING:
    from ..events.recorded_motion import Occurrence
    from .trajectory import Trajectory


@final
class EventRecord:
    """The occurrences of one event.

    Attributes
    ----------
    name : str
        Name of the event.
    t : ndarray (k,)
        When it occurred [s], in order.
    direction : ndarray (k,) of int
        The sign that its expression changed to.
    before, after : Trajectory
        The motion at these times on both sides of jumps, by name; the same where nothing was applied.

    ``record["x"]`` is ``record.before["x"]``.
    """

    def __init__(self, name: str, direction: NDArray[np.int8], before: Trajectory, after: Trajectory) -> None:
        self.name, self.t, self.direction = name, before.t, direction
        self.before, self.after = before, after

    def __len__(self) -> int:
        return len(self.t)

    def counted_from(self, start: float) -> None:
        """Count times, which are those since the start of the run, as that is."""
        for motion in (self.before, self.after):
            motion.counted_from(start)
        self.t = self.before.t

    @property
    def y(self) -> FloatArray:
        """State (k, n_y) before jumps."""
        return self.before.y

    def __getitem__(self, key: Any) -> FloatArray:
        return self.before[key]

    def __repr__(self) -> str:
        return f"<EventRecord {self.name!r}: {len(self)} times>"


@final
class EventRecords(Mapping[str, EventRecord]):
    """The events of a run in the order in which they were given: by name, by expression, or by number."""

    def __init__(self, records: Sequence[EventRecord] = (), aliases: Mapping[str, str] | None = None) -> None:
        self._records = {record.name: record for record in records}
        self._aliases = aliases or {}

    def __getitem__(self, key: Any) -> EventRecord:
        names = list(self._records)
        if isinstance(key, int | np.integer) and -len(names) <= key < len(names):
            return self._records[names[key]]
        name = self._aliases.get(str(key), str(key))
        if name not in self._records:
            raise UnknownNameError(unknown_name("event", str(key), names))
        return self._records[name]

    def counted_from(self, start: float) -> None:
        """Count times, which are those since the start of the run, as that is."""
        for record in self._records.values():
            record.counted_from(start)

    def __iter__(self) -> Iterator[str]:
        return iter(self._records)

    def __len__(self) -> int:
        return len(self._records)

    def __repr__(self) -> str:
        return f"<EventRecords {', '.join(f'{name!r}: {len(r)}' for name, r in self._records.items())}>"


def event_records(names: Sequence[str], occurrences: Sequence[Occurrence], run: Trajectory) -> EventRecords:
    """Return the occurrences on a run without phases by event."""
    records = []
    for number, name in enumerate(names):
        mine = [occurrence for occurrence in occurrences if occurrence.event == number]
        times = np.array([occurrence.t for occurrence in mine], dtype=float)
        shape = (len(mine), run.y.shape[1])
        sides = [
            np.array([getattr(occurrence, side) for occurrence in mine], dtype=float).reshape(shape)
            for side in ("before", "after")
        ]
        before, after = (run.at(times, y) for y in sides)
        signs = np.array([occurrence.sign for occurrence in mine], dtype=np.int8)
        records.append(EventRecord(name, signs, before, after))
    return EventRecords(records, run.parts[0].program.layout.aliases)
