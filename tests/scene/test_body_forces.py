"""Forces on bodies at points that need not be fixed on them: their power is that of the body's own velocity there."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, cross, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import LoadWarning, SceneError

x, y, z, theta, phi = dynamicsymbols("x y z theta phi")
m, r, I, k, F = symbols("m r I k F", positive=True)
N, O = ReferenceFrame("N"), Point("O")
W = N.orientnew("W", "Axis", (theta, N.y))
G = O.locatenew("G", x * N.x)
TYRE = G.locatenew("C", -r * N.z)
ROAD = -k * (x.diff() - r * theta.diff()) * N.x
VALUES = {m: 1.0, r: 0.5, I: 0.1, k: 3.0, F: 1.0}
REST = {x: 0, theta: 0, x.diff(): 0, theta.diff(): 0}


def wheel(*loads):
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[x, theta])
    scene.add_bodies(RigidBody("wheel", G, W, m, (inertia(W, 0, I, 0), G)))
    scene.add_loads(*loads)
    return scene


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_the_road_turns_a_wheel_that_it_pulls(backend):
    """A driven wheel with viscous slip, against SciPy on the equations of Newton and Euler."""
    model = da.compile_model(wheel((G, F * N.x), ("wheel", TYRE, ROAD)), backend=backend)
    run = model.simulate((0, 2), REST, VALUES, rtol=1e-10)

    def rates(_, s):
        slip = s[0] - 0.5 * s[1]
        return [1.0 - 3.0 * slip, 0.5 * 3.0 * slip / 0.1]

    known = solve_ivp(rates, (0, 2), [0, 0], rtol=1e-11, atol=1e-13).y[:, -1]
    np.testing.assert_allclose([run["x_dot"][-1], run["theta_dot"][-1]], known, rtol=1e-8)


def test_a_body_is_given_or_named():
    body = wheel().bodies
    scene = wheel()
    scene.add_loads((G, F * N.x), (scene.bodies[0], TYRE, ROAD))
    named = da.compile_model(wheel((G, F * N.x), ("wheel", TYRE, ROAD)))
    given = da.compile_model(scene)
    assert body and given.source == named.source


def tumbling(loads):
    """Return a body that moves freely, and its frame, mass centre, and a point that moves over it."""
    A = N.orientnew("A", "Axis", (theta, N.z))
    B = A.orientnew("B", "Axis", (phi, A.x))
    C = O.locatenew("C", x * N.x + y * N.y + z * N.z)
    at = C.locatenew("P", sin(phi) * A.y + 0.3 * x * N.x - r * B.z)
    force = (1 + x) * N.x - z * B.y + cos(theta) * A.x
    scene = da.Scene("tumbling", frame=N, origin=O, coordinates=[x, y, z, theta, phi])
    scene.add_bodies(RigidBody("body", C, B, m, (inertia(B, 1, 2, 3, 0.1, 0.2, 0.3), C)))
    scene.add_loads(*loads(B, C, at, force))
    return scene


def test_a_force_on_a_body_is_that_force_at_its_mass_centre_and_a_torque():
    one = da.compile_model(tumbling(lambda B, C, at, force: [("body", at, force)]))
    two = da.compile_model(tumbling(lambda B, C, at, force: [(C, force), (B, cross(at.pos_from(C), force))]))
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, u = rng.uniform(-1, 1, (2, 5))
        p = {m: 1.3, r: 0.4}
        np.testing.assert_allclose(
            one.accelerations(0.0, q, u, p), two.accelerations(0.0, q, u, p), rtol=1e-12, atol=1e-13
        )


def test_the_textbook_view_has_the_same_power():
    scene = wheel((G, F * N.x), ("wheel", TYRE, ROAD))
    actions = da.lagrange(scene).actions
    slip = x.diff() - r * theta.diff()
    assert (actions.given_power(x) - (F - k * slip)).expand() == 0
    assert (actions.given_power(theta) - k * r * slip).expand() == 0


def test_at_a_point_of_the_body_nothing_changes_and_the_energy_counts():
    P = G.locatenew("P", r * W.x)
    pair = da.compile_model(wheel((P, -F * N.z)), outputs=["energy"])
    triple = da.compile_model(wheel(("wheel", P, -F * N.z)), outputs=["energy"])
    start = {**REST, theta: 0.4, theta.diff(): 2.0}
    values = {m: 1.0, r: 0.5, I: 0.1, F: 1.0}
    runs = [model.simulate((0, 3), start, values, rtol=1e-10) for model in (pair, triple)]
    np.testing.assert_allclose(runs[0].y, runs[1].y, rtol=0, atol=1e-12)
    np.testing.assert_allclose(runs[1]["energy"], runs[0]["energy"][0], rtol=1e-9)


def test_a_particle_has_one_velocity():
    scene = da.Scene("point", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", G, m))
    scene.add_loads(("p", O.locatenew("S", 2 * x * N.x), F * N.x))
    run = da.compile_model(scene).simulate((0, 1), {x: 0, x.diff(): 0}, {m: 2.0, F: 4.0})
    assert abs(run["x"][-1] - 1.0) < 1e-12


def test_a_pair_at_a_point_that_moves_over_a_body_is_warned_of():
    said = "force at 'C' acts at a point that is located from 'wheel' and moves over it"
    with pytest.warns(LoadWarning, match=said):
        da.compile_model(wheel((TYRE, ROAD)))


@pytest.mark.parametrize(
    "place", [G, G.locatenew("P", r * W.x), O.locatenew("Q", 2 * x * N.x)], ids=["mass centre", "on it", "elsewhere"]
)
def test_other_pairs_are_not(place):
    with warnings.catch_warnings():
        warnings.simplefilter("error", LoadWarning)
        da.compile_model(wheel((place, F * N.x)))


@pytest.mark.parametrize(
    ("load", "said"),
    [
        (("wheels", TYRE, ROAD), "acts on 'wheels', which is no body; known: wheel"),
        (("wheel", W, ROAD), r"the second of \(body, point, force\) must be a Point"),
        (("wheel", TYRE, ROAD, 1), r"neither \(point, force\), \(frame, torque\) nor \(body, point, force\)"),
        (("wheel", TYRE, F), "force on 'wheel' at 'C'"),
    ],
)
def test_what_is_wrong_is_named(load, said):
    with pytest.raises(SceneError, match=said):
        da.compile_model(wheel(load))
