"""Example 13.4.3: the sphere that rolls without slip, against every equation printed in the text."""

import pytest
import sympy as sp
from sympy import cos, sin

import dalembert as da
from textbook.helpers import TIME, frame, point, same, same_vector, symbols_of


@pytest.fixture(scope="module")
def sphere():
    scene = da.scenes.rolling_sphere()
    return scene, da.lagrange(scene), symbols_of(scene, "x y psi theta phi m r F_u F_v N")


def test_kinematic_screw(sphere):
    scene, view, (x, y, psi, theta, phi, *_) = sphere
    N, A, B = scene.frame, frame(scene, "A"), frame(scene, "B")
    screw = view.kinematic_screw("sphere")
    assert same_vector(screw.resultant, psi.diff() * N.z + theta.diff() * A.x + phi.diff() * B.z, N)
    assert same_vector(screw.moment, x.diff() * N.x + y.diff() * N.y, N)


def test_kinetic_energy(sphere):
    _, view, (x, y, psi, theta, phi, m, r, *_) = sphere
    spin = psi.diff() ** 2 + theta.diff() ** 2 + phi.diff() ** 2 + 2 * psi.diff() * phi.diff() * cos(theta)
    printed = m * (x.diff() ** 2 + y.diff() ** 2) + sp.Rational(2, 5) * m * r**2 * spin
    assert same(2 * view.kinetic_energy, printed)


def printed_equations(symbols):
    x, y, psi, theta, phi, m, r, F_u, F_v, _ = symbols
    J = sp.Rational(2, 5) * m * r**2
    return {
        1: (x, m * x.diff(TIME, 2), F_u * cos(psi) - F_v * sin(psi)),
        2: (y, m * y.diff(TIME, 2), F_u * sin(psi) + F_v * cos(psi)),
        3: (psi, J * (psi.diff() + phi.diff() * cos(theta)).diff(TIME), 0),
        4: (theta, J * (theta.diff(TIME, 2) + psi.diff() * phi.diff() * sin(theta)), r * F_v),
        5: (phi, J * (phi.diff() + psi.diff() * cos(theta)).diff(TIME), r * F_u * sin(theta)),
    }


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_equations_1_to_5(sphere, number):
    _, view, symbols = sphere
    q, left, right = printed_equations(symbols)[number]
    assert same(view.lagrange_expression(q), left)
    assert same(view.equation(q).lhs, left)
    assert same(view.equation(q).rhs, right)


def test_constraints_6_and_7(sphere):
    _, view, (x, y, psi, theta, phi, _m, r, *_) = sphere
    sixth, seventh = view.constraints
    assert same(sixth.expression, x.diff() - r * theta.diff() * sin(psi) + r * phi.diff() * sin(theta) * cos(psi))
    assert same(seventh.expression, y.diff() + r * theta.diff() * cos(psi) + r * phi.diff() * sin(theta) * sin(psi))
    assert not sixth.integrable
    assert not seventh.integrable


def test_constraints_are_the_velocity_of_the_contact(sphere):
    scene, view, _ = sphere
    velocity = view.geometry.components(view.kinematic_screw("sphere", point(scene, "I")).moment, scene.frame)
    assert same(velocity[0], view.constraints[0].expression)
    assert same(velocity[1], view.constraints[1].expression)
    assert same(velocity[2], 0)


def test_F_u_and_F_v_vanish(sphere):
    _, view, (*_, F_u, F_v, _N) = sphere
    assert view.reactions == {F_u: 0, F_v: 0} or dict(view.reactions) == {F_u: 0, F_v: 0}
    assert view.ideal_conditions("ground") == []


def test_N_appears_in_no_equation(sphere):
    _, view, (*_, N) = sphere
    assert view.undetermined == (N,)
    with pytest.raises(da.errors.ConstraintError, match=r"'N' appears in no equation.*release"):
        view.reactions["N"]


def test_z_released_gives_N(sphere):
    scene, view, symbols = sphere
    z = sp.Function("z")(TIME)
    wider = scene.release(z, point(scene, "G"), scene.frame.z)
    released = da.lagrange(wider)
    m, r, g, N = symbols_of(wider, "m r g N")
    assert same(released.constraints[0].expression, z - r)
    equation = released.equation(z)
    assert same(equation.lhs, m * z.diff(TIME, 2))
    assert same(equation.rhs, N - m * g)
    for q in symbols[:5]:
        assert same(released.equation(q).lhs, view.equation(q).lhs)
        assert same(released.equation(q).rhs, view.equation(q).rhs)
    assert same(released.reactions["N"], m * g)
