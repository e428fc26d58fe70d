"""
When does a top precess steadily, and when does it nod?
=======================================================

A symmetric top with a fixed point. Released at rest, its axis nods in cusps;
with the right precession rate it does not nod. The rate solves A cos(theta)
w^2 - C n w + m g h = 0.
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

psi, theta, phi = dynamicsymbols("psi theta phi")
m, h, A, C, g = symbols("m h A C g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
N1 = N.orientnew("N1", "Axis", (psi, N.z))
N2 = N1.orientnew("N2", "Axis", (theta, N1.x))
T = N2.orientnew("T", "Axis", (phi, N2.z))
G = O.locatenew("G", h * N2.z)
scene = da.Scene("top", frame=N, origin=O, coordinates=[psi, theta, phi])
scene.add_bodies(
    RigidBody("top", G, T, m, (inertia(T, A - m * h**2, A - m * h**2, C), G))
)
scene.apply_uniform_gravity(-g * N.z)
scene.add_shapes(
    {
        "top": da.Disk(radius=h / 2, axis=T.z),
        "axis": da.Rod(O, G),
        "floor": da.Ground(normal=N.z),
    }
)
scene.add_shapes({"track": da.Path(G)})
model = da.compile_model(scene)

# %%
values = {m: 1, h: 0.1, A: 0.015, C: 0.01, g: 9.81}
tilt, n = 0.6, 60.0  # angle of the axis, spin about it
slow = min(np.roots([0.015 * np.cos(tilt), -0.01 * n, 0.981]).real)
runs = {}
for label, rate in (
    ("released at rest", 0.0),
    ("steady precession", slow),
    ("pushed back", -slow),
):
    start = {
        psi: 0,
        theta: tilt,
        phi: 0,
        psi.diff(): rate,
        theta.diff(): 0,
        phi.diff(): n - rate * np.cos(tilt),
    }
    runs[label] = model.simulate((0, 4), start, values, rtol=1e-11)
nods = np.ptp(runs["steady precession"]["theta"])
print(f"the axis of the steady precession moves by {nods:.1e} rad")

# %%
# The path of the axis on the unit sphere, seen from above.

_, panel = plt.subplots()
for label, run in runs.items():
    fine = run(np.linspace(0, 4, 2000))
    panel.plot(
        np.sin(fine["theta"]) * np.sin(fine["psi"]),
        -np.sin(fine["theta"]) * np.cos(fine["psi"]),
        label=label,
    )
panel.set(aspect="equal", xlim=(-0.6, 1.8))
panel.set_axis_off()
panel.legend()

# %%
# The top that is released at rest, at half its speed.

# sphinx_gallery_thumbnail_number = -1
runs["released at rest"](np.linspace(0, 2, 200)).animate(fps=25, speed=0.5)
