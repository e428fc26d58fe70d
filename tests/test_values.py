"""What is a number and what only looks like one, in every place that takes numbers."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
import xarray

import dalembert as da
from dalembert.errors import DalembertError, OptionError, ValueInputError
from dalembert.values import array_of, number, whole

P = {"m": 1.0, "b": 0.3, "I_C": 0.5}
START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}


class Quantity:
    """A number with a unit, as packages for units have them."""

    magnitude, units = 3.0, "gram"

    def __float__(self):
        return 3.0

    def __array__(self, dtype=None, copy=None):
        return np.array(3.0, dtype)


NUMBERS = [1, True, 1.0, np.int8(1), np.float32(1), np.array(1), Decimal(1), Fraction(1, 1), sp.Integer(1), sp.exp(0)]
NUMBERS += [xarray.DataArray(1.0), np.longdouble(1)]
WRONG = ["1.0", b"1", np.array("1.0"), 1j, np.complex128(1), np.array(1 + 0j), np.timedelta64(1, "s"), None, {}, {1.0}]
WRONG += [np.datetime64("2026-01-01"), np.ma.masked, Quantity(), 10**400, sp.Symbol("z"), lambda: 1.0, (x for x in "1")]
ARRAYS = [[1, 2], (1, 2), range(1, 3), np.array([1, sp.Integer(2)], object), xarray.DataArray([1, 2])]
NO_ARRAYS = [["1", "2"], [1, 2j], np.array([1, 2], "m8[s]"), [1, None], [[1], [1, 2]], {1.0, 2.0}, [1, "2"]]
NO_ARRAYS += [np.ma.array([1.0, 2.0], mask=[0, 1]), np.array([1, 2j]), np.array([1, "2"], object)]


@pytest.mark.parametrize("value", NUMBERS, ids=repr)
def test_numbers(value):
    assert number(value) == 1.0 and type(number(value)) is float


@pytest.mark.parametrize("value", WRONG, ids=lambda value: type(value).__name__)
def test_no_numbers(value):
    with pytest.raises(ValueError, match=r"is not a|has units|has masked"):
        number(value)


@pytest.mark.parametrize("value", ARRAYS, ids=repr)
def test_arrays(value):
    np.testing.assert_array_equal(array_of(value), [1.0, 2.0])


@pytest.mark.parametrize("value", NO_ARRAYS, ids=repr)
def test_no_arrays(value):
    with pytest.raises(ValueError, match=r"is not an? |has masked"):
        array_of(value)


def test_whole_numbers():
    assert whole("max_steps", 1e6) == 1_000_000
    for wrong in (np.inf, np.nan, 2.5, "3", None):
        with pytest.raises(OptionError, match="max_steps must be a"):
            whole("max_steps", wrong)


@pytest.fixture(scope="module")
def sleigh():
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")


@pytest.mark.parametrize("wrong", ["1e-8", None, [1.0, 2.0], 1j], ids=repr)
@pytest.mark.parametrize("name", ["rtol", "atol", "max_step", "max_steps"])
def test_options_that_are_no_numbers(sleigh, name, wrong):
    for run in (sleigh.simulate, sleigh.sweep):
        with pytest.raises(OptionError, match=rf"{name} must be a number, not "):
            run((0, 0.1), START, P, **{name: wrong})
    with pytest.raises(OptionError, match=rf"{name} must be a number, not "):
        sleigh.prepare((0, 1), **{name: wrong})


@pytest.mark.parametrize("wrong", ["a", ["a"], [[1.0], [1.0, 2.0]], {0.05}, [0.05, 1j]], ids=repr)
def test_times_that_are_no_numbers(sleigh, wrong):
    run = sleigh.simulate((0, 0.1), START, P)
    calls = [lambda: run(wrong), lambda: sleigh.forcing(wrong, [0, 0, 0], [0, 0, 0], P)]
    calls += [lambda f=f: f((0, 0.1), START, P, t_eval=wrong) for f in (sleigh.simulate, sleigh.sweep)]
    for call in calls:
        with pytest.raises(ValueInputError, match=r"^t(_eval)? = .* is not an? "):
            call()


def test_times_are_one_or_a_list(sleigh):
    run = sleigh.simulate((0, 0.1), START, P)
    for call in (lambda t: run(t), lambda t: sleigh.forcing(t, [0, 0, 0], [0, 0, 0], P)):
        with pytest.raises(ValueInputError, match=r"^t has shape \(1, 2\)"):
            call([[0.0, 0.1]])


def test_columns_and_axes_that_are_no_numbers(sleigh):
    for wrong, why in (("0.3", "not a number"), (["0.3"], "not an array"), ([[0.3]], "shape")):
        with pytest.raises(ValueInputError, match=rf"^b .*{why}"):
            sleigh.sweep((0, 0.1), START, {**P, "b": wrong})
    assert len(sleigh.sweep((0, 0.1), START, {**P, "b": []})) == 0
    for wrong in ("abc", ["a"], [1j], {0.3}):
        with pytest.raises(ValueInputError, match=r"axes of a grid .*b = "):
            da.grid(b=wrong)
    with pytest.raises(ValueInputError, match=r"grid must be made by dalembert\.grid"):
        sleigh.sweep((0, 0.1), START, {"m": 1, "I_C": 0.5}, grid={"b": [0.1, 0.2]})


def test_states_that_are_no_numbers(sleigh):
    for call in (
        lambda: sleigh.mass_matrix([0, 0, "a"], P),
        lambda: sleigh.expand(0, START, P),
        lambda: sleigh.expand(0, [0.0], P),
        lambda: sleigh.state(START, P, t="a"),
        lambda: sleigh.linearize("a", START, P),
        lambda: sleigh.assemble(START, P, t="a"),
        lambda: sleigh.simulate(("0", "1"), START, P),
    ):
        with pytest.raises(DalembertError):
            call()
    np.testing.assert_array_equal(sleigh.expand(0, sleigh.state(START, P).tolist(), P)[:3], [0.0, 0.0, 0.2])
