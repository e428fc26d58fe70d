"""
Which friction law does a slider's record show?
===============================================

A block on a spring slides on a guide that brakes it by a law that nobody
knows. From a record of its position, a small network inside of the simulator
learns the force as a function of the velocity. It is an input of the scene,
and JAX differentiates the motion by its weights.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

jax.config.update("jax_enable_x64", True)

x, friction = dynamicsymbols("x friction")
m, k = symbols("m k", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P = O.locatenew("P", x * N.x)
scene = da.Scene("slider", frame=N, origin=O, coordinates=[x])
scene.add_bodies(Particle("block", P, m))
scene.add_loads((P, (friction - k * x) * N.x))
scene.add_inputs(friction)
model = da.compile_model(scene, backend="jax")
solve = model.solve_fn(
    [x, x.diff()], method="tsit5", rtol=1e-6, atol=1e-8, max_steps=512
)
parameters = {"m": 1.0, "k": 4.0}

# %%
# The record: two runs of six seconds, by hand-written equations, with an error
# of a millimetre. The true law falls from its peak at low velocities and rises
# again with them (Stribeck).


def true_law(v):
    return (
        -(0.35 + 0.45 * np.exp(-((v / 0.35) ** 2))) * np.tanh(v / 0.08)
        - 0.15 * v
    )


times, starts = np.linspace(0, 6, 121), np.array([[1.0, 0.0], [-0.2, 2.2]])
rng = np.random.default_rng(5)
exact = [
    solve_ivp(
        lambda t, y: [y[1], true_law(y[1]) - 4 * y[0]],
        (0, 6),
        start,
        t_eval=times,
        rtol=1e-9,
        atol=1e-10,
    ).y[0]
    for start in starts
]
record = np.array(exact) + 1e-3 * rng.standard_normal((2, len(times)))

# %%
# The network is odd in the velocity, and a function of it alone. Its weights
# are any pytree; here they are few enough that least squares (Levenberg and
# Marquardt) can have the derivatives of the whole record by all of them, in
# forward mode.


def law(t, q, qdot, theta):
    return -jnp.sum(
        theta["size"] * jnp.tanh(jnp.exp(theta["steepness"]) * qdot[0])
    )


theta = {"size": jnp.full(6, 0.1), "steepness": jnp.linspace(-1.5, 2.5, 6)}
flat, whole = jax.flatten_util.ravel_pytree(theta)


@jax.jit
def positions(weights):
    given = {friction: da.feedback(law, whole(weights))}
    return jax.vmap(
        lambda start: solve(times, start, parameters, inputs=given).q[:, 0]
    )(starts)


def residual(weights):
    return np.asarray((positions(weights) - record) / 1e-3).ravel()


derivatives = jax.jit(jax.jacfwd(positions))
fit = least_squares(
    residual,
    flat,
    jac=lambda w: np.asarray(derivatives(w) / 1e-3).reshape(-1, len(flat)),
    method="lm",
    max_nfev=200,
)
print(
    "mean square of the residuals, in units of the error:"
    f" {2 * fit.cost / record.size:.2f}"
)

# %%
# The law that was learned is the true one, at the velocities that the record
# has.

v = np.linspace(-2.0, 2.0, 401)
learned = jax.vmap(
    lambda v: law(0.0, None, jnp.array([v]), whole(jnp.asarray(fit.x)))
)(v)
error = np.sqrt(np.mean((learned - true_law(v)) ** 2))
print(
    f"root mean square error of the law: {error:.3f} N, of forces up to"
    f" {abs(true_law(v)).max():.2f} N"
)
assert error < 0.05

# %%
# sphinx_gallery_thumbnail_number = 2
_, left = plt.subplots()
for measured, found in zip(record, positions(fit.x), strict=True):
    left.plot(times, measured, ".", color="0.6", ms=3)
    left.plot(times, found, lw=1)
left.set(xlabel="t [s]", ylabel="x [m]", title="record and fit")
_, right = plt.subplots()
right.plot(v, true_law(v), "k--", lw=1, label="true")
right.plot(v, learned, label="learned")
right.set(xlabel="velocity [m/s]", ylabel="friction [N]")
right.legend()
