"""Random joints: the moves that lead from a body to the next."""

from __future__ import annotations

from typing import Any

from fuzz.description import Equation, number
from fuzz.drawing import Draw

__all__ = ["KINDS", "Joints"]

Z = (number(0), number(0), number(1))
ZERO = number(0)

KINDS = {
    "revolute": (1, 6),
    "skew revolute": (1, 4),
    "prismatic": (1, 3),
    "universal": (2, 3),
    "cylindrical": (2, 2),
    "screw": (1, 1),
    "planar": (3, 3),
    "angles": (3, 3),
    "quaternion": (4, 3),
    "free angles": (6, 1),
    "free quaternion": (7, 1),
    "point": (3, 2),
    "bead": (1, 2),
    "prescribed rotation": (0, 1),
    "driven revolute": (1, 2),
    "moving support": (1, 2),
    "fixed": (0, 1),
}
"""Name -> coordinates and weight."""


class Joints:
    """Draws joints; keeps the coordinates that they make, and the unit quaternions' constraints."""

    def __init__(self, draw: Draw) -> None:
        self.draw = draw
        self.coordinates: list[str] = []
        self.guess: list[tuple[float, float]] = []
        self.units: list[Equation] = []

    def coordinate(self, wish: str, low: float = -0.9, high: float = 0.9) -> Any:
        """Return a new coordinate with bounds of its value at the start."""
        self.coordinates.append(f"{wish}{len(self.coordinates)}")
        self.guess.append((low, high))
        return ("q", len(self.coordinates) - 1)

    def moves(self, kind: str) -> tuple[Any, ...]:
        """Return the moves of a joint of one of `KINDS`."""
        draw = self.draw
        if kind in ("revolute", "skew revolute"):
            return (("rotate", draw.axis(1.0 if kind != "revolute" else 0.0), self.coordinate("th")),)
        if kind == "prismatic":
            return (self._slide(draw.axis(), self.coordinate("x")), *self._tilt())
        if kind == "universal":
            return self._two_turns()
        if kind == "cylindrical":
            axis = draw.axis(0.0)
            return (("rotate", axis, self.coordinate("th")), self._slide(axis, self.coordinate("x")))
        if kind == "screw":
            axis, q = draw.axis(0.0), self.coordinate("th")
            return (("rotate", axis, q), self._slide(axis, ("mul", draw.number(0.1, 0.5, "h"), q)))
        if kind == "planar":
            shift = ("shift", (self.coordinate("x"), self.coordinate("y"), ZERO))
            return (shift, ("rotate", Z, self.coordinate("th")))
        if kind == "point":
            return self._point()
        if kind == "bead":
            q = self.coordinate("x")
            curve = draw.pick(("pow", q, number(2)), ("sin", ("mul", draw.number(1, 2), q)), ("cosh", q))
            return (("shift", (q, ("mul", draw.number(0.2, 0.8), curve), ZERO)),)
        return self._orienting(kind)

    def _point(self) -> tuple[Any, ...]:
        count = self.draw.pick(2, 3)
        axes = [self.coordinate("x") for _ in range(count)] + [ZERO] * (3 - count)
        return (("shift", tuple(axes)),)

    def _orienting(self, kind: str) -> tuple[Any, ...]:
        draw = self.draw
        if kind.startswith("free"):
            shift = ("shift", tuple(self.coordinate("x") for _ in range(3)))
            return (shift, *self._orienting(kind.removeprefix("free ")))
        if kind == "angles":
            return self._angles()
        if kind == "quaternion":
            e = tuple(self.coordinate("e", 0.2, 0.8)[1] for _ in range(4))
            square = ("add", *(("pow", ("q", i), number(2)) for i in e), number(-1))
            self.units.append(Equation(True, square, unit=True))
            return (("quaternion", e),)
        if kind == "driven revolute":
            q = self.coordinate("th")
            return (("rotate", draw.axis(), ("add", q, draw.smooth_time())),)
        if kind == "prescribed rotation":
            return (("rotate", draw.axis(), draw.smooth_time()),)
        if kind == "moving support":
            shift = tuple(draw.smooth_time() if draw.chance(0.5) else ZERO for _ in range(3))
            return (("shift", shift), ("rotate", draw.axis(), self.coordinate("th")))
        return self._tilt(always=True)

    def _slide(self, axis: Any, q: Any) -> Any:
        return ("shift", tuple(x if x == ZERO else ("mul", x, q) for x in axis))

    def _tilt(self, *, always: bool = False) -> tuple[Any, ...]:
        """Return a fixed rotation by a number, or by a matrix of decimals, or none."""
        draw = self.draw
        if not always and draw.chance(0.6):
            return ()
        if draw.style in ("decimal", "mixed") and draw.chance(0.3):
            c, s = "0.8", "0.6"
            return (("matrix", tuple(map(number, (c, "-" + s, 0, s, c, 0, 0, 0, 1)))),)
        return (("rotate", draw.axis(0.2), draw.number(-1.2, 1.2, "tilt")),)

    def _two_turns(self) -> tuple[Any, ...]:
        first, second = self.draw.rng.sample(range(3), 2)
        axes = [tuple(number(1 if j == i else 0) for j in range(3)) for i in (first, second)]
        return tuple(("rotate", axis, self.coordinate("th")) for axis in axes)

    def _angles(self) -> tuple[Any, ...]:
        """Return three angles in one orientation or in three, away from where they are singular."""
        draw = self.draw
        order = draw.pick("ZXZ", "XYZ", "ZYX", "ZXY", "YXY", "XZX")
        proper = order[0] == order[2]
        first = self.coordinate("th")
        middle = self.coordinate("th", *((0.6, 1.4) if proper else (-0.6, 0.6)))
        third = self.coordinate("th")
        angles = (first, middle, third)
        if draw.chance(0.5):
            return (("angles", draw.pick("Body", "Space"), order, angles),)
        axes = [tuple(number(1 if "XYZ"[j] == letter else 0) for j in range(3)) for letter in order]
        return tuple(("rotate", axis, angle) for axis, angle in zip(axes, angles, strict=True))
