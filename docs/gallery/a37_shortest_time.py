"""
How soon can a crane bring its load to rest a metre away?
=========================================================

Multiple shooting with a free final time: the motion is cut into six pieces,
whose first states are unknown, and so are the force in each piece and the time
that all take together. SciPy's SLSQP joins the pieces; the Jacobians by
states, forces and final time come from JAX.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

jax.config.update("jax_enable_x64", True)

x, theta, u = dynamicsymbols("x theta u")
M, m, l, g = symbols("M m l g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
A = N.orientnew("A", "Axis", (theta, N.z))
C = O.locatenew("C", x * N.x)
P = C.locatenew("P", -l * A.y)
scene = da.Scene("crane", frame=N, origin=O, coordinates=[x, theta])
scene.add_bodies(Particle("trolley", C, M), Particle("load", P, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_inputs(u)
scene.add_loads((C, u * N.x))
model = da.compile_model(scene, backend="jax")
parameters = {"M": 1.0, "m": 0.5, "l": 0.4, "g": 9.81}
pieces, largest = 6, 4.0  # newtons
first, goal = jnp.zeros(4), jnp.array([1.0, 0.0, 0.0, 0.0])
names = ["x", "theta", "x_dot", "theta_dot"]
solve = model.solve_fn(
    names, method="tsit5", rtol=1e-8, atol=1e-10, max_steps=128
)

# %%
# All pieces run side by side, from 0 to a sixth of the final time. Where one
# ends the next must begin.


def parts(z):
    """Return the end [s], the forces (6,), and the states (7, 4)."""
    inner = z[1 + pieces :].reshape(pieces - 1, 4)
    return (
        z[0],
        z[1 : 1 + pieces],
        jnp.concatenate([first[None], inner, goal[None]]),
    )


def gaps(z):
    """Return how far ends of pieces (6, 4) miss the beginnings of the next."""
    duration, forces, states = parts(z)

    def end(y, force):
        return solve(
            jnp.array([0.0, duration / pieces]),
            y,
            parameters,
            inputs={u: force},
        ).y[-1]

    return (jax.vmap(end)(states[:-1], forces) - states[1:]).ravel()


joined, slopes = jax.jit(gaps), jax.jit(jax.jacfwd(gaps))
line = np.asarray(first + np.linspace(0, 1, pieces + 1)[1:-1, None] * goal)
guess = np.concatenate(
    [[2.0], np.repeat([1.0, -1.0], pieces // 2), line.ravel()]
)

# The derivative by the final time is the rate at the end, a sixth of it from
# each piece.
step = 1e-6 * np.eye(len(guess))[0]
difference = (joined(guess + step) - joined(guess - step)) / 2e-6
np.testing.assert_allclose(
    slopes(guess)[:, 0], difference, rtol=1e-6, atol=1e-7
)

# %%
# The shortest time under which the pieces join, with forces of at most four
# newtons.

found = minimize(
    lambda z: (z[0], np.eye(len(z))[0]),
    guess,
    jac=True,
    method="SLSQP",
    bounds=[(0.5, 5.0)]
    + pieces * [(-largest, largest)]
    + 4 * (pieces - 1) * [(None, None)],
    constraints={
        "type": "eq",
        "fun": lambda z: np.asarray(joined(z)),
        "jac": lambda z: np.asarray(slopes(z)),
    },
    options={"maxiter": 200, "ftol": 1e-10},
)
duration, forces, _ = (np.asarray(part) for part in parts(found.x))
print(f"{found.message}: {duration:.4f} s, forces {np.round(forces, 3)} N")
assert found.success and np.abs(joined(found.x)).max() < 1e-7

# %%
# One run with these forces as samples that are held comes to rest at the goal.
# A rigid load, which could not swing, would take at least 2 sqrt(distance mass
# / force).

times = np.linspace(0, duration, pieces + 1)
record = da.samples(times, np.append(forces, 0.0), kind="hold")
fine = np.linspace(0, duration, 200)
run = model.simulate(
    (0, duration),
    dict.fromkeys(names, 0.0),
    parameters,
    inputs={u: record},
    t_eval=fine,
)
assert np.abs(run.y[-1] - goal).max() < 1e-5
assert duration > 2 * np.sqrt(1.0 * 1.5 / largest)

_, (above, below) = plt.subplots(2, 1, sharex=True)
above.plot(run.t, run["x"], label="trolley [m]")
above.plot(run.t, run["theta"], label="load [rad]")
above.legend()
below.step(times, np.append(forces, forces[-1]), where="post")
below.set(xlabel="time [s]", ylabel="force [N]")
