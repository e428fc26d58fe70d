"""
How rarely may a controller act and still balance a pole?
=========================================================

A sampled controller acts once in each period and holds its force in between.
The gains are designed for continuous time; a sweep over the period shows where
they fail. The eigenvalues of the sampled linear system predict the limit.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import expm, solve_continuous_are
from scipy.optimize import brentq
from sympy import Max, Min, cos, sin, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

x, a, u = dynamicsymbols("x a u")
M, m, l, g, T = symbols("M m l g T", positive=True)
k = symbols("k_x k_a k_v k_w")
N, O = ReferenceFrame("N"), Point("O")
cart = O.locatenew("cart", x * N.x)
bob = cart.locatenew(
    "bob", l * sin(a) * N.x + l * cos(a) * N.y
)  # a = 0 is upright
scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, a])
scene.add_bodies(Particle("cart", cart, M), Particle("bob", bob, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_inputs(u)
scene.add_loads((cart, u * N.x))

# %%
# The linear model about the upright position, and gains that are optimal for
# it in continuous time.

values = {M: 1.0, m: 0.2, l: 0.6, g: 9.81}
upright = {x: 0, a: 0, x.diff(): 0, a.diff(): 0}
linear = da.compile_model(scene).linearize(0.0, upright, values, inputs={u: 0})
A, B = linear.A, linear.B
P = solve_continuous_are(A, B, np.diag([1.0, 1.0, 0.1, 0.1]), [[0.1]])
gains = 10.0 * B.T @ P
print("gains:", gains[0].round(2))

# %%
# Sampled, the linear system is y' = (Phi - Gamma gains) y from one instant to
# the next. It is stable as long as no eigenvalue is larger than one.


def spectral_radius(period):
    """Return the size of the largest eigenvalue over one period."""
    block = expm(period * np.block([[A, B], [np.zeros((1, 5))]]))
    return abs(np.linalg.eigvals(block[:4, :4] - block[:4, 4:] @ gains)).max()


limit = brentq(lambda period: spectral_radius(period) - 1.0, 0.05, 0.5)
print(f"predicted limit: {1e3 * limit:.1f} ms")

# %%
# The full model with the controller in it. The motor gives at most 20 N, so
# that a lost pole does not run away. In 200 cases the period differs; whether
# the lean grows is seen in the last ten seconds.

law = -sum(
    gain * value
    for gain, value in zip(k, (x, a, x.diff(), a.diff()), strict=True)
)
scene.add_controllers(
    da.Controller("balance", period=T, inputs={u: Max(-20, Min(20, law))})
)
model = da.compile_model(scene)
p = {**values, **dict(zip(k, gains[0], strict=True))}
start = {x: 0, a: 0.05, x.diff(): 0, a.diff(): 0}
periods = np.linspace(0.3 * limit, 1.2 * limit, 200)
sweep = model.sweep(
    (0, 20), start, {**p, T: periods}, t_eval=np.linspace(10, 20, 201)
)
before, after = (
    abs(sweep["a"][:, :100]).max(axis=1),
    abs(sweep["a"][:, 100:]).max(axis=1),
)
grows = (after > before) & (after > 1e-6)
print(
    f"the lean grows from a period of {1e3 * periods[grows].min():.1f} ms on"
)
assert abs(periods[grows].min() / limit - 1) < 0.01

# %%
# sphinx_gallery_thumbnail_number = 2
_, left = plt.subplots()
for share in (0.3, 0.9):
    run = model.simulate((0, 5), start, {**p, T: share * limit})
    left.plot(run.t, run["u"], label=f"period {1e3 * share * limit:.0f} ms")
left.set(xlabel="t [s]", ylabel="force on the cart [N]")
left.legend()
_, right = plt.subplots()
right.semilogy(1e3 * periods, np.maximum(after, 1e-10), ".", ms=4)
right.axvline(
    1e3 * limit, color="C3", lw=0.8, label="limit of the linear system"
)
right.set(xlabel="period [ms]", ylabel="largest lean [rad]")
right.legend()
