"""Random scenes from a seed."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from fuzz.dependent import DEPENDENT
from fuzz.description import (
    GROUND,
    ZERO,
    Body,
    Description,
    Distance,
    Equation,
    Force,
    PointCondition,
    Spring,
    Torque,
    Variation,
    number,
)
from fuzz.drawing import Draw
from fuzz.families import FAMILIES
from fuzz.joints import KINDS, Joints
from fuzz.newton_euler import Reference
from fuzz.solving import consistent_position, consistent_rates, solved

__all__ = ["VERSION", "generated"]

VERSION = 2
"""Raised whenever a seed gives another scene."""

MOST = 7
"""Coordinates that a scene has at most, unit quaternions aside."""


def generated(seed: int) -> Description:
    """Return the description of a seed."""
    return _Scene(seed).description()


class _Scene:
    """A scene under construction."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.draw = Draw(seed)
        self.joints = Joints(self.draw)
        self.bodies: list[Body] = []
        self.loads: list[Any] = []
        self.constraints: list[Any] = []
        self.family, self.intent = "tree", "regular"
        self.stops: list[float] = []
        t0 = self.draw.pick(0.0, 0.0, 0.0, 0.0, 0.37, -0.2, 1.5)
        self.span = (t0, round(t0 + self.draw.pick(0.3, 0.4, 0.5, 0.6), 6))

    def description(self) -> Description:
        """Return the finished description."""
        draw = self.draw
        kind = draw.rng.random()
        if kind < 0.4:
            families = DEPENDENT if kind < 0.12 else FAMILIES
            self.family = draw.pick(*families)
            families[self.family](self)
        else:
            self._tree()
            for _ in range(draw.pick(0, 0, 0, 1, 1, 2)):
                self._random_constraint()
        self._keep_reactions()
        self.constraints += self.joints.units
        self._loads()
        if draw.chance(0.08):
            self._spoil()
        gravity = None
        if draw.chance(0.65):
            gravity = draw.axis(0.3)
            size = draw.number(-9.9, -2, "g")
            gravity = tuple(x if x == number(0) else ("mul", size, x) for x in gravity)
        varied = draw.parameter("load", draw.decimal(0.5, 3))
        body = draw.rng.randrange(len(self.bodies))
        self.loads.append(Force(body, ZERO, GROUND, (varied, ("neg", varied), ("mul", number("1/2"), varied))))
        return self._with_start(gravity, varied[1])

    # --- bodies ---

    def _tree(self) -> None:
        draw = self.draw
        names, weights = list(KINDS), [weight for _, weight in KINDS.values()]
        for k in range(draw.pick(1, 1, 1, 2, 2, 2, 2, 3, 3, 4)):
            for _ in range(20):
                kind = draw.rng.choices(names, weights)[0]
                if len(self.joints.coordinates) + KINDS[kind][0] <= MOST + (kind.endswith("quaternion")):
                    break
            else:
                break
            if not self.joints.coordinates and not KINDS[kind][0] and k == 0:
                kind = "driven revolute"
            self.add_body(kind)

    def add_body(self, kind: str, parent: int | None = None, **given: Any) -> int:
        """Hang a body on a parent by a joint of a kind, or by given moves; return its index."""
        draw, k = self.draw, len(self.bodies)
        if parent is None:
            parent = draw.rng.randrange(-1, k) if k else -1
            if k and draw.chance(0.5):
                parent = k - 1
        moves = given.get("moves")
        moves = self.joints.moves(kind) if moves is None else moves
        hinge = given.get("hinge", draw.vector(1.0) if parent >= 0 or draw.chance(0.2) else ZERO)
        point = kind in ("point", "bead") or (kind == "prismatic" and draw.chance(0.3))
        mass, inertia = draw.number(0.4, 3, "m"), None if point else self.inertia()
        if not given and not point:
            if draw.chance(0.05):
                mass = number(0)
            elif draw.chance(0.08):
                inertia = (number(0),) * 6
        centre = ZERO if point or draw.chance(0.3) else draw.vector(0.5, "b")
        body = Body(f"body{k}", parent, hinge, moves, given.get("centre", centre), mass, inertia, kind)
        self.bodies.append(body)
        return k

    def inertia(self) -> Any:
        """Return moments and products of inertia of a real body: of three moments, none above the others' sum."""
        draw = self.draw
        moments = tuple(draw.number(0.3, 0.55, "J") for _ in range(3))
        products = tuple(draw.number(-0.06, 0.06, "D") if draw.chance(0.2) else number(0) for _ in range(3))
        if draw.chance(0.15):
            moments = (moments[0],) * 3
        return (*moments, *products)

    # --- what acts ---

    def variables(self) -> tuple[list[Any], list[Any]]:
        """Return the coordinates and rates that expressions may contain: those of no quaternion."""
        quaternions = {i for body in self.bodies for move in body.moves if move[0] == "quaternion" for i in move[1]}
        free = [i for i in range(len(self.joints.coordinates)) if i not in quaternions]
        return [("q", i) for i in free], [("u", i) for i in free]

    def frame(self, body: int) -> tuple[int, int]:
        """Return the last frame of a body, or the ground's."""
        return GROUND if body < 0 or self.draw.chance(0.4) else (body, -1)

    def _expression(self) -> Any:
        q, u = self.variables()
        if not q:
            return ("mul", self.draw.number(-5, 5, "F"), self.draw.smooth([("t",)]))
        return self.draw.load(q, u)

    def _loads(self) -> None:
        draw = self.draw
        for _ in range(draw.pick(0, 1, 1, 2, 2, 3)):
            k = draw.rng.randrange(len(self.bodies))
            kind = draw.pick("force", "force", "torque", "spring", "pulse")
            at = draw.vector(0.6) if self.bodies[k].inertia is not None else ZERO
            if kind == "spring":
                self._spring(k, at)
                continue
            expression = self._expression()
            if kind == "pulse":
                if not draw.chance(0.5):
                    continue
                expression, stops = draw.pulse(self.span)
                self.stops += stops
            place = draw.rng.randrange(3)
            components: Any = tuple(expression if i == place else number(0) for i in range(3))
            if kind == "torque" and self.bodies[k].inertia is not None:
                self.loads.append(Torque(k, self.frame(k), components))
            else:
                self.loads.append(Force(k, at, self.frame(k), components))

    def _spring(self, k: int, at: Any) -> None:
        draw = self.draw
        other = draw.rng.randrange(-1, len(self.bodies))
        if other == k:
            other = -1
        far = tuple(draw.number(1.5, 3) if i == draw.rng.randrange(3) or i == 0 else number(0) for i in range(3))
        length = draw.number(0.5, 2, "l")
        self.loads.append(Spring(k, at, other, far, draw.number(1, 20, "k"), length, draw.number(0.1, 1, "d")))

    # --- what holds ---

    def _random_constraint(self) -> None:
        draw = self.draw
        q, u = self.variables()
        if len(self.joints.coordinates) - len(self.constraints) - len(self.joints.units) < 2 or not q:
            return
        kind = draw.pick("position", "position", "distance", "velocity", "velocity", "rates", "coordinates")
        k = draw.rng.randrange(len(self.bodies))
        other = draw.rng.randrange(-1, len(self.bodies)) if draw.chance(0.3) else -1
        other = -1 if other == k else other
        at = draw.vector(0.7, zero=0.3) if self.bodies[k].inertia is not None else ZERO
        if kind == "distance":
            self.constraints.append(Distance(k, at, other, draw.vector(1.2, zero=0.3), ("fit",)))
        elif kind == "position":
            direction = draw.axis(0.2)
            value = ("add", ("fit",), draw.smooth_time()) if draw.chance(0.25) else ("fit",)
            reaction = f"X{len(self.constraints)}" if other < 0 and draw.chance(0.5) else ""
            self.constraints.append(
                PointCondition(True, k, at, other, ZERO, GROUND, direction, value, reaction=reaction)
            )
        elif kind == "velocity":
            value = draw.pick(number(0), number(0), draw.number(-0.5, 0.5, "v"), draw.smooth_time())
            reaction = f"X{len(self.constraints)}" if draw.chance(0.5) else ""
            frame = self.frame(k)
            self.constraints.append(
                PointCondition(False, k, at, -1, ZERO, frame, draw.axis(0.2), value, reaction=reaction)
            )
        elif kind == "rates":
            terms = [("mul", draw.pick(draw.number(-1.5, 1.5), draw.smooth(q)), rate) for rate in u[:3]]
            value = draw.pick(number(0), draw.number(-0.5, 0.5), draw.smooth_time())
            self.constraints.append(Equation(False, ("add", *terms, value)))
        elif len(q) > 1:
            a, b = draw.rng.sample(q, 2)
            value = draw.pick(("fit",), ("add", ("fit",), draw.smooth_time()))
            coupling = ("mul", draw.number(-1, 1), draw.smooth([b]))
            self.constraints.append(Equation(True, ("add", a, coupling, ("neg", value))))

    def _keep_reactions(self) -> None:
        """Keep the unknown reactions where every constraint has one: joints must be able to exert them all."""
        if all(getattr(item, "reaction", "") for item in self.constraints):
            return
        kept = [_changed(item, reaction="") if hasattr(item, "reaction") else item for item in self.constraints]
        self.constraints = kept

    def _spoil(self) -> None:
        """Add a constraint that follows from another, or contradicts it, or a coordinate that moves nothing."""
        draw = self.draw
        kind = draw.pick("redundant", "redundant", "contradictory", "massless")
        held = [item for item in self.constraints if isinstance(item, Equation) and not item.unit]
        if kind != "massless" and held:
            item, factor = draw.pick(*held), draw.number(0.3, 3)
            twin = ("mul", factor, item.expression)
            if kind == "contradictory":
                twin = ("add", twin, draw.number(0.1, 0.5))
            self.constraints = [*self.constraints, Equation(item.holonomic, twin)]
            self._keep_reactions()
            self.intent = kind
        elif kind == "massless":
            q = self.joints.coordinate("x")
            moves = (("shift", (q, number(0), number(0))),)
            self.bodies.append(Body(f"body{len(self.bodies)}", -1, ZERO, moves, ZERO, number(0), None, "point"))
            self.intent = kind

    # --- the start ---

    def _with_start(self, gravity: Any, varied: str) -> Description:
        draw, names = self.draw, tuple(self.joints.coordinates)
        q = np.array([draw.rng.uniform(*bounds) for bounds in self.joints.guess])
        for body in self.bodies:
            for move in body.moves:
                if move[0] == "quaternion":
                    q[list(move[1])] /= np.linalg.norm(q[list(move[1])])
        u = np.array([draw.rng.uniform(-1.2, 1.2) for _ in names])
        decimals = draw.chance(0.7)
        if decimals:
            q, u = np.round(q, 2), np.round(u, 2)
        plain = Description(
            self.seed, draw.style, names, dict(draw.parameters), tuple(self.bodies), tuple(self.loads), gravity,
            (), self.span, stops=tuple(self.stops), family=self.family, intent=self.intent,
        )  # fmt: skip
        fitted = tuple(self._fitted(plain, item, q) for item in self.constraints)
        whole = _changed(plain, constraints=fitted)
        used = _parameters_in((whole.bodies, whole.loads, whole.gravity, fitted))
        whole = _changed(whole, parameters={key: value for key, value in draw.parameters.items() if key in used})
        reference = Reference(whole)
        values = {name: np.array([value]) for name, value in whole.parameters.items()}
        t0 = self.span[0]
        with np.errstate(all="ignore"):
            q, left = consistent_position(reference, t0, q, values)
            if np.isfinite(left):
                u, _ = consistent_rates(reference, t0, q, u, values)
        start = dict(zip(names, map(float, q), strict=True))
        start |= {f"{name}_dot": float(rate) for name, rate in zip(names, u, strict=True)}
        out = self._left_out(reference, q, u, values) if draw.chance(0.4) else ()
        declared = any(body.kind.endswith("quaternion") for body in self.bodies) and draw.chance(0.5)
        variation = self._variation(whole, start, varied)
        return _changed(whole, start=start, left_out=out, variation=variation, declared_quaternions=declared)

    def _fitted(self, plain: Description, item: Any, q: Any) -> Any:
        """Return a constraint whose length or offset is a number with which the start nearly satisfies it."""
        trees = {"Distance": "length", "PointCondition": "value", "Equation": "expression"}
        field = trees[type(item).__name__]
        tree = getattr(item, field)
        if not _has(tree, *FITS):
            return item
        draw = self.draw
        probe = _changed(plain, constraints=(_changed(item, **{field: _fill(tree, number(0))}),))
        probe = _changed(probe, parameters=dict(draw.parameters))
        values = {name: np.array([value]) for name, value in probe.parameters.items()}
        state = np.concatenate([q, np.zeros_like(q)])[:, None]
        size = float(Reference(probe).equations(self.span[0], state, values).positions[0, 0])
        if isinstance(item, Distance):
            size = size**0.5
        if _has(tree, ("exact fit",)):
            return _changed(item, **{field: _fill(tree, number(repr(size)))})
        size = round(size, 2) or 0.1
        style = draw.style if draw.style != "mixed" else draw.pick("decimal", "rational", "parameter")
        whole = number(f"{round(size * 100)}/100") if style == "rational" else number(repr(size))
        fit = draw.parameter("L", size) if style == "parameter" else whole
        return _changed(item, **{field: _fill(tree, fit)})

    def _left_out(self, reference: Reference, q: Any, u: Any, values: Any) -> tuple[str, ...]:
        """Return rates that the constraints fix well, given the others."""
        e = reference.equations(self.span[0], np.concatenate([q, u])[:, None], values)
        rows = e.rows[0].copy()
        if not len(rows) or solved(e).rest[0] > 0 or solved(e).rank[0] < len(rows):
            return ()
        names, out = reference.description.coordinates, []
        for i in range(len(rows)):
            j = int(np.argmax(np.abs(rows[i])))
            if abs(rows[i, j]) < 0.3:
                return ()
            out.append(f"{names[j]}_dot")
            rows[i] /= rows[i, j]
            for k in range(len(rows)):
                if k != i:
                    rows[k] -= rows[k, j] * rows[i]
        return tuple(out)

    def _variation(self, whole: Description, start: dict[str, float], varied: str) -> Variation:
        """Return what the sweep varies: a load, or without constraints a value at the start."""
        name, value, far = varied, whole.parameters[varied], 0.2
        if not whole.constraints and self.draw.chance(0.4):
            name = self.draw.pick(*start)
            value = start[name]
        step = far * max(1.0, abs(value))
        return Variation(name, (value - step, value - 1e-4, value, value + 1e-4, value + step))


def _changed(item: Any, **changes: Any) -> Any:
    return replace(item, **changes)


def _parameters_in(part: Any) -> set[str]:
    """Return the names of the parameters that occur in a part of a description."""
    if isinstance(part, tuple):
        if len(part) == 2 and part[0] == "par":
            return {part[1]}
        return set().union(*map(_parameters_in, part))
    if is_dataclass(part):
        return set().union(*(_parameters_in(getattr(part, item.name)) for item in fields(part)))
    return set()


FITS = (("fit",), ("exact fit",))
"""What stands for a number with which the start satisfies a constraint: rounded to cents, or not."""


def _has(tree: Any, *wanted: Any) -> bool:
    return tree in wanted or any(isinstance(item, tuple) and _has(item, *wanted) for item in tree)


def _fill(tree: Any, fit: Any) -> Any:
    """Return a tree with an expression in the place left for it."""
    if tree in FITS:
        return fit
    return tuple(_fill(item, fit) if isinstance(item, tuple) else item for item in tree)
