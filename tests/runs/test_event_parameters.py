"""Parameters that stand only in events and reductions are given with a run, and swept."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import UnknownNameError, ValueInputError

h = dynamicsymbols("h")
m, g, limit, bounce, scale = sp.symbols("m g limit bounce scale", positive=True)
T = dynamicsymbols._t
START = {"h": 1.0, "h_dot": 0.0}
FALL = np.sqrt(2 / 9.81)


def ball(contact=False):
    N, O = ReferenceFrame("N"), Point("O")
    place = O.locatenew("ball", h * N.y)
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[h])
    scene.add_bodies(Particle("ball", place, m))
    scene.apply_uniform_gravity(-g * N.y)
    if contact:
        F = da.unknowns("F")
        scene.add_joints(da.Joint("floor", body="ball", at=place, force=F * N.y))
        scene.add_contacts(da.UnilateralContact(F, h, name="floor"))
    return scene


def passes(level):
    """Return when the ball falls through a level [s]."""
    return np.sqrt(2 * (1 - level) / 9.81)


@pytest.mark.parametrize("backend", ["llvm", pytest.param("numba", marks=pytest.mark.matrix), "numpy"])
def test_simulate(backend):
    model = da.compile_model(ball(), backend=backend)
    given = {m: 1, g: 9.81, limit: 0.4}
    run = model.simulate((0, 0.4), START, given, events=[da.Event(h - limit, terminal=True, name="low")])
    assert run.events["low"].t == pytest.approx([passes(0.4)], rel=1e-9)
    assert run.t[-1] == pytest.approx(passes(0.4), rel=1e-9)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_sweep_of_levels(backend):
    model = da.compile_model(ball(), backend=backend)
    levels = np.array([0.2, 0.4, 0.7])
    kept = {"when": da.first_crossing(h - limit), "most": da.maximum(scale * h.diff(T, 2)), "last": da.final(limit * h)}
    given = {m: 1, g: 9.81, "limit": levels, scale: 2}
    sweep = model.sweep((0, 0.41), START, given, reduce=kept, events=[da.Event(h - limit, name="low")])
    np.testing.assert_allclose(sweep.reduced["when"], passes(levels), rtol=1e-9)
    np.testing.assert_allclose(sweep.events["low"].first, passes(levels), rtol=1e-9)
    np.testing.assert_allclose(sweep.reduced["most"], -2 * 9.81, rtol=1e-12)
    np.testing.assert_allclose(sweep.reduced["last"], levels * (1 - 9.81 / 2 * 0.41**2), rtol=1e-9)
    if backend == "llvm":
        grid = da.grid(limit=levels, m=np.array([1.0, 2.0]))
        both = model.sweep((0, 0.41), START, {g: 9.81}, grid=grid, reduce={"when": da.first_crossing(h - limit)})
        whole = both.to_xarray()["when"]
        assert dict(whole.sizes) == {"limit": 3, "m": 2}
        np.testing.assert_allclose(whole.values[:, 0], passes(levels), rtol=1e-9)


def test_jumps_take_them():
    model = da.compile_model(ball(), backend="numpy")
    impact = da.Event(h, direction=-1, apply={h.diff(): -bounce * h.diff()}, name="impact")
    run = model.simulate((0, 0.8), START, {m: 1, g: 9.81, bounce: 0.5}, events=[impact])
    assert run.events["impact"].after["h_dot"][0] == pytest.approx(0.5 * 9.81 * FALL, rel=1e-9)


def test_far_from_zero():
    """The run is that of another model of the scene, which has the parameter too."""
    model = da.compile_model(ball(), backend="numpy")
    run = model.simulate((1e6, 1e6 + 0.4), START, {m: 1, g: 9.81, limit: 0.4}, events=[h - limit])
    assert run.events[h - limit].t - 1e6 == pytest.approx([passes(0.4)], abs=1e-9)


@pytest.mark.parametrize("kind", ["simulate", "sweep"])
def test_in_a_scene_with_contacts(kind):
    model = da.compile_model(ball(contact=True), backend="numpy")
    given = {m: 1, g: 9.81, limit: np.array([0.2, 0.4]) if kind == "sweep" else 0.4}
    if kind == "simulate":
        run = model.simulate((0, 1), START, given, events=[h - limit])
        assert run.events[h - limit].t == pytest.approx([passes(0.4)], rel=1e-9)
    else:
        sweep = model.sweep((0, 1), START, given, events=[da.Event(h - limit, name="low")])
        np.testing.assert_allclose(sweep.events["low"].first, passes(np.array([0.2, 0.4])), rtol=1e-9)


def test_other_runs_stay_as_they_are():
    """The model that others use has no further parameter, and one model serves all values."""
    model = da.compile_model(ball(), backend="numpy")
    watched = [h - limit]
    for level in (0.3, 0.6):
        run = model.simulate((0, 0.4), START, {m: 1, g: 9.81, limit: level}, events=watched)
        assert run.events[h - limit].t == pytest.approx([passes(level)], rel=1e-9)
    assert model.layout.parameters == ("g", "m")
    assert model.simulate((0, 0.1), START, {m: 1, g: 9.81}).success
    assert len([key for key in model.variants._watched if key[0] == "parameters"]) == 1


# -- faults -----------------------------------------------------------------------------------------------


def test_what_is_not_given_or_not_used():
    model = da.compile_model(ball(), backend="numpy")
    with pytest.raises(UnknownNameError, match=r"unknown name 'limit'.*given to the run with the others"):
        model.simulate((0, 1), START, {m: 1, g: 9.81}, events=[h - limit])
    with pytest.raises(UnknownNameError, match="unknown parameter 'bounce'"):
        model.simulate((0, 1), START, {m: 1, g: 9.81, limit: 1, bounce: 2}, events=[h - limit])
    with pytest.raises(UnknownNameError, match="unknown parameter 'limit'"):
        model.simulate((0, 1), START, {m: 1, g: 9.81, limit: 1})
    with pytest.raises(ValueInputError, match="limit"):
        model.simulate((0, 1), START, {m: 1, g: 9.81, limit: -1.0}, events=[h - limit])
