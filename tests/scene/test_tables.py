"""Tables in SymPy expressions: what they are there, and what is refused."""

import pickle

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, dynamicsymbols

import dalembert as da
from dalembert.errors import ExpressionError, OptionError, SceneError, ValueInputError
from table_cases import CURVES, KNOTS, VALUES, N, O, m, spring, x

t = dynamicsymbols._t


def test_sympy_differentiates_a_table():
    curve = spring("cubic")
    slope = curve.diff(x)
    assert curve.diff(t) == slope * x.diff()
    assert str(curve) == "spring(x(t))" and str(slope) == "spring'(x(t))"
    assert (curve - slope).xreplace({x: sp.Symbol("z")}).free_symbols == {sp.Symbol("z")}
    for q in (-1.9, 0.3, 1.5):
        assert float(curve.subs(x, q)) == pytest.approx(float(CURVES["cubic"](q)), rel=1e-14)
        assert float(slope.subs(x, q)) == pytest.approx(float(CURVES["cubic"](q, 1)), rel=1e-13)
    assert spring("cubic").diff(x, 4) == 0 and spring("hold").diff(x) == 0


def test_equal_numbers_are_the_same_table():
    assert spring("cubic") == spring("cubic")
    assert spring("cubic") != spring("linear")
    other = VALUES.copy()
    other[3] = np.nextafter(other[3], 9.0)
    assert da.table(x, KNOTS, other, name="spring") != spring("linear")
    assert pickle.loads(pickle.dumps(spring("cubic"))) == spring("cubic")


WRONG = [
    (dict(kind="quadratic"), OptionError, "known: linear|known: hold"),
    (dict(extrapolate="nearest"), OptionError, "unknown extrapolate 'nearest'; known: error, hold, linear"),
    (dict(knots=[0.0, 1.0, 1.0, 2.0]), ValueInputError, r"not increasing: knot 1 is 1.0 and knot 2 is 1.0"),
    (dict(knots=[0.0, 2.0, 1.0, 3.0]), ValueInputError, "not increasing"),
    (dict(knots=[0.0, 1.0, np.inf, 3.0]), ValueInputError, "number 2 of the knots is inf"),
    (dict(values=[0.0, np.nan, 0.0, 3.0]), ValueInputError, "number 1 of the values is nan"),
    (dict(values=[0.0, 1.0]), ValueInputError, "4 knots and 2 values"),
    (dict(knots=[[0.0, 1.0], [2.0, 3.0]]), ValueInputError, r"the knots have the shape \(2, 2\)"),
    (dict(values="abc"), ValueInputError, "the values are not numbers"),
    (dict(knots=[0, 1, 2], values=[0, 1, 2], kind="cubic"), ValueInputError, "'cubic' needs 4 or more"),
    (dict(knots=[0], values=[0], kind="linear"), ValueInputError, "'linear' needs 2 or more"),
    (dict(x="x"), ExpressionError, "is not a SymPy expression"),
]


@pytest.mark.parametrize(("wrong", "error", "text"), WRONG, ids=[str(next(iter(row[0].items()))) for row in WRONG])
def test_wrong_input_is_named(wrong, error, text):
    given = dict(x=x, knots=[0.0, 1.0, 2.0, 3.0], values=[0.0, 1.0, 0.0, 1.0]) | wrong
    with pytest.raises(error, match=text) as caught:
        da.table(**given, name="brake")
    assert "'brake'" in str(caught.value)


y = dynamicsymbols("y")


def scene_with(kind, where, extrapolate="error"):
    """Return a scene with a table in a position, a holonomic or a nonholonomic constraint."""
    road = spring(kind, extrapolate, name="road")
    scene = da.Scene("rough", frame=N, origin=O, coordinates=[x] if where == "position" else [x, y])
    Q = O.locatenew("Q", x * N.x + (road if where == "position" else y) * N.y)
    scene.add_bodies(Particle("mass", Q, m))
    if where == "holonomic":
        scene.add_holonomic_constraints(y - road)
    if where == "nonholonomic":
        scene.add_nonholonomic_constraints(y.diff() - road * x.diff())
    return scene


@pytest.mark.parametrize("where", ["position", "holonomic"])
@pytest.mark.parametrize(("kind", "extrapolate"), [("linear", "error"), ("hold", "error"), ("cubic", "hold")])
def test_positions_need_two_derivatives(kind, extrapolate, where):
    with pytest.raises(SceneError, match=r"table 'road' .* positions need two derivatives; use\s+kind=\"cubic\""):
        da.compile_model(scene_with(kind, where, extrapolate), backend="numpy")


def test_constraints_on_velocities_need_one_derivative():
    with pytest.raises(SceneError, match="the table 'road' jumps at knots, and velocities need a derivative"):
        da.compile_model(scene_with("hold", "nonholonomic"), backend="numpy")
    for kind in ("linear", "cubic"):
        da.compile_model(scene_with(kind, "nonholonomic"), backend="numpy")


def test_a_number_outside_of_the_knots_is_a_fault():
    scene = da.Scene("constant", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, spring("linear", argument=sp.Integer(3)) * N.x))
    with pytest.raises(SceneError, match=r"spring\(3\) is outside of the knots .* from -2 to 2"):
        da.compile_model(scene, backend="numpy")


def test_the_textbook_view_shows_the_table_as_a_function():
    view = da.lagrange(scene_with("cubic", "holonomic"))
    accelerations = view.equations_of_motion
    assert "road'(x)" in str(view) and "road''(x)*x'**2" in str(view)
    model = da.compile_model(scene_with("cubic", "holonomic"), backend="numpy")
    q, height = 0.4, float(CURVES["cubic"](0.4))
    slope = float(CURVES["cubic"](q, 1))
    found = model.accelerations(0.0, [q, height], [1.5, 1.5 * slope], {m: 2.0})
    expected = [float(sp.sympify(e).subs(x.diff(), 1.5).subs(x, q).evalf()) for e in accelerations.values()]
    assert found == pytest.approx(expected, rel=1e-12)
