"""Scenes whose constraints follow from each other up to the rounding of decimals, as people write them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fuzz.description import GROUND, ZERO, Distance, Equation, PointCondition, number

__all__ = ["DEPENDENT"]

O = number(0)
X, Y, Z = ((number(1), O, O), (O, number(1), O), (O, O, number(1)))


def _pair(draw: Any, low: float, high: float) -> tuple[Any, Any]:
    """Return one number written in two ways: as decimals that rounding may set apart, or as rationals."""
    a, b = round(draw.rng.uniform(low, high), 1) or 0.1, round(draw.rng.uniform(low, high), 1) or 0.2
    if draw.style in ("decimal", "mixed"):
        k = round(draw.rng.uniform(0.1, 0.9), 1)
        return number(repr(a)), number(repr(draw.pick(a + b - b, a * k / k, (a / b) * b)))
    if draw.style == "rational":
        exact = number(f"{round(a * 10)}/10")
        return exact, ("div", ("mul", exact, number(3)), number(3))
    name = draw.parameter("s", a)
    return name, name


def rails(scene: Any) -> None:
    """A plate in the plane that two or three pins hold on one straight rail."""
    draw = scene.draw
    k = scene.add_body("planar", -1, hinge=ZERO)
    first, second = _pair(draw, 0.1, 0.9)
    places = [draw.number(-0.8, -0.2), draw.number(0.2, 0.9), draw.number(1, 2)][: draw.pick(2, 3)]
    height = draw.number(-0.5, 0.5)
    for i, place in enumerate(places):
        level = (first, second, first)[i]
        at = (place, level, O)
        value = ("add", height, level)
        scene.constraints.append(PointCondition(True, k, at, -1, ZERO, GROUND, Y, value))
    scene.intent = "redundant"


def scaled_equations(scene: Any) -> None:
    """Equations between coordinates of which one is a multiple of another, its factors rounded."""
    draw = scene.draw
    k = scene.add_body(draw.pick("planar", "point", "cylindrical", "universal"), -1)
    k = scene.add_body("revolute", k)
    q, u = scene.variables()
    a, b, c, factor = (draw.decimal(0.2, 2) for _ in range(4))
    x, y = draw.rng.sample(range(len(q)), 2)
    holonomic = draw.chance(0.5)
    terms = (q[x], q[y]) if holonomic else (u[x], u[y])

    def equation(*factors: float) -> Equation:
        a, b, c = ((number(repr(f))) for f in factors)
        return Equation(holonomic, ("add", ("mul", a, terms[0]), ("mul", b, terms[1]), c))

    scene.constraints.append(equation(a, -b, -0.1 * c))
    scene.constraints.append(equation(a * factor, -b * factor, -0.1 * c * factor))
    if draw.chance(0.3):
        other = (q if holonomic else u)[draw.rng.randrange(len(q))]
        scene.constraints.append(Equation(holonomic, ("add", other, ("neg", terms[0]))))
    scene.intent = "redundant"


def parallel_bars(scene: Any) -> None:
    """A coupler on one crank and two or three rods, all parallel: one rod would do."""
    draw = scene.draw
    length, again = _pair(draw, 0.6, 1.2)
    spacing, same = _pair(draw, 0.3, 1.5)
    tilt = round(draw.rng.uniform(0.3, 1.2), 2)
    crank = scene.add_body("crank", -1, hinge=ZERO, moves=(("rotate", Z, scene.joints.coordinate("th", tilt, tilt)),))
    turn = (("rotate", Z, scene.joints.coordinate("th", -tilt, -tilt)),)
    coupler = scene.add_body("coupler", crank, hinge=(length, O, O), moves=turn)
    for i in range(draw.pick(2, 3)):
        here, there = ((spacing, same), (("mul", number(2), same), ("mul", number(2), spacing)), (same, same))[i]
        scene.constraints.append(Distance(coupler, (here, O, O), -1, (there, O, O), again))
    scene.intent = "redundant"


def spatial_four_bar(scene: Any) -> None:
    """Links about parallel axes whose end is pinned in space: one of the three conditions says nothing new."""
    draw = scene.draw
    axis = Z if draw.chance(0.4) else draw.axis(1.0)
    last = -1
    for i in range(3):
        hinge = ZERO if i == 0 else (draw.number(0.6, 1.4), draw.number(-0.2, 0.2), O)
        moves = (("rotate", axis, scene.joints.coordinate("th", 0.2 + 0.4 * i, 0.9 + 0.4 * i)),)
        last = scene.add_body("link", last, hinge=hinge, moves=moves)
    end = (draw.number(0.6, 1.4), draw.number(-0.3, 0.3), O)
    for direction in (X, Y, Z):
        scene.constraints.append(PointCondition(True, last, end, -1, ZERO, GROUND, direction, ("exact fit",)))
    scene.intent = "redundant"


def wheels_in_line(scene: Any) -> None:
    """A cart with three or four blades or wheels, of which two would do."""
    draw = scene.draw
    k = scene.add_body("planar", -1, hinge=ZERO)
    first, second = _pair(draw, 0.1, 0.9)
    half = draw.number(0.3, 0.8)
    for i in range(draw.pick(2, 3, 4)):
        at = ((first, second, first, second)[i], ("mul", number(i - 1), half), O)
        scene.constraints.append(PointCondition(False, k, at, -1, ZERO, (k, -1), Y, O))
    scene.intent = "redundant"


DEPENDENT: dict[str, Callable[[Any], None]] = {
    function.__name__: function
    for function in (rails, scaled_equations, parallel_bars, spatial_four_bar, wheels_in_line)
}
"""Name -> function that adds bodies and constraints to a scene under construction."""
