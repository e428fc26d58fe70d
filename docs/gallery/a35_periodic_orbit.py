"""
How does the swing of a driven pendulum depend on its damping?
==============================================================

A damped pendulum driven by a torque that repeats settles into a motion that
repeats, too. Its start is the root of "state after one period minus state",
which optimistix finds by Newton's method. The root is differentiated by the
implicit function theorem: nothing goes through the iterations.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optimistix as optx
from sympy import cos, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

jax.config.update("jax_enable_x64", True)

theta, t = dynamicsymbols("theta"), dynamicsymbols._t
m, l, g, d, A, w = symbols("m l g d A w", positive=True)
N, O = ReferenceFrame("N"), Point("O")
B = N.orientnew("B", "Axis", (theta, N.z))
P = O.locatenew("P", -l * B.y)
scene = da.Scene("driven", frame=N, origin=O, coordinates=[theta])
scene.add_bodies(Particle("bob", P, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_loads((B, (A * cos(w * t) - d * theta.diff()) * N.z))
model = da.compile_model(scene, backend="jax")
solve = model.solve_fn(method="tsit5", rtol=1e-9, atol=1e-11)
p = {"m": 1.0, "l": 1.0, "g": 9.81, "A": 1.5, "w": 2.0}
period = jnp.array([0.0, np.pi])

# %%
# The start of the motion that repeats, as a function of the damping.


@jax.jit
def start(damping):
    """Return angle and rate at time 0 of the motion that repeats."""

    def gap(y, damping):
        return solve(period, y, {**p, "d": damping}).y[-1] - y

    newton = optx.Newton(rtol=1e-10, atol=1e-10)
    return optx.root_find(gap, newton, jnp.zeros(2), args=damping).value


slope = jax.jit(jax.jacfwd(start))(0.8)
difference = (start(0.8 + 1e-4) - start(0.8 - 1e-4)) / 2e-4
print(
    f"derivative by the damping {np.round(slope, 6)}, by differences"
    f" {np.round(difference, 6)}"
)
np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-7)

# %%
# What it looks like, from a run of many periods that begins there.

for damping in (0.5, 0.8, 1.6):
    y = np.asarray(start(damping))
    run = model.simulate(
        (0, 10 * np.pi),
        {"theta": y[0], "theta_dot": y[1]},
        {**p, "d": damping},
        rtol=1e-9,
    )
    assert abs(run["theta"][-1] - y[0]) < 1e-6
    plt.plot(run["theta"], run["theta_dot"], label=f"d = {damping}")
plt.xlabel("angle [rad]")
plt.ylabel("rate [rad/s]")
plt.legend()
