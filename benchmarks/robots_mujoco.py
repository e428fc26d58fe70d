"""Accelerations of MJCF models against MuJoCo, whose constraints are disabled, at random states.

Needs the package mujoco, which the library's own environments do not have:

    python benchmarks/robots_mujoco.py                     # the models of tests/interop/robot_texts.py
    python benchmarks/robots_mujoco.py model.xml ...       # others; what a scene has no part for is skipped
    python benchmarks/robots_mujoco.py --references        # writes what the tests compare with
    pip install --no-deps dm_control gymnasium robosuite
    python benchmarks/robots_mujoco.py --packages --write  # their models; to robots_mujoco.csv
    python benchmarks/robots_mujoco.py --packages --menagerie FOLDER --write  # with a copy of mujoco_menagerie

Equalities are among the forces of neither, nor is what a scene has no part for: tendons, a fluid, other actuators.
Controls and forces are not clipped in MuJoCo, as they are not in a scene. Models of more than `MOST` coordinates are
read and not compared.
"""

from __future__ import annotations

import importlib.util
import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from exact import ROOT  # puts tests/ on the path
from saved_tables import save

import dalembert as da
from dalembert.interop.mjcf import SKIPPABLE
from interop.robot_texts import CRANE, PUCK

MODELS = {"crane": CRANE, "puck": PUCK}
STATES = 5
MOST = 45
PACKAGES = {
    "dm_control": ("suite", "locomotion/walkers/assets", "third_party"),
    "gymnasium": ("envs/mujoco/assets",),
    "robosuite": ("models/assets/robots", "models/assets/grippers"),
}
"""Packages whose models are read, and their folders."""


class Reference:
    """MuJoCo's model of a file, with constraints disabled."""

    def __init__(self, path: Path) -> None:
        import mujoco

        self.mujoco, self.model = mujoco, mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
        self.model.actuator_forcelimited[:], self.model.jnt_actfrclimited[:] = 0, 0

    def leave_out(self, scene: da.Scene) -> None:
        """Turn off what a scene has no part for: tendons, a fluid, and actuators that are not among its inputs."""
        model = self.model
        model.opt.density = model.opt.viscosity = 0.0
        model.tendon_stiffness[:], model.tendon_damping[:] = 0.0, 0.0
        served = {str(u.func.__name__) for u in scene.inputs}
        for place, name in enumerate(self.inputs()):
            if name not in served:
                model.actuator_gainprm[place], model.actuator_biasprm[place] = 0.0, 0.0

    def inputs(self) -> list[str]:
        """Return the names that inputs of a scene have for the actuators, in their order."""
        mujoco, model = self.mujoco, self.model

        def name(i: int) -> str:
            own = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i)
            return own or mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, model.actuator_trnid[i, 0])

        return [f"ctrl_{name(i)}" for i in range(model.nu)]

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
    return differences(path, da.Scene.from_mjcf(path, joint_loads="damping", skip=list(SKIPPABLE)))


def differences(path: Path, scene: da.Scene) -> float:
    """Return the same for a scene that was read."""
    equalities = {id(row) for row, _ in scene.constraint_names}
    scene.holonomic_constraints = tuple(row for row in scene.holonomic_constraints if id(row) not in equalities)
    reference, model = Reference(path), da.compile_model(scene, cache=False)
    reference.leave_out(scene)
    rng, errors = np.random.default_rng(5), []
    for _ in range(STATES):
        case = reference.state(rng)
        tables = reference.named(case, scene)
        q, rates, second = (np.array([table[name] for name in model.layout.coordinates]) for table in tables)
        given = dict(zip(reference.inputs(), case["ctrl"], strict=True))
        controls = {name: given[name] for name in model.layout.inputs}
        found = model.accelerations(0.0, q, rates, {}, inputs=controls)
        errors.append(np.max(np.abs(found - second)) / np.max(np.abs(second)))
    return float(max(errors))


def packaged(menagerie: Path | None) -> dict[str, Path]:
    """Return the models of packages, and of a copy of MuJoCo's menagerie, where one is given."""
    found = {} if menagerie is None else models_in(menagerie, menagerie, "menagerie")
    for package, folders in PACKAGES.items():
        spec = importlib.util.find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            raise SystemExit(f"{package} is not installed: pip install --no-deps {' '.join(PACKAGES)}")
        top = Path(spec.submodule_search_locations[0])
        for folder in folders:
            found |= models_in(top / folder, top, package)
    return found


def models_in(folder: Path, top: Path, prefix: str) -> dict[str, Path]:
    """Return files whose outermost element is <mujoco>, and that have bodies of their own and are no scenes of one."""
    found = {}
    for path in sorted(folder.rglob("*.xml")):
        text = path.read_text()
        robot = "<mujoco" in text and "<mujocoinclude" not in text and not path.name.startswith("scene")
        if robot and any(f"<{what}" in text for what in ("joint", "freejoint", "include")):
            found[f"{prefix}/{path.relative_to(top).with_suffix('')}"] = path
    return found


def read_and_compared(path: Path) -> tuple[int, str]:
    """Return the number of coordinates and the difference of a model, or 0 and why it is refused."""
    try:
        scene = da.Scene.from_mjcf(path, joint_loads="damping", skip=list(SKIPPABLE))
    except da.errors.DalembertError as reason:
        faults = [fault.strip() for fault in str(reason).split("\n  - ")[1:]]
        return 0, re.sub(r"^line \d+( of '[^']*')?: ", "", faults[0])
    count = len(scene.coordinates)
    if count > MOST:
        return count, ""
    try:
        return count, f"{differences(path, scene):.0e}"
    except ValueError as reason:  # MuJoCo refuses some of these files
        return count, f"MuJoCo: {str(reason).splitlines()[0][:60]}"


def table(rows: dict[str, tuple[int, str]]) -> str:
    """Return models as a table; `raised` has the error that a model raises."""
    lines = ["| model | coordinates | difference | raised |", "|---|--:|--:|---|"]
    for name, (count, text) in rows.items():
        figures = (count, text if text[:1].isdigit() else "", "") if count else ("", "", text.replace("'", "`"))
        lines.append(f"| {name} | {' | '.join(map(str, figures))} |")
    return "\n".join(lines)


def measure_packages(menagerie: Path | None, write: bool) -> None:
    """Print the table of models of packages; save it, and write its part of docs/robots_measured.md."""
    rows = {}
    for name, path in packaged(menagerie).items():
        rows[name] = read_and_compared(path)
        print(name, *rows[name], flush=True)
    text = table(rows)
    print(text)
    if write:
        save("robots_mujoco", text)


def main(arguments: list[str]) -> None:
    """Compare models, or write what the tests compare with."""
    if "--packages" in arguments:
        at = arguments.index("--menagerie") + 1 if "--menagerie" in arguments else 0
        measure_packages(Path(arguments[at]) if at else None, "--write" in arguments)
        return
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
