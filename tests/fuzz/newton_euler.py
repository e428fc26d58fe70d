"""The independent reference: Newton-Euler equations of a description, assembled from numbers.

Positions and attitudes are jets along the motion; the accelerations with all second rates zero are the bias, and what
each second rate adds is the Jacobian. The projected Newton and Euler equations and the constraints are solved on the
null space of the constraint Jacobian, by its singular values. Nothing of dalembert is imported.

Arrays carry cases on an axis of their own: M (C, n, n), forces (C, n), constraint rows (C, m, n).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fuzz.description import ZERO, Description, Distance, Equation, Force, PointCondition, Spring, Torque
from fuzz.jets import Jet, Kinks, bilinear, compiled
from fuzz.kinematics import Environment, Pose, Tree, cross, dot, matvec, stacked

__all__ = ["Equations", "Reference", "Solved"]

GROUND_FRAME = np.eye(3)


@dataclass(frozen=True, eq=False)
class Equations:
    """M qdd = forces + rows^T lam, rows qdd + gamma = 0, and what the constraints leave over."""

    M: Any
    forces: Any
    rows: Any
    gamma: Any
    positions: Any
    rates: Any


@dataclass(frozen=True, eq=False)
class Solved:
    """Second rates (C, n), multipliers (C, m), and how well both are determined.

    `rank` (C,) of the scaled rows, `gap` (C,) the smallest singular value that counts, `rest` (C,) the largest that
    does not, `regular` (C,) the reciprocal condition of the mass matrix on the free directions, `scale` (C,) the size
    of the terms that the second rates are made of, `clash` (C,) what contradictory rows leave over.
    """

    qdd: Any
    multipliers: Any
    rank: Any
    gap: Any
    rest: Any
    regular: Any
    scale: Any
    clash: Any


class Reference:
    """The equations of motion of a description, evaluated for several cases side by side."""

    def __init__(self, description: Description) -> None:
        self.description = description
        self.kinks = Kinks()
        self.geometric = Kinks()
        self.tree = Tree(description, self.geometric)
        self.size = len(description.coordinates)
        self._bodies = [
            (self._vector(body.centre), compiled(body.mass, self.kinks), self._inertia(body.inertia))
            for body in description.bodies
        ]
        self._gravity = None if description.gravity is None else self._vector(description.gravity)
        self._loads = [self._load(item) for item in description.loads]
        self._constraints = [self._constraint(item) for item in description.constraints]
        self.holonomic = [item.holonomic for item in description.constraints]

    def _vector(self, trees: Any) -> Callable[[Any], Any]:
        parts = [compiled(tree, self.kinks) for tree in trees]
        return lambda env: stacked([part(env) for part in parts])

    def _inertia(self, trees: Any) -> Callable[[Any], Any] | None:
        if trees is None:
            return None
        six = self._vector(trees)

        def matrix(env: Any) -> Any:
            xx, yy, zz, xy, yz, zx = np.moveaxis(six(env), -1, 0)
            return np.moveaxis(np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]), (0, 1), (-2, -1))

        return matrix

    # --- what acts ---

    def _load(self, item: Any) -> Callable[[Any, list[Pose], list[Any]], Any]:
        """Return a function of (environment, poses, rotation Jacobians) that gives generalised forces (C, n)."""
        if isinstance(item, Spring):
            at, other_at = self._vector(item.at), self._vector(item.other_at)
            k, length, c = (compiled(x, self.kinks) for x in (item.stiffness, item.length, item.damping))

            def spring(env: Any, poses: list[Pose], turning: list[Any]) -> Any:
                P = poses[item.body].point(at(env))
                away = P - (poses[item.other].point(other_at(env)) if item.other >= 0 else other_at(env))
                distance = np.sqrt(dot(away.v, away.v))
                along = away.v / distance[..., None]
                size = -k(env) * (distance - length(env)) - c(env) * dot(away.d, along)
                return _power(away, along * np.asarray(size)[..., None])

            return spring
        components = self._vector(item.components)

        def direct(env: Any, poses: list[Pose]) -> Any:
            frame = _frame(poses, item.frame)
            return matvec(frame.v if isinstance(frame, Jet) else frame, components(env))

        if isinstance(item, Torque):

            def torque(env: Any, poses: list[Pose], turning: list[Any]) -> Any:
                return matvec(turning[item.body], direct(env, poses)) if turning[item.body] is not None else 0.0

            return torque
        assert isinstance(item, Force)
        at = self._vector(item.at)
        return lambda env, poses, turning: _power(poses[item.body].point(at(env)), direct(env, poses))

    # --- what holds ---

    def _constraint(self, item: Any) -> Callable[[Any, list[Pose]], Any]:
        """Return a function of (environment of jets, poses) that gives the residual as a jet."""
        if isinstance(item, Equation):
            return (lambda f: lambda env, poses: f(env))(compiled(item.expression, self.geometric))
        at, other_at = self._vector(item.at), self._vector(item.other_at)

        def apart(env: Any, poses: list[Pose]) -> Any:
            there = poses[item.other].point(other_at(env)) if item.other >= 0 else other_at(env)
            return poses[item.body].point(at(env)) - there

        if isinstance(item, Distance):
            length = compiled(item.length, self.geometric)

            def rod(env: Any, poses: list[Pose]) -> Any:
                away, l = apart(env, poses), length(env)
                return bilinear(dot, away, away) - l * l

            return rod
        assert isinstance(item, PointCondition)
        value = compiled(item.value, self.geometric)
        direction, arm = self._vector(item.direction), self._vector(item.arm)
        rolls = item.arm != ZERO

        def condition(env: Any, poses: list[Pose]) -> Any:
            along = bilinear(matvec, _frame(poses, item.frame), direction(env))
            away = apart(env, poses)
            if item.holonomic:
                return bilinear(dot, away, along) - value(env)
            speed = Jet(away.d, away.dd, None)
            if rolls:
                spin = _angular(poses[item.body].frames[-1])
                reach = bilinear(matvec, _frame(poses, item.arm_frame), arm(env))
                speed = speed + bilinear(cross, spin, reach)
            return bilinear(dot, speed, along) - value(env)

        return condition

    # --- assembly ---

    def _environments(self, t: float, y: Any, parameters: Any, middle: float) -> tuple[Environment, Environment]:
        n = self.size
        q, u = y[:n], y[n:]
        ones = np.zeros((n, n + 1, 1))
        ones[np.arange(n), np.arange(n) + 1] = 1.0
        there = Environment(q, u, middle, parameters)
        plain = Environment(q, u, t, parameters, there)
        jets = Environment(
            [Jet(q[i], u[i], ones[i]) for i in range(n)],
            [Jet(u[i], ones[i], None) for i in range(n)],
            Jet(t, 1.0, 0.0),
            parameters,
            there,
        )
        return plain, jets

    def equations(self, t: float, y: Any, parameters: Any, middle: float | None = None) -> Equations:
        """Return the equations at states y (2 n, C) and parameters {name: (C,)}; `middle` chooses branches of time."""
        n, count = self.size, y.shape[1]
        plain, jets = self._environments(t, y, parameters, t if middle is None else middle)
        poses = self.tree.poses(jets)
        M, forces = np.zeros((count, n, n)), np.zeros((count, n))
        turning: list[Any] = []
        weight = None if self._gravity is None else self._gravity(plain)
        for pose, (centre, mass, inertia) in zip(poses, self._bodies, strict=True):
            J, bias = self._parts(pose.point(centre(plain)))
            m = np.asarray(mass(plain))[..., None]
            M += m[..., None] * (J @ J.swapaxes(-1, -2))
            forces += matvec(J, m * ((0.0 if weight is None else weight) - bias))
            R = pose.frames[-1]
            if not isinstance(R, Jet):
                turning.append(None)
                continue
            W, dW = R.d @ R.v.swapaxes(-1, -2), R.dd @ R.v.swapaxes(-1, -2)
            Jw, wbias = self._parts(Jet(None, None, _axial(dW)))
            turning.append(Jw)
            if inertia is not None:
                I = R.v @ inertia(plain) @ R.v.swapaxes(-1, -2)
                w = _axial(W)
                M += Jw @ I @ Jw.swapaxes(-1, -2)
                forces -= matvec(Jw, matvec(I, wbias) + cross(w, matvec(I, w)))
        for load in self._loads:
            forces += load(plain, poses, turning)
        return self._constrained(jets, poses, M, forces)

    def _parts(self, x: Jet) -> tuple[Any, Any]:
        """Return the Jacobian (C, n, 3) and the bias (C, 3) of a vector's second rate."""
        dd = np.asarray(x.dd)
        if dd.ndim < 3:  # it does not depend on the second rates
            return np.zeros((1, self.size, 3)), dd
        return (dd[1:] - dd[:1]).swapaxes(0, 1), dd[0]

    def _constrained(self, jets: Environment, poses: list[Pose], M: Any, forces: Any) -> Equations:
        count, m = len(M), len(self._constraints)
        rows, gamma = np.zeros((count, m, self.size)), np.zeros((count, m))
        positions, rates = np.zeros((count, m)), np.zeros((count, m))
        for i, (constraint, holonomic) in enumerate(zip(self._constraints, self.holonomic, strict=True)):
            x = constraint(jets, poses)
            if holonomic:
                positions[:, i], rates[:, i] = x.v, x.d
            else:
                rates[:, i] = x.v
            last = np.asarray(x.dd if holonomic else x.d)
            if last.ndim == 2:
                rows[:, i], gamma[:, i] = (last[1:] - last[:1]).T, last[0]
            else:
                gamma[:, i] = last
        return Equations(M, forces, rows, gamma, positions, rates)


def _axial(W: Any) -> Any:
    """Return the vectors of the antisymmetric parts of matrices."""
    return 0.5 * np.stack([W[..., 2, 1] - W[..., 1, 2], W[..., 0, 2] - W[..., 2, 0], W[..., 1, 0] - W[..., 0, 1]], -1)


def _angular(R: Any) -> Any:
    """Return the angular velocity of a frame as a jet of first order."""
    if not isinstance(R, Jet):
        return Jet(np.zeros(3), np.zeros(3), None)
    return Jet(_axial(R.d @ R.v.swapaxes(-1, -2)), _axial(R.dd @ R.v.swapaxes(-1, -2)), None)


def _frame(poses: list[Pose], name: tuple[int, int]) -> Any:
    return GROUND_FRAME if name[0] < 0 else poses[name[0]].frames[name[1]]


def _power(point: Any, force: Any) -> Any:
    """Return the generalised forces (C, n) of a force (C, 3) at a point."""
    dd = np.asarray(point.dd) if isinstance(point, Jet) else np.zeros(1)
    if dd.ndim < 3:
        return 0.0
    return matvec((dd[1:] - dd[:1]).swapaxes(0, 1), force)
