"""Accelerations of the chains of `chains` by Pinocchio, MuJoCo, Drake and Exudyn, each called from Python.

- Pinocchio: `aba`, the articulated-body algorithm.
- MuJoCo: `mj_forward` without contacts and constraints, with sparse Jacobians.
- Drake: `CalcTimeDerivatives` of a continuous `MultibodyPlant`, after the state was set anew.
- Exudyn: a step of its explicit Euler method on an `ObjectKinematicTree`: many steps in one call less one step in one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["LARGEST", "MOMENTS", "PEERS", "VALUES", "Evaluation", "axes"]

Vector = NDArray[np.float64]
VALUES = {"m": 1.0, "l": 0.5, "Ix": 0.01, "Iy": 0.02, "Iz": 0.03, "g": 9.81}
MOMENTS = VALUES["Ix"], VALUES["Iy"], VALUES["Iz"]
CENTRE = np.array([VALUES["l"] / 2, 0.0, 0.0])


class Evaluation(NamedTuple):
    """A call that evaluates accelerations `count` times, and one that does the same for nothing.

    `accelerations` are those of the state, (n,).
    """

    accelerations: Vector
    call: Callable[[], object]
    empty: Callable[[], object]
    count: int = 1


def axes(chain: str, n: int) -> str:
    """Return the axes of the joints of a chain."""
    return (("z" if chain == "planar" else "zyx") * n)[:n]


def _gravity(chain: str) -> list[float]:
    return [0.0, -VALUES["g"], 0.0] if chain == "planar" else [0.0, 0.0, -VALUES["g"]]


def _place(i: int) -> Vector:
    return np.array([VALUES["l"] if i else 0.0, 0.0, 0.0])


def _with_empty(
    make: Callable[[str, Vector, Vector], tuple[Callable[[], object], Callable[[], Vector]]],
) -> Callable[[str, Vector, Vector], Evaluation]:
    """Return the evaluation of a chain whose empty call is that of a chain without bodies."""

    def evaluation(chain: str, q: Vector, qdot: Vector) -> Evaluation:
        call, read = make(chain, q, qdot)
        empty, _ = make(chain, q[:0], qdot[:0])
        call()
        return Evaluation(read().copy(), call, empty)

    return evaluation


def _pinocchio(chain: str, q: Vector, qdot: Vector) -> tuple[Callable[[], object], Callable[[], Vector]]:
    import pinocchio as pin

    model, joint = pin.Model(), 0
    for i, axis in enumerate(axes(chain, len(q))):
        turn = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}[axis]()
        joint = model.addJoint(joint, turn, pin.SE3(np.eye(3), _place(i)), f"q{i}")
        model.appendBodyToJoint(joint, pin.Inertia(VALUES["m"], CENTRE, np.diag(MOMENTS)), pin.SE3.Identity())
    model.gravity.linear = np.array(_gravity(chain))
    data, nothing, aba = model.createData(), np.zeros(len(q)), pin.aba
    return lambda: aba(model, data, q, qdot, nothing), lambda: np.array(data.ddq)


def _mujoco(chain: str, q: Vector, qdot: Vector) -> tuple[Callable[[], object], Callable[[], Vector]]:
    import mujoco

    spec = mujoco.MjSpec()
    spec.compiler.balanceinertia, spec.compiler.boundmass = False, 0.0
    spec.option.gravity = _gravity(chain)
    body = spec.worldbody
    for i, axis in enumerate(axes(chain, len(q))):
        inertial = {"mass": VALUES["m"], "ipos": CENTRE, "inertia": MOMENTS, "explicitinertial": True}
        body = body.add_body(pos=_place(i), **inertial)
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=np.eye(3)["xyz".index(axis)])
    model = spec.compile()
    disable = mujoco.mjtDisableBit
    model.opt.disableflags |= int(disable.mjDSBL_CONSTRAINT) | int(disable.mjDSBL_CONTACT)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    data, forward = mujoco.MjData(model), mujoco.mj_forward
    data.qpos[:], data.qvel[:] = q, qdot
    return lambda: forward(model, data), lambda: np.array(data.qacc)


def _drake(chain: str, q: Vector, qdot: Vector) -> tuple[Callable[[], object], Callable[[], Vector]]:
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RotationalInertia, SpatialInertia

    plant = MultibodyPlant(0.0)
    body = plant.world_body()
    inertia = SpatialInertia.MakeFromCentralInertia(VALUES["m"], CENTRE, RotationalInertia(*MOMENTS))
    for i, axis in enumerate(axes(chain, len(q))):
        place = FixedOffsetFrame(f"F{i}", body.body_frame(), RigidTransform(_place(i)))
        frame, body = plant.AddFrame(place), plant.AddRigidBody(f"body{i}", inertia)
        plant.AddJoint(RevoluteJoint(f"q{i}", frame, body.body_frame(), np.eye(3)["xyz".index(axis)]))
    plant.mutable_gravity_field().set_gravity_vector(_gravity(chain))
    plant.Finalize()
    context, rates, state = plant.CreateDefaultContext(), plant.AllocateTimeDerivatives(), np.concatenate([q, qdot])

    def call() -> None:
        plant.SetPositionsAndVelocities(context, state)
        plant.CalcTimeDerivatives(context, rates)

    return call, lambda: np.asarray(rates.CopyToVector()[len(q) :])


def _exudyn(chain: str, q: Vector, qdot: Vector) -> Evaluation:
    import exudyn as exu

    container = exu.SystemContainer()
    system = container.AddSystem()
    system.AddNode(exu.itemInterface.NodeGenericODE2(**_coordinates(q, qdot)))
    system.AddObject(exu.itemInterface.ObjectKinematicTree(nodeNumber=0, **_kinematic_tree(chain, len(q))))
    system.Assemble()
    settings = exu.SimulationSettings()
    integration, solution = settings.timeIntegration, settings.solution
    integration.explicit.computeEndOfStepAccelerations = False
    solution.file.write, solution.sensors.writePeriod, step = False, 1.0, 1e-9

    def run(steps: int) -> object:
        integration.numberOfSteps, integration.endTime = steps, steps * step
        return system.SolveDynamic(settings, solverType=exu.DynamicSolverType.ExplicitEuler)

    run(1)
    found = np.array(system.systemData.GetODE2Coordinates_tt())
    count = int(np.clip(20_000 / len(q) ** 2, 1, 1000))
    _keep = container  # the system belongs to it
    return Evaluation(found, lambda: run(count + 1), lambda: (run(1), _keep), count)


def _coordinates(q: Vector, qdot: Vector) -> dict[str, Any]:
    return {
        "referenceCoordinates": [0.0] * len(q),
        "initialCoordinates": list(q),
        "initialCoordinates_t": list(qdot),
        "numberOfODE2Coordinates": len(q),
    }


def _kinematic_tree(chain: str, n: int) -> dict[str, Any]:
    import exudyn as exu

    turns, places, inertias, centres = exu.Matrix3DList(), exu.Vector3DList(), exu.Matrix3DList(), exu.Vector3DList()
    for i in range(n):
        turns.Append(np.eye(3))
        places.Append(_place(i))
        inertias.Append(np.diag(MOMENTS))
        centres.Append(CENTRE)
    return {
        "jointTypes": [getattr(exu.JointType, f"Revolute{axis.upper()}") for axis in axes(chain, n)],
        "linkParents": [i - 1 for i in range(n)],
        "jointTransformations": turns,
        "jointOffsets": places,
        "linkInertiasCOM": inertias,
        "linkCOMs": centres,
        "linkMasses": [VALUES["m"]] * n,
        "baseOffset": [0.0, 0.0, 0.0],
        "gravity": _gravity(chain),
    }


PEERS: dict[str, Callable[[str, Vector, Vector], Evaluation]] = {
    "Pinocchio": _with_empty(_pinocchio),
    "MuJoCo": _with_empty(_mujoco),
    "Drake": _with_empty(_drake),
    "Exudyn": _exudyn,
}
"""What makes the evaluation of a chain at a state, by the name of the program."""

LARGEST = {"Pinocchio": 500}
"""Most bodies of programs that have such a limit: data of Pinocchio hold four arrays of n^3 numbers, 32 GB of 1,000."""
