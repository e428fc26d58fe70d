"""What the loops over lanes work with: arrays that their callers make, because compiled loops allocate nothing.

Nothing here imports numba, so that a process that finds the loops compiled does without it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from .crossings import DEEPEST

__all__ = [
    "ATTEMPTS",
    "BEFORE",
    "CASE",
    "END",
    "FIRST",
    "FRESH",
    "GOING",
    "IDLE",
    "LONE",
    "MARK",
    "NEXT",
    "NOW",
    "PATIENCE",
    "POINT_LANES",
    "QUICK",
    "REFUSED",
    "RETURNS",
    "RUNNING",
    "SAMPLED",
    "SAMPLED_BEFORE",
    "SAVED",
    "STAGED",
    "STATUS",
    "Room",
    "Scratch",
    "Watch",
    "aligned",
    "room",
    "scratch",
    "unwatched",
]

POINT_LANES = 8
QUICK = 7
"""Outputs of the quick test for each expression, see `dalembert.transforms.step_bounds.running_kernel`."""

CASE, STATUS, SAMPLED, SAMPLED_BEFORE, MARK, FRESH, LONE, STAGED = range(8)
"""Rows of ``Room.whole``."""

NOW, END, NEXT = range(3)
"""Rows of ``Room.clock``."""

ATTEMPTS, REFUSED, BEFORE, FIRST = range(4)
"""Rows of ``Room.tally``."""

PATIENCE, RETURNS, GOING, SAVED = range(4)
"""Places in ``Room.pause``; what a loop that pauses remembers begins at the last."""

RUNNING, IDLE = -1, -2
"""Statuses of a lane whose case goes on, and of one without a case."""

_LINE = 64


def aligned(rows: int, columns: int, dtype: type = np.float64) -> NDArray[np.float64]:
    """Return zeros (rows, columns) that begin with a cache line, so that no pack lies across two."""
    size = rows * columns * np.dtype(dtype).itemsize
    memory = np.zeros(size + _LINE, np.uint8)
    first = -memory.__array_interface__["data"][0] % _LINE
    return memory[first : first + size].view(dtype).reshape(rows, columns)


class Room(NamedTuple):
    """What lanes hold, one column each.

    ``clock`` are time, end and the next time to record; ``tally`` attempts, refused attempts, the time before the last
    step and that of the start; ``whole`` whole numbers. A step reads the state in one half of ``states`` and writes
    the other. Others are for cases that come next: ``given`` values, state, checks and memory in ``begun``.

    After so many rounds as the first number of ``pause`` the loop looks whether it is to stop, and returns where the
    second is not 0. The third then is not 0, and it goes on where it was when it is called again.
    """

    clock: FloatArray
    settings: FloatArray
    constants: FloatArray
    states: FloatArray
    delta: FloatArray
    tally: FloatArray
    whole: NDArray[np.int64]
    given: FloatArray
    begun: FloatArray
    clock_ahead: FloatArray
    settings_ahead: FloatArray
    constants_ahead: FloatArray
    pause: NDArray[np.int64]


def room(lanes: int, n: int, n_c: int, n_s: int, rows: int, given: int, begun: int) -> Room:
    """Return room for so many lanes.

    States have n components, constants n_c, settings n_s; a step writes `rows` outputs; cases are made from at most
    `given` values, which gives `begun` numbers.
    """
    return Room(
        aligned(3, lanes),
        aligned(n_s, lanes),
        aligned(max(n_c, 1), lanes),
        aligned(2 * rows, lanes),
        aligned(n, lanes),
        aligned(4, lanes),
        np.zeros((8, lanes), np.int64),
        aligned(max(given, 1), lanes),
        aligned(begun, lanes),
        aligned(2, lanes),
        aligned(n_s, lanes),
        aligned(max(n_c, 1), lanes),
        np.zeros(SAVED + 8, np.int64),
    )


class Watch(NamedTuple):
    """Addresses of compiled code, and the rules of the events.

    ``quiet`` gives the sign of each expression over a step of every lane, 0 where it may change. ``values`` are the
    watched expressions (n) at `POINT_LANES` points, all others take one point: ``value`` the same
    expressions, ``begins`` value, rate and noise of each (3 n), ``jumps`` (n) coordinates and rates after a jump or 0,
    ``start`` the state from them with its checks, ``refill`` what a step remembers at its start, or 0. ``used`` are
    the components of the state that the expressions read, ``given`` and ``checks`` the sizes around ``start``.

    Expressions of which minima, maxima or integrals are taken, as ``kinds`` say, are ``running`` at `POINT_LANES`
    points and ``at`` one; ``quick`` tests them over a step of every lane, and ``read`` is what they read of the state.

    Where ``followed`` is not 0 but the number of events, all of these end the case, and a step writes their series too.
    """

    quiet: int
    values: int
    value: int
    begins: int
    start: int
    refill: int
    given: int
    checks: int
    jumps: NDArray[np.int64]
    directions: NDArray[np.int64]
    last: NDArray[np.int64]
    used: NDArray[np.int64]
    quick: int
    running: int
    at: int
    kinds: NDArray[np.int64]
    read: NDArray[np.int64]
    followed: int = 0


def unwatched() -> Watch:
    """Return what stands where nothing is watched."""
    nothing = np.zeros(0, np.int64)
    return Watch(*(0,) * 8, *(nothing,) * 4, *(0,) * 3, *(nothing,) * 2)


class Scratch(NamedTuple):
    """Arrays to watch cases with, and what each lane remembers: signs, what was seen of them, and zeros at the start.

    ``curves`` are the series of what is followed, in the fraction of the step, and ``level`` what rounding of the state
    made of it where each lane began. ``open`` are 1 for what may change its sign in the present step, else 0; ``rates``
    belong to its beginning.

    ``own`` (lanes, n_c) are the constants of each lane in a row, ``constants`` (lanes * n_c, 8) for eight points.
    """

    own: FloatArray
    constants: FloatArray
    clock: FloatArray
    point: FloatArray
    out: FloatArray
    series: FloatArray
    values: FloatArray
    ends: FloatArray
    noise: FloatArray
    one_clock: FloatArray
    one_point: FloatArray
    one_out: FloatArray
    setting: FloatArray
    earlier: FloatArray
    over: FloatArray
    quick: FloatArray
    signs: FloatArray
    seen: FloatArray
    zero: FloatArray
    found: FloatArray
    happens: FloatArray
    residual: FloatArray
    jumped: FloatArray
    work: FloatArray
    stack: FloatArray
    curves: FloatArray
    level: FloatArray
    rates: FloatArray
    open: FloatArray
    powers: FloatArray


def scratch(watch: Watch, n: int, degree: int, n_c: int, n_s: int, lanes: int) -> Scratch:
    """Return room to watch cases of n components and n_c constants, by polynomials of a degree, in so many lanes."""
    k, count = max(watch.directions.size, watch.kinds.size, 1), max(n_c, 1)
    size = max(3 * k, watch.given, n + watch.checks, 2 * n + 8)
    return Scratch(
        own=aligned(lanes, count),
        constants=aligned(lanes * count, POINT_LANES),
        clock=aligned(1, POINT_LANES),
        point=aligned(n, POINT_LANES),
        out=aligned(k, POINT_LANES),
        series=aligned(n, degree + 1),
        values=aligned(k, POINT_LANES),
        ends=aligned(2, k),
        noise=aligned(1, k),
        one_clock=aligned(1, 1),
        one_point=aligned(2, max(n, watch.given)),
        one_out=aligned(1, size),
        setting=aligned(1, n_s),
        earlier=aligned(1, lanes),
        over=aligned(watch.directions.size, lanes),
        quick=aligned(QUICK * watch.kinds.size, lanes),
        signs=aligned(lanes, k),
        seen=aligned(lanes, k),
        zero=aligned(lanes, k),
        found=aligned(k, 2),
        happens=aligned(1, k),
        residual=aligned(1, k),
        jumped=aligned(lanes, 2),
        work=aligned(5, 8),
        stack=aligned(2 * DEEPEST + 4, 3),
        curves=aligned(max(watch.followed, 1), degree),
        level=aligned(lanes, k),
        rates=aligned(1, k),
        open=np.ones((1, k)),
        powers=aligned(1, degree + 1),
    )
