"""
Which path does a rolling coin take?
====================================

A thin disc rolls on a plane without slip. The two velocity constraints are
nonholonomic. The energy is kept, the contact point draws loops and cusps.
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

x, y, heading, lean, spin = dynamicsymbols("x y heading lean spin")
m, r, g = symbols("m r g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
H = N.orientnew("H", "Axis", (heading, N.z))
L = H.orientnew("L", "Axis", (lean, H.x))
D = L.orientnew("D", "Axis", (spin, L.y))
P = O.locatenew("P", x * N.x + y * N.y)  # contact point
G = P.locatenew("G", r * L.z)  # centre

scene = da.Scene(
    "coin", frame=N, origin=O, coordinates=[x, y, heading, lean, spin]
)
scene.add_bodies(
    RigidBody(
        "coin",
        G,
        D,
        m,
        (inertia(D, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4), G),
    )
)
scene.apply_uniform_gravity(-g * N.z)
touching = G.pos_from(O).dt(N) + D.ang_vel_in(N).cross(
    -r * L.z
)  # velocity of the coin's material point at P
scene.add_nonholonomic_constraints(touching.dot(N.x), touching.dot(N.y))
scene.add_shapes(
    {
        "coin": da.Disk(radius=r, axis=D.y),
        "floor": da.Ground(normal=N.z),
        "track": da.Path(P),
    }
)
model = da.compile_model(scene)

# %%
# The rates of x and y follow from the constraints.

start = {
    x: 0,
    y: 0,
    heading: 0,
    lean: 0.3,
    spin: 0,
    heading.diff(): 0.8,
    lean.diff(): 0,
    spin.diff(): 4.0,
}
run = model.simulate((0, 12), start, {m: 0.1, r: 0.2, g: 9.81}, rtol=1e-11)
print(
    "relative drift of the energy:"
    f" {np.ptp(run['energy']) / run['energy'][0]:.1e}"
)
print(
    f"largest slip velocity: {np.abs(run.constraint_violation).max():.1e} m/s"
)

# %%
fine = run(np.linspace(0, 12, 3000))
_, left = plt.subplots()
left.plot(fine["x"], fine["y"], lw=1)
left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
_, right = plt.subplots()
right.plot(fine.t, np.degrees(fine["lean"]))
right.set(xlabel="t [s]", ylabel="lean [degrees]")

# %%
# The motion, to play and to turn.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, 6), start, {m: 0.1, r: 0.2, g: 9.81}).animate(fps=20)
