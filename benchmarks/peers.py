"""Other solvers, on equations that a person reduced by hand: SciPy, and where installed heyoka, diffrax and CasADi."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from cases import END, Problem
from contenders import Contender, Prepared, absolute
from numpy.typing import NDArray

__all__ = ["heyoka_system", "installed", "peers"]

FloatArray = NDArray[np.float64]


def installed(name: str) -> Any:
    """Return a module, or None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def peers(problem: Problem) -> Iterator[Contender]:
    """Yield the peers that can solve a problem here."""
    yield Contender("SciPy", "by hand", "DOP853", lambda rtol: _scipy(problem, rtol))
    if (heyoka := installed("heyoka")) is not None:
        yield Contender("heyoka", "by hand", "taylor", lambda rtol: _heyoka(heyoka, problem, rtol))
    if (diffrax := installed("diffrax")) is not None:
        for name in ("Tsit5", "Dopri8"):
            yield Contender("diffrax", "by hand", name, lambda rtol, name=name: _diffrax(diffrax, problem, name, rtol))
    if (casadi := installed("casadi")) is not None:
        yield Contender("CasADi", "by hand", "cvodes", lambda rtol: _casadi(casadi, problem, rtol))


def _scipy(problem: Problem, rtol: float) -> Prepared:
    from scipy.integrate import solve_ivp

    reduced, functions = problem.reduced, (math.sin, math.cos)
    p = reduced.parameters

    def rhs(_: float, y: FloatArray) -> Sequence[float]:
        return reduced.rhs(y.tolist(), p, functions)

    def run() -> Any:
        return solve_ivp(rhs, (0.0, END), reduced.start, method="DOP853", rtol=rtol, atol=absolute(rtol))

    solution = run()
    error = problem.error(*reduced.to_scene(solution.y[:, -1]))
    return Prepared(run, None, error, len(solution.t) - 1, solution.nfev)


def heyoka_system(heyoka: Any, problem: Problem) -> list[tuple[Any, Any]]:
    """Return the equations as heyoka takes them."""
    reduced = problem.reduced
    variables = [heyoka.expression(f"y{i}") for i in range(len(reduced.start))]
    p = [heyoka.par[i] for i in range(len(reduced.parameters))]
    return list(zip(variables, reduced.rhs(variables, p, (heyoka.sin, heyoka.cos)), strict=True))


def _heyoka(heyoka: Any, problem: Problem, rtol: float) -> Prepared:
    reduced = problem.reduced
    integrator = heyoka.taylor_adaptive(
        heyoka_system(heyoka, problem), reduced.start.tolist(), tol=rtol, pars=list(reduced.parameters)
    )

    def run() -> Any:
        integrator.time = 0.0
        integrator.state[:] = reduced.start
        return integrator.propagate_until(END)

    steps = run()[3]
    return Prepared(run, None, problem.error(*reduced.to_scene(integrator.state.copy())), steps)


def _diffrax(diffrax: Any, problem: Problem, method: str, rtol: float) -> Prepared:
    import jax
    import jax.numpy as jnp

    reduced = problem.reduced

    def rhs(_: Any, y: Any, p: Any) -> Any:
        return jnp.stack(reduced.rhs(y, p, (jnp.sin, jnp.cos)))

    def solve(y: Any, p: Any) -> Any:
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rhs),
            getattr(diffrax, method)(),
            t0=0.0,
            t1=END,
            dt0=None,
            y0=y,
            args=p,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=absolute(rtol)),
            saveat=diffrax.SaveAt(t1=True),
            max_steps=1_000_000,
        )
        return solution.ys[0], solution.stats["num_steps"]

    with jax.enable_x64(True):
        compiled = jax.jit(solve)
        y, p = jnp.asarray(reduced.start), jnp.asarray(reduced.parameters)

        def run() -> Any:
            with jax.enable_x64(True):
                return compiled(y, p)[0].block_until_ready()

        end, steps = compiled(y, p)
        return Prepared(run, None, problem.error(*reduced.to_scene(np.asarray(end))), int(steps))


def _casadi(casadi: Any, problem: Problem, rtol: float) -> Prepared:
    reduced = problem.reduced
    y, p = casadi.SX.sym("y", len(reduced.start)), casadi.SX.sym("p", len(reduced.parameters))
    parts = [[v[i] for i in range(v.numel())] for v in (y, p)]
    rates = casadi.vertcat(*reduced.rhs(*parts, (casadi.sin, casadi.cos)))
    options = {"reltol": rtol, "abstol": absolute(rtol), "max_num_steps": 1_000_000}
    integrator = casadi.integrator("run", "cvodes", {"x": y, "p": p, "ode": rates}, 0.0, END, options)

    def run() -> Any:
        return integrator(x0=reduced.start, p=reduced.parameters)["xf"]

    end = np.asarray(run()).ravel()
    return Prepared(run, None, problem.error(*reduced.to_scene(end)))
