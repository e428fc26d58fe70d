"""
When does a pair of gears with backlash rattle?
===============================================

Teeth of gears have some play. While the torque of an engine swings little, the
flanks that drive stay in contact; beyond a limit they part, strike back, and
strike the flanks behind, too. The limit has a closed form. The check of the
motion is a program of its own, with formulas for the flights between impacts.
"""

from functools import partial

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq
from sympy import cos, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# The engine turns the left gear, and the right one has a constant load. In the
# pitch point, teeth push the right gear up by ``P`` or, with the flanks
# behind, down by ``Q``. The gaps of the two contacts add up to the play.

a, b, t = *dynamicsymbols("a b"), dynamicsymbols._t
M, swing, w, play, e = symbols("M swing w play e", positive=True)
r, R, J, K = 0.06, 0.09, 0.004, 0.006
N, O = ReferenceFrame("N"), Point("O")
A, B = (
    N.orientnew(*n) for n in (("A", "Axis", (a, N.z)), ("B", "Axis", (b, N.z)))
)
C, pitch = O.locatenew("C", (r + R) * N.x), O.locatenew("pitch", r * N.x)
scene = da.Scene("gears", frame=N, origin=O, coordinates=[a, b])
scene.add_bodies(
    RigidBody("left", O, A, 1, (inertia(A, 0, 0, J), O)),
    RigidBody("right", C, B, 1, (inertia(B, 0, 0, K), C)),
)
engine, load = M + swing * cos(w * t), M * R / r
scene.add_loads((A, engine * N.z), (B, load * N.z))
P, Q = da.unknowns("P Q")
gap = -r * a - R * b
teeth = {"body": "right", "other": "left", "at": pitch}
scene.add_joints(da.Joint("drive", force=P * N.y, **teeth))
scene.add_joints(da.Joint("back", force=-Q * N.y, **teeth))
scene.add_contacts(
    da.UnilateralContact(P, gap, restitution=e, name="drive"),
    da.UnilateralContact(Q, play - gap, restitution=e, name="back"),
)

# %%
# Outlines of the gears with involute flanks, for the picture.


def gear(radius, count, begin):
    """Return vertices and triangles of a gear, with a tooth at an angle."""
    flank = np.deg2rad(25)
    base = radius * np.cos(flank)
    heights = np.linspace(max(base, radius - 0.0095), radius + 0.008, 5)
    angles = np.arccos(base / heights)
    width = (2 * np.pi / count - 0.004 / radius) / 4
    half = width + np.tan(flank) - flank - np.tan(angles) + angles
    heights = np.r_[radius - 0.0095, heights, heights[::-1], radius - 0.0095]
    half = np.r_[-half[0], -half, half[::-1], half[0]]
    turns = begin + 2 * np.pi / count * np.arange(count)[:, np.newaxis] + half
    rim = heights * np.array([np.cos(turns), np.sin(turns), 0 * turns])
    points = np.concatenate([[[0, 0, 0]], rim.reshape(3, -1).T])
    last = len(points) - 1
    return points, [[0, i, i % last + 1] for i in range(1, last + 1)]


thick = (2 * np.pi * r / 12 - 0.004) / 2
gears = gear(r, 12, -thick / 2 / r), gear(R, 18, np.pi - thick / 2 / R)
scene.add_shapes({"left": da.Mesh(gears[0]), "right": da.Mesh(gears[1])})
ends = O.locatenew("end_left", r * A.x), C.locatenew("end_right", -R * B.x)
scene.add_shapes({"marks": [da.Rod(O, ends[0]), da.Rod(C, ends[1])]})
model = da.compile_model(scene, outputs={"gap": gap})

# %%
# In contact the gears are one inertia. The teeth part where the load pulls
# more than the engine, at a swing of its torque beyond ``onset``.

left, right = J / r**2, K / R**2  # as masses at the pitch point
onset = 3 * (left + right) / right
values = {M: 3, w: 200, play: 0.004, e: 0.6}
start = {a: 0, b: 0, a.diff(): 20, b.diff(): -20 * r / R}
swings = onset * np.linspace(0.8, 2.5, 171)
largest = {"gap": da.maximum("gap")}
sweep = model.sweep((0, 1), start, {**values, swing: swings}, reduce=largest)
rattles = swings[sweep.reduced["gap"] > 1e-9]
print(f"rattles from {rattles[0]:.3f} N m on; closed form {onset:.3f} N m")
assert abs(rattles[0] - onset) <= swings[1] - swings[0]

# %%
# The check of a motion. The gap has the acceleration -down - up cos(w t), and
# so a formula in a flight. An impact turns its rate, times -e. Where impacts
# accumulate, the flanks stay together until the acceleration parts them.

down, up = 3 / r * (1 / left + 1 / right), 2 * onset / r / left


def flight(t, x, v, s):
    """Return gap and rate a while s after those at a time."""
    sine, cosine = np.sin(200 * t), np.cos(200 * t)
    rate = v - down * s - up / 200 * (np.sin(200 * (t + s)) - sine)
    wave = np.cos(200 * (t + s)) - cosine + 200 * s * sine
    return x + v * s - down * s**2 / 2 + up / 200**2 * wave, rate


def past(s, t, x, v, wall):
    """Return how far the gap is beyond a limit after a while."""
    return flight(t, x, v, s)[0] - wall


def program(times):
    """Return the gap at times, which begin in contact."""
    gaps, t, x, v = 0 * times, 0.0, 0.0, 0.0
    while t < times[-1]:
        now, ahead = t, np.geomspace(1e-9, 0.04, 4000)
        if abs(v) < 1e-6:
            turn = np.arccos(-down / up) * (1 if x == 0 else -1)
            turn += 2 * np.pi * np.ceil((200 * t - turn) / 2 / np.pi)
            t, v, ahead = turn / 200, 0.0, ahead[ahead > 1e-4]
            gaps[(times >= now) & (times < t)] = x
        places = flight(t, x, v, ahead)[0]
        k = np.argmax((places < 0) | (places > 0.004))
        wall = 0.0 if places[k] < 0 else 0.004
        beyond = partial(past, t=t, x=x, v=v, wall=wall)
        s = brentq(beyond, ahead[k - 1], ahead[k], xtol=1e-16)
        flown = (times >= t) & (times < t + s)
        gaps[flown] = flight(t, x, v, times[flown] - t)[0]
        t, x, v = t + s, wall, -0.6 * flight(t, x, v, s)[1]
    return gaps


times, strong = np.linspace(0, 0.5, 3000), {**values, swing: 2 * onset}
run = model.simulate((0, 0.5), start, strong, t_eval=times, rtol=1e-12)
error = abs(run["gap"] - program(times)).max()
print(
    f"{len(run.phases)} phases; largest difference of the gap: {error:.1e} m"
)
assert error < 1e-13

# %%
# No force between teeth changes the momentum of both gears, reduced to the
# pitch point.

momentum = left * r * run["a_dot"] - right * R * run["b_dot"]
gained = 2 * onset / r * np.sin(200 * times) / 200
error = abs(momentum - momentum[0] - gained).max()
print(f"largest difference of the momentum: {error:.1e} N s")
assert error < 1e-11

# %%
# Up to about 1.5 times the limit the flanks behind are out of reach.

_, panel = plt.subplots()
panel.plot(swings, 1e3 * sweep.reduced["gap"], ".")
panel.axvline(onset, color="C3", label="closed form")
panel.axhline(4, color="0.5", ls="--", label="play")
panel.set(xlabel="swing of the torque [N m]", ylabel="largest gap [mm]")
panel.legend(loc="lower right")

# %%
# The gap over three periods of the torque, at three swings.

_, panel = plt.subplots()
shown = np.linspace(0, 6 * np.pi / 200, 2000)
for factor in (1.2, 1.5, 2):
    runs = {**values, swing: factor * onset}
    run = model.simulate((0, 0.6), start, runs, t_eval=0.5 + shown)
    panel.plot(1e3 * shown, 1e3 * run["gap"], label=f"{factor}")
panel.set(xlabel="t - 500 [ms]", ylabel="gap [mm]", ylim=(-0.2, 5.2))
panel.legend(title="swing / limit", ncols=3, loc="upper center")

# %%
# The teeth in a flight: the left gear drives upwards.

# sphinx_gallery_thumbnail_number = 3
_, panel = plt.subplots()
pose = run([run.t[np.argmax(run["gap"])] - 2e-3])
turns = ((0, pose["a"][0], "C0"), (r + R, pose["b"][0], "C1"))
for (points, _), (place, turn, color) in zip(gears, turns, strict=True):
    xy = points[1:, :2] @ [1, 1j] * np.exp(1j * turn) + place
    panel.fill(1e3 * xy.real, 1e3 * xy.imag, color=color, alpha=0.7)
panel.set(xlim=(20, 100), ylim=(-28, 28))
panel.set_axis_off()

# %%
# The motion, at a fiftieth of its speed.

model.simulate((0, 0.1), start, runs).animate(fps=25, speed=0.02)
