"""Other solvers of one case, on equations that a person reduced by hand: SciPy, heyoka, diffrax and CasADi.

Each at the setting that `peer_settings.py` found fastest at equal error; the options are arguments, so that this script
can try others.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from cases import END, Problem, Reduced
from contenders import Contender, Prepared, absolute
from numpy.typing import NDArray

__all__ = ["CVODES", "DIFFRAX", "HEYOKA", "SETTINGS", "DiffraxSetting", "casadi_integrator", "casadi_run"]
__all__ += ["compiled_rhs", "diffrax_run", "diffrax_solve", "heyoka_run", "heyoka_system", "installed", "peers"]
__all__ += ["scipy_ode", "scipy_solve_ivp"]

FloatArray = NDArray[np.float64]
Options = Mapping[str, Any]
_MAX_STEPS = 1_000_000

HEYOKA: Options = MappingProxyType({"fast_math": True})
CVODES: Options = MappingProxyType({"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"})


@dataclass(frozen=True)
class DiffraxSetting:
    """How diffrax is called.

    Attributes
    ----------
    scalars : bool
        Whether the state is a tuple of scalars; otherwise one array.
    adjoint : str
        Name of the class of `diffrax` for derivatives, which are not asked for here.
    throw : bool
        Whether failures raise.
    """

    scalars: bool = False
    adjoint: str = "ForwardMode"
    throw: bool = False


DIFFRAX = DiffraxSetting()
SETTINGS = {
    "SciPy": "`scipy.integrate.ode`, whose steps are compiled code, on a right-hand side compiled by numba",
    "heyoka": "`fast_math=True`",
    "diffrax": "state in one array, `ForwardMode()`, `throw=False`",
    "CasADi": "Adams' formulas with functional iteration; `SX` expressions",
}
"""The setting of each peer for one trajectory, in words."""


def installed(name: str) -> Any:
    """Return a module, or None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def peers(problem: Problem) -> Iterator[Contender]:
    """Yield the peers that can solve a problem here."""
    yield Contender("SciPy", "by hand", "dop853", partial(scipy_ode, problem), "numba rhs")
    if (heyoka := installed("heyoka")) is not None:
        yield Contender("heyoka", "by hand", "taylor", partial(heyoka_run, heyoka, problem), "fast_math")
    if installed("diffrax") is not None:
        for name in ("Tsit5", "Dopri8"):
            yield Contender("diffrax", "by hand", name, partial(diffrax_run, problem, name), "ForwardMode")
    if (casadi := installed("casadi")) is not None:
        yield Contender("CasADi", "by hand", "cvodes", partial(casadi_run, casadi, problem), "Adams")


# -- SciPy --------------------------------------------------------------------------------------


def interpreted_rhs(reduced: Reduced) -> Callable[[float, FloatArray], Sequence[float]]:
    """Return the right-hand side in Python, with functions of `math`."""
    functions, p = (math.sin, math.cos), reduced.parameters
    return lambda _, y: reduced.rhs(y.tolist(), p, functions)


def compiled_rhs(reduced: Reduced) -> Callable[..., FloatArray]:
    """Return the right-hand side (t, y, p) compiled by numba, p a tuple."""
    from numba import njit
    from numba.np.unsafe.ndarray import to_fixed_tuple

    by_hand, size = njit(reduced.rhs), len(reduced.start)

    @njit
    def rhs(_: float, y: FloatArray, p: tuple[float, ...]) -> FloatArray:
        rates = by_hand(to_fixed_tuple(y, size), p, (math.sin, math.cos))
        out = np.empty(size)
        for i in range(size):
            out[i] = rates[i]
        return out

    return rhs


def scipy_ode(problem: Problem, rtol: float, method: str = "dop853", *, compiled: bool = True) -> Prepared:
    """Return a run by `scipy.integrate.ode`."""
    from scipy.integrate import ode

    reduced = problem.reduced
    if compiled:
        solver = ode(compiled_rhs(reduced)).set_f_params(reduced.parameters)
    else:
        solver = ode(interpreted_rhs(reduced))
    solver.set_integrator(method, rtol=rtol, atol=absolute(rtol), nsteps=_MAX_STEPS)

    def run() -> Any:
        solver.set_initial_value(reduced.start, 0.0)
        return solver.integrate(END)

    end = run()
    if not solver.successful():
        raise RuntimeError(f"{problem.name}, SciPy's {method} at rtol {rtol:g} failed")
    return Prepared(run, None, problem.error(*reduced.to_scene(end)))


def scipy_solve_ivp(problem: Problem, rtol: float, method: str = "DOP853", *, compiled: bool = False) -> Prepared:
    """Return a run by `scipy.integrate.solve_ivp`."""
    from scipy.integrate import solve_ivp

    reduced = problem.reduced
    rhs, args = (compiled_rhs(reduced), (reduced.parameters,)) if compiled else (interpreted_rhs(reduced), None)

    def run() -> Any:
        return solve_ivp(rhs, (0.0, END), reduced.start, method=method, rtol=rtol, atol=absolute(rtol), args=args)

    solution = run()
    error = problem.error(*reduced.to_scene(solution.y[:, -1]))
    return Prepared(run, None, error, len(solution.t) - 1, solution.nfev)


# -- heyoka -------------------------------------------------------------------------------------


def heyoka_system(heyoka: Any, problem: Problem) -> list[tuple[Any, Any]]:
    """Return the equations as heyoka takes them."""
    reduced = problem.reduced
    variables = [heyoka.expression(f"y{i}") for i in range(len(reduced.start))]
    p = [heyoka.par[i] for i in range(len(reduced.parameters))]
    return list(zip(variables, reduced.rhs(variables, p, (heyoka.sin, heyoka.cos)), strict=True))


def heyoka_run(heyoka: Any, problem: Problem, rtol: float, options: Options = HEYOKA) -> Prepared:
    """Return a run by heyoka's `taylor_adaptive`."""
    start, pars = problem.reduced.start, list(problem.reduced.parameters)
    integrator = heyoka.taylor_adaptive(heyoka_system(heyoka, problem), start.tolist(), tol=rtol, pars=pars, **options)
    state, propagate = integrator.state, integrator.propagate_until  # a view: looked up once

    def run() -> Any:
        integrator.time = 0.0
        state[:] = start
        return propagate(END)

    steps = run()[3]
    return Prepared(run, None, problem.error(*problem.reduced.to_scene(state.copy())), steps)


# -- diffrax ------------------------------------------------------------------------------------


def diffrax_solve(problem: Problem, method: str, rtol: float, setting: DiffraxSetting) -> Callable[[Any, Any], Any]:
    """Return a function (y, p) -> (state at the end, steps) for `jax.jit`; y and p are tuples with `scalars`."""
    import diffrax
    import jax
    import jax.numpy as jnp

    by_hand, functions = problem.reduced.rhs, (jnp.sin, jnp.cos)

    def rhs(_: Any, y: Any, p: Any) -> Any:
        rates = by_hand(y, p, functions)
        return tuple(map(jnp.asarray, rates)) if setting.scalars else jnp.stack(rates)

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
            max_steps=_MAX_STEPS,
            adjoint=getattr(diffrax, setting.adjoint)(),
            throw=setting.throw,
        )
        return jax.tree.map(lambda values: values[0], solution.ys), solution.stats["num_steps"]

    return solve


def diffrax_run(problem: Problem, method: str, rtol: float, setting: DiffraxSetting = DIFFRAX) -> Prepared:
    """Return a run by diffrax, jitted."""
    import jax
    import jax.numpy as jnp

    reduced = problem.reduced
    with jax.enable_x64(True):
        compiled = jax.jit(diffrax_solve(problem, method, rtol, setting))
        y, p = jnp.asarray(reduced.start), jnp.asarray(reduced.parameters)
        if setting.scalars:
            y, p = tuple(y), tuple(p)

        def run() -> Any:
            with jax.enable_x64(True):
                return jax.block_until_ready(compiled(y, p)[0])

        end, steps = compiled(y, p)
        return Prepared(run, None, problem.error(*reduced.to_scene(np.array(end))), int(steps))


# -- CasADi -------------------------------------------------------------------------------------


def casadi_integrator(casadi: Any, problem: Problem, rtol: float, options: Options, plugin: str = "cvodes") -> Any:
    """Return CasADi's integrator of the equations, a function of x0 and p."""
    reduced = problem.reduced
    y, p = casadi.SX.sym("y", len(reduced.start)), casadi.SX.sym("p", len(reduced.parameters))
    parts = [[v[i] for i in range(v.numel())] for v in (y, p)]
    rates = casadi.vertcat(*reduced.rhs(*parts, (casadi.sin, casadi.cos)))
    own = {"reltol": rtol, "abstol": absolute(rtol), "max_num_steps": _MAX_STEPS, **options}
    return casadi.integrator("run", plugin, {"x": y, "p": p, "ode": rates}, 0.0, END, own)


def casadi_run(
    casadi: Any, problem: Problem, rtol: float, options: Options = CVODES, plugin: str = "cvodes"
) -> Prepared:
    """Return a run by CasADi's interface to SUNDIALS."""
    reduced = problem.reduced
    integrator = casadi_integrator(casadi, problem, rtol, options, plugin)
    start, p = casadi.DM(reduced.start), casadi.DM(list(reduced.parameters))

    def run() -> Any:
        return integrator(x0=start, p=p)["xf"]

    return Prepared(run, None, problem.error(*reduced.to_scene(np.asarray(run()).ravel())))
