"""
How does compile time grow with the number of links?
====================================================

A chain of 50 pendulum links hangs from one end and is released from the
horizontal. The equations are derived by articulated bodies: the operations
grow linearly with the number of links.
"""

import time

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


def chain(n):
    """Return a chain of n links with a particle at the end of each."""
    angles = dynamicsymbols(f"a0:{n}")
    m, l, g = symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(f"chain_{n}", frame=N, origin=O, coordinates=angles)
    point = O
    for i, a in enumerate(angles):
        point = point.locatenew(f"P{i}", l * sin(a) * N.x - l * cos(a) * N.y)
        scene.add_bodies(Particle(f"p{i}", point, m))
    scene.apply_uniform_gravity(-g * N.y)
    return scene, point


sizes, seconds = (5, 10, 20, 50), []
for n in sizes:
    scene, end = chain(n)
    before = time.perf_counter()
    model = da.compile_model(scene, outputs=[end], cache=False)
    seconds.append(time.perf_counter() - before)
    print(f"{n} links: {seconds[-1]:.2f} s from scene to program")

# %%
start = dict.fromkeys(model.layout.coordinates, np.pi / 2) | dict.fromkeys(
    model.layout.rates, 0.0
)
run = model.simulate(
    (0, 0.6), start, {"m": 0.02, "l": 0.02, "g": 9.81}, rtol=1e-8
)
print(
    f"{run.stats.steps} steps, relative drift of the energy"
    f" {np.ptp(run['energy']) / 0.02 / 50 / 9.81:.1e}"
)

# %%
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
for t in np.linspace(0, 0.6, 13):
    angles = run(t).q.ravel()
    x, y = np.cumsum(0.02 * np.sin(angles)), -np.cumsum(0.02 * np.cos(angles))
    left.plot(np.r_[0, x], np.r_[0, y], lw=1, color="C0", alpha=0.3 + t)
left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
_, right = plt.subplots()
right.plot(sizes, seconds, "o-")
right.set(
    xlabel="links", ylabel="compilation [s]", xticks=sizes, ylim=(0, None)
)
