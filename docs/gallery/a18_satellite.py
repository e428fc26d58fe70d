"""
How do reaction wheels turn a satellite?
========================================

A satellite with three wheels, free in space. Motors exert torques between
wheel and body; a control law turns the body by 120 degrees about a diagonal.
The attitude is a quaternion. The total angular momentum stays zero.
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

angles = dynamicsymbols("a_x a_y a_z")
J_x, J_y, J_z, J_w, k_p, k_d = symbols(
    "J_x J_y J_z J_w k_p k_d", positive=True
)
N, O, B = ReferenceFrame("N"), Point("O"), ReferenceFrame("B")
scene = da.Scene("satellite", frame=N, origin=O, coordinates=list(angles))
e = da.free_orientation(scene, B)
scene.add_bodies(RigidBody("body", O, B, 0, (inertia(B, J_x, J_y, J_z), O)))
omega = B.ang_vel_in(N)
for name, axis, angle, error in zip(
    "xyz", (B.x, B.y, B.z), angles, e[1:], strict=True
):
    W = B.orientnew(f"W_{name}", "Axis", (angle, axis))
    scene.add_bodies(
        RigidBody(
            f"wheel_{name}",
            O,
            W,
            0,
            (inertia(W, *(J_w if c == name else 0 for c in "xyz")), O),
        )
    )
    torque = (
        k_p * error + k_d * omega.dot(axis)
    ) * axis  # on the wheel; the body has the opposite
    scene.add_loads((W, torque), (B, -torque))
scene.add_shapes({"body": da.Box(1.2, 0.9, 0.6)})
model = da.compile_model(scene)

# %%
# The target attitude is the identity; the body starts 120 degrees away, at
# rest.

start = {
    e[0]: 0.5,
    e[1]: 0.5,
    e[2]: 0.5,
    e[3]: 0.5,
    "omega_B_x": 0,
    "omega_B_y": 0,
    "omega_B_z": 0,
}
start |= {angle: 0 for angle in angles} | {angle.diff(): 0 for angle in angles}
values = {J_x: 10, J_y: 14, J_z: 18, J_w: 0.05, k_p: 1.0, k_d: 4.0}
run = model.simulate((0, 60), start, values, rtol=1e-9)
names = [str(c.func) for c in e]
print("final attitude:", np.round([run[name][-1] for name in names], 6))

# %%
run = run(np.linspace(0, 60, 400))
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
for name in names:
    left.plot(run.t, run[name], label=name)
left.set(xlabel="t [s]", ylabel="quaternion")
left.legend()
_, right = plt.subplots()
for angle in angles:
    right.plot(run.t, run[angle.diff()])
right.set(xlabel="t [s]", ylabel="wheel speeds [rad/s]")
