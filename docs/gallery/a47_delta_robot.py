"""
Which torques move a Delta robot along its path?
================================================

Three motors on a frame turn arms, and light rods carry their motion to a
platform that stays level: three closed loops. With the path as constraints,
the torques of the motors are unknown reactions. The check is an inverse
dynamics written by hand. A controller then follows the path with these
torques, without them, and with a load that it does not know of.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import cos, pi, sin, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# Arms turn by the angles ``a``. A pair of parallel rods is one body that does
# not turn about its own axis, with two angles.

x, y, z = place = dynamicsymbols("x y z")
a, b, c = (dynamicsymbols(f"{name}0:3") for name in "abc")
t, (m, g, w) = dynamicsymbols._t, symbols("m g w", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
scene = da.Scene("delta", frame=N, origin=O, coordinates=[*place, *a, *b, *c])
level = (inertia(N, 0, 0, 0), P)
scene.add_bodies(RigidBody("platform", P, N, m, level))
scene.apply_uniform_gravity(-g * N.z)
scene.add_shapes(
    {"platform": da.Cylinder(0.05, 0.02, N.z), "path": da.Path(P)}
)
J, K = 0.4 * 0.24**2 / 12, 0.16 * 0.52**2 / 12
motors = []
for i in range(3):
    E = N.orientnew(f"E{i}", "Axis", (2 * i * pi / 3, N.z))
    A = E.orientnew(f"A{i}", "Axis", (a[i], E.y))
    B = E.orientnew(f"B{i}", "Axis", (b[i], E.y))
    C = B.orientnew(f"C{i}", "Axis", (c[i], B.z))
    hip = O.locatenew(f"hip{i}", 0.15 * E.x)
    knee = hip.locatenew(f"knee{i}", 0.24 * A.x)
    end = knee.locatenew(f"end{i}", 0.52 * C.x)
    ball = P.locatenew(f"ball{i}", 0.05 * E.x)
    G, H = (
        hip.locatenew(f"G{i}", 0.12 * A.x),
        knee.locatenew(f"H{i}", 0.26 * C.x),
    )
    scene.add_bodies(
        RigidBody(f"arm{i}", G, A, 0.4, (inertia(A, 0, J, J), G)),
        RigidBody(f"rods{i}", H, C, 0.16, (inertia(C, 0, K, K), H)),
    )
    ends = {"parent_point": end, "child_point": ball}
    loop = da.Closure(f"loop{i}", f"rods{i}", "platform", kind="ball", **ends)
    scene.add_joints(loop)
    motors.append((hip, A, E.y))
    pair = []
    for side in (-4, 4):
        top, low = (
            joint.locatenew(f"{joint.name}{side}", side / 100 * E.y)
            for joint in (knee, ball)
        )
        pair.append(da.Rod(top, low, color="#e07b1a"))
    scene.add_shapes({f"arm{i}": da.Rod(hip, knee), f"rods{i}": pair})

hips = [[0.15, 0, 0], [-0.075, 0.13, 0], [-0.075, -0.13, 0]]
scene.add_shapes({"frame": da.Mesh((hips, [[0, 1, 2]]), fixed=True)})

# %%
# The platform goes to and fro between two places at which it is low. The
# torques of the motors are outputs.

path = 0.2 * cos(w * t), 0.06 * sin(w * t), sin(w * t) ** 2 / 10 - 0.6
guided = scene.copy()
guided.add_holonomic_constraints(
    *(q - s for q, s in zip(place, path, strict=True))
)
torques = da.unknowns("M0:3")
for i, (hip, _, axis) in enumerate(motors):
    motor = {"body": f"arm{i}", "at": hip, "torque": torques[i] * axis}
    guided.add_joints(da.Joint(f"motor{i}", **motor))
model = da.compile_model(guided, outputs=torques)
values = {m: 0.5, g: 9.81, w: 10.0}
guess = {x: 0.2, y: 0, z: -0.6}
guess |= dict.fromkeys(a, 0.5) | dict.fromkeys(b, 1.8) | dict.fromkeys(c, 0)
start = model.assemble(guess, values)
times = np.linspace(0, np.pi / 5, 128, endpoint=False)  # a period
run = model.simulate((0, times[-1]), start, values, t_eval=times, rtol=1e-11)
found = np.stack([run[f"M{i}"] for i in range(3)], axis=1)

# %%
# The check, for arrays with axes for times, arms and components. The angles of
# the arms have a closed form, rates are those of Fourier series, and the
# virtual work of a thin rod needs the accelerations of its ends alone.


def rate(values):
    """Return the rate of values over a period."""
    waves = 10j * np.arange(len(values) // 2 + 1)
    return np.fft.irfft((waves * np.fft.rfft(values, axis=0).T).T, axis=0)


def pull(points):
    """Return accelerations less that of gravity."""
    return rate(rate(points)) + 9.81 * up


up, turns, s = np.array([0, 0, 1]), 2 * np.pi / 3 * np.arange(3), 10 * times
out = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
at = [0.2 * np.cos(s), 0.06 * np.sin(s), np.sin(s) ** 2 / 10 - 0.6]
balls = np.transpose(at)[:, np.newaxis] - 0.1 * out  # from the hips
near, below = (balls * out).sum(axis=2), balls[..., 2]
near_knee = ((balls**2).sum(axis=2) + 0.24**2 - 0.52**2) / 0.48
angles = np.arctan2(-below, near) - np.arccos(
    near_knee / np.hypot(near, below)
)
sine, cosine = np.sin(angles)[..., np.newaxis], np.cos(angles)[..., np.newaxis]
knees = 0.24 * (cosine * out - sine * up)
swing = -0.24 * (sine * out + cosine * up)  # rate of a knee by its angle
own = 0.4 * 0.24**2 / 3 * rate(rate(angles)) + 0.2 * 9.81 * swing[..., 2]
pulls = pull(balls) + 2 * pull(knees), 2 * pull(balls) + pull(knees)
own += 0.16 / 6 * (pulls[0] * swing).sum(axis=2)
force = 0.5 * pull(balls[:, 0]) + 0.16 / 6 * pulls[1].sum(axis=1)
rods = balls - knees
gear = rods / (rods * swing).sum(axis=2, keepdims=True)  # angles by place
force = np.linalg.solve(gear.transpose(0, 2, 1), force[..., np.newaxis])
expected = own + force[..., 0]
error = abs(found - expected).max()
print(f"largest difference of the torques: {error:.1e} N m")
assert error < 1e-9

# %%
_, panel = plt.subplots()
for i in range(3):
    panel.plot(times, found[:, i], label=f"motor {i + 1}")
    panel.plot(times[::4], expected[::4, i], "k.", ms=3)
panel.set(xlabel="t [s]", ylabel="torque [N m]")
panel.legend()

# %%
# A controller acts a thousand times a second: on the deviations of the angles
# and of their rates, and with a share of the torques found above.

u, aims, feeds = (
    dynamicsymbols(f"{name}0:3") for name in ("u", "aim", "feed")
)
share, k_p, k_d = symbols("share k_p k_d")
robot = scene.copy()
robot.add_inputs(*u, *aims, *feeds)
law = {}
for i, (_, A, axis) in enumerate(motors):
    robot.add_loads((A, u[i] * axis))
    behind = aims[i] - a[i]
    law[u[i]] = share * feeds[i] + k_p * behind + k_d * behind.diff()
robot.add_controllers(da.Controller("motors", period=0.001, inputs=law))
controlled = da.compile_model(robot)
knots = np.linspace(0, 2 * np.pi / 5, 401)
aim = model.simulate((0, knots[-1]), start, values, t_eval=knots, rtol=1e-9)
given = {}
for i in range(3):
    for name, record in ((aims[i], aim[f"a{i}"]), (feeds[i], aim[f"M{i}"])):
        given[name] = da.samples(knots, record, kind="cubic")


def follow(part, load):
    """Return times, and how far the platform is from its path in mm."""
    numbers = {m: 0.5 + load, g: 9.81, share: part, k_p: 60, k_d: 2}
    begin = start | {x.diff(): 0, y.diff(): 0.6, z.diff(): 0}
    about = {"inputs": given, "t_eval": knots[:-1], "rtol": 1e-8}
    seen = controlled.simulate((0, knots[-1]), begin, numbers, **about)
    return seen.t, 1e3 * np.linalg.norm((seen.q - aim.q[:-1])[:, :3], axis=1)


_, panel = plt.subplots()
cases = {"torques known": (1, 0), "feedback alone": (0, 0)}
cases |= {"unknown 0.5 kg": (1, 0.5)}
for label, case in cases.items():
    passed, off = follow(*case)
    print(f"{label}: at most {off.max():.2f} mm from the path")
    panel.plot(passed, off, label=label)
    assert off.max() < (0.5 if label == "torques known" else 30)
panel.set(xlabel="t [s]", ylabel="distance from the path [mm]", ylim=(-1, 38))
panel.legend(loc="upper center", ncols=2)

# %%
# The motion, at a quarter of its speed.

# sphinx_gallery_thumbnail_number = -1
aim.animate(fps=25, speed=0.25)
