"""
Does a stiffer damper make a car more comfortable over a bump?
==============================================================

A quarter car drives over a speed bump, a piece of a cosine in the road. Steps
end exactly where the bump begins and ends. A sweep over the damping shows the
conflict between comfort (acceleration of the body) and grip (load of the
wheel).
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import Piecewise, cos, pi, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

z_b, z_w, t = *dynamicsymbols("z_b z_w"), dynamicsymbols._t
m_b, m_w, k_s, k_t, c, v, h, length, g = symbols(
    "m_b m_w k_s k_t c v h length g", positive=True
)
place = v * (t - 1)  # the bump begins after one second
road = Piecewise(
    (
        h / 2 * (1 - cos(2 * pi * place / length)),
        (place > 0) & (place < length),
    ),
    (0, True),
)
N, O = ReferenceFrame("N"), Point("O")
body, wheel = O.locatenew("body", z_b * N.z), O.locatenew("wheel", z_w * N.z)
scene = da.Scene("quarter_car", frame=N, origin=O, coordinates=[z_b, z_w])
scene.add_bodies(Particle("body", body, m_b), Particle("wheel", wheel, m_w))
suspension = -k_s * (z_b - z_w) - c * (z_b.diff() - z_w.diff())
tyre = -k_t * (z_w - road)
scene.add_loads((body, suspension * N.z), (wheel, (tyre - suspension) * N.z))
acceleration = suspension / m_b
model = da.compile_model(scene)

# %%
values = {m_b: 300, m_w: 40, k_s: 2e4, k_t: 2e5, v: 5.0, h: 0.08, length: 1.0}
damping = np.linspace(200, 6000, 60)
rest = {z_b: 0, z_w: 0, z_b.diff(): 0, z_w.diff(): 0}
kept = {
    "up": da.maximum(acceleration),
    "down": da.minimum(acceleration),
    "load": da.minimum(tyre),
}
sweep = model.sweep((0, 4), rest, {**values, c: damping}, reduce=kept)
comfort = np.maximum(sweep.reduced["up"], -sweep.reduced["down"])
print(
    f"least peak acceleration {comfort.min():.2f} m/s^2 at c ="
    f" {damping[comfort.argmin()]:.0f} N s/m"
)

# %%
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
for value in (500, 1500, 4000):
    run = model.simulate((0, 4), rest, {**values, c: value})
    fine = run(np.linspace(0.8, 3, 800))
    left.plot(fine.t, fine["z_b"], label=f"c = {value} N s/m")
left.set(xlabel="t [s]", ylabel="body [m]")
left.legend()
_, right = plt.subplots()
right.plot(damping, comfort)
right.set(xlabel="c [N s/m]", ylabel="peak [m/s^2]")
