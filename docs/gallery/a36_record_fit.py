"""
Which length and friction has a pendulum whose swing was recorded?
==================================================================

Least squares with optimistix: the residuals are a function that JAX
differentiates (`solve_fn`), so that the method of Levenberg and Marquardt has
exact Jacobians, and the errors of the parameters follow from the last one.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optimistix as optx
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

jax.config.update("jax_enable_x64", True)

theta = dynamicsymbols("theta")
m, l, g, d = symbols("m l g d", positive=True)
N, O = ReferenceFrame("N"), Point("O")
B = N.orientnew("B", "Axis", (theta, N.z))
P = O.locatenew("P", -l * B.y)
scene = da.Scene("recorded", frame=N, origin=O, coordinates=[theta])
scene.add_bodies(Particle("bob", P, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_loads((B, -d * theta.diff() * N.z))
model = da.compile_model(scene, backend="jax")

# %%
# The record: eighty angles in eight seconds, with an error of 0.02 rad. The
# angle of release is not known either.

times, noise = np.linspace(0, 8, 81), 0.02
true = np.array(
    [0.9, 0.12, 1.1]
)  # length [m], friction [N m s], first angle [rad]
given = {"theta": true[2], "theta_dot": 0.0}
run = model.simulate(
    (0, 8),
    given,
    {"m": 1.0, "g": 9.81, "l": true[0], "d": true[1]},
    t_eval=times,
)
record = run["theta"] + noise * np.random.default_rng(5).standard_normal(81)

# %%
# The fit begins a fifth away. A fit that begins with a length that is too
# wrong would find another number of swings.

solve = model.solve_fn(
    ["theta", "theta_dot"],
    method="tsit5",
    rtol=1e-8,
    atol=1e-10,
    max_steps=1024,
)


def residuals(x, record):
    """Return the differences of motion and record, in units of the error."""
    solved = solve(
        times,
        {"theta": x[2], "theta_dot": 0.0},
        {"m": 1.0, "g": 9.81, "l": x[0], "d": x[1]},
    )
    return (solved.q[:, 0] - record) / noise


method = optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
guess = jnp.array([1.0, 0.3, 0.9])


@jax.jit
def fitted(record):
    """Return the parameters, their Jacobian, and the success of the fit."""
    fit = optx.least_squares(
        residuals, method, guess, args=record, max_steps=64, throw=False
    )
    return (
        fit.value,
        jax.jacfwd(residuals)(fit.value, record),
        fit.result == optx.RESULTS.successful,
    )


values, slopes, ended = fitted(record)
errors = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
for name, value, error, right in zip(
    ("length", "friction", "first angle"), values, errors, true, strict=True
):
    print(f"{name:12s} {value:.4f} +- {error:.4f}, true {right}")
assert ended
assert np.all(np.abs(values - true) < 4 * errors) and errors.max() < 0.02

# %%
# The residuals are noise, with no trace of a swing in it.

left = np.asarray(residuals(values, record))
assert 0.7 < np.std(left) < 1.3
_, (above, below) = plt.subplots(2, 1, sharex=True)
above.plot(times, record, "k.", label="record")
above.plot(times, record + noise * left, label="fit")
above.set_ylabel("angle [rad]")
above.legend()
below.plot(times, left, ".")
below.set(xlabel="time [s]", ylabel="residual / error")
