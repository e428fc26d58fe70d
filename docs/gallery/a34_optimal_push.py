"""
Which pushes bring a cart with a pole to rest a metre away?
===========================================================

A pole hangs from a cart. Sixty pushes of fixed length are to move the cart by
one metre and leave everything at rest. The motion is a loop of
``model.functions.step``, its gradient by all pushes comes from JAX, and Adam
of optax descends.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

x, theta, u = dynamicsymbols("x theta u")
M, m, l, g = symbols("M m l g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
A = N.orientnew("A", "Axis", (theta, N.z))
C = O.locatenew("C", x * N.x)
P = C.locatenew("P", -l * A.y)
scene = da.Scene("crane", frame=N, origin=O, coordinates=[x, theta])
scene.add_bodies(Particle("cart", C, M), Particle("bob", P, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_inputs(u)
scene.add_loads((C, u * N.x))
model = da.compile_model(scene, backend="jax")
parameters = {"M": 1.0, "m": 0.3, "l": 0.6, "g": 9.81}
dt, goal = 0.05, jnp.array([1.0, 0.0, 0.0, 0.0])

# %%
# The cost is the distance from rest at the goal, and a little of what the
# pushes cost.


def motion(pushes):
    """Return the states (60, 4) after each push."""

    def one(y, push):
        y = model.functions.step(y, {"u": push}, dt, parameters)
        return y, y

    return jax.lax.scan(one, jnp.zeros(4), pushes)[1]


def cost(pushes):
    """Return what is to be small."""
    return 100.0 * jnp.sum((motion(pushes)[-1] - goal) ** 2) + 0.01 * jnp.sum(
        pushes**2
    )


# %%
# The descent is one loop, compiled once.

adam = optax.adam(0.1)


@jax.jit
def descend(pushes):
    """Return better pushes, and the costs on the way."""

    def one(carry, _):
        pushes, memory = carry
        value, slope = jax.value_and_grad(cost)(pushes)
        change, memory = adam.update(slope, memory)
        return (optax.apply_updates(pushes, change), memory), value

    (pushes, _), costs = jax.lax.scan(
        one, (pushes, adam.init(pushes)), None, length=1500
    )
    return pushes, costs


pushes, costs = descend(jnp.zeros(60))
states = np.asarray(motion(pushes))
print(
    f"cost {float(costs[0]):.1f} to {float(costs[-1]):.4f}; last state"
    f" {np.round(states[-1], 3)}"
)
assert np.abs(states[-1] - goal).max() < 0.02

# %%
# The same pushes in a run with control of its error, as samples that are held.

times = dt * np.arange(61)
record = da.samples(times, np.append(pushes, 0.0), kind="hold")
start = {"x": 0, "theta": 0, "x_dot": 0, "theta_dot": 0}
run = model.simulate(
    (0, times[-1]), start, parameters, inputs={u: record}, t_eval=times
)
assert np.abs(run.y[-1] - goal).max() < 0.02

_, (above, below) = plt.subplots(2, 1, sharex=True)
above.plot(run.t, run["x"], label="cart [m]")
above.plot(run.t, run["theta"], label="pole [rad]")
above.legend()
below.step(times, np.append(pushes, pushes[-1]), where="post")
below.set(xlabel="time [s]", ylabel="push [N]")
