"""
Which damper is best on a measured road?
========================================

A quarter car drives over a road whose height was measured every 5 cm. The
record is an input of the scene; steps end at its knots, so that the corners of
the record cost no accuracy. A sweep over the damping shows what comfort and
grip ask for. SciPy's `lsim` on the linearised car, which is exact between
knots, is the check.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import lsim
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

z_b, z_w, road = dynamicsymbols("z_b z_w road")
m_b, m_w, k_s, k_t, c = symbols("m_b m_w k_s k_t c", positive=True)
N, O = ReferenceFrame("N"), Point("O")
body, wheel = O.locatenew("body", z_b * N.z), O.locatenew("wheel", z_w * N.z)
scene = da.Scene("quarter_car", frame=N, origin=O, coordinates=[z_b, z_w])
scene.add_bodies(Particle("body", body, m_b), Particle("wheel", wheel, m_w))
scene.add_inputs(road)
suspension = k_s * (z_w - z_b) + c * (z_w - z_b).diff()
tyre = k_t * (road - z_w)
scene.add_loads((body, suspension * N.z), (wheel, (tyre - suspension) * N.z))
model = da.compile_model(
    scene, outputs={"tyre": tyre, "acceleration": suspension / m_b}
)

# %%
# The record: a random road whose spectrum falls with the square of the wave
# number, as that of a country road does.

speed, spacing = 20.0, 0.05
rng = np.random.default_rng(5)
height = np.cumsum(0.003 * np.sqrt(spacing) * rng.standard_normal(4001))
times = np.arange(len(height)) * spacing / speed
record = da.samples(times, height - height[0], kind="linear")

# %%
# One damper against `lsim`, which interpolates its input linearly, too.

values = {m_b: 300, m_w: 40, k_s: 2e4, k_t: 2e5}
rest = {z_b: 0, z_w: 0, z_b.diff(): 0, z_w.diff(): 0}
run = model.simulate(
    (0, times[-1]),
    rest,
    {**values, c: 1500},
    inputs={road: record},
    t_eval=times,
    rtol=1e-10,
)
linear = model.linearize(
    0.0, rest, {**values, c: 1500}, inputs={road: 0.0}, outputs=[z_b, "tyre"]
)
_, check, _ = lsim(linear.realization(), record.values, times)
recorded = np.stack([run["z_b"], run["tyre"]], axis=1)
error = (abs(recorded - check).max(axis=0) / abs(check).max(axis=0)).max()
print(
    f"{run.stats.steps} steps over {len(times)} knots; largest relative"
    f" difference from lsim {error:.1e}"
)
assert error < 1e-8

# %%
# Comfort is the root mean square of the acceleration of the body, grip that of
# the force of the tyre.

damping = np.geomspace(300, 6000, 200)
sweep = model.sweep(
    (0, times[-1]),
    rest,
    {**values, c: damping},
    inputs={road: record},
    t_eval=times,
)
comfort, grip = (
    np.sqrt(np.mean(sweep[name] ** 2, axis=1))
    for name in ("acceleration", "tyre")
)
for name, curve in (("comfort", comfort), ("grip", grip)):
    print(f"best for {name}: c = {damping[curve.argmin()]:.0f} N s/m")

# %%
# sphinx_gallery_thumbnail_number = 2
_, left = plt.subplots()
shown = times < 3
left.plot(times[shown], 1e3 * record.values[shown], label="road")
left.plot(times[shown], 1e3 * run["z_b"][shown], label="body")
left.set(xlabel="t [s]", ylabel="height [mm]")
left.legend()
_, right = plt.subplots()
right.plot(comfort, grip, "k-", lw=0.8)
marks = right.scatter(comfort, grip, c=damping, s=15)
plt.colorbar(marks, label="c [N s/m]")
right.set(
    xlabel="body, rms [m/s^2]",
    ylabel="tyre, rms [N]",
)
