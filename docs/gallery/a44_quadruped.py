"""
How does a robot on four legs stand, trot and fall?
===================================================

Thirteen bodies: a trunk that moves freely and four legs of three joints. The
feet are points on a rough floor, with Coulomb's law and impacts, and none of
them is a spring. A controller sets the torques 500 times a second.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import Max, Min, cos, pi, sin, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

t = dynamicsymbols._t
place, e = dynamicsymbols("x y z"), dynamicsymbols("e0:4")
g, mu, stride, lift, push = symbols("g mu stride lift push")
N, O, T = ReferenceFrame("N"), Point("O"), ReferenceFrame("T")
T.orient(N, "Quaternion", e)
C = O.locatenew("C", place[0] * N.x + place[1] * N.y + place[2] * N.z)
angles = [dynamicsymbols(f"hip{i} thigh{i} knee{i}") for i in range(4)]
torques = [dynamicsymbols(f"tau{i}_1:4") for i in range(4)]
coordinates = [*place, *e, *(q for leg in angles for q in leg)]
scene = da.Scene("robot", frame=N, origin=O, coordinates=coordinates)
scene.add_holonomic_constraints(sum(c**2 for c in e) - 1)
scene.add_bodies(RigidBody("trunk", C, T, 8, (inertia(T, 0.05, 0.2, 0.22), C)))
scene.add_inputs(*(tau for leg in torques for tau in leg))
scene.add_loads((C, push * N.y * sin(10 * pi * Min(t, 0.1))))
scene.apply_uniform_gravity(-g * N.z)
scene.add_shapes({"trunk": da.Box(0.4, 0.1, 0.08), "floor": da.Ground(N.z)})

# %%
# A thigh and a shank are 0.2 m long. Legs 0 and 1 are in front, 0 and 2 at
# the left. Each joint has a torque and some damping. In a trot, two opposite
# legs swing while the others push, twice a second.

parts = {"hip": (0.5, 5e-4), "thigh": (0.8, 3e-3), "shank": (0.15, 6e-4)}
outputs, law = {}, {}
for i in range(4):
    side, start, last, drawn = (-1) ** i, C, T, []
    start = start.locatenew(f"P{i}", (0.2 - i // 2 * 0.4) * T.x)
    start = start.locatenew(f"H{i}", 0.05 * side * T.y)
    for k, (part, (m, J)) in enumerate(parts.items()):
        axis, q, tau = last.y if k else last.x, angles[i][k], torques[i][k]
        S = last.orientnew(f"{part}{i}", "Axis", (q, axis))
        torque = (tau - 0.2 * q.diff()) * axis
        scene.add_loads((S, torque), (last, -torque))
        way = 0.08 * side * S.y if part == "hip" else -0.2 * S.z
        G = start.locatenew(f"G_{part}{i}", way / 2)
        about = inertia(S, J, J, J if part == "hip" else J / 10)
        scene.add_bodies(RigidBody(f"{part}{i}", G, S, m, (about, G)))
        start, before, last = start.locatenew(f"{part}_{i}", way), start, S
        drawn.append(da.Rod(before, start))
    scene.add_shapes({f"leg{i}": drawn})
    floor = {"point": start, "plane": (O, N.z), "friction": mu}
    scene.add_contacts(da.PointPlane(f"foot{i}", body=f"shank{i}", **floor))
    outputs |= {f"{k}{i}": start.pos_from(O).dot(getattr(N, k)) for k in "xyz"}
    outputs[f"N{i}"] = f"foot{i}.normal"
    phase, begins = 4 * pi * t + (0 if i in (0, 3) else pi), Min(1, 2 * t)
    up = lift * Max(0, sin(phase)) * begins
    thigh = 0.7 + up / 2 + stride * cos(phase) * begins
    for k, angle in enumerate((0, thigh, -1.4 - up)):
        q = angles[i][k]
        law[torques[i][k]] = 300 * (angle - q) - 1.5 * q.diff()
scene.add_controllers(da.Controller("legs", period=0.002, inputs=law))
model = da.compile_model(scene, outputs=outputs)

# %%
# One model stands, trots, and is pushed from the side until it lies.

pose = {place[2]: 0.4 * np.cos(0.7), e[0]: 1}
pose |= {q: 0.7 for _, q, _ in angles} | {q: -1.4 for _, _, q in angles}
pose = dict.fromkeys(coordinates, 0) | pose
pose |= {q.diff(): 0 for q in coordinates}
lies = da.Event(place[2] - 0.15, terminal=True, name="lies")


def run(seconds, **given):
    """Return a motion that begins at rest; what is not given is zero."""
    values = {"stride": 0, "lift": 0, "push": 0, g: 9.81, mu: 0.6} | given
    about = {"events": [lies], "rtol": 1e-6, "atol": 1e-8}
    return model.simulate((0, seconds), pose, values, **about)


stand = run(2)
trot = run(2.5, stride=0.15, lift=0.5)
fall = run(2.5, push=300)
weight = 9.81 * (8 + 4 * 1.45)
carried = sum(stand[f"N{i}"][-1] for i in range(4))
stuck = stand.t > stand.phases[-1].t0
drift = max(np.ptp(stand[f"{k}{i}"][stuck]) for k in "xy" for i in range(4))
print(f"feet carry {carried:.2f} N of {weight:.2f} N and drift {drift:.0e} m")
print(f"it trots {trot['x'][-1]:.2f} m in {len(trot.phases)} phases")
print(f"pushed, it lies after {fall.events['lies'].t[0]:.2f} s")
assert {*stand.phases[-1].modes.values()} == {"stick"}
assert abs(carried / weight - 1) < 1e-3 and drift < 1e-12
assert trot.success and trot["x"][-1] > 0.6 and len(fall.events["lies"].t)

# %%
_, panel = plt.subplots()
panel.plot(trot.t, trot["z"], label="trots")
panel.plot(fall.t, fall["z"], color="C3", label="falls")
panel.plot(stand.t, stand["z"], color="black", label="stands")
panel.set(xlabel="t [s]", ylabel="height of the trunk [m]")
panel.legend()

# %%
# The trot, at half its speed.

# sphinx_gallery_thumbnail_number = -1
trot(np.linspace(0, 2.5, 100)).animate(fps=20, speed=0.5)
