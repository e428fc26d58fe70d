"""Jumps of rates across which derivatives are not those of the equations of variation: found, and refused by name.

Where rates jump at a time that what is differentiated by moves, or in a state that it moves, the derivative of the
motion jumps too. At a time that stays, it does not, and steps end there.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, list_names
from ..integrators.breakpoints import break_times
from ..integrators.problem import Solution
from ..integrators.segments import Constants, constants_at
from ..ir.conditions import NARROW, Conditions
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program

__all__ = ["moved_breaks", "refuse_jumps_at", "refuse_jumps_between"]

_JUMP = 1e-7
"""Share of the rates that counts as a jump."""
_HALVINGS = 60


def moved_breaks(program: Program, wrt: tuple[str, ...], c: FloatArray, t0: float, t1: float) -> FloatArray:
    """Return the breaks of a run whose times depend on parameters by which one differentiates."""
    conditions = program.conditions
    if conditions is None:
        return np.zeros(0)
    names = program.layout.parameters
    places = {names.index(name) for name in wrt if name in names}
    moved = [
        kind != NARROW and any(load.array == "p" and load.index in places for load in f.loads)
        for f, kind in zip(conditions.functions, conditions.kinds, strict=True)
    ]
    if not any(moved):
        return np.zeros(0)
    kept = [
        i
        for i, own in enumerate(moved)
        if own
        or (conditions.kinds[i] != NARROW and any(conditions.nested[k] for k in range(i, len(moved)) if moved[k]))
    ]
    some = Conditions(
        conditions.place,
        tuple(conditions.functions[i] for i in kept),
        tuple(conditions.kinds[i] for i in kept),
        tuple(conditions.nested[i] for i in kept),
        tuple(conditions.sharpness[i] for i in kept),
    )
    return break_times(some, c[: len(names)], t0, t1)


def refuse_jumps_at(
    program: Program, times: FloatArray, solution: Solution, c: Constants, size: int, wrt: tuple[str, ...]
) -> None:
    """Refuse a run (its first `size` components are the state) whose rates jump at times which it recorded.

    Raises
    ------
    OptionError
        Naming the time.
    """
    order = np.diff(solution.t, append=solution.t[-1:])
    forward = -1.0 if np.any(order < 0.0) else 1.0
    for t in times:
        here = np.flatnonzero(solution.t == t)
        if not len(here):
            continue
        y, near = solution.y[here[:1]], np.array([t, np.nextafter(t, -forward * np.inf)])
        sides = [interpret_rows(program.kernel("rhs"), near[:1], y, constants_at(c, near[i : i + 1])) for i in (0, 1)]
        if _differ(sides[0][0, :size], sides[1][0, :size]):
            raise OptionError(_message(float(t), wrt, "at a time that depends on it"))


def refuse_jumps_between(
    program: Program, kernel: Kernel, solution: Solution, c: Constants, size: int, wrt: tuple[str, ...]
) -> None:
    """Refuse a run with continuous output in which decisions change strictly within the span, and rates jump there.

    Raises
    ------
    OptionError
        Naming the time.
    """
    dense = solution.dense
    if dense is None or len(dense.knots) < 2:
        return
    knots = dense.knots
    shares = np.array([0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
    times = np.unique((knots[:-1, np.newaxis] + np.diff(knots)[:, np.newaxis] * shares).ravel())
    y = dense(times)
    made = interpret_rows(kernel, times, y, constants_at(c, times))
    changes = np.flatnonzero(np.any(made[1:] != made[:-1], axis=1))
    for i in changes:
        low, high, first = times[i], times[i + 1], made[i]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if middle in (low, high):
                break
            at = np.array([middle])
            if np.any(interpret_rows(kernel, at, dense(at), constants_at(c, at))[0] != first):
                high = middle
            else:
                low = middle
        sides = np.array([low, high])
        if low <= times[0] or high >= times[-1]:
            continue
        rates = interpret_rows(program.kernel("rhs"), sides, dense(sides), constants_at(c, sides[:1]))[:, :size]
        if _differ(rates[0], rates[1]):
            raise OptionError(_message(float(high), wrt, "in a state that depends on it"))


def _differ(a: FloatArray, b: FloatArray) -> bool:
    size = max(float(np.max(np.abs(a), initial=0.0)), float(np.max(np.abs(b), initial=0.0)))
    return bool(np.any(np.abs(a - b) > _JUMP * size))


def _message(t: float, wrt: tuple[str, ...], why: str) -> str:
    return (
        f"sensitivity: the rates of the motion jump at t = {t:.9g}, {why} ({list_names(wrt)}), and derivatives across"
        " such a jump are not those of the equations of variation. End the span before it, smooth the jump (tanh), or"
        " take differences of two runs of simulate; kinks, and jumps at times that do not depend on what is"
        " differentiated by, are fine"
    )
