"""
Which push can the rider of a unicycle catch?
=============================================

The rider turns the pedals against a fall forwards or backwards, and a heavy
pole against a fall to the side, as on a tightrope. Both torques are bounded,
so that a push may be too hard; where that begins has a closed form for small
angles. The wheel rolls in space without slip. The check is the balance of
moments, computed from the positions alone.
"""

import matplotlib.pyplot as plt
import numpy as np
from numpy.polynomial import chebyshev
from scipy.linalg import solve_continuous_are
from scipy.spatial.transform import Rotation
from sympy import Max, Min
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# The wheel is a disc that leans and rolls, and the rider has another angle
# about its axle.

x, y, heading, lean, spin, pitch, pole = q = dynamicsymbols(
    "x y heading lean spin pitch pole"
)
g, r, speed = 9.81, 0.3, 0.6
N, O = ReferenceFrame("N"), Point("O")
H = N.orientnew("H", "Axis", (heading, N.z))
L = H.orientnew("L", "Axis", (lean, H.x))
W = L.orientnew("W", "Axis", (spin, L.y))
R = L.orientnew("R", "Axis", (pitch, L.y))
B = R.orientnew("B", "Axis", (pole, R.x))
P = O.locatenew("P", x * N.x + y * N.y)  # where the wheel touches the floor
C = P.locatenew("C", r * L.z)
G, D = C.locatenew("G", 0.9 * R.z), C.locatenew("D", 1.1 * R.z)
scene = da.Scene("unicycle", frame=N, origin=O, coordinates=q)
scene.add_bodies(
    RigidBody("wheel", C, W, 3, (inertia(W, 0.12, 0.24, 0.12), C)),
    RigidBody("rider", G, R, 60, (inertia(R, 9, 8, 1.5), G)),
    RigidBody("pole", D, B, 10, (inertia(B, 10, 0, 10), D)),
)
scene.apply_uniform_gravity(-g * N.z)
slip = C.pos_from(O).dt(N) + W.ang_vel_in(N).cross(-r * L.z)
scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))

# %%
# Shapes for the picture.

seat, head = (C.locatenew(n, s * R.z) for n, s in (("s", 0.5), ("h", 1.4)))
ends = [D.locatenew(f"end{s}", s * B.y) for s in (-1, 1)]
body = [da.Box(0.2, 0.35, 0.7), da.Sphere(0.13, at=head)]
weights = [da.Sphere(0.08, at=end) for end in ends]
scene.add_shapes({"wheel": da.Disk(r, W.y), "rider": body})
scene.add_shapes({"pole": [da.Rod(*ends), *weights]})
scene.add_shapes({"post": da.Rod(C, seat), "track": da.Path(P)})
scene.add_shapes({"floor": da.Ground(N.z)})


def driven(pedals, hands):
    """Return the scene with torques on the wheel and on the pole."""
    ridden = scene.copy()
    ridden.add_loads((W, pedals * L.y), (R, -pedals * L.y))
    ridden.add_loads((B, hands * R.x), (R, -hands * R.x))
    return ridden


# %%
# Gains from the linear model of the upright ride, for little effort. Falls
# forwards and to the side do not affect each other in it.

torques = dynamicsymbols("pedals hands")
plant = driven(*torques)
plant.add_inputs(*torques)
plant = da.compile_model(plant)
ride = dict.fromkeys(plant.layout.coordinates, 0.0)
ride |= {f"{name}_dot": 0.0 for name in ("heading", "lean", "pitch", "pole")}
ride |= {"spin_dot": speed / r}
about = {"inputs": dict.fromkeys(torques, 0.0), "states": [*ride]}
linear = plant.linearize(0.0, ride, {}, **about)
parts = (
    {"pitch": pitch, "pitch_dot": pitch.diff(), "spin_dot": spin.diff()},
    {"lean": lean, "lean_dot": lean.diff(), "pole": pole}
    | {"pole_dot": pole.diff()},
)
bounds, gains, limits, law = (30, 40), [], [], []  # bounds in N m
for k, (part, bound) in enumerate(zip(parts, bounds, strict=True)):
    A, rows = linear.block(*part), [[*ride].index(name) for name in part]
    b = linear.B[rows, k : k + 1]
    S = solve_continuous_are(A, b, np.eye(len(A)), [[0.1]])
    gains.append((10 * b.T @ S).ravel())
    errors = [s - ride[name] for name, s in part.items()]
    torque = -sum(k * e for k, e in zip(gains[-1], errors, strict=True))
    law.append(Max(-bound, Min(bound, torque)))
    limits.append(bound * abs(b[1, 0]) / np.sqrt(A[1, 0]))
model = da.compile_model(driven(*law))

# %%
# A push gives an angle s a rate. For small angles s'' = a s - b u, and if the
# torque u is bounded, no controller catches a rate beyond b / sqrt(a) times
# its bound: the frame in the map of 3,965 pushes.

fall = da.Event(lean**2 + pitch**2 - 1, terminal=True, name="fall")
side, ahead = np.linspace(-0.18, 0.18, 61), np.linspace(-1.6, 1.6, 65)
pushes = da.grid(lean_dot=side, pitch_dot=ahead)
rest = {n: s for n, s in ride.items() if n not in ("lean_dot", "pitch_dot")}
sweep = model.sweep((0, 10), rest, {}, grid=pushes, events=[fall])
caught = np.isnan(sweep.events["fall"].first).reshape(61, 65)
hardest = side[caught[:, 32]].max(), ahead[caught[30]].max()
for name, found, limit in zip("xy", hardest, limits[::-1], strict=True):
    print(f"about {name}: {found:.3f} rad/s, small angles {limit:.3f} rad/s")
    assert 0.85 * limit < found < limit

_, panel = plt.subplots()
panel.pcolormesh(side, ahead, caught.T, cmap="Greens", vmin=0, vmax=2)
corners = np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])
panel.plot(*(np.array(limits[::-1])[:, np.newaxis] * corners), "C3")
panel.set(xlabel="push to the side [rad/s]", ylabel="push forwards [rad/s]")

# %%
# The check of a motion, whose rates are those of the Chebyshev series through
# its positions. Gravity and inertia have no moment about the contact; those of
# the wheel have that of the pedals about the axle, and those of the pole have
# that of the hands about its pivot.

nodes = -np.cos(np.pi * np.arange(65) / 64)
times = 0.75 * (1 + nodes)
gentle = ride | {"lean_dot": 0.03, "pitch_dot": 0.1}
tight = {"t_eval": times, "rtol": 1e-12, "atol": 1e-14}
run = model.simulate((0, 1.5), gentle, {}, **tight)
slopes = chebyshev.chebval(nodes, chebyshev.chebder(np.eye(65))).T / 0.75
slopes = slopes @ np.linalg.inv(chebyshev.chebvander(nodes, 64))


def rate(values):
    """Return the rate of values (time, ...)."""
    return np.tensordot(slopes, values, axes=1)


def spun(frames, J):
    """Return the angular velocity of a body, and its moment of inertia."""
    spin = rate(frames) @ frames.transpose(0, 2, 1)
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    momentum = np.einsum("tij,j,tkj,tk->ti", frames, J, frames, omega)
    return omega, rate(momentum)


lean_frame = Rotation.from_euler("ZX", run.q[:, [2, 3]])
about_axle = [Rotation.from_euler("Y", run.q[:, [i]]) for i in (4, 5)]
wheel, rider = (lean_frame * turn for turn in about_axle)
held = rider * Rotation.from_euler("X", run.q[:, [6]])
leant, *frames = (f.as_matrix() for f in (lean_frame, wheel, rider, held))
contact = run.q[:, :2] @ np.eye(2, 3)
axle = contact + r * leant[..., 2]
centres = [axle + height * frames[1][..., 2] for height in (0, 0.9, 1.1)]
inertias = [0.12, 0.24, 0.12], [9, 8, 1.5], [10, 0, 10]
omegas, inertial = zip(*map(spun, frames, inertias), strict=True)
up, masses = np.array([0, 0, g]), zip((3, 60, 10), centres, strict=True)
forces = [m * (rate(rate(place)) + up) for m, place in masses]
arms = [place - contact for place in centres]
whole = sum(map(np.cross, arms, forces)) + sum(inertial)
rolling = inertial[0] + np.cross(arms[0], sum(forces))
states = [np.stack([run[n] - ride[n] for n in part], axis=1) for part in parts]
torques = [-s @ K for s, K in zip(states, gains, strict=True)]
left = (
    np.linalg.norm(whole, axis=1),
    (rolling * leant[..., 1]).sum(axis=1) - torques[0],
    (inertial[2] * frames[1][..., 0]).sum(axis=1) - torques[1],
)
slip = rate(axle) - np.cross(omegas[0], arms[0])
print(f"largest residual of the moments: {abs(np.array(left)).max():.1e} N m")
print(f"largest slip: {abs(slip).max():.1e} m/s")
assert abs(np.array(left)).max() < 1e-5 and abs(slip).max() < 1e-9

# %%
# A push to the side. The rider is upright again after three seconds, and the
# pole is level after nine.

push = ride | {"lean_dot": -0.035}
run = model.simulate((0, 15), push, {}, rtol=1e-9)
fine = run(np.linspace(0, 15, 1500))
_, panel = plt.subplots()
panel.plot(fine.t, 10 * fine["lean"], label="10 x lean")
panel.plot(fine.t, fine["pole"], label="pole")
panel.set(xlabel="t [s]", ylabel="angle [rad]")
panel.legend()

# %%
# The first five seconds.

# sphinx_gallery_thumbnail_number = -1
run(np.linspace(0, 5, 126)).animate(fps=25)
