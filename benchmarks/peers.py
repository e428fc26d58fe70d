"""Other solvers, on equations that a person has reduced by hand: SciPy's DOP853, and heyoka where it is installed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from contenders import Contender, Prepared, absolute
from exact import END, SLEIGH, SPHERE, Case, final_error, spatial_angular_velocity
from numpy.typing import NDArray

__all__ = ["peers"]

FloatArray = NDArray[np.float64]
Functions = tuple[Callable[[Any], Any], Callable[[Any], Any]]


@dataclass(frozen=True)
class Reduced:
    """A case in independent speeds.

    Attributes
    ----------
    rhs : callable
        (y, p, (sin, cos)) -> rates of the state, for numbers and for heyoka's expressions.
    parameters : tuple of float
        What it takes for p.
    start : ndarray (n_y,)
    to_scene : callable
        State -> (q, q_dot).
    """

    rhs: Callable[[Any, Any, Functions], Sequence[Any]]
    parameters: tuple[float, ...]
    start: FloatArray
    to_scene: Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def _sleigh_rhs(state: Any, p: Any, functions: Functions) -> Sequence[Any]:
    _, _, theta, v, omega = state
    sin, cos = functions
    return v * cos(theta), v * sin(theta), omega, p[0] * (omega * omega), -p[1] * (v * omega)


def _sphere_rhs(state: Any, p: Any, functions: Functions) -> Sequence[Any]:
    _, _, psi, theta, _, ox, oy, oz = state
    sin, cos = functions
    sine, cosine = sin(psi), cos(psi)
    phi_dot = (ox * sine - oy * cosine) / sin(theta)
    still = 0.0 * ox
    return (
        *(p[0] * oy, -p[0] * ox),
        *(oz - phi_dot * cos(theta), ox * cosine + oy * sine, phi_dot),
        *(still, still, still),
    )


def _sleigh(case: Case) -> Reduced:
    p, start = case.parameters, case.exact(0)

    def to_scene(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        return y[:3], np.array([y[3] * math.cos(y[2]), y[3] * math.sin(y[2]), y[4]])

    speeds = [start.qdot[0] * math.cos(start.q[2]) + start.qdot[1] * math.sin(start.q[2]), start.qdot[2]]
    parameters = (p["b"], p["m"] * p["b"] / p["I_C"])
    return Reduced(_sleigh_rhs, parameters, np.array([*start.q, *speeds]), to_scene)


def _sphere(case: Case) -> Reduced:
    start, parameters = case.exact(0), (case.parameters["r"],)

    def to_scene(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        return y[:5], np.array(_sphere_rhs(y, parameters, (math.sin, math.cos))[:5])

    omega = spatial_angular_velocity(start.q, start.qdot)
    return Reduced(_sphere_rhs, parameters, np.array([*start.q, *omega]), to_scene)


_REDUCED = {SLEIGH: _sleigh, SPHERE: _sphere}


def peers(case: Case) -> Iterator[Contender]:
    """Yield the peers that can solve a case here."""
    reduced = _REDUCED[case](case)
    yield Contender("SciPy", "by hand", "DOP853", lambda rtol: _scipy(case, reduced, rtol))
    try:
        import heyoka
    except ImportError:
        return
    yield Contender("heyoka", "by hand", "taylor", lambda rtol: _heyoka(heyoka, case, reduced, rtol))


def _scipy(case: Case, reduced: Reduced, rtol: float) -> Prepared:
    from scipy.integrate import solve_ivp

    p, functions = reduced.parameters, (math.sin, math.cos)

    def rhs(_: float, y: FloatArray) -> Sequence[float]:
        return reduced.rhs(y.tolist(), p, functions)

    def run() -> Any:
        return solve_ivp(rhs, (0.0, END), reduced.start, method="DOP853", rtol=rtol, atol=absolute(rtol))

    solution = run()
    error = final_error(case, *reduced.to_scene(solution.y[:, -1]))
    return Prepared(run, None, error, len(solution.t) - 1, solution.nfev)


def _heyoka(heyoka: Any, case: Case, reduced: Reduced, rtol: float) -> Prepared:
    variables = [heyoka.expression(f"y{i}") for i in range(len(reduced.start))]
    p = [heyoka.par[i] for i in range(len(reduced.parameters))]
    rates = reduced.rhs(variables, p, (heyoka.sin, heyoka.cos))
    integrator = heyoka.taylor_adaptive(
        list(zip(variables, rates, strict=True)), reduced.start.tolist(), tol=rtol, pars=list(reduced.parameters)
    )

    def run() -> Any:
        integrator.time = 0.0
        integrator.state[:] = reduced.start
        return integrator.propagate_until(END)

    steps = run()[3]
    return Prepared(run, None, final_error(case, *reduced.to_scene(integrator.state.copy())), steps)
