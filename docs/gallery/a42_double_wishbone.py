"""
How far does a double wishbone steer its wheel on a rough road?
===============================================================

A quarter of a car with its suspension in space: two arms, an upright on two
ball joints, a tie rod, a spring with a damper on the lower arm, a tyre. On a
road, the wheel changes its camber and toe as it moves. The four closure
equations, solved by SciPy for the same travel, are the check.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from sympy import asin
from sympy.physics.mechanics import (
    LinearDamper,
    LinearPathway,
    LinearSpring,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# Hard points [m] from the body: x forward, y outwards, z up. Both arms turn
# about axes along x.

P = {"lower pivot": (0, 0.35, 0.2), "lower ball": (0, 0.75, 0.18)}
P |= {"upper pivot": (0, 0.45, 0.46), "upper ball": (-0.02, 0.68, 0.5)}
P |= {"rack": (0.12, 0.4, 0.25), "arm": (0.12, 0.72, 0.25)}
P |= {"wheel": (0, 0.78, 0.3), "mount": (0, 0.5, 0.6), "seat": (0, 0.6, 0.19)}
P = {name: np.array(place) for name, place in P.items()}

names = "height lower upper yaw pitch roll"
height, lower, upper, yaw, pitch, roll = q = dynamicsymbols(names)
road = dynamicsymbols("road")
N, O = ReferenceFrame("N"), Point("O")
L = N.orientnew("L", "Axis", (lower, N.x))
U = N.orientnew("U", "Axis", (upper, N.x))
W = N.orientnew("W", "Body", (yaw, pitch, roll), "zyx")
body = O.locatenew("body", height * N.z)


def place(name, origin, offset, frame=N):
    """Return a point at an offset (3,) along the axes of a frame."""
    x, y, z = offset
    return origin.locatenew(name, x * frame.x + y * frame.y + z * frame.z)


pivots = [place(n, body, P[n]) for n in ("lower pivot", "upper pivot")]
ball = place("ball", pivots[0], P["lower ball"] - P["lower pivot"], L)
seat = place("seat", pivots[0], P["seat"] - P["lower pivot"], L)
top = place("top", pivots[1], P["upper ball"] - P["upper pivot"], U)
hub = place("hub", ball, P["wheel"] - P["lower ball"], W)
reach = place("reach", ball, P["upper ball"] - P["lower ball"], W)
arm = place("arm", ball, P["arm"] - P["lower ball"], W)
rack, mount = place("rack", body, P["rack"]), place("mount", body, P["mount"])

# %%
# The upper ball joint closes the loop of the arms, and the tie rod holds its
# length.

scene = da.Scene("wishbone", frame=N, origin=O, coordinates=q)
wheel = RigidBody("wheel", hub, W, 35, (inertia(W, 1.2, 1.8, 1.2), hub))
scene.add_bodies(Particle("body", mount, 350), wheel)
scene.add_inputs(road)
scene.add_holonomic_constraints(
    *(reach.pos_from(top).dot(axis) for axis in N),
    arm.pos_from(rack).magnitude() - np.linalg.norm(P["arm"] - P["rack"]),
)
scene.apply_uniform_gravity(-9.81 * N.z)
strut = LinearPathway(seat, mount)
scene.add_actuators(LinearSpring(4e4, strut, 0.565), LinearDamper(3e3, strut))
tyre = 2e5 * (road - hub.pos_from(O).dot(N.z))
scene.add_loads((hub, tyre * N.z))
rods = [da.Rod(pivots[0], ball), da.Rod(pivots[1], top), da.Rod(rack, arm)]
rods += [da.Rod(ball, reach), da.Rod(ball, arm), da.Rod(ball, hub)]
shapes = {"wheel": da.Disk(radius=0.3, axis=W.y), "links": rods}
scene.add_shapes({**shapes, "spring": da.Spring(seat, mount)})
seen = {"camber": asin(W.y.dot(N.z)), "toe": asin(-W.y.dot(N.x))}
seen |= {"travel": hub.pos_from(body).dot(N.z), "tyre": tyre}
model = da.compile_model(scene, outputs=seen)

# %%
# A random road of 100 m, measured every 5 cm and driven at 20 m/s. The car
# starts in its equilibrium.

rng = np.random.default_rng(5)
rises = 0.006 * np.sqrt(0.05) * rng.standard_normal(2000)
profile = np.cumsum(np.r_[0, 0, rises])
times = 0.05 / 20 * np.arange(len(profile))
record = da.samples(times, profile, kind="linear")
design = dict.fromkeys(q, 0.0) | {height: -0.3, height.diff(): 0}
rest = model.trim(design | {lower.diff(): 0}, {}, inputs={road: 0})
run = model.simulate(
    (0, times[-1]), rest.initial, {}, inputs={road: record}, t_eval=times
)
print(f"least force of the tyre: {run['tyre'].min():.0f} N")

# %%
# The check: the pose that closes the loops at a travel of the wheel.


def gaps(pose, travel):
    """Return what is open at the upper ball joint, the tie rod, the hub."""
    arms = [Rotation.from_euler("X", angle) for angle in pose[:2]]
    upright = Rotation.from_euler("ZYX", pose[2:])
    low = P["lower pivot"] + arms[0].apply(P["lower ball"] - P["lower pivot"])
    high = P["upper pivot"] + arms[1].apply(P["upper ball"] - P["upper pivot"])
    top, arm, hub = (
        low + upright.apply(P[name] - P["lower ball"])
        for name in ("upper ball", "arm", "wheel")
    )
    rod = np.linalg.norm(arm - P["rack"]) - np.linalg.norm(
        P["arm"] - P["rack"]
    )
    return [*(top - high), rod, hub[2] - travel]


def camber_and_toe(travel):
    """Return both angles [rad] of the closed loops."""
    pose = root(gaps, np.zeros(5), travel, method="lm").x
    axle = Rotation.from_euler("ZYX", pose[2:]).apply([0, 1, 0])
    return np.arcsin(axle[2]), np.arcsin(-axle[0])


found = np.stack([run["camber"], run["toe"]], axis=1)[::20]
expected = np.array([camber_and_toe(travel) for travel in run["travel"][::20]])
error = abs(found - expected).max()
print(f"largest difference of camber and toe: {error:.1e} rad")
assert error < 1e-9

# %%
# The suspension over its whole travel, and where the road takes it.

travels = np.linspace(0.22, 0.38, 40)
curves = np.degrees([camber_and_toe(travel) for travel in travels])
_, panel = plt.subplots()
panel.plot(curves, 1e3 * (travels - 0.3), color="0.6", lw=1)
for name in ("camber", "toe"):
    angle = np.degrees(run[name])
    panel.plot(angle, 1e3 * (run["travel"] - 0.3), ".", label=name)
panel.set(xlabel="angle [degrees]", ylabel="travel of the wheel [mm]")
panel.legend()

# %%
# The first two seconds, at a quarter of the speed.

# sphinx_gallery_thumbnail_number = -1
run(np.linspace(0, 2, 160)).animate(fps=20, speed=0.25)
