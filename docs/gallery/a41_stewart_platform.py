"""
Which forces do the legs of a Stewart platform carry?
=====================================================

Six legs of given lengths hold a platform, as in flight simulators. The
lengths are functions of time; where the platform goes follows from them, and
so do the forces. SciPy's solution of the six closure equations and the
balances of force and moment are the check.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation
from sympy import sin, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

x, y, z, a, b, c = q = dynamicsymbols("x y z a b c")
t, (m, J, K, g, w) = dynamicsymbols._t, symbols("m J K g w", positive=True)
N, O = ReferenceFrame("N"), Point("O")
B = N.orientnew("B", "Body", (a, b, c), "xyz")
G = O.locatenew("G", x * N.x + y * N.y + z * N.z)
scene = da.Scene("platform", frame=N, origin=O, coordinates=q)
scene.add_bodies(RigidBody("platform", G, B, m, (inertia(B, J, J, K), G)))
scene.apply_uniform_gravity(-g * N.z)

# %%
# Legs stand in pairs on the base, and meet in other pairs at the platform. Leg
# i is longer by 0.1 m sin(w t + i) than in the middle position.

base = np.deg2rad([-10, 10, 110, 130, 230, 250])
top = np.deg2rad([-50, 50, 70, 170, 190, 290])
feet = 1.2 * np.stack([np.cos(base), np.sin(base), 0 * base], axis=1)
heads = 0.7 * np.stack([np.cos(top), np.sin(top), 0 * top], axis=1)
middle = np.linalg.norm(heads - feet + np.array([0, 0, 1.2]), axis=1)
rods = []
for i in range(6):
    foot = O.locatenew(f"foot{i}", feet[i, 0] * N.x + feet[i, 1] * N.y)
    head = G.locatenew(f"head{i}", heads[i, 0] * B.x + heads[i, 1] * B.y)
    length = middle[i] + sin(w * t + i) / 10
    leg = {"name": f"leg{i}", "child": "platform", "length": length}
    rods.append(da.Rod(foot, head, **leg))
scene.add_joints(*rods)
disk = da.Disk(radius=0.7, axis=B.z)
scene.add_shapes({"platform": disk, "legs": rods, "floor": da.Ground(N.z)})
tensions = [f"leg{i}.force" for i in range(6)]
model = da.compile_model(scene, outputs=tensions)

# %%
# `assemble` solves for the pose at the start. The lengths determine the rest
# of the motion.

values = {m: 500, J: 40, K: 80, g: 9.81, w: 2.0}
guess = dict.fromkeys(q, 0.0) | {z: 1.2}
start = model.assemble(guess, values)
times = np.linspace(0, np.pi, 128, endpoint=False)  # a period
run = model.simulate((0, times[-1]), start, values, t_eval=times, rtol=1e-11)

# %%
# The check: poses from the closure equations, rates of their Fourier series,
# and the balances of force and of moment about the mass centre.


def gaps(pose, time):
    """Return by how much legs are too long at a pose."""
    turned = Rotation.from_euler("XYZ", pose[3:]).apply(heads)
    reach = np.linalg.norm(pose[:3] + turned - feet, axis=1)
    return reach - middle - np.sin(2 * time + np.arange(6)) / 10


def rate(values):
    """Return the rate of values over a period."""
    waves = 2j * np.fft.rfftfreq(len(values), 1 / len(values))
    return np.fft.irfft((waves * np.fft.rfft(values, axis=0).T).T, axis=0)


poses = np.array([fsolve(gaps, run.q[0], time, xtol=1e-13) for time in times])
print(f"largest difference of the poses: {abs(run.q - poses).max():.1e}")
turn = Rotation.from_euler("XYZ", poses[:, 3:]).as_matrix()
spin = rate(turn) @ turn.transpose(0, 2, 1)
omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
momentum = np.einsum("tij,j,tkj,tk->ti", turn, [40, 40, 80], turn, omega)
arms = np.einsum("tij,lj->tli", turn, heads)
legs = feet - poses[:, np.newaxis, :3] - arms
pulls = legs / np.linalg.norm(legs, axis=2, keepdims=True)
forces = np.stack([run[name] for name in tensions], axis=1)[..., np.newaxis]
weight = 500 * (rate(rate(poses[:, :3])) + np.array([0, 0, 9.81]))
left = (forces * pulls).sum(axis=1) - weight
turning = (forces * np.cross(arms, pulls)).sum(axis=1) - rate(momentum)
error = max(abs(left).max(), abs(turning).max())
print(f"largest residual of the balances: {error:.1e} N, N m")
assert abs(run.q - poses).max() < 1e-9 and error < 1e-6

# %%
_, panel = plt.subplots()
for i in range(6):
    panel.plot(run.t, -forces[:, i, 0] / 1e3, label=f"leg {i}")
panel.set(xlabel="t [s]", ylabel="force of a leg [kN]", ylim=(0, None))
panel.legend(ncols=3)

# %%
# The motion, to play and to turn.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, np.pi), start, values).animate(fps=25)
