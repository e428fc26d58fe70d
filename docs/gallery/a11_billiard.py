"""
When does a struck billiard ball begin to roll?
===============================================

A ball with side spin slides on the cloth; Coulomb friction acts in two
directions. The centre moves on a parabola until slip ends. Then the ball rolls
on a straight line. A slip velocity of u ends after 2 u / (7 mu g), as Euler
found in 1758.
"""

import matplotlib.pyplot as plt
import numpy as np

import dalembert as da

model = da.compile_model(da.scenes.billiard_ball(), outputs=["F_x", "F_y"])
r, mu, g = 0.028, 0.2, 9.81
attitude = {"e0": 1, "e1": 0, "e2": 0, "e3": 0}
runs = []
for side in (-60.0, 0.0, 60.0):
    # body rates from the angular velocity: e_dot = e omega / 2 at the identity
    rates = {"e0_dot": 0, "e1_dot": side / 2, "e2_dot": -10.0, "e3_dot": 0}
    start = {
        "x": 0,
        "y": 0,
        "z": r,
        "x_dot": 2.0,
        "y_dot": 0,
        "z_dot": 0,
        **attitude,
        **rates,
    }
    run = model.simulate(
        (0, 1.2), start, {"m": 0.17, "r": r, "mu": mu, "g": g}, rtol=1e-10
    )
    slip = np.hypot(2.0 - r * -20.0, r * side)
    print(
        f"rolls from t = {run.phases[1].t0:.9f} s, Euler:"
        f" {2 * slip / (7 * mu * g):.9f} s"
    )
    runs.append(run)

# %%
_, panel = plt.subplots()
for run in runs:
    fine = run(np.linspace(0, 1.2, 200))
    panel.plot(fine["x"], fine["y"])
    begins = run(np.array([run.phases[1].t0]))
    panel.plot(begins["x"], begins["y"], "ko", ms=4)
panel.set(
    xlabel="x [m]", ylabel="y [m]", title="dots: the ball begins to roll"
)
