"""Stored sweeps of scenes with contacts: the bits of one call, whatever the chunks, restarts and processes."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError
from dalembert.phases import runner_choice
from hard_cases.contacts import corner_plate

zarr = pytest.importorskip("zarr")
pytest.importorskip("xarray")

TIME = dynamicsymbols._t
PLATE = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81, "mu": np.linspace(0.7, 0.9, 40)}
TILTED = {"x": -0.5 / math.tan(0.5), "theta": 0.5, "theta_dot": 0.0, "x_dot": 0.0}
DROPPED = {"x": 0.0, "y": 1.0, "x_dot": 0.5, "y_dot": 0.0}
BALL = {"m": 1.0, "g": 9.81, "e": np.linspace(0.3, 0.9, 40)}
y = dynamicsymbols("y")


@cache
def plate():
    return da.compile_model(corner_plate(4 + 7 * sp.sin(3 * TIME)), outputs=["N_Q"])


@cache
def ball(backend="llvm"):
    return da.compile_model(da.scenes.bouncing_ball(), outputs=["N"], backend=backend)


def assert_same(stored, sweep):
    """Compare everything that a sweep has, to the bit."""
    whole = sweep.to_xarray()
    assert set(whole.variables) <= set(stored.variables)
    for name, values in whole.variables.items():
        np.testing.assert_array_equal(stored[name].to_numpy(), values.to_numpy(), err_msg=name)
    assert stored.attrs["scene"] == whole.attrs["scene"]


@pytest.mark.parametrize("chunk", [None, 13, 1])
def test_finals_phases_and_modes_do_not_depend_on_chunks(tmp_path, chunk):
    few = {**PLATE, "mu": PLATE["mu"][:5]} if chunk == 1 else PLATE
    stored = plate().sweep((0, 4), TILTED, few, to=tmp_path / "s.zarr", chunk=chunk)
    sweep = plate().sweep((0, 4), TILTED, few)
    assert_same(stored, sweep)
    assert chunk == 1 or len(set(sweep.phases)) > 1
    np.testing.assert_array_equal(stored["phases"], sweep.phases)
    meaning = stored["corner_mode"].attrs["flag_meanings"].split()
    assert [meaning[k] for k in stored["corner_mode"].to_numpy()] == list(sweep.mode("corner"))


def test_samples_and_estimates_with_methods_by_mode(tmp_path):
    """At this tolerance one mode has another method than the other, and the twin another again."""
    options = {"t_eval": [0.0, 0.7, 2.0], "error_estimate": True, "rtol": 1e-6}
    stored = plate().sweep((0, 2), TILTED, PLATE, to=tmp_path / "s.zarr", chunk=11, **options)
    sweep = plate().sweep((0, 2), TILTED, PLATE, **options)
    assert len(set(sweep.stats.methods.values())) > 1
    assert_same(stored, sweep)
    np.testing.assert_array_equal(stored["theta_error"], sweep.error_estimate["theta"])


def test_events_and_reductions(tmp_path):
    options = {
        "events": [da.Event(y - 0.2, name="low", direction=-1)],
        "reduce": {"top": da.maximum(y), "mean": da.mean(y), "half": da.first_crossing(y - 0.5)},
    }
    stored = ball().sweep((0, 2), DROPPED, BALL, to=tmp_path / "s.zarr", chunk=11, **options)
    sweep = ball().sweep((0, 2), DROPPED, BALL, **options)
    assert_same(stored, sweep)
    np.testing.assert_array_equal(stored["low_count"], sweep.events["low"].count)
    assert len(set(sweep.events["low"].count)) > 1


def test_a_backend_that_goes_phase_by_phase(tmp_path):
    grid = da.grid(e=[0.3, 0.6, 0.9], y=[0.5, 1.0])
    start, parameters = {k: v for k, v in DROPPED.items() if k != "y"}, {"m": 1.0, "g": 9.81}
    stored = ball("numpy").sweep((0, 0.6), start, parameters, grid=grid, to=tmp_path / "s.zarr", chunk=2)
    whole = ball("numpy").sweep((0, 0.6), start, parameters, grid=grid).to_xarray()
    assert stored["phases"].dims == ("e", "y")
    for name in whole.variables:
        np.testing.assert_array_equal(stored[name], whole[name])


def test_cases_that_cannot_start_have_no_mode(tmp_path):
    """A chunk without a case that starts has the columns of the others."""
    start = {**DROPPED, "y": np.r_[np.full(4, -1.0), np.ones(4)]}
    parameters = {**BALL, "e": 0.5}
    stored = ball().sweep((0, 1), start, parameters, to=tmp_path / "s.zarr", chunk=4)
    sweep = ball().sweep((0, 1), start, parameters)
    assert list(sweep.success) == [False] * 4 + [True] * 4
    assert_same(stored, sweep)


def test_methods_are_chosen_once_for_all_cases(tmp_path, monkeypatch):
    """What "auto" finds by looking at motions is found in the first, the middle and the last case, and sent."""
    looked = []

    def fitting(engine, cases, settings, quick_start, **about):
        looked.append(engine)
        return replace(settings, method="dop853")

    with monkeypatch.context() as patched:
        patched.setattr(runner_choice, "fitted", fitting)
        stored = plate().sweep((0, 2), TILTED, PLATE, to=tmp_path / "s.zarr", chunk=20)
    assert looked and len(looked) == len(set(looked))
    assert_same(stored, plate().sweep((0, 2), TILTED, PLATE, method="dop853"))
    with pytest.raises(OptionError, match="holds another sweep"):
        plate().sweep((0, 2), TILTED, PLATE, to=tmp_path / "s.zarr", chunk=20)


def test_what_a_store_of_contacts_holds_is_refused_to_others(tmp_path):
    path = tmp_path / "s.zarr"
    single = da.compile_model(da.scenes.bouncing_ball(), outputs={"load": da.unknowns("N")})
    single.sweep((0, 0.5), DROPPED, BALL, to=path)
    doubled = da.compile_model(da.scenes.bouncing_ball(), outputs={"load": 2 * da.unknowns("N")})
    with pytest.raises(OptionError, match="other: its scene"):
        doubled.sweep((0, 0.5), DROPPED, BALL, to=path)


def test_a_cluster_and_a_restart_give_the_same_bits(tmp_path):
    distributed = pytest.importorskip("distributed")
    path, sweep = tmp_path / "s.zarr", plate().sweep((0, 4), TILTED, PLATE)
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert_same(plate().sweep((0, 4), TILTED, PLATE, to=path, chunk=7, client=client), sweep)
    piece = next(p for p in sorted((path / "theta").rglob("c/*")) if p.is_file())
    piece.write_bytes(piece.read_bytes()[:5])
    assert_same(plate().sweep((0, 4), TILTED, PLATE, to=path, chunk=7), sweep)
