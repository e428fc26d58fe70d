"""Arrays of cases for the loop over phases."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...integrators.phase_stops import no_stops
from ...integrators.phase_tables import CaseTable, case_numbers
from ...results.hybrid_sweep import States
from .reductions import PhaseReductions
from .state import HybridState

__all__ = ["case_table"]


def case_table(
    state: HybridState,
    t1: FloatArray,
    reductions: PhaseReductions,
    t_eval: FloatArray | None,
    samples: States,
    log: FloatArray,
) -> CaseTable:
    """Return cases as the loop over phases sees them.

    Parameters
    ----------
    state : HybridState
    t1 : ndarray (k,)
        Ends [s].
    reductions : PhaseReductions
        What users watch.
    t_eval : ndarray (m,) or None
        Times of samples [s].
    samples : States
        Gets the samples, case by case.
    log : ndarray (n_lines, n)
        Gets the beginnings of the phases of a case that is alone.
    """
    count, nothing = len(state.t), np.zeros(0, np.int64)
    return CaseTable(
        np.ascontiguousarray(t1, np.float64),
        state.t.copy(),
        state.c,
        state.cases,
        case_numbers(count),
        *reductions.begun(count),
        nothing,
        nothing,
        np.empty(0) if t_eval is None else np.ascontiguousarray(t_eval, np.float64),
        samples.t,
        samples.x,
        samples.mode,
        samples.history,
        samples.directions.reshape(len(samples.t), -1 if len(samples.t) else 0),
        samples.sides,
        samples.rest,
        log,
        no_stops(),
        np.zeros((0, 0)),
    )
