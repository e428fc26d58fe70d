"""First integrals of a motion: which of the candidates are conserved, and their values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import WIDTH, Program, coefficient_places
from ..reduction.invariants import InvariantCandidates
from .assembly import assembled
from .state_sizes import coordinate_sizes

Rows = Callable[[Kernel, FloatArray, FloatArray, FloatArray], FloatArray]
"""Outputs (k, n_out) of a kernel at times (k,), states (k, n) and constants (k, n_c)."""

_TRIALS = 8
_CASE_TRIALS = 4
_DRAWS = 64
"""Values of the free arguments in each trial."""
_SPREAD = 0.2
_STILL = 1e-9
"""Rate of change, over the sum of its terms' sizes, that rounding explains."""


def conserved(
    program: Program, found: InvariantCandidates, c: FloatArray, t: FloatArray, x: FloatArray
) -> dict[str, FloatArray]:
    """Return the first integrals along a motion t (n_t,) as arrays (n_t,) by name.

    The rows of x (n_t, 2 n_q + n_z) are coordinates, rates and first-order states. A candidate that is not certain
    counts as conserved when its rate vanishes in random states around the motion that satisfy the constraints, at times
    of the motion and others, with random inputs and in all branches of the equations; the random numbers are the same
    in every run.
    """
    kept = np.array(found.certain)
    if not np.all(kept) and len(t):
        kept = kept | _still(program, found, c, t, x)
    values = interpret_rows(found.values, t, x, c)
    return {name: values[:, i] for i, name in enumerate(found.names) if kept[i]}


def changing(
    program: Program, found: InvariantCandidates, c: FloatArray, t: FloatArray, y: FloatArray, rows: Rows
) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Return which candidates change (k, n) in which cases, from starts at t (k,) in y (k, n_y) with c (k, n_c).

    Each case is evaluated at random speeds, with free arguments on both sides of their centres; the numbers are the
    same for all cases. Cases that are not finite do not count.
    """
    random, count = np.random.default_rng(2), len(found.names)
    moves = np.zeros((len(t), count), bool)
    speeds = np.array([name not in program.layout.coordinates for name in program.layout.state])
    size = 1.0 + np.max(np.abs(y), axis=1, initial=0.0, keepdims=True)
    centres = np.array([where.centre for where in found.free])
    free = np.empty(0)
    for trial in range(_CASE_TRIALS):
        state = y + np.where(speeds, random.standard_normal(len(speeds)), 0.0) * size
        if "project_velocity" in program:
            for _ in range(2):
                state = state + rows(program.kernel("project_velocity"), t, state, c)
        x = rows(program.kernel("expand"), t, state, c)
        second = rows(program.kernel("accelerations"), t, x, c)
        drawn = [where.draw(random, 1)[0] for where in found.free]
        free = 2.0 * centres - free if trial % 2 else np.array(drawn)
        for kernel, further in (found.changes, second), (found.branches, np.tile(free, (len(t), 1))):
            out = rows(kernel, t, np.hstack([x, further]), c)
            moves |= np.abs(out[:, :count]) > _STILL * out[:, count:]
    return moves & ~np.array(found.certain)


def _still(
    program: Program, found: InvariantCandidates, c: FloatArray, t: FloatArray, x: FloatArray
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which candidates do not change in any of the random states."""
    layout, random = program.layout, np.random.default_rng(1)
    count, size = len(found.names), len(layout.coordinates)
    still, trials = np.ones(count, bool), 0
    for trial, place in enumerate(np.linspace(0, len(t) - 1, _TRIALS).astype(int)):
        now = t[place : place + 1] + trial % 2 * random.standard_normal()
        own = (c if c.ndim == 1 else c[place]).copy()
        sizes = coordinate_sizes(program, t[place : place + 1], x[place : place + 1], own)[0]
        speed = _speed(program, t[place : place + 1], x[place : place + 1], own, sizes)
        start = np.concatenate([x[place, :size], np.zeros(size), x[place, 2 * size :]])
        spread = np.concatenate([_SPREAD * sizes, speed * sizes])
        start[: 2 * size] += spread * random.standard_normal(2 * size)
        start[2 * size :] += random.standard_normal(len(layout.states))
        guess = dict(zip(layout.variables, start.tolist(), strict=True))
        for first in coefficient_places(layout.parameters, layout.inputs):  # conserved whatever the inputs are
            own[first + 1 : first + WIDTH] += random.standard_normal(WIDTH - 1)
        try:
            state = assembled(program, own, float(now[0]), guess, ())
        except (InitialStateError, np.linalg.LinAlgError):
            continue
        y = np.array([[state[name] for name in layout.variables]])
        draws = _DRAWS if found.free else 1
        drawn = [where.draw(random, draws) for where in found.free]
        rows = np.hstack([np.repeat(y, draws, 0), *(values[:, np.newaxis] for values in drawn)])
        with np.errstate(all="ignore"):
            second = interpret_rows(program.kernel("accelerations"), now, y, own)
            out = interpret_rows(found.changes, now, np.hstack([y, second]), own)
            branches = interpret_rows(found.branches, np.repeat(now, draws), rows, own)
        if np.all(np.isfinite(out)):
            for values in (out, branches[np.all(np.isfinite(branches), axis=1)]):
                still &= np.all(np.abs(values[:, :count]) <= _STILL * values[:, count:], axis=0)
            trials += 1
    return still & (trials > 0)


def _speed(program: Program, t: FloatArray, x: FloatArray, c: FloatArray, sizes: FloatArray) -> float:
    """Return a speed of the motion at a state x (1, 2 n_q + n_z), in sizes of coordinates in a unit of time.

    The largest of its rates, and of what accelerations make of rest over the sizes; one where nothing moves.
    """
    n = len(sizes)
    with np.errstate(all="ignore"):
        second = np.abs(interpret_rows(program.kernel("accelerations"), t, x, c)[0]) / sizes
    fastest = np.max(np.abs(x[0, n : 2 * n]) / sizes, initial=0.0)
    speed = float(np.fmax(fastest, np.sqrt(np.max(second[np.isfinite(second)], initial=0.0))))
    return speed if speed > 0.0 else 1.0
