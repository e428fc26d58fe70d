"""Sweeps that Ctrl-C has stopped: cases that have not ended have NaN, others the bits of a whole sweep."""

import contextlib
from functools import partial

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm import sweeps
from dalembert.methods.status import Status
from dalembert.phases import given_values as hybrid_sweep
from dalembert.runs import case_blocks

COUNT = 300
SLEIGH = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
VALUES = {"m": 1.0, "b": np.linspace(0.05, 0.5, COUNT), "I_C": 0.5}
x, u = dynamicsymbols("x u")
m, T, k = sp.symbols("m T k", positive=True)
WATCHED = {"events": ["x"], "reduce": {"mean": da.mean("x"), "top": da.maximum("x"), "end": da.final("x_dot")}}


@pytest.fixture(scope="module")
def sleigh():
    return da.compile_model(da.scenes.chaplygin_sleigh())


@pytest.fixture(scope="module")
def projected():
    return da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected")


@pytest.fixture(scope="module")
def cart():
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_inputs(u)
    scene.add_loads((P, u * N.x))
    scene.add_controllers(da.Controller("p", period=T, inputs={u: -k * x - x.diff()}))
    return da.compile_model(scene)


def press(monkeypatch, part, run):
    """Return the results of a run, and of another in which Ctrl-C is pressed after that part of the loop's returns.

    How often a loop returns to Python depends on how many lanes the processor has.
    """
    real, calls, last, whole = sweeps.check, [], np.inf, run()

    def check(t=np.nan):
        calls.append(t)
        if len(calls) > last:
            raise KeyboardInterrupt
        real(t)

    monkeypatch.setattr(sweeps, "_QUICK", 0.0)
    monkeypatch.setattr(sweeps, "_FIRST_ROUNDS", 7)
    monkeypatch.setattr(sweeps, "check", check)
    run()
    last = part * len(calls)
    calls.clear()
    return run(), whole


def assert_parts(broken, whole):
    """Return how many cases have ended."""
    stopped = broken.status == Status.INTERRUPTED
    assert np.all(broken.success | stopped)
    columns = [(broken.t, whole.t), *((broken[name], whole[name]) for name in ("x", "x_dot"))]
    columns += [(broken.reduced[name], whole.reduced[name]) for name in whole.reduced]
    for name, events in whole.events.items():
        assert not np.any(broken.events[name].count[stopped])
        counts = np.where(stopped, np.nan, broken.events[name].count), events.count
        columns += [counts, *((getattr(broken.events[name], n), getattr(events, n)) for n in ("first", "last"))]
    for found, expected in columns:
        assert np.all(np.isnan(found[stopped]))
        np.testing.assert_array_equal(found[~stopped], expected[~stopped])
    return np.sum(~stopped)


@pytest.mark.parametrize("part", [0, 0.4, 0.9])
@pytest.mark.parametrize("options", [{"t_eval": [0, 2, 5]}, {**WATCHED, "t_eval": [0, 2, 5]}], ids=["times", "events"])
@pytest.mark.parametrize("name", ["sleigh", "projected"])
def test_sweeps_with_samples(request, monkeypatch, name, options, part):
    """Where states are projected, blocks of cases run one after another, else all are one run."""
    model = request.getfixturevalue(name)
    run = partial(model.sweep, (0, 5), SLEIGH, VALUES, threads=1, **options)
    ended = assert_parts(*press(monkeypatch, part, run))
    assert (ended > 0) == (part > 0) and ended < COUNT


@pytest.mark.parametrize("part", [0, 0.4, 0.9])
@pytest.mark.parametrize("options", [{"t_eval": [0, 0.3, 1]}, {**WATCHED, "t_eval": [0, 0.3, 1]}])
def test_sweeps_with_controllers(cart, monkeypatch, options, part):
    """A case between two instants has not ended."""
    values = {m: 1, k: np.linspace(1, 4, COUNT), T: 0.1}
    run = partial(cart.sweep, (0, 1), {x: 1, x.diff(): 0}, values, threads=1, **options)
    assert assert_parts(*press(monkeypatch, part, run)) < COUNT


def press_at_bar(monkeypatch, model, ends, start, values, options):
    """Return the results of a sweep at whose bar Ctrl-C is pressed when the first 50 cases have ended at time 1."""

    def pressed(finished):
        raise KeyboardInterrupt

    whole = model.sweep((0, 1), start, values, **options)
    monkeypatch.setattr(case_blocks, "_BETWEEN_LOOKS", 0.01)
    with monkeypatch.context() as patched:
        patched.setattr(case_blocks, "meter", lambda total, wanted: contextlib.nullcontext(pressed))
        broken = model.sweep((0, ends), start, values, progress=True, **options)
    assert np.all(broken.status[50:] == Status.INTERRUPTED)
    assert_parts(broken, whole)
    return broken


@pytest.mark.parametrize("options", [{}, WATCHED, {"error_estimate": True}], ids=["plain", "events", "estimate"])
def test_sweeps_of_one_run(sleigh, monkeypatch, options):
    """All cases are one run of the loop, at whose bar Ctrl-C is pressed."""
    ends = np.where(np.arange(COUNT) < 50, 1.0, 1e9)  # most never end
    options = {"threads": 1, "max_step": 0.01, "max_steps": 10**12, **options}
    broken = press_at_bar(monkeypatch, sleigh, ends, SLEIGH, VALUES, options)
    if options.get("error_estimate"):
        assert np.all(np.isnan(broken.error_estimate["x"]))


@pytest.mark.parametrize("options", [{}, WATCHED], ids=["plain", "events"])
def test_sweeps_of_one_run_with_controllers(cart, monkeypatch, options):
    ends = np.where(np.arange(COUNT) < 50, 1.0, 1e5)
    values = {m: 1, k: np.linspace(1, 4, COUNT), T: 0.1}
    options = {"threads": 1, "max_step": 1e-3, "max_steps": 10**12, **options}
    press_at_bar(monkeypatch, cart, ends, {x: 1, x.diff(): 0}, values, options)


@pytest.mark.parametrize("options", [{}, {"t_eval": [0, 0.5, 2]}, {**WATCHED, "t_eval": [0, 0.5, 2]}])
def test_sweeps_with_contacts(monkeypatch, options):
    calls = []

    def pressed(finished):
        calls.append(finished)
        if len(calls) == 3:
            raise KeyboardInterrupt

    model = da.compile_model(da.scenes.corner_plate(friction=True))
    values = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81, "F_A": 0.0, "mu": np.linspace(0.7, 0.95, 60)}
    values = {name: value for name, value in values.items() if name in model.layout.given}
    start = {"x": -0.5 / np.tan(0.5), "theta": 0.5, "theta_dot": 0.0}
    whole = model.sweep((0, 2), start, values, **options)
    with monkeypatch.context() as patched:
        patched.setattr(hybrid_sweep, "_BETWEEN_LOOKS", 20)
        patched.setattr(hybrid_sweep, "meter", lambda total, wanted: contextlib.nullcontext(pressed))
        broken = model.sweep((0, 2), start, values, progress=True, **options)
    assert 0 < assert_parts(broken, whole) < 60
    stopped = broken.status == Status.INTERRUPTED
    assert not np.any(broken.phases[stopped]) and not np.any(broken.steps[stopped])
    assert np.all(broken.mode("corner")[stopped] == "none")
