"""Mass matrix and forcing of serial chains of n rods at a numerical state, from explicit body Jacobians.

Conventions, with links and joints numbered 0 to n - 1:

- Frame E_0 is N. Joint i turns E_i into E_(i+1) by the relative angle q_i about one of the axes of E_i, which
  is the same vector in E_(i+1). Joint 0 is at the origin O.
- Link i is a rod of length l_i that is fixed in E_(i+1), along its x axis. It starts at joint i; its mass
  centre is at l_i/2, joint i + 1 at l_i.
- ``planar_chain``: every joint turns about z; gravity is -g N.y; `inertias` holds I_i, the moment about z
  through the mass centre. At q = 0 the chain lies along N.x, horizontal; it hangs at q = (-pi/2, 0, 0, ...).
- ``spatial_chain``: joint i turns about z, y, x, z, y, x, ... for i = 0, 1, 2, 3, ...; gravity is -g N.z;
  `inertias` holds (Ix, Iy, Iz), the principal moments of link i along the axes of E_(i+1), through the mass
  centre. At q = 0 the chain lies along N.x, horizontal.

In SymPy the same chain reads (the planar one with the axis always z)::

    frame, joint = N, O
    for i in range(n):
        axis = (frame.z, frame.y, frame.x)[i % 3]
        frame = frame.orientnew(f"E{i + 1}", "Axis", (q[i], axis))
        G = joint.locatenew(f"G{i}", l[i] / 2 * frame.x)
        scene.add_bodies(RigidBody(f"link{i}", G, frame, m[i], (inertia(frame, Ix[i], Iy[i], Iz[i]), G)))
        joint = joint.locatenew(f"P{i + 1}", l[i] * frame.x)

The equations are ``M(q) qddot = forcing(q, qdot)``. Each body's Jacobian has the columns
``a_j x (r_G - r_j)`` and ``a_j`` for the joints j up to its own, so M is a plain sum over bodies; the forcing
projects gravity less the accelerations at qddot = 0, propagated from link to link, on the same columns.
Complex states are accepted, for derivatives by the complex step.
"""

from typing import NamedTuple

import numpy as np

PLANAR_AXES = (2,)
SPATIAL_AXES = (2, 1, 0)


class ChainTerms(NamedTuple):
    """Mass matrix of shape (n, n) and forcing of shape (n,)."""

    mass_matrix: np.ndarray
    forcing: np.ndarray


class Geometry(NamedTuple):
    """Where a chain is: one row per link, in components along N.

    Attributes
    ----------
    axes : ndarray, shape (n, 3)
        Unit vectors a_i of the joints.
    joints : ndarray, shape (n, 3)
        Positions r_i of the joints.
    centres : ndarray, shape (n, 3)
        Positions of the mass centres.
    rotations : ndarray, shape (n, 3, 3)
        Columns are the axes of the links.
    """

    axes: np.ndarray
    joints: np.ndarray
    centres: np.ndarray
    rotations: np.ndarray


def planar_chain(q, qdot, masses, lengths, inertias, g) -> ChainTerms:
    """Return the terms of the planar chain; every argument but the scalar `g` has shape (n,)."""
    gravity = np.array([0.0, -g, 0.0])
    return _terms(PLANAR_AXES, q, qdot, masses, lengths, _planar_inertias(inertias), gravity)


def spatial_chain(q, qdot, masses, lengths, inertias, g) -> ChainTerms:
    """Return the terms of the spatial chain; `inertias` has shape (n, 3), the others are as in the plane."""
    return _terms(SPATIAL_AXES, q, qdot, masses, lengths, np.asarray(inertias), np.array([0.0, 0.0, -g]))


def planar_energies(q, qdot, masses, lengths, inertias, g):
    """Return the kinetic and the potential energy (zero at the height of O) of the planar chain."""
    gravity = np.array([0.0, -g, 0.0])
    return _energies(PLANAR_AXES, q, qdot, masses, lengths, _planar_inertias(inertias), gravity)


def spatial_energies(q, qdot, masses, lengths, inertias, g):
    """Return the kinetic and the potential energy (zero at the height of O) of the spatial chain."""
    return _energies(SPATIAL_AXES, q, qdot, masses, lengths, np.asarray(inertias), np.array([0.0, 0.0, -g]))


def _planar_inertias(inertias) -> np.ndarray:
    rows = np.zeros((len(inertias), 3))
    rows[:, 2] = inertias
    return rows


def _geometry(pattern, q, lengths) -> Geometry:
    axes, joints, centres, rotations = [], [], [], []
    rotation, joint = np.eye(3), np.zeros(3)
    for i, (angle, length) in enumerate(zip(q, lengths, strict=True)):
        index = pattern[i % len(pattern)]
        axes.append(rotation[:, index])
        joints.append(joint)
        rotation = rotation @ _elementary_rotation(index, angle)
        rotations.append(rotation)
        centres.append(joint + length / 2 * rotation[:, 0])
        joint = joint + length * rotation[:, 0]
    return Geometry(np.array(axes), np.array(joints), np.array(centres), np.array(rotations))


def _elementary_rotation(index, angle) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    after, last = (index + 1) % 3, (index + 2) % 3
    rotation = np.eye(3, dtype=np.result_type(angle, float))
    rotation[after, after] = rotation[last, last] = c
    rotation[last, after], rotation[after, last] = s, -s
    return rotation


def _terms(pattern, q, qdot, masses, lengths, inertias, gravity) -> ChainTerms:
    chain = _geometry(pattern, q, lengths)
    n = len(q)
    dtype = np.result_type(np.asarray(q), np.asarray(qdot), float)
    M, forcing = np.zeros((n, n), dtype), np.zeros(n, dtype)
    omega = alpha = acceleration = np.zeros(3)  # of the link before, and of the joint it ends in
    for k in range(n):
        alpha = alpha + np.cross(omega, chain.axes[k]) * qdot[k]
        omega = omega + chain.axes[k] * qdot[k]

        J_v, J_omega = np.zeros((3, n), dtype), np.zeros((3, n), dtype)
        for j in range(k + 1):
            J_v[:, j] = np.cross(chain.axes[j], chain.centres[k] - chain.joints[j])
            J_omega[:, j] = chain.axes[j]
        inertia = chain.rotations[k] @ np.diag(inertias[k]) @ chain.rotations[k].T
        M += masses[k] * J_v.T @ J_v + J_omega.T @ inertia @ J_omega

        arm = chain.centres[k] - chain.joints[k]
        force = masses[k] * (gravity - acceleration - _carried(alpha, omega, arm))
        torque = -inertia @ alpha - np.cross(omega, inertia @ omega)
        forcing += J_v.T @ force + J_omega.T @ torque
        acceleration = acceleration + _carried(alpha, omega, 2 * arm)
    return ChainTerms(M, forcing)


def _carried(alpha, omega, arm) -> np.ndarray:
    """Return the acceleration of a point of a link relative to another one, `arm` away."""
    return np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))


def _energies(pattern, q, qdot, masses, lengths, inertias, gravity):
    chain = _geometry(pattern, q, lengths)
    omega = velocity = np.zeros(3)
    kinetic = potential = 0.0
    for k in range(len(q)):
        omega = omega + chain.axes[k] * qdot[k]
        arm = chain.centres[k] - chain.joints[k]
        v_G = velocity + np.cross(omega, arm)
        local = chain.rotations[k].T @ omega
        kinetic += (masses[k] * v_G @ v_G + local @ (inertias[k] * local)) / 2
        potential -= masses[k] * gravity @ chain.centres[k]
        velocity = velocity + np.cross(omega, 2 * arm)
    return kinetic, potential
