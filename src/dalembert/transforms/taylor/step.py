"""Taylor step as straight-line code: [Recurrences] -> [Kernel].

A step computes the series of the state, takes its size from the last coefficients, and sums the series by
Estrin's scheme. Order and step size follow Jorba and Zou (Experimental Mathematics 14, 2005): the step is the smaller
of two estimates of the radius of convergence, divided by e**p, with their safety factor exp(-0.7 / (order - 1)), and
the order is ceil(-log(tolerance)/p + 1). They take p = 2, which is best where the time of a step grows with the square
of its order. Here it grows more slowly, for what a step takes besides its products of coefficients: see `_GROWTH`.

At the floor, 1e-16, rounding and not truncation makes the error. Sums near 1, as the square of a pendulum's length, are
rounded down more often than up, because doubles below 1 are twice as dense; what that adds to the energy in a step
grows with the square of the step. Steps are therefore shorter there, and of an order of their own (`_FLOOR_SHARE`): the
drift of the energy of pendulums, sleighs and disks over 1e5 time units, 2e-12 to 4e-12 with p = 1.6, stays below 1e-12.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

from ...ir.kernel import Assignment, Kernel, Lines, Load, Operand
from ...methods.step_constants import SMALLEST_NORMAL
from ..pipelines import STEP_PASSES
from .expansion import FAITHFUL_ORDER, Expansion, Series, coefficient, over
from .nonsmooth import largest_degree
from .pairs import Pairs, pairs_of
from .recurrences import Integrated, Recurrences
from .residual_control import PREVIOUS, grown, reached
from .singular_steps import beside, passing
from .step_ends import CLOCK, before_zeros, within_piece
from .switch_steps import before_switches

STEP_ARGUMENTS = ("t", "y", "c", "s")
SETTINGS = ("largest step", "direction of time", "scale floor")
"""Entries of the argument s. The scale floor is atol / rtol, below which a state counts as that large.

Where each component of the state has an absolute tolerance of its own, atol is the smallest of them, and the weights
atol / own tolerance of the components follow: errors and magnitudes are compared after they are multiplied by these.
"""

_GROWTH = 1.6
"""Power of the order with which the time of a step grows; any from 1.5 to 1.8 is as good on spheres and sleighs."""

_FLOOR, _FLOOR_ORDER = 1.04e-16, 20
"""Tolerance up to which a step is one for the floor, and its order, which no other tolerance takes."""

_LEAST_ORDER = 6
"""Least order: forces with lower powers show in the series of a motion that begins where they are zero."""

_FLOOR_SHARE = 3.0
"""Exponent that takes the place of p in the size of such a step."""


def clipped_tolerance(rtol: float, atol: float) -> float:
    """Return the tolerance that the order of a Taylor step follows: rtol, or atol where there is no rtol."""
    return min(max(rtol or float(atol), 1e-18), 0.5)


@lru_cache(maxsize=64)
def order_at(rtol: float, atol: float) -> int:
    """Return the order of Taylor steps at tolerances."""
    return order_for(clipped_tolerance(rtol, atol))


@lru_cache(maxsize=64)
def scale_floor(rtol: float, atol: float) -> float:
    """Return the size below which a state counts as that large, which is the scale floor of `SETTINGS`."""
    return max(atol / clipped_tolerance(rtol, atol), SMALLEST_NORMAL)


def order_for(tolerance: float) -> int:
    """Return the order that is cheapest for a tolerance."""
    if tolerance <= _FLOOR:
        return _FLOOR_ORDER
    order = max(_LEAST_ORDER, math.ceil(-math.log(tolerance) / _GROWTH + 1.0))
    return order + 1 if order == _FLOOR_ORDER else order


def _loads(recurrences: Recurrences) -> tuple[Load, ...]:
    """Return loads of everything the kernel reads, and of every component of the state."""
    others = tuple(load for load in recurrences.kernel.loads if load.array != "y")
    return tuple(Load(state, "y", i) for i, state in enumerate(recurrences.states)) + others


def step_kernel(recurrences: Recurrences, order: int, *, dense: bool) -> Kernel:
    """Return one Taylor step as a kernel of the arguments `STEP_ARGUMENTS`.

    Its outputs are the new state (n_y), the size of the step, a zero that is NaN where the new state is not finite,
    and, where `dense`, the coefficients of orders 0 to `order` of each component in turn, in powers of the signed time.
    """
    return _expanded_step(recurrences, order, dense)[1]


def paired_step(recurrences: Recurrences, order: int, *, dense: bool) -> tuple[Kernel, Pairs]:
    """Return the kernel of a step, and pairs of its operations that one instruction on two numbers can do."""
    expansion, kernel = _expanded_step(recurrences, order, dense)
    return kernel, pairs_of(expansion, kernel)


def _expanded_step(recurrences: Recurrences, order: int, dense: bool) -> tuple[Expansion, Kernel]:
    expansion = Expansion(recurrences, order)
    expansion.extend(order)
    rates = [expansion.of(rate) for rate in recurrences.rates]
    poles, watched = ([expansion.of(value) for value in each] for each in (recurrences.poles, recurrences.watched))
    outputs = closing(expansion.lines, recurrences, rates, poles, order, watched)
    if dense:
        outputs += [a for state in recurrences.states for a in expansion.series[state]]
    loads = (*_loads(recurrences), *closing_loads(recurrences))
    return expansion, STEP_PASSES(Kernel("step", STEP_ARGUMENTS, loads, tuple(expansion.lines.body), tuple(outputs)))


_TURNS = 4.0 * math.pi
LOW_TERMS = 4
"""Terms of the series of an event that may be the largest: those after which it leaves zero."""
_NOTHING, _LESS = 1e-250, 1e-300
"""Smallest sizes of terms, so that a series that is zero does not limit the step."""

SETTING_NAMES = ("largest_", "direction_", "floor_")


def closing_loads(recurrences: Recurrences) -> list[Load]:
    """Return the loads of the end of a step that its series do not need."""
    loads = [Load(name, "s", i) for i, name in enumerate((*SETTING_NAMES, *_weights(recurrences)))]
    if recurrences.step_growth_limited:
        loads.append(Load(PREVIOUS, "y", len(recurrences.states)))
    return [*loads, Load(CLOCK, "t", None)] if recurrences.watched else loads


def closing(
    lines: Lines,
    recurrences: Recurrences,
    rates: list[Series],
    poles: list[Series],
    order: int,
    watched: Sequence[Series] = (),
) -> list[Operand]:
    """Return the new state, the size of the step and the check, from the series of the rates and of the poles.

    Of poles, the first terms and the last two are read; `watched` are the series of `Recurrences.watched`.
    """
    largest, direction, floor = SETTING_NAMES
    scale, weights = _scale(lines, recurrences, floor), _weights(recurrences)
    radius = _radius(lines, recurrences, rates, order, scale, _orders_read(recurrences, order))
    tables, vanishing, pivots = len(recurrences.tables), len(recurrences.roots), len(recurrences.pivots)
    arguments, roots, others = watched[:tables], watched[tables : tables + vanishing], watched[tables + vanishing :]
    if radius is not None and pivots:
        clean = _radius(lines, recurrences, rates, order, scale, (order // 2, order // 2 + 1))
        assert clean is not None
        radius = passing(lines, others[:pivots], order, radius, clean, direction)
    size: Operand = largest if radius is None else lines.op("min", radius, largest)
    for pole in poles:
        size = lines.op("min", size, lines.op("rough_exp2", lines.op("min", *_share_of_itself(lines, pole, order))))
    if recurrences.step_growth_limited:
        size = grown(lines, size, largest)
    deciding = dict(zip(recurrences.switch_arguments, others[pivots:], strict=True))
    for (_, key), series in zip(recurrences.tables, arguments, strict=True):
        size = within_piece(lines, series, key, order, size, direction)
    tolerance = _FLOOR if order == _FLOOR_ORDER else math.exp(-_GROWTH * (order - 1))
    changes = _weighted(lines, rates, weights) if roots or recurrences.switches else rates
    size = before_zeros(lines, roots, changes, order, size, direction, scale, tolerance)
    moving = recurrences.switches, deciding, changes
    size = before_switches(lines, *moving, order, size, direction, scale, tolerance)
    if recurrences.controlled:
        begun: dict[Operand, Operand] = {
            name: series[0] for (name, _), series in zip(recurrences.tables, arguments, strict=True)
        }
        begun |= {name: series[0] for name, series in deciding.items()}
        size = reached(lines, recurrences, rates, order, size, direction, scale, tolerance, begun, weights)
    size = beside(lines, others[:pivots], order, size, direction)
    h = lines.op("mul", size, direction)
    faithful = order >= FAITHFUL_ORDER
    new: list[Operand] = []
    check: Operand = 0.0
    powers = [h]
    while len(powers) < (order - 1).bit_length():
        powers.append(lines.op("mul", powers[-1], powers[-1]))
    own = len(recurrences.states) - recurrences.events_with_series
    for state, rate in zip(recurrences.states[:own], rates[:own], strict=True):
        terms = [over(lines, coefficient(rate, k), k + 1, faithful) for k in range(order)]
        begin = len(lines.body)
        moved = _polynomial(lines, terms, powers)
        lines.note(state, begin)
        new.append(lines.add(state, lines.mul(moved, h)))
        check = lines.op("fma", new[-1], 0.0, check)
    return [*new, *recurrences.states[own:], size, check]


def _weights(recurrences: Recurrences) -> list[str]:
    """Return the names of the weights of the components of the state; none where all count alike."""
    own = len(recurrences.states) - recurrences.events_with_series
    return [f"weight_{i}_" for i in range(own)] if recurrences.weighted else []


def _weighted(lines: Lines, rates: Sequence[Series], weights: Sequence[str]) -> list[Series]:
    """Return series times the weights of their components; those behind the weights, of events, as they are."""
    found = [[lines.mul(a, weight) for a in rate] for rate, weight in zip(rates, weights, strict=False)]
    return [*found, *rates[len(weights) :]]


def _polynomial(lines: Lines, coefficients: Series, powers: Sequence[Operand]) -> Operand:
    """Return a polynomial by Estrin's scheme, whose operations wait for few others; `powers` are x, x^2, x^4, ..."""
    for power in powers:
        coefficients = [
            lines.fma(power, high, low)
            for low, high in zip(coefficients[::2], [*coefficients[1::2], 0.0], strict=False)
        ]
    return coefficients[0]


def ending(
    recurrences: Recurrences,
    rates: list[list[str]],
    poles: list[list[str]],
    order: int,
    watched: Sequence[list[str]] = (),
) -> tuple[list[Assignment], list[Operand]]:
    """Return the end of a step whose series are already known: lines, and the outputs of `step_kernel` without dense.

    `rates`, `poles` and `watched` name the coefficients 0 to order - 1 of each rate, pole and watched value.
    """
    lines = Lines()
    known: list[list[Series]] = [[list(names) for names in group] for group in (rates, poles, watched)]
    return lines.body, closing(lines, recurrences, known[0], known[1], order, known[2])


def series_kernel(recurrences: Recurrences, order: int) -> Kernel:
    """Return the series alone: coefficients of orders 0 to `order` of each component of the state in turn."""
    expansion = Expansion(recurrences, order)
    expansion.extend(order)
    outputs = [a for state in recurrences.states for a in expansion.series[state]]
    kernel = Kernel("series", ("t", "y", "c"), _loads(recurrences), tuple(expansion.lines.body), tuple(outputs))
    return STEP_PASSES(kernel)


def _scale(lines: Lines, recurrences: Recurrences, floor: Operand) -> Operand:
    """Return the scale of errors.

    It is the largest component that anything depends on, but at least the floor; quadratures count in the error and
    not in the scale, and an angle counts as two turns at most, however often it has gone round. Components count by
    their weights, where they have any.
    """
    own = len(recurrences.states) - recurrences.events_with_series
    used = {arg for item in recurrences.items for arg in (item.value if isinstance(item, Integrated) else item).args}
    used |= set(recurrences.rates)
    states = recurrences.states[:own]
    scale: list[Operand] = [state for state in states if state in used] or list(states)
    angles = [state for state in scale if state in recurrences.angles]
    every: Sequence[Operand] = _weights(recurrences) or [1.0] * own
    weights = dict(zip(states, every, strict=True))
    others = [state for state in scale if state not in recurrences.angles]
    largest = _norm(lines, [lines.mul(state, weights[str(state)]) for state in others], floor)
    for group in [[angle] for angle in angles] if recurrences.weighted else [angles] if angles else []:
        turned = lines.op("min", _norm(lines, group[1:], lines.op("abs", group[0])), _TURNS)
        largest = lines.op("max", largest, lines.mul(turned, weights[str(group[0])]))
    return largest


def _radius(
    lines: Lines, recurrences: Recurrences, rates: list[Series], order: int, scale: Operand, read: Sequence[int]
) -> Operand | None:
    """Return the step that coefficients of the state of the orders `read` allow, read off those of its rate.

    None, which allows any step, where all are zero whatever the state is, as of a polynomial in time.
    """
    own = len(recurrences.states) - recurrences.events_with_series
    rates, event_series = rates[:own], rates[own:]
    weights: Sequence[Operand] = _weights(recurrences) or [1.0] * own
    size = lines.op("rough_log2", scale)
    steps = []
    for k in read:
        terms = [coefficient(rate, k - 1) for rate in rates]
        norm = _norm(lines, [lines.mul(*pair) for pair in zip(terms, weights, strict=True)], _LESS)
        if norm != _LESS:
            gap = lines.op("add", lines.op("sub", size, lines.op("rough_log2", norm)), math.log2(k))
            steps.append(lines.mul(gap, 1.0 / k))
    steps += [lines.op("min", *_share_of_itself(lines, series, order)) for series in event_series]
    share = _FLOOR_SHARE if order == _FLOOR_ORDER else _GROWTH
    safety = (-share - 0.7 / (order - 1)) / math.log(2.0)
    if not steps:
        return None
    shortest = steps[0]
    for step in steps[1:]:
        shortest = lines.op("min", step, shortest)
    return lines.op("rough_exp2", lines.op("add", shortest, safety))


def _orders_read(recurrences: Recurrences, order: int) -> list[int]:
    """Return orders of coefficients of the state, of which one is not zero as long as the series continues.

    A motion that begins like t**p, p <= 2, under a force whose first power in it is d has terms with gaps of
    p (d - 1) + 2 orders; those of the coordinates and of the speeds make two orders next to each other in each gap.
    For d = 2, as of a pendulum released where it is horizontal, and for p = 1 and d = 3, as of a mass in the middle of
    a cubic spring, gaps are 4, and the last two orders are none of those where `order` is a multiple of 4 or one less.
    Larger gaps need products of so many factors; every other order is enough, or all where the gap is not yet over.
    """
    factors = max(largest_degree(recurrences.kernel), 2)
    if order <= 2 * factors:
        return list(range(2, order + 1))
    more = factors - 1 if factors > 2 else 0 if order % 4 in (1, 2) else 1
    return [*range(order - 1 - 2 * more, order - 1, 2), order - 1, order]


def _share_of_itself(lines: Lines, series: Series, order: int) -> list[Operand]:
    """Return log2 of the steps at whose end the last two terms of a series are as large as the largest of the first.

    What it counts as large is the series itself, whatever its units.
    """

    def size(k: int, least: float) -> Operand:
        return lines.op("rough_log2", _norm(lines, [coefficient(series, k)], least))

    first = [size(k, _NOTHING) for k in range(min(LOW_TERMS, order - 2))]
    steps = []
    for k in (order - 2, order - 1):
        last = size(k, _LESS)
        best: Operand = -math.inf
        for low, term in enumerate(first):
            reach = lines.mul(lines.sub(term, last), 1.0 / (k - low))
            best = reach if low == 0 else lines.op("max", reach, best)
        steps.append(best)
    return steps


def _norm(lines: Lines, values: Sequence[Operand], least: Operand) -> Operand:
    """Return the largest size, at least `least`."""
    sizes = [least, *(lines.op("abs", v) if isinstance(v, str) else abs(v) for v in values if v != 0.0)]
    while len(sizes) > 1:
        larger = [lines.op("max", *pair) for pair in zip(sizes[::2], sizes[1::2], strict=False)]
        sizes = larger + sizes[2 * len(larger) :]
    return sizes[0]
