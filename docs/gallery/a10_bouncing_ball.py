"""
How long does a ball bounce?
============================

A ball with restitution 0.8 bounces infinitely often in a finite time. The run
passes that time: the contact then rests, and the ball stays on the floor.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

x, y = dynamicsymbols("x y")
m, g, e = symbols("m g e", positive=True)
N, O = ReferenceFrame("N"), Point("O")
B = O.locatenew("B", x * N.x + y * N.y)
scene = da.Scene("ball", frame=N, origin=O, coordinates=[x, y])
scene.add_bodies(Particle("ball", B, m))
scene.apply_uniform_gravity(-g * N.y)
R = da.unknowns("R")
scene.add_joints(da.Joint("floor", body="ball", at=B, force=R * N.y))
scene.add_contacts(
    da.UnilateralContact(normal=R, gap=y, restitution=e, name="floor")
)
scene.add_shapes({"ball": da.Sphere(0.05), "floor": da.Ground(N.y)})
model = da.compile_model(scene)

# %%
run = model.simulate(
    (0, 6),
    {x: 0, y: 1, x.diff(): 0.5, y.diff(): 0},
    {m: 1, g: 9.81, e: 0.8},
    rtol=1e-10,
)
rest = run.phases[-1].t0
exact = np.sqrt(2 / 9.81) * (1 + 2 * 0.8 / (1 - 0.8))
print(
    f"{run.status.name}; {len(run.phases)} phases; at rest from t ="
    f" {rest:.6f} s (geometric series: {exact:.6f} s)"
)

# %%
fine = run(np.linspace(0, 6, 3000))
_, panel = plt.subplots()
panel.plot(fine["x"], fine["y"])
panel.set(xlabel="x [m]", ylabel="y [m]")
