"""
Which curve does a point of a coupler draw?
===========================================

A four-bar linkage: the crank turns at a prescribed angle, a function of time;
two loop equations determine the other two angles. The motion is kinematics
alone: no degree of freedom is left.
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

beta, gamma, t = *dynamicsymbols("beta gamma"), dynamicsymbols._t
l_1, l_2, l_3, d, p, q, w, m = symbols("l_1 l_2 l_3 d p q w m", positive=True)
N, O = ReferenceFrame("N"), Point("O")
K = N.orientnew("K", "Axis", (w * t, N.z))  # crank
B = N.orientnew("B", "Axis", (beta, N.z))  # coupler
C = N.orientnew("C", "Axis", (gamma, N.z))  # rocker
crank_pin = O.locatenew("crank_pin", l_1 * K.x)
rocker_pin = O.locatenew("rocker_pin", d * N.x + l_3 * C.x)
loop = crank_pin.pos_from(O) + l_2 * B.x - rocker_pin.pos_from(O)
traced = crank_pin.locatenew("traced", p * B.x + q * B.y)
scene = da.Scene("four_bar", frame=N, origin=O, coordinates=[beta, gamma])
scene.add_bodies(
    Particle("traced", traced, m), Particle("rocker", rocker_pin, m)
)
scene.add_holonomic_constraints(loop.dot(N.x), loop.dot(N.y))
fixed_pin = O.locatenew("fixed_pin", d * N.x)
bars = [
    da.Rod(O, crank_pin),
    da.Rod(crank_pin, rocker_pin),
    da.Rod(rocker_pin, fixed_pin),
    da.Rod(crank_pin, traced),
]
scene.add_shapes({"bars": bars, "curve": da.Path(traced)})
model = da.compile_model(scene, outputs=[traced])

# %%
_, panel = plt.subplots()
for offset in (0.2, 0.6, 1.0):
    values = {
        l_1: 0.5,
        l_2: 1.5,
        l_3: 1.2,
        d: 1.4,
        p: 0.8,
        q: offset,
        w: 2 * np.pi,
        m: 1,
    }
    start = model.assemble({beta: 0.9, gamma: 1.8}, values)
    run = model.simulate(
        (0, 1), start, values, t_eval=np.linspace(0, 1, 400), rtol=1e-10
    )
    panel.plot(run["traced_x"], run["traced_y"], label=f"q = {offset}")
    print(
        f"q = {offset}: the curve closes within"
        f" {abs(run['traced_x'][-1] - run['traced_x'][0]):.1e} m"
    )
panel.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
panel.legend()

# %%
# The linkage with the last of the points.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, 2), start, values).animate(fps=20, speed=0.5)
