"""
What damps a pendulum that a recorded torque drives?
====================================================

The torque of a motor was recorded at 50 Hz and drives a rod in its bearing.
From a noisy record of its angle, the moment of inertia and the coefficients of
linear and quadratic drag are to be found. `model.sensitivity` gives the exact
derivatives of the motion under the recorded torque, and least squares the
parameters with their uncertainty.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares
from sympy import Abs, sin, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

a, torque = dynamicsymbols("a torque")
I, d, q, k = symbols(
    "I d q k", positive=True
)  # k, weight times length, is known
N, O = ReferenceFrame("N"), Point("O")
R = N.orientnew("R", "Axis", (a, N.z))
scene = da.Scene("driven_pendulum", frame=N, origin=O, coordinates=[a])
scene.add_bodies(RigidBody("rod", O, R, 1, (inertia(R, 0, 0, I), O)))
scene.add_inputs(torque)
rate = a.diff()
scene.add_loads(
    (R, (torque - k * sin(a) - d * rate - q * rate * Abs(rate)) * N.z)
)
model = da.compile_model(scene)

# %%
# Records of ten seconds. Those of the angle come from hand-written equations
# by SciPy, with an error of one degree.

times = np.linspace(0, 10, 501)
rng = np.random.default_rng(3)
pushes = 2.0 * gaussian_filter1d(rng.standard_normal(len(times)), 8)
true, sigma = {"I": 0.02, "d": 0.03, "q": 0.004}, np.radians(1.0)


def by_hand(t, y):
    drag = 0.03 * y[1] + 0.004 * y[1] * abs(y[1])
    return [
        y[1],
        (np.interp(t, times, pushes) - 0.5 * np.sin(y[0]) - drag) / 0.02,
    ]


exact = solve_ivp(
    by_hand,
    (0, 10),
    [0.3, 0],
    t_eval=times,
    max_step=0.02,
    rtol=1e-11,
    atol=1e-12,
).y[0]
measured = exact + sigma * rng.standard_normal(len(times))

# %%
# The torque is an input; between its samples it is linear, as the controller
# of the motor makes it.

given = {torque: da.samples(times, pushes, kind="linear")}


def run(theta):
    """Return the motion and its derivatives by the three parameters."""
    p = {"I": theta[0], "d": theta[1], "q": theta[2], "k": 0.5}
    start = {"a": 0.3, "a_dot": 0.0}
    return model.sensitivity(
        (0, 10),
        start,
        p,
        wrt=[*true],
        of=["a"],
        inputs=given,
        t_eval=times,
        rtol=1e-10,
    )


fit = least_squares(
    lambda theta: (run(theta)["a"] - measured) / sigma,
    [0.03, 0.05, 0.001],
    jac=lambda theta: (
        np.stack([run(theta).jacobian("a", name) for name in true], axis=1)
        / sigma
    ),
    x_scale="jac",
)
deviations = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
for name, value, deviation in zip(true, fit.x, deviations, strict=True):
    print(f"{name} = {value:.5f} +- {deviation:.5f}, true {true[name]}")
    assert abs(value - true[name]) < 4 * deviation
print(
    "mean square of the residuals, in units of the error:"
    f" {2 * fit.cost / len(times):.2f}"
)

# %%
# At the true parameters the motion is that of the hand-written equations.

error = abs(run(list(true.values()))["a"] - exact).max()
print(f"largest difference from SciPy: {error:.1e} rad")
assert error < 1e-6

# %%
_, (top, bottom) = plt.subplots(2, 1, sharex=True)
top.plot(times, pushes)
top.set(ylabel="torque [N m]")
bottom.plot(times, np.degrees(measured), "k.", ms=2, label="record")
bottom.plot(times, np.degrees(run(fit.x)["a"]), label="fit")
bottom.set(xlabel="t [s]", ylabel="angle [degrees]")
bottom.legend()
