"""
How fine must the encoders of a Furuta pendulum be?
===================================================

A motor turns an arm, whose end carries a pendulum that is to stay upright. A
sampled regulator sees both angles through encoders, which round them, and
takes rates from differences. The coarser the encoders, the more the arm
trembles. SciPy, with equations written by hand, is the check.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_discrete_are
from sympy import floor, symbols
from sympy.physics.mechanics import (
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da

arm, lean, u = dynamicsymbols("arm lean u")
old_arm, old_lean = old = dynamicsymbols("old_arm old_lean")
m, l, r, J, g = 0.024, 0.065, 0.085, 2e-4, 9.81  # the pendulum is 2 l long
N, O = ReferenceFrame("N"), Point("O")
A = N.orientnew("A", "Axis", (arm, N.z))
B = A.orientnew("B", "Axis", (-lean, A.x))
end = O.locatenew("end", r * A.x)
G = end.locatenew("G", l * B.z)
rod = inertia(B, m * l**2 / 3, m * l**2 / 3, 0)
scene = da.Scene("furuta", frame=N, origin=O, coordinates=[arm, lean])
scene.add_bodies(
    RigidBody("arm", O, A, 0.1, (inertia(A, 0, 0, J), O)),
    RigidBody("pendulum", G, B, m, (rod, G)),
)
scene.apply_uniform_gravity(-g * N.z)
scene.add_inputs(u)
scene.add_loads((A, u * N.z))
tip = end.locatenew("tip", 2 * l * B.z)
rods = {"arm": da.Rod(O, end), "pendulum": da.Rod(end, tip)}
scene.add_shapes({**rods, "track": da.Path(end)})

# %%
# Gains from the linear model of the exact angles: a regulator that acts every
# 5 ms and holds its torque in between.

T = 0.005
upright = {arm: 0, lean: 0, arm.diff(): 0, lean.diff(): 0}
linear = da.compile_model(scene).linearize(0.0, upright, {}, inputs={u: 0})
held = expm(T * np.block([[linear.A, linear.B], [np.zeros((1, 5))]]))
Ad, Bd = held[:4, :4], held[:4, 4:]
Q, R = np.diag([1, 1, 0.01, 0.01]), np.array([[1e3]])
S = solve_discrete_are(Ad, Bd, Q, R)
K = np.linalg.solve(R + Bd.T @ S @ Bd, Bd.T @ S @ Ad).ravel()

# %%
# The encoders round to steps of ``step`` radians. The controller keeps what it
# has seen for the next difference.

step = symbols("step", positive=True)
seen = [step * floor(angle / step + 0.5) for angle in (arm, lean)]
rates = [(new - last) / T for new, last in zip(seen, old, strict=True)]
law = -sum(k * s for k, s in zip(K, [*seen, *rates], strict=True))
memory = dict(zip(old, seen, strict=True))
regulator = da.Controller(
    "regulator", period=T, inputs={u: law}, states=memory
)
scene.add_controllers(regulator)
model = da.compile_model(scene)
start = upright | {lean: 0.1, old_arm: 0, old_lean: 0.1}
times = np.linspace(0, 6, 1201)
runs = {}
for count in (500, 2000, 8000):
    p = {step: 2 * np.pi / count}
    runs[count] = model.simulate((0, 6), start, p, t_eval=times, rtol=1e-11)

# %%
# The check: the first second with the encoder of 2000 steps a turn.


def rhs(t, y, torque):
    """Return the rates of arm, lean and their rates."""
    _, b, a_dot, b_dot = y
    s, c, k = np.sin(b), np.cos(b), 4 / 3 * m * l**2
    mass = [[J + m * r**2 + k * s**2, m * r * l * c], [m * r * l * c, k]]
    first = torque - 2 * k * s * c * a_dot * b_dot + m * r * l * s * b_dot**2
    second = k * s * c * a_dot**2 + m * g * l * s
    return [a_dot, b_dot, *np.linalg.solve(mass, [first, second])]


q, y, last, expected = 2 * np.pi / 2000, [0, 0.1, 0, 0], [0, 0.1], []
for _ in range(200):
    expected.append(y[:2])
    read = q * np.floor(np.array(y[:2]) / q + 0.5)
    torque, last = -K @ [*read, *((read - last) / T)], read
    tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
    y = solve_ivp(rhs, (0, T), y, args=(torque,), **tight).y[:, -1]
error = abs(runs[2000].q[:200] - expected).max()
print(f"largest difference from SciPy in the first second: {error:.1e} rad")
assert error < 1e-8

# %%
_, panel = plt.subplots()
for count, run in runs.items():
    panel.plot(run.t, np.degrees(run["arm"]), label=f"{count} steps a turn")
panel.set(xlabel="t [s]", ylabel="angle of the arm [degrees]")
panel.legend()

# %%
# The wobble at the end falls with the step of the encoders.

steps = 2 * np.pi / np.geomspace(200, 20000, 60)
late = np.linspace(4, 6, 401)
sweep = model.sweep((0, 6), start, {step: steps}, t_eval=late)
_, panel = plt.subplots()
for name in ("arm", "lean"):
    panel.loglog(steps, np.ptp(sweep[name], axis=1), "o", ms=4, label=name)
panel.plot(steps, steps, color="0.5", label="one step")
panel.set(xlabel="step of the encoders [rad]", ylabel="wobble [rad]")
panel.legend()

# %%
# Half a second of the start, at a fifth of the speed.

# sphinx_gallery_thumbnail_number = -1
model.simulate((0, 0.6), start, p).animate(fps=25, speed=0.2)
