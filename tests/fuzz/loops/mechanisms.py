"""Mechanisms with redundant closing conditions, and their motions in independent coordinates, derived by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from random import Random
from typing import Any, final

import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

__all__ = ["FAMILIES", "LONG", "Mechanism"]

Vector = sp.Matrix
G = sp.Rational(981, 100)


@final
@dataclass(frozen=True)
class Mechanism:
    """A scene, and its motion by hand.

    Attributes
    ----------
    scene : da.Scene
        Particles, their places in coordinates, and constraints of which some follow from others.
    free : sequence of symbols
        Independent coordinates.
    by_hand : mapping of str to expression
        Every coordinate of the scene in terms of them.
    places, masses : sequence
        Places (3,) of the particles in terms of the coordinates of the scene, and their masses.
    down : Matrix (3, 1)
        The direction of gravity.
    start, rates : sequence of float
        Independent coordinates and their rates at the start.
    duration : float
    """

    scene: da.Scene
    free: Sequence[sp.Symbol]
    by_hand: dict[str, Any]
    places: Sequence[Vector]
    masses: Sequence[Any]
    down: Vector
    start: Sequence[float]
    rates: Sequence[float]
    duration: float


@final
class Draw:
    """Random lengths, masses and bases."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)

    def number(self, low: float, high: float) -> sp.Rational:
        """Return a rational number with three digits."""
        return sp.Rational(round(1000 * self.rng.uniform(low, high)), 1000)

    def plane(self) -> Callable[[Any, Any], Vector]:
        """Return the map from components in a turned plane to space."""
        t = self.number(-3, 3)
        return lambda x, y: Vector([sp.cos(t) * x - sp.sin(t) * y, sp.sin(t) * x + sp.cos(t) * y, 0])

    def basis(self) -> sp.Matrix:
        """Return an orthogonal matrix (3, 3) of rational numbers."""
        a, b, c = (self.number(-1, 1) for _ in range(3))
        skew = sp.Matrix([[0, -c, b], [c, 0, -a], [-b, a, 0]])
        return (sp.eye(3) - skew) * (sp.eye(3) + skew).inv()


def _mechanism(
    name: str,
    names: Sequence[str],
    build: Callable[..., tuple[Sequence[Vector], Sequence[Any]]],
    by_hand: Callable[..., Sequence[Any]],
    draw: Draw,
    start: tuple[Sequence[float], Sequence[float]],
    down: Vector | None = None,
    duration: float = 4.0,
) -> Mechanism:
    """Return a mechanism from its places and closing conditions as functions of the coordinates."""
    N, O = ReferenceFrame("N"), Point("O")
    q = [dynamicsymbols(each) for each in names]
    scene = da.Scene(name, frame=N, origin=O, coordinates=q)
    places, closing = build(*q)
    masses = [draw.number(0.5, 2) for _ in places]
    for i, (place, mass) in enumerate(zip(places, masses, strict=True)):
        at = O.locatenew(f"P{i}", sum((x * axis for x, axis in zip(place, (N.x, N.y, N.z), strict=True)), 0 * N.x))
        scene.add_bodies(Particle(f"p{i}", at, mass))
    scene.add_holonomic_constraints(*closing)
    down = Vector([0, -1, 0]) if down is None else down
    scene.apply_uniform_gravity(sum((G * x * axis for x, axis in zip(down, (N.x, N.y, N.z), strict=True)), 0 * N.x))
    free = [sp.Symbol(f"s{i}") for i in range(len(start[0]))]
    known = dict(zip(names, by_hand(*free), strict=True))
    plain = [place.subs({x: known[each] for x, each in zip(q, names, strict=True)}) for place in places]
    return Mechanism(scene, free, known, plain, masses, down, *start, duration)


def _along(angle: Any, length: Any = 1) -> tuple[Any, Any]:
    return length * sp.cos(angle), length * sp.sin(angle)


def parallelogram(draw: Draw) -> Mechanism:
    """Two cranks of one length, their ends level at one distance; it turns over all quarters."""
    at, length, base = draw.plane(), draw.number(0.4, 1.5), draw.number(0.6, 2)

    def build(a: Any, b: Any) -> Any:
        first, second = at(*_along(a, length)), at(*_along(b, length)) + at(base, 0)
        gap = second - first - at(base, 0)
        return (first, second), (gap[0], gap[1])

    speed = draw.rng.uniform(-8, 8)
    return _mechanism("parallelogram", "ab", build, lambda s: (s, s), draw, ([draw.rng.uniform(-3, 3)], [speed]))


def three_cranks(draw: Draw) -> Mechanism:
    """A coupler that three cranks of one length carry without turning: more conditions than coordinates."""
    at, length = draw.plane(), draw.number(0.4, 1.5)
    feet = [(0, 0), *((draw.number(0.5, 2), draw.number(-1, 1)) for _ in range(2))]

    def build(*q: Any) -> Any:
        ends = [at(*_along(angle, length)) + at(*foot) for angle, foot in zip(q, feet, strict=True)]
        gaps = [end - ends[0] - at(*foot) for end, foot in zip(ends[1:], feet[1:], strict=True)]
        return ends, [gap[i] for gap in gaps for i in range(2)]

    start = [draw.rng.uniform(-3, 3)], [draw.rng.uniform(-8, 8)]
    return _mechanism("three_cranks", ["a0", "a1", "a2"], build, lambda s: (s, s, s), draw, start)


def carried_coupler(draw: Draw) -> Mechanism:
    """A coupler with an angle of its own on three cranks, its feet on no line: it never folds."""
    at, length = draw.plane(), draw.number(0.4, 1.5)
    feet = [(0, 0), (draw.number(0.8, 2), 0), (draw.number(0.3, 1), draw.number(0.6, 1.2))]

    def build(a: Any, b: Any, c: Any, turn: Any) -> Any:
        ends = [at(*_along(angle, length)) + at(*foot) for angle, foot in zip((a, b, c), feet, strict=True)]
        cos, sin = sp.cos(turn), sp.sin(turn)
        arms = [at(cos * x - sin * y, sin * x + cos * y) for x, y in feet]
        gaps = [end - ends[0] - arm for end, arm in zip(ends[1:], arms[1:], strict=True)]
        return (*ends, ends[0] + arms[1] / 3 + arms[2] / 2), [gap[i] for gap in gaps for i in range(2)]

    start = [draw.rng.uniform(-3, 3)], [draw.rng.uniform(-8, 8)]
    return _mechanism("carried_coupler", ["a", "b", "c", "turn"], build, lambda s: (s, s, s, 0), draw, start)


def doubled_bar(draw: Draw) -> Mechanism:
    """Two points on bars of one length and a coupler; a third bar at its middle follows. It does not fold."""
    at, length, base = draw.plane(), draw.number(0.6, 1.5), draw.number(0.8, 2)
    foot = at(base, 0)

    def build(x: Any, y: Any, u: Any, v: Any) -> Any:
        first, second = Vector([x, y, 0]), Vector([u, v, 0])
        middle = (first + second - foot) / 2
        rows = [each.dot(each) for each in (first, second - foot, second - first, middle)]
        return (first, second), [row - d**2 for row, d in zip(rows, (length, length, base, length), strict=True)]

    def by_hand(s: Any) -> Any:
        first = at(*_along(s, length))
        return (*first[:2], *(first + foot)[:2])

    level = foot / base  # gravity across the base, so that it hangs and does not reach its folds
    down = Vector([level[1], -level[0], 0])
    start = [-1.5708 + draw.rng.uniform(-0.9, 0.9)], [draw.rng.uniform(-0.5, 0.5)]
    return _mechanism("doubled_bar", ["x", "y", "u", "v"], build, by_hand, draw, start, down)


def pantograph(draw: Draw) -> Mechanism:
    """Two pairs of parallel bars that close, and one bar more between them; two angles are free, and stay apart."""
    at, first, second = draw.plane(), draw.number(0.6, 1.2), draw.number(0.6, 1.2)
    share = draw.number(0.2, 0.8)

    def build(a: Any, b: Any, c: Any, d: Any, f: Any) -> Any:
        arm, corner = at(*_along(a, first)), at(*_along(c, second))
        end = arm + at(*_along(b, second))
        gap = end - corner - at(*_along(d, first))
        other = at(*_along(a, share * first)) + at(*_along(f, second)) - corner - at(*_along(d, share * first))
        return (arm, corner, end), (gap[0], gap[1], other[0], other[1])

    def by_hand(s: Any, r: Any) -> Any:
        return s, r, r, s, r

    start = [draw.rng.uniform(-0.3, 0.3), draw.rng.uniform(1.2, 1.8)], [0.0, draw.rng.uniform(-0.3, 0.3)]
    return _mechanism("pantograph", ["a", "b", "c", "d", "f"], build, by_hand, draw, start, duration=0.2)


def scott_russell(draw: Draw) -> Mechanism:
    """A bar of twice the crank's length between two straight guides: one of its three conditions follows."""
    at, length = draw.plane(), draw.number(0.4, 1.2)

    def build(x: Any, bar: Any, crank: Any) -> Any:
        foot, middle = at(x, 0), at(*_along(crank, length))
        gap = foot + at(*_along(bar, length)) - middle
        guided = x + 2 * length * sp.cos(bar)
        return (foot, middle, foot + at(*_along(bar, 2 * length))), (gap[0], gap[1], guided)

    def by_hand(s: Any) -> Any:
        return -2 * length * sp.cos(s), s, sp.pi - s

    start = [draw.rng.uniform(0.4, 2.7)], [draw.rng.uniform(-5, 5)]
    return _mechanism("scott_russell", ["x", "bar", "crank"], build, by_hand, draw, start)


def slider_in_space(draw: Draw) -> Mechanism:
    """A slider-crank in a tilted plane that is closed in space: three conditions of rank two."""
    basis, crank = draw.basis(), draw.number(0.3, 0.6)
    rod = crank + draw.number(0.3, 1)

    def build(a: Any, b: Any, x: Any) -> Any:
        pin = basis * Vector([*_along(a, crank), 0])
        gap = pin + basis * Vector([*_along(b, rod), 0]) - basis * Vector([x, 0, 0])
        return (pin, basis * Vector([x, 0, 0])), list(gap)

    def by_hand(s: Any) -> Any:
        b = -sp.asin(crank / rod * sp.sin(s))
        return s, b, crank * sp.cos(s) + rod * sp.cos(b)

    start = [draw.rng.uniform(-3, 3)], [draw.rng.uniform(-8, 8)]
    return _mechanism("slider_in_space", ["a", "b", "x"], build, by_hand, draw, start)


def _turn(axis: int, angle: Any) -> sp.Matrix:
    turn = (sp.rot_axis1, sp.rot_axis2, sp.rot_axis3)[axis](angle)
    return turn.T


def _sarrus(draw: Draw) -> tuple[Any, Any, Any]:
    """Return the basis of a Sarrus linkage, and functions for its places and conditions, and coordinates by hand."""
    basis, length, other = draw.basis(), draw.number(0.5, 1.2), draw.number(0.5, 1.2)
    other = other if other > length else length + draw.number(0.1, 0.5)
    reach, across = draw.number(0.3, 1), draw.number(0.3, 1)

    def build(a: Any, b: Any, tilt: Any, c: Any, d: Any, lean: Any) -> Any:
        knee = Vector([reach + length * sp.cos(a), 0, length * sp.sin(a)])
        top = knee + Vector([length * sp.cos(b), 0, length * sp.sin(b)])
        plate = _turn(1, tilt)
        centre = top - plate * Vector([reach, 0, 0])
        elbow = Vector([0, across + other * sp.cos(c), other * sp.sin(c)])
        end = elbow + Vector([0, other * sp.cos(d), other * sp.sin(d)])
        turned = _turn(0, lean)
        gap = basis * (end - turned * Vector([0, across, 0]) - centre)
        x, y, z = (plate.col(i) for i in range(3))
        u, v, w = (turned.col(i) for i in range(3))
        twist = (x.dot(v) - u.dot(y), y.dot(w) - v.dot(z), z.dot(u) - w.dot(x))
        return [basis * each for each in (knee, centre, elbow)], (*gap, *twist)

    def by_hand(s: Any) -> Any:
        c = sp.asin(length / other * sp.sin(s))
        return s, sp.pi - s, 0, c, sp.pi - c, 0

    return basis, build, by_hand


def sarrus(draw: Draw) -> Mechanism:
    """Two hinged chains in planes across each other that lift a platform: six conditions of rank five."""
    basis, build, by_hand = _sarrus(draw)
    start = [draw.rng.uniform(0.4, 1.0)], [draw.rng.uniform(-0.5, 0.5)]
    return _mechanism(
        "sarrus", ["a", "b", "tilt", "c", "d", "lean"], build, by_hand, draw, start, duration=0.25, down=-basis.col(2)
    )


def bennett(draw: Draw) -> Mechanism:
    """Four skew hinges on two pairs of links: six conditions of rank three, which only these proportions meet."""
    basis = draw.basis()
    first, second = draw.number(0.4, 1.0), draw.number(1.3, 2.0)
    lengths = draw.number(0.8, 1.5), None
    lengths = lengths[0], lengths[0] * sp.sin(second) / sp.sin(first)
    links = [(lengths[i % 2], (first, second)[i % 2]) for i in range(4)]

    def build(*q: Any) -> Any:
        turn, place, places = sp.eye(3), sp.zeros(3, 1), []
        for angle, (length, twist) in zip(q, links, strict=True):
            turn = turn * _turn(2, angle)
            place = place + turn * Vector([length, 0, 0])
            turn = turn * _turn(0, twist)
            places.append(basis * place)
        skew = (turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
        return places[:3], (*(basis * place), *skew)

    factor = sp.sin((first + second) / 2) / sp.sin((second - first) / 2)

    def by_hand(s: Any) -> Any:
        other = 2 * sp.atan(factor / sp.tan(s / 2))
        return s, other, -s, -other

    start = [draw.rng.uniform(0.8, 2.2)], [draw.rng.uniform(-0.5, 0.5)]
    return _mechanism("bennett", ["a", "b", "c", "d"], build, by_hand, draw, start, duration=0.4)


def ladder(draw: Draw) -> Mechanism:
    """Cranks of one length in a row, each end level with the next at one distance: twelve conditions of rank six."""
    at, length, base = draw.plane(), draw.number(0.4, 1.5), draw.number(0.6, 2)

    def build(*q: Any) -> Any:
        ends = [at(*_along(angle, length)) + at(i * base, 0) for i, angle in enumerate(q)]
        gaps = [after - before - at(base, 0) for before, after in pairwise(ends)]
        return ends, [gap[i] for gap in gaps for i in range(2)]

    start = [draw.rng.uniform(-3, 3)], [draw.rng.uniform(-8, 8)]
    return _mechanism("ladder", [f"a{i}" for i in range(7)], build, lambda s: [s] * 7, draw, start)


def two_sarrus(draw: Draw) -> Mechanism:
    """A Sarrus linkage that stands on the platform of another: twelve conditions of rank ten."""
    (basis, lower, low), (_, upper, high) = _sarrus(draw), _sarrus(draw)

    def build(*q: Any) -> Any:
        below, first = lower(*q[:6])
        above, second = upper(*q[6:])
        return [*below, *(below[1] + place for place in above)], [*first, *second]

    start = [draw.rng.uniform(0.5, 0.9) for _ in range(2)], [draw.rng.uniform(-0.3, 0.3) for _ in range(2)]
    names = [f"{name}{i}" for i in range(2) for name in ("a", "b", "tilt", "c", "d", "lean")]
    down = -basis.col(2)
    return _mechanism("two_sarrus", names, build, lambda s, r: (*low(s), *high(r)), draw, start, down, 0.2)


LONG: dict[str, Callable[[Draw], Mechanism]] = {each.__name__: each for each in (ladder, two_sarrus)}
"""Mechanisms whose conditions have a rank beyond that of one group."""

FAMILIES: dict[str, Callable[[Draw], Mechanism]] = {
    each.__name__: each
    for each in (
        parallelogram,
        three_cranks,
        carried_coupler,
        doubled_bar,
        pantograph,
        scott_russell,
        slider_in_space,
        sarrus,
        bennett,
    )
}
