"""The search for breaks of one run in the compiled subset, for exports: that of `dalembert.stops.breakpoints`.

It finds the same times, to the bit where the functions of conditions have additions, products and quotients alone. The
search of this process takes many runs at a time, as arrays; this one has a run, no memory but its arguments, and goes
through the intervals in the order of time. Rules and constants are the same.
"""

from __future__ import annotations

import math

import numpy as np

from ..methods.step_constants import EPSILON, ROOT_PRECISION, ROOT_TRIES, SMALLEST_OF_TIME
from ..subset.compiled_subset import call_code, compiled_subset, row, sqrt
from .break_tables import IS_NARROW, IS_WHOLE, BreakTable
from .breakpoints import AROUND, FEW_PIECES, SHORT
from .interval_roots import FIRST_PARTS, MOST_CUTS

_MOST_PIECES = 100_000
"""Largest number of intervals of one length."""
_LARGEST_WHOLE = 1e15

_TIME, _WHOLE_RANGE, _CENTRE, _TESTED, _FOUND = range(5)
"""Rows of the memory: an interval of time; bounds over it, and in its middle; what is tested, and outputs."""


@compiled_subset
def find_breaks(table: BreakTable, t0: float, t1: float) -> bool:
    """List the breaks strictly between two times in the order of a run; return whether there is room for them."""
    search, low, high = table.search, min(t0, t1), max(t0, t1)
    search.count, search.next, search.begin, search.end, search.over = 0, 0, t0, t1, 0
    for k in range(table.kinds.size):
        kept = search.count
        if not _find_of_condition(table, k, low, high):
            if table.kinds[k] != IS_NARROW or search.over != 0:
                return False
            search.count = kept  # too many for any to be narrow
        _merge(table, low, high)
    if t1 < t0:
        for i in range(search.count // 2):
            other = search.count - 1 - i
            table.times[i], table.times[other] = table.times[other], table.times[i]
    return True


@compiled_subset
def middle_of(table: BreakTable, segment: int) -> float:
    """Return when conditions are decided in a segment between breaks."""
    begin, end = table.search.begin, table.search.end
    if segment > 0:
        begin = table.times[segment - 1]
    if segment < table.search.count:
        end = table.times[segment]
    return begin + 0.5 * (end - begin)


@compiled_subset
def _find_of_condition(table: BreakTable, k: int, low: float, high: float) -> bool:
    """Add the breaks of a condition, which is decided anew in each piece where others that it contains are."""
    search, pieces = table.search, 1
    if table.nested[k] != 0:
        pieces = search.count + 1
        for i in range(search.count):
            table.edges[i] = table.times[i]
    allowed = FEW_PIECES * (pieces + FIRST_PARTS) if table.kinds[k] == IS_NARROW else _MOST_PIECES
    search.found, search.stuck = 0, 0
    for level in range(table.levels.size):
        table.levels[level] = 0
    for piece in range(pieces):
        a, b = low, high
        if piece > 0:
            a = table.edges[piece - 1]
        if piece < pieces - 1:
            b = table.edges[piece]
        if table.place >= 0:
            table.parameters[0, table.place] = a + 0.5 * (b - a)
        search.last, search.cluster = np.nan, 0
        if a < b and not _search_piece(table, k, a, b, allowed):
            return False
        _finish(table, k, a, b, np.inf)
    return search.over == 0


@compiled_subset
def _search_piece(table: BreakTable, k: int, a: float, b: float, allowed: int) -> bool:
    """Find the roots of a function between two times; return whether there are few enough."""
    search, left, low = table.search, FIRST_PARTS, a
    for part in range(FIRST_PARTS):
        table.ends[part], table.cuts[part] = a + (b - a) * (float(FIRST_PARTS - part) / float(FIRST_PARTS)), 0
    table.ends[0] = b
    while left > 0:
        high, cut = table.ends[left - 1], table.cuts[left - 1]
        _test(table, k, low, high)
        straight, rest, done = table.memory[_FOUND, 0], table.memory[_FOUND, 1], table.memory[_FOUND, 2]
        if rest != 0.0 and done == 0.0 and cut < MOST_CUTS:
            table.levels[cut] += 1
            if table.levels[cut] > allowed:
                return False
            table.ends[left], table.cuts[left], table.cuts[left - 1] = low + (high - low) * 0.5, cut + 1, cut + 1
            left += 1
            continue
        if rest != 0.0:
            if search.cluster == 0:
                search.cluster, search.low = 1, low
            search.high = high
            search.stuck += 1
        else:
            _end_cluster(table, k, a, b)
            if straight != 0.0 and not _monotone(table, k, low, high, a, b, allowed):
                return False
        if search.found > allowed or search.stuck > 4 * allowed:
            return False
        low = high
        left -= 1
    _end_cluster(table, k, a, b)
    return True


@compiled_subset
def _test(table: BreakTable, k: int, low: float, high: float) -> None:
    """Write whether an interval may hold roots, see `dalembert.stops.interval_roots.kinds_of`."""
    memory, time, middle = table.memory, row(table.memory, _TIME), low + 0.5 * (high - low)
    memory[_TIME, 0], memory[_TIME, 1], memory[_TIME, 2] = low, high, 1.0
    call_code(table.bounds[k], time, row(table.parameters, 0), 0, 0, row(memory, _WHOLE_RANGE))
    memory[_TIME, 0], memory[_TIME, 1], memory[_TIME, 2] = middle, middle, 0.0
    call_code(table.bounds[k], time, row(table.parameters, 0), 0, 0, row(memory, _CENTRE))
    memory[_TESTED, 0], memory[_TESTED, 1] = low, high
    for i in range(4):
        memory[_TESTED, 2 + i] = memory[_WHOLE_RANGE, i]
    memory[_TESTED, 6], memory[_TESTED, 7] = memory[_CENTRE, 0], memory[_CENTRE, 1]
    test = 1 if table.kinds[k] == IS_WHOLE else 0
    call_code(table.tests[test], row(memory, _TESTED), 0, 0, 0, row(memory, _FOUND))


@compiled_subset
def _value(table: BreakTable, code: int, t: float) -> float:
    """Return what a kernel gives at a time."""
    memory = table.memory
    memory[_TIME, 0] = t
    call_code(code, row(memory, _TIME), row(table.parameters, 0), 0, 0, row(memory, _FOUND))
    return memory[_FOUND, 0]


@compiled_subset
def _monotone(table: BreakTable, k: int, low: float, high: float, a: float, b: float, allowed: int) -> bool:
    """Find the roots of a function that rises or falls between two times; return whether there are few enough."""
    first, last = _value(table, table.values[k], low), _value(table, table.values[k], high)
    if table.kinds[k] != IS_WHOLE:
        _crossing(table, k, low, high, first, last, 0.0, a, b)
        return True
    if math.isnan(first) or math.isnan(last):
        return True
    if not (abs(first) < _LARGEST_WHOLE and abs(last) < _LARGEST_WHOLE):
        return False
    bottom, top = -_floor(-min(first, last)), _floor(max(first, last))
    if top - bottom + 1 > allowed:
        return False
    for level in range(bottom, top + 1):
        _crossing(table, k, low, high, first - float(level), last - float(level), float(level), a, b)
    return True


@compiled_subset
def _floor(x: float) -> int:
    whole = int(x)
    if float(whole) > x:
        whole -= 1
    return whole


@compiled_subset
def _crossing(
    table: BreakTable, k: int, low: float, high: float, first: float, last: float, level: float, a: float, b: float
) -> None:
    """Add the time at which a function, with values at two times, is at a level, if it passes it between them."""
    if math.isnan(first) or math.isnan(last):
        return
    if first == 0.0:
        _add(table, k, low, a, b)
    elif last == 0.0:
        _add(table, k, high, a, b)
    elif (first < 0.0 and last > 0.0) or (first > 0.0 and last < 0.0):
        _add(table, k, _zero(table, table.values[k], low, high, first, last, level), a, b)


@compiled_subset
def _zero(table: BreakTable, code: int, a: float, b: float, fa: float, fb: float, level: float) -> float:
    """Return the time between two others at which a function is at a level.

    Source: T. R. Chandrupatla, Advances in Engineering Software 28 (1997) 145-149.
    """
    least, t, best = EPSILON * max(abs(a), abs(b)), 0.5, b
    x1, f1, x2, f2, x3, f3 = b, fb, a, fa, a, fa
    for _ in range(ROOT_TRIES):
        x = x1 + t * (x2 - x1)
        f = _value(table, code, x) - level
        if (f > 0.0) == (f1 > 0.0):
            x3, f3 = x1, f1
        else:
            x3, f3, x2, f2 = x2, f2, x1, f1
        x1, f1 = x, f
        best, f_best = x1, f1
        if abs(f2) < abs(f1):
            best, f_best = x2, f2
        room = (ROOT_PRECISION * abs(best) + least) / abs(x2 - x1)
        if room > 0.5 or f_best == 0.0 or not math.isfinite(room):
            break
        xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        inner = f1 / (f2 - f1) * f3 / (f2 - f3)
        outer = (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        t = 0.5
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi and math.isfinite(inner + outer):
            t = min(max(inner + outer, room), 1.0 - room)
    return best


@compiled_subset
def _end_cluster(table: BreakTable, k: int, a: float, b: float) -> None:
    """Add a break in neighbouring intervals that may hold a root, where the function differs on both sides."""
    search = table.search
    if search.cluster == 0:
        return
    search.cluster = 0
    low, high = search.low, search.high
    width = (high - low) + SMALLEST_OF_TIME * max(abs(low), abs(high))
    before, after = _value(table, table.values[k], low - width), _value(table, table.values[k], high + width)
    same = (before > 0.0 and after > 0.0) or (before < 0.0 and after < 0.0) or (before == 0.0 and after == 0.0)
    if table.kinds[k] == IS_WHOLE:
        same = abs(before) < _LARGEST_WHOLE and abs(after) < _LARGEST_WHOLE
        same = same and _floor(before) == _floor(after)
    if not same:
        _add(table, k, low + 0.5 * (high - low), a, b)


@compiled_subset
def _add(table: BreakTable, k: int, t: float, a: float, b: float) -> None:
    """Add a root of a condition in a piece of a run: a break or, of a narrow one, the place of a pulse."""
    search = table.search
    search.found += 1
    if table.kinds[k] != IS_NARROW:
        _append(table, t)
        return
    gap = t - search.last  # a root where an interval was cut is that of both parts
    if gap <= SMALLEST_OF_TIME * abs(t):
        return
    size = 1.0 / sqrt(_value(table, table.sharpness[k], t))
    if not (math.isfinite(size) and size > 0.0):
        return
    _finish(table, k, a, b, gap)
    search.gap = np.inf if math.isnan(gap) else gap
    search.last, search.size = t, size


@compiled_subset
def _finish(table: BreakTable, k: int, a: float, b: float, following: float) -> None:
    """Add the ends of steps about the last pulse of a piece, where it is short; the next one follows in some time."""
    search = table.search
    if table.kinds[k] != IS_NARROW or math.isnan(search.last):
        return
    if SHORT * search.size < min(b - a, min(search.gap, following)):
        for i in range(AROUND.size):
            t = search.last + search.size * AROUND[i]
            if a < t and t < b:
                _append(table, t)
    search.last = np.nan


@compiled_subset
def _append(table: BreakTable, t: float) -> None:
    search = table.search
    if search.count == table.times.size:
        search.over = 1
        return
    table.times[search.count] = t
    search.count += 1


@compiled_subset
def _merge(table: BreakTable, low: float, high: float) -> None:
    """Sort breaks; keep one of those that agree within rounding, and none at the ends of a run."""
    search, times, kept, previous = table.search, table.times, 0, np.nan
    for i in range(1, search.count):
        t, j = times[i], i
        while j > 0 and times[j - 1] > t:
            times[j] = times[j - 1]
            j -= 1
        times[j] = t
    for i in range(search.count):
        t = times[i]
        close = SMALLEST_OF_TIME * abs(t)
        if not (t - low > close and high - t > close):
            continue
        if not (t - previous <= close):
            times[kept] = t
            kept += 1
        previous = t
    search.count = kept
