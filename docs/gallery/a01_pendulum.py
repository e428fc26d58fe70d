"""
What is the period of a pendulum at a large amplitude?
======================================================

A pendulum in one coordinate. The period is compared with the complete elliptic
integral.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import ellipk
from sympy import cos, sin, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

theta, (m, l, g) = dynamicsymbols("theta"), symbols("m l g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[theta])
scene.add_bodies(
    Particle(
        "bob", O.locatenew("P", l * sin(theta) * N.x - l * cos(theta) * N.y), m
    )
)
scene.apply_uniform_gravity(-g * N.y)
model = da.compile_model(scene)

# %%
# The first time at which the rate becomes positive is half a period after a
# release at rest. A sweep over the amplitude keeps that time alone.

amplitudes = np.linspace(0.1, 3.1, 200)
half = da.first_crossing(theta.diff(), direction=1)
sweep = model.sweep(
    (0, 10),
    {theta: amplitudes, theta.diff(): 0},
    {m: 1, l: 1, g: 9.81},
    reduce={"half": half},
    rtol=1e-12,
    atol=1e-14,
)
period = 2 * sweep.reduced["half"]
exact = 4 * ellipk(np.sin(amplitudes / 2) ** 2) / np.sqrt(9.81)
print(
    "largest relative error of the period:"
    f" {np.nanmax(np.abs(period / exact - 1)):.1e}"
)

# %%
_, panel = plt.subplots()
panel.plot(amplitudes, period, label="simulated")
panel.plot(amplitudes[::10], exact[::10], "k.", label="elliptic integral")
panel.set(xlabel="amplitude [rad]", ylabel="period [s]")
panel.legend()
