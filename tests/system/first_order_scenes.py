"""Scenes with first-order states, and their right-hand sides written by hand, for SciPy."""

from dataclasses import dataclass, field

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

t = dynamicsymbols._t
x, y, theta, F, D, T, delta, e = dynamicsymbols("x y theta F D T delta e")
m, g, l, k, tau, w, I, c, V, r = sp.symbols("m g l k tau w I c V r", positive=True)


@dataclass
class Case:
    """A scene, a start, parameters, and values by name at times, which something else computed."""

    scene: da.Scene
    initial: dict
    parameters: dict
    reference: object
    names: tuple
    span: tuple = (0.0, 2.0)
    outputs: tuple = ()
    formulations: tuple = field(default_factory=tuple)


def solved(right, start, times):
    """Return the solution (n_t, n) of an initial value problem by SciPy, at errors near rounding."""
    first, last = (0.0, times[-1]) if times[-1] > 0 else (times[0], 0.0)
    found = solve_ivp(right, (first, last), start, method="DOP853", rtol=1e-13, atol=1e-15, t_eval=times)
    return found.y.T


def servo():
    """A cart that a lag drives, with the integral of its error: linear, so that a matrix exponential solves it."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("servo", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", P, m))
    scene.add_states({F: (k * (r - x) - F) / tau})
    scene.add_states({e: r - x})
    scene.add_loads((P, (F + e - c * x.diff()) * N.x))
    values = {"m": 1.3, "k": 2.0, "c": 3.0, "tau": 0.4, "r": 0.7}

    def reference(times):
        from scipy.linalg import expm

        a = np.zeros((5, 5))  # x, x_dot, F, e, 1
        a[0, 1] = 1.0
        a[1] = np.array([0.0, -3.0, 1.0, 1.0, 0.0]) / 1.3
        a[2] = np.array([-2.0, 0.0, -1.0, 0.0, 2.0 * 0.7]) / 0.4
        a[3, 0], a[3, 4] = -1.0, 0.7
        return np.array([(expm(a * s) @ np.array([0.1, 0.0, 0.2, -0.3, 1.0]))[:4] for s in times])

    initial = {x: 0.1, x.diff(): 0.0, F: 0.2, "e": -0.3}
    return Case(scene, initial, values, reference, ("x", "x_dot", "F", "e"), formulations=("minimal", "augmented"))


def crane():
    """A pendulum in Cartesian coordinates, pulled by a muscle with activation dynamics of its own and a given beat."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("crane", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bob", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    scene.add_states({F: (k * (sp.sin(w * t) - x) - F) / tau - F**3 * x**2})
    scene.add_loads((P, F * N.x))
    values = {"m": 1.2, "g": 9.81, "l": 0.8, "k": 3.0, "tau": 0.3, "w": 2.5}

    def right(s, z):
        angle, rate, pull = z
        own_x = 0.8 * np.sin(angle)
        turn = (-1.2 * 9.81 * np.sin(angle) + pull * np.cos(angle)) / (1.2 * 0.8)
        return [rate, turn, (3.0 * (np.sin(2.5 * s) - own_x) - pull) / 0.3 - pull**3 * own_x**2]

    def reference(times):
        angle, rate, pull = solved(right, [0.5, 0.3, 0.4], times).T
        own = 0.8 * np.sin(angle), -0.8 * np.cos(angle)
        return np.column_stack([*own, -own[1] * rate, own[0] * rate, pull])

    first = reference(np.array([0.0, 1.0]))[0]
    initial = dict(zip(("x", "y", "x_dot", "y_dot", "F"), first.tolist(), strict=True))
    names = ("x", "y", "x_dot", "y_dot", "F")
    own = ("projected", "baumgarte", "ggl", "augmented")
    return Case(scene, initial, values, reference, names, formulations=own)


def tricycle():
    """A body on a blade whose angle to it is a state, as are drive and torque: a state in a nonholonomic constraint."""
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    scene = da.Scene("tricycle", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("body", C, S, m, (inertia(S, 0, 0, I), C)))
    X, Y = da.unknowns("X Y")
    scene.add_joints(da.Joint("blade", body="body", at=C, force=X * N.x + Y * N.y))
    angle = theta + delta
    along = x.diff() * sp.cos(angle) + y.diff() * sp.sin(angle)
    scene.add_nonholonomic_constraints(-x.diff() * sp.sin(angle) + y.diff() * sp.cos(angle))
    scene.add_states({delta: (sp.sin(w * t) / 2 - delta) / tau, D: k * (V - along), T: -T / tau + delta})
    scene.add_loads((C, D * (sp.cos(angle) * N.x + sp.sin(angle) * N.y)), (S, (T - c * theta.diff()) * N.z))
    values = {"m": 1.5, "I": 0.7, "tau": 0.6, "w": 2.0, "k": 2.2, "V": 1.5, "c": 0.4}

    def right(s, z):
        _, _, turn, speed, spin, steer, drive, torque = z
        whole = turn + steer
        steered = (0.5 * np.sin(2.0 * s) - steer) / 0.6
        motion = [speed * np.cos(whole), speed * np.sin(whole), spin, drive / 1.5, (torque - 0.4 * spin) / 0.7]
        return [*motion, steered, 2.2 * (1.5 - speed), -torque / 0.6 + steer]

    def reference(times):
        own_x, own_y, turn, speed, spin, steer, drive, torque = solved(
            right, [0.1, -0.2, 0.3, 1.0, 0.5, 0.2, 0.1, -0.3], times
        ).T
        whole = turn + steer
        side = 1.5 * speed * (spin + (0.5 * np.sin(2.0 * times) - steer) / 0.6)  # m v (theta + delta)'
        push = side * -np.sin(whole), side * np.cos(whole)
        rates = speed * np.cos(whole), speed * np.sin(whole)
        return np.column_stack([own_x, own_y, turn, *rates, spin, steer, drive, torque, *push])

    names = ("x", "y", "theta", "x_dot", "y_dot", "theta_dot", "delta", "D", "T", "X", "Y")
    first = reference(np.array([0.0, 1.0]))[0]
    initial = dict(zip(names[:9], first[:9].tolist(), strict=True))
    own = ("projected", "baumgarte", "ggl", "augmented")
    return Case(scene, initial, values, reference, names, outputs=("X", "Y"), formulations=own)


def spinner():
    """A free body whose speed of rotation a motor on it controls, with a filter of the speed, over a sleigh's blade."""
    case = da.scenes.chaplygin_sleigh()
    S = case.bodies[0].frame
    x0, _, turn = case.coordinates
    case.add_states({T: (k * (w - turn.diff()) - T) / tau, e: turn.diff() * x0.diff()})
    case.add_loads((S, T * S.z))
    values = {"m": 1.0, "b": 0.3, "I_C": 0.5, "k": 0.8, "w": 1.2, "tau": 0.5}

    def right(s, z):
        _, _, angle, speed, spin, torque, _ = z
        forward = speed * np.cos(angle)
        push = 0.3 * spin**2
        turning = (-1.0 * 0.3 * speed * spin + torque) / 0.5
        return [
            forward,
            speed * np.sin(angle),
            spin,
            push,
            turning,
            (0.8 * (1.2 - spin) - torque) / 0.5,
            spin * forward,
        ]

    def reference(times):
        found = solved(right, [0.0, 0.0, 0.2, 1.0, 0.5, 0.1, 0.0], times).T
        own_x, own_y, angle, speed, spin, torque, total = found
        return np.column_stack([own_x, own_y, angle, speed * np.cos(angle), speed * np.sin(angle), spin, torque, total])

    names = ("x", "y", "theta", "x_dot", "y_dot", "theta_dot", "T", "e")
    initial = {"x": 0, "y": 0, "theta": 0.2, "x_dot": np.cos(0.2), "theta_dot": 0.5, "T": 0.1, "e": 0.0}
    return Case(case, initial, values, reference, names, formulations=("minimal", "projected"))


CASES = {case.__name__: case for case in (servo, crane, tricycle, spinner)}
