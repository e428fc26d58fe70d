"""Random cases of the families: `FAMILIES`, and `drawn`, which makes a case of a seed."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

__all__ = ["FAMILIES", "Case", "drawn"]

VERSION = 1
"""Of the draws: a result of another version says nothing about a seed."""


@final
@dataclass(frozen=True)
class Case:
    """A scene by name with its numbers: parameters, start (coordinates and rates), and span [s]."""

    scene: str
    parameters: dict[str, float]
    initial: dict[str, float]
    span: float

    def __str__(self) -> str:
        return f"{self.scene}, {self.span:g} s, {json.dumps(self.initial)}, {json.dumps(self.parameters)}"


@final
class Draw:
    """Random numbers of a case, rounded to few digits so that ties, rests and zeros are frequent."""

    def __init__(self, family: int, seed: int) -> None:
        self.rng = np.random.default_rng([17, family, seed])
        self.digits = 1 if self.rng.random() < 0.3 else 3

    def __call__(self, low: float, high: float, zero: float = 0.0) -> float:
        """Return a number from a range, with a probability of being 0."""
        value = round(float(self.rng.uniform(low, high)), self.digits)
        return 0.0 if self.rng.random() < zero else value

    def positive(self, low: float, high: float, zero: float = 0.0) -> float:
        """Return the same, at least 0.05 unless it is 0."""
        value = self(low, high, zero)
        return value if value == 0.0 else max(value, 0.05)

    def chance(self, probability: float) -> bool:
        """Return True with a probability."""
        return bool(self.rng.random() < probability)

    def one(self, *values: Any) -> Any:
        """Return one of some values."""
        return values[int(self.rng.integers(len(values)))]


def particle(d: Draw) -> Case:
    """A particle that slides, sticks, is lifted, and lands, sometimes with restitution."""
    static, falls = d.chance(0.25), d.chance(0.3)
    mu = d.positive(0.0, 1.0, 0.1)
    p = {"m": d.positive(0.3, 3), "g_x": d(-4, 4, 0.5), "g_y": d.one(9.81, 9.81, 10.0, 2.0)}
    p |= {"k": d(0, 30, 0.3), "c": d(0, 1, 0.6), "x_0": d(-0.3, 0.3, 0.6)}
    p |= {"A": d(0, 10, 0.5), "omega": d(1, 9), "phi": d(0, 3, 0.5)}
    p |= {"B": d(0, 12, 0.8), "C": d(0, 25, 0.7), "nu": d(1, 9), "belt": d(-1, 1, 0.5), "mu": mu}
    p |= {"mu_s": mu + d(0, 0.4) if static else mu, "e": d(0.1, 0.95, 0.0) if falls and d.chance(0.5) else 0.0}
    start = {"x": d(-0.5, 0.5, 0.3), "y": d(0.05, 0.6) if falls else 0.0}
    start |= {"x_dot": d(-2, 2, 0.3), "y_dot": d(-1, 1, 0.5) if falls and start["y"] > 0.0 else 0.0}
    return Case("particle static" if static else "particle", p, start, d.one(1.0, 2.0, 3.0))


def stack(d: Draw) -> Case:
    """Blocks on each other; the uppermost may fall on the others, or be lifted."""
    count = d.one(2, 3)
    p = {"g": d.one(9.81, 10.0), "belt": d(-0.6, 0.6, 0.6), "lift": d(0, 25, 0.8), "nu": d(1, 6)}
    start: dict[str, float] = {}
    for i in range(1, count + 1):
        p |= {f"m{i}": d.positive(0.3, 3), f"A{i}": d(0, 20, 0.4), f"omega{i}": d(1, 9)}
        p |= {f"mu{i}": d.positive(0.05, 0.8)}
        start |= {f"x{i}": d(-0.5, 0.5, 0.5), f"y{i}": 0.0}
    for i in range(1, count + 1):
        start |= {f"x{i}_dot": d(-2, 2, 0.4), f"y{i}_dot": 0.0}
    if d.chance(0.3):
        start[f"y{count}"] = d(0.05, 0.4)
    return Case(f"stack of {count}", p, start, d.one(1.0, 2.0))


def _rod(d: Draw) -> dict[str, float]:
    return {"m": d.positive(0.3, 3), "l": d.positive(0.3, 1.2), "g": d.one(9.81, 10.0)} | {
        "A": d(0, 10, 0.6),
        "omega": d(1, 8),
    }


def rod_floor(d: Draw) -> Case:
    """A rod that slides on one end, falls on the floor, and lies there."""
    p = _rod(d) | {"mu": d(0, 0.9, 0.1)}
    p["e"] = d(0.1, 0.8) if d.chance(0.1) else 0.0
    theta = d(-1.4, 1.4, 0.05)
    up = p["l"] * abs(math.sin(theta))
    turn, along = d(-3, 3, 0.3), d(-2, 2, 0.2)
    start = {"x": 0.0, "y": up, "theta": theta, "x_dot": along, "y_dot": 0.0, "theta_dot": turn}
    if d.chance(0.5):  # in the air
        start |= {"y": up + d(0.1, 0.5), "y_dot": d(-1, 1, 0.5)}
    elif theta == 0.0:
        start["theta_dot"] = 0.0
    else:  # the lower end stays on the floor: y = l sin(|theta|)
        start["y_dot"] = p["l"] * math.cos(theta) * turn * math.copysign(1.0, theta)
    return Case("rod on floor", p, start, d.one(0.5, 1.0, 1.5))


def rod_corner(d: Draw) -> Case:
    """A rod that leans in a corner, slips, leaves the wall and lies down."""
    p = _rod(d) | {"mu": d(0, 0.6, 0.1), "mu_wall": d(0, 0.6, 0.2)}
    theta = -d.positive(0.2, 1.4)
    l, c, s = p["l"], math.cos(theta), math.sin(theta)
    turn = d(-2, 1, 0.5)
    start = {"x": l * c, "y": -l * s, "theta": theta}
    start |= {"x_dot": -l * s * turn, "y_dot": -l * c * turn, "theta_dot": turn}
    if d.chance(0.25):
        start |= {"x": start["x"] + d(0.05, 0.3), "x_dot": start["x_dot"] + d(-2, 0, 0.3)}
    return Case("rod in corner", p, start, d.one(0.5, 1.0, 1.5))


def plate(d: Draw) -> Case:
    """A plate that slides, tips and rocks on two feet, or falls on one of them."""
    m, b, h = d.positive(0.5, 3), d.positive(0.1, 0.8), d.positive(0.1, 1.0)
    p = {"m": m, "I": round(m * (b**2 + h**2) / 3.0, 4), "b": b, "h": h, "g": d.one(9.81, 10.0)}
    p |= {"mu": d(0, 1.0, 0.05), "A": d(0, 8, 0.4) * m, "omega": d(1, 9), "phi": d(0, 3, 0.5)}
    start = {"x": 0.0, "y": h, "theta": 0.0, "x_dot": d(-2, 2, 0.4), "y_dot": 0.0, "theta_dot": 0.0}
    if d.chance(0.5):  # on one foot, or above
        theta = d(-0.3, 0.3)
        start |= {"theta": theta, "y": b * math.sin(abs(theta)) + h * math.cos(theta)}
        if d.chance(0.4):
            start |= {"y": start["y"] + d(0.05, 0.3), "theta_dot": d(-1, 1)}
        else:
            start["x_dot"] = 0.0
    return Case("plate", p, start, d.one(0.5, 1.0, 2.0))


def wheel(d: Draw) -> Case:
    """A wheel that slips and rolls, falls, and runs against a wall."""
    m, r, wall = d.positive(0.3, 3), d.positive(0.1, 0.6), d.chance(0.35)
    p = {"m": m, "I": round(m * r**2 * d.one(0.5, 1.0, 0.7), 5), "r": r, "g_x": d(-3, 5, 0.5), "g_y": 9.81}
    p |= {"belt": d(-1, 1, 0.7), "T": d(-4, 4, 0.4), "omega": d(1, 8), "A": d(-5, 5, 0.7)}
    p |= {"mu": d(0, 0.9, 0.05), "mu_wall": d(0, 0.7, 0.3), "x_wall": r + d(0.2, 1.0) if wall else 50.0, "e": 0.0}
    start = {"x": 0.0, "y": r, "theta": 0.0, "x_dot": d(-2, 3, 0.2), "y_dot": 0.0, "theta_dot": d(-9, 9, 0.3)}
    if d.chance(0.15):  # rolls from the start
        start["theta_dot"] = (p["belt"] - start["x_dot"]) / r
    if d.chance(0.3):
        start |= {"y": r + d(0.05, 0.5), "y_dot": d(-1, 1, 0.5)}
        p["e"] = d(0.1, 0.9, 0.5) if not wall else 0.0
    return Case("wheel", p, start, d.one(1.0, 2.0))


def slot(d: Draw) -> Case:
    """A block in a slot, a bead on a ring, a rod with its ends in two slots: normal reactions of either sign."""
    name = d.one("slot", "ring", "trammel")
    if name == "slot":
        p = {"m": d.positive(0.3, 3), "k": d(0, 30, 0.3), "A": d(0, 10, 0.3), "omega": d(1, 9)}
        p |= {"B": d(0, 15, 0.2), "nu": d(1, 9), "load": d(-12, 12, 0.3), "belt": d(-0.8, 0.8, 0.6), "mu": d(0, 1.0)}
        start = {"x": d(-0.5, 0.5, 0.2), "y": 0.0, "x_dot": d(-2, 2, 0.3), "y_dot": 0.0}
        return Case(name, p, start, d.one(1.0, 2.0, 3.0))
    if name == "ring":
        p = {"m": d.positive(0.3, 3), "R": d.positive(0.3, 1.2), "g": d.one(9.81, 10.0)}
        p |= {"A": d(0, 15, 0.5), "omega": d(1, 8), "mu": d(0, 0.8, 0.05)}
        angle, speed, R = d(-3.0, 3.0, 0.1), d(-5, 5, 0.2), p["R"]
        start = {"x": R * math.sin(angle), "y": -R * math.cos(angle)}
        start |= {"x_dot": speed * math.cos(angle), "y_dot": speed * math.sin(angle)}
        return Case(name, p, start, d.one(1.0, 2.0))
    p = _rod(d) | {"mu": d(0, 0.5, 0.1), "mu_wall": d(0, 0.5, 0.2)}
    theta, turn, l = d(-1.5, 1.5), d(-4, 4, 0.3), p["l"]
    c, s = math.cos(theta), math.sin(theta)
    start = {"x": l * c, "y": -l * s, "theta": theta}
    start |= {"x_dot": -l * s * turn, "y_dot": -l * c * turn, "theta_dot": turn}
    return Case(name, p, start, d.one(0.5, 1.0, 2.0))


def chain(d: Draw) -> Case:
    """Three sprung masses on a line that meet each other and a wall."""
    p: dict[str, float] = {}
    for name, low, high, zero in (("m", 0.3, 3.0, 0.0), ("k", 5.0, 80.0, 0.0), ("a", -0.1, 1.2, 0.1)):
        p |= {f"{name}{i}": d(low, high, zero) if name == "a" else d.positive(low, high) for i in (1, 2, 3)}
    if d.chance(0.25):  # two rest where they touch
        p["a2"] = p["a1"]
    p |= {"c": d(0, 2, 0.5), "A": d(0, 30, 0.5), "omega": d(1, 12)}
    bounces = d.chance(0.4)
    p |= {"e_wall": d(0, 0.9) if bounces else 0.0, "e": d(0, 0.9) if bounces else 0.0}
    places = sorted(d(0.0, 1.2, 0.1) for _ in range(3))
    start = {f"x{i + 1}": place for i, place in enumerate(places)}
    speeds = [d(-1.5, 1.5, 0.4) for _ in range(3)]
    for i in range(3):  # what touches does not approach
        before, gap = (0.0, places[0]) if i == 0 else (speeds[i - 1], places[i] - places[i - 1])
        if gap == 0.0:
            speeds[i] = max(speeds[i], before)
    start |= {f"x{i + 1}_dot": speed for i, speed in enumerate(speeds)}
    return Case("chain", p, start, d.one(1.0, 2.0))


def disc(d: Draw) -> Case:
    """A particle on a moving plane at two springs, pushed round, and sometimes thrown at it."""
    falls = d.chance(0.35)
    p = {"m": d.positive(0.3, 3), "g_x": d(-3, 3, 0.6), "g_y": d(-3, 3, 0.7), "g_z": 9.81}
    p |= {"k_x": d(0, 30, 0.3), "k_y": d(0, 30, 0.3), "c": d(0, 1, 0.7)}
    p |= {"u_x": d(-0.8, 0.8, 0.4), "u_y": d(-0.8, 0.8, 0.7)}
    p |= {"A": d(0, 10, 0.6), "omega": d(1, 8), "C": d(0, 8, 0.7), "nu": d(1, 8)}
    p |= {"mu": d(0, 1.0, 0.05), "e": d(0, 0.8, 0.4) if falls else 0.0}
    if d.chance(0.2):
        p["k_y"] = p["k_x"]
    start = {"x": d(-0.4, 0.4, 0.3), "y": d(-0.4, 0.4, 0.3), "z": d(0.05, 0.5) if falls else 0.0}
    start |= {"x_dot": d(-2, 2, 0.2), "y_dot": d(-2, 2, 0.3), "z_dot": d(-2, 1, 0.3) if falls else 0.0}
    if d.chance(0.1):  # sticks from the start
        start |= {"x_dot": p["u_x"], "y_dot": p["u_y"]}
    return Case("disc", p, start, d.one(1.0, 2.0, 3.0))


def pendulum(d: Draw) -> Case:
    """A double pendulum that swings against a wall."""
    p = {"m_1": d.positive(0.3, 3), "m_2": d.positive(0.3, 3), "l_1": d.positive(0.3, 1.2), "l_2": d.positive(0.3, 1.2)}
    p |= {"g": 9.81, "d": d(-0.2, 0.9, 0.1), "A": d(0, 12, 0.5), "omega": d(1, 8), "c": d(0, 0.5, 0.5)}
    bounces = d.chance(0.35)
    p |= {"mu": d(0, 0.5, 0.3), "e": d(0.1, 0.9) if bounces else 0.0, "mu_elbow": d(0, 0.5, 0.5)}
    a, b = d(-1.2, 0.5), d(-1.5, 0.5)
    reach = max(p["l_1"] * math.sin(a), p["l_1"] * math.sin(a) + p["l_2"] * math.sin(b))
    if reach >= p["d"]:
        p["d"] = round(reach + d.positive(0.05, 0.4), 3)
    start = {"a": a, "b": b, "a_dot": d(-2, 3, 0.3), "b_dot": d(-2, 3, 0.3)}
    return Case("pendulum", p, start, d.one(1.0, 2.0))


def puck(d: Draw) -> Case:
    """A particle on a rough table between two walls, that is pushed against them, along them and away from them."""
    p = {"m": d.positive(0.3, 3), "g_x": d(-3, 5, 0.4), "g_y": d(-3, 5, 0.4), "g_z": 9.81}
    p |= {"A": d(0, 15, 0.3), "omega": d(1, 8), "B": d(0, 15, 0.4), "nu": d(1, 8)}
    p |= {"a": d(0.0, 0.5, 0.3), "b": d(0.0, 0.5, 0.3), "mu": d(0.1, 1.0), "e": d(0, 0.8, 0.7)}
    start = {"x": d.one(p["a"], p["a"] - 0.25, p["a"] - 0.1), "y": d.one(p["b"], p["b"] - 0.25, p["b"] - 0.1), "z": 0.0}
    start |= {"x_dot": d(-2, 3, 0.3), "y_dot": d(-2, 3, 0.3), "z_dot": 0.0}
    for name, wall in (("x", "a"), ("y", "b")):
        if start[name] == p[wall]:
            start[f"{name}_dot"] = min(start[f"{name}_dot"], 0.0)
    return Case("puck", p, start, d.one(1.0, 2.0))


FAMILIES: dict[str, Callable[[Draw], Case]] = {
    "particle": particle,
    "stack": stack,
    "rod on floor": rod_floor,
    "rod in corner": rod_corner,
    "plate": plate,
    "wheel": wheel,
    "slot": slot,
    "chain": chain,
    "disc": disc,
    "pendulum": pendulum,
    "puck": puck,
}


def drawn(family: str, seed: int) -> Case:
    """Return the case of a seed."""
    return FAMILIES[family](Draw(list(FAMILIES).index(family), seed))
