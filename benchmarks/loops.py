"""Mechanisms of many closed loops: windows of four bars, nets of particles, tracks and arches.

Each function returns a scene of n parts, values of its parameters, and a start.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sympy import Expr, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

__all__ = ["LOOPS", "arch", "net", "track", "windows"]

Mechanism = tuple[da.Scene, dict[str, float], dict[Any, float]]
m, l, I, g, D = symbols("m l I g D", positive=True)
ROD = {"m": 1.0, "l": 1.0, "I": 1 / 12, "g": 9.81}


def _rod(scene: da.Scene, name: str, frame: ReferenceFrame, centre: Point) -> None:
    scene.add_bodies(RigidBody(name, centre, frame, m, (inertia(frame, 0, 0, I), centre)))


def _at_rest(positions: dict[Any, float]) -> dict[Any, float]:
    return positions | dict.fromkeys((q.diff() for q in positions), 0.0)


def windows(n: int) -> Mechanism:
    """Return n windows of four bars side by side on the ground, in absolute angles of cranks a and couplers b."""
    a, b = dynamicsymbols(f"a0:{n + 1}"), dynamicsymbols(f"b0:{n}")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("windows", frame=N, origin=O, coordinates=[*a, *b])
    scene.apply_uniform_gravity(-g * N.y)
    tips = []
    for i, angle in enumerate(a):
        frame, base = N.orientnew(f"A{i}", "Axis", (angle, N.z)), O.locatenew(f"O{i}", i * l * N.x)
        _rod(scene, f"crank{i}", frame, base.locatenew(f"G{i}", l / 2 * frame.x))
        tips.append(base.locatenew(f"T{i}", l * frame.x))
    for i, angle in enumerate(b):
        frame = N.orientnew(f"B{i}", "Axis", (angle, N.z))
        _rod(scene, f"coupler{i}", frame, tips[i].locatenew(f"H{i}", l / 2 * frame.x))
        end = tips[i].locatenew(f"E{i}", l * frame.x)
        pin = {"parent_point": end, "child_point": tips[i + 1], "axis": N.z}
        scene.add_joints(da.Closure(f"pin{i}", f"coupler{i}", f"crank{i + 1}", "pin", **pin))
    return scene, ROD, _at_rest(dict.fromkeys(a, 1.2) | dict.fromkeys(b, 0.0))


def net(n: int) -> Mechanism:
    """Return n x n particles at the distance l of their neighbours, level and held at two corners."""
    N, O = ReferenceFrame("N"), Point("O")
    places = [(i, j) for i in range(n) for j in range(n)]
    at = {(i, j): dynamicsymbols(f"x{i}_{j} y{i}_{j} z{i}_{j}") for i, j in places}
    scene = da.Scene("net", frame=N, origin=O, coordinates=[q for place in places for q in at[place]])
    scene.apply_uniform_gravity(-g * N.z)
    start: dict[Any, float] = {}
    for i, j in places:
        x, y, z = at[i, j]
        scene.add_bodies(Particle(f"p{i}_{j}", O.locatenew(f"P{i}_{j}", x * N.x + y * N.y + z * N.z), m))
        start |= {x: float(i), y: float(j), z: 0.0}
    for (i, j), there in ((place, at.get(further)) for place in places for further in _neighbours(*place)):
        if there is not None:
            scene.add_holonomic_constraints(_square(at[i, j], there) - l**2)
    scene.add_holonomic_constraints(*at[0, 0], at[0, n - 1][2])
    return scene, {name: ROD[name] for name in ("m", "l", "g")}, _at_rest(start)


def _neighbours(i: int, j: int) -> tuple[tuple[int, int], tuple[int, int]]:
    return (i + 1, j), (i, j + 1)


def _square(a: list[Expr], b: list[Expr]) -> Expr:
    return sum(((x - y) ** 2 for x, y in zip(a, b, strict=True)), 0 * l)


def track(n: int) -> Mechanism:
    """Return the closed chain of n links of a track, each with x, y and an absolute angle, without its wheels."""
    N, O = ReferenceFrame("N"), Point("O")
    x, y, a = (dynamicsymbols(f"{letter}0:{n}") for letter in "xya")
    scene = da.Scene("track", frame=N, origin=O, coordinates=[q for own in zip(x, y, a, strict=True) for q in own])
    scene.apply_uniform_gravity(-g * N.y)
    ends, start = [], {}
    for i in range(n):
        frame, centre = N.orientnew(f"F{i}", "Axis", (a[i], N.z)), O.locatenew(f"G{i}", x[i] * N.x + y[i] * N.y)
        _rod(scene, f"link{i}", frame, centre)
        ends.append([centre.locatenew(f"{side}{i}", sign * l / 2 * frame.x) for side, sign in (("L", -1), ("R", 1))])
        angle, radius = 2 * np.pi * i / n, 0.5 / np.tan(np.pi / n)
        start |= {x[i]: radius * np.cos(angle), y[i]: radius * np.sin(angle), a[i]: angle + np.pi / 2}
    for i in range(n):
        k = (i + 1) % n
        pin = {"parent_point": ends[i][1], "child_point": ends[k][0], "axis": N.z}
        scene.add_joints(da.Closure(f"pin{i}", f"link{i}", f"link{k}", "pin", **pin))
    return scene, ROD, _at_rest(start)


def arch(n: int) -> Mechanism:
    """Return a chain of n rods in relative angles, which turn about one axis, pinned to the ground at its end."""
    N, O = ReferenceFrame("N"), Point("O")
    q = dynamicsymbols(f"q0:{n}")
    scene = da.Scene("arch", frame=N, origin=O, coordinates=q)
    scene.apply_uniform_gravity(-g * N.y)
    frame, joint = N, O
    for i in range(n):
        frame = frame.orientnew(f"E{i}", "Axis", (q[i], frame.z))
        _rod(scene, f"rod{i}", frame, joint.locatenew(f"G{i}", l / 2 * frame.x))
        joint = joint.locatenew(f"P{i}", l * frame.x)
    pin = {"parent_point": O.locatenew("Q", D * N.x), "child_point": joint, "axis": N.z}
    scene.add_joints(da.Closure("pin", None, f"rod{n - 1}", "pin", **pin))
    lean = np.arccos(0.8)
    angles = [-lean if i < n // 2 else lean for i in range(n)]
    return scene, ROD | {"D": 0.8 * n}, _at_rest(dict(zip(q, np.diff(angles, prepend=0.0).tolist(), strict=True)))


LOOPS = {"windows": windows, "net": net, "track": track, "arch": arch}
