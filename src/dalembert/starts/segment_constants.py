"""Constants of runs in whose course conditions on time change."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret
from ..ir.program import Program, along_run
from ..stops.segments import Segments
from .inputs import constants, prepare_rows

_FEW = 32
"""Most segments whose constants are interpreted one by one."""


def segments_of(program: Program, c: FloatArray, t0: float, t1: float) -> Segments:
    """Return the segments of a run of a program with conditions from t0 to t1, of constants (n_c,) as of any time.

    Raises
    ------
    BreakTimesError
        Where there are too many.
    """
    from ..stops.breakpoints import break_times

    conditions = program.conditions
    assert conditions is not None
    p = c[: len(program.layout.parameters)]
    breaks = break_times(conditions, p, t0, t1)
    edges = np.concatenate([[t0], breaks, [t1]])
    return Segments(edges, prepared_rows(program, p, edges[:-1] + 0.5 * np.diff(edges)))


def prepared_rows(program: Program, p: FloatArray, middles: FloatArray) -> FloatArray:
    """Return the constants (m, n_c) of parameters (n_p,) with conditions decided at times (m,)."""
    assert program.conditions is not None
    rows = np.tile(p, (len(middles), 1))
    program.conditions.decide_at(rows, middles)
    return constants_of_rows(program, rows)


def constants_of_rows(program: Program, rows: FloatArray) -> FloatArray:
    """Return the constants (m, n_c) of parameters, the first columns of rows (m, n)."""
    if len(rows) > _FEW:
        return prepare_rows(program, rows)
    kernel = program.kernel("prepare")
    return np.array([interpret(kernel, {"p": row.tolist()}) for row in rows], dtype=float)


def starting_constants(program: Program, c: FloatArray, t0: float, t1: float) -> FloatArray:
    """Return the constants (n_c,) with which a run from t0 to t1 begins."""
    if t1 < t0:
        names = program.layout.parameters
        p = c[: len(names)]
        directed = along_run(names, p, backward=True)
        c = c if directed is p else constants(program, directed)
    return c if program.conditions is None else segments_of(program, c, t0, t1).first


def at_time(program: Program, c: FloatArray, t: float) -> FloatArray:
    """Return the constants (n_c,) with conditions decided at t."""
    if program.conditions is None:
        return c
    return prepared_rows(program, c[: len(program.layout.parameters)], np.array([t]))[0]
