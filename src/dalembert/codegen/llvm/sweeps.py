"""Runs of many cases: what the loop over lanes is given, and the calls of its machine code."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.workspace import GOING, PATIENCE, RETURNS, Watch, aligned, room, scratch
from ...interrupts import STOPPED, check
from ..base import BlockResult, CaseColumns, CaseRun, LoopCall
from .loops import loop_named, packed

__all__ = ["SweepShape", "case_run"]

_ROUNDS, _MOST_ROUNDS, _QUICK = 256, 1 << 24, 0.02
"""Rounds after which a loop first returns to Python, and at most; seconds below which the next may take longer."""

_COUNT = 5
"""Place of the number of cases in the loop's ``shape``."""


@final
@dataclass(frozen=True)
class SweepShape:
    """Lanes, components of the state, constants, degree and memory of a step, and how many cases are taken at a time.

    ``dense`` says whether the step writes its polynomials, and ``followed`` how many it writes besides.
    """

    lanes: int
    n: int
    n_c: int
    degree: int
    memory: int
    share: int
    dense: bool
    followed: int = 0


def case_run(
    codes: tuple[int, int, int, int, int, int, int, int],
    shape: SweepShape,
    settings: Sequence[float],
    cases: CaseColumns,
    result: BlockResult,
    constants: FloatArray,
    watch: Watch,
    watched: bool,
) -> CaseRun:
    """Return cases ready to run; see `dalembert.integrators.lane_loop`.

    Parameters
    ----------
    codes : addresses
        As the loop takes them.
    settings : sequence of float
        What the step reads behind the largest step and the direction of time.
    constants : (k, n_c) or (0, 0)
        Gets the constants.
    watched : bool
        Whether there are events or reductions.
    """
    k, n, wanted = cases.count, shape.n, len(cases.t_eval)
    columns, held = _columns(cases)
    values, checks = len(cases.given), 2 * len(cases.start.labels)
    limits = np.array([[cases.max_step, float(cases.max_steps), *settings]])
    samples = result.samples.reshape(k, wanted * n) if wanted else np.empty((1, 1))
    projections = codes[2:4]
    inside = np.zeros((k, wanted) if wanted and any(projections) else (0, 0), np.bool_)
    turn = np.zeros(1, np.int64)
    more = n + shape.followed
    size = more + 2 + shape.memory
    rows = size + (more * (shape.degree + 1) if shape.dense else 0)
    t_eval = np.ascontiguousarray(cases.t_eval)
    first = (
        codes,
        (shape.degree, shape.memory, len(cases.parameters), values, checks, k, shape.share),
        limits,
        columns,
        turn,
        t_eval,
        result.y,
        result.ends,
        samples,
        inside,
        constants,
    )
    last = (result.happened, result.totals)
    loop = loop_named("event_lane_loop" if watched else "projected_lane_loop" if any(projections) else "lane_loop")
    head, tail = packed(first), packed(last)
    places = len(packed(first[:1])) + _COUNT, len(packed(first[:4]))

    def call() -> LoopCall:
        n_s = 2 + len(settings)
        space = room(shape.lanes, n, shape.n_c, n_s, rows, max(len(cases.parameters), values), n + checks + size)
        space.pause[PATIENCE] = _ROUNDS
        spare = (watch, scratch(watch, n, shape.degree, shape.n_c, n_s, shape.lanes)) if watched else ()
        words = np.concatenate([head, packed((space, spare)), tail])
        return LoopCall(loop.address, words, *places, (held, first, last, space, spare), space.pause)

    def work() -> None:
        made, code = call(), loop.call
        words, pause = ctypes.c_void_p(made.words.ctypes.data), made.pause
        pause[RETURNS], going = 1, True
        while going:  # Ctrl-C is raised here
            begin = perf_counter()
            code(words)
            going = bool(pause[GOING]) and turn[0] < STOPPED
            check()
            if going and perf_counter() - begin < _QUICK:
                pause[PATIENCE] = min(2 * pause[PATIENCE], _MOST_ROUNDS)

    def finish() -> None:
        if np.any(inside):
            _project(projections, constants, t_eval, inside, samples, shape)

    return CaseRun(work, turn, finish, call)


def _columns(cases: CaseColumns) -> tuple[NDArray[np.int64], tuple[FloatArray, ...]]:
    """Return address and stride of every column, and the columns."""
    columns = (*cases.spans, *cases.parameters, *cases.given)
    assert all(column.dtype == np.float64 and column.flags.c_contiguous for column in columns)
    places = [(column.__array_interface__["data"][0], int(len(column) > 1)) for column in columns]
    return np.array(places, np.int64), columns


def _project(
    codes: tuple[int, int],
    constants: FloatArray,
    t_eval: FloatArray,
    inside: NDArray[np.bool_],
    samples: FloatArray,
    shape: SweepShape,
) -> None:
    lanes, n = shape.lanes, shape.n
    space = aligned(1, lanes), aligned(n, lanes), np.ones((max(shape.n_c, 1), lanes)), aligned(n, lanes)
    loop_named("sample_projection")(codes, constants, t_eval, inside, samples, *space, np.zeros((2, lanes), np.int64))
