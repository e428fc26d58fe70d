"""What symmetric and variational methods would give, and what the projection onto first integrals gives.

Beside tight Taylor steps stand RATTLE, and leapfrog of d'Alembert.

RATTLE (H. C. Andersen, J. Comput. Phys. 52, 1983) and its symmetric composition of order 8 with 17 stages (W. Kahan
and R.-C. Li, Math. Comp. 66, 1997) run the pendulum in Cartesian coordinates; the leapfrog of d'Alembert (R. I.
McLachlan and M. Perlmutter, J. Nonlinear Sci. 16, 2006) runs a nonholonomic particle in a potential.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numba import njit
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from hard_cases import hard_case

__all__ = ["kept_integrals", "symmetric_methods"]

G = 9.81
KAHAN_LI = (
    0.13020248308889008087881763,
    0.56116298177510838456196441,
    -0.38947496264484728640807860,
    0.15884190655515560089621075,
    -0.39590389413323757733623154,
    0.18453964097831570709183254,
    0.25837438768632204729397911,
    0.29501172360931029887096624,
    -0.60550853383003451169892108,
)
KEPT_SCENES = (
    ("pendulum, Cartesian (IFToMM A01)", "projected", 100.0),
    ("slider-crank", "projected", 5.0),
    ("heavy top, fast precession", "minimal", 20.0),
    ("double pendulum, angles", "minimal", 20.0),
)
KEPT_METHODS = (("dop853", 1e-6), ("taylor", 1e-6), ("taylor", 1e-12))
REPEATS = 9
STEPS = KAHAN_LI[:-1] + KAHAN_LI[-1:] + KAHAN_LI[-2::-1]


@njit
def _rattle(x, y, u, v, steps, h, stages):  # type: ignore[no-untyped-def]
    """Return the end of a RATTLE run of the pendulum, and the largest change of its energy."""
    start = (u * u + v * v) / 2 + G * y
    worst = 0.0
    for _ in range(steps):
        for share in stages:
            d = share * h
            px, py = x + d * u, y + d * v - d * d * G / 2
            # the multiplier along (x, y): |p - lam (x, y)| = 1
            along, size = px * x + py * y, px * px + py * py - 1.0
            norm = x * x + y * y
            lam = size / (along + math.sqrt(along * along - norm * size))
            nx, ny = px - lam * x, py - lam * y
            u, v = (nx - x) / d, (ny - y) / d - d * G / 2
            x, y = nx, ny
            mu = (u * x + v * y) / (x * x + y * y)
            u, v = u - mu * x, v - mu * y
        worst = max(worst, abs((u * u + v * v) / 2 + G * y - start))
    return x, y, u, v, worst


@njit
def _leapfrog(steps, h):  # type: ignore[no-untyped-def]
    """Return the end of a leapfrog run of z_dot = y x_dot, potential (x^2 + y^2 + z^2)/2, and its energy's change."""
    q = np.array([1.0, 0.0, 0.0])
    w = np.array([0.0, 1.0, 0.0])
    start = 0.5 * (q @ q + w @ w)
    worst = 0.0
    # half a step back, so that velocities stand between positions
    first = True
    for _ in range(steps):
        a = np.array([-q[1], 0.0, 1.0])
        if first:
            force = -q
            w = w + 0.5 * h * (force - a * (a @ force + w[1] * -w[0]) / (a @ a))
            first = False
        else:
            free = w + h * -q
            w, old = free - a * ((a @ (free + w)) / (a @ a)), w
            middle = 0.5 * (w + old)
            worst = max(worst, abs(0.5 * (q @ q + middle @ middle) - start))
        q = q + h * w
    return q, worst


def _pendulum(end: float) -> list[str]:
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    exact = case.expected([end])[0]
    rows = []
    for label, stages, steps in (
        ("RATTLE", (1.0,), 100_000),
        ("RATTLE", (1.0,), 1_000_000),
        ("RATTLE of order 8, 17 stages", STEPS, 4_000),
        ("RATTLE of order 8, 17 stages", STEPS, 16_000),
    ):
        _rattle(-1.0, 0.0, 0.0, 0.0, 1, 1e-3, stages)
        begin = time.perf_counter()
        *state, worst = _rattle(-1.0, 0.0, 0.0, 0.0, steps, end / steps, stages)
        seconds = time.perf_counter() - begin
        error = float(np.max(np.abs(np.array(state) - exact)))
        rows.append(_row("pendulum, Cartesian", label, f"{steps * len(stages):,} forces", error, worst / G, seconds))
    model = case.compile("projected")
    options = {"method": "taylor", "rtol": 1e-16, "atol": 1e-18, "dense": False}
    for _ in range(2):
        run = model.simulate((0, end), case.initial, case.parameters, t_eval=[end], **options)
    error = float(np.max(np.abs(case.observe(_after(run)) - exact)))
    drift = abs(float(run["energy"][-1])) / G
    rows.append(
        _row("", "Taylor, projected, 1e-16", f"{run.stats.steps:,} series", error, drift, run.stats.run_seconds)
    )
    return rows


class _after:
    """A run with its only time twice, as `HardCase.observe` leaves out the first."""

    def __init__(self, run: da.results.trajectory.Trajectory) -> None:  # type: ignore[name-defined]
        self.run = run

    def __getitem__(self, name: str) -> np.ndarray:
        return np.repeat(self.run[name], 2)


def _particle(end: float) -> list[str]:
    x, y, z = q = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    body = Particle("particle", P, 1)
    body.potential_energy = (x**2 + y**2 + z**2) / 2
    scene = da.Scene("nonholonomic_oscillator", frame=N, origin=O, coordinates=q)
    scene.add_bodies(body)
    scene.add_loads((P, -(x * N.x + y * N.y + z * N.z)))
    scene.add_nonholonomic_constraints(z.diff() - y * x.diff())
    model = da.compile_model(scene)
    start = {"x": 1.0, "y": 0.0, "z": 0.0, "x_dot": 0.0, "y_dot": 1.0}
    options = {"method": "taylor", "dense": False, "max_steps": 10_000_000}
    exact = model.simulate((0, end), start, {}, rtol=1e-16, atol=1e-18, t_eval=[0, end], **options)
    goal = exact.q[-1]
    rows = []
    _leapfrog(2, 1e-3)
    for h in (1e-2, 1e-3):
        begin = time.perf_counter()
        state, worst = _leapfrog(round(end / h), h)
        seconds = time.perf_counter() - begin
        error = float(np.max(np.abs(state - goal)))
        rows.append(
            _row("particle, z_dot = y x_dot", "leapfrog", f"{round(end / h):,} forces", error, float(worst), seconds)
        )
    drift = float(np.ptp(exact["energy"]))
    label = f"{exact.stats.steps:,} series"
    rows.append(_row("", "Taylor, minimal, 1e-16", label, math.nan, drift, exact.stats.run_seconds))
    return rows


def _row(scene: str, method: str, work: str, error: float, drift: float, seconds: float) -> str:
    shown = "reference" if math.isnan(error) else f"{error:.0e}"
    return f"| {scene} | {method} | {work} | {shown} | {drift:.0e} | {1e3 * seconds:.3g} |"


def symmetric_methods() -> str:
    """Return a table of what the methods give."""
    makers: list[Callable[[float], list[str]]] = [_pendulum, _particle]
    rows = [row for make, end in zip(makers, (100.0, 1000.0), strict=True) for row in make(end)]
    head = (
        "| scene | method | work | error at the end | largest change of energy | ms |\n|---|---|---:|---:|---:|---:|\n"
    )
    return head + "\n".join(rows) + "\n\n(the pendulum over 100 s, the particle over 1000)"


def kept_integrals() -> str:
    """Return a table of runs without and with all first integrals kept after every step, against a tight run."""
    rows, tight = [], {"method": "taylor", "rtol": 1e-16, "atol": 1e-18}
    for name, formulation, end in KEPT_SCENES:
        case, shown = hard_case(name), f"{name}, {end:g} s"
        model = case.compile(formulation)
        exact = model.simulate((0, end), case.initial, case.parameters, t_eval=[end], **tight)
        for method, rtol in KEPT_METHODS:
            options = {"method": method, "rtol": rtol, "atol": 1e-2 * rtol, "dense": False, "max_steps": 10_000_000}
            runs, seconds = {}, {False: math.inf, True: math.inf}
            for _ in range(REPEATS):
                for keep in seconds:
                    runs[keep] = model.simulate(
                        (0, end), case.initial, case.parameters, t_eval=[0, end], project_invariants=keep, **options
                    )
                    seconds[keep] = min(seconds[keep], runs[keep].stats.run_seconds)
            errors = " / ".join(f"{float(np.max(np.abs(run.q[-1] - exact.q[-1]))):.0e}" for run in runs.values())
            drifts = " / ".join(f"{float(np.ptp(run['energy'])):.0e}" for run in runs.values())
            ratio = seconds[True] / seconds[False]
            rows.append(
                f"| {shown} | {method}, {rtol:.0e} | {runs[True].stats.steps:,} | {errors} | {drifts} | {ratio:.1f} |"
            )
            shown = ""
    head = "| scene | method, rtol | steps | error at the end | change of energy | time, with over without |\n"
    return head + "|---|---|---:|---:|---:|---:|\n" + "\n".join(rows)


if __name__ == "__main__":
    print(kept_integrals())
