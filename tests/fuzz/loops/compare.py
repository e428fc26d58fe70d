"""Runs of mechanisms against their motions in independent coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

import dalembert as da
from fuzz.loops.mechanisms import FAMILIES, Draw, G, Mechanism

__all__ = ["compared", "examined", "initial_values", "mechanism_of", "motion_by_hand"]

METHODS = "auto", "taylor", "dop853"


def mechanism_of(seed: int) -> tuple[str, Mechanism]:
    """Return the mechanism of a seed, and its family: these come in turn."""
    name = list(FAMILIES)[seed % len(FAMILIES)]
    return name, FAMILIES[name](Draw(seed))


def _values_by_hand(found: Mechanism) -> Any:
    """Return a function of independent coordinates and rates: coordinates and rates of the scene, in its order."""
    rates = [sp.Symbol(f"{s}_dot") for s in found.free]
    nodes = [sp.sympify(node) for node in found.by_hand.values()]
    speeds = [sum(node.diff(s) * rate for s, rate in zip(found.free, rates, strict=True)) for node in nodes]
    return sp.lambdify([*found.free, *rates], [*nodes, *speeds], "math", cse=True)


def initial_values(found: Mechanism) -> dict[str, float]:
    """Return initial coordinates and rates of the scene."""
    names = [*found.by_hand, *(f"{name}_dot" for name in found.by_hand)]
    return dict(zip(names, map(float, _values_by_hand(found)(*found.start, *found.rates)), strict=True))


def motion_by_hand(found: Mechanism, times: Any) -> Any:
    """Return coordinates of the scene (n_q, k) at times, by Lagrange's equations in the independent coordinates."""
    n, free = len(found.free), found.free
    rates = [sp.Symbol(f"{s}_dot") for s in free]
    inertia, force = sp.zeros(n, n), sp.zeros(n, 1)
    for place, mass in zip(found.places, found.masses, strict=True):
        slopes = place.jacobian(free)
        speed = slopes * sp.Matrix(rates)
        inertia += mass * slopes.T * slopes
        force += mass * slopes.T * (G * found.down - speed.jacobian(free) * sp.Matrix(rates))
    both = sp.lambdify([*free, *rates], [inertia, force], "numpy", cse=True)

    def slope(_: float, y: Any) -> Any:
        matrix, supplied = both(*y)
        return [*y[n:], *np.linalg.solve(matrix, supplied)[:, 0]]

    start = [*found.start, *found.rates]
    run = solve_ivp(slope, (0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-12, atol=1e-13)
    values = _values_by_hand(found)
    return np.array([values(*row)[: len(found.by_hand)] for row in run.y.T]).T


def examined(seed: int, formulation: str = "auto", method: str = "auto", rtol: float = 1e-9) -> tuple[str, str]:
    """Return the outcome of one mechanism, "agree", "ended" with a status, or "WRONG", and what is known of it."""
    return compared(*mechanism_of(seed), formulation, method, rtol)


def compared(
    name: str, found: Mechanism, formulation: str = "auto", method: str = "auto", rtol: float = 1e-9
) -> tuple[str, str]:
    """Return the outcome of a mechanism, as `examined` does."""
    times = np.linspace(0, found.duration, 9)
    model = da.compile_model(found.scene, formulation=formulation)
    run = model.simulate(
        (0, found.duration), initial_values(found), {}, t_eval=times, rtol=rtol, atol=rtol / 100, method=method
    )
    if not run.success:
        return "ended", f"{name}: {run.status.name} at {run.t_end:.4g} of {found.duration:g}: {run.message}"
    expected = motion_by_hand(found, times)
    off = max(float(np.abs(run[x] - row).max()) for x, row in zip(found.by_hand, expected, strict=True))
    size = float(np.abs(expected).max())
    text = f"{name}: off by {off:.1e} at sizes of {size:.1e}, {run.stats.steps} steps"
    return ("agree" if off < 3e3 * rtol * max(1.0, size) else "WRONG"), text
