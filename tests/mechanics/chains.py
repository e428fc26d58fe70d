"""Chains of rods with relative joint angles, as `oracles.chain_recursion` describes them."""

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from oracles.chain_recursion import planar_chain, spatial_chain

KINDS = ("planar", "spatial")


def chain(kind, n):
    """Return the scene of a chain of n links; parameters m0.., l0.., inertias and g."""
    q = dynamicsymbols(f"q0:{n}")
    m, l = sp.symbols(f"m0:{n}", positive=True), sp.symbols(f"l0:{n}", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(f"{kind}_chain_{n}", frame=N, origin=O, coordinates=q)
    frame, joint = N, O
    for i in range(n):
        axis = frame.z if kind == "planar" else (frame.z, frame.y, frame.x)[i % 3]
        frame = frame.orientnew(f"E{i + 1}", "Axis", (q[i], axis))
        if kind == "planar":
            moments = 0, 0, sp.Symbol(f"I{i}", positive=True)
        else:
            moments = sp.symbols(f"Ix{i} Iy{i} Iz{i}", positive=True)
        G = joint.locatenew(f"G{i}", l[i] / 2 * frame.x)
        scene.add_bodies(RigidBody(f"link{i}", G, frame, m[i], (inertia(frame, *moments), G)))
        joint = joint.locatenew(f"P{i + 1}", l[i] * frame.x)
    g = sp.Symbol("g", positive=True)
    scene.apply_uniform_gravity(-g * (N.y if kind == "planar" else N.z))
    return scene


def random_parameters(kind, n, rng):
    """Return parameters by name, and the arguments that the recursion takes after the state."""
    masses, lengths = rng.uniform(0.5, 2, n), rng.uniform(0.5, 1.5, n)
    inertias = rng.uniform(0.1, 1, n) if kind == "planar" else rng.uniform(0.1, 1, (n, 3))
    named = {"g": 9.81}
    for i in range(n):
        named |= {f"m{i}": masses[i], f"l{i}": lengths[i]}
        if kind == "planar":
            named[f"I{i}"] = inertias[i]
        else:
            named |= dict(zip((f"Ix{i}", f"Iy{i}", f"Iz{i}"), inertias[i], strict=True))
    return named, (masses, lengths, inertias, 9.81)


def recursion(kind, q, qdot, arguments):
    """Return mass matrix and forcing from explicit body Jacobians."""
    terms = (planar_chain if kind == "planar" else spatial_chain)(np.asarray(q), np.asarray(qdot), *arguments)
    return terms.mass_matrix, terms.forcing
