"""
Which forces act in the joints of a slider-crank?
=================================================

A closed loop: crank, connecting rod and piston. A constant torque drives the
crank against a damper at the piston. The pin between rod and piston is a joint
between two bodies, with unknown reactions that are outputs.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

alpha, beta, s = dynamicsymbols("alpha beta s")
m_c, m_r, m_p, l_c, l_r, M, c = symbols(
    "m_c m_r m_p l_c l_r M c", positive=True
)
N, O = ReferenceFrame("N"), Point("O")
A, B = (
    N.orientnew("A", "Axis", (alpha, N.z)),
    N.orientnew("B", "Axis", (beta, N.z)),
)
crank_pin = O.locatenew("crank_pin", l_c * A.x)
rod_end = crank_pin.locatenew("rod_end", l_r * B.x)
piston = O.locatenew("piston", s * N.x)
G_c, G_r = (
    O.locatenew("G_c", l_c / 2 * A.x),
    crank_pin.locatenew("G_r", l_r / 2 * B.x),
)
scene = da.Scene(
    "slider_crank", frame=N, origin=O, coordinates=[alpha, beta, s]
)
scene.add_bodies(
    RigidBody(
        "crank", G_c, A, m_c, (inertia(A, 0, 0, m_c * l_c**2 / 12), G_c)
    ),
    RigidBody("rod", G_r, B, m_r, (inertia(B, 0, 0, m_r * l_r**2 / 12), G_r)),
    Particle("piston", piston, m_p),
)
scene.add_loads((A, M * N.z), (piston, -c * s.diff() * N.x))

# %%
# The loop is closed at the pin between rod and piston; its reaction holds the
# two constraints.

loop = rod_end.pos_from(piston)
scene.add_holonomic_constraints(loop.dot(N.x), loop.dot(N.y))
P_x, P_y = da.unknowns("P_x P_y")
scene.add_joints(
    da.Joint(
        "piston_pin",
        body="rod",
        other="piston",
        at=rod_end,
        force=P_x * N.x + P_y * N.y,
    )
)
links = {"crank": da.Rod(O, crank_pin), "rod": da.Rod(crank_pin, rod_end)}
slider = da.Disk(radius=l_c / 4, axis=N.z)
scene.add_shapes({**links, "piston": slider, "curve": da.Path(G_r)})
model = da.compile_model(scene, outputs=["P_x", "P_y"])

# %%
# The initial angles need not close the loop: `assemble` solves for what is not
# fixed.

values = {m_c: 1.0, m_r: 0.5, m_p: 0.8, l_c: 0.1, l_r: 0.3, M: 2.0, c: 20.0}
start = model.assemble({alpha: 0.3, beta: -0.1, s: 0.4}, values, fixed=[alpha])
run = model.simulate((0, 3), {**start, alpha.diff(): 5.0}, values, rtol=1e-10)
print(
    "the loop stays closed within"
    f" {np.abs(run.constraint_violation).max():.1e}"
)

# %%
fine = run(np.linspace(2, 3, 2000))
_, left = plt.subplots()
left.plot(run.t, run["alpha_dot"])
left.set(xlabel="t [s]", ylabel="crank speed [rad/s]")
_, right = plt.subplots()
right.plot(fine["P_x"], fine["P_y"])
right.set(
    xlabel="P_x [N]", ylabel="P_y [N]", title="force on the rod at the piston"
)

# %%
# The motion, with the force on the rod as an arrow.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, 2), {**start, alpha.diff(): 5.0}, values).animate(
    fps=30, speed=0.5, reactions=True
)
