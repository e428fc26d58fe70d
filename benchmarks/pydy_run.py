"""PyDy's run of the sleigh: SymPy's KanesMethod, PyDy's generated functions, SciPy's odeint."""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import END, Problem
from contenders import Prepared, absolute
from sympy import cos, sin, symbols
from sympy.physics.mechanics import KanesMethod, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

__all__ = ["pydy_run"]


def _kane() -> Any:
    """Return KanesMethod of the sleigh in the speeds along its blade and across it (zero), and the angular velocity."""
    q, u = dynamicsymbols("x y theta"), dynamicsymbols("v w omega")
    (x, y, theta), (v, w, omega) = q, u
    m, b, I_C = symbols("m b I_C")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    S.set_ang_vel(N, omega * N.z)
    O.set_vel(N, 0)
    C = O.locatenew("C", x * N.x + y * N.y)
    C.set_vel(N, v * S.x + w * S.y)
    G = C.locatenew("G", b * S.x)
    G.v2pt_theory(C, N, S)
    body = RigidBody("sleigh", G, S, m, (inertia(S, 0, 0, I_C - m * b**2), G))
    kinematics = [
        x.diff() - v * cos(theta) + w * sin(theta),
        y.diff() - v * sin(theta) - w * cos(theta),
        theta.diff() - omega,
    ]
    kane = KanesMethod(N, q, [v, omega], kd_eqs=kinematics, u_dependent=[w], velocity_constraints=[w])
    kane.kanes_equations([body], [])
    return kane


def pydy_run(generator: str, problem: Problem, rtol: float) -> Prepared:
    """Return a run of the sleigh by PyDy's `System`, from the rate equations that KanesMethod derives."""
    from pydy.system import System

    system = System(_kane(), times=np.array([0.0, END]))
    system.generate_ode_function(generator=generator, constants_arg_type="array")
    values = {str(symbol): symbol for symbol in system.constants_symbols}
    system.constants = {values[name]: value for name, value in problem.parameters.items()}
    x, y, theta, v, omega = problem.reduced.start.tolist()
    start = {"x": x, "y": y, "theta": theta, "v": v, "w": 0.0, "omega": omega}
    system.initial_conditions = {symbol: start[symbol.func.__name__] for symbol in system.states}
    order = [[symbol.func.__name__ for symbol in system.states].index(n) for n in ("x", "y", "theta", "v", "omega")]

    def run() -> Any:
        return system.integrate(rtol=rtol, atol=absolute(rtol), mxstep=1_000_000)

    return Prepared(run, None, problem.error(*problem.reduced.to_scene(run()[-1][order])))
