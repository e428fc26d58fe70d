"""First integrals: found where they are, and refused with a reason where they are not."""

import numpy as np
import pytest
import sympy as sp
from sympy import cos, sin
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from textbook.helpers import same, symbols_of


def heavy_top():
    psi, theta, phi = dynamicsymbols("psi theta phi")
    m, l, A, C, g = sp.symbols("m l A C g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = N.orientnew("P", "Axis", (psi, N.z))
    Q = P.orientnew("Q", "Axis", (theta, P.x))
    S = Q.orientnew("S", "Axis", (phi, Q.z))
    G = O.locatenew("G", l * S.z)
    scene = da.Scene("heavy top", frame=N, origin=O, coordinates=[psi, theta, phi])
    scene.add_bodies(RigidBody("top", G, S, m, (inertia(S, A, A, C), G)))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def pendulum(links=1, drive=0):
    m, l, g = sp.symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    angles = dynamicsymbols(f"theta1:{links + 1}")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=angles)
    end = O.locatenew("P0", drive * N.x)
    for i, angle in enumerate(angles):
        frame = N.orientnew(f"F{i}", "Axis", (angle, N.z))
        end = end.locatenew(f"P{i + 1}", -l * frame.y)
        scene.add_bodies(Particle(f"bob{i}", end, m))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def test_sleigh_has_energy_only():
    found = da.lagrange(da.scenes.chaplygin_sleigh()).first_integrals
    assert [item.name for item in found] == ["energy"]
    assert len(found.reasons) == 3
    assert "x is cyclic, but the forces have power on it" in found.reasons[0]


def test_sphere_has_four_momenta():
    scene = da.scenes.rolling_sphere()
    found = da.lagrange(scene).first_integrals
    x, y, psi, theta, phi, m, r = symbols_of(scene, "x y psi theta phi m r")
    J = sp.Rational(2, 5) * m * r**2
    expected = [
        m * x.diff(),
        m * y.diff(),
        J * (psi.diff() + phi.diff() * cos(theta)),
        J * (phi.diff() + psi.diff() * cos(theta)),
    ]
    assert all(same(item.expression, e) for item, e in zip(found, expected, strict=False))
    assert [item.name for item in found][4:] == ["energy"]
    assert found.independent == 4  # the energy follows from the momenta and the constraints


def test_heavy_symmetric_top():
    scene = heavy_top()
    found = da.lagrange(scene).first_integrals
    psi, theta, phi, m, l, A, C, g = symbols_of(scene, "psi theta phi m l A C g")
    spin = phi.diff() + psi.diff() * cos(theta)
    p_phi = C * spin
    p_psi = (A + m * l**2) * psi.diff() * sin(theta) ** 2 + p_phi * cos(theta)
    energy = (A + m * l**2) * (theta.diff() ** 2 + psi.diff() ** 2 * sin(theta) ** 2) / 2 + C * spin**2 / 2
    energy += m * g * l * cos(theta)
    assert [item.name for item in found] == ["momentum of psi", "momentum of phi", "energy"]
    for item, expected in zip(found, (p_psi, p_phi, energy), strict=True):
        assert same(item.expression, expected)
    assert found.independent == 3


def test_double_pendulum_has_energy():
    found = da.lagrange(pendulum(2)).first_integrals
    assert [item.name for item in found] == ["energy"]


def test_driven_scene_has_none_and_says_why():
    a, w = sp.symbols("a w", positive=True)
    found = da.lagrange(pendulum(1, drive=a * cos(w * dynamicsymbols._t))).first_integrals
    assert tuple(found) == ()
    assert found.independent == 0
    assert any("energy: the kinetic energy depends explicitly on time" in reason for reason in found.reasons)
    assert "none from energy" in str(found)


def test_rheonomic_constraint_takes_the_energy_away():
    scene = pendulum(2)
    w = sp.Symbol("w", positive=True)
    scene.add_holonomic_constraints(scene.coordinates[0] - w * dynamicsymbols._t)
    found = da.lagrange(scene).first_integrals
    assert tuple(found) == ()
    assert any("moves with time" in reason for reason in found.reasons)


def test_damping_takes_the_energy_away():
    scene = pendulum(1)
    (theta,) = scene.coordinates
    c = sp.Symbol("c", positive=True)
    bob = scene.bodies[0].point
    scene.add_loads((bob, -c * theta.diff() * scene.frame.x))
    found = da.lagrange(scene).first_integrals
    assert tuple(found) == ()
    assert any("the loads have no potential" in reason for reason in found.reasons)


def test_spring_has_a_potential():
    scene = pendulum(1)
    (theta,) = scene.coordinates
    k, l = sp.symbols("k l", positive=True)
    scene.add_loads((scene.bodies[0].point, -k * l * sin(theta) * scene.frame.x))
    (energy,) = da.lagrange(scene).first_integrals
    m, g = symbols_of(scene, "m g")
    expected = m * l**2 * theta.diff() ** 2 / 2 - m * g * l * cos(theta) + k * l**2 * sin(theta) ** 2 / 2
    assert same((energy.expression - expected).diff(theta), 0)
    assert same((energy.expression - expected).diff(theta.diff()), 0)


def test_rotating_referential_has_jacobi_s_integral():
    """A bead on a rod that turns at a given rate: time occurs in no term, and T - m r^2 w^2 .. is constant."""
    r = dynamicsymbols("r")
    m, w = sp.symbols("m w", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (w * dynamicsymbols._t, N.z))
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[r])
    scene.add_bodies(Particle("bead", O.locatenew("P", r * S.x), m))
    (integral,) = da.lagrange(scene).first_integrals
    assert integral.name == "Jacobi's integral"
    assert same(integral.expression, m * (r.diff() ** 2 - w**2 * r**2) / 2)


def test_total_momentum_is_found_as_a_combination():
    x, y = dynamicsymbols("x y")
    m, n, k = sp.symbols("m n k", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P, Q = O.locatenew("P", x * N.x), O.locatenew("Q", y * N.x)
    scene = da.Scene("two", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", P, m), Particle("q", Q, n))
    scene.add_loads((P, k * (y - x) * N.x), (Q, k * (x - y) * N.x))
    momentum, energy = da.lagrange(scene).first_integrals
    assert same(momentum.expression, m * x.diff() + n * y.diff())
    assert energy.name == "energy"


@pytest.mark.parametrize("name", sorted(da.scenes.ALL))
def test_first_integrals_are_constant_in_simulations(name):
    scene = da.scenes.ALL[name]()
    view = da.lagrange(scene)
    model = da.compile_model(scene, backend="llvm", outputs=list(view.first_integrals.expressions))
    state = view._states.states[1]
    p = {x.name: value for x, value in zip(view.system.p, state.p, strict=True)}
    p = {key: p.get(key, 0.8) for key in model.layout.parameters}
    initial = dict(zip((*model.layout.coordinates, *model.layout.rates), (*state.q, *state.v), strict=True))
    run = model.simulate((0, 0.4), initial, p, rtol=1e-11, atol=1e-13)
    for e in view.first_integrals.expressions:
        values = run[str(e)]
        assert np.abs(values - values[0]).max() < 1e-8 * max(1, np.abs(values[0]))
