"""
Why does a rattleback reverse its spin?
=======================================

An ellipsoid rolls on a table. Its principal axes of inertia are turned a
little against its axes of shape. Spun in one direction it begins to rattle,
stops, and turns the other way.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial import ConvexHull
from sympy import sqrt, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

x, y = dynamicsymbols("x y")
m, a, b, c, h, A, B, C, delta, g = symbols(
    "m a b c h A B C delta g", positive=True
)
N, O, S = (
    ReferenceFrame("N"),
    Point("O"),
    ReferenceFrame("S"),
)  # S: axes of the shape
scene = da.Scene("rattleback", frame=N, origin=O, coordinates=[x, y])
e = da.free_orientation(scene, S)
n = [N.z.dot(axis) for axis in S]  # vertical in the body
size = sqrt((a * n[0]) ** 2 + (b * n[1]) ** 2 + (c * n[2]) ** 2)
to_contact = (
    -(a**2 * n[0] * S.x + b**2 * n[1] * S.y + c**2 * n[2] * S.z) / size
)  # from the centre of the ellipsoid
centre = O.locatenew("centre", x * N.x + y * N.y + size * N.z)
G = centre.locatenew("G", -h * S.z)
I = S.orientnew("I", "Axis", (delta, S.z))  # principal axes of inertia
scene.add_bodies(RigidBody("rattleback", G, S, m, (inertia(I, A, B, C), G)))
scene.apply_uniform_gravity(-g * N.z)
slip = centre.pos_from(O).dt(N) + S.ang_vel_in(N).cross(to_contact)
scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
spin_rate = S.ang_vel_in(N).dot(S.z)
i = np.arange(200) + 0.5  # points of a spiral on the ellipsoid
z, turn = 1 - i / 100, np.pi * (1 + np.sqrt(5)) * i
round_z = np.sqrt(1 - z**2)
points = np.stack([round_z * np.cos(turn), round_z * np.sin(turn), z], axis=1)
surface = points * (0.2, 0.03, 0.02), ConvexHull(points).simplices
scene.add_shapes({"rattleback": da.Mesh(surface, at=centre)})
scene.add_shapes({"table": da.Ground(N.z)})
model = da.compile_model(scene, outputs={"spin": spin_rate})

# %%
# Semi-axes and moments of inertia are those of Kane and Levinson (1982). The
# body starts with a tilt of half a degree.

values = {
    m: 1,
    a: 0.2,
    b: 0.03,
    c: 0.02,
    h: 0.01,
    A: 2e-4,
    B: 1.6e-3,
    C: 1.7e-3,
    delta: 0.0143,
    g: 9.81,
}
tilted = {
    e[0]: np.cos(0.005),
    e[1]: np.sin(0.005),
    e[2]: 0,
    e[3]: 0,
    x: 0,
    y: 0,
}
runs = {}
for spin in (-5.0, 5.0):
    start = {**tilted, "omega_S_x": 0, "omega_S_y": 0, "omega_S_z": spin}
    runs[spin] = model.simulate((0, 20), start, values, rtol=1e-10)
    run = runs[spin]
    print(
        f"spin {spin:+.0f} rad/s at the start, {run['spin'][-1]:+.2f}"
        " rad/s after 20 s;",
        end=" ",
    )
    print(
        "energy kept to"
        f" {np.ptp(run['energy']) / np.ptp(run['kinetic_energy']):.0e}"
    )

# %%
_, panel = plt.subplots()
for spin, run in runs.items():
    panel.plot(
        run.t,
        run["spin"],
        lw=0.8,
        label=f"started with {spin:+.0f} rad/s",
    )
panel.set(xlabel="t [s]", ylabel="spin [rad/s]")
panel.legend()
