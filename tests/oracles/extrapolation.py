"""Ordinary differential equations in many digits, with their events: extrapolation of Gragg's midpoint rule.

Right-hand sides are functions of time and state on mpf; nothing of dalembert takes part (Hairer, Norsett, Wanner,
Solving Ordinary Differential Equations I, section II.9).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import mpmath as mp

__all__ = ["Occurrence", "advance", "follow"]

Rhs = Callable[[Any, Sequence[Any]], Sequence[Any]]
COLUMNS = 13


def _midpoint(rhs: Rhs, t, y, first, h, count):
    """Return the midpoint rule of `count` (even) steps over h, without smoothing: an even series in the step."""
    step = h / count
    before, now = y, [a + step * b for a, b in zip(y, first, strict=True)]
    for k in range(1, count):
        slope = rhs(t + k * step, now)
        before, now = now, [a + 2 * step * b for a, b in zip(before, slope, strict=True)]
    return now


def advance(rhs: Rhs, t, y, h):
    """Return the state after `h`, and how much the last column of the extrapolation changed it."""
    if h == 0:
        return list(y), mp.mpf(0)
    first = rhs(t, y)
    table: list[list[Any]] = []
    for j in range(COLUMNS):
        row = [_midpoint(rhs, t, y, first, h, 2 * (j + 1))]
        for k in range(j):
            factor = mp.mpf(j + 1) ** 2 / mp.mpf(j - k) ** 2 - 1
            row.append([a + (a - b) / factor for a, b in zip(row[k], table[j - 1][k], strict=True)])
        table.append(row)
    last = table[-1]
    return last[-1], max(abs(a - b) for a, b in zip(last[-1], last[-2], strict=True))


@final
@dataclass(frozen=True)
class Occurrence:
    """Where a motion stopped: the name of the event or "", time, and state."""

    name: str
    t: Any
    y: list


def follow(
    rhs: Rhs,
    t,
    y,
    end,
    events: Mapping[str, Callable[[Any, Sequence[Any]], Any]] | None = None,
    *,
    step="0.05",
    tolerance="1e-25",
) -> Occurrence:
    """Follow a motion to `end`, or to the first event: an expression that falls below zero.

    Parameters
    ----------
    rhs : function of (t, y)
        The rates of the state.
    t, y, end : numbers, sequence of numbers
        Start and end.
    events : mapping of str to function of (t, y)
        What has to stay positive. One that is negative or zero at the start, as a rate that starts from rest, has to
        become positive before it counts.
    step, tolerance : str
        Largest step, which has to be shorter than what lies between two signs of an event; largest change by the
        last column of the extrapolation in a step.

    Returns
    -------
    Occurrence
        Events are located to twenty digits and more.
    """
    t, end, largest, tolerance = (mp.mpf(x) for x in (t, end, step, tolerance))
    y = [mp.mpf(x) for x in y]
    h = largest
    events = dict(events or {})
    values = {name: g(t, y) for name, g in events.items()}
    while t < end:
        h = min(h, end - t)
        new, error = advance(rhs, t, y, h)
        if error > tolerance:
            h /= 2
            if h < mp.mpf(10) ** -12:
                raise ArithmeticError(f"no step leads on from t = {mp.nstr(t, 15)}")
            continue
        after = {name: g(t + h, new) for name, g in events.items()}
        found = [
            (_locate(rhs, t, y, h, events[name], values[name]), name)
            for name in events
            if values[name] > 0 and after[name] <= 0
        ]
        if found:
            part, name = min(found)
            return Occurrence(name, t + part, advance(rhs, t, y, part)[0])
        t, y, values = t + h, new, after
        h = min(largest, h * 2 if error < tolerance / 10**6 else h)
    return Occurrence("", t, y)


def _locate(rhs, t, y, h, g, value):
    """Return where in (0, h) an event falls to zero, by false position with Illinois' weights, then bisection's end."""
    low, high = mp.mpf(0), h
    g_low, g_high = value, g(t + h, advance(rhs, t, y, h)[0])
    side = 0
    for _ in range(100):
        middle = (low * g_high - high * g_low) / (g_high - g_low)
        value = g(t + middle, advance(rhs, t, y, middle)[0])
        if abs(value) < mp.mpf(10) ** (4 - mp.mp.dps) or high - low < mp.mpf(10) ** (4 - mp.mp.dps):
            return middle
        if value > 0:
            low, g_low = middle, value
            g_high = g_high / 2 if side == 1 else g_high
            side = 1
        else:
            high, g_high = middle, value
            g_low = g_low / 2 if side == -1 else g_low
            side = -1
    raise ArithmeticError("an event was not located")
