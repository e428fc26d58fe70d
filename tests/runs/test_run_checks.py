"""The registry of checks: a further check ends single runs and cases of sweeps alike."""

from dataclasses import replace

import numpy as np
import pytest

import dalembert as da
from dalembert.methods.status import Status
from dalembert.runs import run_checks
from dalembert.runs.run_check import RunCheck

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1.0, "b": 0.3, "I_C": 0.5}


class FarAway(RunCheck):
    """Ends runs whose sleigh has left the half-plane below x = `most`."""

    most = 0.5

    def __init__(self, place):
        self.place = place

    @classmethod
    def of(cls, model):
        return cls(model.layout.state.index("x")) if "x" in model.layout.state else None

    def before(self, problem):
        assert problem.max_steps > 0
        return problem

    def after(self, run):
        beyond = run.steps.y[:, self.place] > self.most
        if not np.any(beyond):
            return run.solution, "near"
        t = run.steps.t[np.argmax(beyond)]
        kept = run.solution.t < t
        cut = {"t": run.solution.t[kept], "y": run.solution.y[kept], "end": float(t)}
        return replace(run.solution, status=Status.EVENT, **cut), f"too far at t = {t:.3f}"

    def after_cases(self, method, block, done):
        done.ends[done.y[:, self.place] > self.most, 1] = float(Status.EVENT)


class Unreached(FarAway):
    """Must not be asked once another check has ended the run."""

    def after(self, run):
        raise AssertionError("asked after a check had ended the run")

    def after_cases(self, method, block, done):
        self.asked = True


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize("t_eval", [None, [0.0, 0.25, 0.5, 2.0]])
def test_a_further_check(monkeypatch, backend, t_eval):
    plain = da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend)
    assert plain.checks == ()
    monkeypatch.setattr(run_checks, "CHECKS", (FarAway, Unreached))
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend)
    assert [type(check) for check in model.checks] == [FarAway, Unreached]
    assert plain.simulate((0, 2), START, PARAMETERS, t_eval=t_eval).success
    run = model.simulate((0, 2), START, PARAMETERS, t_eval=t_eval)
    assert run.status is Status.EVENT and run["x"].max() <= 0.5 and "too far at t = " in run.message
    sweep = model.sweep((0, 0.7), {**START, "x_dot": [0.98, 0.098], "theta_dot": [2.0, 0.2]}, PARAMETERS)
    assert sweep.status.tolist() == [Status.EVENT, Status.SUCCESS]


def test_which_checks_models_have():
    """Scenes pay only for what can happen to them."""
    names = {
        "chaplygin_sleigh": [],
        "rolling_sphere": ["GimbalCheck"],
        "corner_plate": [],
    }
    for name, expected in names.items():
        model = da.compile_model(getattr(da.scenes, name)(), backend="numpy")
        assert [type(check).__name__ for check in model.checks] == expected, name
