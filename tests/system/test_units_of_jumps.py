"""Velocities that jump, angles that lock and integrals that are kept, in other units of length, mass and time."""

import numpy as np
import pytest
from sympy import Max, sign, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from scene.scaled import I_C, Units, g, l, m
from system.test_units import UNITS

v, T, F, k = symbols("v T F k", positive=True)
t = dynamicsymbols._t
P = {"m": 1.5, "g": 9.81, "l": 0.7, "I_C": 0.4, "v": 2.0, "T": 0.5, "F": 0.5, "k": 50.0}
LENGTH, FORCE = (1, 0, 0), (1, 1, -2)
DIMENSIONS = dict.fromkeys(["x", "y", "l"], LENGTH) | {"m": (0, 1, 0), "g": (1, 0, -2), "I_C": (2, 1, 0)}
DIMENSIONS |= {"v": (1, 0, -1), "T": (0, 0, 1), "F": FORCE, "k": (0, 1, -2)}
SLOW = [Units(1e-6, 1.0, 1e6), Units(1e-9, 1.0, 1e3), Units(1e8, 1e-9, 1e-6)]


def _space(name, *coordinates):
    N, O = ReferenceFrame("N"), Point("O")
    return da.Scene(name, frame=N, origin=O, coordinates=coordinates), N, O


def _jerked_string():
    """Return a pendulum in coordinates of its bob, its pivot at rest until T and then at the velocity v."""
    x, y = dynamicsymbols("x y")
    scene, N, O = _space("jerked_string", x, y)
    bob = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bob", bob, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints((x - v * Max(0, t - T)) ** 2 + y**2 - l**2)
    return scene


def _jerked_rod():
    """Return a rod that slides and turns on a pivot that is at rest until T and then moves at the velocity v."""
    x, a = dynamicsymbols("x a")
    scene, N, O = _space("jerked_rod", x, a)
    S = N.orientnew("S", "Axis", (a, N.z))
    G = O.locatenew("A", v * Max(0, t - T) * N.x).locatenew("G", (l + x) * S.x)
    scene.add_bodies(RigidBody("rod", G, S, m, (inertia(S, 0, 0, I_C), G)))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def _run(model, start, units, end):
    """Return a run to a time in ordinary units."""
    given = units.of({name: P[name] for name in model.layout.given}, DIMENSIONS)
    atol = 1e-9 * min(units.length, 1.0) / max(units.time, 1.0)
    return model.simulate((0.0, end * units.time), units.of(start, DIMENSIONS), given, rtol=1e-9, atol=atol)


@pytest.mark.parametrize(
    ("build", "start"),
    [
        (_jerked_string, {"x": 0.0, "y": -0.7, "x_dot": 0.0, "y_dot": 0.0}),
        (_jerked_rod, {"x": 0.0, "a": 0.3, "x_dot": 0.0, "a_dot": 0.0}),
    ],
)
def test_rates_jump_alike(build, start):
    model = da.compile_model(build(), backend="numpy")
    expected = None
    for units in [Units(), *UNITS, *SLOW]:
        run = _run(model, start, units, 0.7)
        assert run.success, (units, run.message)
        found = [*units.without({name: run[name][-1] for name in start}, DIMENSIONS).values()]
        expected = found if expected is None else expected
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7, err_msg=str(units))


def test_angles_lock_only_where_constraints_do_not_hold_them():
    """A body on a line locks at a right angle; where a constraint that is a length holds an angle, it does not."""
    x, a, b, c = dynamicsymbols("x a b c")
    for held, status in ((False, "SINGULAR_COORDINATES"), (True, "SUCCESS")):
        scene, N, O = _space("gimbal", x, a, b, c)
        S = N.orientnew("S", "Body", (a, b, c), "XYZ")
        G = O.locatenew("G", x * N.x)
        scene.add_bodies(RigidBody("body", G, S, m, (inertia(S, I_C, 2 * I_C, 3 * I_C), G)))
        scene.add_holonomic_constraints(x - l)
        if held:
            scene.add_holonomic_constraints(l * a)
        model = da.compile_model(scene, backend="numpy", formulation="projected")
        start = {"x": 0.7, "a": 0.0, "b": 1.0, "c": 0.0, "b_dot": 1.0}
        start |= dict.fromkeys(["x_dot", "a_dot", "c_dot"], 0.0)
        for units in [Units(), *UNITS]:
            run = _run(model, start, units, 1.0)
            assert str(run.status) == status, (units, held, run.message)


def test_rubbing_is_seen_in_any_unit():
    """A force that is small beside others in ordinary units is not small beside those of a scene of its size."""
    x, y = dynamicsymbols("x y")
    scene, N, O = _space("rubbing", x, y)
    bob = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bob", bob, m))
    scene.add_loads((bob, -k * (x * N.x + y * N.y) - F * sign(x.diff()) * N.x))
    model = da.compile_model(scene, backend="numpy")
    start = {"x": 0.9, "y": 0.5, "x_dot": 0.0, "y_dot": 0.3}
    for units in [Units(), *UNITS, *SLOW]:
        run = _run(model, start, units, 0.02)
        assert not run.invariants, units
