"""Example 13.4.4: the plate that slides on its edge, against every equation printed in the text."""

import numpy as np
import pytest
import sympy as sp
from sympy import cos, sin

import dalembert as da
from textbook.helpers import TIME, frame, point, same, same_vector, symbols_of

PARAMETERS = {"m": 1.2, "A": 0.05, "B": 0.09, "C": 0.14, "h": 0.4, "g": 9.81}


@pytest.fixture(scope="module")
def plate():
    scene = da.scenes.edge_plate()
    return scene, da.lagrange(scene), symbols_of(scene, "x y z psi theta m A B C F h g X Y Z L M N")


def test_constraint_1(plate):
    _, view, (_x, _y, z, _psi, theta, _m, _A, _B, _C, _F, h, *_) = plate
    (constraint,) = view.constraints
    assert constraint.holonomic
    assert same(constraint.expression, z - h * sin(theta))


def test_partial_kinematic_screws_at_H_with_z_imposed(plate):
    """With z = h sin(theta) the screws of the text reduce to velocities of H in the plane."""
    scene, *_ = plate
    z = scene.coordinates[2]
    view = da.lagrange(scene.impose(z))
    N, A, H = scene.frame, frame(scene, "A"), point(scene, "H")
    x, y, psi, theta = view.coordinates
    for q, omega, velocity in ((x, 0 * N.x, N.x), (y, 0 * N.x, N.y), (psi, N.z, None), (theta, A.x, None)):
        screw = view.partial_kinematic_screw("plate", q, H)
        assert same_vector(screw.resultant, omega, N)
        if velocity is not None:
            assert same_vector(screw.moment, velocity, N)
        assert same(screw.moment.dot(N.z), 0)


def test_ideal_conditions(plate):
    _, view, (*_, X, Y, _Z, L, _M, N) = plate
    assert set(view.ideal_conditions("edge")) == {X, Y, L, N}


def test_M_is_undetermined_and_Z_is_not(plate):
    _, view, (*_, Z, _L, M, _N) = plate
    assert view.undetermined == (M,)
    assert Z in view.determined
    assert {str(x): e for x, e in view.reactions.items() if str(x) != "Z"} == {"X": 0, "Y": 0, "L": 0, "N": 0}


def test_partial_kinematic_screws_at_G(plate):
    scene, view, (x, y, z, psi, theta, *_) = plate
    N, A = scene.frame, frame(scene, "A")
    zero = 0 * N.x
    for q, omega, velocity in (
        (x, zero, N.x),
        (y, zero, N.y),
        (z, zero, N.z),
        (psi, N.z, zero),
        (theta, A.x, zero),
    ):
        screw = view.partial_kinematic_screw("plate", q)
        assert same_vector(screw.resultant, omega, N)
        assert same_vector(screw.moment, velocity, N)


def test_partial_kinematic_screws_transported_to_H(plate):
    scene, view, (_x, _y, _z, psi, theta, _m, _A, _B, _C, _F, h, *_) = plate
    N, A, S, H = scene.frame, frame(scene, "A"), frame(scene, "S"), point(scene, "H")
    assert same_vector(view.partial_kinematic_screw("plate", psi, H).moment, h * cos(theta) * A.x, N)
    assert same_vector(view.partial_kinematic_screw("plate", theta, H).moment, -h * S.z, N)


def test_power_coefficients(plate):
    _, view, (x, y, z, psi, theta, m, _A, _B, _C, _F, h, g, _X, _Y, Z, *_) = plate
    printed = {x: 0, y: 0, z: Z - m * g, psi: 0, theta: -h * Z * cos(theta)}
    for q, power in printed.items():
        assert same(view.power_coefficient(q, ideal=True), power)


def test_power_coefficient_is_the_screw_product_at_any_point(plate):
    scene, view, (_x, _y, _z, _psi, theta, *_) = plate
    action, H, G = view.action_screw("edge"), point(scene, "H"), point(scene, "G")
    partial = view.partial_kinematic_screw("plate", theta)
    at_H = action.product(partial.at(H))
    at_G = action.at(G).product(partial)
    assert same(at_H, at_G)
    assert same(at_H, view.power_coefficient(theta))  # gravity has none


def test_kinetic_energy(plate):
    _, view, (x, y, z, psi, theta, m, A, B, C, F, *_) = plate
    printed = m * (x.diff() ** 2 + y.diff() ** 2 + z.diff() ** 2) + A * theta.diff() ** 2
    printed += 2 * F * psi.diff() * theta.diff() * sin(theta)
    printed += psi.diff() ** 2 * (B * sin(theta) ** 2 + C * cos(theta) ** 2)
    assert same(2 * view.kinetic_energy, printed)


def printed_equations(symbols):
    x, y, z, psi, theta, m, A, B, C, F, h, g, _X, _Y, Z, *_ = symbols
    momentum = psi.diff() * (B * sin(theta) ** 2 + C * cos(theta) ** 2) + F * theta.diff() * sin(theta)
    sixth = A * theta.diff(TIME, 2) + F * psi.diff(TIME, 2) * sin(theta)
    sixth -= psi.diff() ** 2 * (B - C) * cos(theta) * sin(theta)
    return {
        2: (x, m * x.diff(TIME, 2), 0),
        3: (y, m * y.diff(TIME, 2), 0),
        4: (z, m * z.diff(TIME, 2), Z - m * g),
        5: (psi, momentum.diff(TIME), 0),
        6: (theta, sixth, -h * Z * cos(theta)),
    }


@pytest.mark.parametrize("number", [2, 3, 4, 5, 6])
def test_equations_2_to_6(plate, number):
    _, view, symbols = plate
    q, left, right = printed_equations(symbols)[number]
    assert same(view.equation(q, ideal=True).lhs, left)
    assert same(view.equation(q, ideal=True).rhs, right)


def test_three_first_integrals_and_energy(plate):
    _, view, (x, y, _z, psi, theta, m, _A, B, C, F, *_) = plate
    found = view.first_integrals
    momentum = psi.diff() * (B * sin(theta) ** 2 + C * cos(theta) ** 2) + F * theta.diff() * sin(theta)
    assert len(found) == 4
    assert same(found[0].expression, m * x.diff())
    assert same(found[1].expression, m * y.diff())
    assert same(found[2].expression, momentum)
    assert found[3].name == "energy"
    assert found.independent == 4


def test_four_coordinate_model_has_no_Z(plate):
    scene, _, (x, y, z, psi, theta, *_) = plate
    imposed = scene.impose(z)
    view = da.lagrange(imposed)
    assert view.coordinates == (x, y, psi, theta)
    assert view.constraints == ()
    assert all("Z" not in {s.name for s in view.equation(q).free_symbols} for q in view.coordinates)
    assert {str(u) for u in view.undetermined} == {"Z", "M"}


def test_four_coordinate_model_moves_as_the_five_coordinate_one(plate):
    scene, view, (_x, _y, z, psi, theta, _m, _A, _B, _C, _F, h, *_) = plate
    reduced = da.lagrange(scene.impose(z))
    for q in (psi, theta):
        assert same(reduced.equations_of_motion[q.diff(TIME, 2)], view.equations_of_motion[q.diff(TIME, 2)])
    height = (h * sin(theta)).diff(TIME, 2).subs(reduced.equations_of_motion)
    assert same(view.equations_of_motion[z.diff(TIME, 2)], height)


def test_released_rotation_about_v_gives_M(plate):
    """The moment that the text leaves unknown holds the edge in the plane."""
    scene, *_ = plate
    A = frame(scene, "A")
    phi = sp.Function("phi")(TIME)
    wider = da.lagrange(scene.release(phi, A, A.y))
    assert wider.undetermined == ()
    s = wider._states.states[0]
    with_M = wider.system.function([wider.system.plain(wider.reactions["M"])])
    expected = wider.system.motion(s.t, s.q, s.v, s.p)[1][[str(x) for x in wider.unknowns].index("M")]
    assert with_M(s.t, s.q, s.v, s.p)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_question_d_released_from_rest(plate, backend):
    """With F = 0 the edge keeps its direction, with F not zero it turns; psi_dot (..) + F theta_dot sin(theta) = 0."""
    model = da.compile_model(plate[0], backend=backend, outputs=["Z"])
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.2, "x_dot": 0, "y_dot": 0, "psi_dot": 0, "theta_dot": 0}
    straight = model.simulate((0, 0.2), start, {**PARAMETERS, "F": 0.0}, rtol=1e-10)
    turning = model.simulate((0, 0.2), start, {**PARAMETERS, "F": 0.03}, rtol=1e-10)
    np.testing.assert_array_equal(straight["psi"], 0.3)
    assert abs(turning["psi"][-1] - 0.3) > 1e-3
    theta, B, C = turning["theta"], PARAMETERS["B"], PARAMETERS["C"]
    momentum = turning["psi_dot"] * (B * np.sin(theta) ** 2 + C * np.cos(theta) ** 2)
    momentum += 0.03 * turning["theta_dot"] * np.sin(theta)
    np.testing.assert_allclose(momentum, 0, atol=1e-9)
    assert np.all(np.diff(straight["theta"]) < 0)
