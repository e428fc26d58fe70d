"""The Chaplygin sleigh: turning past pi/2, against its stable direction, with b -> 0, from rest along the blade."""

from functools import cache

from sympy import cos, sin
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from hard_cases.case import HardCase, reference
from oracles.sleigh_exact import sleigh_state

CLOSED = "closed form (tanh, sech and quadrature of v exp(i theta)) in 40 digits; Chaplygin 1911"


def _observed():
    x, y, theta = dynamicsymbols("x y theta")
    return ["x", "y", "theta", x.diff() * cos(theta) + y.diff() * sin(theta), "theta_dot"]


_scene = cache(da.scenes.chaplygin_sleigh)


def _case(parameters, start, values, source, **options):
    x0, y0, theta0, v0, omega0 = start
    return HardCase(
        scene=_scene(),
        parameters=parameters,
        initial={"x": x0, "y": y0, "theta": theta0, "x_dot": v0 * float(cos(theta0)), "theta_dot": omega0},
        quantity="position and angle, v along the blade, omega",
        observed=_observed(),
        values=values,
        source=source,
        **options,
    )


def _exact(parameters, start, times):
    states = {
        t: sleigh_state(t, **parameters, **dict(zip(("x", "y", "theta", "v", "omega"), start, strict=True)))
        for t in times
    }
    return {t: (s.x, s.y, s.theta, s.v, s.omega) for t, s in states.items()}


def through_half_pi():
    """x_dot is no independent speed at pi/2."""
    p, start = {"m": 1.0, "b": 0.3, "I_C": 0.5}, (0.0, 0.0, 0.2, 1.0, 2.0)
    return _case(p, start, _exact(p, start, (1.0, 10.0)), CLOSED, bound=5e-15)


def against_stable_direction():
    """Turns around at t = 12.7; errors grow by some 4e3."""
    p, start = {"m": 1.0, "b": 0.3, "I_C": 0.5}, (0.0, 0.0, 0.5, -1.0, 1e-3)
    return _case(p, start, _exact(p, start, (10.0, 40.0)), CLOSED, bound=2e-14)


def _given(name):
    entry = reference("chaplygin_sleigh")["values"][name]
    numbers = {key: float(value) for key, value in entry["params"].items()}
    m, b = numbers["m"], numbers["b"]
    p = {"m": m, "b": b, "I_C": numbers["Icm"] + m * b**2}
    start = tuple(numbers[key] for key in ("x0", "y0", "th0", "v0", "w0"))
    values = {float(row["t"]): [row[key] for key in ("x", "y", "theta", "v", "omega")] for row in entry["values"]}
    return p, start, values, reference("chaplygin_sleigh")["source"]


def b_1e_8():
    """The closed form divides by b."""
    return _case(*_given("S3_b_1e-8_near_singular"), bound=3e-13)


def from_v_zero():
    """Starts with no velocity along the blade."""
    return _case(*_given("S4_start_exactly_at_v0_zero"), bound=5e-15)


def b_0():
    """The centre of mass moves on a circle."""
    p, start = {"m": 1.0, "b": 0.0, "I_C": 0.5}, (0.0, 0.0, 0.2, 1.0, 0.5)
    return _case(p, start, _exact(p, start, (10.0, 100.0)), "closed form: a circle of radius v/omega", bound=1e-13)


CASES = {
    "sleigh through theta = pi/2": through_half_pi,
    "sleigh against its stable direction": against_stable_direction,
    "sleigh, b = 1e-8": b_1e_8,
    "sleigh, b = 0": b_0,
    "sleigh from v = 0": from_v_zero,
}
