"""
When do the laws of rigid friction contradict each other?
=========================================================

A rod slides on rough ground with one end. Beyond a coefficient of friction of
4/3 there are angles at which no normal reaction satisfies the laws of contact
and friction, or two do: Painleve's paradox. The run ends there with a status
that says so.
"""

import matplotlib.pyplot as plt
import numpy as np

import dalembert as da

model = da.compile_model(da.scenes.sliding_rod(), outputs=["N"])
runs = {}
for mu in (0.5, 1.2, 1.6):
    start = {
        "x": 0,
        "y": 0,
        "theta": 0.5,
        "x_dot": -10.0,
        "y_dot": 0,
        "theta_dot": 2,
    }
    runs[mu] = model.simulate(
        (0, 1), start, {"m": 1, "l": 0.5, "mu": mu, "g": 9.81}, rtol=1e-9
    )
    print(f"mu = {mu}: {runs[mu].status.name} at t = {runs[mu].t[-1]:.3f} s")

# %%
# The coefficient p of the normal reaction in p N + b = 0. It is negative in
# the shaded region.

angle, coefficient = np.meshgrid(
    np.linspace(0, np.pi / 2, 300), np.linspace(0, 2.5, 300)
)
p = 1 + 3 * np.cos(angle) * (np.cos(angle) - coefficient * np.sin(angle))
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
_, right = plt.subplots()
left.contourf(angle, coefficient, p, levels=[-10, 0], colors=["0.85"])
for mu, run in runs.items():
    left.plot(run["theta"], np.full(len(run.t), mu))
    right.plot(run.t, run["N"], label=f"mu = {mu}")
left.set(xlabel="theta [rad]", ylabel="mu", xlim=(0, np.pi / 2))
right.set(xlabel="t [s]", ylabel="normal reaction [N]", ylim=(-1, 40))
right.legend()
