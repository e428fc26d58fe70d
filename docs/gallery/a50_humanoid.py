"""
How does a humanoid fall?
=========================

A humanoid of nine bodies is read from a file, dropped, and falls without a
controller. Joints have springs and dampers. Feet, hands, hips and head are
spheres above a rough floor, with Coulomb's law and impacts. None is a spring.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from sympy import symbols

import dalembert as da

# %%
# The file is written in MJCF, once for both sides.

SIDE = """
<body name="thigh_SIDE" pos="0 HIP 0">
  <joint name="spread_SIDE" axis="1 0 0" stiffness="60"/>
  <joint name="hip_SIDE" stiffness="30" springref="-0.3"/>
  <geom fromto="0 0 0 0 0 -0.4" size="0.07" mass="8"/>
  <body name="shank_SIDE" pos="0 0 -0.4">
    <joint name="knee_SIDE" stiffness="30" springref="0.6"/>
    <geom fromto="0 0 0 0 0 -0.4" size="0.05" mass="4"/>
  </body>
</body>
<body name="arm_SIDE" pos="0 ARM 0.45">
  <joint name="shoulder_SIDE" stiffness="10" springref="-0.6"/>
  <geom fromto="0 0 0 0 0 -0.28" size="0.045" mass="2"/>
  <body name="forearm_SIDE" pos="0 0 -0.28">
    <joint name="elbow_SIDE" stiffness="8" springref="-0.6"/>
    <geom fromto="0 0 0 0 0 -0.26" size="0.04" mass="1.5"/>
  </body>
</body>"""
left = SIDE.replace("SIDE", "left").replace("HIP", "0.1").replace("ARM", "0.2")
right = SIDE.replace("SIDE", "right").replace("HIP", "-0.1")
right = right.replace("ARM", "-0.2")
TEXT = f"""<mujoco model="humanoid"><compiler angle="radian"/>
<default>
  <geom type="capsule" contype="0" conaffinity="0"/>
  <joint axis="0 1 0" damping="3"/>
</default>
<worldbody><body name="trunk"><freejoint name="base"/>
  <geom fromto="0 0 0.05 0 0 0.42" size="0.12" mass="28"/>
  <geom type="sphere" pos="0 0 0.68" size="0.11" mass="4"/>
  {left}{right}
</body></worldbody></mujoco>"""
with TemporaryDirectory() as folder:
    path = Path(folder, "humanoid.xml")
    path.write_text(TEXT)
    scene = da.Scene.from_mjcf(path)

# %%
# The ends of limbs touch the floor. Two rough contacts of one rigid body
# would share friction forces indeterminately, so the head is smooth.

mu = symbols("mu")
ends = {"hips": ("trunk", 0.05, 0.12), "head": ("trunk", 0.68, 0.11)}
for side in ("left", "right"):
    ends[f"foot_{side}"] = f"shank_{side}", -0.4, 0.05
    ends[f"hand_{side}"] = f"forearm_{side}", -0.26, 0.04
floor = scene.origin, scene.frame.z
for name, (part, height, radius) in ends.items():
    link = scene.robot.links[part]
    sphere = {"centre": link.point.locatenew(name, height * link.frame.z)}
    sphere |= {"radius": radius, "friction": 0 if name == "head" else mu}
    scene.add_contacts(da.SpherePlane(name, body=part, plane=floor, **sphere))
scene.add_shapes({"floor": da.Ground(scene.frame.z)})
scene.add_shapes({"tracks": da.Path(scene.robot.links["trunk"].point)})
gaps = [f"{name}.gap" for name in ends]
model = da.compile_model(scene, outputs=["energy", *gaps])

# %%
# It is dropped while it walks: one foot lands, both slip, the legs fold.

pose = dict.fromkeys(model.layout.coordinates, 0)
pose |= {"base_z": 0.95, "base_e0": 1, "spread_left": 0.05}
pose |= {"hip_left": -0.5, "hip_right": -0.1, "spread_right": -0.08}
pose |= {"knee_left": 0.7, "knee_right": 0.4, "elbow_left": -0.5}
pose |= {"shoulder_left": -0.5, "shoulder_right": -0.3, "elbow_right": -0.5}
pose |= {f"{name}_dot": 0 for name in model.layout.coordinates}
pose |= {"base_x_dot": 1, "base_y_dot": 0.1}
fall = model.simulate((0, 1.5), pose, {mu: 0.4}, rtol=1e-6, atol=1e-8)

# %%
# Energy never grows: of weight, springs and motion, floor and dampers only
# take. In flight, nothing changes the horizontal momentum and the angular
# momentum about the vertical axis, and no sphere enters the floor.

times = np.linspace(0, fall.t_end, 3001)
dense = fall(times)
growth = np.max(np.diff(dense["energy"]))
deepest = min(dense[gap].min() for gap in gaps)

flight = fall(np.linspace(0, fall.phases[0].t1 * (1 - 1e-12), 50))
q = flight.q
momenta = np.einsum("kij,kj->ki", model.mass_matrix(q, {mu: 0.4}), flight.qdot)
a, b, c, d = q[:, 3:7].T
turning = np.column_stack([-d, -c, b, a]) / 2  # 2 e_dot to omega_z
turn = np.sum(turning * momenta[:, 3:7], axis=1)
turn += q[:, 0] * momenta[:, 1] - q[:, 1] * momenta[:, 0]
changes = [np.ptp(momenta[:, 0]), np.ptp(momenta[:, 1]), np.ptp(turn)]
weight = momenta[:, 2] - momenta[0, 2] + 63 * 9.81 * flight.t

hit = {}
for phase in fall.phases:
    for name, mode in phase.modes.items():
        if mode != "open":
            hit.setdefault(name, phase.t0)
print(f"{len(fall.phases)} phases;", end=" ")
print(", ".join(f"{name} at {t:.2f} s" for name, t in hit.items()))
first, last = dense["energy"][[0, -1]]
print(f"energy falls from {first:.0f} to {last:.0f} J")
print(f"momenta change by {max(changes):.0e} in flight")
print(f"no sphere is deeper in the floor than {-deepest:.0e} m")
assert fall.success and {*hit} >= {"foot_left", "foot_right", "hand_left"}
assert growth < 1e-9 and deepest > -1e-9
assert max(changes) < 1e-6 and np.max(np.abs(weight)) < 1e-6

# %%
_, panel = plt.subplots()
for name in ("hips", "head", "hand_left", "foot_left"):
    panel.plot(times, dense[f"{name}.gap"], label=name.replace("_", ", "))
panel.set(xlabel="t [s]", ylabel="distance from the floor [m]")
panel.legend()

# %%
# The fall, at half its speed.

# sphinx_gallery_thumbnail_number = -1
fall(np.linspace(0, fall.t_end, 90)).animate(fps=30, speed=0.5)
