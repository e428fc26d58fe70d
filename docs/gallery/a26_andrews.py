"""
How does a mechanism with three closed loops move within 30 milliseconds?
=========================================================================

Andrews' squeezing mechanism, a benchmark of solvers: seven bodies, three loops
through one pin, a spring and a motor. The result is compared with the values
of the Test Set for IVP Solvers, which are good to nine digits.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import sqrt, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# Lengths in metres, masses in kilograms, moments of inertia in kg m^2.

lengths = {
    "d": 0.028,
    "d_a": 0.0115,
    "e": 0.02,
    "e_a": 0.01421,
    "rr": 0.007,
    "ra": 0.00092,
    "l_0": 0.07785,
}
lengths |= {
    "ss": 0.035,
    "sa": 0.01874,
    "sb": 0.01043,
    "sc": 0.018,
    "sd": 0.02,
    "ta": 0.02308,
    "tb": 0.00916,
}
lengths |= {
    "u": 0.04,
    "ua": 0.01228,
    "ub": 0.00449,
    "zf": 0.02,
    "zt": 0.04,
    "fa": 0.01421,
}
masses = (0.04325, 0.00365, 0.02373, 0.00706, 0.0705, 0.00706, 0.05498)
moments = (2.194e-6, 4.41e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
values = {**lengths, "c_0": 4530.0, "mom": 0.033}
values |= {f"m{i + 1}": m for i, m in enumerate(masses)} | {
    f"I{i + 1}": I for i, I in enumerate(moments)
}
p = {name: symbols(name, positive=True) for name in values}

names = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")
be, th, ga, ph, de, om, ep = q = dynamicsymbols(" ".join(names))
N, O = ReferenceFrame("N"), Point("O")
A = O.locatenew("A", -0.06934 * N.x - 0.00227 * N.y)
B = O.locatenew("B", -0.03635 * N.x + 0.03273 * N.y)
C = O.locatenew("C", 0.014 * N.x + 0.072 * N.y)
K = [
    N.orientnew(f"K{i + 1}", "Axis", (a, N.z))
    for i, a in enumerate((be, be + th, ga, ph + de, de, om + ep, ep))
]
pin, knee, elbow = (
    O.locatenew("pin", p["rr"] * K[0].x),
    A.locatenew("knee", p["zt"] * K[4].x),
    A.locatenew("elbow", -p["u"] * K[6].y),
)
centres = [
    O.locatenew("G1", p["ra"] * K[0].x),
    pin.locatenew("G2", -p["d_a"] * K[1].x),
    B.locatenew("G3", p["sa"] * K[2].x - p["sb"] * K[2].y),
    knee.locatenew("G4", -(p["e"] - p["e_a"]) * K[3].y),
    A.locatenew("G5", p["ta"] * K[4].x - p["tb"] * K[4].y),
    elbow.locatenew("G6", (p["zf"] - p["fa"]) * K[5].x),
    A.locatenew("G7", p["ua"] * K[6].x - p["ub"] * K[6].y),
]
scene = da.Scene("andrews", frame=N, origin=O, coordinates=q)
for i, (G, frame) in enumerate(zip(centres, K, strict=True)):
    scene.add_bodies(
        RigidBody(
            f"K{i + 1}",
            G,
            frame,
            p[f"m{i + 1}"],
            (inertia(frame, 0, 0, p[f"I{i + 1}"]), G),
        )
    )

# %%
# The three loops close at P.

P = pin.locatenew("P", -p["d"] * K[1].x)
ends = (
    B.locatenew("P3", -p["ss"] * K[2].y),
    knee.locatenew("P4", -p["e"] * K[3].y),
    elbow.locatenew("P6", p["zf"] * K[5].x),
)
for end in ends:
    gap = P.pos_from(end)
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
D = B.locatenew("D", p["sd"] * K[2].x - p["sc"] * K[2].y)
pull = D.pos_from(C)
length = sqrt(pull.dot(N.x) ** 2 + pull.dot(N.y) ** 2)
scene.add_loads(
    (D, -p["c_0"] * (length - p["l_0"]) / length * pull),
    (K[0], p["mom"] * N.z),
)
triangle = [(B, ends[0]), (B, D), (D, ends[0])]
bars = [[(O, pin)], [(pin, P)], triangle, [(knee, ends[1])], [(A, knee)]]
bars += [[(elbow, ends[2])], [(A, elbow)]]
for i, lines in enumerate(bars):
    scene.add_shapes({f"K{i + 1}": [da.Rod(*line) for line in lines]})
scene.add_shapes({"spring": da.Spring(C, D), "track": da.Path(P)})
model = da.compile_model(scene)

# %%
# The initial angles are given to a few digits; `assemble` closes the loops.

guess = dict(
    zip(
        names,
        (-0.0617, 0.0, 0.4553, 0.2227, 0.4874, -0.2227, 1.2305),
        strict=True,
    )
)
start = model.assemble(guess, values, fixed=["Theta"])
run = model.simulate(
    (0, 0.03), {**start, "Theta_dot": 0.0}, values, rtol=1e-11, atol=1e-11
)
published = {
    "beta": 15.81077119629904,
    "Theta": -15.75637105984298,
    "gamma": 0.04082224013073101,
}
for name, value in published.items():
    print(f"{name} at 0.03 s: {run[name][-1]:.9f}, reference {value:.9f}")

# %%
fine = run(np.linspace(0, 0.03, 800))
_, left = plt.subplots()
left.plot(1e3 * fine.t, fine["beta"])
left.set(xlabel="t [ms]", ylabel="angle of the motor [rad]")
_, right = plt.subplots()
for name in ("gamma", "delta", "epsilon"):
    right.plot(1e3 * fine.t, fine[name], label=name)
right.set(xlabel="t [ms]", ylabel="angle [rad]")
right.legend()

# %%
# The motion, two hundred times slower.

# sphinx_gallery_thumbnail_number = -1
run.animate(fps=20, speed=0.005)
