"""
How fast do two double pendulums diverge?
=========================================

The motion of a double pendulum is chaotic: neighbouring motions move apart
exponentially. A sweep of 400 motions starts within a nanoradian; the spread
grows until it is as large as the motion itself.
"""

import matplotlib.pyplot as plt
import numpy as np
from sympy import cos, sin, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

a, b = dynamicsymbols("a b")
m, l, g = symbols("m l g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P = O.locatenew("P", l * sin(a) * N.x - l * cos(a) * N.y)
Q = P.locatenew("Q", l * sin(b) * N.x - l * cos(b) * N.y)
scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
scene.add_bodies(Particle("upper", P, m), Particle("lower", Q, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_shapes({"rods": [da.Rod(O, P), da.Rod(P, Q)], "track": da.Path(Q)})
model = da.compile_model(scene)

# %%
# All cases are simulated at the same times. Tolerances near rounding keep
# numerical errors far below the spread.

times = np.linspace(0, 20, 401)
offsets = 1e-9 * np.linspace(-1, 1, 400)
start = {a: 2.0, b: 2.5 + offsets, a.diff(): 0, b.diff(): 0}
sweep = model.sweep(
    (0, 20), start, {m: 1, l: 1, g: 9.81}, t_eval=times, rtol=1e-13, atol=1e-13
)
spread = sweep["b"].std(axis=0)
growing = (spread > 1e-8) & (spread < 1e-2)
rate = np.polyfit(times[growing], np.log(spread[growing]), 1)[0]
print(f"the spread grows by a factor e in {1 / rate:.2f} s")

# %%
_, left = plt.subplots()
left.plot(times, sweep["b"][::40].T, lw=0.8)
left.set(xlabel="t [s]", ylabel="lower rod [rad]")
_, right = plt.subplots()
right.semilogy(times, spread)
right.set(xlabel="t [s]", ylabel="spread [rad]")

# %%
# One of them.

# sphinx_gallery_thumbnail_number = -1
run = model.simulate(
    (0, 8), {a: 2.0, b: 2.5, a.diff(): 0, b.diff(): 0}, {m: 1, l: 1, g: 9.81}
)
run.animate(fps=20)
