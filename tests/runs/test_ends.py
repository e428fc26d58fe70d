"""Ends of runs: what a trajectory holds when a run ended before some of the times that were asked for, or all."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError
from dalembert.methods.status import Status

END = 1.0 / 3.0
START = {"x": 1.0, "y": 1.0, "x_dot": -3.0, "y_dot": -3.0}


def crossing_lines():
    """A point on x^2 = y^2, where the constraint loses its rank at the origin, reached after a third of a second."""
    x, y = dynamicsymbols("x y")
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", x * frame.x + y * frame.y)
    scene = da.Scene("lines", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("p", point, sp.Symbol("m", positive=True)))
    scene.add_holonomic_constraints(x**2 - y**2)
    return scene


def force(expression, x):
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", x * frame.x)
    scene = da.Scene("mass", frame=frame, origin=origin, coordinates=[x])
    scene.add_bodies(Particle("p", point, 1))
    scene.add_loads((point, expression * frame.x))
    return scene


@pytest.fixture(scope="module", params=["numpy", "llvm"])
def lines(request):
    return da.compile_model(crossing_lines(), backend=request.param, formulation="augmented")


def consistent(run, end):
    """Check that everything can be asked of a run, and nothing lies behind its end."""
    assert run.t_end == pytest.approx(end, rel=1e-4)
    assert run.q.shape == run.qdot.shape == (len(run.t), len(run.coordinates))
    assert run["energy"].shape == run.t.shape
    assert run.to_xarray().sizes["time"] == len(run.t)
    assert all(len(values) == len(run.t) for values in run.invariants.values())
    assert len(run.constraint_violation) == len(run.t)
    assert "Trajectory" in repr(run)
    if run.can_evaluate:
        assert run(0.9 * end).t_end == run.t_end
        assert run([]).q.shape == (0, len(run.coordinates))
        with pytest.raises(OptionError, match="which the run covers"):
            run(end + 0.5)


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize("wanted", [[], [9.9], [0.1, 9.9], None])
def test_a_run_that_loses_rank_holds_the_times_it_reached(lines, wanted, dense):
    run = lines.simulate((0, 9.9), START, {"m": 1.0}, t_eval=wanted, dense=dense)
    assert run.status is Status.SINGULAR_CONFIGURATION
    if wanted is not None:
        reached = [t for t in wanted if t < END]
        assert list(run.t) == (reached if dense else reached[: len(run.t)])
        assert run["x"] == pytest.approx(1.0 - 3.0 * run.t, abs=1e-6)
    if dense:
        consistent(run, END)
        assert run(0.3)["x"] == pytest.approx(0.1, abs=1e-5)


def test_backwards_too(lines):
    start = {name: -value if name.endswith("_dot") else value for name, value in START.items()}
    run = lines.simulate((0, -9.9), start, {"m": 1.0}, t_eval=[-0.2, -9.9])
    assert (run.status, list(run.t)) == (Status.SINGULAR_CONFIGURATION, [-0.2])
    assert run.t_end == pytest.approx(-END, rel=1e-4)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
@pytest.mark.parametrize("method", ["dop853", "radau"])
@pytest.mark.parametrize("wanted", [[], [2.0], [0.5, 0.5, 2.0]])
def test_a_run_that_fails(backend, method, wanted):
    """x = 1/(1 - t)^2 has no value at 1."""
    x = dynamicsymbols("x")
    model = da.compile_model(force(6 * x**2, x), backend=backend)
    run = model.simulate((0, 2), {"x": 1.0, "x_dot": 2.0}, {}, t_eval=wanted, method=method, rtol=1e-6)
    assert not run.success
    assert list(run.t) == [t for t in wanted if t < 1.0]
    consistent(run, 1.0)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_a_terminal_event_before_the_first_time(backend):
    x = dynamicsymbols("x")
    model = da.compile_model(force(-4 * x, x), backend=backend)
    run = model.simulate((0, 3), {"x": 1.0, "x_dot": 0.0}, {}, t_eval=[2.0], events=[da.Event(x, terminal=True)])
    assert (run.status, len(run.t)) == (Status.EVENT, 0)
    consistent(run, np.pi / 4)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_the_step_budget(backend):
    x = dynamicsymbols("x")
    model = da.compile_model(force(-4 * x, x), backend=backend)
    run = model.simulate((0, 3), {"x": 1.0, "x_dot": 0.0}, {}, t_eval=[3.0], max_steps=1, dense=False, method="dop853")
    assert (run.status, len(run.t)) == (Status.MAX_STEPS, 0)
    assert 0.0 < run.t_end < 3.0


@pytest.mark.parametrize("method", ["dop853", "rk45", "radau", "bdf", "lsoda"])
def test_no_absolute_tolerance_and_a_component_that_is_zero(method):
    """The numpy backend never came to an end."""
    x = dynamicsymbols("x")
    model = da.compile_model(force(1 - x, x), backend="numpy")
    run = model.simulate((0, 1), {"x": 0.0, "x_dot": 0.0}, {}, method=method, atol=0.0, rtol=1e-6, max_steps=5_000)
    assert run.success
    assert run["x"][-1] == pytest.approx(1.0 - np.cos(1.0), rel=1e-4)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_sweeps_that_record_nothing_or_fail_before(backend):
    x = dynamicsymbols("x")
    model = da.compile_model(force(6 * sp.Symbol("a") * x**2, x), backend=backend)
    start = {"x": 1.0, "x_dot": 2.0}
    for wanted in ([], [2.0]):
        sweep = model.sweep((0, 2), start, {"a": [1.0, 0.0]}, t_eval=wanted, rtol=1e-6)
        assert list(sweep.success) == [False, True]
        assert sweep["energy"].shape == sweep["x"].shape == (2, len(wanted))
        assert sweep.to_xarray().sizes["time"] == len(wanted)
        assert not np.any(np.isfinite(sweep["x"][0]))
        assert sweep.t == pytest.approx([1.0, 2.0], rel=1e-3)


def test_no_run_is_told_to_do_what_it_does():
    status = Status.SINGULAR_CONFIGURATION
    assert "projected" in status.message_for(("augmented",), "taylor")
    assert "projected" not in status.message_for(("projected",), "taylor")
    assert "implicit" in Status.MAX_STEPS.message_for(("minimal",), "dop853")
    assert "implicit" not in Status.MAX_STEPS.message_for(("minimal",), "radau")
    model = da.compile_model(crossing_lines(), formulation="projected")
    run = model.simulate((0, 1), START, {"m": 1.0})
    run.status = status
    assert "projected" not in run.message
    sweep = model.sweep((0, 1), START, {"m": [1.0, 2.0]})
    sweep.status[:] = status
    assert not any("projected" in failure.message for failure in sweep.failures())
