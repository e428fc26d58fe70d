"""What is simulated: five scenes, each with the best equations that a person would reduce by hand, for peers.

Sleigh and sphere have closed forms; the sleigh on a torsion spring, the sphere with three unequal moments and the
double pendulum are measured against references in extended precision (`extended`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from exact import END, SLEIGH, SPHERE, Case, spatial_angular_velocity
from extended import FILE
from numpy.typing import NDArray
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

__all__ = ["END", "EXTENDED", "PROBLEMS", "Problem", "Reduced"]

FloatArray = NDArray[np.float64]
Functions = tuple[Callable[[Any], Any], Callable[[Any], Any]]


@dataclass(frozen=True, eq=False)
class Reduced:
    """Equations in independent speeds, or fewer unknowns still.

    Attributes
    ----------
    rhs : callable
        (y, p, (sin, cos)) -> rates of the state, for numbers, arrays and expressions of other libraries.
    parameters : tuple of float
        What it takes for p.
    start : ndarray (n_y,)
    to_scene : callable
        State -> (q, q_dot).
    """

    rhs: Callable[[Any, Any, Functions], Sequence[Any]]
    parameters: tuple[float, ...]
    start: FloatArray
    to_scene: Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class Problem:
    """A motion from time 0 to `END`; `end` gives the exact (q, q_dot) there."""

    name: str
    build: Callable[[], da.Scene]
    parameters: Mapping[str, float]
    initial: Mapping[str, float]
    reduced: Reduced
    end: Callable[[], tuple[FloatArray, FloatArray]]

    def error(self, q: FloatArray, qdot: FloatArray) -> float:
        """Return the largest error of coordinates and rates at `END`."""
        exact = self.end()
        return float(max(abs(q - exact[0]).max(), abs(qdot - exact[1]).max()))


# -- sleigh, free and on a torsion spring -------------------------------------------------------


def sleigh_rhs(state: Any, p: Any, functions: Functions) -> Sequence[Any]:
    """x, y, theta, speed along the blade, angular velocity; p = (b, m b / I_C)."""
    _, _, theta, v, omega = state
    sin, cos = functions
    return v * cos(theta), v * sin(theta), omega, p[0] * (omega * omega), -p[1] * (v * omega)


def spring_rhs(state: Any, p: Any, functions: Functions) -> Sequence[Any]:
    """Rates of the sleigh with a torque -k theta; p = (b, m b / I_C, k / I_C)."""
    _, _, theta, v, omega = state
    sin, cos = functions
    omega_dot = -p[1] * (v * omega) - p[2] * theta
    return v * cos(theta), v * sin(theta), omega, p[0] * (omega * omega), omega_dot


def sleigh_to_scene(y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (q, q_dot) of a sleigh."""
    return y[:3], np.array([y[3] * math.cos(y[2]), y[3] * math.sin(y[2]), y[4]])


def _sleigh_start(case: Case) -> FloatArray:
    start = case.exact(0)
    speed = start.qdot[0] * math.cos(start.q[2]) + start.qdot[1] * math.sin(start.q[2])
    return np.array([*start.q, speed, start.qdot[2]])


def spring_sleigh() -> da.Scene:
    """Return the Chaplygin sleigh whose heading is held by a torsion spring k."""
    scene = da.scenes.chaplygin_sleigh()
    body, (_, _, theta) = scene.bodies[0], scene.coordinates
    scene.add_loads((body.frame, -sp.Symbol("k", positive=True) * theta * scene.frame.z))
    return scene


# -- rolling sphere, homogeneous and with three moments -----------------------------------------


def sphere_rhs(state: Any, p: Any, functions: Functions) -> Sequence[Any]:
    """x, y, psi, theta, phi with a constant angular velocity: p = (r, omega_x, omega_y, omega_z)."""
    _, _, psi, theta, _ = state
    sin, cos = functions
    r, ox, oy, oz = p
    sine, cosine = sin(psi), cos(psi)
    phi_dot = (ox * sine - oy * cosine) / sin(theta)
    still = 0.0 * psi
    return r * oy + still, -r * ox + still, oz - phi_dot * cos(theta), ox * cosine + oy * sine, phi_dot


def unequal_rhs(state: Any, p: Any, functions: Functions) -> Sequence[Any]:
    """x, y, psi, theta, phi of Chaplygin's ball; p = (r, D, A + D, B + D, C + D, K_x, K_y, K_z), D = m r^2.

    The angular momentum K about the contact is constant in space (Chaplygin 1903), which gives the angular velocity
    from the orientation: J omega - D gamma (gamma . omega) = K in the body's axes, solved by Sherman and Morrison.
    """
    _, _, psi, theta, phi = state
    sin, cos = functions
    r, D, a, b, c, K_x, K_y, K_z = p
    s1, c1, s2, c2, s3, c3 = sin(psi), cos(psi), sin(theta), cos(theta), sin(phi), cos(phi)
    along, across = K_x * c1 + K_y * s1, c2 * (K_y * c1 - K_x * s1) + K_z * s2
    k1, k2, k3 = along * c3 + across * s3, across * c3 - along * s3, s2 * (K_x * s1 - K_y * c1) + K_z * c2
    g1, g2, g3 = s2 * s3, s2 * c3, c2
    u1, u2, u3, w1, w2, w3 = k1 / a, k2 / b, k3 / c, g1 / a, g2 / b, g3 / c
    spin = D * (g1 * u1 + g2 * u2 + g3 * u3) / (1.0 - D * (g1 * w1 + g2 * w2 + g3 * w3))
    o1, o2, o3 = u1 + spin * w1, u2 + spin * w2, u3 + spin * w3
    theta_dot = o1 * c3 - o2 * s3
    psi_dot = (o1 * s3 + o2 * c3) / s2
    phi_dot = o3 - psi_dot * c2
    level = phi_dot * s2
    return r * (theta_dot * s1 - level * c1), -r * (theta_dot * c1 + level * s1), psi_dot, theta_dot, phi_dot


def unequal_sphere() -> da.Scene:
    """Return the rolling sphere with principal moments A, B, C; its mass centre stays in its centre."""
    scene = da.scenes.rolling_sphere()
    sphere, (A, B, C) = scene.bodies[0], sp.symbols("A B C", positive=True)
    moments = inertia(sphere.frame, A, B, C), sphere.masscenter
    scene.bodies = (RigidBody("sphere", sphere.masscenter, sphere.frame, sphere.mass, moments),)
    return scene


UNEQUAL = {"m": 1.3, "r": 0.5, "g": 9.81, "A": 0.08, "B": 0.13, "C": 0.2}


def unequal_parameters(p: Mapping[str, float], q: FloatArray, omega: FloatArray) -> tuple[float, ...]:
    """Return what `unequal_rhs` takes, from parameters, coordinates and the angular velocity along fixed axes."""
    R = rotation(q)
    D = p["m"] * p["r"] ** 2
    moments = np.array([p["A"], p["B"], p["C"]])
    K = R @ (moments * (R.T @ omega)) + D * np.array([omega[0], omega[1], 0.0])
    return (p["r"], D, *(moments + D).tolist(), *K.tolist())


def rotation(q: FloatArray) -> FloatArray:
    """Return the matrix whose columns are the axes of a sphere at coordinates (x, y, psi, theta, phi)."""

    def turn(angle: float, i: int, j: int) -> FloatArray:
        matrix = np.eye(3)
        matrix[i, i] = matrix[j, j] = math.cos(angle)
        matrix[j, i], matrix[i, j] = math.sin(angle), -math.sin(angle)
        return matrix

    return turn(q[2], 0, 1) @ turn(q[3], 1, 2) @ turn(q[4], 0, 1)


# -- double pendulum ------------------------------------------------------------------------------


def pendulum_rhs(state: Any, p: Any, functions: Functions) -> Sequence[Any]:
    """Return the rates of angles to the vertical and their rates: p = (m_1, m_2, l_1, l_2, g).

    The accelerations are solved for by hand; each sine is taken once.
    """
    a, b, a_dot, b_dot = state
    sin, cos = functions
    m1, m2, l1, l2, g = p
    s, c, m = sin(a - b), cos(a - b), m1 + m2
    first, second = l1 * (a_dot * a_dot), l2 * (b_dot * b_dot)
    f1 = -m2 * s * second - m * g * sin(a)
    f2 = s * first - g * sin(b)
    inertia = m1 + m2 * (s * s)
    return a_dot, b_dot, (f1 - m2 * c * f2) / (l1 * inertia), (m * f2 - c * f1) / (l2 * inertia)


def double_pendulum() -> da.Scene:
    """Return two particles on massless rods, in absolute angles."""
    a, b = dynamicsymbols("a b")
    m_1, m_2, l_1, l_2, g = sp.symbols("m_1 m_2 l_1 l_2 g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", l_1 * (sp.sin(a) * N.x - sp.cos(a) * N.y))
    Q = P.locatenew("Q", l_2 * (sp.sin(b) * N.x - sp.cos(b) * N.y))
    scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(Particle("upper", P, m_1), Particle("lower", Q, m_2))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


DOUBLE = {"m_1": 1.2, "m_2": 0.7, "l_1": 0.9, "l_2": 1.1, "g": 9.81}
_DOUBLE_START = np.array([0.9, -0.4, 0.0, 1.5])


# -- the five -----------------------------------------------------------------------------------


def _closed(name: str, case: Case, reduced: Reduced) -> Problem:
    def end() -> tuple[FloatArray, FloatArray]:
        exact = case.exact(END)
        return exact.q, exact.qdot

    return Problem(name, da.scenes.ALL[case.scene], case.parameters, case.initial, reduced, end)


def _extended(
    name: str, build: Callable[[], da.Scene], coordinates: Sequence[str], p: Mapping[str, float], reduced: Reduced
) -> Problem:
    def end() -> tuple[FloatArray, FloatArray]:
        return reduced.to_scene(np.array([float(v) for v in json.loads(FILE.read_text(encoding="utf-8"))[name]]))

    rates = [f"{q}_dot" for q in coordinates]
    q, qdot = reduced.to_scene(reduced.start)
    initial = {**dict(zip(coordinates, q.tolist(), strict=True)), **dict(zip(rates, qdot.tolist(), strict=True))}
    return Problem(name, build, p, initial, reduced, end)


def _all() -> list[Problem]:
    p = SLEIGH.parameters
    sleigh = (p["b"], p["m"] * p["b"] / p["I_C"])
    spring = {**p, "k": 5e3}
    start = SPHERE.exact(0)
    omega = spatial_angular_velocity(start.q, start.qdot)

    def to_scene(rhs: Any, parameters: tuple[float, ...]) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
        return lambda y: (y, np.array(rhs(y.tolist(), parameters, (math.sin, math.cos))))

    sphere = (SPHERE.parameters["r"], *omega.tolist())
    unequal = unequal_parameters(UNEQUAL, start.q, omega)
    first = _sleigh_start(SLEIGH)
    on_spring = Reduced(spring_rhs, (*sleigh, spring["k"] / p["I_C"]), first, sleigh_to_scene)
    pendulum = Reduced(pendulum_rhs, tuple(DOUBLE.values()), _DOUBLE_START, lambda y: (y[:2], y[2:]))
    chaplygin = Reduced(unequal_rhs, unequal, start.q, to_scene(unequal_rhs, unequal))
    return [
        _closed("sleigh", SLEIGH, Reduced(sleigh_rhs, sleigh, first, sleigh_to_scene)),
        _closed("sphere", SPHERE, Reduced(sphere_rhs, sphere, start.q, to_scene(sphere_rhs, sphere))),
        _extended("unequal sphere", unequal_sphere, SPHERE.coordinates, UNEQUAL, chaplygin),
        _extended("stiff sleigh", spring_sleigh, SLEIGH.coordinates, spring, on_spring),
        _extended("double pendulum", double_pendulum, ("a", "b"), DOUBLE, pendulum),
    ]


PROBLEMS: dict[str, Problem] = {problem.name: problem for problem in _all()}
EXTENDED = {
    name: (PROBLEMS[name].reduced.rhs, PROBLEMS[name].reduced.parameters, PROBLEMS[name].reduced.start.tolist())
    for name in ("unequal sphere", "stiff sleigh", "double pendulum")
}
