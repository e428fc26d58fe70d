"""
How hard does a plate press on a corner?
========================================

The first example of the text: the end A of a plate slides on the ground, the
plate leans on a corner Q with Coulomb friction. The vertical reaction N_A at
the end has no power on the coordinates, and is an output all the same.
"""

import matplotlib.pyplot as plt
import numpy as np

import dalembert as da

scene = da.scenes.corner_plate(friction=True)
x, theta = scene.coordinates
model = da.compile_model(scene, outputs=["N_Q", "F_Q", "N_A"])

# %%
values = {"m": 2.0, "l": 1.0, "h": 0.6, "g": 9.81, "F_A": 0.0, "mu": 0.2}
start = {theta: 0.9, x: -0.6 / np.tan(0.9), theta.diff(): 0}
run = model.simulate((0, 0.5), start, values, rtol=1e-9)
lifts = run.t[np.flatnonzero(run["N_A"] < 0)[:1]]
print(
    f"from t = {lifts[0]:.2f} s on N_A is negative: a plate that rests on the"
    " ground lifts off"
)

# %%
run = run(np.linspace(0, 0.5, 200))
# sphinx_gallery_thumbnail_number = 2
_, left = plt.subplots()
left.plot(run.t, np.degrees(run["theta"]))
left.set(xlabel="t [s]", ylabel="theta [degrees]")
_, right = plt.subplots()
for name in ("N_A", "N_Q", "F_Q"):
    right.plot(run.t, run[name], label=name)
right.axhline(0, color="0.7", lw=0.8)
right.set(xlabel="t [s]", ylabel="force [N]")
right.legend()
