"""Robots of example-robot-data: which URDF files load, and accelerations against Pinocchio.

Needs the packages pin and example-robot-data, which the library's own environments do not have:

    pip install pin example-robot-data
    python benchmarks/robots.py            # prints the table
    python benchmarks/robots.py --write    # saves it: robots.csv, from which docs/robots_measured.md is written
    python benchmarks/robots.py panda ur5  # some robots
    python benchmarks/robots.py --all      # larger robots with a floating base, too, which takes half an hour

Each robot is read as it stands in its file (fixed base) and with a floating base, without loads of joints. At five
random states its accelerations are compared with those that Pinocchio's mass matrix and bias give, where joints that
mimic others are eliminated: `error` is the largest difference relative to the largest acceleration, `residual` that of
the equations M a + h = 0 relative to the sizes of their terms.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from saved_tables import save

import dalembert as da

STATES = 5
MOST = 23
"""Coordinates of robots that are measured with a floating base, without --all."""


def files() -> list[Path]:
    """Return the URDF files of example-robot-data."""
    for place in sys.path:
        folder = Path(place) / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
        if folder.is_dir():
            return sorted(folder.rglob("*.urdf"))
    raise SystemExit("example-robot-data is not installed: pip install pin example-robot-data")


class Reference:
    """Pinocchio's model of a file: mass matrix and bias at states in the coordinates of a scene."""

    def __init__(self, path: Path, scene: da.Scene, *, floating: bool) -> None:
        import pinocchio as pin

        self.pin, self.floating = pin, floating
        root = (pin.JointModelFreeFlyer(),) if floating else ()
        self.model = pin.buildModelFromUrdf(str(path), *root)
        self.data = self.model.createData()
        self.names = [str(q.func.__name__) for q in scene.coordinates]
        joints = scene.robot.joints
        columns = [name for name, joint in joints.items() if joint.coordinates]
        first = 6 if floating else 0
        self.into = np.zeros((self.model.nv, first + len(columns)))
        self.into[:first, :first] = np.eye(first)
        self.offsets = np.zeros(self.model.nv)
        for name, joint in joints.items():
            row = self.model.joints[self.model.getJointId(name)].idx_v
            values = [float(joint.value.subs(dict.fromkeys(scene.coordinates, v))) for v in (0, 1)]
            followed = next(c for c in columns if joints[c].value in joint.value.atoms(type(joints[c].value)))
            self.into[row, first + columns.index(followed)] = values[1] - values[0]
            self.offsets[row] = values[0]

    def state(self, rng: Any) -> tuple[np.ndarray, np.ndarray, tuple[Any, ...]]:
        """Return coordinates and rates of the scene at a random state, and what Pinocchio needs for it."""
        pin, model = self.pin, self.model
        first = 6 if self.floating else 0
        free = self.into.shape[1] - first
        values, rates = rng.uniform(-3, 3, free), rng.uniform(-1, 1, free)
        z = np.concatenate([rng.uniform(-1, 1, first), rates])
        v = self.into @ z
        angles = self.into[:, first:] @ values + self.offsets
        q = pin.neutral(model)
        for joint in list(model.joints)[1:]:
            if joint.nv == 6:
                continue
            angle = angles[joint.idx_v]
            q[joint.idx_q : joint.idx_q + joint.nq] = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        own, own_rates = values, rates
        if self.floating:
            e = rng.normal(size=4)
            e /= np.linalg.norm(e)
            place = rng.uniform(-1, 1, 3)
            q[:3], q[3:7] = place, (*e[1:], e[0])
            turn = pin.Quaternion(q[6], q[3], q[4], q[5]).matrix()
            own = np.concatenate([place, e, values])
            own_rates = np.concatenate([turn @ z[:3], 0.5 * spun(e) @ z[3:6], rates])
        return own, own_rates, (q, v, z)

    def equations(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the reduced mass matrix and bias."""
        pin = self.pin
        upper = np.triu(pin.crba(self.model, self.data, q))
        full = upper + np.triu(upper, 1).T
        bias = pin.nonLinearEffects(self.model, self.data, q, v)
        return self.into.T @ full @ self.into, self.into.T @ bias

    def reduced(self, own: np.ndarray, rates: np.ndarray, second: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return second rates of the scene as accelerations of Pinocchio's free velocities."""
        if not self.floating:
            return second
        e, e_dot, e_ddot = own[3:7], rates[3:7], second[3:7]
        turn = self.pin.Quaternion(*e).matrix()
        alpha = 2 * spun(e).T @ (e_ddot - 0.5 * spun(e_dot) @ z[3:6])
        linear = turn.T @ second[:3] - np.cross(z[3:6], z[:3])
        return np.concatenate([linear, alpha, second[7:]])


def spun(e: np.ndarray) -> np.ndarray:
    """Return the matrix (4, 3) of e_dot = matrix omega / 2, omega on the body."""
    a, b, c, d = e
    return np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]])


def measured(path: Path, *, floating: bool) -> dict[str, Any]:
    """Return a row of the table: sizes, seconds and differences, or why the robot is refused."""
    folder = path.parts[path.parts.index("robots") + 1].removesuffix("_description")
    row: dict[str, Any] = {"name": f"{folder}/{path.stem}", "floating": floating}
    try:
        start = time.process_time()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scene = da.Scene.from_urdf(path, floating_base=floating, joint_loads=False)
        row["warned"] = "; ".join(str(each.message) for each in caught)
        row["read"] = time.process_time() - start
        row |= {"links": len(scene.robot.links), "bodies": len(scene.bodies), "coordinates": len(scene.coordinates)}
        start = time.process_time()
        model = da.compile_model(scene, cache=False)
        row["compile"] = time.process_time() - start
    except da.errors.DalembertError as reason:
        row["refused"] = str(reason)
        return row
    reference = Reference(path, scene, floating=floating)
    rng, errors, residuals = np.random.default_rng(1), [], []
    for _ in range(STATES):
        q, rates, (pin_q, v, z) = reference.state(rng)
        matrix, bias = reference.equations(pin_q, v)
        exact = np.linalg.solve(matrix, -bias)
        found = reference.reduced(q, rates, model.accelerations(0.0, q, rates, {}), z)
        errors.append(np.max(np.abs(found - exact)) / max(np.max(np.abs(exact)), 1e-300))
        sizes = np.abs(matrix) @ np.abs(found) + np.abs(bias)
        residuals.append(np.max(np.abs(matrix @ found + bias)) / max(np.max(sizes), 1e-300))
    return row | {"error": max(errors), "residual": max(residuals)}


def first_fault(text: str) -> str:
    """Return the first of the faults of an error, and how many more there are."""
    head, *faults = text.split("\n  - ")
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return (faults[0] if faults else head) + more


def cells(fixed: dict[str, Any] | None, floating: dict[str, Any] | None) -> list[str]:
    """Return the sizes of a robot with a fixed base, and pairs of what was measured with a fixed and a floating one."""
    sizes = fixed or {"links": floating["links"], "bodies": floating["bodies"] - 1, "coordinates": 0}
    formats = {"read": ".2f", "compile": ".2f", "error": ".0e", "residual": ".0e"}
    pairs = [[format(row[key], form) if row else "-" for row in (fixed, floating)] for key, form in formats.items()]
    return [*(str(sizes[key]) for key in ("links", "bodies", "coordinates")), *map(", ".join, pairs)]


HEAD = "| robot | links | bodies | coordinates | read [s] | compile [s] | error | residual | raised |"


def table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a table, a line a robot; `raised` has the errors that it raises."""
    lines = [HEAD, "|---|--:|--:|--:|--:|--:|--:|--:|---|"]
    for name in dict.fromkeys(row["name"] for row in rows):
        own = {row["floating"]: row for row in rows if row["name"] == name}
        loaded = [own[base] if "refused" not in own.get(base, {"refused": 0}) else None for base in (False, True)]
        raised: dict[str, list[str]] = {}
        for floating, row in own.items():
            if "refused" in row:
                raised.setdefault(first_fault(row["refused"]), []).append("floating" if floating else "fixed")
        figures = cells(*loaded) if any(loaded) else [""] * 7
        told = "; ".join(f"{' and '.join(bases)} base: {fault}" for fault, bases in raised.items())
        lines.append(f"| {name} | {' | '.join(figures)} | {told} |")
    return "\n".join(lines)


def main(arguments: list[str]) -> None:
    """Measure the robots that are named, or all."""
    names = [name for name in arguments if not name.startswith("--")]
    chosen = [path for path in files() if not names or path.stem in names]
    rows = []
    for path in chosen:
        for floating in (False, True):
            if floating and "--all" not in arguments and rows[-1].get("coordinates", 0) > MOST:
                continue
            rows.append(measured(path, floating=floating))
            print({key: f"{v:.2g}" if isinstance(v, float) else v for key, v in rows[-1].items()}, flush=True)
    text = table(rows)
    print(text)
    if "--write" in arguments:
        save("robots", text)


if __name__ == "__main__":
    main(sys.argv[1:])
