"""Example 13.4.6: the Chaplygin sleigh, against every equation printed in the text; remarks 13.4.8 and 13.4.9."""

import pytest
import sympy as sp
from sympy import cos, sin, tan

import dalembert as da
from dalembert.textbook import lagrange_operator
from textbook.helpers import TIME, frame, point, same, same_vector, symbols_of


@pytest.fixture(scope="module")
def sleigh():
    scene = da.scenes.chaplygin_sleigh()
    return scene, da.lagrange(scene), symbols_of(scene, "x y theta m b I_C X Y N")


def on_constraint(expression, x, y, theta):
    return expression.subs(y.diff(), x.diff() * tan(theta))


def test_constraint_1_is_not_integrable(sleigh):
    _, view, (x, y, theta, *_) = sleigh
    (constraint,) = view.constraints
    assert same(constraint.expression, -x.diff() * sin(theta) + y.diff() * cos(theta))
    assert not constraint.holonomic
    assert not constraint.integrable
    assert same(constraint.obstruction**2, 1)  # a . curl a = -1 or 1, as the variables are ordered


def test_kinematic_screw(sleigh):
    scene, view, (x, y, theta, *_) = sleigh
    N, C = scene.frame, point(scene, "C")
    screw = view.kinematic_screw("sleigh", C)
    assert same_vector(screw.resultant, theta.diff() * N.z, N)
    assert same_vector(screw.moment, x.diff() * N.x + y.diff() * N.y, N)


def test_equations_2_and_3(sleigh):
    _, view, (_x, _y, theta, _m, _b, _I_C, X, Y, N) = sleigh
    conditions = view.ideal_conditions("blade")
    assert len(conditions) == 2
    assert N in conditions
    assert any(same(e, X * cos(theta) + Y * sin(theta)) for e in conditions)


def test_partial_kinematic_screws(sleigh):
    scene, view, (x, y, theta, *_) = sleigh
    N, C = scene.frame, point(scene, "C")
    zero = 0 * N.x
    for q, omega, velocity in ((x, zero, N.x), (y, zero, N.y), (theta, N.z, zero)):
        screw = view.partial_kinematic_screw("sleigh", q, C)
        assert same_vector(screw.resultant, omega, N)
        assert same_vector(screw.moment, velocity, N)


def printed_energy(x, y, theta, m, b, I_C):
    cross = 2 * m * b * theta.diff() * (-x.diff() * sin(theta) + y.diff() * cos(theta))
    return (m * (x.diff() ** 2 + y.diff() ** 2) + cross + I_C * theta.diff() ** 2) / 2


def test_kinetic_energy(sleigh):
    _, view, symbols = sleigh
    assert same(view.kinetic_energy, printed_energy(*symbols[:6]))


def test_equation_4(sleigh):
    _, view, (x, _y, theta, m, b, _I_C, X, *_) = sleigh
    assert same(view.equation(x).lhs, m * (x.diff() - b * theta.diff() * sin(theta)).diff(TIME))
    assert same(view.equation(x).rhs, X)


def test_equation_5(sleigh):
    _, view, (_x, y, theta, m, b, _I_C, _X, Y, _N) = sleigh
    assert same(view.equation(y).lhs, m * (y.diff() + b * theta.diff() * cos(theta)).diff(TIME))
    assert same(view.equation(y).rhs, Y)


def test_equation_6(sleigh):
    _, view, (x, y, theta, m, b, I_C, _X, _Y, N) = sleigh
    left = I_C * theta.diff(TIME, 2) + m * b * (-x.diff(TIME, 2) * sin(theta) + y.diff(TIME, 2) * cos(theta))
    assert same(view.equation(theta).lhs, left)
    assert same(view.equation(theta).rhs, N)


def test_final_equations_of_motion(sleigh):
    _, view, (x, y, theta, m, b, I_C, *_) = sleigh
    found = {a: on_constraint(e, x, y, theta) for a, e in view.equations_of_motion.items()}
    spin = theta.diff()
    assert same(found[x.diff(TIME, 2)], b * spin**2 * cos(theta) - x.diff() * spin * tan(theta))
    assert same(found[y.diff(TIME, 2)], b * spin**2 * sin(theta) + x.diff() * spin)
    printed = -m * b * spin * (x.diff() * cos(theta) + y.diff() * sin(theta)) / I_C
    assert same(found[theta.diff(TIME, 2)], on_constraint(printed, x, y, theta))


def test_reactions_as_functions_of_the_state(sleigh):
    _, view, (x, y, theta, m, b, I_C, X, Y, N) = sleigh
    across = m * (x.diff() * cos(theta) + y.diff() * sin(theta)) * theta.diff() * (1 - m * b**2 / I_C)
    assert same(view.reactions[X], -across * sin(theta))
    assert same(view.reactions["Y"], across * cos(theta))
    assert view.reactions[N] == 0
    assert view.determined == (X, Y, N)
    assert same(view.reactions[X] * cos(theta) + view.reactions[Y] * sin(theta), 0)
    motion = view.equations_of_motion
    for q, unknown in ((x, X), (y, Y), (theta, N)):
        assert same(view.equation(q).lhs.subs(motion), view.reactions[unknown])


# -- remark 13.4.8 ------------------------------------------------------------------------------


def simplified(x, y, theta, m, _b, I_C):
    """The kinetic energy with constraint (1) used in it: right in value, wrong to differentiate."""
    return (m * (x.diff() ** 2 + y.diff() ** 2) + I_C * theta.diff() ** 2) / 2


def test_remark_13_4_8_a_simplified_kinetic_energy_is_refused(sleigh):
    scene, _, symbols = sleigh
    with pytest.raises(da.errors.SceneError) as caught:
        da.lagrange(scene, kinetic_energy=simplified(*symbols[:6]))
    message = str(caught.value)
    assert "only where the constraints hold" in message
    assert "13.4.8" in message
    assert "-sin(theta)*x' + cos(theta)*y' = 0" in message


def test_remark_13_4_8_erroneous_equations_would_follow(sleigh):
    """The screws and the energy of the remark give x'' = cos (X cos + Y sin), ... = 0, which is not the motion."""
    scene, view, (x, y, theta, m, b, I_C, X, _Y, N) = sleigh
    C, S = point(scene, "C"), frame(scene, "S")
    T = simplified(x, y, theta, m, b, I_C)
    action = view.action_screw("blade")
    along = view.geometry.dot(action.resultant, S.x)  # power in the wrong partial velocities cos S.x and sin S.x
    wrong = {
        x: (m * x.diff(TIME, 2), cos(theta) * along),
        y: (m * y.diff(TIME, 2), sin(theta) * along),
        theta: (I_C * theta.diff(TIME, 2), N),
    }
    condition = sp.solve(view.ideal_conditions("blade"), [X, N], dict=True)[0]
    for q, (left, right) in wrong.items():
        assert same(lagrange_operator(T, q), left)
        assert same(right.subs(condition), 0)
    assert action.point is C
    true = {a: on_constraint(e, x, y, theta) for a, e in view.equations_of_motion.items()}
    assert not same(true[x.diff(TIME, 2)], 0)
    assert not same(true[theta.diff(TIME, 2)], 0)


def test_remark_13_4_8_a_wrong_kinetic_energy_is_refused(sleigh):
    scene, _, (x, y, theta, m, b, I_C, *_) = sleigh
    wrong = printed_energy(x, y, theta, m, b, I_C) + m * x.diff() ** 2
    with pytest.raises(da.errors.SceneError, match=r"not that of the scene: it exceeds it by m\*x'\*\*2"):
        da.lagrange(scene, kinetic_energy=wrong)
    strange = sp.Function("w")(TIME)
    with pytest.raises(da.errors.SceneError, match=r"contains w\(t\), which is no coordinate"):
        da.lagrange(scene, kinetic_energy=wrong + strange.diff())


def test_remark_13_4_8_the_right_kinetic_energy_is_taken(sleigh):
    scene, _, symbols = sleigh
    given = printed_energy(*symbols[:6])
    assert da.lagrange(scene, kinetic_energy=given).kinetic_energy == given


# -- remark 13.4.9 and section 13.6 --------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(da.scenes.ALL))
def test_remark_13_4_9_multipliers_and_maggi_agree(name):
    """The equations with multipliers and the reduced ones hold for the same accelerations, identically."""
    view = da.lagrange(da.scenes.ALL[name]())
    motion, multipliers = view.equations_of_motion, view.multipliers
    assert len(multipliers) == len(view.constraints)
    maggi = view.maggi_equations()
    assert len(maggi) == len(view.coordinates) - len(view.constraints)
    for equation in maggi:
        assert same((equation.lhs - equation.rhs).subs(motion), 0)
    for equation in view.multiplier_equations():
        assert same((equation.lhs - equation.rhs).subs(motion).subs(multipliers), 0)


def test_multiplier_of_the_sleigh_is_the_force_across_the_blade(sleigh):
    _, view, (_x, _y, theta, _m, _b, _I_C, X, Y, _N) = sleigh
    (multiplier,) = view.multipliers.values()
    assert same(multiplier, -view.reactions[X] * sin(theta) + view.reactions[Y] * cos(theta))
