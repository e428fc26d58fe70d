"""Loops are assembled from rough guesses, or the error says what stays open; wrong starts name the nearest one."""

import math

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import InitialStateError, UnknownNameError
from hard_cases import hard_case
from hard_cases.loops import ANDREWS_START, slider_crank_scene


@pytest.fixture(scope="module")
def crank():
    return da.compile_model(slider_crank_scene(), backend="numpy")


@pytest.fixture(scope="module")
def lengths():
    return dict(hard_case("slider-crank").parameters)


def closed(values, p):
    """Return the gap of the slider-crank's loop."""
    x = p["r"] * math.cos(values["phi"]) + p["l"] * math.cos(values["beta"]) - values["s"]
    y = p["r"] * math.sin(values["phi"]) - p["l"] * math.sin(values["beta"])
    return math.hypot(x, y)


def radius(model, at, p):
    """Return the radius of gyration of a crank at coordinates, the unit of lengths beside angles."""
    mass = np.diag(model.mass_matrix([at["phi"], at["beta"], at["s"]], model.parameter_vector(p)))
    return math.sqrt((mass[0] + mass[1]) / mass[2])


@pytest.mark.parametrize("phi", np.linspace(-3, 3, 7))
@pytest.mark.parametrize("beta", [-0.4, 0.0, 0.4])
def test_a_crank_angle_is_kept_and_the_loop_closes(crank, lengths, phi, beta):
    found = crank.assemble({"phi": phi, "beta": beta, "s": 0.5}, lengths, fixed=["phi"])
    assert found["phi"] == phi
    assert closed(found, lengths) < 1e-15
    assert found["beta"] == pytest.approx(math.asin(lengths["r"] * math.sin(phi) / lengths["l"]), abs=1e-14)


def test_both_ways_of_assembling_are_found_from_where_they_are_near(crank, lengths):
    values = [crank.assemble({"phi": 1.0, "beta": b, "s": s}, lengths, fixed=["phi"]) for b, s in ((0, 0.5), (3, -0.3))]
    assert values[0]["s"] > 0 > values[1]["s"]
    assert max(closed(v, lengths) for v in values) < 1e-15


def test_without_fixed_values_the_nearest_position_is_found(crank, lengths):
    guess = {"phi": 0.9, "beta": 0.25, "s": 0.51}
    found, unit = crank.assemble(guess, lengths), radius(crank, guess, lengths)

    def away(other):
        return math.hypot(other["phi"] - 0.9, other["beta"] - 0.25, (other["s"] - 0.51) / unit)

    near = (crank.assemble({**guess, "phi": found["phi"] + d}, lengths, fixed=["phi"]) for d in (-1e-4, 1e-4))
    assert all(away(found) < away(other) for other in near)


def test_rates_follow_and_symbols_serve_as_names(crank, lengths):
    phi, beta, s = dynamicsymbols("phi beta s")
    found = crank.assemble({phi: 1.0, beta: 0, s: 0.5, phi.diff(): 3.0}, lengths, fixed=[phi, phi.diff()])
    assert found["phi_dot"] == 3.0
    expected = lengths["r"] * math.cos(1.0) * 3.0 / (lengths["l"] * math.cos(found["beta"]))
    assert found["beta_dot"] == pytest.approx(expected, rel=1e-14)
    run = crank.simulate((0, 0.1), found, lengths)
    assert run.success


def test_contradicting_rates_are_moved_as_little_as_needed(crank, lengths):
    start = crank.assemble({"phi": 1.0, "beta": 0, "s": 0.5}, lengths, fixed=["phi"])
    guess = {**start, "phi_dot": 1.0, "beta_dot": 0.0, "s_dot": 0.0}
    found = crank.assemble(guess, lengths)
    rates = ("phi_dot", "beta_dot", "s_dot")
    direction = np.array([found[name] for name in rates])
    change = (direction - [guess[name] for name in rates]) / [1.0, 1.0, radius(crank, start, lengths) ** 2]
    assert abs(direction @ change) < 1e-14  # the motion is one-dimensional: the nearest rate is the foot on its line


def test_andrews_mechanism_from_a_rough_guess():
    case = hard_case("Andrews' squeezing mechanism")
    model = da.compile_model(case.scene, backend="numpy")
    guess = {**dict.fromkeys(ANDREWS_START, 0.5), "be": ANDREWS_START["be"]}
    found = model.assemble(guess, case.parameters, fixed=["be"])
    assert max(abs(found[name] - value) for name, value in ANDREWS_START.items()) < 1e-14


def test_redundant_loops_are_assembled():
    case = hard_case("four-bar with redundant bars")
    model = da.compile_model(case.scene, backend="numpy", formulation="augmented")
    guess = {"phi0": 0.5, "phi1": 0.4, "phi2": 0.6, "psi0": 0.1, "phi0_dot": 1.0}
    found = model.assemble(guess, case.parameters, fixed=["phi0"])
    expected = {"phi0": 0.5, "phi1": 0.5, "phi2": 0.5, "psi0": 0.0, "phi0_dot": 1.0, "phi1_dot": 1.0}
    assert all(abs(found[name] - value) < 1e-12 for name, value in expected.items())


def test_constraints_that_depend_on_time():
    """A particle on a line that moves."""
    x, y = dynamicsymbols("x y")
    v = symbols("v")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("moving_line", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", O.locatenew("P", x * N.x + y * N.y), 1))
    scene.add_holonomic_constraints(x + y - v * dynamicsymbols._t)
    model = da.compile_model(scene, backend="numpy", formulation="projected")
    found = model.assemble({"x": 0, "y": 0, "x_dot": 0, "y_dot": 0}, {"v": 2.0}, t=3.0)
    assert found == pytest.approx({"x": 3.0, "y": 3.0, "x_dot": 1.0, "y_dot": 1.0}, abs=1e-14)


class TestErrors:
    def test_a_loop_that_cannot_close_says_what_stays_open(self, crank, lengths):
        with pytest.raises(InitialStateError) as error:
            crank.assemble({"phi": 1.5, "beta": 0.3, "s": 0.3}, {**lengths, "l": 0.1}, fixed=["phi"])
        text = str(error.value)
        assert "scene 'slider_crank' cannot be assembled from this guess, with phi fixed" in text
        assert "holonomic constraint 2" in text and "0.0496 is left" in text and "holonomic constraint 1" not in text
        assert "the loops may be unable to close" in text

    def test_a_coordinate_without_a_guess(self, crank, lengths):
        with pytest.raises(InitialStateError, match="a guess is missing for the coordinates beta, s"):
            crank.assemble({"phi": 1.0}, lengths)

    def test_a_fixed_name_that_is_not_given(self, crank, lengths):
        with pytest.raises(UnknownNameError, match="unknown fixed name 'psi'"):
            crank.assemble({"phi": 1.0, "beta": 0, "s": 0.5}, lengths, fixed=["psi"])

    def test_rates_that_are_not_determined(self):
        case = hard_case("knife edge on an incline")
        model = da.compile_model(case.scene, backend="numpy")
        with pytest.raises(InitialStateError, match="a guess is missing for the rates y_dot, phi_dot"):
            model.assemble({"x": 0, "y": 0, "phi": 0.3, "x_dot": 1.0}, case.parameters)

    def test_fixed_rates_that_contradict(self, crank, lengths):
        start = crank.assemble({"phi": 1.0, "beta": 0, "s": 0.5}, lengths, fixed=["phi"])
        guess = {**start, "phi_dot": 1.0, "beta_dot": 0.0, "s_dot": 0.0}
        with pytest.raises(InitialStateError, match="no rates near the guess satisfy the velocity constraints"):
            crank.assemble(guess, lengths, fixed=["phi_dot", "beta_dot", "s_dot"])

    def test_an_inconsistent_start_offers_the_nearest_consistent_one(self, crank, lengths):
        start = {"phi": 0.3, "beta": 0.2, "s": 0.55, "phi_dot": 1.0}
        with pytest.raises(InitialStateError) as error:
            crank.simulate((0, 1), start, lengths)
        found = crank.assemble(start, lengths)
        distance = math.dist(start.values(), [found[name] for name in start])
        assert f"The nearest consistent state is at distance {distance:.3g}" in str(error.value)
        assert f"beta = {found['beta']:.10g}" in str(error.value)
        assert crank.simulate((0, 0.1), found, lengths).success

    def test_where_nothing_near_is_consistent_nothing_is_offered(self):
        """x^2 + y^2 = -c has no solution where c > 0."""
        x, y = dynamicsymbols("x y")
        N, O = ReferenceFrame("N"), Point("O")
        scene = da.Scene("impossible", frame=N, origin=O, coordinates=[x, y])
        scene.add_bodies(Particle("p", O.locatenew("P", x * N.x + y * N.y), 1))
        scene.add_holonomic_constraints(x**2 + y**2 + symbols("c"))
        model = da.compile_model(scene, backend="numpy", formulation="projected")
        start = {"x": 1.0, "y": 0.5, "x_dot": 0.0, "y_dot": 0.0}
        with pytest.raises(InitialStateError, match="contradict the constraints") as error:
            model.simulate((0, 1), start, {"c": 1.0})
        assert "nearest" not in str(error.value)
        with pytest.raises(InitialStateError, match=r"holonomic constraint 1, .*: 1 is left"):
            model.assemble(start, {"c": 1.0})
