"""
Which force swings a pendulum on a cart up?
===========================================

Direct collocation: states and forces at 41 knots are the unknowns of one
nonlinear program. Between knots the motion is a cubic polynomial that fulfils
the equations of motion at its ends and in its middle. Those equations are
`model.vector_field` of the JAX backend, so that the derivatives of the program
are exact. SciPy's SLSQP solves it, and an independent integration of the
hand-written equations checks the result.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from sympy import cos, sin, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

jax.config.update("jax_enable_x64", True)
x, a = dynamicsymbols("x a")
F, M, m, l, g = symbols("F M m l g")
N, O = ReferenceFrame("N"), Point("O")
cart = O.locatenew("cart", x * N.x)
bob = cart.locatenew("bob", l * sin(a) * N.x - l * cos(a) * N.y)
scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, a])
scene.add_bodies(Particle("cart", cart, M), Particle("bob", bob, m))
scene.add_loads((cart, F * N.x))
scene.apply_uniform_gravity(-g * N.y)
model = da.compile_model(scene, backend="jax", formulation="projected")
print(model.layout.state)

# %%
# The force is one of the parameters of the vector field. A knot has the state
# (x, a, x_dot, a_dot) and the force.

KNOTS, SPAN, LIMIT = 41, 2.0, 25.0
times = np.linspace(0, SPAN, KNOTS)
step = times[1]
values = {"M": 1.0, "m": 0.3, "l": 0.5, "g": 9.81, "F": 0.0}
p = jnp.array(model.parameter_vector(values))
place = model.layout.parameters.index("F")


def rates(state, force):
    return model.vector_field(0.0, state, p.at[place].set(force))


def split(z):
    return z[: 4 * KNOTS].reshape(KNOTS, 4), z[4 * KNOTS :]


def defects(z):
    """Return the residuals amid the intervals, and those of the ends."""
    y, force = split(z)
    f = jax.vmap(rates)(y, force)
    middle = (y[1:] + y[:-1]) / 2 + step / 8 * (f[:-1] - f[1:])
    between = jax.vmap(rates)(middle, (force[1:] + force[:-1]) / 2)
    left = y[1:] - y[:-1] - step / 6 * (f[:-1] + 4 * between + f[1:])
    hanging, upright = jnp.zeros(4), jnp.array([0.5, jnp.pi, 0, 0])
    return jnp.concatenate([left.ravel(), y[0] - hanging, y[-1] - upright])


def effort(z):
    """Return the integral of the square of the force."""
    _, force = split(z)
    return (
        step
        / 3
        * jnp.sum(force[1:] ** 2 + force[1:] * force[:-1] + force[:-1] ** 2)
    )


guess = np.concatenate(
    [
        np.linspace([0, 0, 0, 0], [0.5, np.pi, 0, 0], KNOTS).ravel(),
        np.zeros(KNOTS),
    ]
)
found = minimize(
    jax.jit(jax.value_and_grad(effort)),
    guess,
    jac=True,
    method="SLSQP",
    bounds=[(None, None)] * (4 * KNOTS) + [(-LIMIT, LIMIT)] * KNOTS,
    constraints={
        "type": "eq",
        "fun": jax.jit(defects),
        "jac": jax.jit(jax.jacfwd(defects)),
    },
    options={"maxiter": 300, "ftol": 1e-8},
)
assert found.success, found.message
y, force = split(found.x)
print(
    f"effort {found.fun:.2f} N^2 s after {found.nit} iterations, largest"
    f" force {abs(force).max():.1f} N"
)

# %%
# The hand-written equations of motion under the piecewise linear force, by
# SciPy at tight tolerances. Near the top the pendulum is unstable, so that the
# error of the cubic polynomials grows towards the end.


def by_hand(t, y):
    _, a, v, w = y
    push = np.interp(t, times, force) + 0.3 * (
        0.5 * w**2 + 9.81 * np.cos(a)
    ) * np.sin(a)
    acceleration = push / (1.0 + 0.3 * np.sin(a) ** 2)
    return [
        v,
        w,
        acceleration,
        -(acceleration * np.cos(a) + 9.81 * np.sin(a)) / 0.5,
    ]


check = solve_ivp(
    by_hand,
    (0, SPAN),
    y[0],
    rtol=1e-10,
    atol=1e-12,
    t_eval=times,
    max_step=step,
)
error = abs(check.y.T - y)
print(f"largest difference of the angle {error[:, 1].max():.1e} rad")
assert error[:, 1].max() < 5e-3

# %%
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
for k in range(0, KNOTS, 2):
    shade = plt.get_cmap("viridis")(k / KNOTS)
    left.plot(
        y[k, 0] + np.array([0, 0.5 * np.sin(y[k, 1])]),
        [0, -0.5 * np.cos(y[k, 1])],
        "o-",
        ms=4,
        color=shade,
    )
left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
_, right = plt.subplots()
right.plot(times, force)
right.set(xlabel="t [s]", ylabel="force [N]")
