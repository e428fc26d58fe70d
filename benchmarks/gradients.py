"""Gradients of the accelerations of robots by coordinates, speeds and torques, beside Pinocchio.

    pip install pin example-robot-data
    python benchmarks/gradients.py           # prints the table
    python benchmarks/gradients.py --write   # saves it: gradients.csv, for docs/many_bodies_measured.md

Robots of example-robot-data are read without loads of joints, with a motor in each joint. At a random state the
derivatives of the second rates of the joints, by their coordinates, rates and torques, are compared with Pinocchio's
`computeABADerivatives` (`apart` is the largest difference, relative to the largest derivative of its kind).
`one state` is a call of the compiled kernel for one lane through `ctypes`, `of 1,000 states` the time of each of 1,000
states in one call, which are computed in lanes. Pinocchio is called from Python, and the time of a call of its
`computeGeneralizedGravity` of a model without joints, which does nothing, is subtracted. All are the least of many.
"""

from __future__ import annotations

import sys
from ctypes import CFUNCTYPE, c_void_p
from pathlib import Path
from time import process_time

import numpy as np
from bodies import least
from robots import Reference, files
from saved_tables import save

import dalembert as da
from dalembert.model.model import CompiledModel

ROBOTS = (
    ("xarm_description/urdf/xarm7.urdf", False),
    ("ur_description/urdf/ur5_robot.urdf", False),
    ("hyq_description/robots/hyq_no_sensors.urdf", True),
    ("simple_humanoid_description/urdf/simple_humanoid.urdf", True),
)
HEADER = (
    "| robot | base | speeds | operations | derived, s | compiled, s | one state, us | of 1,000 states, us |"
    " Pinocchio, us | apart |\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|"
)


def own_times(model: CompiledModel, y: np.ndarray, p: np.ndarray) -> tuple[float, float]:
    """Return the microseconds of the derivatives at one state, and of each of 1,000 states in one call."""
    kernel, many = model.jacobian_kernel.kernel, 1000
    code = model.engine._code.of(kernel, 1)  # type: ignore[attr-defined]
    t, out = np.zeros(1), np.zeros(len(kernel.outputs))
    call = CFUNCTYPE(None, *[c_void_p] * 5)(int(code))
    arguments = [a.ctypes.data for a in (t, y, p, p, out)]
    one = least(lambda: call(*arguments))
    rows, parameters, times = np.tile(y, (many, 1)), np.tile(p, (many, 1)), np.zeros(many)
    return 1e6 * one, 1e6 / many * least(lambda: model.engine.rows(kernel, times, rows, parameters), 10, 2)


def row(path: Path, *, floating: bool) -> str:
    """Return a row of the table.

    Raises
    ------
    RuntimeError
        Where derivatives differ from those of Pinocchio.
    """
    import pinocchio as pin

    scene = da.Scene.from_urdf(path, floating_base=floating, joint_loads=False, actuated=True)
    model = da.compile_model(scene, formulation="minimal", cache=False)
    begin = process_time()
    kernel = model.jacobian_kernel
    derived = process_time() - begin
    layout, reference = model.layout, Reference(path, scene, floating=floating)
    rng = np.random.default_rng(4)
    q, rates, (q_pin, v, _) = reference.state(rng)
    free = len(q) - 7 if floating else len(q)
    torque = rng.uniform(-5, 5, free)
    inputs = dict(zip(layout.inputs, torque, strict=True))
    given = {**dict(zip(layout.coordinates, q, strict=True)), **dict(zip(layout.rates, rates, strict=True))}
    y, p = model.state(given, {}, inputs=inputs), model.parameter_vector({})
    begin = process_time()
    by_state, by_inputs = model.rate_jacobians(0.0, y, p, inputs=inputs)
    compiled = process_time() - begin
    data, pm, first = reference.model.createData(), reference.model, 6 if floating else 0
    tau = reference.into @ np.concatenate([np.zeros(first), torque])

    def gradients() -> None:
        pin.computeABADerivatives(pm, data, q_pin, v, tau)

    apart = 0.0
    own = by_state[-free:, len(q) - free : len(q)], by_state[-free:, -free:], by_inputs[-free:]
    for a, b in zip(own, pin.computeABADerivatives(pm, data, q_pin, v, tau), strict=True):
        b = (reference.into.T @ b @ reference.into)[first:, first:]
        apart = max(apart, float(np.max(np.abs(a - b)) / np.max(np.abs(b))))
    if apart > 1e-10:
        raise RuntimeError(f"{path.stem}: derivatives differ from those of Pinocchio by {apart:.1g}")
    empty = pin.Model()
    nothing, none = empty.createData(), np.zeros(0)
    call = least(lambda: pin.computeGeneralizedGravity(empty, nothing, none))
    theirs = 1e6 * (least(gradients) - call)
    one, many = own_times(model, y, np.zeros(len(p)) + np.nan_to_num(p))
    return (
        f"| {path.stem} | {'floating' if floating else 'fixed'} | {len(layout.state) - len(q)} |"
        f" {len(kernel.kernel.body):,} | {derived:.1f} | {compiled:.1f} | {one:.1f} | {many:.2f} | {theirs:.1f} |"
        f" {apart:.0e} |"
    )


def main(*, write: bool) -> None:
    """Print the table, or save it."""
    known = {str(path): path for path in files()}
    lines = [HEADER]
    for name, floating in ROBOTS:
        (path,) = (path for text, path in known.items() if text.endswith(name))
        lines.append(row(path, floating=floating))
        print(lines[-1], flush=True)
    if write:
        save("gradients", "\n".join(lines))


if __name__ == "__main__":
    main(write="--write" in sys.argv)
