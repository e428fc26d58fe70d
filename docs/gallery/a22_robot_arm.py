"""
Which torques let a robot arm follow a path?
============================================

A planar arm with three links follows a circle with its hand: the path is a
pair of constraints, the torques that keep them are unknown reactions, solved
for together with the motion. The third link is free to settle with a damper.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import cos, sin, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

a, b, c, t = *dynamicsymbols("a b c"), dynamicsymbols._t
m, l, g, d, w, R = symbols("m l g d w R", positive=True)
N, O = ReferenceFrame("N"), Point("O")
frames = [
    N.orientnew(f"F{i}", "Axis", (q, N.z)) for i, q in enumerate((a, b, c))
]
scene = da.Scene("arm", frame=N, origin=O, coordinates=[a, b, c])
point, previous = O, N
for i, F in enumerate(frames):
    G = point.locatenew(f"G{i}", l / 2 * F.x)
    scene.add_bodies(
        RigidBody(f"link{i}", G, F, m, (inertia(F, 0, 0, m * l**2 / 12), G))
    )
    point = point.locatenew(f"P{i}", l * F.x)
    if i == 1:
        hand_base = point
scene.apply_uniform_gravity(-g * N.y)
scene.add_loads(
    (frames[2], -d * (c.diff() - b.diff()) * N.z),
    (frames[1], d * (c.diff() - b.diff()) * N.z),
)
T_1, T_2 = da.unknowns("T_1 T_2")  # motors at the shoulder and at the elbow
scene.add_joints(
    da.Joint("shoulder", body="link0", at=O, torque=(T_1 - T_2) * N.z),
    da.Joint("elbow", body="link1", at=O, torque=T_2 * N.z),
)
path = (1.2 + R * cos(w * t)) * N.x + (0.2 + R * sin(w * t)) * N.y
off = hand_base.pos_from(O) - path
scene.add_holonomic_constraints(off.dot(N.x), off.dot(N.y))
model = da.compile_model(scene, outputs=["T_1", "T_2", hand_base])

# %%
values = {m: 2.0, l: 1.0, g: 9.81, d: 3.0, w: 2.0, R: 0.3}
start = model.assemble({a: -0.6, b: 0.9, c: -1.5}, values, fixed=[c])
run = model.simulate((0, 10), {**start, c.diff(): 0.0}, values, rtol=1e-9)
print(
    "the elbow's end leaves its path by"
    f" {np.abs(run.constraint_violation[:, :2]).max():.1e} m"
)

# %%
fine = run(np.linspace(0, 10, 1500))
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
for k in range(1000, 1500, 45):
    x = np.cumsum([0, *np.cos([fine[n][k] for n in "abc"])])
    y = np.cumsum([0, *np.sin([fine[n][k] for n in "abc"])])
    left.plot(x, y, "o-", color="C0", alpha=0.3, ms=3)
left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
_, right = plt.subplots()
right.plot(fine.t, fine["T_1"], label="T_1")
right.plot(fine.t, fine["T_2"], label="T_2")
right.set(xlabel="t [s]", ylabel="motor torque [N m]")
right.legend()
