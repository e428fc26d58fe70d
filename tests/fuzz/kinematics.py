"""Positions and attitudes of the bodies of a description as jets: rotations composed as matrices of numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from fuzz.description import Description
from fuzz.jets import Jet, Kinks, bilinear, compiled

__all__ = ["Environment", "Pose", "Tree", "cross", "dot", "matvec", "stacked"]

AXES = np.eye(3)


class Environment:
    """What expressions are evaluated on."""

    __slots__ = ("middle", "parameters", "q", "t", "u")

    def __init__(self, q: Any, u: Any, t: Any, parameters: Any, middle: Environment | None = None) -> None:
        self.q, self.u, self.t, self.parameters = q, u, t, parameters
        self.middle = self if middle is None else middle


def matvec(a: Any, b: Any) -> Any:
    """Return the product of matrices (..., 3, 3) and vectors (..., 3)."""
    return (a @ b[..., None])[..., 0]


def dot(a: Any, b: Any) -> Any:
    """Return the scalar product of vectors (..., 3)."""
    return (a * b).sum(-1)


def cross(a: Any, b: Any) -> Any:
    """Return the vector product of vectors (..., 3)."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def _join(items: list[Any]) -> Any:
    shape = np.broadcast_shapes(*(np.shape(item) for item in items))
    out = np.empty((*shape, len(items)))
    for i, item in enumerate(items):
        out[..., i] = item
    return out


def stacked(items: list[Any]) -> Any:
    """Return scalars, some of them jets, as a vector (..., k)."""
    if not any(isinstance(item, Jet) for item in items):
        return _join(items)
    jets = [item if isinstance(item, Jet) else Jet(item, 0.0, 0.0) for item in items]
    known = all(jet.dd is not None for jet in jets)
    dd = _join([jet.dd for jet in jets]) if known else None
    return Jet(_join([jet.v for jet in jets]), _join([jet.d for jet in jets]), dd)


def skew(a: Any) -> Any:
    """Return the matrix of the vector product with a vector (3,)."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]], dtype=float)


def _wide(a: Any) -> Any:
    return np.asarray(a, dtype=float)[..., None, None]


def rotation(axis: Any, angle: Any) -> Any:
    """Return the rotation by an angle about an axis (3,)."""
    K = skew(axis / np.sqrt(axis @ axis))
    KK = K @ K
    x = angle.v if isinstance(angle, Jet) else angle
    s, c = _wide(np.sin(x)), _wide(np.cos(x))
    value = np.eye(3) + s * K + (1 - c) * KK
    if not isinstance(angle, Jet):
        return value
    first, second, d = c * K + s * KK, c * KK - s * K, _wide(angle.d)
    return Jet(value, first * d, second * d**2 + first * _wide(angle.dd))


def from_quaternion(e: Any) -> Any:
    """Return (e0^2 - e.e) 1 + 2 e e^T + 2 e0 [e]x, from components on the body to components on its parent."""
    parts = [[e[0] * e[0] - e[1] * e[1] - e[2] * e[2] - e[3] * e[3] for _ in range(3)] for _ in range(3)]
    sign = {(0, 1): (-1, 3), (1, 0): (1, 3), (0, 2): (1, 2), (2, 0): (-1, 2), (1, 2): (-1, 1), (2, 1): (1, 1)}
    for i in range(3):
        for j in range(3):
            outer = 2 * (e[i + 1] * e[j + 1])
            if i == j:
                parts[i][j] = parts[i][j] + outer
            else:
                s, k = sign[i, j]
                parts[i][j] = outer + (2 * s) * (e[0] * e[k])
    return stacked_matrix(parts)


def stacked_matrix(parts: list[list[Any]]) -> Any:
    """Return nine scalars as a matrix (..., 3, 3)."""
    flat = stacked([item for row in parts for item in row])
    if isinstance(flat, Jet):
        return Jet(*(None if x is None else x.reshape(*x.shape[:-1], 3, 3) for x in (flat.v, flat.d, flat.dd)))
    return flat.reshape(*flat.shape[:-1], 3, 3)


class Tree:
    """The compiled joints of a description."""

    def __init__(self, description: Description, kinks: Kinks) -> None:
        def vector(trees: Any) -> Any:
            parts = [compiled(tree, kinks) for tree in trees]
            return lambda env: stacked([part(env) for part in parts])

        self.parents = [body.parent for body in description.bodies]
        self.hinges = [vector(body.hinge) for body in description.bodies]
        self.moves = []
        for body in description.bodies:
            steps: list[tuple[str, Any]] = []
            for move in body.moves:
                kind, *rest = move
                if kind == "rotate":
                    axis = np.array([float(compiled(item, kinks)(None)) for item in rest[0]])
                    steps.append(("rotate", (axis, compiled(rest[1], kinks))))
                elif kind == "shift":
                    steps.append(("shift", vector(rest[0])))
                elif kind == "quaternion":
                    steps.append(("quaternion", rest[0]))
                elif kind == "angles":
                    steps.append(("angles", (rest[0], rest[1], [compiled(item, kinks) for item in rest[2]])))
                else:
                    entries = [float(compiled(item, kinks)(None)) for item in rest[0]]
                    steps.append(("matrix", np.array(entries).reshape(3, 3)))
            self.moves.append(steps)

    def poses(self, env: Environment) -> list[Pose]:
        """Return the pose of every body."""
        poses: list[Pose] = []
        for parent, hinge, moves in zip(self.parents, self.hinges, self.moves, strict=True):
            R: Any = np.eye(3) if parent < 0 else poses[parent].frames[-1]
            p: Any = hinge(env)
            if parent >= 0:
                p = poses[parent].origin + bilinear(matvec, R, p)
            frames = [R]
            for kind, data in moves:
                if kind == "shift":
                    p = p + bilinear(matvec, R, data(env))
                else:
                    R = bilinear(np.matmul, R, _turn(kind, data, env))
                frames.append(R)
            poses.append(Pose(p, frames))
        return poses


def _turn(kind: str, data: Any, env: Environment) -> Any:
    """Return the rotation of one move."""
    if kind == "rotate":
        return rotation(data[0], data[1](env))
    if kind == "quaternion":
        return from_quaternion([env.q[i] for i in data])
    if kind == "matrix":
        return data
    way, order, angles = data
    turns = [rotation(AXES["XYZ".index(letter)], angle(env)) for letter, angle in zip(order, angles, strict=True)]
    if way == "Space":  # about axes that stay: each further rotation is applied in front
        turns.reverse()
    return bilinear(np.matmul, bilinear(np.matmul, turns[0], turns[1]), turns[2])


class Pose:
    """The reference point of a body, and its frame after each move of its joint."""

    __slots__ = ("frames", "origin")

    def __init__(self, origin: Any, frames: list[Any]) -> None:
        self.origin, self.frames = origin, frames

    def point(self, at: Any) -> Any:
        """Return the position of a point given in the body's frame."""
        p = self.origin + bilinear(matvec, self.frames[-1], at)
        return p if isinstance(p, Jet) else Jet(p, np.zeros(3), np.zeros(3))
