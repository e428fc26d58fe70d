"""Numbers that contradict what their symbols were declared to be: SymPy has simplified the scene with that."""

import functools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import AssumptionWarning, SceneError, ValueInputError
from dalembert.methods.status import Status

START = {"x": 1.0, "x_dot": 0.0}


def spring(x=None, stiffness=None, further=0):
    """A particle on a spring of stiffness sqrt(k**2), which SymPy makes k where k is positive."""
    x = dynamicsymbols("x") if x is None else x
    k = sp.Symbol("k", positive=True) if stiffness is None else stiffness
    N, O = ReferenceFrame("N"), Point("O")
    scene, P = da.Scene("spring", frame=N, origin=O, coordinates=[x]), O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("bead", P, sp.Symbol("m", positive=True)))
    scene.add_loads((P, (further - sp.sqrt(k**2) * x) * N.x))
    return scene


@functools.cache
def model(backend="numpy"):
    return da.compile_model(spring(), backend=backend)


WAYS = {
    "simulate": lambda p: model().simulate((0, 1), START, p),
    "state": lambda p: model().state(START, p),
    "parameter_vector": lambda p: model().parameter_vector(p),
    "kernels by name": lambda p: model().mass_matrix([1.0], p),
    "kernels by array": lambda p: model().accelerations(0.0, [1.0], [0.0], [p["k"], p["m"]]),
    "linearize": lambda p: model().linearize(0.0, START, p),
    "sensitivity": lambda p: model().sensitivity((0, 1), START, p, wrt=["k"]),
    "sweep of one value": lambda p: model().sweep((0, 1), START, {**p, "m": np.ones(3)}),
}


@pytest.mark.parametrize("way", WAYS)
def test_parameters_that_contradict_their_symbols_are_named_with_a_remedy(way):
    with pytest.raises(ValueInputError) as caught:
        WAYS[way]({"m": 1.0, "k": -2.0})
    text = str(caught.value)
    assert "k = -2 contradicts positive=True" in text and "real=True" in text and "m =" not in text


def test_zero_is_the_limit_of_what_is_positive():
    assert model().simulate((0, 1), START, {"m": 1.0, "k": 0.0})["x"][-1] == 1.0


def test_what_rounding_leaves_of_zero_starts_a_motion_but_is_no_parameter():
    made, p = da.compile_model(spring(dynamicsymbols("x", positive=True)), backend="numpy"), {"m": 1.0, "k": 1.0}
    start = {"x": -1e-17, "x_dot": 1.0}
    np.testing.assert_allclose(made.simulate((0, 1), start, p)["x"][-1], np.sin(1.0), rtol=1e-7)
    assert made.sweep((0, np.array([0.5, 1.0])), start, p).success.all()
    np.testing.assert_allclose(made.forcing(0.0, [-1e-17], [1.0], p), 0.0, atol=1e-16)
    with pytest.raises(ValueInputError, match="k = -1e-17 contradicts"):
        made.parameter_vector({"m": 1.0, "k": -1e-17})


def test_remedy_helps():
    plain = da.compile_model(spring(stiffness=sp.Symbol("k", real=True)), backend="numpy")
    end = plain.simulate((0, 1), START, {"m": 1.0, "k": -2.0})["x"][-1]
    np.testing.assert_allclose(end, np.cos(np.sqrt(2.0)), rtol=1e-7)


@pytest.mark.parametrize(
    ("declared", "good", "bad"),
    [
        ({"nonnegative": True}, 0.0, -1.0),
        ({"negative": True}, -1.0, 1.0),
        ({"nonpositive": True}, 0.0, 1.0),
        ({"integer": True}, -3.0, 2.5),
        ({"even": True}, 4.0, 3.0),
        ({"odd": True}, -3.0, 2.0),
        ({"zero": True}, 0.0, 1.0),
        ({"positive": True, "integer": True}, 2.0, -2.0),
        ({"extended_positive": True}, 2.0, -2.0),
    ],
)
def test_every_declaration_that_excludes_numbers_is_checked(declared, good, bad):
    made = da.compile_model(spring(further=sp.Symbol("c", **declared)), backend="numpy")
    assert made.forcing(0.0, [1.0], [0.0], {"k": 1.0, "m": 1.0, "c": good})[0] == good - 1.0
    what = next(iter(declared)).removeprefix("extended_")
    with pytest.raises(ValueInputError, match=f"c = {bad:g} contradicts {what}=True"):
        made.parameter_vector({"k": 1.0, "m": 1.0, "c": bad})


@pytest.mark.parametrize("declared", [{"imaginary": True}, {"infinite": True, "extended_real": True}])
def test_symbols_that_are_no_real_numbers_are_refused_with_the_scene(declared):
    with pytest.raises(SceneError, match="'c' is declared to be no finite real number"):
        da.compile_model(spring(further=sp.Symbol("c", **declared)), backend="numpy")


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
@pytest.mark.parametrize("t_eval", [None, [0.0, 1.0]])
def test_cases_of_a_sweep_that_contradict_have_a_status_and_spare_their_neighbours(backend, t_eval):
    sweep = model(backend).sweep((0, 1), START, {"m": 1.0, "k": np.array([-1.0, 0.0, 1.0, np.nan])}, t_eval=t_eval)
    assert list(sweep.status) == [Status.ASSUMPTION, Status.SUCCESS, Status.SUCCESS, Status.NON_FINITE]
    assert np.isnan(sweep.final["x"][[0, 3]]).all() and sweep.parameters["k"][0] == -1.0
    np.testing.assert_allclose(sweep.final["x"][1:3], [1.0, np.cos(1.0)], rtol=1e-7)


def test_coordinates_start_and_stay_where_they_were_declared_to_be():
    made = da.compile_model(spring(dynamicsymbols("x", positive=True)), backend="numpy")
    p = {"m": 1.0, "k": 1.0}
    with pytest.raises(ValueInputError, match="x = -1 contradicts positive=True"):
        made.simulate((0, 1), {"x": -1.0, "x_dot": 0.0}, p)
    with pytest.raises(ValueInputError, match="x = -1 contradicts positive=True"):
        made.forcing(0.0, [[1.0], [-1.0]], [0.0], p)
    made.simulate((0, 1), START, p)
    with pytest.warns(AssumptionWarning, match=r"x = -.* the coordinate was declared with positive=True"):
        made.simulate((0, 3), START, p)
    with pytest.warns(AssumptionWarning, match=r"t = 3 \(1 of 2 records\)"):
        made.sweep((0, np.array([1.0, 3.0])), START, p)
