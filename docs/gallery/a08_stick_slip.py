"""
When does a block on a belt stick and slip?
===========================================

A block on a moving belt, held by a spring. The coefficient of friction is
larger in stick than in slip. The block sticks until the spring overcomes
static friction, slips back, and sticks again. The law is set-valued: a contact
that sticks does not creep.
"""

import matplotlib.pyplot as plt
import numpy as np

import dalembert as da

model = da.compile_model(da.scenes.belt_oscillator(), outputs=["F", "N"])
start = {"x": 0, "x_dot": 0.2, "y": 0, "y_dot": 0}
values = {"m": 1.0, "k": 4.0, "v_b": 0.2, "mu": 0.3, "mu_s": 0.5, "g": 9.81}
run = model.simulate((0, 20), start, values, rtol=1e-10)

# %%
# The phases of the contact, and the closed form of the time of slip.

slips = [
    phase.t1 - phase.t0
    for phase in run.phases
    if phase.modes["belt"] == "slip"
]
w = np.sqrt(4.0)
exact = 2 / w * (np.pi - np.arctan((0.5 - 0.3) * 9.81 * w / (4.0 * 0.2)))
print(f"time of slip: {slips[0]:.12f} s, closed form: {exact:.12f} s")

# %%
# sphinx_gallery_thumbnail_number = 2
_, left = plt.subplots()
left.plot(run["x"], run["x_dot"])
left.set(xlabel="x [m]", ylabel="x_dot [m/s]")
_, right = plt.subplots()
right.plot(run.t, run["F"])
right.axhline(0.5 * 9.81, color="0.5", ls="--")
right.axhline(0.3 * 9.81, color="0.5", ls=":")
right.set(xlabel="t [s]", ylabel="friction force [N]")
