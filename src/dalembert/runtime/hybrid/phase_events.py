"""Records of users' events over the phases of a motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from ...arrays import FloatArray
from ...integrators.event_code import Event
from ...results.events import EventRecords
from ...results.hybrid import HybridTrajectory, Part, joined_records
from ...results.trajectory import Trajectory
from .event_jumps import EventJumps

__all__ = ["PhaseEvents", "after_jump", "event_history"]


@final
@dataclass(frozen=True, eq=False)
class PhaseEvents:
    """A phase, what occurred in it, and variables (2 n_q + n_z,) after the jump that ended it, or None."""

    part: Part
    records: EventRecords
    after: FloatArray | None


def after_jump(part: Part, jumps: EventJumps, x: FloatArray, p: FloatArray) -> Part:
    """Return the variables x (2 n_q + n_z,) after a jump at the end of a phase, with parameters p (n_p,) of the scene.

    It belongs to no mode yet, and is one of the model in which all that can open is open.
    """
    t, stages = np.array([part.motion.t_end]), jumps.model.stages
    y, c = jumps.motion_state(t, x[np.newaxis], p[np.newaxis])
    motion = Trajectory(stages.program, c[0], part.motion.status, t, y, part.motion.stats, None)
    return Part(replace(part.phase, t0=part.phase.t1), motion.of_scene(stages.scene), jumps.violation)


def event_history(
    events: Sequence[Event],
    phases: Sequence[PhaseEvents],
    make: Callable[[Sequence[Part]], HybridTrajectory],
    jumps: EventJumps,
    p: FloatArray,
    aliases: Mapping[str, str],
) -> EventRecords:
    """Return the records of all events over all phases; `make` joins motions, p (n_p,) are the parameters."""

    def sides(phase: PhaseEvents, label: str) -> tuple[Part, Part]:
        record = phase.records[label]
        motions: Any = record.before, record.after
        before, after = (replace(phase.part, motion=motion) for motion in motions)
        if phase.after is not None and label in jumps and len(record):  # a phase ends where its state jumps
            after = after_jump(phase.part, jumps, phase.after, p)
        return before, after

    labels = [event.label for event in events]
    found = [{label: (*sides(phase, label), phase.records[label].direction) for label in labels} for phase in phases]
    return EventRecords(joined_records(labels, found, make), aliases)
