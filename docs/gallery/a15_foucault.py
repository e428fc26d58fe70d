"""
How fast does the plane of Foucault's pendulum turn?
====================================================

A pendulum on the turning earth, at the latitude of Paris: the plane of its
swing turns at -W sin(latitude). The frame of the laboratory is oriented by
time.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import sqrt, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

x, y, t = *dynamicsymbols("x y"), dynamicsymbols._t
m, l, g, W, latitude = symbols("m l g W latitude", positive=True)
N, O = (
    ReferenceFrame("N"),
    Point("O"),
)  # inertial; z along the axis of the earth
E = N.orientnew("E", "Axis", (W * t, N.z))
L = E.orientnew("L", "Axis", (-latitude, E.y))  # L.x points up
up, east, north = L.x, L.y, L.z
B = O.locatenew("B", x * east + y * north - sqrt(l**2 - x**2 - y**2) * up)
scene = da.Scene("foucault", frame=N, origin=O, coordinates=[x, y])
scene.add_bodies(Particle("bob", B, m))
scene.add_loads((B, -m * g * up))
model = da.compile_model(scene)

# %%
# The origin lies on the axis of the earth, so that no centrifugal force tilts
# the vertical. The earth turns faster here: one revolution in 600 s.

turn, phi = 2 * np.pi / 600, np.radians(48.85)
values = {m: 28, l: 67, g: 9.81, W: turn, latitude: phi}
run = model.simulate(
    (0, 300), {x: 3.0, y: 0, x.diff(): 0, y.diff(): 0}, values, rtol=1e-11
)
fine = run(np.linspace(0, 300, 20001))
far = np.hypot(fine["x"], fine["y"])
peaks = np.flatnonzero((far[1:-1] > far[:-2]) & (far[1:-1] > far[2:])) + 1
plane = np.unwrap(2 * np.arctan2(fine["y"][peaks], fine["x"][peaks])) / 2
rate = np.polyfit(fine.t[peaks], plane, 1)[0]
print(
    f"the plane turns at {rate:.5f} rad/s; -W sin(latitude) ="
    f" {-turn * np.sin(phi):.5f} rad/s"
)

# %%
_, panel = plt.subplots()
panel.plot(fine["x"], fine["y"], lw=0.5)
panel.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
