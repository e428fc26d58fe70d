"""Scenes that people write: wheels, blades, rolling bodies, closed loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fuzz.description import GROUND, ZERO, Body, Distance, Equation, PointCondition, number

__all__ = ["FAMILIES"]

O = number(0)
ONE = number(1)
X, Y, Z = (ONE, O, O), (O, ONE, O), (O, O, ONE)
FIT = ("fit",)


def _in_plane(scene: Any, name: str = "planar") -> int:
    """Add a body that moves in the plane, its reference point the origin of wheels and blades."""
    k: int = scene.add_body(name, -1, hinge=ZERO)
    return k


def _blade(body: int, at: Any, direction: Any, frame: Any, reaction: str = "", value: Any = O) -> PointCondition:
    return PointCondition(False, body, at, -1, ZERO, frame, direction, value, reaction=reaction)


def sleigh(scene: Any) -> None:
    """A sleigh on a knife edge, some with a given slip or an edge that turns in the body."""
    draw = scene.draw
    k = _in_plane(scene)
    at = ZERO if draw.chance(0.5) else (draw.number(-0.6, 0.6), draw.number(-0.6, 0.6), O)
    turn = draw.number(-1, 1, "beta")
    if draw.chance(0.4):
        turn = draw.smooth_time()
    direction = Y if draw.chance(0.6) else (("neg", ("sin", turn)), ("cos", turn), O)
    value = draw.pick(O, O, draw.number(-0.4, 0.4, "slip"), draw.smooth_time())
    scene.constraints.append(_blade(k, at, direction, (k, -1), "X", value))


def axle(scene: Any) -> None:
    """A cart whose two wheels stand on one axle: one of the two conditions follows from the other."""
    draw = scene.draw
    k = _in_plane(scene)
    reach, half = draw.number(0.1, 0.6), draw.number(0.3, 0.8)
    same = draw.pick(reach, ("add", ("mul", number("0.5"), reach), ("mul", number("0.5"), reach)))
    scene.constraints.append(_blade(k, (reach, half, O), Y, (k, -1)))
    scene.constraints.append(_blade(k, (same, ("neg", half), O), Y, (k, -1)))
    scene.intent = "redundant"
    if draw.chance(0.3):  # two axles at an angle that hold it fast, but for a turn about the meeting point
        angle = draw.number(0.4, 1.2)
        direction = (("sin", angle), ("cos", angle), O)
        scene.constraints[-1] = _blade(k, (("neg", reach), half, O), direction, (k, -1))
        scene.intent = "regular"


def steered(scene: Any) -> None:
    """A bicycle in the plane: a body on a rear wheel, with a fork that is steered or free."""
    draw = scene.draw
    k = _in_plane(scene)
    angle = draw.smooth_time() if draw.chance(0.4) else scene.joints.coordinate("steer", -0.5, 0.5)
    base = (draw.number(0.6, 1.4, "base"), O, O)
    fork = scene.add_body("fork", k, hinge=base, moves=(("rotate", Z, angle),))
    scene.constraints.append(_blade(k, ZERO, Y, (k, -1), "Y_rear"))
    scene.constraints.append(_blade(fork, ZERO, Y, (fork, -1)))


def differential_drive(scene: Any) -> None:
    """A cart on two wheels that roll, each an axis of its own."""
    draw = scene.draw
    k = _in_plane(scene)
    half, r = draw.number(0.2, 0.6, "w"), draw.number(0.1, 0.4, "r")
    for side in (1, -1):
        hinge = (O, half if side > 0 else ("neg", half), O)
        wheel = scene.add_body(
            "wheel", k, hinge=hinge, moves=(("rotate", Y, scene.joints.coordinate("ph")),), centre=ZERO
        )
        condition = PointCondition(False, wheel, ZERO, -1, ZERO, (k, -1), X, O, (O, O, ("neg", r)), (k, -1))
        scene.constraints.append(condition)
    scene.constraints.append(_blade(k, ZERO, Y, (k, -1)))


def _attitude(scene: Any) -> Any:
    """Return the moves of a free attitude."""
    return scene.joints.moves("quaternion" if scene.draw.chance(0.5) else "angles")


def sphere(scene: Any) -> None:
    """A sphere that rolls on a plane, some on a turntable or with its centre of mass aside."""
    draw = scene.draw
    r = draw.number(0.3, 1, "r")
    shift = ("shift", (scene.joints.coordinate("x"), scene.joints.coordinate("y"), r))
    centre = ZERO if draw.chance(0.6) else draw.vector(0.2, "b", 0.3)
    k = scene.add_body("sphere", -1, hinge=ZERO, moves=(shift, *_attitude(scene)), centre=centre)
    table = draw.number(0.3, 2, "Omega") if draw.chance(0.3) else O
    x, y = shift[1][:2]
    values = (O, O) if table == O else (("neg", ("mul", table, y)), ("mul", table, x))
    for direction, value in zip((X, Y), values, strict=True):
        item = PointCondition(False, k, ZERO, -1, ZERO, GROUND, direction, value, (O, O, ("neg", r)))
        scene.constraints.append(item)


def disk(scene: Any) -> None:
    """A disk that rolls on a plane; its height is a coordinate that a constraint fixes, or follows from the lean."""
    draw = scene.draw
    r = draw.number(0.3, 1, "r")
    x, y = scene.joints.coordinate("x"), scene.joints.coordinate("y")
    yaw, lean, spin = (scene.joints.coordinate("th", *b) for b in ((-0.9, 0.9), (-0.6, 0.6), (-0.9, 0.9)))
    height: Any = ("mul", r, ("cos", lean))
    free = draw.chance(0.4)
    z = scene.joints.coordinate("z", 0.3, 0.8) if free else height
    turns = (("rotate", Z, yaw), ("rotate", X, lean), ("rotate", Y, spin))
    k = scene.add_body("disk", -1, hinge=ZERO, moves=(("shift", (x, y, z)), *turns), centre=ZERO)
    if free:
        scene.constraints.append(Equation(True, ("add", z, ("neg", height))))
    for direction in (X, Y):
        item = PointCondition(False, k, ZERO, -1, ZERO, GROUND, direction, O, (O, O, ("neg", r)), (k, 3))
        scene.constraints.append(item)


def four_bar(scene: Any) -> None:
    """Links about parallel axes whose end is pinned, by two conditions or by a rod."""
    draw = scene.draw
    last = -1
    for i in range(draw.pick(2, 3)):
        hinge = ZERO if i == 0 else (draw.number(0.6, 1.4, "l"), O, O)
        moves = (("rotate", Z, scene.joints.coordinate("th", 0.2 + 0.4 * i, 0.9 + 0.4 * i)),)
        last = scene.add_body("link", last, hinge=hinge, moves=moves, centre=(draw.number(0.2, 0.6, "b"), O, O))
    end = (draw.number(0.6, 1.4, "l"), O, O)
    if last == 2 and draw.chance(0.6):
        for i, direction in enumerate((X, Y)):
            scene.constraints.append(
                PointCondition(True, last, end, -1, ZERO, GROUND, direction, FIT, reaction=f"R{i}")
            )
    else:
        scene.constraints.append(Distance(last, end, -1, (draw.number(1.5, 2.5), draw.number(-0.5, 0.5), O), FIT))


def slider_crank(scene: Any) -> None:
    """A crank, a rod and a slider on a line; or the rod's end held on the line."""
    draw = scene.draw
    crank = scene.add_body("crank", -1, hinge=ZERO, moves=(("rotate", Z, scene.joints.coordinate("th", 0.3, 1.0)),))
    hinge = (draw.number(0.4, 0.8, "l"), O, O)
    rod = scene.add_body("rod", crank, hinge=hinge, moves=(("rotate", Z, scene.joints.coordinate("th", -1.4, -0.6)),))
    end = (draw.number(1.0, 1.6, "l"), O, O)
    scene.constraints.append(PointCondition(True, rod, end, -1, ZERO, GROUND, Y, FIT, reaction="R"))
    if draw.chance(0.4):
        slider = scene.add_body(
            "slider", -1, hinge=ZERO, moves=(("shift", (scene.joints.coordinate("x", 0.8, 1.6), O, O)),)
        )
        scene.constraints.append(PointCondition(True, rod, end, slider, ZERO, GROUND, X, FIT))


def redundant_particle(scene: Any) -> None:
    """A particle in Cartesian coordinates on a sphere or rod, or a pendulum in too many coordinates."""
    draw = scene.draw
    k = scene.add_body("point", -1, hinge=ZERO)
    scene.constraints.append(Distance(k, ZERO, -1, ZERO, FIT))
    if draw.chance(0.5):
        second = scene.add_body("point", -1, hinge=ZERO)
        scene.constraints.append(Distance(second, ZERO, k, ZERO, FIT))


def coupled_particle(scene: Any) -> None:
    """A mass at (x + L cos th, y + L sin th): more coordinates than it moves in, one of them held."""
    draw = scene.draw
    x, y, th = (scene.joints.coordinate(name) for name in ("x", "y", "th"))
    L = draw.number(0.5, 1, "L")
    moves = (("shift", (("add", x, ("mul", L, ("cos", th))), ("add", y, ("mul", L, ("sin", th))), O)),)
    mass = draw.number(0.5, 2, "m")
    scene.bodies.append(Body("body0", -1, ZERO, moves, ZERO, mass, None, "point"))
    if draw.chance(0.7):
        other = draw.pick(y, th)
        value = ("sin", ("add", other, draw.number(-0.5, 0.5)))
        scene.constraints.append(Equation(True, ("add", x, ("neg", value))))


FAMILIES: dict[str, Callable[[Any], None]] = {
    function.__name__: function
    for function in (
        sleigh,
        axle,
        steered,
        differential_drive,
        sphere,
        disk,
        four_bar,
        slider_crank,
        redundant_particle,
        coupled_particle,
    )
}
"""Name -> function that adds bodies and constraints to a scene under construction."""
