"""
At which speeds does a bicycle stay upright by itself?
======================================================

The Whipple bicycle: four bodies, two rolling wheels, six constraints. Its
linear model about upright motion is taken at many speeds. Between about 4.3
and 6.0 m/s all eigenvalues have a negative real part: the bicycle is stable
without a rider who steers.
"""

from math import pi

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
# Parameters of the benchmark bicycle (Meijaard, Papadopoulos, Ruina and
# Schwab, 2007), in metres and kilograms.

values = {
    "w": 1.02,
    "c": 0.08,
    "lam": pi / 10,
    "g": 9.81,
    "rR": 0.3,
    "mR": 2,
    "IRxx": 0.0603,
    "IRyy": 0.12,
}
values |= {
    "xB": 0.3,
    "zB": -0.9,
    "mB": 85,
    "IBxx": 9.2,
    "IByy": 11,
    "IBzz": 2.8,
    "IBxz": 2.4,
}
values |= {
    "xH": 0.9,
    "zH": -0.7,
    "mH": 4,
    "IHxx": 0.05892,
    "IHyy": 0.06,
    "IHzz": 0.00708,
    "IHxz": -0.00756,
}
values |= {"rF": 0.35, "mF": 3, "IFxx": 0.1405, "IFyy": 0.28}
p = {name: symbols(name, real=True) for name in values}

# %%
# The rear frame is turned by yaw, lean and pitch, the front frame by the
# steering angle about a tilted axis.

names = ("x", "y", "z", "yaw", "lean", "pitch", "steer", "rear", "front")
x, y, z, yaw, lean, pitch, steer, rear, front = q = dynamicsymbols(
    " ".join(names)
)
N, O = ReferenceFrame("N"), Point("O")  # z upwards
Y = N.orientnew("Y", "Axis", (yaw, N.z))
L = Y.orientnew("L", "Axis", (lean, Y.x))
B = L.orientnew("B", "Axis", (pitch, L.y))  # x forward, y left, z up
T = B.orientnew("T", "Axis", (-p["lam"], B.y))
S = T.orientnew("S", "Axis", (steer, T.z))
F = S.orientnew("F", "Axis", (p["lam"], S.y))
R_hub = O.locatenew("R_hub", x * N.x + y * N.y + z * N.z)
foot = R_hub.locatenew(
    "foot", (p["w"] + p["c"]) * B.x - p["rR"] * B.z
)  # where the steering axis meets the ground
F_hub = foot.locatenew("F_hub", -p["c"] * F.x + p["rF"] * F.z)
G_B = R_hub.locatenew("G_B", p["xB"] * B.x - (p["zB"] + p["rR"]) * B.z)
G_H = foot.locatenew("G_H", (p["xH"] - p["w"] - p["c"]) * F.x - p["zH"] * F.z)
W_R, W_F = (
    B.orientnew("W_R", "Axis", (rear, B.y)),
    F.orientnew("W_F", "Axis", (front, F.y)),
)
scene = da.Scene("bicycle", frame=N, origin=O, coordinates=q)
scene.add_bodies(
    RigidBody(
        "rear_wheel",
        R_hub,
        W_R,
        p["mR"],
        (inertia(W_R, p["IRxx"], p["IRyy"], p["IRxx"]), R_hub),
    ),
    RigidBody(
        "rider",
        G_B,
        B,
        p["mB"],
        (inertia(B, p["IBxx"], p["IByy"], p["IBzz"], 0, 0, -p["IBxz"]), G_B),
    ),
    RigidBody(
        "fork",
        G_H,
        F,
        p["mH"],
        (inertia(F, p["IHxx"], p["IHyy"], p["IHzz"], 0, 0, -p["IHxz"]), G_H),
    ),
    RigidBody(
        "front_wheel",
        F_hub,
        W_F,
        p["mF"],
        (inertia(W_F, p["IFxx"], p["IFyy"], p["IFxx"]), F_hub),
    ),
)
scene.apply_uniform_gravity(-p["g"] * N.z)
for hub, wheel, axle, radius in (
    (R_hub, W_R, B.y, p["rR"]),
    (F_hub, W_F, F.y, p["rF"]),
):
    down = -(N.z - N.z.dot(axle) * axle) / sqrt(
        1 - N.z.dot(axle) ** 2
    )  # from the hub to the contact point
    scene.add_holonomic_constraints(
        hub.pos_from(O).dot(N.z) + radius * down.dot(N.z)
    )
    slip = hub.pos_from(O).dt(N) + wheel.ang_vel_in(N).cross(radius * down)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
wheels = {
    "rear_wheel": da.Disk(radius=p["rR"], axis=B.y),
    "front_wheel": da.Disk(radius=p["rF"], axis=F.y),
}
rider = [da.Rod(R_hub, G_B), da.Rod(G_B, G_H)]
scene.add_shapes({**wheels, "rider": rider, "fork": da.Rod(G_H, F_hub)})
scene.add_shapes({"road": da.Ground(normal=N.z), "track": da.Path(G_B)})
model = da.compile_model(scene)

# %%
# At each speed: the four eigenvalues of lean and steer.


def eigenvalues(speed):
    """Return the eigenvalues of lean and steer about upright motion."""
    upright = dict.fromkeys(names, 0.0) | {
        "z": 0.3,
        "lean_dot": 0.0,
        "steer_dot": 0.0,
        "rear_dot": speed / 0.3,
    }
    states = [
        "x",
        "y",
        "yaw",
        "lean",
        "steer",
        "rear",
        "front",
        "lean_dot",
        "steer_dot",
        "rear_dot",
    ]
    linear = model.linearize(0.0, upright, values, states=states)
    return np.linalg.eigvals(
        linear.block("lean", "steer", "lean_dot", "steer_dot")
    )


speeds = np.linspace(0.5, 8, 31)
found = np.array([np.sort_complex(eigenvalues(v)) for v in speeds])
print(
    "published weave speed 4.2924 m/s: largest real part"
    f" {eigenvalues(4.292382536341).real.max():.1e} 1/s"
)

# %%
_, panel = plt.subplots()
panel.plot(speeds, found.real, "k.", ms=3)
panel.plot(
    speeds,
    np.where(found.imag > 0, found.imag, np.nan),
    ".",
    color="0.7",
    ms=3,
)
stable = speeds[found.real.max(axis=1) < 0]
panel.axvspan(stable[0], stable[-1], color="C2", alpha=0.2)
panel.set(
    xlabel="speed [m/s]",
    ylabel="eigenvalues [1/s]",
    ylim=(-10, 10),
    title="black: real parts, grey: imaginary parts",
)

# %%
# The full nonholonomic model in the stable range: pushed, the bicycle turns
# aside, weaves and comes upright again. The picture shows the first 0.6 s.

# sphinx_gallery_thumbnail_number = -1
start = dict.fromkeys(names, 0.0) | {
    "z": 0.3,
    "lean_dot": 0.5,
    "steer_dot": 0.0,
    "rear_dot": 4.6 / 0.3,
}
pushed = model.simulate((0, 4), start, values)
leans = np.degrees(pushed["lean"])
print(
    f"lean: at most {abs(leans).max():.1f} degrees, {leans[-1]:.2f} at the end"
)
pushed(np.linspace(0, 0.6, 100)).animate(fps=20, speed=0.15)
