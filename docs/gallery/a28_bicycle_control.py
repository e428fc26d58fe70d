"""
Which steering torque keeps a bicycle upright at walking speed?
===============================================================

The benchmark bicycle of Meijaard, Papadopoulos, Ruina and Schwab (2007) falls
below 4.29 m/s. `model.linearize` gives its matrices at 2 m/s from the full
nonholonomic model, a sampled regulator is designed for them, and the full
model runs with it. The published linear equations under the same regulator,
solved by SciPy, are the check.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_discrete_are
from sympy import pi, sqrt, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# Both wheels roll: each touches the ground (a holonomic constraint) and does
# not slip (two nonholonomic ones). ``psi`` is pi/2 plus the lean, ``psif``
# turns the fork.

x, y, z, theta, psi, phi, psif, betar, betaf = q = dynamicsymbols(
    "x y z theta psi phi psif betar betaf"
)
u = dynamicsymbols("u")  # the steering torque
w, c, lam, rR, rF, g = 1.02, 0.08, pi / 10, 0.3, 0.35, symbols("g")
N, O = ReferenceFrame("N"), Point("O")
yaw = N.orientnew("Y", "Axis", (theta, N.z))
lean = yaw.orientnew("L", "Axis", (psi, yaw.x))
b = lean.orientnew("b", "Axis", (phi, lean.z))
tilted = b.orientnew("T", "Axis", (-lam, b.z))
steer = tilted.orientnew("U", "Axis", (-psif, tilted.y))
f = steer.orientnew("f", "Axis", (lam, steer.z))
rear = O.locatenew("R", x * N.x + y * N.y + z * N.z)
foot = rear.locatenew("K", (w + c) * b.x + rR * b.y)
front = foot.locatenew("F", -c * f.x - rF * f.y)
rider = rear.locatenew("GB", 0.3 * b.x + (rR - 0.9) * b.y)
fork = foot.locatenew("GH", (0.9 - w - c) * f.x - 0.7 * f.y)
back, ahead = (
    b.orientnew("WR", "Axis", (betar, b.z)),
    f.orientnew("WF", "Axis", (betaf, f.z)),
)
scene = da.Scene("bicycle", frame=N, origin=O, coordinates=q)
scene.add_bodies(
    RigidBody(
        "rear wheel",
        rear,
        back,
        2,
        (inertia(back, 0.0603, 0.0603, 0.12), rear),
    ),
    RigidBody(
        "rider", rider, b, 85, (inertia(b, 9.2, 2.8, 11, 2.4, 0, 0), rider)
    ),
    RigidBody(
        "fork",
        fork,
        f,
        4,
        (inertia(f, 0.05892, 0.00708, 0.06, -0.00756, 0, 0), fork),
    ),
    RigidBody(
        "front wheel",
        front,
        ahead,
        3,
        (inertia(ahead, 0.1405, 0.1405, 0.28), front),
    ),
)
scene.add_inputs(u)
scene.add_loads((f, -u * tilted.y), (b, u * tilted.y))
scene.apply_uniform_gravity(-g * N.z)
for centre, wheel, carrier, radius in (
    (rear, back, b, rR),
    (front, ahead, f, rF),
):
    up = N.z - N.z.dot(carrier.z) * carrier.z
    arm = -radius / sqrt(1 - N.z.dot(carrier.z) ** 2) * up
    scene.add_holonomic_constraints(centre.pos_from(O).dot(N.z) + arm.dot(N.z))
    slip = centre.pos_from(O).dt(N) + wheel.ang_vel_in(N).cross(arm)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
model = da.compile_model(scene, formulation="projected")

# %%
# Linearisation about upright motion. Position and heading do not matter, so
# that the block of lean and steer is left.

SPEED, PERIOD, p = 2.0, 0.05, {g: 9.81}
upright = {name: 0.0 for name in model.layout.coordinates} | {
    "z": rR,
    "psi": np.pi / 2,
    "phi": np.pi,
}
rolling = upright | {"psi_dot": 0.0, "psif_dot": 0.0, "betar_dot": SPEED / rR}
free = [
    "x",
    "y",
    "theta",
    "psi",
    "psif",
    "betar",
    "betaf",
    "psi_dot",
    "psif_dot",
    "betar_dot",
]
linear = model.linearize(0.0, rolling, p, inputs={u: 0.0}, states=free)
part = ["psi", "psif", "psi_dot", "psif_dot"]
A, B = linear.block(*part), linear.B[[free.index(name) for name in part]]
print("eigenvalues without control:", np.linalg.eigvals(A).round(3))

# %%
# A regulator that acts every 0.05 s and holds its torque in between: the exact
# discrete system, and the gains that minimise a sum of squares of lean, steer
# and torque. With python-control this is ``control.dlqr(Ad, Bd, Q, R)``.

both = expm(PERIOD * np.block([[A, B], [np.zeros((1, 5))]]))
Ad, Bd = both[:4, :4], both[:4, 4:]
Q, R = np.diag([100.0, 10.0, 1.0, 1.0]), np.array([[0.1]])
P = solve_discrete_are(Ad, Bd, Q, R)
K = np.linalg.solve(R + Bd.T @ P @ Bd, Bd.T @ P @ Ad)
print(
    "gains:",
    K.round(2),
    " largest |z|:",
    abs(np.linalg.eigvals(Ad - Bd @ K)).max().round(3),
)

# %%
# The full model with the regulator, after a push: a rate of lean at the start.
# The torque is held between instants.

gains = symbols("k1:5")
deviation = [psi - pi / 2, psif, psi.diff(), psif.diff()]
law = -sum(k * error for k, error in zip(gains, deviation, strict=True))
scene.add_controllers(
    da.Controller("regulator", period=PERIOD, inputs={u: law})
)
controlled = da.compile_model(scene, formulation="projected")


def ride(push, seconds, rows):
    """Return the ride after a push, with the gains given."""
    values = p | dict(zip(gains, np.ravel(rows), strict=True))
    instants = np.arange(round(seconds / PERIOD) + 1) * PERIOD
    return controlled.simulate(
        (0, seconds),
        rolling | {"psi_dot": push},
        values,
        t_eval=instants,
        rtol=1e-10,
        atol=1e-12,
    )


run = ride(0.3, 4.0, K)
lean = run["psi"] - np.pi / 2
print(
    f"lean at most {np.degrees(abs(lean).max()):.1f} degrees, after 4 s"
    f" {np.degrees(lean[-1]):.3f}"
)
assert abs(lean[-1]) < 1e-3

# %%
# The check: published matrices, M q'' + v C q' + (g K_0 + v^2 K_2) q = (0, u),
# for a small push.

M = np.array(
    [[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]]
)
C = np.array([[0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
K0 = np.array(
    [[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]]
)
K2 = np.array([[0, 76.59734589573222], [0, 2.65431523794604]])
stiffness, damping = 9.81 * K0 + SPEED**2 * K2, SPEED * C
published = np.block(
    [
        [np.zeros((2, 2)), np.eye(2)],
        [-np.linalg.solve(M, np.hstack([stiffness, damping]))],
    ]
)
drive = np.concatenate([[0, 0], np.linalg.solve(M, [0, 1])])
print(
    "largest difference of the matrices:"
    f" {max(abs(published - A).max(), abs(drive - B[:, 0]).max()):.1e}"
)

seen, expected = np.array([0, 0, 1e-4, 0]), []


def linear_rates(t, e, torque):
    return published @ e + drive * torque


for _ in range(80):
    expected.append(seen)
    seen = solve_ivp(
        linear_rates,
        (0, PERIOD),
        seen,
        args=-(K @ seen),
        rtol=1e-11,
        atol=1e-16,
    ).y[:, -1]
small = ride(1e-4, 4.0, K)
found = np.stack([small[name] for name in part], axis=1) - [np.pi / 2, 0, 0, 0]
error = abs(found[:80] - expected).max() / abs(found).max()
print(
    f"largest difference of the motions after a small push: {error:.1e} of"
    " the largest rate"
)
assert error < 1e-6

# %%
falling = ride(0.3, 0.8, 0 * K)
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
fine = run(np.linspace(0, 4, 500))
left.plot(fine.t, np.degrees(fine["psi"]) - 90, label="lean")
left.plot(fine.t, np.degrees(fine["psif"]), label="steer")
left.plot(
    falling.t,
    np.degrees(falling["psi"]) - 90,
    "k:",
    label="lean without control",
)
left.set(xlabel="t [s]", ylabel="angle [degrees]", ylim=(-2, 25))
left.legend()
_, right = plt.subplots()
right.step(run.t, run["u"], where="post")
right.set(xlabel="t [s]", ylabel="torque [N m]", xlim=(0, 2))
