"""Labelled arrays: what they say of their run, units, and files that keep all of it."""

import json
import warnings
from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError
from dalembert.methods.status import Status

xarray = pytest.importorskip("xarray")

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1, "b": 0.3, "I_C": 0.5}
BELT = {"m": 1, "k": 10, "v_b": 0.2, "mu": 0.2, "mu_s": 0.3, "g": 9.81}
UNITS = {dynamicsymbols("x"): "m", "theta_dot": "rad/s", "X": "N", "m": "kg", "b": "m"}


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", cache=False, outputs=["X"])


@pytest.fixture(scope="module")
def results(model):
    """Return a function of a kind, of a result of that kind as labelled arrays with units."""
    options = {"rtol": 1e-7, "atol": 1e-9}

    @cache
    def of(kind):
        match kind:
            case "trajectory":
                return model.simulate((0, 1), START, P, **options).to_xarray(UNITS)
            case "sweep":
                swept = model.sweep((0, 1), START, {**P, "b": [0.1, 0.2]}, t_eval=[0.5, 1], **options)
                return swept.to_xarray(UNITS)
            case "grid":
                axes = da.grid(b=[0.2, 0.3], theta_dot=[1.0, 2.0, 3.0])
                begin = {name: value for name, value in START.items() if name != "theta_dot"}
                slow = da.first_crossing(dynamicsymbols("theta").diff() - 1, direction=-1)
                inertia = {"m": 1, "I_C": 0.5}
                swept = model.sweep((0, 1), begin, inertia, grid=axes, reduce={"slow": slow}, **options)
                return swept.to_xarray(UNITS)
            case "contacts":
                belt = da.compile_model(da.scenes.belt_oscillator(), backend="numpy", cache=False)
                run = belt.simulate((0, 2), {"x": 0, "x_dot": 0}, BELT, **options)
                return run.to_xarray({"x": "m", "k": "N/m"})

    return of


KINDS = ("trajectory", "sweep", "grid", "contacts")


@pytest.mark.parametrize("kind", KINDS)
def test_attributes_say_how_the_values_were_computed(results, kind):
    attributes = results(kind).attrs
    assert attributes["rtol"] == 1e-7 and attributes["atol"] == 1e-9
    assert attributes["dalembert_version"] == da.__version__
    assert {"scene", "formulation", "method"} <= attributes.keys()
    wanted = {"trajectory": P, "sweep": {"m": 1, "I_C": 0.5}, "grid": {"m": 1, "I_C": 0.5}, "contacts": BELT}
    assert json.loads(attributes["parameters"]) == wanted[kind]


def test_tables_of_pandas_have_a_row_each(model):
    run = model.simulate((0, 1), START, P, rtol=1e-7)
    table = run.to_dataframe()
    np.testing.assert_array_equal(table["x"], run["x"])
    np.testing.assert_array_equal(table.index, run.t)
    sweep = model.sweep((0, 1), START, {**P, "b": [0.1, 0.2]}, t_eval=[0.5, 1], rtol=1e-7)
    table = sweep.to_dataframe()
    assert table.index.names == ["case", "time"] and table.shape[0] == 4
    np.testing.assert_array_equal(table["x"].loc[1], sweep["x"][1])


def test_units_are_on_what_they_are_of(results):
    run, sweep, grid = map(results, ("trajectory", "sweep", "grid"))
    assert run["x"].units == grid["x"].units == "m" and run["X"].units == "N" and run["time"].units == "s"
    assert "units" not in run["y"].attrs
    assert json.loads(run.attrs["parameter_units"]) == {"m": "kg", "b": "m"}
    assert sweep["b"].units == grid["b"].units == "m" and json.loads(grid.attrs["parameter_units"]) == {"m": "kg"}
    assert grid["theta_dot"].units == grid["theta_dot_value"].units == "rad/s"


@pytest.mark.parametrize("kind", ["sweep", "grid"])
def test_the_numbers_of_statuses_are_named(results, kind):
    status = results(kind)["status"]
    meanings = dict(zip(status.attrs["flag_values"], status.attrs["flag_meanings"].split(), strict=True))
    assert meanings == {kind.value: kind.name for kind in Status}
    assert {meanings[int(number)] for number in np.unique(status)} == {"SUCCESS"}


def test_units_of_what_is_not_there(model):
    run = model.simulate((0, 1), START, P)
    with pytest.raises(UnknownNameError, match=r"unknown variable 'theta_dt'\. Did you mean 'theta_dot'"):
        run.to_xarray({"theta_dt": "rad/s"})
    with pytest.raises(OptionError, match="units must map names"):
        run.to_xarray({"x": 1.0})
    with pytest.raises(OptionError, match="units must map names"):
        run.to_xarray("m")


@pytest.fixture(scope="module")
def taken():
    """A scene whose coordinates, outputs and parameters have names that a data set has itself."""
    time, status = dynamicsymbols("time status")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", time * N.x + status * N.y)
    scene = da.Scene("taken", frame=N, origin=O, coordinates=[time, status])
    mass, stiffness = sp.symbols("steps t_end", positive=True)
    scene.add_bodies(Particle("P", P, mass))
    scene.add_loads((P, -stiffness * time * N.x))
    outputs = {"case": 2 * time, "time_value": 3 * time}
    return da.compile_model(scene, outputs=outputs, backend="numpy", cache=False)


RATES = {"time_dot": 0, "status_dot": 1}
NEW = {"time": "time_value", "status": "status_value", "case": "case_value", "time_value": "time_value_value"}


def test_names_that_a_data_set_has_itself(taken):
    units = {"time": "m", "t_end": "N/m"}
    run = taken.simulate((0, 1), {**RATES, "time": 1, "status": 0}, {"steps": 1, "t_end": 2}, t_eval=[0, 0.5, 1])
    cases = {**RATES, "status": 0, "time": [1, 2]}, {"steps": 1, "t_end": [1, 2]}
    for found in (run, taken.sweep((0, 1), *cases), taken.sweep((0, 1), *cases, t_eval=[0, 0.5, 1])):
        labelled = found.to_xarray(units)
        for name, new in NEW.items():
            np.testing.assert_array_equal(labelled[new], found[name])
        assert labelled["time_value"].units == "m"
        if "time" in labelled:
            np.testing.assert_array_equal(labelled["time"], [0, 0.5, 1])
            assert labelled["time"].units == "s"
        if found is not run:
            np.testing.assert_array_equal(labelled["time_given"], [1, 2])
            np.testing.assert_array_equal(labelled["t_end_given"], [1, 2])
            np.testing.assert_array_equal(labelled["t_end"], [1, 1])
            assert labelled["t_end_given"].units == "N/m" and "units" not in labelled["t_end"].attrs


@pytest.mark.parametrize("samples", [None, [0.5, 1]])
def test_axes_of_names_that_a_data_set_has_itself(taken, samples, tmp_path):
    """In a store as in memory."""
    pytest.importorskip("zarr")
    options = {"grid": da.grid(time=[1.0, 2.0], t_end=[1.0, 2.0, 3.0], status=[0.0, 1.0]), "t_eval": samples}
    sweep = taken.sweep((0, 1), RATES, {"steps": 1}, **options)
    labelled = sweep.to_xarray()
    stored = taken.sweep((0, 1), RATES, {"steps": 1}, **options, to=tmp_path / "s.zarr", chunk=1)
    dims = ("time_given", "t_end_given", "status_given", *(("time",) if samples else ()))
    for data in (labelled, stored):
        assert data["time_value"].dims == dims and set(data.coords) == set(dims)
        for name, new in NEW.items():
            np.testing.assert_array_equal(data[new].to_numpy().ravel(), sweep[name].ravel())
    assert list(stored.data_vars) == list(labelled.data_vars)
    xarray.testing.assert_equal(stored, labelled)


def _same(loaded, saved):
    """Whether a data set is the same, whatever whole numbers and attributes of numbers a file has."""
    assert set(loaded.variables) == set(saved.variables)
    for name in saved.variables:
        np.testing.assert_array_equal(loaded[name].to_numpy(), saved[name].to_numpy(), err_msg=str(name))
        assert loaded[name].attrs.get("units") == saved[name].attrs.get("units")
    assert {name: str(value) for name, value in loaded.attrs.items()} == {
        name: str(value) for name, value in saved.attrs.items()
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("engine", ["scipy", "netcdf4"])
def test_a_netcdf_file_keeps_all_of_it(results, kind, engine, tmp_path):
    if engine == "netcdf4":
        pytest.importorskip("netCDF4")
    results(kind).to_netcdf(tmp_path / "results.nc", engine=engine)
    with xarray.open_dataset(tmp_path / "results.nc", engine=engine) as loaded:
        _same(loaded, results(kind))


@pytest.mark.parametrize("kind", KINDS)
def test_a_zarr_store_keeps_all_of_it(results, kind, tmp_path):
    pytest.importorskip("zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of zarr, on texts of fixed length
        results(kind).to_zarr(tmp_path / "results.zarr", consolidated=False)
        with xarray.open_zarr(tmp_path / "results.zarr", consolidated=False) as loaded:
            _same(loaded, results(kind))
