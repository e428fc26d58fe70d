"""Motions of mechanisms by other programs: Pinocchio, MuJoCo, Drake, Exudyn, and SymPy's equations with SciPy.

Each contender is a name, the settings to try from loose to tight, and a function that makes a run for a setting. A run
returns what is observed at the end. A package that is not installed is left out.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "TOLERANCES",
    "Contender",
    "Robot",
    "Vector",
    "installed",
    "robot_contenders",
    "robot_file",
    "robot_reference",
]

Vector = NDArray[np.float64]
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)


@dataclass(frozen=True)
class Contender:
    """A program and a method of it.

    Attributes
    ----------
    name : str
        The program, and the method in words.
    settings : sequence of float
        Tolerances or step sizes, from loose to tight.
    make : function
        Takes a setting and returns the run, a function without arguments; what need not be repeated is done before.
    """

    name: str
    settings: Sequence[float]
    make: Callable[[float], Callable[[], Vector]]


# Robots of URDF files.


def robot_file(path: Path) -> Path:
    """Return a copy of a URDF file without shapes, damping and friction."""
    tree = ElementTree.parse(path)
    root = tree.getroot()
    unwanted = {"link": ("visual", "collision"), "joint": ("dynamics", "safety_controller", "calibration")}
    for tag, parts in unwanted.items():
        for element in root.iter(tag):
            for part in [x for x in element if x.tag in parts]:
                element.remove(part)
    for part in [x for x in root if x.tag in ("transmission", "gazebo", "ros2_control")]:
        root.remove(part)
    copy = Path(tempfile.mkdtemp()) / path.name
    tree.write(copy)
    return copy


@dataclass(frozen=True)
class Robot:
    """A motion of a robot with a fixed base: joint angles [rad] and rates [rad/s] at the start, by names of joints."""

    path: Path
    angles: Mapping[str, float]
    rates: Mapping[str, float]
    end: float

    def start(self, names: Sequence[str]) -> tuple[Vector, Vector]:
        """Return angles and rates in the order of the names."""
        return np.array([self.angles[x] for x in names]), np.array([self.rates[x] for x in names])

    @property
    def start_by_name(self) -> dict[str, float]:
        """Angles and rates as `simulate` takes them."""
        return {**self.angles, **{f"{name}_dot": rate for name, rate in self.rates.items()}}

    def in_order(self, names: Sequence[str]) -> list[int]:
        """Return the places of the joints among the names."""
        return [list(names).index(name) for name in self.angles]


def _pinocchio(robot: Robot) -> tuple[Callable[[float, Vector], Vector], Vector, list[int]]:
    """Return the rates of the state by the articulated-body algorithm, the start, and places of joints."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(robot.path))
    data, n = model.createData(), model.nv
    names = list(model.names)[1:]
    zero = np.zeros(n)

    def rates(_t: float, y: Vector) -> Vector:
        return np.concatenate((y[n:], pin.aba(model, data, y[:n], y[n:], zero)))

    return rates, np.concatenate(robot.start(names)), robot.in_order(names)


def robot_reference(robot: Robot) -> Vector:
    """Return the angles at the end, by Pinocchio's accelerations and SciPy's DOP853 at 1e-13."""
    return _scipy(robot, 1e-13)()


def _scipy(robot: Robot, tolerance: float) -> Callable[[], Vector]:
    from scipy.integrate import solve_ivp

    rates, start, order = _pinocchio(robot)

    def run() -> Vector:
        found = solve_ivp(rates, (0.0, robot.end), start, "DOP853", [robot.end], rtol=tolerance, atol=tolerance)
        return np.asarray(found.y[order, -1])

    return run


def _mujoco(robot: Robot, step: float) -> Callable[[], Vector]:
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(robot.path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    steps = round(robot.end / step)
    model.opt.timestep = robot.end / steps
    data = mujoco.MjData(model)
    names = [model.joint(i).name for i in range(model.njnt)]
    angles, rates = robot.start(names)
    order = robot.in_order(names)

    def run() -> Vector:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = angles, rates
        mujoco.mj_step(model, data, nstep=steps)
        return np.array(data.qpos[order])

    return run


def _drake(robot: Robot, accuracy: float, scheme: str = "runge_kutta3") -> Callable[[], Vector]:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

    plant = MultibodyPlant(0.0)
    instance = Parser(plant).AddModels(str(robot.path))[0]
    base = plant.get_body(plant.GetBodyIndices(instance)[0])
    if not any(plant.get_joint(i).child_body().index() == base.index() for i in plant.GetJointIndices(instance)):
        plant.WeldFrames(plant.world_frame(), base.body_frame())
    plant.Finalize()
    joints = [plant.get_joint(i) for i in plant.GetJointIndices(instance)]
    names = [joint.name() for joint in joints if joint.num_velocities()]
    (angles, rates), order = robot.start(names), robot.in_order(names)
    simulator = Simulator(plant)
    ResetIntegratorFromFlags(simulator, scheme, robot.end / 4)
    simulator.get_mutable_integrator().set_target_accuracy(accuracy)
    context = simulator.get_mutable_context()

    def run() -> Vector:
        context.SetTime(0.0)
        plant.SetPositions(context, angles)
        plant.SetVelocities(context, rates)
        simulator.Initialize()
        simulator.AdvanceTo(robot.end)
        return np.asarray(plant.GetPositions(context))[order]

    return run


def _exudyn(robot: Robot, tolerance: float) -> Callable[[], Vector]:
    import exudyn as exu
    import pinocchio as pin
    from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree

    model = pin.buildModelFromUrdf(str(robot.path))
    names = list(model.names)[1:]
    angles, rates = robot.start(names)
    container = exu.SystemContainer()
    system = container.AddSystem()
    node = system.AddNode(
        NodeGenericODE2(
            referenceCoordinates=[0.0] * model.nv,
            initialCoordinates=list(angles),
            initialCoordinates_t=list(rates),
            numberOfODE2Coordinates=model.nv,
        )
    )
    turns, places, inertias, centres = (exu.Matrix3DList(), exu.Vector3DList(), exu.Matrix3DList(), exu.Vector3DList())
    kinds = []
    for i in range(1, model.njoints):
        place, body = model.jointPlacements[i], model.inertias[i]
        kinds.append(getattr(exu.JointType, "Revolute" + model.joints[i].shortname()[-1]))
        turns.Append(place.rotation)
        places.Append(place.translation)
        inertias.Append(body.inertia)
        centres.Append(body.lever)
    system.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=kinds,
            linkParents=[int(model.parents[i]) - 1 for i in range(1, model.njoints)],
            jointTransformations=turns,
            jointOffsets=places,
            linkInertiasCOM=inertias,
            linkCOMs=centres,
            linkMasses=[model.inertias[i].mass for i in range(1, model.njoints)],
            baseOffset=[0.0, 0.0, 0.0],
            gravity=[0.0, 0.0, -9.81],
        )
    )
    return _exudyn_run(
        system, robot.end, tolerance, lambda: np.asarray(system.systemData.GetODE2Coordinates())[robot.in_order(names)]
    )


def _exudyn_run(system: Any, end: float, tolerance: float, read: Callable[[], Vector]) -> Callable[[], Vector]:
    """Return a run of a system without constraints by Exudyn's DOPRI5."""
    import exudyn as exu

    system.Assemble()
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = 1, end
    integration.initialStepSize = end / 1000  # the first step of a long chain else has no finite error
    integration.minimumStepSize = end / 100_000  # at 1e-10 rounding decides the estimates of a chain
    integration.absoluteTolerance = integration.relativeTolerance = tolerance
    integration.verboseMode = 0
    integration.explicitIntegration.computeEndOfStepAccelerations = False
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = end

    def run() -> Vector:
        system.SolveDynamic(settings, solverType=exu.DynamicSolverType.DOPRI5)
        return read()

    return run


_ROBOTS: tuple[tuple[str, Sequence[float], Callable[[Robot, float], Callable[[], Vector]], str], ...] = (
    ("Pinocchio, SciPy's DOP853", TOLERANCES, _scipy, "pinocchio"),
    ("MuJoCo, RK4", (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4), _mujoco, "mujoco"),
    ("Drake, Runge-Kutta 3", TOLERANCES[:8], _drake, "pydrake"),
    ("Drake, Runge-Kutta 5", TOLERANCES[2:], partial(_drake, scheme="runge_kutta5"), "pydrake"),
    ("Exudyn, DOPRI5", TOLERANCES[:8], _exudyn, "exudyn"),
)


def robot_contenders(robot: Robot) -> Iterator[Contender]:
    """Yield the programs that are installed."""
    for name, settings, make, package in _ROBOTS:
        if installed(package):
            yield Contender(name, settings, lambda x, make=make: make(robot, x))


@cache
def installed(package: str) -> bool:
    """Whether a package can be imported."""
    from importlib.util import find_spec

    return find_spec(package) is not None
