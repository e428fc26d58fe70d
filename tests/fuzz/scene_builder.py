"""The dalembert scene of a description, written with SymPy as a user would."""

from __future__ import annotations

from typing import Any

import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from fuzz.description import ZERO, Description, Distance, Equation, Force, PointCondition, Spring, Torque

__all__ = ["SceneBuilder", "scene_of"]

TIME = dynamicsymbols._t
FUNCTIONS = {
    "abs": sp.Abs,
    "atan2": sp.atan2,
    "ceiling": sp.ceiling,
    "floor": sp.floor,
    "heaviside": sp.Heaviside,
    "max": sp.Max,
    "min": sp.Min,
    "mod": sp.Mod,
    "sign": sp.sign,
    "sqrt": sp.sqrt,
}
LETTERS = {"X": "1", "Y": "2", "Z": "3"}


def scene_of(description: Description) -> Any:
    """Return the scene of a description."""
    return SceneBuilder(description).scene


class SceneBuilder:
    """Builds the scene of a description; `frames` and `points` are those of its bodies."""

    def __init__(self, description: Description) -> None:
        self.description = description
        self.q = [dynamicsymbols(name) for name in description.coordinates]
        self.parameters = {name: sp.Symbol(name, real=True) for name in description.parameters}
        self.N, self.O = ReferenceFrame("N"), Point("O")
        self._count = 0
        declared = self._declared() if description.declared_quaternions else set()
        coordinates = [q for i, q in enumerate(self.q) if i not in declared]
        self.scene = da.Scene(f"fuzz_{description.seed}", frame=self.N, origin=self.O, coordinates=coordinates)
        self.frames: list[list[Any]] = []
        self.points: list[Any] = []
        self.bodies: list[Any] = []
        for k in range(len(description.bodies)):
            self._body(k)
        if description.gravity is not None:
            self.scene.apply_uniform_gravity(self.vector(description.gravity, self.N))
        for item in description.loads:
            self._load(item)
        for item in description.constraints:
            self._constraint(item)

    def _declared(self) -> set[int]:
        moves = [move for body in self.description.bodies for move in body.moves]
        return {i for move in moves if move[0] == "quaternion" for i in move[1]}

    def read(self, tree: Any) -> Any:
        """Return the SymPy expression of a tree."""
        kind = tree[0]
        if kind == "num":
            text = tree[1]
            return sp.Rational(text) if "/" in text or text.lstrip("-").isdigit() else sp.Float(float(text))
        if kind == "par":
            return self.parameters[tree[1]]
        if kind == "t":
            return TIME
        if kind in ("q", "u"):
            return self.q[tree[1]] if kind == "q" else self.q[tree[1]].diff(TIME)
        parts = [self.read(item) for item in tree[1:]]
        if kind == "add":
            return sum(parts[1:], parts[0])
        if kind == "mul":
            return sp.Mul(*parts)
        if kind == "div":
            return parts[0] / parts[1]
        if kind == "neg":
            return -parts[0]
        if kind == "pow":
            return parts[0] ** parts[1]
        if kind == "piecewise":
            return sp.Piecewise((parts[2], parts[0] < parts[1]), (parts[3], True))
        return FUNCTIONS.get(kind, getattr(sp, kind, None))(*parts)

    def vector(self, trees: Any, frame: Any) -> Any:
        """Return the vector with these components on a frame."""
        return sum((self.read(tree) * axis for tree, axis in zip(trees, frame, strict=True)), 0 * frame.x)

    def frame(self, name: tuple[int, int]) -> Any:
        """Return a frame by the pair that names it."""
        return self.N if name[0] < 0 else self.frames[name[0]][name[1]]

    def point(self, body: int, at: Any) -> Any:
        """Return a point of a body, or of the ground."""
        start, frame = (self.O, self.N) if body < 0 else (self.points[body], self.frames[body][-1])
        if at == ZERO:
            return start
        self._count += 1
        return start.locatenew(f"C{self._count}", self.vector(at, frame))

    def _body(self, k: int) -> None:
        body = self.description.bodies[k]
        point = self.point(body.parent, body.hinge)
        frame = self.N if body.parent < 0 else self.frames[body.parent][-1]
        frames = [frame]
        for i, move in enumerate(body.moves):
            if move[0] == "shift":
                point = point.locatenew(f"P{k}_{i}", self.vector(move[1], frame))
            else:
                frame = self._turned(f"S{k}_{i}", frame, move)
            frames.append(frame)
        self.frames.append(frames)
        self.points.append(point)
        centre = point if body.centre == ZERO else point.locatenew(f"G{k}", self.vector(body.centre, frame))
        mass = self.read(body.mass)
        if body.inertia is None:
            made = Particle(body.name, centre, mass)
        else:
            made = RigidBody(body.name, centre, frame, mass, (inertia(frame, *map(self.read, body.inertia)), centre))
        self.bodies.append(made)
        self.scene.add_bodies(made)

    def _turned(self, name: str, frame: Any, move: Any) -> Any:
        """Return a new frame, turned as a move says."""
        kind = move[0]
        if kind == "rotate":
            return frame.orientnew(name, "Axis", (self.read(move[2]), self.vector(move[1], frame)))
        if kind == "angles":
            order = "".join(LETTERS[letter] for letter in move[2])
            return frame.orientnew(name, move[1], tuple(map(self.read, move[3])), order)
        if kind == "matrix":
            entries = sp.Matrix(3, 3, list(map(self.read, move[1])))
            return frame.orientnew(name, "DCM", entries)
        if self.description.declared_quaternions:
            made = ReferenceFrame(name)
            names = [self.description.coordinates[i] for i in move[1]]
            da.free_orientation(self.scene, made, frame, names=names)
            return made
        return frame.orientnew(name, "Quaternion", tuple(self.q[i] for i in move[1]))

    def _load(self, item: Any) -> None:
        if isinstance(item, Torque):
            torque = self.vector(item.components, self.frame(item.frame))
            self.scene.add_loads((self.frames[item.body][-1], torque))
        elif isinstance(item, Force):
            force = self.vector(item.components, self.frame(item.frame))
            self.scene.add_loads((self.point(item.body, item.at), force))
        else:
            assert isinstance(item, Spring)
            self._spring(item)

    def _spring(self, item: Spring) -> None:
        """Add a spring as a load on each end, by vector algebra in the Newtonian frame."""
        P, Q = self.point(item.body, item.at), self.point(item.other, item.other_at)
        away = self._components(P.pos_from(Q))
        distance = sp.sqrt(sum(x**2 for x in away))
        speed = sum(x * x.diff(TIME) for x in away) / distance
        k, length, c = (self.read(tree) for tree in (item.stiffness, item.length, item.damping))
        size = (-k * (distance - length) - c * speed) / distance
        force = sum((size * x * axis for x, axis in zip(away, self.N, strict=True)), 0 * self.N.x)
        self.scene.add_loads((P, force))
        if item.other >= 0:
            self.scene.add_loads((Q, -force))

    def _components(self, vector: Any) -> list[Any]:
        """Return the components of a vector on the Newtonian frame, without simplifying them."""
        total = sp.zeros(3, 1)
        for column, frame in vector.args:
            total += self.N.dcm(frame) * column
        return list(total)

    def _along(self, vector: Any, name: tuple[int, int], direction: Any) -> Any:
        """Return the component of a vector along a direction given on a frame."""
        other = self._components(self.vector(direction, self.frame(name)))
        return sum(a * b for a, b in zip(self._components(vector), other, strict=True))

    def _constraint(self, item: Any) -> None:
        add = self.scene.add_holonomic_constraints
        if isinstance(item, Equation):
            if not item.holonomic:
                add = self.scene.add_nonholonomic_constraints
            elif self.description.declared_quaternions and item.unit:
                return  # `free_orientation` has added it
            add(self.read(item.expression))
            return
        P, Q = self.point(item.body, item.at), self.point(item.other, item.other_at)
        away = P.pos_from(Q)
        if isinstance(item, Distance):
            add(sum(x**2 for x in self._components(away)) - self.read(item.length) ** 2)
            return
        assert isinstance(item, PointCondition)
        direction = self.vector(item.direction, self.frame(item.frame))
        if item.holonomic:
            add(self._along(away, item.frame, item.direction) - self.read(item.value))
        else:
            away = self._components(away)
            speed = sum((x.diff(TIME) * axis for x, axis in zip(away, self.N, strict=True)), 0 * self.N.x)
            if item.arm != ZERO:
                spin = self._spin(self.frames[item.body][-1])
                arm = self._components(self.vector(item.arm, self.frame(item.arm_frame)))
                turning = sp.Matrix(spin).cross(sp.Matrix(arm))
                speed += sum((x * axis for x, axis in zip(turning, self.N, strict=True)), 0 * self.N.x)
            value = self._along(speed, item.frame, item.direction) - self.read(item.value)
            self.scene.add_nonholonomic_constraints(value)
        if item.reaction:
            X = da.unknowns(item.reaction)
            name = self.description.bodies[item.body].name
            self.scene.add_joints(da.Joint(f"joint_{X}", body=name, at=P, force=X * direction))

    def _spin(self, frame: Any) -> list[Any]:
        """Return the angular velocity of a frame on the Newtonian one."""
        if self.description.declared_quaternions or any(
            move[0] in ("quaternion", "matrix") for body in self.description.bodies for move in body.moves
        ):
            R = self.N.dcm(frame)
            W = R.diff(TIME) * R.T
            return [(W[2, 1] - W[1, 2]) / 2, (W[0, 2] - W[2, 0]) / 2, (W[1, 0] - W[0, 1]) / 2]
        return self._components(frame.ang_vel_in(self.N))
