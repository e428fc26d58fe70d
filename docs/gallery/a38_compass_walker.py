"""
How does a pair of legs walk down a slope without a motor?
==========================================================

The simplest walking model of Garcia, Chatterjee, Ruina and Coleman (1998): a
hip with two straight legs, whose feet are so light that they do not disturb
the hip. Gravity replaces what each impact of a foot takes. The gait and its
stability at a slope of 0.009 rad are compared with the published values.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import fsolve
from sympy import cos, sin, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

# %%
# Both angles are measured from the normal of the slope: ``stance`` that of the
# leg whose foot is at rest, ``swing`` that of the other leg.

stance, swing = dynamicsymbols("stance swing")
m, slope, g = symbols("m slope g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
hip = O.locatenew("hip", -sin(stance) * N.x + cos(stance) * N.y)
foot = hip.locatenew("foot", sin(swing) * N.x - cos(swing) * N.y)
scene = da.Scene("walker", frame=N, origin=O, coordinates=[stance, swing])
scene.add_bodies(Particle("hip", hip, 1), Particle("foot", foot, m))
scene.apply_uniform_gravity(g * (sin(slope) * N.x - cos(slope) * N.y))

# %%
# The foot strikes where the angles are opposite. Then the legs change their
# roles. The angular momentum about the new foot is conserved, and so is that
# of the new swing leg about the hip.

turn = cos(2 * stance) * stance.diff()
rates = {stance.diff(): turn, swing.diff(): cos(2 * stance) * turn}
strike = da.Event(
    stance + swing,
    direction=-1,
    apply={stance: swing, swing: stance, **rates},
    name="strike",
)
legs = {"stance": da.Rod(O, hip, "gray"), "swing": da.Rod(hip, foot, "orange")}
scene.add_shapes({**legs, "hip": da.Sphere(0.08), "slope": da.Ground(N.y)})
model = da.compile_model(scene)
values = {slope: 0.009, m: 1e-9, g: 1}


def walk(angle, rate, seconds):
    """Return a walk that begins right after a strike."""
    legs = {stance: angle, swing: -angle}
    legs |= {stance.diff(): rate, swing.diff(): rate * np.cos(2 * angle)}
    return model.simulate((0, seconds), legs, values, events=[strike])


def step(start):
    """Return angle and rate of the stance leg after the next strike."""
    after = walk(*start, 6).events["strike"].after
    return np.array([after["stance"][0], after["stance_dot"][0]])


# %%
# A steady gait is a fixed point of the map from one step to the next. It is
# stable if the eigenvalues of the derivative lie inside of the unit circle.

gait = fsolve(lambda start: step(start) - start, [0.2, -0.2], xtol=1e-13)
published = np.array([0.20031090049483, -0.19983247291764])
print(f"steady gait {gait}, published {published}")
assert abs(gait - published).max() < 1e-8
shift = 1e-5 * np.eye(2)
columns = [(step(gait + d) - step(gait - d)) / 2e-5 for d in shift]
eigenvalues = np.linalg.eigvals(np.transpose(columns))
print(f"eigenvalues {eigenvalues.round(5)}")
assert abs(abs(eigenvalues) - 0.588).max() < 2e-3  # published

# %%
# A walk that begins with a longer step settles into the gait.

run = walk(0.21, -0.21, 90)
lengths = 2 * np.sin(run.events["strike"].after["stance"])
_, panel = plt.subplots()
panel.axhline(2 * np.sin(published[0]), color="0.5", label="published gait")
panel.plot(np.arange(1, 1 + len(lengths)), lengths, "o", label="walk")
panel.set(xlabel="step", ylabel="length of the step / leg")
panel.legend()

# %%
# Two steps of the gait. The swing leg is orange.

# sphinx_gallery_thumbnail_number = 2
_, panel = plt.subplots()
for begin in range(2):
    pose = walk(*gait, 3.88)(np.linspace(0, 3.88, 12))
    for a, b in zip(pose["stance"], pose["swing"], strict=True):
        x = begin * 2 * np.sin(gait[0]) + np.array([0, -np.sin(a)])
        panel.plot(x, [0, np.cos(a)], color="C0")
        ends = [x[1], x[1] + np.sin(b)]
        panel.plot(ends, [np.cos(a), np.cos(a) - np.cos(b)], color="C1", lw=1)
panel.axhline(0, color="0.5", zorder=0)
panel.set_aspect("equal")
panel.set_axis_off()
