"""Example 13.4.2: a plate on the ground and a corner, against every equation printed in the text."""

import pytest
import sympy as sp
from sympy import cos, cot, sin

import dalembert as da
from textbook.helpers import TIME, frame, point, same, same_vector, symbols_of


@pytest.fixture(scope="module")
def plate():
    scene = da.scenes.corner_plate()
    return scene, da.lagrange(scene), symbols_of(scene, "x theta m l h g F_A N_A N_Q F_Q")


@pytest.fixture(scope="module")
def released():
    scene = da.scenes.corner_plate()
    y = sp.Function("y")(TIME)
    wider = scene.release(y, point(scene, "A"), scene.frame.y)
    return wider, da.lagrange(wider), y, symbols_of(wider, "x theta m l h g F_A N_A N_Q F_Q")


def test_velocity_of_the_mass_centre(plate):
    scene, view, (x, theta, _m, l, *_) = plate
    N, S = scene.frame, frame(scene, "S")
    screw = view.kinematic_screw("plate")
    assert same_vector(screw.moment, x.diff() * N.x + l * theta.diff() * S.y, N)
    assert same_vector(screw.resultant, theta.diff() * N.z, N)


def test_kinetic_energy(plate):
    _, view, (x, theta, m, l, *_) = plate
    printed = m * x.diff() ** 2 - 2 * m * l * x.diff() * theta.diff() * sin(theta)
    printed += sp.Rational(4, 3) * m * l**2 * theta.diff() ** 2
    assert same(2 * view.kinetic_energy, printed)


def test_lagrange_expression_of_x(plate):
    _, view, (x, theta, m, l, *_) = plate
    printed = m * x.diff(TIME, 2) - m * l * theta.diff(TIME, 2) * sin(theta) - m * l * theta.diff() ** 2 * cos(theta)
    assert same(view.lagrange_expression(x), printed)


def test_lagrange_expression_of_theta(plate):
    _, view, (x, theta, m, l, *_) = plate
    printed = sp.Rational(4, 3) * m * l**2 * theta.diff(TIME, 2) - m * l * x.diff(TIME, 2) * sin(theta)
    assert same(view.lagrange_expression(theta), printed)


def test_equation_1(plate):
    _, view, (x, theta, m, l, _h, _g, F_A, _N_A, N_Q, F_Q) = plate
    equation = view.equation(x)
    left = m * x.diff(TIME, 2) - m * l * theta.diff(TIME, 2) * sin(theta) - m * l * theta.diff() ** 2 * cos(theta)
    assert same(equation.lhs, left)
    assert same(equation.rhs, F_A - N_Q * sin(theta) + F_Q * cos(theta))


def test_equation_2(plate):
    _, view, (x, theta, m, l, h, g, _F_A, _N_A, N_Q, _F_Q) = plate
    equation = view.equation(theta)
    left = sp.Rational(4, 3) * m * l**2 * theta.diff(TIME, 2) - m * l * x.diff(TIME, 2) * sin(theta)
    assert same(equation.lhs, left)
    assert same(equation.rhs, -m * g * l * cos(theta) + h / sin(theta) * N_Q)


def test_equation_3(plate):
    _, view, (x, theta, _m, _l, h, *_) = plate
    (constraint,) = view.constraints
    assert constraint.holonomic
    assert same(constraint.expression, x + h * cot(theta))


def test_equation_4_sign_of_friction(plate):
    """Q slips along the plate with x_dot cos(theta): F_Q S.x opposes it when F_Q has the sign of -x_dot cos(theta)."""
    scene, view, (x, theta, _m, _l, h, *_) = plate
    N, S, Q = scene.frame, frame(scene, "S"), point(scene, "Q")
    velocity = view.kinematic_screw("plate", Q).moment
    assert same_vector(velocity, x.diff() * N.x + h / sin(theta) * theta.diff() * S.y, N)
    rate = {theta.diff(): sp.solve((x + h * cot(theta)).diff(TIME), theta.diff())[0]}
    along, across, up = (view.geometry.components(velocity, S)[i].subs(rate) for i in range(3))
    assert same(along, x.diff() * cos(theta))
    assert same(across, 0)
    assert same(up, 0)
    slip = view.geometry.components(view.slip_velocity("corner"), S)
    assert same(slip[0].subs(theta.diff(), rate[theta.diff()]), x.diff() * cos(theta))
    assert same(slip[1], 0)


def test_corner_without_friction_is_ideal_when_F_Q_vanishes(plate):
    _, view, (*_, F_Q) = plate
    assert view.ideal_conditions("corner") == [F_Q]
    assert view.ideal_conditions("ground") == []
    assert [str(x) for x in view.undetermined] == ["N_A"]


def test_released_y_corrects_the_kinetic_energy(plate, released):
    _, view, _ = plate
    _, wider, y, (_x, theta, m, l, *_) = released
    correction = m / 2 * (y.diff() ** 2 + 2 * l * y.diff() * theta.diff() * cos(theta))
    assert same(wider.kinetic_energy - view.kinetic_energy, correction)


def test_released_y_keeps_the_power_coefficients_of_x_and_theta(plate, released):
    _, view, _ = plate
    _, wider, _, (x, theta, *_) = released
    assert same(wider.power_coefficient(x), view.power_coefficient(x))
    assert same(wider.power_coefficient(theta), view.power_coefficient(theta))


def test_equation_of_y(released):
    _, wider, y, (_x, theta, m, l, _h, g, _F_A, N_A, N_Q, F_Q) = released
    equation = wider.equation(y)
    assert same(equation.lhs, m * (y.diff() + l * theta.diff() * cos(theta)).diff(TIME))
    assert same(equation.rhs, N_A + N_Q * cos(theta) + F_Q * sin(theta) - m * g)


def test_N_A_has_the_term_that_the_text_drops(released):
    """With y = 0, N_A = m g - N_Q cos - F_Q sin + m l d/dt(theta_dot cos): the text prints it without the last."""
    _, wider, y, (_x, theta, m, l, _h, g, _F_A, N_A, N_Q, F_Q) = released
    (solved,) = sp.solve(wider.equation(y).subs(y, 0).doit(), N_A)
    complete = m * g - N_Q * cos(theta) - F_Q * sin(theta) + m * l * (theta.diff() * cos(theta)).diff(TIME)
    assert same(solved, complete)
    assert not same(solved, m * g - N_Q * cos(theta) - F_Q * sin(theta))
    motion = {theta.diff(TIME, 2): wider.equations_of_motion[theta.diff(TIME, 2)]}
    known = {N_Q: wider.reactions["N_Q"], F_Q: wider.reactions["F_Q"]}
    assert same(wider.reactions["N_A"], complete.subs(motion).subs(known))


def test_all_reactions_are_determined_with_y_released(released):
    _, wider, *_ = released
    assert wider.undetermined == ()
    assert {str(x) for x in wider.determined} == {"N_A", "N_Q", "F_Q"}
