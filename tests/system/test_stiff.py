"""Stiff scenes: Radau against references, and the automatic choice of it."""

import functools

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen import compiled_engine
from dalembert.errors import OptionError
from dalembert.steps import method_choice
from system.stiff_scenes import GOVERNOR, GOVERNOR_END, GOVERNOR_START, damped_pair, governor

PAIR = {"m": 1.0, "l": 1.0, "g": 9.81, "c": 2e4, "k": 1.0}
PAIR_START = {"x0": 0.3, "a0": 0.5, "x0_dot": 0.0, "a0_dot": 0.0}


@functools.cache
def compiled(build, backend="llvm", formulation="auto"):
    return da.compile_model(build(), backend=backend, formulation=formulation)


def final_error(run):
    return max(abs(run[name][-1] - value) for name, value in GOVERNOR_END.items())


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-7, 1e-9])
def test_governor_ends_at_the_reference(formulation, rtol):
    model = compiled(governor, formulation=formulation)
    run = model.simulate((0, 10), GOVERNOR_START, GOVERNOR, method="radau", rtol=rtol, atol=rtol)
    assert run.success and run.stats.method == "radau" and run.stats.note == ""
    assert final_error(run) < 2 * rtol
    assert run.stats.steps < 40 * rtol**-0.25


def test_scipy_ends_at_the_reference_too():
    model = compiled(governor, "numpy")
    run = model.simulate((0, 1), GOVERNOR_START, GOVERNOR, method="radau", rtol=1e-7, atol=1e-7)
    expected = compiled(governor).simulate((0, 1), GOVERNOR_START, GOVERNOR, method="radau", rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(run.y[-1], expected.y[-1], atol=1e-7)


def test_automatic_choice_finds_the_governor_stiff_and_says_so():
    model = compiled(governor)
    run = model.simulate((0, 10), GOVERNOR_START, GOVERNOR, rtol=1e-6, atol=1e-6)
    assert run.stats.method == "radau"
    assert run.stats.note.startswith("stiff: modes decay at") and run.stats.note in run.message
    assert final_error(run) < 2e-6
    chosen = model.simulate((0, 10), GOVERNOR_START, GOVERNOR, rtol=1e-6, atol=1e-6, method="radau")
    np.testing.assert_array_equal(run.y, chosen.y)
    assert "stiff" in model.explain() and "radau" in model.explain()


def test_automatic_choice_of_large_scenes():
    """Those whose Taylor step is too long, which go by a Runge-Kutta pair."""
    count = 40
    model = compiled(functools.partial(damped_pair, count))
    start = {f"x{i}": 0.1 + i / 200 for i in range(count)} | {f"a{i}": 0.5 for i in range(count)}
    start |= {f"{name}_dot": 0.0 for name in start}
    run = model.simulate((0, 4), start, PAIR, rtol=1e-5, atol=1e-7)
    explicit = model.simulate((0, 4), start, PAIR, rtol=1e-5, atol=1e-7, method="dop853")
    assert run.stats.method == "radau" and "stiff" in run.message
    assert explicit.stats.steps > 10 * run.stats.steps
    np.testing.assert_allclose(run.q[-1], explicit.q[-1], atol=1e-4)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_runs_that_are_not_stiff_are_those_of_the_method_that_auto_takes(backend):
    model = compiled(damped_pair, backend)
    end = 60.0 if backend == "llvm" else 3.0
    gentle = {**PAIR, "c": 0.5}
    run = model.simulate((0, end), PAIR_START, gentle)
    same = model.simulate((0, end), PAIR_START, gentle, method=run.stats.method)
    assert run.stats.method != "radau" and run.stats.note == ""
    np.testing.assert_array_equal(run.t, same.t)
    np.testing.assert_array_equal(run.y, same.y)


def test_long_runs_that_are_not_stiff_keep_their_method():
    model = compiled(damped_pair)
    run = model.simulate((0, 2000), PAIR_START, {**PAIR, "c": 1e-3})
    same = model.simulate((0, 2000), PAIR_START, {**PAIR, "c": 1e-3}, method="taylor")
    assert run.stats.steps > 5000
    np.testing.assert_array_equal(run.y, same.y)


def test_runs_with_events_that_few_steps_complete_need_no_test_of_stiffness(monkeypatch):
    """Those of long right-hand sides are tried first: the same motions, and stiff ones are still found."""
    model, asked, turns = compiled(damped_pair), [], [da.Event("x0_dot", name="turn")]
    own = method_choice.fitting
    monkeypatch.setattr(method_choice, "fitting", lambda *about: asked.append(about) or own(*about))

    def runs():
        gentle = model.simulate((0, 3), PAIR_START, {**PAIR, "c": 0.5}, events=turns)
        stiff = model.simulate((0, 2), PAIR_START, PAIR, events=turns, rtol=1e-4, atol=1e-6)
        return gentle, stiff

    tested = runs()
    assert len(asked) == 2 and tested[0].stats.steps < method_choice.EXPLICIT_STEPS
    monkeypatch.setattr(compiled_engine, "_LONG", 0)
    tried = runs()
    assert len(asked) == 3 and [run.stats.method for run in tried] == [run.stats.method for run in tested]
    assert tried[1].stats.method == "radau"
    for one, other in zip(tested, tried, strict=True):
        np.testing.assert_array_equal(one.y, other.y)
        np.testing.assert_array_equal(one.events["turn"].t, other.events["turn"].t)


def test_sweeps_that_few_steps_complete_need_no_test_of_stiffness(monkeypatch):
    """Of long right-hand sides some cases are tried: the same motions, and stiff ones are still found."""
    model, asked = compiled(damped_pair), []
    own = method_choice.fitting
    monkeypatch.setattr(method_choice, "fitting", lambda *about: asked.append(about) or own(*about))
    monkeypatch.setattr(model.engine._lanes, "_looked", 0)
    watched = {"events": ["x0_dot"], "reduce": {"far": da.maximum("x0")}, "t_eval": np.array([0.0, 1.0, 3.0])}

    def runs():
        gentle = [model.sweep((0, 3), PAIR_START, {**PAIR, "c": np.array([0.5, 1.0])}, **o) for o in ({}, watched)]
        stiff = model.sweep((0, 2), PAIR_START, {**PAIR, "c": np.array([0.5, 1e4])}, rtol=1e-4, atol=1e-6)
        ends = np.array([1.0, 2000.0])
        long = model.sweep((0, ends), PAIR_START, {**PAIR, "c": 1e-3}, rtol=1e-4, atol=1e-6)
        return [*gentle, stiff, long]

    tested = runs()
    assert len(asked) == 8
    monkeypatch.setattr(compiled_engine, "_LONG", 0)
    tried = runs()
    assert len(asked) == 12 and [run.stats.method for run in tried] == ["taylor", "taylor", "radau", "taylor"]
    assert tried[3].steps[1] > method_choice.EXPLICIT_STEPS
    for one, other in zip(tested, tried, strict=True):
        assert one.stats.method == other.stats.method and one.stats.note == other.stats.note
        np.testing.assert_array_equal(one.y, other.y)
    np.testing.assert_array_equal(tested[1].samples, tried[1].samples)
    np.testing.assert_array_equal(tested[1].reduced["far"], tried[1].reduced["far"])
    np.testing.assert_array_equal(tested[1].events["x0_dot"].first, tried[1].events["x0_dot"].first)


def test_numpy_finds_stiffness_too():
    run = compiled(damped_pair, "numpy").simulate((0, 1), PAIR_START, PAIR, rtol=1e-4, atol=1e-6)
    assert run.success and run.stats.method == "radau" and "stiff" in run.message


def test_sweeps_by_radau_are_single_runs():
    model, damping = compiled(damped_pair), np.array([1e2, 1e4, 1e5])
    times = np.linspace(0, 2, 5)
    options = {"method": "radau", "rtol": 1e-7, "atol": 1e-9, "t_eval": times}
    sweep = model.sweep((0, 2), PAIR_START, {**PAIR, "c": damping}, **options)
    assert np.all(sweep.status == 0)
    for i, c in enumerate(damping):
        single = model.simulate((0, 2), PAIR_START, {**PAIR, "c": c}, **options)
        np.testing.assert_array_equal(sweep["x0"][i], single["x0"])
        np.testing.assert_array_equal(sweep.final["a0_dot"][i], single["a0_dot"][-1])


def test_sweeps_choose_radau_where_a_case_is_stiff():
    model = compiled(damped_pair)
    sweep = model.sweep((0, 5), PAIR_START, {**PAIR, "c": np.array([1.0, 1e4, 1e5])}, rtol=1e-6, atol=1e-8)
    assert sweep.stats.method == "radau" and "stiff" in sweep.stats.note
    gentle = model.sweep((0, 5), PAIR_START, {**PAIR, "c": np.array([1.0, 2.0])}, rtol=1e-6, atol=1e-8)
    assert gentle.stats.method == "taylor" and gentle.stats.note == ""


def test_prepared_runs_by_radau():
    model = compiled(governor)
    run = model.prepare((0, 1), method="radau", rtol=1e-8, atol=1e-8)
    final = run(model.state(GOVERNOR_START, GOVERNOR), model.parameter_vector(GOVERNOR))
    single = model.simulate((0, 1), GOVERNOR_START, GOVERNOR, method="radau", rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(final, single.y[-1])


def test_unknown_method_lists_radau():
    with pytest.raises(OptionError, match="radau"):
        compiled(governor).simulate((0, 1), GOVERNOR_START, GOVERNOR, method="bdf")
