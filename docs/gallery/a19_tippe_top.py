"""
Why does a tippe top turn upside down?
======================================

A ball whose mass centre lies below its centre spins fast on a table. Friction
at the sliding contact turns it over and lifts its mass centre. The friction
law is smooth here (`regularization=`), so that the model is an ordinary one.
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

x, y, z = dynamicsymbols("x y z")
m, r, a, A, C, g, mu, eps = symbols("m r a A C g mu eps", positive=True)
N, O, T = ReferenceFrame("N"), Point("O"), ReferenceFrame("T")
scene = da.Scene("tippe_top", frame=N, origin=O, coordinates=[x, y, z])
e = da.free_orientation(scene, T)
centre = O.locatenew("centre", x * N.x + y * N.y + z * N.z)
G = centre.locatenew("G", -a * T.z)  # mass centre
P = centre.locatenew("P", -r * N.z)  # contact point
scene.add_bodies(RigidBody("top", G, T, m, (inertia(T, A, A, C), G)))
scene.apply_uniform_gravity(-g * N.z)
R, F_x, F_y = da.unknowns("R F_x F_y")
scene.add_joints(
    da.Joint("table", body="top", at=P, force=F_x * N.x + F_y * N.y + R * N.z)
)
scene.add_holonomic_constraints(z - r)
scene.add_friction(
    da.CoulombFriction(R, (F_x, F_y), mu=mu, regularization=eps, name="table")
)
scene.add_shapes(
    {
        "top": [
            da.Sphere(radius=r, at=centre),
            da.Cylinder(radius=r / 4, length=3 * r, axis=T.z, at=centre),
        ]
    }
)
scene.add_shapes({"table": da.Ground(normal=N.z)})
model = da.compile_model(scene, outputs=[G, T.z.dot(N.z)])

# %%
radius = 0.02
values = {
    m: 0.006,
    r: radius,
    a: 0.15 * radius,
    A: 7.2e-7,
    C: 8.0e-7,
    g: 9.81,
    mu: 0.3,
    eps: 0.01,
}
start = {x: 0, y: 0, z: radius, x.diff(): 0, y.diff(): 0, z.diff(): 0}
start |= {
    e[0]: np.cos(0.05),
    e[1]: np.sin(0.05),
    e[2]: 0,
    e[3]: 0,
    "omega_T_x": 0,
    "omega_T_y": 0,
    "omega_T_z": 155.0,
}
run = model.simulate((0, 8), start, values, rtol=1e-8)
axis = str(T.z.dot(N.z))
tilt = np.degrees(np.arccos(np.clip(run[axis], -1, 1)))
print(
    f"{run.status.name}: the axis tilts from {tilt[0]:.0f} to {tilt[-1]:.0f}"
    " degrees"
)

# %%
_, left = plt.subplots()
left.plot(run.t, tilt)
left.set(xlabel="t [s]", ylabel="tilt [degrees]")
_, right = plt.subplots()
right.plot(run.t, 1e3 * run["G_z"])
right.set(xlabel="t [s]", ylabel="height of G [mm]")

# %%
# The top turns over, at half its speed.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, 4), start, values, rtol=1e-6).animate(fps=20, speed=0.5)
