"""Serial chains of n rods, as `tests/oracles/chain_recursion.py` defines them, and SymPy's way to their equations."""

from __future__ import annotations

from typing import Any

from sympy import symbols
from sympy.physics.mechanics import (
    KanesMethod,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

__all__ = ["CHAINS", "kane_planar_chain", "planar_chain", "spatial_chain"]


def planar_chain(n: int) -> da.Scene:
    """Return the chain of `n` rods whose joints all turn about z, with gravity along -y."""
    return _chain("planar_chain", n, "z", "y")


def spatial_chain(n: int) -> da.Scene:
    """Return the chain of `n` rods whose joints turn about z, y, x in turn, with gravity along -z."""
    return _chain("spatial_chain", n, "zyx", "z")


CHAINS = {"planar": planar_chain, "spatial": spatial_chain}


def _chain(name: str, n: int, axes: str, vertical: str) -> da.Scene:
    frame, joint = ReferenceFrame("N"), Point("O")
    q = dynamicsymbols(f"q0:{n}")
    m, l, *I = (symbols(f"{letter}0:{n}", positive=True) for letter in ("m", "l", "Ix", "Iy", "Iz"))
    scene = da.Scene(name, frame=frame, origin=joint, coordinates=q)
    scene.apply_uniform_gravity(-symbols("g", positive=True) * getattr(frame, vertical))
    for i in range(n):
        link, G = ReferenceFrame(f"E{i + 1}"), Point(f"G{i}")
        link.dcm(link)  # before it is joined to others, among all of which SymPy looks for the way to itself
        link.orient_axis(frame, getattr(frame, axes[i % len(axes)]), q[i])
        frame = link
        central = inertia(frame, *(moments[i] for moments in I))
        scene.add_bodies(RigidBody(f"link{i}", G, frame, m[i], (central, G)))
        G.set_pos(joint, l[i] / 2 * frame.x)  # after the body, for the same reason
        joint = joint.locatenew(f"P{i + 1}", l[i] * frame.x)
    return scene


def kane_planar_chain(n: int) -> Any:
    """Return SymPy's `KanesMethod` of the planar chain of `n` rods, with its equations formed."""
    N, O = ReferenceFrame("N"), Point("O")
    q, u = dynamicsymbols(f"q0:{n}"), dynamicsymbols(f"u0:{n}")
    m, l, Iz = (symbols(f"{letter}0:{n}", positive=True) for letter in ("m", "l", "Iz"))
    g = symbols("g", positive=True)
    O.set_vel(N, 0)
    frame, joint, bodies, loads = N, O, [], []
    for i in range(n):
        link = frame.orientnew(f"E{i + 1}", "Axis", (q[i], frame.z))
        link.set_ang_vel(frame, u[i] * frame.z)
        G = joint.locatenew(f"G{i}", l[i] / 2 * link.x)
        end = joint.locatenew(f"P{i + 1}", l[i] * link.x)
        G.v2pt_theory(joint, N, link)
        end.v2pt_theory(joint, N, link)
        bodies.append(RigidBody(f"link{i}", G, link, m[i], (inertia(link, 0, 0, Iz[i]), G)))
        loads.append((G, -m[i] * g * N.y))
        frame, joint = link, end
    rates = [coordinate.diff() - speed for coordinate, speed in zip(q, u, strict=True)]
    kane = KanesMethod(N, q_ind=q, u_ind=u, kd_eqs=rates)
    kane.kanes_equations(bodies, loads)
    return kane
