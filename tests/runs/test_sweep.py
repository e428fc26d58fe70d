"""Sweeps, grids, prepared runs and error estimates through the public API."""

import contextlib
import gc
import os
import subprocess
import sys
import weakref

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError, ValueInputError
from dalembert.methods.status import Status
from dalembert.runs import case_blocks
from oracles.sleigh_exact import sleigh_state

START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1.0, "b": 0.3, "I_C": 0.5}
LENGTHS = np.linspace(0.1, 0.5, 41)


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X"])


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_sweep_equals_single_runs(backend):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend, outputs=["X"])
    lengths = LENGTHS[::10]
    sweep = model.sweep((0, 3), START, {**PARAMETERS, "b": lengths}, rtol=1e-10)
    assert np.all(sweep.success) and len(sweep) == len(lengths)
    for i, b in enumerate(lengths):
        single = model.simulate((0, 3), START, {**PARAMETERS, "b": b}, rtol=1e-10)
        for name in ("x", "theta_dot", "energy", "X"):
            assert sweep[name][i] == pytest.approx(single[name][-1], rel=1e-8, abs=1e-9)
        assert sweep.final["y"][i] == pytest.approx(single["y"][-1], rel=1e-8)


@pytest.mark.parametrize("t_eval", [None, [0.0, 0.5, 1.0]])
def test_a_sweep_is_freed_with_its_last_reference(model, t_eval):
    """No values keep it alive until Python looks for cycles: large ones in a row would fill the memory."""
    gc.collect()
    gc.disable()
    try:
        sweep = model.sweep((0, 1), START, {**PARAMETERS, "b": LENGTHS}, t_eval=t_eval)
        sweep.to_xarray()
        kept = weakref.ref(sweep)
        del sweep
        assert kept() is None
    finally:
        gc.enable()


def test_threads_and_neighbours_do_not_change_a_bit(model):
    parameters = {**PARAMETERS, "b": LENGTHS}
    one = model.sweep((0, 5), START, parameters, threads=1)
    two = model.sweep((0, 5), START, parameters, threads=2)
    turned = model.sweep((0, 5), START, {**PARAMETERS, "b": LENGTHS[::-1].copy()})
    spoilt = model.sweep((0, 5), START, {**PARAMETERS, "b": np.where(np.arange(41) == 7, np.nan, LENGTHS)})
    assert np.array_equal(one.y, two.y) and np.array_equal(one.y, turned.y[::-1])
    others = np.arange(41) != 7
    assert np.array_equal(spoilt.y[others], one.y[others])
    (failure,) = spoilt.failures()
    assert failure.case == 7 and failure.status is Status.NON_FINITE and "NaN" in failure.message


def test_a_contradiction_is_the_status_of_its_case(model):
    rates = np.where(np.arange(5) == 2, 0.5, 0.98 * np.tan(0.2))
    sweep = model.sweep((0, 1), {**START, "y_dot": rates}, PARAMETERS)
    assert [Status(s) for s in sweep.status] == [Status.SUCCESS] * 2 + [Status.INITIAL_STATE] + [Status.SUCCESS] * 2


def test_spans_of_each_case(model):
    ends = np.linspace(0.5, 10.0, 23)
    sweep = model.sweep((0, ends), START, PARAMETERS, rtol=1e-10)
    assert np.array_equal(sweep.t, ends)
    run = model.simulate((0, 10), START, PARAMETERS, rtol=1e-10)
    assert np.allclose(sweep["x"], run(ends)["x"], atol=1e-8)


def test_samples_at_common_times(model):
    times = np.linspace(0, 4, 9)
    sweep = model.sweep((0, 4), START, {**PARAMETERS, "b": LENGTHS}, t_eval=times, rtol=1e-10)
    assert sweep["x"].shape == (41, 9)
    single = model.simulate((0, 4), START, {**PARAMETERS, "b": LENGTHS[13]}, t_eval=times, rtol=1e-10)
    assert np.allclose(sweep["theta"][13], single["theta"], atol=1e-8)
    with pytest.raises(OptionError, match="common to all cases"):
        model.sweep((0, np.array([1.0, 2.0])), START, PARAMETERS, t_eval=times)


def test_grid_makes_named_axes(model):
    pytest.importorskip("xarray")
    start = {name: value for name, value in START.items() if name != "theta_dot"}
    parameters = {"m": 1.0, "I_C": 0.5}
    grid = da.grid(b=[0.1, 0.2, 0.3], theta_dot=[1.0, 2.0])
    sweep = model.sweep((0, 2), start, parameters, grid=grid, t_eval=[0.0, 1.0, 2.0])
    data = sweep.to_xarray()
    assert dict(data.sizes) == {"b": 3, "theta_dot": 2, "time": 3}
    single = model.simulate((0, 2), {**start, "theta_dot": 2.0}, {**parameters, "b": 0.3})
    assert float(data["x"].sel(b=0.3, theta_dot=2.0, time=2.0)) == pytest.approx(single["x"][-1], abs=1e-7)
    with pytest.raises(UnknownNameError, match="'bb'"):
        model.sweep((0, 1), start, parameters, grid=da.grid(bb=[1.0]))
    with pytest.raises(ValueInputError, match="give it once"):
        model.sweep((0, 1), START, parameters, grid=grid)


def test_input_that_is_wrong_for_all_cases(model):
    with pytest.raises(ValueInputError, match="one length"):
        model.sweep((0, 1), {**START, "x": np.zeros(3)}, {**PARAMETERS, "b": np.ones(4)})
    with pytest.raises(UnknownNameError, match="missing parameters: m"):
        model.sweep((0, 1), START, {"b": 0.3, "I_C": 0.5})
    with pytest.raises(OptionError, match="threads"):
        model.sweep((0, 1), START, PARAMETERS, threads=0)


def test_progress_shows_a_bar(model, capsys):
    pytest.importorskip("tqdm")
    model.sweep((0, 1), START, {**PARAMETERS, "b": LENGTHS}, progress=True)
    assert "41/41" in capsys.readouterr().err.replace(".0", "")


@pytest.fixture
def interrupted(monkeypatch):
    """Progress at which someone presses Ctrl-C, once cases have ended."""

    def press(finished):
        if finished:
            raise KeyboardInterrupt

    monkeypatch.setattr(case_blocks, "_BETWEEN_LOOKS", 0.01)
    monkeypatch.setattr(case_blocks, "meter", lambda total, wanted: contextlib.nullcontext(press))


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_keeps_what_is_finished(model, interrupted, threads):
    """Cases that ended have the results of a whole sweep; lanes and threads do not end in the order of the cases."""
    lengths = np.linspace(0.1, 0.5, 200_000)
    sweep = model.sweep((0, 10), START, {**PARAMETERS, "b": lengths}, threads=threads, progress=True)
    assert {Status(s) for s in sweep.status} == {Status.SUCCESS, Status.INTERRUPTED}
    ended = sweep.success
    whole = model.sweep((0, 10), START, {**PARAMETERS, "b": lengths[ended]}, threads=threads)
    assert np.all(sweep.t[ended] == 10)
    assert np.array_equal(sweep.y[ended], whole.y)
    assert np.all(np.isnan(sweep.y[~ended]))


def test_an_interrupt_keeps_blocks_that_are_finished(interrupted):
    """Cases with samples run in blocks where states are projected."""
    model, lengths = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected"), np.linspace(0.1, 0.5, 640)
    sweep = model.sweep((0, 10), START, {**PARAMETERS, "b": lengths}, threads=1, t_eval=[5.0])
    assert {Status(s) for s in sweep.status} == {Status.SUCCESS, Status.INTERRUPTED}
    assert np.all(np.isfinite(sweep.samples[sweep.success]))


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_prepared_run_gives_the_final_state(formulation, method):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation=formulation)
    run = model.prepare((0, 10), method=method, rtol=1e-11, atol=1e-11)
    y = run(model.state(START, PARAMETERS), model.parameter_vector(PARAMETERS))
    single = model.simulate((0, 10), START, PARAMETERS, method=method, rtol=1e-11, atol=1e-11)
    assert run.status is Status.SUCCESS
    assert np.allclose(y, single.y[-1], rtol=1e-9, atol=1e-10)
    assert (
        model.prepare((0, 10), method=method, max_steps=3)(
            model.state(START, PARAMETERS), model.parameter_vector(PARAMETERS)
        ).shape
        == y.shape
    )


def test_prepared_run_reports_how_it_ended(model):
    run = model.prepare((0, 10), method="taylor", max_steps=3)
    run(model.state(START, PARAMETERS), model.parameter_vector(PARAMETERS))
    assert run.status is Status.MAX_STEPS
    run(np.full(5, np.nan), model.parameter_vector(PARAMETERS))
    assert run.status is Status.NON_FINITE


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_error_estimate_is_near_the_true_error(model, rtol):
    lengths = LENGTHS[::4]
    sweep = model.sweep((0, 10), START, {**PARAMETERS, "b": lengths}, rtol=rtol, atol=rtol, error_estimate=True)
    speed = 0.98 / np.cos(0.2)
    exact = [sleigh_state(10, 1.0, b, 0.5, 0.0, 0.0, 0.2, speed, 2.0) for b in lengths]
    for name in ("x", "y", "theta"):
        true = np.abs(sweep[name] - np.array([float(getattr(state, name)) for state in exact]))
        ratio = sweep.error_estimate[name] / np.maximum(true, 1e-300)
        assert np.mean((ratio > 0.1) & (ratio < 10.0)) >= 0.95
    single = model.simulate((0, 10), START, PARAMETERS, rtol=rtol, atol=rtol, error_estimate=True)
    assert single.error_estimate["x"].shape == single.t.shape
    with pytest.raises(OptionError, match="error_estimate=True"):
        _ = model.simulate((0, 1), START, PARAMETERS).error_estimate


def test_a_case_starts_from_the_bits_of_a_single_run(model):
    lengths, angles = np.linspace(0.1, 0.5, 9), np.linspace(-3.0, 3.0, 9)
    parameters = {**PARAMETERS, "b": lengths}
    sweep = model.sweep((1.0, 1.0), {**START, "theta": angles}, parameters)
    for i in range(9):
        given = {**START, "theta": angles[i]}, {**PARAMETERS, "b": lengths[i]}
        assert np.array_equal(sweep.y[i], model.state(*given))
        assert np.array_equal(sweep.y[i], model.simulate((1.0, 1.0), *given).y[0])


def test_columns_of_any_layout(model):
    pairs = np.stack([np.linspace(0.1, 0.5, 70), np.linspace(-3.0, 3.0, 70)], axis=1)
    apart, together = pairs[:, 0], np.ascontiguousarray(pairs[:, 0])
    ends = np.linspace(0.5, 2.0, 140)[::2]
    sweeps = [model.sweep((0.0, ends), START, {**PARAMETERS, "b": b}) for b in (apart, together, apart.astype(">f8"))]
    for sweep in sweeps[1:]:
        assert np.array_equal(sweep.y, sweeps[0].y)
    assert np.array_equal(sweeps[0].t, ends)


def test_results_are_their_own(model):
    """Neither what was given nor what was handed out is what results are evaluated from."""
    lengths, positions, times = np.array([0.1, 0.3]), np.zeros(2), np.array([0.0, 1.0])
    options = {"t_eval": times}
    sweep = model.sweep((0, 1), {**START, "x": positions}, {**PARAMETERS, "b": lengths}, **options)
    single = model.simulate((0, 1), START, PARAMETERS, **options)
    axes, evaluated = da.grid(b=lengths), single(times)
    for given in (lengths, positions, times):
        given[:] = 0.7
    for run in (sweep, single):
        for name in ("theta", "v_S_x", "X"):
            run[name][...] = 0.7
    np.testing.assert_array_equal(sweep.parameters["b"], axes.axes["b"])
    np.testing.assert_array_equal(sweep.parameters["b"], [0.1, 0.3])
    np.testing.assert_array_equal(sweep.t_eval, [0.0, 1.0])
    np.testing.assert_array_equal(evaluated.t, single.t)
    for name in ("theta", "v_S_x", "X", "energy"):
        np.testing.assert_allclose(sweep[name][1], single[name], rtol=1e-12)


def test_cases_that_cannot_start(model):
    speeds = np.array([0.0, 0.5, np.nan, 0.0])  # a slip of the blade, and a number that is none
    sweep = model.sweep((0.5, 3.0), {**START, "theta": 0.0, "y_dot": speeds}, PARAMETERS)
    assert [Status(s) for s in sweep.status] == [
        Status.SUCCESS,
        Status.INITIAL_STATE,
        Status.NON_FINITE,
        Status.SUCCESS,
    ]
    assert np.all(np.isnan(sweep.y[1:3])) and np.all(sweep.t[1:3] == 0.5) and np.all(sweep.steps[1:3] == 0)
    assert np.array_equal(sweep.y[0], sweep.y[3])


FORK = """
import os
import numpy as np
import dalembert as da

model = da.compile_model(da.scenes.chaplygin_sleigh())
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
p = {"m": 1, "b": np.linspace(0.1, 0.5, 300), "I_C": 0.5}
here = model.sweep((0, 1), start, p, threads=2)
child = os.fork()
if child == 0:
    there = model.sweep((0, 1), start, p, threads=2)
    os._exit(0 if np.array_equal(there.y, here.y) else 1)
raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this platform does not fork")
def test_a_forked_process_can_sweep():
    subprocess.run([sys.executable, "-c", FORK], check=True, timeout=60)


def test_no_cases_are_no_error(model):
    sweep = model.sweep((0, 1), START, {**PARAMETERS, "b": np.empty(0)}, method="taylor")
    assert len(sweep) == 0 and sweep["x"].shape == (0,)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("t_eval", [None, [0.0, 5e-4]])
def test_checks_look_at_the_very_starts_of_the_cases(method, t_eval):
    """They were made once more, by NumPy, whose sines differ in the last bit."""
    model = da.compile_model(da.scenes.rolling_sphere())
    psi = np.linspace(-1.0, 1.0, 150_001 if t_eval is None else 6_001)  # several parts or blocks
    psi[3] = np.nan
    start = {"x": 0, "y": 0, "psi": psi, "theta": 0.9, "phi": 0.2, "psi_dot": 0.5, "theta_dot": 0.3, "phi_dot": 1}
    parameters, seen, kind = {"m": 1, "r": 0.5, "g": 9.81}, [], type(model.checks[0])
    check = kind.after_cases

    def after(self, method, block, done):
        seen.append((block.y.copy(), block.c.copy(), block.spans.copy()))
        return check(self, method, block, done)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, "after_cases", after)
        sweep = model.sweep((0, 1e-3), start, parameters, method=method, t_eval=t_eval)
    y, c, spans = map(np.concatenate, zip(*seen, strict=True))
    assert len(y) == len(psi) and np.all(spans == [0.0, 1e-3]) and np.all(c == c[0])
    assert sweep.status[3] == Status.NON_FINITE and np.sum(~sweep.success) == 1
    rows = {row.tobytes() for row in y}
    for angle in psi[[0, 77, 3_000, -1]]:
        assert model.state({**start, "psi": angle}, parameters).tobytes() in rows
