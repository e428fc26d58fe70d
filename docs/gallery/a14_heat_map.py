"""
From which initial angles does a double pendulum flip?
======================================================

A sweep of 102,400 motions over a grid of initial angles. Only one number of
each motion is kept: the first time at which the lower rod passes the upright
position.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import cos, sin, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

a, b = dynamicsymbols("a b")
m, l, g = symbols("m l g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P = O.locatenew("P", l * sin(a) * N.x - l * cos(a) * N.y)
Q = P.locatenew("Q", l * sin(b) * N.x - l * cos(b) * N.y)
scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
scene.add_bodies(Particle("upper", P, m), Particle("lower", Q, m))
scene.apply_uniform_gravity(-g * N.y)
model = da.compile_model(scene)

# %%
# cos(b / 2) is zero where the lower rod stands upright.

side = np.linspace(-np.pi, np.pi, 321)[:-1] + np.pi / 320
sweep = model.sweep(
    (0, 10),
    {a.diff(): 0, b.diff(): 0},
    {m: 1, l: 1, g: 9.81},
    grid=da.grid(a=side, b=side),
    rtol=1e-6,
    reduce={"flip": da.first_crossing(cos(b / 2))},
)
flip = sweep.reduced["flip"].reshape(len(side), len(side))
print(
    f"{sweep.stats.run_seconds:.1f} s for {flip.size:,} motions;"
    f" {100 * np.isnan(flip).mean():.0f} % never flip"
)

# %%
_, panel = plt.subplots()
image = panel.pcolormesh(side, side, flip.T, cmap="magma_r", shading="nearest")
plt.colorbar(image, label="first flip [s]")
panel.set(
    xlabel="upper rod [rad]",
    ylabel="lower rod [rad]",
    aspect="equal",
)
