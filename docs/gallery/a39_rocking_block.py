"""
How does a block rock to rest?
==============================

A slender block stands on rough ground, as statues and cabinets do in an
earthquake. It is tilted, released, and rocks from one lower corner to the
other. Housner (1963) gave the period, which falls with the amplitude, and the
velocity that remains after each impact; neither is put into the scene.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import quad
from sympy import symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

x, z, tilt = dynamicsymbols("x z tilt")
m, b, h, g, mu = symbols("m b h g mu", positive=True)
N, O = ReferenceFrame("N"), Point("O")
B = N.orientnew("B", "Axis", (tilt, N.y))
G = O.locatenew("G", x * N.x + z * N.z)
scene = da.Scene("block", frame=N, origin=O, coordinates=[x, z, tilt])
J = inertia(B, 0, m * (b**2 + h**2) / 3, 0)
scene.add_bodies(RigidBody("block", G, B, m, (J, G)))
scene.apply_uniform_gravity(-g * N.z)
for name, side in (("left", -b), ("right", b)):
    corner = G.locatenew(name, side * B.x - h * B.z)
    contact = {"point": corner, "plane": (O, N.z), "friction": mu}
    scene.add_contacts(da.PointPlane(name, body="block", **contact))
floor = da.Ground(N.z, at=O)
scene.add_shapes({"block": da.Box(2 * b, b, 2 * h), "floor": floor})
model = da.compile_model(scene)

# %%
# The block starts at rest on its right corner.

values = {m: 1000, b: 0.25, h: 1.0, g: 9.81, mu: 0.7}
alpha, R = np.arctan(0.25), np.hypot(0.25, 1.0)
start = {tilt: 0.6 * alpha, x: 0, z: R * np.cos(alpha - 0.6 * alpha)}
still = {x.diff(): 0, z.diff(): 0, tilt.diff(): 0}
run = model.simulate((0, 10), start | still, values, rtol=1e-10)
impacts = np.array([phase.t0 for phase in run.phases[1:]])
print(f"{run.status.name}, {len(impacts)} impacts")

# %%
# Between impacts the block is a pendulum about a corner, and an impact leaves
# 1 - 3/2 sin(alpha)^2 of the angular velocity.


def quarter(level):
    """Return the time from rest to the impact, for an energy of a rocking."""
    lowest = np.arccos(level)  # angle of the corner's line at rest

    def slowness(s):
        angle = lowest + s * s
        return 2 * s / np.sqrt(3 * g_R / 2 * (level - np.cos(angle)))

    return quad(slowness, 0, np.sqrt(alpha - lowest), epsabs=1e-12)[0]


g_R = 9.81 / R
kept = (1 - 1.5 * np.sin(alpha) ** 2) ** 2  # of the kinetic energy
times, level = [quarter(np.cos(0.4 * alpha))], np.cos(0.4 * alpha)
for _ in range(9):
    level = np.cos(alpha) + kept * (level - np.cos(alpha))
    times.append(times[-1] + 2 * quarter(level))
error = abs(impacts[:10] - times).max()
print(f"largest difference of the first ten impacts: {error:.1e} s")
assert error < 1e-7

# %%
fine = run(np.linspace(0, 10, 2000))
_, panel = plt.subplots()
panel.plot(fine.t, fine["tilt"] / alpha)
panel.plot(times, np.zeros(10), "k.", label="impacts by Housner")
panel.set(xlabel="t [s]", ylabel="tilt / angle of the diagonal")
panel.legend()

# %%
# The motion, at half its speed.

# sphinx_gallery_thumbnail_number = -1
run(np.linspace(0, 6, 150)).animate(fps=25, speed=0.5)
