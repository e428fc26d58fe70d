"""Potential energies that bodies say themselves: they exert no force, and count in the energies once."""

import warnings

import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import EnergyWarning

x, y = dynamicsymbols("x y")
m, g, k, c = sp.symbols("m g k c", real=True)
START = {"x": 1.0, "y": 0.5, "x_dot": 0.0, "y_dot": 1.0}
P = {"m": 2.0, "g": 9.0, "k": 3.0, "c": 0.25}


def bead(potential, *, gravity=False, spring=False, damper=False):
    N, O = ReferenceFrame("N"), Point("O")
    scene, B = da.Scene("bead", frame=N, origin=O, coordinates=[x, y]), O.locatenew("B", x * N.x + y * N.y)
    body = Particle("bead", B, m)
    body.potential_energy = potential
    scene.add_bodies(body)
    if gravity:
        scene.apply_uniform_gravity(-g * N.y)
    if spring:
        scene.add_loads((B, -k * x * N.x))
    if damper:
        scene.add_loads((B, -c * x.diff() * N.x - c * y.diff() * N.y))
    return scene


def potential_at_start(scene):
    model = da.compile_model(scene, backend="numpy")
    used = {name: value for name, value in P.items() if name in model.layout.parameters}
    return model.simulate((0, 0.01), START, used)["potential_energy"][0]


SOUND = [
    (k * x**2 / 2, {"spring": True}, 1.5),
    (k * x**2 / 2, {"spring": True, "damper": True}, 1.5),
    (k * x**2 / 2, {"spring": True, "gravity": True}, 10.5),
    (m * g * y, {"gravity": True}, 9.0),
    (m * g * (y - 1), {"gravity": True}, -9.0),
    (m, {"gravity": True}, 11.0),
]


@pytest.mark.parametrize(("potential", "loads", "expected"), SOUND)
def test_potential_that_loads_exert_counts_once(potential, loads, expected):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert potential_at_start(bead(potential, **loads)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("potential", "loads", "name"),
    [
        (k * x**2 / 2, {}, "x"),
        (k * x**2 / 2, {"damper": True}, "x"),
        (k * x**2 / 2, {"gravity": True}, "x"),
        (k * x**2 / 2 + m * g * y, {"gravity": True, "spring": True}, "y"),
        (m * g * y + k * x**2 / 2, {}, "x, y"),
    ],
)
def test_potential_that_nothing_exerts_is_warned_of(potential, loads, name):
    with pytest.warns(EnergyWarning, match=f"depends on {name}, along which no load acts"):
        da.compile_model(bead(potential, **loads), backend="numpy")
