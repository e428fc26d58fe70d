"""
Why does a ball on a turntable move in a circle?
================================================

A homogeneous ball rolls on a table that turns at a constant rate w. Its centre
moves on a circle at the rate 2/7 w, wherever it starts: like a charge in a
magnetic field.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

x, y = dynamicsymbols("x y")
m, r, w = symbols("m r w", positive=True)
N, O, T = ReferenceFrame("N"), Point("O"), ReferenceFrame("T")
scene = da.Scene("turntable", frame=N, origin=O, coordinates=[x, y])
e = da.free_orientation(scene, T)
G = O.locatenew("G", x * N.x + y * N.y + r * N.z)
I = 2 * m * r**2 / 5
scene.add_bodies(RigidBody("ball", G, T, m, (inertia(T, I, I, I), G)))
omega = T.ang_vel_in(N)
slip = (
    G.pos_from(O).dt(N)
    + omega.cross(-r * N.z)
    - (w * N.z).cross(x * N.x + y * N.y)
)
scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
scene.add_shapes({"ball": da.Sphere(r), "table": da.Ground(N.z)})
model = da.compile_model(scene)

# %%
# The angular velocity at the start follows from rolling.

x0, vy, rate = 0.3, 0.1, 7.0
values = {m: 1, r: 0.05, w: rate}
runs = []
for vx in (0.0, 0.3, 0.6):
    spin = {
        "omega_T_x": (rate * x0 - vy) / 0.05,
        "omega_T_y": vx / 0.05,
        "omega_T_z": 0,
    }
    start = {
        x: x0,
        y: 0,
        x.diff(): vx,
        y.diff(): vy,
        e[0]: 1,
        e[1]: 0,
        e[2]: 0,
        e[3]: 0,
        **spin,
    }
    runs.append(model.simulate((0, np.pi), start, values, rtol=1e-12))
closed = max(
    np.hypot(run["x"][-1] - run["x"][0], run["y"][-1] - run["y"][0])
    for run in runs
)
print(
    "after 2 pi / (2/7 w) = pi seconds each circle closes within"
    f" {closed:.1e} m"
)

# %%
_, panel = plt.subplots()
for run in runs:
    panel.plot(*run(np.linspace(0, np.pi, 300)).q.T[:2])
panel.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
