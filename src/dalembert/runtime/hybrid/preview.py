"""Preview of one motion with contacts: when its phases end and what follows them, computed by compiled code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from ...arrays import FloatArray
from ...hybrid import Mode
from ...hybrid.modes import STATES
from ...integrators.phase_tables import NOBODY, CaseTable, case_numbers
from ...integrators.workspace import RUNNING
from ...ir.program import Layout
from ...methods.status import Status
from ...options import StepOptions
from .mode_models import ModeModels
from .phases import PhaseExecutor
from .reductions import PhaseReductions
from .state import HybridState

__all__ = ["PhasePreview", "PhaseStart", "Previewed", "case_table"]

_MOST_PHASES = 256
"""Phases that are previewed at a time."""


@final
@dataclass(frozen=True, eq=False)
class PhaseStart:
    """How a phase begins.

    Attributes
    ----------
    t : float
        Time [s].
    soon : int
        Phases in a row before it that ended too soon.
    mode : Mode
    x : ndarray (2 n_q,)
    directions, sides, rest : ndarray (n_contacts, 2), (n_contacts,), (n_contacts,)
        Directions of slip, signs of normal reactions and rest speeds.
    """

    t: float
    soon: int
    mode: Mode
    x: FloatArray
    directions: FloatArray
    sides: FloatArray
    rest: FloatArray


@final
@dataclass(frozen=True, eq=False)
class Previewed:
    """What comes of a motion.

    Attributes
    ----------
    starts : list of PhaseStart
        The phases that begin after the present one.
    state : HybridState
        The case at the end of the preview.
    soon : int
        Phases in a row that ended too soon.
    status : Status or None
        How the motion ends after the last phase; None where it goes on.
    """

    starts: list[PhaseStart]
    state: HybridState
    soon: int
    status: Status | None


def case_table(
    state: HybridState,
    t1: FloatArray,
    reductions: PhaseReductions,
    t_eval: FloatArray,
    samples: tuple[Any, Any, Any, Any, Any, Any, Any],
    lines: FloatArray,
) -> CaseTable:
    """Return cases as the loop over phases sees them.

    Parameters
    ----------
    state : HybridState
    t1 : ndarray (k,)
        Ends [s].
    reductions : PhaseReductions
        What users watch.
    t_eval : ndarray (m,)
    samples : tuple of ndarray
        Times, states, modes, histories, directions, sides and rest speeds of samples.
    lines : ndarray (n_lines, n)
        The log.
    """
    count, nothing = len(state.t), np.zeros(0, np.int64)
    return CaseTable(
        state.t,
        np.ascontiguousarray(t1, np.float64),
        state.c,
        state.cases,
        case_numbers(count),
        *reductions.begun(count),
        nothing,
        nothing,
        np.ascontiguousarray(t_eval, np.float64),
        *samples,
        lines,
    )


def no_samples() -> tuple[Any, Any, Any, Any, Any, Any, Any]:
    """Return what `case_table` takes where no samples are recorded."""
    none, rows = np.zeros(0, np.int64), np.empty((0, 0))
    return np.zeros(0), rows, none, none, rows, rows, rows


@final
class PhasePreview:
    """Previews a motion.

    Parameters
    ----------
    modes : ModeModels
    layout : Layout
        Of the scene.
    options : StepOptions
        Method, tolerances, largest step and number of steps.
    t1 : float
        End of the whole motion [s].
    start : HybridState
        The case where it starts.
    """

    def __init__(self, modes: ModeModels, layout: Layout, options: StepOptions, t1: float, start: HybridState) -> None:
        self.modes, self.state, k = modes, start.copy(), len(modes.equations.contacts)
        self.log = np.empty((_MOST_PHASES, 2 + 5 * k + start.x.shape[1]))
        nothing = PhaseReductions({}, ())
        self.table = case_table(self.state, np.array([t1]), nothing, np.zeros(0), no_samples(), self.log)
        self.executor = PhaseExecutor(modes, layout, options, 0, nothing, self.state, self.table)

    def preview(self, state: HybridState, soon: int) -> Previewed | None:
        """Return what comes of a motion from an instant on; None where compiled code does not serve its mode."""
        self.state.copied_from(state)
        numbers = self.table.numbers
        for values in numbers:
            values[:] = 0
        numbers.state[:], numbers.runner[:], numbers.soon[:], self.log[:, 0] = RUNNING, NOBODY, soon, np.nan
        if not self.executor.run_alone():
            return None
        starts = [self._start(line) for line in self.log[~np.isnan(self.log[:, 0])]]
        status = None if numbers.state[0] == RUNNING else Status(int(numbers.state[0]))
        return Previewed(starts, self.state.copy(), int(numbers.soon[0]), status)

    def _start(self, line: FloatArray) -> PhaseStart:
        k = len(self.modes.equations.contacts)
        places = np.cumsum([2, k, 2 * k, k, k])
        modes, directions, sides, rest, x = np.split(line, places)[1:]
        mode = tuple(STATES[int(number)] for number in modes)
        return PhaseStart(
            float(line[0]), int(line[1]), mode, x.copy(), directions.reshape(k, 2).copy(), sides.copy(), rest.copy()
        )
