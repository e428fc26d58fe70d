"""
From which speed on does a cam follower float?
==============================================

A spring presses a follower onto an eccentric cam. At high speed the follower
cannot keep up with the falling flank: it floats, and lands with an impact. The
speed at which that begins, the take-off and the landing have closed forms.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq
from sympy import cos, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

y, t = dynamicsymbols("y"), dynamicsymbols._t
m, k, F, e, w = symbols("m k F e w", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P, cam = O.locatenew("P", y * N.y), e * (1 - cos(w * t))
scene = da.Scene("follower", frame=N, origin=O, coordinates=[y])
scene.add_bodies(Particle("follower", P, m))
scene.add_loads((P, -(F + k * y) * N.y))  # F is the preload of the spring
surface = (O.locatenew("C", cam * N.y), N.y)
contact = {"body": "follower", "point": P, "plane": surface}
scene.add_contacts(da.PointPlane("cam", **contact, restitution=0.3))
model = da.compile_model(scene, outputs=["cam.normal", "cam.gap"])

# %%
# On the cam, the normal reaction is F + k y + m y''. It is least on top of the
# cam, and vanishes there at the speed ``onset``.

values = {m: 0.2, k: 5e3, F: 60.0, e: 0.005}
onset = np.sqrt((60 + 2 * 5e3 * 0.005) / (0.2 * 0.005))
rest = {y: 0, y.diff(): 0}
speeds = onset * np.linspace(0.9, 1.5, 60)
kept = {"gap": da.maximum("cam.gap")}
sweep = model.sweep((0, 0.1), rest, {**values, w: speeds}, reduce=kept)
floats = speeds[sweep.reduced["gap"] > 1e-9]
print(f"floats from {floats[0]:.1f} rad/s on; closed form {onset:.1f} rad/s")
assert abs(floats[0] - onset) <= speeds[1] - speeds[0]

# %%
# The first flight at 1.2 times that speed: the follower leaves where the
# reaction vanishes, swings on its spring, and lands.

speed, natural = 1.2 * onset, np.sqrt(5e3 / 0.2)
run = model.simulate((0, 0.08), rest, {**values, w: speed}, rtol=1e-12)
flight = next(phase for phase in run.phases if phase.modes["cam"] == "open")
leave = np.arccos(-85 / (0.001 * speed**2 - 25)) / speed
height = 0.005 * (1 - np.cos(speed * leave))
rate = 0.005 * speed * np.sin(speed * leave)


def gap(time):
    """Return the height above the cam in the flight."""
    turned = natural * (time - leave)
    wave = (height + 0.012) * np.cos(turned) + rate / natural * np.sin(turned)
    return wave - 0.012 - 0.005 * (1 - np.cos(speed * time))


land = brentq(gap, leave + 1e-3, leave + 0.015, xtol=1e-15)
print(f"take-off {flight.t0:.12f} s, closed form {leave:.12f} s")
print(f"landing  {flight.t1:.12f} s, closed form {land:.12f} s")
assert abs(np.array([flight.t0 - leave, flight.t1 - land])).max() < 1e-11

# %%
fine = run(np.linspace(0, 0.08, 3000))
lift = 5 * (1 - np.cos(speed * fine.t))
# sphinx_gallery_thumbnail_number = 1
_, panel = plt.subplots()
panel.fill_between(1e3 * fine.t, lift, -1, color="0.85", label="cam")
panel.plot(1e3 * fine.t, 1e3 * fine["y"], label="follower")
panel.set(xlabel="t [ms]", ylabel="lift [mm]", ylim=(-1, 14))
panel.legend(loc="upper left", ncols=2)

# %%
_, panel = plt.subplots()
panel.plot(speeds * 30 / np.pi, 1e3 * sweep.reduced["gap"], ".")
panel.axvline(onset * 30 / np.pi, color="C3", label="closed form")
panel.set(xlabel="speed of the cam [1/min]", ylabel="largest gap [mm]")
panel.legend()
