"""Trees of bodies as scenes, and their torques by the recursion of Newton and Euler in plain NumPy.

A tree is a list of links, parents first. Each has one joint, "turn" or "slide" along an axis of its parent's frame, at
a place on the parent; links without mass make joints of several axes.
"""

from dataclasses import dataclass

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

GRAVITY = 9.81


@dataclass(frozen=True)
class Link:
    """A joint and the body behind it; vectors (3,) in the frame of the parent, then in that of the body."""

    parent: int
    kind: str
    axis: int
    place: np.ndarray
    mass: float = 0.0
    centre: np.ndarray | None = None
    moments: np.ndarray | None = None


def links(parents, kinds, seed, *, planar=False):
    """Return links with random places, masses, centres and moments; `kinds` are such as "turn z", "slide x", "ball"."""
    rng, found, last = np.random.default_rng(seed), [], {-1: -1}
    for number, (parent, kind) in enumerate(zip(parents, kinds, strict=True)):
        place = rng.uniform(-0.5, 0.5, 3) + np.array([0.7, 0, 0])
        centre = rng.uniform(-0.3, 0.3, 3)
        if planar:
            place[2] = centre[2] = 0.0
        body = rng.uniform(0.5, 2.0), centre, rng.uniform(0.1, 0.4, 3) + np.array([0.2, 0.2, 0.2])
        parts = {"ball": ["turn z", "turn y", "turn x"]}.get(kind, [kind])
        if kind == "free":
            parts = ["slide x", "slide y", "slide z", "turn z", "turn y", "turn x"]
        base = last[parent]
        for k, part in enumerate(parts):
            what, axis = part.split()
            own = body if k == len(parts) - 1 else ()
            where = place if k == 0 and parent >= 0 else np.zeros(3)
            found.append(Link(base, what, "xyz".index(axis), where, *own))
            base = len(found) - 1
        last[number] = base
    return found


def scene_of(name, tree, *, numbers=True):
    """Return the scene of a tree in its joints' coordinates q0, q1, ..., with gravity along -y; and its parameters."""
    q = dynamicsymbols(f"q0:{len(tree)}")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(name, frame=N, origin=O, coordinates=q)
    g = sp.Symbol("g", positive=True)
    scene.apply_uniform_gravity(-g * N.y)
    values = {"g": GRAVITY}

    def parameter(symbol, value):
        values[symbol] = float(value)
        return sp.Symbol(symbol, real=True)

    def vector(frame, symbol, a):
        parts = [parameter(f"{symbol}{'xyz'[k]}", a[k]) * (frame.x, frame.y, frame.z)[k] for k in range(3) if a[k]]
        return sum(parts, 0 * frame.x)

    frames, points = {-1: N}, {-1: O}
    for i, link in enumerate(tree):
        frame, point = frames[link.parent], points[link.parent]
        if np.any(link.place):
            point = point.locatenew(f"J{i}", vector(frame, f"r{i}", link.place))
        axis = (frame.x, frame.y, frame.z)[link.axis]
        if link.kind == "slide":
            point = point.locatenew(f"S{i}", q[i] * axis)
        else:
            frame = frame.orientnew(f"E{i}", "Axis", (q[i], axis))
        frames[i], points[i] = frame, point
        if link.mass:
            G = point.locatenew(f"G{i}", vector(frame, f"c{i}", link.centre))
            moments = [parameter(f"I{i}{'xyz'[k]}", x) for k, x in enumerate(link.moments)]
            scene.add_bodies(
                RigidBody(f"body{i}", G, frame, parameter(f"m{i}", link.mass), (inertia(frame, *moments), G))
            )
    return scene, values


def torques(tree, q, qdot, qddot, up=1):
    """Return the torques and forces of the joints (n,) that a motion needs, and the sizes of the terms of each (n,).

    Motions may be complex, for derivatives by complex steps; gravity is against the axis `up`.
    """
    n, kind = len(tree), np.result_type(q, qdot, qddot, float)
    turns, axes, places = [], [], []
    omega, alpha, a = np.zeros((3, n + 1, 3), kind)
    rotation = [np.eye(3)] * (n + 1)  # from the frame of a link to that of the scene; the last is the scene's
    a[-1, up] = GRAVITY
    for i, link in enumerate(tree):
        p, axis = link.parent, np.eye(3)[link.axis]
        c, s = np.cos(q[i]), np.sin(q[i])
        turn = np.eye(3, dtype=kind)
        if link.kind == "turn":
            j, k = (link.axis + 1) % 3, (link.axis + 2) % 3
            turn[j, j] = turn[k, k] = c
            turn[k, j], turn[j, k] = s, -s
        rotation[i] = rotation[p] @ turn
        r = link.place + (q[i] * axis if link.kind == "slide" else 0.0)
        w, z = omega[p], alpha[p]
        accelerated = a[p] + np.cross(z, r) + np.cross(w, np.cross(w, r))
        if link.kind == "slide":
            accelerated = accelerated + 2 * qdot[i] * np.cross(w, axis) + qddot[i] * axis
        else:
            z = z + qddot[i] * axis + qdot[i] * np.cross(w, axis)
            w = w + qdot[i] * axis
        omega[i], alpha[i], a[i] = turn.T @ w, turn.T @ z, turn.T @ accelerated
        turns.append(turn)
        axes.append(axis)
        places.append(r)
    force, moment = np.zeros((2, n, 3), kind)
    forces, moments = np.zeros(n), np.zeros(n)
    found, terms = np.zeros(n, kind), np.zeros(n)
    for i in range(n - 1, -1, -1):
        link = tree[i]
        if link.mass:
            c, inertia_ = link.centre, np.diag(link.moments)
            inward = np.cross(alpha[i], c) + np.cross(omega[i], np.cross(omega[i], c))
            f = link.mass * (a[i] + inward)
            t = inertia_ @ alpha[i] + np.cross(omega[i], inertia_ @ omega[i])
            force[i] += f
            moment[i] += t + np.cross(c, f)
            size = link.mass * (np.linalg.norm(a[i]) + np.linalg.norm(inward))
            forces[i] += size
            moments[i] += np.linalg.norm(inertia_ @ alpha[i]) + np.linalg.norm(t) + np.linalg.norm(c) * size
        f, t = turns[i] @ force[i], turns[i] @ moment[i]
        found[i] = axes[i] @ (f if link.kind == "slide" else t)
        terms[i] = forces[i] if link.kind == "slide" else moments[i]
        if link.parent >= 0:
            force[link.parent] += f
            moment[link.parent] += t + np.cross(places[i], f)
            forces[link.parent] += forces[i]
            moments[link.parent] += moments[i] + np.linalg.norm(places[i]) * forces[i]
    return found, terms
