"""A rolling sphere with three unequal moments of inertia: the scene, and its equations reduced by hand."""

from __future__ import annotations

from typing import Any

from sympy import symbols
from sympy.physics.mechanics import RigidBody, inertia

import dalembert as da

__all__ = ["INITIAL", "PARAMETERS", "hand_written", "hand_written_start", "unequal_sphere"]

PARAMETERS = {"m": 1.3, "r": 0.5, "g": 9.81, "J_1": 0.10, "J_2": 0.14, "J_3": 0.19}
INITIAL = {"x": 0.0, "y": 0.0, "psi": 0.4, "theta": 1.1, "phi": -0.3, "psi_dot": 0.3, "theta_dot": 0.2, "phi_dot": 0.9}


def unequal_sphere() -> da.Scene:
    """Return the ready scene of the rolling sphere with moments J_1, J_2, J_3 about its centre."""
    scene = da.scenes.rolling_sphere()
    body = scene.bodies[0]
    J_1, J_2, J_3 = symbols("J_1 J_2 J_3", positive=True)
    frame, centre = body.frame, body.masscenter
    heavier = da.Scene("unequal_sphere", frame=scene.frame, origin=scene.origin, coordinates=scene.coordinates)
    heavier.add_bodies(RigidBody("sphere", centre, frame, body.mass, (inertia(frame, J_1, J_2, J_3), centre)))
    heavier.apply_uniform_gravity(-symbols("g", positive=True) * scene.frame.z)
    heavier.add_nonholonomic_constraints(*scene.nonholonomic_constraints)
    return heavier


def hand_written(y: Any, p: Any, np: Any) -> Any:
    """Return the rates of (x, y, psi, theta, phi, omega along the body's axes) at p = (m r^2, r, J_1, J_2, J_3).

    With k the vertical along the body's axes, (J + m r^2 (1 - k k^T)) omega_dot = -omega x J omega: the moment of the
    friction about the centre is -r k x m r (omega_dot x k). The matrix is solved
    by the formula of Sherman and Morrison.
    """
    _, _, psi, theta, phi, o1, o2, o3 = y
    mr2, r, j1, j2, j3 = p
    st, ct, sp, cp = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    k1, k2, k3 = st * sp, st * cp, ct
    v1, v2, v3 = (j2 - j3) * o2 * o3, (j3 - j1) * o3 * o1, (j1 - j2) * o1 * o2
    d1, d2, d3 = 1.0 / (j1 + mr2), 1.0 / (j2 + mr2), 1.0 / (j3 + mr2)
    share = mr2 * (k1 * d1 * v1 + k2 * d2 * v2 + k3 * d3 * v3)
    share = share / (1.0 - mr2 * (k1 * k1 * d1 + k2 * k2 * d2 + k3 * k3 * d3))
    psi_dot = (o1 * sp + o2 * cp) / st
    theta_dot = o1 * cp - o2 * sp
    phi_dot = o3 - psi_dot * ct
    x_dot = r * (theta_dot * np.sin(psi) - phi_dot * st * np.cos(psi))
    y_dot = -r * (theta_dot * np.cos(psi) + phi_dot * st * np.sin(psi))
    rates = (d1 * (v1 + k1 * share), d2 * (v2 + k2 * share), d3 * (v3 + k3 * share))
    return x_dot, y_dot, psi_dot, theta_dot, phi_dot, *rates


def hand_written_start(np: Any) -> Any:
    """Return the state of `hand_written` at `INITIAL`."""
    angles = [INITIAL[name] for name in ("x", "y", "psi", "theta", "phi")]
    theta, phi = INITIAL["theta"], INITIAL["phi"]
    psi_dot, theta_dot, phi_dot = (INITIAL[f"{name}_dot"] for name in ("psi", "theta", "phi"))
    sine = np.sin(theta)
    omega = (
        psi_dot * sine * np.sin(phi) + theta_dot * np.cos(phi),
        psi_dot * sine * np.cos(phi) - theta_dot * np.sin(phi),
        psi_dot * np.cos(theta) + phi_dot,
    )
    return np.array([*angles, *omega])
