"""
How fast must the gyroscopes of a monorail car spin?
====================================================

A car on one rail carries two rotors that spin in opposite ways. Their gimbals
are geared so that one tilts forwards as the other tilts backwards. The car
would fall, and so would the rotors, whose centres are above their gimbals; a
fast spin couples them so that both stay up. The least spin has a closed form.
SciPy's solution of equations written by hand is the check of the motion.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp
from sympy import exp, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

# %%
# The rail is a circle, on which the car starts from rest and approaches the
# angular velocity ``w``; with w = 0 it stands. Gimbals have friction ``c``. A
# motor tilts them by a torque that is ``e`` times the lean of the car.

lean, tilt, spin1, spin2 = q = dynamicsymbols("lean tilt spin1 spin2")
w, c, e = symbols("w c e")
t, g, radius = dynamicsymbols._t, 9.81, 1.5
N, O = ReferenceFrame("N"), Point("O")
H = N.orientnew("H", "Axis", (w * (t - 1 + exp(-t)), N.z))
L = H.orientnew("L", "Axis", (lean, H.x))
rail = O.locatenew("rail", -radius * H.y)
G = rail.locatenew("G", 0.25 * L.z)
scene = da.Scene("monorail", frame=N, origin=O, coordinates=q)
scene.add_bodies(RigidBody("car", G, L, 20, (inertia(L, 0.75, 2, 2), G)))
scene.apply_uniform_gravity(-g * N.z)
fore, aft = (
    rail.locatenew(name, place * H.x + 0.08 * L.z)
    for name, place in (("fore", 0.25), ("aft", -0.25))
)
wheels = [da.Disk(0.08, L.y, at=place, color="black") for place in (fore, aft)]
car = [da.Box(0.8, 0.2, 0.2), *wheels]
scene.add_shapes({"car": car, "rail": da.Path(rail), "floor": da.Ground(N.z)})
servo = e * lean - c * tilt.diff()
for i, (way, spin) in enumerate(((1, spin1), (-1, spin2)), 1):
    A = L.orientnew(f"gimbal{i}", "Axis", (way * tilt, L.y))
    R = A.orientnew(f"rotor{i}", "Axis", (spin, A.z))
    pivot = G.locatenew(f"pivot{i}", way * 0.2 * L.x + 0.15 * L.z)
    C = pivot.locatenew(f"C{i}", 0.05 * A.z)
    about = (inertia(R, 0.008, 0.008, 0.015), C)
    scene.add_bodies(RigidBody(f"rotor{i}", C, R, 3, about))
    scene.add_loads((A, way * servo / 2 * L.y))
    disk = {f"rotor{i}": da.Disk(0.15, R.z), f"axle{i}": da.Rod(pivot, C)}
    scene.add_shapes(disk)
model = da.compile_model(scene)

# %%
# About the upright position, lean and tilt obey A lean'' = P lean - H tilt'
# and B tilt'' = K tilt + H lean', with the spin momentum H = 0.03 n. Both are
# unstable if H = 0, and stable if H is larger than sqrt(A K) + sqrt(B P).

A = 0.75 + 20 * 0.25**2 + 2 * (0.008 + 3 * 0.45**2)
B, K = 2 * (0.008 + 3 * 0.05**2), 6 * g * 0.05
P = g * (20 * 0.25 + 6 * 0.45)
least = (np.sqrt(A * K) + np.sqrt(B * P)) / 0.03
free = {w: 0, c: 0, e: 0}


def start(n, push=0.01):
    """Return a car that leans a little, with rotors at n rad/s."""
    rates = {lean.diff(): 0, tilt.diff(): 0, spin1.diff(): n, spin2.diff(): -n}
    return {lean: push, tilt: 0, spin1: 0, spin2: 0, **rates}


fall = da.Event(lean**2 - 1, terminal=True, name="fall")
spins = np.linspace(0.2, 1.3, 111) * least
sweep = model.sweep((0, 20), start(spins, 1e-3), free, events=[fall])
falls = sweep.events["fall"].first  # NaN where the car does not fall
stays = spins[np.isnan(falls)]
print(f"stays up from {stays[0]:.0f} rad/s on; closed form {least:.0f} rad/s")
assert np.isnan(falls).sum() == len(stays) == sum(spins >= stays[0])
assert abs(stays[0] - least) < 0.02 * least

# %%
_, panel = plt.subplots()
panel.plot(spins, falls, ".", label="falls")
panel.axvspan(least, spins[-1], color="C2", alpha=0.3, label="stays up")
panel.set(xlabel="spin [rad/s]", ylabel="time of the fall [s]", ylim=(0, 6.5))
panel.legend(loc="upper left")

# %%
# The check of a motion of the car that stands, at 1.5 times that spin.

spin = 1.5 * least


def rhs(t, y):
    """Return the rates of lean, tilt and their rates."""
    a, b, a_dot, b_dot = y
    sine, cosine, height = np.sin(b), np.cos(b), 0.4 + 0.05 * np.cos(b)
    I = 2 + 0.016 * cosine**2 + 6 * height**2
    slope = -0.032 * cosine * sine - 0.6 * height * sine  # of I by the tilt
    coupling = 0.03 * spin * cosine
    lift = g * (5 + 6 * height) * np.sin(a)
    first = lift - slope * a_dot * b_dot - coupling * b_dot
    second = slope * a_dot**2 / 2 + coupling * a_dot + K * sine * np.cos(a)
    return [a_dot, b_dot, first / I, second / B]


times = np.linspace(0, 8, 801)
tight = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15, "t_eval": times}
expected = solve_ivp(rhs, (0, 8), [0.05, 0, 0, 0], **tight).y
run = model.simulate((0, 8), start(spin, 0.05), free, t_eval=times, rtol=1e-13)
error = abs(run.q[:, :2].T - expected[:2]).max()
print(f"largest difference from SciPy: {error:.1e} rad")
assert error < 1e-9

# %%
# Friction in the gimbals lets the slow precession grow. A torque that tilts
# the gimbals further with the lean brings the car back.

_, panel = plt.subplots()
cases = {"free": {}, "friction": {c: 0.5}, "and motor": {c: 0.5, e: 20}}
for (label, case), color in zip(
    cases.items(), ("C0", "C3", "C2"), strict=True
):
    run = model.simulate((0, 5), start(spin, 0.03), free | case, events=[fall])
    fine = run(np.linspace(0, run.t[-1], 1000))
    panel.plot(fine.t, fine["lean"], color, label=label)
panel.set(xlabel="t [s]", ylabel="lean [rad]", ylim=(-0.12, 0.22))
panel.legend()
assert abs(run["lean"][-1]) < 1e-3

# %%
# On a circle the car leans inwards by itself, by the centrifugal force over
# its weight, or a little less: its centre is inside of the rail.

given = {w: 0.9, c: 0.5, e: 10}
run = model.simulate((0, 8), start(2 * least, 0), given)
inwards = 0.9**2 * radius / g
print(f"lean {run['lean'][-1]:.3f} rad; force by weight {inwards:.3f}")
assert abs(run["lean"][-1] + inwards) < 0.01

# sphinx_gallery_thumbnail_number = -1
run.animate(fps=20)
