"""Robots in free flight: what of energy, momentum and angular momentum changes over 100 s.

Needs the package example-robot-data, which the library's own environments do not have:

    pip install example-robot-data
    python benchmarks/robots_flight.py                 # the robots of the table
    python benchmarks/robots_flight.py solo12 talos    # robots by names of files

A robot without loads of joints and without gravity starts with random angles and rates of its joints, and turns.
Momenta are those of the mass matrix; changes of the angular momentum about the origin are relative to the largest of
its terms. Columns: robot, bodies, coordinates, rtol, changes of energy, momentum, angular momentum and of e.e,
processor seconds of compilation and of the run.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from robots import files, spun

import dalembert as da

END, SAMPLES = 100.0, 201
CHOSEN = ("quadrotor_base", "solo12", "bolt", "simple_humanoid")
TOLERANCES = (1e-10, 1e-13)


def momenta(model: Any, q: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return momentum and angular momentum about the origin (k, 3), and the largest of its terms, at rows of states."""
    generalised = np.einsum("kij,kj->ki", model.mass_matrix(q, {}), rates)
    linear, turned = generalised[:, :3], np.empty((len(q), 3))
    for k, (e, power) in enumerate(zip(q[:, 3:7], generalised[:, 3:7], strict=True)):
        a, b, c, d = e
        fixed = np.array([[-b, a, -d, c], [-c, d, a, -b], [-d, -c, b, a]])  # omega = 2 fixed e_dot on fixed axes
        turned[k] = 0.5 * fixed @ power
    carried = np.cross(q[:, :3], linear)
    return linear, turned + carried, float(np.max(np.linalg.norm([turned, carried], axis=2)))


def changes(path: Path) -> None:
    """Print a row for each tolerance."""
    scene = da.Scene.from_urdf(path, floating_base=True, joint_loads=False, gravity=(0, 0, 0))
    begin = time.process_time()
    model = da.compile_model(scene, outputs=["energy"])
    names, compiled = model.layout.coordinates, time.process_time() - begin
    rng = np.random.default_rng(1)
    joints = len(names) - 7
    e = rng.normal(size=4)
    e /= np.linalg.norm(e)
    q = np.concatenate([np.zeros(3), e, rng.uniform(-0.5, 0.5, joints)])
    turning = spun(e) @ [0.3, -0.2, 0.4] / 2
    rates = np.concatenate([[0.1, 0.2, -0.1], turning, rng.uniform(-0.5, 0.5, joints)])
    start = dict(zip(names, q, strict=True)) | {f"{name}_dot": x for name, x in zip(names, rates, strict=True)}
    for rtol in TOLERANCES:
        begin = time.process_time()
        run = model.simulate((0, END), start, {}, rtol=rtol, atol=rtol, t_eval=np.linspace(0, END, SAMPLES))
        seconds = time.process_time() - begin
        linear, angular, size = momenta(model, run.q, run.qdot)
        parts = [np.ptp(run["energy"]) / run["energy"][0]]
        sizes = float(np.linalg.norm(linear[0])), size
        parts += [
            np.max(np.linalg.norm(x - x[0], axis=1)) / most for x, most in zip((linear, angular), sizes, strict=True)
        ]
        parts.append(float(np.max(np.abs(np.sum(run.q[:, 3:7] ** 2, axis=1) - 1))))
        cells = [path.stem, len(scene.bodies), len(names), f"{rtol:.0e}", *(f"{part:.0e}" for part in parts)]
        assert run.success, run.message
        print(f"| {' | '.join(map(str, cells))} | {compiled:.0f} | {seconds:.1f} |", flush=True)


if __name__ == "__main__":
    chosen = sys.argv[1:] or CHOSEN
    for name in chosen:
        changes(next(path for path in files() if path.stem == name))
