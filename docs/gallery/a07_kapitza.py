"""
Can a pendulum stand upside down?
=================================

The pivot of a pendulum vibrates vertically: y = a cos(w t). Beyond a w >
sqrt(2 g l) the inverted position is stable. A sweep over the amplitude a finds
that limit.
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

theta, t = dynamicsymbols("theta"), dynamicsymbols._t
m, l, g, a, w = symbols("m l g a w", positive=True)
N, O = ReferenceFrame("N"), Point("O")
pivot = O.locatenew("pivot", a * cos(w * t) * N.y)
scene = da.Scene("kapitza", frame=N, origin=O, coordinates=[theta])
scene.add_bodies(
    Particle(
        "bob",
        pivot.locatenew("P", l * sin(theta) * N.x + l * cos(theta) * N.y),
        m,
    )
)
scene.apply_uniform_gravity(-g * N.y)
model = da.compile_model(scene)

# %%
# theta = 0 is upside down. Each case starts near it; the largest angle says
# whether the pendulum stays.

amplitudes = np.linspace(0.005, 0.06, 400)
values = {m: 1, l: 0.5, g: 9.81, a: amplitudes, w: 100.0}
sweep = model.sweep(
    (0, 20),
    {theta: 0.02, theta.diff(): 0},
    values,
    reduce={"largest": da.maximum(theta)},
)
limit = np.sqrt(2 * 9.81 * 0.5) / 100.0
found = amplitudes[np.flatnonzero(sweep.reduced["largest"] < 1.5)[0]]
print(
    f"stable from a = {found:.4f} m on; the averaged equations say"
    f" {limit:.4f} m"
)

# %%
runs = {
    label: model.simulate(
        (0, 6), {theta: 0.2, theta.diff(): 0}, {**values, a: size}
    )
    for label, size in (
        ("a w = 1.2 sqrt(2 g l)", 1.2 * limit),
        ("a w = 0.9 sqrt(2 g l)", 0.9 * limit),
    )
}
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
for label, run in runs.items():
    left.plot(run.t, np.clip(run["theta"], -4, 4), label=label, lw=0.8)
left.set(xlabel="t [s]", ylabel="theta [rad]")
left.legend()
_, right = plt.subplots()
right.plot(amplitudes, np.minimum(sweep.reduced["largest"], 4))
right.axvline(limit, color="C3", ls="--")
right.set(xlabel="a [m]", ylabel="largest angle [rad]")
