"""Random driven cases, each of ten families of scenes with more: `FAMILIES`, and `drawn`, which makes one of a seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import final

from fuzz.contacts.families import FAMILIES as SCENES
from fuzz.contacts.families import Case, Draw
from fuzz.contacts.families import drawn as drawn_scene
from fuzz.contacts.systems import SYSTEMS
from fuzz.driven.records import PIECES, Record

__all__ = ["FAMILIES", "Driven", "Kick", "Law", "drawn", "of_case"]

FORCES = {
    "particle": {"g_x": 4.0, "x_0": 0.3, "A": 10.0, "C": 25.0},
    "particle static": {"g_x": 4.0, "x_0": 0.3, "A": 10.0},
    "stack of 2": {"A1": 20.0, "A2": 20.0, "lift": 25.0},
    "stack of 3": {"A1": 20.0, "A3": 20.0, "lift": 25.0},
    "rod on floor": {"A": 10.0},
    "rod in corner": {"A": 10.0},
    "plate": {"A": 8.0},
    "wheel": {"T": 4.0, "g_x": 4.0, "A": 5.0},
    "slot": {"load": 12.0, "A": 10.0},
    "ring": {"A": 15.0},
    "trammel": {"A": 10.0},
    "chain": {"A": 30.0, "a1": 0.6, "a3": 0.6},
    "disc": {"g_x": 3.0, "g_y": 3.0, "A": 10.0},
    "pendulum": {"A": 12.0},
}
"""Numbers that may jump, with their largest sizes, by scene."""
SPEEDS = {
    "particle": {"belt": 1.0},
    "particle static": {"belt": 1.0},
    "stack of 2": {"belt": 0.6},
    "stack of 3": {"belt": 0.6},
    "wheel": {"belt": 1.0},
    "slot": {"belt": 0.8},
    "disc": {"u_x": 0.8, "u_y": 0.8},
}
"""Speeds of belts, which are continuous."""
PLACES = {"wheel": {"x_wall": 0.15}, "pendulum": {"d": 0.04}}
"""Places of walls, which are smooth, with how far they move."""


@final
@dataclass(frozen=True)
class Law:
    """What a controller sets a number to at its instants.

    Attributes
    ----------
    sets : str
        Name of the number.
    kind : {"line", "switch", "integral", "count"}
        a - b q - c v; a or -a by the side of b that q is on; the sum of T (b - q), times a; a cos(b n) at instant n.
    place : int
        Of the coordinate q with the rate v.
    numbers : tuple of float
        a, b, c.
    period : float
        Time between instants [s].
    """

    sets: str
    kind: str
    place: int
    numbers: tuple[float, float, float]
    period: float

    def value(self, q: Sequence[float], v: Sequence[float], own: float) -> float:
        """Return what it sets at coordinates, rates, and its own state: the number of the instant, or a sum."""
        a, b, c = self.numbers
        x = float(q[self.place])
        if self.kind == "line":
            return a - b * x - c * float(v[self.place])
        if self.kind == "switch":
            return a if x > b else -a
        return a * own if self.kind == "integral" else a * math.cos(b * own)

    def error(self, q: Sequence[float]) -> float:
        """Return what an instant adds to the sum."""
        return self.period * (self.numbers[1] - float(q[self.place]))


@final
@dataclass(frozen=True)
class Kick:
    """An event that maps the state: where time, or a coordinate, comes to a level, all rates are scaled.

    Attributes
    ----------
    place : int
        Of the coordinate; -1 for time.
    level : float
        Of the coordinate, or the time [s].
    direction : int
        As that of `Event`.
    scale : float
        Of the rates.
    """

    place: int
    level: float
    direction: int
    scale: float


@final
@dataclass(frozen=True)
class Driven:
    """A case of the ten families with records in place of some numbers, a controller, and a kick."""

    case: Case
    records: tuple[tuple[str, Record], ...] = ()
    law: Law | None = None
    kick: Kick | None = None


def of_case(case: Case, records: dict[str, Record]) -> Driven:
    """Return a case with records in place of some of its numbers."""
    return Driven(case, tuple(records.items()))


def _times(d: Draw, span: float, count: int) -> tuple[float, ...]:
    """Return times of a span that begin with 0; eighths of it, or any."""
    some = {round(span * int(d.rng.integers(1, 8)) / 8, 4) if d.chance(0.5) else round(d(0.05, 0.95) * span, 3)}
    while len(some) < count - 1:
        some.add(round(span * float(d.rng.uniform(0.03, 0.97)), d.digits + 1))
    return (0.0, *sorted(some))


def _sampled(d: Draw, kind: str, first: float, most: float, about: float, span: float) -> Record:
    """Return samples that begin with a value and stay within a distance of another one."""
    knots = (*_times(d, span, d.one(4, 6, 9)), span)
    return Record(kind, knots, (first, *(round(about + d(-most, most, 0.1), 4) for _ in knots[1:])))


def _function(d: Draw, kind: str, first: float, most: float, span: float) -> Record:
    """Return a function of time of pieces that begins with a value."""
    knots, rate = _times(d, span, PIECES), 2.0 * most / span
    slopes = tuple(d(-rate, rate, 0.4) for _ in knots)
    values = [first]
    for i in range(1, PIECES):
        values.append(
            values[-1] + slopes[i - 1] * (knots[i] - knots[i - 1]) if kind == "ramps" else d(-most, most, 0.1)
        )
    return Record(kind, knots, tuple(values), slopes)


def _records(d: Draw, case: Case, samples: bool) -> dict[str, Record]:
    """Return records of one or two numbers of a case."""
    name, found = case.scene, {}
    forces, speeds, places = FORCES[name], SPEEDS.get(name, {}), PLACES.get(name, {})
    if name == "wheel" and case.parameters["x_wall"] > 10.0:
        places = {}
    for _ in range(d.one(1, 1, 2)):
        table = d.one(*(kind for kind in (forces, forces, speeds, places if samples else {}) if kind))
        key = d.one(*table)
        most, first = table[key], case.parameters[key]
        if table is forces and d.chance(0.5):
            first = d(-most, most)
        if not samples:
            found[key] = _function(d, "ramps" if table is speeds else d.one("steps", "ramps"), first, most, case.span)
            continue
        kinds = (
            ("cubic",) if table is places else ("linear", "cubic") if table is speeds else ("hold", "linear", "cubic")
        )
        about = first if table is places else 0.0
        found[key] = _sampled(d, d.one(*kinds), first, most, about, case.span)
    return found


def inputs(d: Draw, case: Case) -> Driven:
    """Forces, belts and walls by samples."""
    return of_case(case, _records(d, case, True))


def functions(d: Draw, case: Case) -> Driven:
    """Forces and belts by functions of time with jumps and kinks."""
    return of_case(case, _records(d, case, False))


def controllers(d: Draw, case: Case) -> Driven:
    """A force by a sampled controller."""
    sets = d.one(*FORCES[case.scene])
    most, place = FORCES[case.scene][sets], int(d.rng.integers(len(case.initial) // 2))
    kind, q = d.one("line", "line", "switch", "integral", "count"), list(case.initial.values())[place]
    if kind == "line":
        numbers = (round(most * d(-0.5, 0.5, 0.2), 3), round(most * d(0.0, 2.0), 3), round(most * d(0.0, 0.3, 0.4), 3))
    elif kind == "switch":
        numbers = (most * d.one(0.5, 1.0), round(q + d(-0.3, 0.3), 3), 0.0)
    elif kind == "integral":
        numbers = (round(most * d(1.0, 8.0), 3), round(q + d(-0.5, 0.5), 3), 0.0)
    else:
        numbers = (most * d.one(0.5, 1.0), d(0.3, 2.0), 0.0)
    period = d.one(case.span / 8, case.span / 20, case.span / 40, 0.03, 0.05, 0.07)
    return Driven(case, law=Law(sets, kind, place, numbers, period))


def events(d: Draw, case: Case) -> Driven:
    """Events that scale all rates, half of them beside samples."""
    made = of_case(case, _records(d, case, True)) if d.chance(0.5) else Driven(case)
    values = list(case.initial.values())
    scale = d.one(0.5, 0.0, 1.3, -0.7, -1.0)
    if d.chance(0.4):
        return replace(made, kick=Kick(-1, round(case.span * d(0.1, 0.9), 3), 0, scale))
    place = int(d.rng.integers(len(values) // 2))
    return replace(made, kick=Kick(place, round(values[place] + d(-0.4, 0.4), 4), d.one(0, 1, -1), scale))


FAMILIES: dict[str, Callable[[Draw, Case], Driven]] = {
    "inputs": inputs,
    "functions": functions,
    "controllers": controllers,
    "events": events,
}


_DRIVEN = [name for name in SCENES if name != "puck"]


def drawn(family: str, seed: int) -> Driven:
    """Return the driven case of a seed: seeds go through the ten families of scenes that are driven."""
    scene = _DRIVEN[seed % len(_DRIVEN)]
    case = drawn_scene(scene, 1000 + seed)
    assert case.scene in SYSTEMS or case.scene.startswith("particle")
    return FAMILIES[family](Draw(100 + list(FAMILIES).index(family), seed), case)
