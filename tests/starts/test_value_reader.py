"""Keys of mappings that are resolved once: what is remembered changes neither values nor refusals."""

import math
from collections import OrderedDict
from types import MappingProxyType

import numpy as np
import pytest
from sympy import Symbol
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.errors import InitialStateError, SingularMassMatrixError, UnknownNameError, ValueInputError
from dalembert.starts.initial_states import _INTERPRETED

START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1.0, "b": 0.3, "I_C": 0.5}


@pytest.fixture
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")


def read(model, given):
    """Return parameters by name, as a model reads them."""
    return dict(zip(model.layout.parameters, model.parameter_vector(given).tolist(), strict=True))


def test_any_order_and_symbols_give_the_same(model):
    expected = model.parameter_vector(PARAMETERS)
    turned = dict(reversed(PARAMETERS.items()))
    symbols = {Symbol(name, positive=True): value for name, value in PARAMETERS.items()}
    for given in (PARAMETERS, turned, symbols, OrderedDict(turned), MappingProxyType(PARAMETERS)) * 2:
        assert model.parameter_vector(given).tolist() == expected.tolist()
    x, theta = dynamicsymbols("x theta")
    mixed = {x: 1.0, "y": 2.0, theta: 3.0, x.diff(): 4.0, theta.diff(): 5.0}
    for _ in range(2):
        assert model.initial_values(mixed) == {"x": 1.0, "y": 2.0, "theta": 3.0, "x_dot": 4.0, "theta_dot": 5.0}


def test_a_wrong_key_after_right_ones_is_refused(model):
    for _ in range(3):
        model.parameter_vector(PARAMETERS)
        with pytest.raises(UnknownNameError, match="unknown parameter 'mass'"):
            model.parameter_vector({**PARAMETERS, "mass": 1.0})
        with pytest.raises(UnknownNameError, match="missing parameters: b"):
            model.parameter_vector({"m": 1.0, "I_C": 0.5})
        with pytest.raises(UnknownNameError, match="'m' is given twice"):
            model.parameter_vector({**PARAMETERS, Symbol("m", positive=True): 2.0})
        with pytest.raises(UnknownNameError, match="unknown initial value 'z'"):
            model.initial_values({**START, "z": 0.0})


def test_a_mapping_that_changes_is_read_anew(model):
    given = dict(PARAMETERS)
    assert read(model, given) == PARAMETERS
    given["b"] = 0.7
    assert read(model, given) == {**PARAMETERS, "b": 0.7}
    del given["b"]
    with pytest.raises(UnknownNameError, match="missing parameters: b"):
        model.parameter_vector(given)
    given["b"], given["m"] = 0.1, given.pop("m")
    assert read(model, given) == {**PARAMETERS, "b": 0.1}


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (math.nan, "b = nan is not finite"),
        (-math.inf, "b = -inf is not finite"),
        ("0.3", "b = '0.3' is not a number"),
        (1j, "b = 1j is not a number"),
        ([0.3, 0.4], "it has shape"),
        (None, "b = None is not a number"),
    ],
)
def test_values_are_checked_every_time(model, value, message):
    for _ in range(2):
        model.parameter_vector(PARAMETERS)
        with pytest.raises(ValueInputError, match=message):
            model.parameter_vector({**PARAMETERS, "b": value})


def test_symbols_exclude_numbers_every_time(model):
    for _ in range(2):
        model.parameter_vector({**PARAMETERS, "m": 0.0})
        with pytest.raises(ValueInputError, match="m = -1 contradicts positive=True"):
            model.parameter_vector({**PARAMETERS, "m": -1.0})


@pytest.mark.parametrize(
    "value", [1, np.int64(1), np.float32(1.0), np.array(1.0), True, Symbol("one") - Symbol("one") + 1]
)
def test_numbers_of_any_kind_are_read(model, value):
    for _ in range(2):
        assert read(model, {**PARAMETERS, "m": value}) == PARAMETERS


def test_whole_numbers_without_end_are_no_numbers(model):
    with pytest.raises(ValueInputError, match="m = 1000"):
        model.parameter_vector({**PARAMETERS, "m": 10**400})
    assert read(model, {**PARAMETERS, "m": 10**20})["m"] == 1e20


def test_only_so_many_tuples_of_keys_are_kept(model):
    for i in range(300):
        with pytest.raises(UnknownNameError):
            model.parameter_vector({**PARAMETERS, f"m{i}": 1.0})
    assert len(model.read_parameters._resolved) <= 64


# -- starts by compiled code --------------------------------------------------------------


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("scene", ["chaplygin_sleigh", "rolling_sphere", "edge_plate"])
def test_compiled_starts_have_the_bits_of_interpreted_ones(scene, formulation):
    model = da.compile_model(da.scenes.ALL[scene](), formulation=formulation)
    rng = np.random.default_rng(4)
    parameters = {name: rng.uniform(0.5, 1.5) for name in model.layout.parameters}
    coordinates = {name: rng.uniform(0.3, 0.9) for name in model.layout.coordinates}
    closed = model.assemble({**coordinates, **dict.fromkeys(model.layout.rates, 0.3)}, parameters)
    values, p = model.initial_values(closed), model.parameter_vector(parameters)
    start = model.derived.quick_start(values)
    assert [start(0.0, values, p) for _ in range(_INTERPRETED)] == [None] * _INTERPRETED
    y, _ = start(0.0, values, p)
    assert np.array_equal(y, model.state(closed, parameters))
    fresh = da.compile_model(da.scenes.ALL[scene](), formulation=formulation)
    runs = [fresh.simulate((0, 0.1), closed, parameters) for _ in range(_INTERPRETED + 2)]
    assert all(np.array_equal(run.y, runs[0].y) for run in runs) and np.array_equal(runs[0].y[0], y)


def test_compiled_starts_refuse_what_interpreted_ones_do():
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    complete = {**START, "y_dot": 0.98 * math.tan(0.2)}
    for _ in range(_INTERPRETED + 2):
        assert model.simulate((0, 0.1), complete, PARAMETERS).success
    for _ in range(2):
        with pytest.raises(InitialStateError, match="the initial rates contradict the constraints"):
            model.simulate((0, 0.1), {**complete, "y_dot": 5.0}, PARAMETERS)
        with pytest.raises((SingularMassMatrixError, ValueInputError)):
            model.simulate((0, 0.1), complete, {**PARAMETERS, "m": 0.0, "I_C": 0.0})
        with pytest.raises(UnknownNameError, match="missing parameters"):
            model.simulate((0, 0.1), complete, {"m": 1.0})


def test_threads_share_compiled_starts():
    from concurrent.futures import ThreadPoolExecutor

    model = da.compile_model(da.scenes.chaplygin_sleigh())
    lengths = np.linspace(0.1, 0.5, 40)

    def end(b):
        return model.simulate((0, 1), START, {**PARAMETERS, "b": float(b)}).y[-1]

    alone = [end(b) for b in lengths]
    with ThreadPoolExecutor(4) as pool:
        assert np.array_equal(list(pool.map(end, lengths)), alone)
