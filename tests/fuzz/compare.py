"""The comparison of one scene: dalembert on several paths against the reference, each judged."""

from __future__ import annotations

import math
import time
import traceback
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

import dalembert as da
from dalembert.errors import DalembertError, FormulationError, InitialStateError
from fuzz.description import Description, PointCondition
from fuzz.scene_builder import scene_of
from fuzz.summary import ORDER
from fuzz.verdicts import Judge

__all__ = ["Report", "compared"]

RTOL, ATOL = 1e-10, 1e-12
BOUNDS = {"minimal": 1e-7, "projected": 1e-7, "auto": 1e-7, "baumgarte": 1e-5, "ggl": 1e-6, "augmented": 1e-6}
"""Largest relative errors of motions at these tolerances."""
SOLVABLE = ("regular", "redundant", "empty constraint")
"""Verdicts of scenes that have one motion."""
OTHERS = ("minimal", "projected", "baumgarte", "ggl", "augmented")


@dataclass
class Report:
    """What became of a scene: outcome and detail for each path, seconds for each part."""

    seed: int
    verdict: str = ""
    paths: dict[str, tuple[str, str]] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """The worst outcome of a path."""
        return max((outcome for outcome, _ in self.paths.values()), key=ORDER.__getitem__, default="agree")

    def add(self, path: str, outcome: str, detail: str = "") -> None:
        """Take down the outcome of a path."""
        self.paths[path] = (outcome, detail[:600])


def compared(description: Description, *, formulations: bool = False, backends: bool = False) -> Report:
    """Return what became of a scene on the default path, and on others where they are asked for."""
    report = Report(description.seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _Comparison(description, report).run(formulations, backends)
    return report


class _Comparison:
    """One scene in the course of being compared."""

    def __init__(self, description: Description, report: Report) -> None:
        self.description, self.report = description, report
        self.judge = Judge(description)
        self.initial = {key: value for key, value in description.start.items() if key not in description.left_out}
        self.parameters = dict(description.parameters)
        self.span = description.span
        self.motion_of: Any = None
        """The first model that runs: others that end early are judged by its motion."""

    def timed(self, part: str, function: Any) -> Any:
        """Return what a function returns; its seconds are added to those of a part."""
        begin = time.process_time()
        try:
            return function()
        finally:
            self.report.seconds[part] = round(self.report.seconds.get(part, 0.0) + time.process_time() - begin, 3)

    def run(self, formulations: bool, backends: bool) -> None:
        """Compare on all paths that are asked for."""
        self.verdict = self.timed("reference", lambda: self.judge.verdict)
        self.report.verdict = f"{self.verdict.kind} {self.verdict.detail}".strip()
        scene = self.timed("build", lambda: scene_of(self.description))
        if self.verdict.kind in SOLVABLE:
            self.timed("reference", lambda: self.judge.motion)
        self._path("auto", scene, "auto", "llvm", whole=True)
        if formulations:
            for name in OTHERS:
                self._path(name, scene, name, "llvm")
        if backends:
            for name in ("numpy", "jax"):
                self._path(name, scene, "auto", name)

    # --- one path ---

    def _path(self, path: str, scene: Any, formulation: str, backend: str, *, whole: bool = False) -> None:
        outputs = self._reactions() if whole else []
        compile_it = lambda: da.compile_model(  # noqa: E731
            scene, formulation=formulation, backend=backend, outputs=outputs, cache=True
        )
        model = self._guarded(path, "compile", compile_it, allowed=(FormulationError,) if formulation != "auto" else ())
        if model is None:
            return
        bound = BOUNDS[formulation]
        known = model.layout.parameters
        self.parameters = {key: value for key, value in self.description.parameters.items() if key in known}
        if whole:
            self._guarded(f"{path} accelerations", "evaluate", lambda: self._accelerations(path, scene, model))
            self._guarded(f"{path} contradiction", "run", lambda: self._contradicted(f"{path} contradiction", model))
        run = self._guarded(path, "run", lambda: self._simulate(path, model, bound))
        if run is None or not whole:
            return
        self._guarded(f"{path} sweep", "sweep", lambda: self._sweep(f"{path} sweep", model, run, bound))
        self._guarded(f"{path} prepared", "prepared", lambda: self._prepared(f"{path} prepared", model, run))
        self._guarded(f"{path} sensitivity", "sensitivity", lambda: self._sensitivity(f"{path} sensitivity", model))

    def _guarded(self, path: str, part: str, function: Any, allowed: tuple[Any, ...] = ()) -> Any:
        """Return what a function returns; judge what it raises, and return None then."""
        try:
            return self.timed(part, function)
        except allowed as reason:
            self.report.add(path, "refused rightly", f"{type(reason).__name__}: {reason}")
        except DalembertError as reason:
            self._refused(path, f"{type(reason).__name__}: {reason}")
        except Exception as reason:
            where = traceback.extract_tb(reason.__traceback__)[-1]
            place = f"{where.filename.rpartition('/src/')[2]}:{where.lineno}"
            self.report.add(path, "BARE EXCEPTION", f"{type(reason).__name__}: {reason} at {place}")
        return None

    def _refused(self, path: str, text: str) -> None:
        """Judge a refusal by name."""
        kind = self.verdict.kind
        if kind in ("contradictory", "singular", "singular start", "undefined", "empty constraint"):
            self.report.add(path, "refused rightly", f"{kind}: {text}")
        elif kind == "unclear":
            self.report.add(path, "set aside", f"{self.verdict.detail}: {text}")
        elif path.endswith("sensitivity") and self._jumps():
            self.report.add(path, "refused rightly", f"jumps: {text}")
        else:
            self.report.add(path, "FALSE REFUSAL", text)

    def _singular_time(self) -> float | None:
        """Return when a motion, which a single run has, passes a configuration where the reference finds a rank lost.

        Steps of a single run may jump over the place; derivatives are without bound there.
        """
        model = self.motion_of
        run = model.simulate(self.span, self.initial, self.parameters, rtol=RTOL, atol=ATOL, max_steps=200_000)
        place = np.argsort(self._order(model))
        times = np.linspace(*self.span, 201)

        def gap(t: float) -> float:
            at = run(np.array([t]))
            return self.judge.smallest_gap([t], [np.concatenate([at.q[0][place], at.qdot[0][place]])])

        best = int(np.argmin([gap(t) for t in times]))
        low, high = times[max(best - 1, 0)], times[min(best + 1, 200)]
        found = minimize_scalar(gap, bounds=(low, high), method="bounded", options={"xatol": 1e-9})
        return float(found.x) if float(found.fun) < 1e-5 else None

    def _jumps(self) -> bool:
        return any(kink.jumps or kink.time_jumps for kink in self.judge.kinks)

    def _reactions(self) -> list[str]:
        """Return the unknown reactions, where they are determined."""
        if self.verdict.kind != "regular":
            return []
        items = self.description.constraints
        return [item.reaction for item in items if isinstance(item, PointCondition) and item.reaction]

    # --- what is compared ---

    def _accelerations(self, path: str, scene: Any, model: Any) -> None:
        if self.verdict.kind not in SOLVABLE or self.judge.motion.failed:
            return
        worst, order = 0.0, self._order(model)
        n, evaluate = len(order), self._evaluator(scene, model)
        for t, y, truth in self.judge.solved_along()[:3]:
            if self._at_kink(t) or self.judge.contradictory(truth):
                continue
            ours = evaluate(t, y[:n][order], y[n:][order])
            # terms of gravity that cancel, which the scale does not know, leave some 4e-15 of rounding
            error = float(np.max(np.abs(ours - truth.qdd[0][order]))) / max(float(truth.scale[0]), 1e-5)
            worst = max(worst, error if math.isfinite(error) else math.inf)
        self.report.errors[f"{path} accelerations"] = worst
        if worst > 1e-9:
            self.report.add(f"{path} accelerations", "WRONG", f"relative error {worst:.1e}")
        else:
            self.report.add(f"{path} accelerations", "agree")

    def _evaluator(self, scene: Any, model: Any) -> Any:
        """Return a function of (t, q, qdot) that gives second rates: of the model in some scenes, else by NumPy."""
        if self.description.seed % 8:
            model = da.compile_model(scene, formulation=model.formulation, backend="numpy")
        return lambda t, q, qdot: model.accelerations(t, q, qdot, self.parameters)

    def _order(self, model: Any) -> list[int]:
        """Return the places of the model's coordinates among those of the description."""
        return [self.description.coordinates.index(name) for name in model.layout.coordinates]

    def _at_kink(self, t: float) -> bool:
        """Whether a load may jump at a time, where the values on its two sides differ; at the start they may, too."""
        at_start = bool(self.judge.kinks) and abs(t - self.span[0]) < 1e-9
        return at_start or any(abs(t - stop) < 1e-9 for stop in self.judge.stops)

    def _simulate(self, path: str, model: Any, bound: float) -> Any:
        run = model.simulate(
            self.span, self.initial, self.parameters, t_eval=self.judge.times, rtol=RTOL, atol=ATOL, max_steps=200_000
        )
        if not run.success:
            self._ended(path, run.status, run.message, float(run.t_end))
            return None
        self.motion_of = self.motion_of or model
        if not self._comparable(path, "SUCCESS"):
            return None
        keys = [*self.description.coordinates, *(f"{name}_dot" for name in self.description.coordinates)]
        ours = np.column_stack([run[key] for key in keys])
        error = self._error(ours, self.judge.motion.y[:, :, 2])
        if not self._judged(path, error, bound, f"t = {self.span}"):
            return None
        self._compare_reactions(path, run)
        return run

    def _contradicted(self, path: str, model: Any) -> None:
        """Compare what becomes of a start with a rate that the constraints exclude: it must be refused by name."""
        if self.verdict.kind not in SOLVABLE or not self.description.constraints:
            return
        n = len(self.description.coordinates)
        rows = self.judge.rows_at_start()
        j = int(np.argmax(np.abs(rows).max(axis=0)))
        y = self.judge.states(self.judge.middle)[:, 0]
        initial = {f"{name}_dot": y[n + i] for i, name in enumerate(self.description.coordinates)}
        initial |= {name: y[i] for i, name in enumerate(self.description.coordinates)}
        initial[f"{self.description.coordinates[j]}_dot"] += 0.3
        if 0.3 * np.abs(rows[:, j]).max() < 1e-2:
            return
        try:
            state = model.state(initial, self.parameters, t=self.span[0])
        except InitialStateError:
            self.report.add(path, "agree")
            return
        self.report.add(path, "WRONG", f"a start that contradicts the constraints is taken as {state}")

    def _comparable(self, path: str, text: str) -> bool:
        """Whether there is a reference motion; where there is none, judge that dalembert has one."""
        kind = self.verdict.kind
        if kind in ("unclear", "singular start", "undefined"):
            self.report.add(path, "set aside", f"{self.report.verdict}; {text}")
        elif kind in ("contradictory", "singular"):
            self.report.add(path, "WRONG", f"{self.report.verdict}, accepted with {text}")
        elif self.judge.motion.failed:
            lost = text != "SUCCESS" and (self.judge.motion.regular < 1e-5 or self.judge.motion.gap < 1e-4)
            self.report.add(path, "refused rightly" if lost else "set aside", f"{self.judge.motion.failed}: {text}")
        elif len(self.judge.motion.ranks) > 1 or self.judge.motion.gap < 1e-5 or self.judge.motion.regular < 1e-9:
            self.report.add(path, "set aside", f"nearly singular on the way: {self._worst()}")
        else:
            return True
        return False

    def _worst(self) -> str:
        motion = self.judge.motion
        return f"singular value {motion.gap:.1e}, mass matrix {motion.regular:.1e}, ranks {sorted(motion.ranks)}"

    def _ended(self, path: str, status: Any, message: str, t: float) -> None:
        """Judge a run that ended early."""
        text = f"{status.name} at t = {t:.6g}: {message[:100]}"
        if self.verdict.kind not in SOLVABLE:
            self._refused(path, text)
        elif not self._comparable(path, text):
            pass
        elif status.name == "SINGULAR_CONFIGURATION" and self.motion_of and self._near(t, self._singular_time()):
            self.report.add(path, "refused rightly", f"the motion passes a singular configuration: {text}")
        else:
            self.report.add(path, "FALSE REFUSAL", f"{text} (on the way: {self._worst()})")

    def _near(self, t: float, other: float | None) -> bool:
        return other is not None and abs(t - other) < 0.02 * abs(self.span[1] - self.span[0])

    def _error(self, ours: Any, truth: Any) -> float:
        """Return the largest error of states (..., 2 n), relative to their size."""
        error = float(np.max(np.abs(ours - truth) / self.judge.sizes[:, 0]))
        return error if math.isfinite(error) else math.inf

    def _judged(self, path: str, error: float, bound: float, what: str, unsure: float | None = None) -> bool:
        """Take down an error; where it is too large, ask how sure the reference is of itself, unless that is given."""
        self.report.errors[path] = max(error, self.report.errors.get(path, 0.0))
        if error <= bound:
            if path not in self.report.paths:
                self.report.add(path, "agree")
            return True
        if unsure is None:
            unsure = self.timed("reference", lambda: self.judge.uncertainty)
        if error <= max(bound, 300 * unsure) and error < 1e-2:
            self.report.add(path, "set aside", f"ill conditioned: error {error:.1e}, reference {unsure:.1e}")
        else:
            self.report.add(path, "WRONG", f"error {error:.2e}, reference sure to {unsure:.1e}; {what}")
        return False

    def _compare_reactions(self, path: str, run: Any) -> None:
        names = self._reactions()
        if not names:
            return
        worst = 0.0
        for i, (t, _, truth) in enumerate(self.judge.solved_along()):
            if self._at_kink(t):
                continue
            for j, item in enumerate(self.description.constraints):
                name = getattr(item, "reaction", "")
                if name in names and name in run.names:
                    scale = max(1.0, float(np.abs(truth.multipliers[0]).max()))
                    worst = max(worst, abs(float(run[name][i]) - float(truth.multipliers[0][j])) / scale)
        self._judged(f"{path} reactions", worst, 1e-5, "reactions")

    def _sweep(self, path: str, model: Any, run: Any, bound: float) -> None:
        variation = self.description.variation
        assert variation is not None
        cases = [0, 2, 4]
        values = np.array(variation.values)[cases]
        initial, parameters = dict(self.initial), dict(self.parameters)
        (parameters if variation.name in parameters else initial)[variation.name] = values
        sweep = model.sweep(self.span, initial, parameters, rtol=RTOL, atol=ATOL, max_steps=200_000, threads=1)
        if not sweep.success[1]:
            self.report.add(path, "FALSE REFUSAL", f"middle case: {sweep.failures()[0].message}")
            return
        names = self.description.coordinates
        final = sweep.final
        ours = np.column_stack([final[key] for key in (*names, *(f"{name}_dot" for name in names))])
        for i, case in enumerate(cases):
            if not sweep.success[i]:
                self.report.add(path, "FALSE REFUSAL", f"case {i}: {sweep.failures()[0].message}")
                return
            if not self._judged(path, self._error(ours[i], self.judge.motion.y[-1, :, case]), bound, f"case {i}"):
                return
        single = np.concatenate([run.q[-1], run.qdot[-1]])
        order = [*self._order(model), *(len(names) + i for i in self._order(model))]
        self._judged(path, self._error(ours[1][order], single), 1e-8, "middle case against the single run")

    def _prepared(self, path: str, model: Any, run: Any) -> None:
        if not model.layout.state:
            return
        prepared = model.prepare(self.span, rtol=RTOL, atol=ATOL, max_steps=200_000)
        y = prepared(
            model.state(self.initial, self.parameters, t=self.span[0]), model.parameter_vector(self.parameters)
        )
        if not prepared.status.success:
            self.report.add(path, "FALSE REFUSAL", prepared.status.name)
            return
        ours = model.expand(self.span[1], y, self.parameters)
        self._judged(path, self._error(ours, np.concatenate([run.q[-1], run.qdot[-1]])), 1e-8, "against the single run")

    def _sensitivity(self, path: str, model: Any) -> None:
        variation = self.description.variation
        assert variation is not None
        if variation.name not in self.parameters and variation.name not in self.initial:
            return
        found = model.sensitivity(
            self.span, self.initial, self.parameters, wrt=[variation.name], t_eval=self.judge.times[[0, -1]],
            rtol=RTOL, atol=ATOL, max_steps=200_000,
        )  # fmt: skip
        if not found.success:
            lost = (
                found.status.name in ("PROJECTION_FAILED", "SINGULAR_CONFIGURATION")
                and self._singular_time() is not None
            )
            text = f"{found.status.name}: the motion passes a singular configuration" if lost else found.status.name
            self.report.add(path, "refused rightly" if lost else "FALSE REFUSAL", text)
            return
        names = self.description.coordinates
        ours = np.array(
            [found.jacobian(key, variation.name)[-1] for key in (*names, *(f"{name}_dot" for name in names))]
        )
        error, unsure = _relative(ours, self.judge.quotient), None
        if self._jumps():
            self.report.add(path, "set aside" if error > 1e-5 else "agree", "derivative across a jump")
            return
        bound = 1e-3 if any(kink.of_state for kink in self.judge.kinks) else 1e-5
        if error > bound:
            truth, unsure = self.timed("reference", lambda: self.judge.derivative)
            error = _relative(ours, truth)
        self._judged(path, error, bound, "sensitivity", unsure)


def _relative(ours: Any, truth: Any) -> float:
    """Return the largest error of derivatives, relative to the largest of them, one at least."""
    return float(np.max(np.abs(ours - truth)) / max(1.0, float(np.max(np.abs(truth)))))
