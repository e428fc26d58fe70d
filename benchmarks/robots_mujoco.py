"""Accelerations of MJCF models against MuJoCo, whose constraints are disabled, at random states.

Needs the package mujoco, which the library's own environments do not have:

    python benchmarks/robots_mujoco.py                 # the models of tests/interop/robot_texts.py
    python benchmarks/robots_mujoco.py model.xml ...   # others; what a scene has no part for is skipped
    python benchmarks/robots_mujoco.py --references    # writes what the tests compare with

Actuators and equalities are among the forces of neither, as far as the scene does not have them.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from exact import ROOT  # puts tests/ on the path

import dalembert as da
from dalembert.interop.mjcf import SKIPPABLE
from interop.robot_texts import CRANE, PUCK

MODELS = {"crane": CRANE, "puck": PUCK}
STATES = 5


class Reference:
    """MuJoCo's model of a file, with constraints disabled."""

    def __init__(self, path: Path) -> None:
        import mujoco

        self.mujoco, self.model = mujoco, mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT

    def state(self, rng: Any) -> dict[str, list[float]]:
        """Return positions, velocities, controls and accelerations of a random state."""
        mujoco, model, data = self.mujoco, self.model, self.data
        data.qpos[:] = rng.normal(size=model.nq).round(3)
        data.qvel[:] = rng.normal(size=model.nv).round(3)
        data.ctrl[:] = rng.normal(size=model.nu).round(3)
        for joint in range(model.njnt):
            at, kind = model.jnt_qposadr[joint], mujoco.mjtJoint(model.jnt_type[joint])
            if kind in (mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_FREE):
                first = at + (3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0)
                signs = np.sign(rng.normal(size=4))
                data.qpos[first : first + 4] = 0.5 * signs
        mujoco.mj_forward(model, data)
        named = {"qpos": data.qpos, "qvel": data.qvel, "ctrl": data.ctrl, "qacc": data.qacc}
        return {name: values.tolist() for name, values in named.items()}

    def named(self, case: dict[str, list[float]], scene: da.Scene) -> tuple[dict[str, float], ...]:
        """Return positions, rates and second rates of a state by the names of the coordinates of a scene."""
        found: tuple[dict[str, float], ...] = ({}, {}, {})
        q, v, a = (np.array(case[name]) for name in ("qpos", "qvel", "qacc"))
        joints = list(scene.robot.joints.values())
        if len(joints) != self.model.njnt:
            raise SystemExit("joints of the scene and of MuJoCo differ")
        order = {self.mujoco.mj_id2name(self.model, self.mujoco.mjtObj.mjOBJ_JOINT, i): i for i in range(len(joints))}
        for place, joint in enumerate(joints):
            number = order.get(joint.name, place)
            at, dof = self.model.jnt_qposadr[number], self.model.jnt_dofadr[number]
            names = [str(c.func.__name__) for c in joint.coordinates]
            free = len(names) if len(names) < 4 else len(names) - 4
            values = [q[at : at + free], v[dof : dof + free], a[dof : dof + free]]
            if len(names) > free:
                e, w, alpha = (
                    q[at + free : at + free + 4],
                    v[dof + free : dof + free + 3],
                    a[dof + free : dof + free + 3],
                )
                rate = 0.5 * spun(e) @ w
                turning = e, rate, 0.5 * (spun(e) @ alpha + spun(rate) @ w)
                values = [np.concatenate(pair) for pair in zip(values, turning, strict=True)]
            for table, row in zip(found, values, strict=True):
                table |= dict(zip(names, row.tolist(), strict=True))
        return found


def spun(e: np.ndarray) -> np.ndarray:
    """Return the matrix (4, 3) of e_dot = matrix omega / 2, omega on the body."""
    a, b, c, d = e
    return np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]])


def compared(path: Path) -> float:
    """Return the largest difference of accelerations relative to the largest acceleration."""
    scene = da.Scene.from_mjcf(path, joint_loads="damping", skip=list(SKIPPABLE))
    equalities = {id(row) for row, _ in scene.constraint_names}
    scene.holonomic_constraints = tuple(row for row in scene.holonomic_constraints if id(row) not in equalities)
    reference, model = Reference(path), da.compile_model(scene, cache=False)
    rng, errors = np.random.default_rng(5), []
    for _ in range(STATES):
        case = reference.state(rng)
        tables = reference.named(case, scene)
        q, rates, second = (np.array([table[name] for name in model.layout.coordinates]) for table in tables)
        controls = dict(zip(model.layout.inputs, case["ctrl"], strict=True))
        found = model.accelerations(0.0, q, rates, {}, inputs=controls)
        errors.append(np.max(np.abs(found - second)) / np.max(np.abs(second)))
    return float(max(errors))


def main(arguments: list[str]) -> None:
    """Compare models, or write what the tests compare with."""
    with tempfile.TemporaryDirectory() as folder:
        paths = {name: Path(name) for name in arguments if not name.startswith("--")}
        if not paths:
            for name, text in MODELS.items():
                paths[name] = Path(folder) / f"{name}.xml"
                paths[name].write_text(text)
        if "--references" in arguments:
            rng = np.random.default_rng(5)
            cases = {name: [Reference(path).state(rng) for _ in range(2)] for name, path in paths.items()}
            about = "MuJoCo's mj_forward, constraints disabled: benchmarks/robots_mujoco.py --references"
            text = json.dumps({"source": about, **cases}, indent=1)
            (ROOT / "tests" / "interop" / "mujoco_references.json").write_text(text + "\n")
            return
        for name, path in paths.items():
            print(f"{name}: {compared(path):.0e}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
