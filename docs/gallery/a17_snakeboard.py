"""
How does a snakeboard move without being pushed?
================================================

A snakeboard: a board with two steered wheel axles and a rotor that the rider
swings. Rotor and axles move as given functions of time. No external force
drives it; the wheels do not slip sideways. Momentum builds up from the product
of both motions.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import sin, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

x, y, theta, t = *dynamicsymbols("x y theta"), dynamicsymbols._t
m, J, J_r, L, A, B, w = symbols("m J J_r L A B w", positive=True)
rotor_angle, axle_angle = A * sin(w * t), B * sin(w * t)
N, O = ReferenceFrame("N"), Point("O")
F = N.orientnew("F", "Axis", (theta, N.z))  # board
R = F.orientnew("R", "Axis", (rotor_angle, F.z))  # rotor
front = F.orientnew("front", "Axis", (-axle_angle, F.z))
rear = F.orientnew("rear", "Axis", (axle_angle, F.z))
G = O.locatenew("G", x * N.x + y * N.y)
P, Q = G.locatenew("P", L * F.x), G.locatenew("Q", -L * F.x)
scene = da.Scene("snakeboard", frame=N, origin=O, coordinates=[x, y, theta])
scene.add_bodies(
    RigidBody("board", G, F, m, (inertia(F, 0, 0, J), G)),
    RigidBody("rotor", G, R, 0, (inertia(R, 0, 0, J_r), G)),
)
scene.add_nonholonomic_constraints(
    P.pos_from(O).dt(N).dot(front.y), Q.pos_from(O).dt(N).dot(rear.y)
)
board = [
    da.Rod(P, Q),
    *(
        da.Rod(
            C.locatenew("a", L / 3 * axle.y), C.locatenew("b", -L / 3 * axle.y)
        )
        for C, axle in ((P, front), (Q, rear))
    ),
]
scene.add_shapes(
    {
        "board and axles": board,
        "rotor": da.Box(x=L / 4, y=L, z=L / 10),
        "track": da.Path(G),
    }
)
model = da.compile_model(scene)

# %%
start = {x: 0, y: 0, theta: 0}
values = {m: 6, J: 0.2, J_r: 0.1, L: 0.2, A: 0.7, B: 0.5, w: 4.0}
at_rest = {x.diff(): 0}  # the other velocities follow from the constraints
run = model.simulate((0, 20), {**start, **at_rest}, values, rtol=1e-9)
speed = np.hypot(run["x_dot"], run["y_dot"])
print(
    f"after 20 s: {np.hypot(run['x'][-1], run['y'][-1]):.2f} m away,"
    f" {speed[-1]:.2f} m/s"
)

# %%
fine = run(np.linspace(0, 20, 2000))
_, left = plt.subplots()
left.plot(fine["x"], fine["y"])
left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
_, right = plt.subplots()
right.plot(fine.t, np.hypot(fine["x_dot"], fine["y_dot"]))
right.set(xlabel="t [s]", ylabel="speed [m/s]")

# %%
# The first four seconds.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, 4), {**start, **at_rest}, values).animate(fps=20)
