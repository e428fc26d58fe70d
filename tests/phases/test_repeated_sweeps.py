"""Sweeps with contacts in a row, which run in the memory of the first: nothing of one is left in another."""

import threading

import numpy as np
import pytest
from sympy import sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from dalembert.phases import phases
from hard_cases.contacts import contact_motion

s = dynamicsymbols("s")
P = {"m": 1.0, "k": 8.0, "P": 2.0, "mu": 0.3}
K = 21
TIMES = np.linspace(0.0, 3.0, 7)


def made():
    """Return a block on a spring, which is clamped: it slips, sticks, and slips again."""
    m, k, load, mu = symbols("m k P mu", positive=True)
    N, O, T = ReferenceFrame("N"), Point("O"), da.unknowns("T")
    where = O.locatenew("B", s * N.x)
    scene = da.Scene("clamped", frame=N, origin=O, coordinates=[s])
    scene.add_bodies(Particle("block", where, m))
    scene.add_loads((where, -k * sin(s) * N.x))
    scene.add_joints(da.Joint("clamp", body="block", at=where, force=T * N.x))
    scene.add_friction(da.CoulombFriction(normal=load, tangential=T, mu=mu, name="clamp"))
    return da.compile_model(scene)


@pytest.fixture(scope="module")
def model():
    return made()


def starts(scale=1.0):
    return {"s": scale * np.linspace(0.01, 1.0, K), "s_dot": 0.0}


WATCHED = {"events": [da.Event(s, name="middle")], "reduce": {"largest": da.maximum("s"), "mean": da.mean("s_dot")}}


def everything(sweep):
    """Return all that a sweep says of its cases."""
    said = [
        sweep.t,
        sweep.status,
        sweep.steps,
        sweep["s"],
        sweep["s_dot"],
        sweep.reduced["largest"],
        sweep.reduced["mean"],
    ]
    return [*map(np.copy, said), np.copy(sweep.events["middle"].count), np.copy(sweep.events["middle"].last)]


@pytest.mark.parametrize("t_eval", [None, TIMES], ids=["ends", "samples"])
@pytest.mark.parametrize("method", ["auto", "dop853"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_sweep_does_not_depend_on_those_before_it(model, threads, method, t_eval):
    options = {"threads": threads, "method": method, "t_eval": t_eval, **WATCHED}

    def sweep(of, scale=1.0, **p):
        return of.sweep((0.0, 3.0), starts(scale), {**P, **p}, **options)

    alone = sweep(made())
    expected = everything(alone)
    first = sweep(model)
    said = everything(first)
    sweep(model, scale=0.02, mu=2.0)  # none slips
    sweep(model, scale=3.0, m=0.0)  # none begins
    later = everything(first)
    again = sweep(model)
    for found in (said, later, everything(again)):
        for values, right in zip(found, expected, strict=True):
            np.testing.assert_array_equal(values, right)
    assert again.stats.methods == alone.stats.methods


def test_threads_that_sweep_one_model_share_no_memory(model):
    expected, found = everything(model.sweep((0.0, 3.0), starts(), P, threads=1, **WATCHED)), {}

    def sweep(number):
        found[number] = [everything(model.sweep((0.0, 3.0), starts(), P, threads=1, **WATCHED)) for _ in range(5)]

    threads = [threading.Thread(target=sweep, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == [0, 1, 2]
    for runs in found.values():
        for run in runs:
            for values, right in zip(run, expected, strict=True):
                np.testing.assert_array_equal(values, right)


@pytest.mark.parametrize(("threads", "how"), [(1, "_work_here"), (2, "_work")])
def test_a_sweep_behind_one_that_an_error_has_ended(model, monkeypatch, threads, how):
    expected = everything(model.sweep((0.0, 3.0), starts(), P, threads=threads, **WATCHED))
    work = getattr(phases.PhaseExecutor, how)

    def ended(*arguments):
        work(*arguments)
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(phases.PhaseExecutor, how, ended)
        with pytest.raises(MemoryError):
            model.sweep((0.0, 3.0), starts(2.0), P, threads=threads, **WATCHED)
    found = everything(model.sweep((0.0, 3.0), starts(), P, threads=threads, **WATCHED))
    for values, right in zip(found, expected, strict=True):
        np.testing.assert_array_equal(values, right)


def swept(monkeypatch, patience, check=lambda: None):
    """Return a sweep of a new model in one thread that returns to Python, and looks there, after so many rounds."""
    with monkeypatch.context() as patched:
        patched.setattr(phases, "_PATIENCE", patience)
        patched.setattr(phases, "check", check)
        return made().sweep((0.0, 3.0), starts(), P, threads=1, t_eval=TIMES, **WATCHED)


@pytest.mark.parametrize("patience", [1, 3])
def test_returns_to_python_change_no_bit(model, monkeypatch, patience):
    looks = []
    expected = everything(model.sweep((0.0, 3.0), starts(), P, threads=1, t_eval=TIMES, **WATCHED))
    for values, right in zip(everything(swept(monkeypatch, patience, lambda: looks.append(0))), expected, strict=True):
        np.testing.assert_array_equal(values, right)
    assert looks


def test_ctrl_c_keeps_what_has_ended_in_one_thread(model, monkeypatch):
    looks = []
    swept(monkeypatch, 1, lambda: looks.append(0))
    left = iter(range(len(looks) // 2))

    def check():
        if next(left, None) is None:
            raise KeyboardInterrupt

    whole = model.sweep((0.0, 3.0), starts(), P, threads=1, t_eval=TIMES, **WATCHED)
    broken = swept(monkeypatch, 1, check)
    stopped = broken.status == Status.INTERRUPTED
    assert 0 < np.sum(stopped) < K and np.all(broken.success[~stopped])
    np.testing.assert_array_equal(broken["s"][~stopped], whole["s"][~stopped])
    assert np.all(np.isnan(broken["s"][stopped])) and np.all(np.isnan(broken.t[stopped]))


def test_ctrl_c_reaches_runs_of_many_short_phases(monkeypatch):
    """Phases of a block on a belt take a few steps, less than the loop makes before it returns to Python."""
    motion, most, looks = contact_motion("block on a belt").motion, 50, []
    monkeypatch.setattr(phases, "_PATIENCE", most)
    monkeypatch.setattr(phases, "check", lambda: looks.append(0))
    model, given, span = motion.compile("auto"), (motion.initial, motion.parameters), (0.0, 800.0)
    whole = model.sweep(span, *given, threads=1)
    in_sweep = len(looks)
    run, p = model.prepare(span), model.parameter_vector(motion.parameters)
    run(model.state(*given), p)
    number, steps = int(whole.phases[0]), int(whole.steps[0])
    assert steps < 5 * number and number > 2 * most
    assert in_sweep >= number // most and len(looks) - in_sweep >= number // most
