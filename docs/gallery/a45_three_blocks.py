"""
When does a block on a belt pull its neighbours along?
======================================================

Three blocks lie on a moving belt, in a row of springs whose first end is
fixed. A block that slips loads the spring of the next one. Some slips stay
with the first block, others set off all three, as earthquakes do along a
fault. The check is a program of its own: a linear system between changes of
stick and slip, advanced by exponentials of matrices.
"""

from functools import partial

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq
from sympy import symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# The weight presses a block onto the belt. Each block has a law of friction
# with its slip on the belt, and a larger coefficient in stick.

q = dynamicsymbols("x1:4")
m, k, g, v, mu, mu_s = symbols("m k g v mu mu_s", positive=True)
N, O = ReferenceFrame("N"), Point("O")
places = [O.locatenew(f"P{i}", (i + x) * N.x) for i, x in enumerate(q, 1)]
pulls = [-k * q[0], k * (q[0] - q[1]), k * (q[1] - q[2]), 0]
scene = da.Scene("blocks", frame=N, origin=O, coordinates=q)
for i, (P, x) in enumerate(zip(places, q, strict=True)):
    block, F = f"block{i}", da.unknowns(f"F{i}")
    scene.add_bodies(Particle(block, P, m))
    scene.add_loads((P, (pulls[i] - pulls[i + 1]) * N.x))
    scene.add_joints(da.Joint(f"belt{i}", body=block, at=P, force=F * N.x))
    law = {"slip": x.diff() - v, "mu": mu, "mu_static": mu_s, "name": block}
    scene.add_friction(da.CoulombFriction(m * g, F, **law))
    scene.add_shapes({block: da.Box(0.5, 0.5, 0.5)})

# %%
# For the picture alone: springs, belt, and two pulleys that turn with it.

ends = [P.locatenew(f"end{P.name}", -0.25 * N.x) for P in places]
starts = [O, *(P.locatenew(f"start{P.name}", 0.25 * N.x) for P in places)]
coils = [da.Spring(*pair, 0.12, 6) for pair in zip(starts, ends, strict=False)]
corners = [[x, y, -0.25] for x in (0, 5) for y in (-0.4, 0.4)]
belt = da.Mesh((corners, [[0, 1, 2], [1, 2, 3]]), fixed=True)
scene.add_shapes({"springs": coils, "belt": belt})
for i in range(2):
    turn = v * dynamicsymbols._t / 0.2
    W = N.orientnew(f"W{i}", "Axis", (turn, N.y))
    axle = O.locatenew(f"axle{i}", 5 * i * N.x - 0.45 * N.z)
    pulley = RigidBody(f"W{i}", axle, W, 1, (inertia(W, 1, 1, 1), axle))
    scene.add_bodies(pulley)
    scene.add_shapes({f"W{i}": da.Cylinder(0.2, 0.8, W.y, color="grey")})
model = da.compile_model(scene)

values = {m: 1, k: 30, g: 9.81, v: 0.1, mu: 0.3, mu_s: 0.5}
start = dict.fromkeys(q, 0.0) | {x.diff(): 0.1 for x in q}
run = model.simulate((0, 20), start, values, rtol=1e-11)
changes = np.array([phase.t0 for phase in run.phases[1:]])
print(f"{run.status.name}, {len(changes)} changes between stick and slip")

# %%
# The check. While no block changes, the equations of y = (positions, rates, 1)
# are linear, and the exponential of a matrix advances it. ``ways`` is the sign
# of the slip of each block, and 0 in stick.

stiffness = 30 * np.array([[2, -1, 0], [-1, 2, -1], [0, -1, 1]])


def guards(y, ways):
    """Return what falls below zero where a block changes."""
    left = 0.5 * 9.81 - abs(stiffness @ y[:3])
    return np.where(ways == 0, left, ways * (y[3:6] - 0.1))


def guard_at(s, A, y, ways, i):
    """Return the guard of a block at a time after that of y."""
    return guards(expm(A * s) @ y, ways)[i]


def program(end, dt=2e-3):
    """Return the times of all changes."""
    y, ways = np.array([0, 0, 0, 0.1, 0.1, 0.1, 1]), np.zeros(3)
    t, times = 0, []
    while True:
        A = np.zeros((7, 7))
        A[:3, 3:6] = np.eye(3)
        A[3:6, :3] = -abs(ways)[:, np.newaxis] * stiffness
        A[3:6, 6] = -0.3 * 9.81 * ways
        step, before = expm(A * dt), guards(y, ways)
        while t < end:
            struck = (guards(step @ y, ways) < 0) & (before >= 0)
            if struck.any():
                break
            t, y = t + dt, step @ y
            before = guards(y, ways)
        else:
            return np.array(times)
        i = np.argmax(struck)
        found = partial(guard_at, A=A, y=y, ways=ways, i=i)
        rest = brentq(found, 0, dt, xtol=1e-15)
        t, y = t + rest, expm(A * rest) @ y
        times.append(t)
        pull = -(stiffness @ y[:3])[i]
        stays = ways[i] != 0 and abs(pull) < 0.5 * 9.81
        ways[i] = 0 if stays else np.sign(pull)


error = abs(changes - program(20)).max()
print(f"largest difference of the times of changes: {error:.1e} s")
assert error < 1e-9

# %%
# The first block breaks loose first, and most often.

fine = run(np.linspace(0, 20, 4000))
_, panel = plt.subplots()
for i in range(3):
    panel.plot(fine.t, i + 1 + fine[f"x{i + 1}"], label=f"block {i + 1}")
panel.set(xlabel="t [s]", ylabel="place [m]", ylim=(0.5, 4.5))
panel.set_xticks(range(0, 21, 5))
panel.legend(loc="upper center", ncols=3)

# %%
# A slip begins and ends with all blocks at rest on the belt. Its size is how
# far they slide back in it, together. Alone, the first block always slides by
# the same amount; how far all three go depends on what earlier slips have left
# in the springs.

long = model.simulate((0, 150), start, values, rtol=1e-11)
rests = [p for p in long.phases if {*p.modes.values()} == {"stick"}]
begins = np.array([rest.t1 for rest in rests[:-1]])
ends = np.array([rest.t0 for rest in rests[1:]])
slid = 0.1 * (ends - begins)[:, np.newaxis] - long(ends).q + long(begins).q
involved = (slid > 1e-6).sum(axis=1)
_, panel = plt.subplots()
for count, name in enumerate(("one block", "two blocks", "all three"), 1):
    seen = involved == count
    size = slid[seen].sum(axis=1)
    line = {"linefmt": f"C{count - 1}-", "basefmt": " ", "label": name}
    panel.stem(begins[seen], size, **line)
    print(f"{name}: {size.min():.3f} m to {size.max():.3f} m")
panel.set(xlabel="t [s]", ylabel="size of a slip [m]", ylim=(0, 2.8))
panel.legend(loc="upper center", ncols=3)

# %%
# The motion, twice as fast.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, 20), start, values).animate(fps=15, speed=2)
