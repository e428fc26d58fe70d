"""Published benchmarks beside general solvers: ``python benchmarks/published_peers.py`` measures and draws.

SciPy, SUNDIALS (through CasADi) and diffrax integrate the right-hand side that dalembert derives, each compiled as the
peer likes it best: by numba, as C by the compiler of this machine, by XLA. None of them projects. Of each solver the
picture docs/published_errors.png shows the runs that no other run of it beats in both error and time; `--draw` draws
what was measured before, from benchmarks/results/published.json.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from exact import ROOT  # puts tests/ on the path
from figures import COLOURS
from matplotlib.figure import Figure
from measure import machine
from numpy.typing import NDArray
from report_published import MOTIONS

from hard_cases import hard_case
from hard_cases.case import HardCase

__all__ = ["draw", "fastest", "main"]

FloatArray: TypeAlias = NDArray[np.float64]
Run: TypeAlias = Callable[[], FloatArray | None]
"""Returns states (n_times, n_y), or None where the run failed."""

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
LIMIT = 5.0
"""Seconds that a run may take; tighter tolerances of the same method are left out then."""
CALLS = 5
_STEPS = 200_000
RESULTS = Path(ROOT) / "benchmarks" / "results" / "published.json"
PICTURE = Path(ROOT) / "docs" / "published_errors.png"

CASES: dict[str, tuple[Callable[[], HardCase], float]] = {
    **{motion.title: (motion.case, motion.end) for motion in MOTIONS},
    "heavy top, fast precession": (partial(hard_case, "heavy top, fast precession"), 10.0),
    "Routh sphere": (partial(hard_case, "Routh sphere"), 20.0),
}
STIFF = ("flyball", "flexible")
"""Words in the titles of cases on which implicit methods are tried."""


class Task:
    """A case as peers take it: the right-hand side, the start, times, and errors of states.

    Parameters
    ----------
    title : str
        A key of `CASES`.
    """

    def __init__(self, title: str) -> None:
        make, end = CASES[title]
        self.title, self.case = title, make()
        self.stiff = any(word in title for word in STIFF)
        self.times = np.array([0.0, *(t for t in self.case.times(all_of_them=True) if t <= end)])
        self.model = self.case.compile("auto")
        given = self.case.initial, self.case.parameters
        self.y, self.p = self.model.state(*given), self.model.parameter_vector(self.case.parameters)
        self.functions = self.model.to_casadi()

    def error(self, states: FloatArray) -> float:
        """Return the largest scaled error of what the case observes, from states (n_times, n_y) after the start."""
        layout, expected = self.model.layout, self.case.expected(list(self.times[1:]))
        rows = []
        for t, y in zip(self.times[1:], states, strict=True):
            found = dict(zip(layout.outputs, self._values("outputs", t, y), strict=True)) if layout.outputs else {}
            found |= dict(zip(layout.variables, self._values("expand", t, y), strict=True))
            rows.append([found[str(x)] for x in self.case.observed])
        return float(np.max(np.abs(np.array(rows) - expected) / self.case.sizes(expected)))

    def _values(self, name: str, t: float, y: FloatArray) -> FloatArray:
        return np.asarray(self.functions[name](t, y, self.p, [])).ravel()


# -- solvers ------------------------------------------------------------------------------------


def ours(task: Task, method: str, rtol: float) -> Run:
    """Return a run of dalembert, by `simulate`."""
    options = {"method": method, "rtol": rtol, "atol": rtol / 100, "dense": False, "max_steps": _STEPS}
    given = (0.0, task.times[-1]), task.case.initial, task.case.parameters

    def run() -> FloatArray | None:
        done = task.model.simulate(*given, t_eval=task.times, **options)
        return done.y[1:] if done.success else None

    return run


def scipy_run(task: Task, method: str, rtol: float) -> Run:
    """Return a run of `scipy.integrate.ode`, or of Radau by `solve_ivp`, on a right-hand side compiled by numba."""
    import numba
    from scipy.integrate import ode, solve_ivp

    kernels = task.case.compile(task.model.formulation, backend="numba").kernels
    c, rhs = np.empty(task.model.layout.constants), kernels.rhs
    kernels.prepare(task.p, c)

    @numba.njit
    def rates(t: float, y: FloatArray) -> FloatArray:
        out = np.empty_like(y)
        rhs(t, y, c, out)
        return out

    tolerances = {"rtol": rtol, "atol": rtol / 100}
    if method == "Radau":

        def implicit() -> FloatArray | None:
            span = (0.0, task.times[-1])
            done = solve_ivp(rates, span, task.y, method="Radau", t_eval=task.times[1:], **tolerances)
            return done.y.T if done.success else None

        return implicit
    solver = ode(rates).set_integrator(method, nsteps=_STEPS, **tolerances)

    def run() -> FloatArray | None:
        solver.set_initial_value(task.y, 0.0)
        rows = [solver.integrate(t).copy() for t in task.times[1:]]
        return np.array(rows) if solver.successful() else None

    return run


def sundials_run(task: Task, method: str, rtol: float) -> Run:
    """Return a run of CVODES: Adams' formulas with functional iteration, or BDF with Newton's."""
    import casadi

    adams = {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
    own = {"reltol": rtol, "abstol": rtol / 100, "max_num_steps": _STEPS, **(adams if method == "Adams" else {})}
    if shutil.which("gcc") and len(task.y) < 50:
        own |= {"jit": True, "compiler": "shell", "jit_options": {"compiler": "gcc", "flags": ["-O3", "-march=native"]}}
    t, y = casadi.SX.sym("t"), casadi.SX.sym("y", len(task.y))
    equations = {"t": t, "x": y, "ode": task.functions["rhs"](t, y, casadi.DM(task.p), casadi.DM(0, 1))}
    integrator = casadi.integrator("run", "cvodes", equations, 0.0, list(task.times[1:]), own)
    start = casadi.DM(task.y)

    def run() -> FloatArray | None:
        try:
            return np.asarray(integrator(x0=start)["xf"]).T
        except RuntimeError:
            return None

    return run


def diffrax_run(task: Task, method: str, rtol: float) -> Run:
    """Return a jitted run of diffrax in double precision."""
    import diffrax
    import jax
    import jax.numpy as jnp

    field = task.case.compile(task.model.formulation, backend="jax").vector_field
    controller = diffrax.PIDController(rtol=rtol, atol=rtol / 100)

    @jax.jit
    def solve(y: Any, p: Any) -> Any:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            getattr(diffrax, method)(),
            t0=0.0,
            t1=task.times[-1],
            dt0=None,
            y0=y,
            args=p,
            stepsize_controller=controller,
            saveat=diffrax.SaveAt(ts=task.times[1:]),
            max_steps=_STEPS,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        )
        return found.ys, found.result == diffrax.RESULTS.successful

    def run() -> FloatArray | None:
        with jax.enable_x64(True):
            rows, good = solve(jnp.asarray(task.y), jnp.asarray(task.p))
            return np.asarray(rows) if bool(good) else None

    return run


def contenders(task: Task) -> Iterator[tuple[str, str, Callable[..., Run]]]:
    """Yield the name of a solver, a method and what makes its runs."""
    yield "dalembert", "auto", ours
    for method in ("lsoda", "Radau") if task.stiff else ("dop853",):
        yield "SciPy", method, scipy_run
    for method in ("BDF",) if task.stiff else ("Adams", "BDF"):
        yield "SUNDIALS", method, sundials_run
    if len(task.y) < 50:  # XLA compiles a right-hand side of forty windows for minutes
        yield "diffrax", "Kvaerno5" if task.stiff else "Dopri8", diffrax_run


# -- measuring and drawing ----------------------------------------------------------------------


def measured(task: Task) -> Iterator[dict[str, Any]]:
    """Yield the error and the least time of every run of a case."""
    for solver, method, make in contenders(task):
        for rtol in TOLERANCES:
            run = make(task, method, rtol)
            begin = time.perf_counter()
            states = run()  # compiles
            slow = time.perf_counter() - begin > LIMIT
            if states is None or not np.all(np.isfinite(states)):
                continue
            seconds = []
            while len(seconds) < (1 if slow else CALLS):
                begin = time.perf_counter()
                run()
                seconds.append(time.perf_counter() - begin)
            row = {"case": task.title, "solver": solver, "method": method, "rtol": rtol}
            yield {**row, "error": task.error(states), "ms": round(1e3 * min(seconds), 4)}
            if slow and min(seconds) > LIMIT:
                break


def fastest(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the runs that no other one beats in both error and time, from the largest error to the least."""
    kept = []
    for row in sorted(rows, key=lambda row: (row["ms"], row["error"])):
        if not kept or row["error"] < kept[-1]["error"]:
            kept.append(row)
    return kept


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw error against time, a panel for each case."""
    titles = list(dict.fromkeys(row["case"] for row in rows))
    figure = Figure(figsize=(15, 6.4), layout="constrained")
    panels = figure.subplots(2, -(-len(titles) // 2), squeeze=False).ravel()
    colours = {"dalembert": COLOURS["dalembert llvm"], "SUNDIALS": COLOURS["CasADi"]}
    for panel, title in zip(panels, titles, strict=False):
        for solver in dict.fromkeys(row["solver"] for row in rows):
            line = fastest([row for row in rows if row["case"] == title and row["solver"] == solver])
            time_ms, error = [row["ms"] for row in line], [max(row["error"], 1e-17) for row in line]
            colour = colours.get(solver) or COLOURS[solver]
            panel.loglog(error, time_ms, "o-", color=colour, label=solver, markersize=4)
        panel.set_title(title, fontsize=10)
        panel.invert_xaxis()
        panel.grid(alpha=0.3)
    for panel in panels[len(titles) :]:
        panel.set_visible(False)
    figure.supxlabel("largest error of what is observed, relative to max(scale, size)")
    figure.supylabel("time of a run in ms")
    panels[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure, write and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draw", action="store_true", help="only draw what was measured before")
    parser.add_argument("--cases", default="", help="only cases whose titles contain this")
    options = parser.parse_args()
    if not options.draw:
        rows = []
        for title in CASES:
            if options.cases in title:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    found = list(measured(Task(title)))
                for row in found:
                    print(*row.values(), sep="\t", flush=True)
                rows += found
        if options.cases:
            return
        RESULTS.write_text(json.dumps({"machine": machine(), "runs": rows}, indent=1) + "\n", encoding="utf-8")
    draw(json.loads(RESULTS.read_text(encoding="utf-8"))["runs"], PICTURE)


if __name__ == "__main__":
    main()
