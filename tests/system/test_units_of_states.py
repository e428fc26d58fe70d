"""One scene in other units of length, mass and time: the same assembled states, linearisations and equilibria."""

import functools

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import (
    LinearPathway,
    LinearSpring,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from scene.scaled import Units, g, l, m, pendulum, r, slider_crank
from system.test_units import CASES, UNITS


@functools.cache
def _model(name):
    return da.compile_model(CASES[name][0](), backend="numpy")


def _written(name, units):
    """Return the initial values and the parameters of a case in some units."""
    _, initial, parameters, dimensions, _ = CASES[name]
    given = {key: parameters[key] for key in _model(name).layout.given}
    return units.of(initial, dimensions), units.of(given, dimensions)


def _assembled(name, units):
    """Return what becomes of a rough guess, in ordinary units."""
    model, dimensions, rng = _model(name), CASES[name][3], np.random.default_rng(3)
    rough = {key: value + 0.1 * rng.normal() for key, value in CASES[name][1].items()}
    found = model.assemble(units.of(rough, dimensions), _written(name, units)[1])
    return units.without(found, dimensions)


@pytest.mark.parametrize("name", CASES)
def test_states_are_assembled_alike(name):
    expected = _assembled(name, Units())
    for units in UNITS:
        found = _assembled(name, units)
        np.testing.assert_allclose([*found.values()], [*expected.values()], rtol=1e-12, atol=1e-12, err_msg=str(units))


def _linearized(name, units):
    """Return the states of a linearisation, and its matrix in ordinary units."""
    lin = _model(name).linearize(0.0, *_written(name, units))
    sizes = np.array([*units.of(dict.fromkeys(lin.states, 1.0), CASES[name][3]).values()])
    return lin.states, lin.A * sizes / sizes[:, np.newaxis] * units.time


@pytest.mark.parametrize("name", CASES)
def test_motions_are_linearised_alike(name):
    expected = _linearized(name, Units())
    for units in UNITS:
        found = _linearized(name, units)
        assert found[0] == expected[0], units
        np.testing.assert_allclose(found[1], expected[1], rtol=1e-10, atol=1e-10, err_msg=str(units))


k, F = symbols("k F", positive=True)


def _hung():
    """Return a particle on two springs from a ceiling."""
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("hung", frame=N, origin=O, coordinates=[x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bob", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    for side in (-r, r):
        scene.add_actuators(LinearSpring(k, LinearPathway(P, O.locatenew("A", side * N.x)), l))
    return scene


def _pushed():
    """Return a pendulum with a spring and a force along x."""
    scene = pendulum()
    x, bob = scene.coordinates[0], scene.bodies[0].masscenter
    scene.add_loads((bob, (F - k * x) * scene.frame.x))
    return scene


def _sprung():
    """Return a slider-crank with a spring on the slider."""
    scene = slider_crank()
    slider = next(body for body in scene.bodies if body.name == "slider")
    scene.add_loads((slider.masscenter, -k * (scene.coordinates[2] - 3 * l) * scene.frame.x))
    return scene


VALUES = {"m": 1.5, "g": 9.81, "l": 0.7, "r": 0.3, "I_C": 0.4, "k": 50.0, "F": 3.0}
DIMENSIONS = {"m": (0, 1, 0), "g": (1, 0, -2), "I_C": (2, 1, 0), "k": (0, 1, -2), "F": (1, 1, -2)}
DIMENSIONS |= dict.fromkeys(["x", "y", "s", "l", "r"], (1, 0, 0))
TRIMS = {
    "springs": (_hung, {"x": 0.1, "y": -0.5}, None),
    "from the ceiling": (_hung, {"x": 0.1, "y": 0.0}, None),
    "which mass": (_hung, {"x": 0.0, "y": -0.8}, ["x", "m"]),
    "pendulum": (_pushed, {"x": 0.1, "y": -0.6}, None),
    "which force": (_pushed, {"x": 0.3, "y": -0.63}, ["y", "F"]),
    "which stiffness": (_pushed, {"x": 0.3, "y": -0.63, "F": 0.0}, ["y", "k", "F"]),
    "slider-crank": (_sprung, {"phi": 0.4, "beta": 0.06, "s": 2.38}, None),
}


@pytest.mark.parametrize("name", TRIMS)
def test_equilibria_are_the_same(name):
    build, guess, free = TRIMS[name]
    model, expected = da.compile_model(build(), backend="numpy"), None
    values = VALUES | {key: value for key, value in guess.items() if key in VALUES}
    start = {key: value for key, value in guess.items() if key not in VALUES}
    start |= dict.fromkeys(model.layout.rates, 0.0)
    for units in [Units(), *UNITS]:
        p = units.of({key: values[key] for key in model.layout.given}, DIMENSIONS)
        point = model.trim(units.of(start, DIMENSIONS), p, **({"free": free} if free else {}))
        assert point.converged, point.message
        found = [*units.without(point.initial | point.parameters, DIMENSIONS).values()]
        expected = found if expected is None else expected
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12, err_msg=str(units))


def test_a_turn_that_does_not_rest_is_no_equilibrium_in_any_unit():
    x, a = dynamicsymbols("x a")
    I_C, T = symbols("I_C T", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (a, N.z))
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[x, a])
    G = O.locatenew("G", x * N.x)
    scene.add_bodies(RigidBody("wheel", G, S, m, (inertia(S, 0, 0, I_C), G)))
    scene.add_loads((G, (F - k * x) * N.x), (S, T * N.z))
    model = da.compile_model(scene, backend="numpy")
    dimensions, start = DIMENSIONS | {"T": (2, 1, -2)}, {"x": 0.1, "a": 0.2, "x_dot": 0.0, "a_dot": 0.0}
    for units in [Units(), *UNITS]:
        p = units.of({"m": 1.5, "I_C": 0.4, "k": 50.0, "F": 3.0, "T": 1e-9}, dimensions)
        point = model.trim(units.of(start, dimensions), p)
        assert not point.converged, units
