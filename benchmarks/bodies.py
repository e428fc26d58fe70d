"""How scenes of many bodies grow: seconds from a scene to its first run, and the time of an evaluation.

``python benchmarks/bodies.py [--sizes 10 30 100] [--chains planar spatial] [--loops windows net] [--limit SECONDS]``
prints a table of chains, then, with the sizes of `LOOP_SIZES`, of mechanisms of many closed loops. Seconds
are those of the processor, so that other work of the machine does not count. An evaluation is a call of the compiled
right-hand side from compiled code, the least mean of many samples. Torques recomputed from the accelerations by the
recursion of `tests/mechanics/bodies.py`, in plain NumPy, are the residual. A size is left out where the one before took
`limit` seconds in all.

Where ``pinocchio`` (``pip install pin``) and ``mujoco`` can be imported, their forward dynamics of the same chain are
measured beside it, called from Python, after their accelerations have been compared.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from ctypes import CFUNCTYPE, c_void_p
from itertools import pairwise
from pathlib import Path
from time import perf_counter, process_time
from typing import NamedTuple, cast

import numpy as np
from chains import CHAINS
from numpy.typing import NDArray

import dalembert as da
from dalembert.codegen.compiled_engine import CompiledEngine
from dalembert.model.model import CompiledModel
from loops import LOOPS

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from mechanics.bodies import Link, torques

SIZES = (2, 7, 12, 30, 50, 100, 300, 1000)
VALUES = {"m": 1.0, "l": 0.5, "Ix": 0.01, "Iy": 0.02, "Iz": 0.03, "g": 9.81}
SPAN = 1.0
LOOP_SIZES = {
    "windows": (10, 20, 40, 100),
    "net": (3, 5, 7, 10),
    "track": (10, 20, 40, 80),
    "arch": (10, 20, 40, 80),
}
LOOP_SPAN = 0.1
"""Seconds of motion; windows reach a singular position soon after."""


class Growth(NamedTuple):
    """One chain or mechanism: seconds of the scene in SymPy, of its compilation, of the first run and of a later one.

    `operations` are those of an evaluation, `microseconds` its time; `residual` is the largest torque that the
    recursion of Newton and Euler recomputes from accelerations of a chain, relative to the sizes of its terms;
    `steps` and `method` are those of the run, `peers` what others take.
    """

    chain: str
    bodies: int
    scene: float
    compiled: float
    first: float
    later: float
    operations: int
    microseconds: float
    residual: float
    steps: int
    method: str
    peers: tuple[str, ...] = ()

    @property
    def total(self) -> float:
        """Seconds from nothing to the first trajectory."""
        return self.scene + self.compiled + self.first


def growth(name: str, n: int) -> Growth:
    """Return what a chain takes, whose n links are bent a little, or a mechanism of n loops; both start at rest."""
    times = [process_time()]
    made = LOOPS[name](n) if name in LOOPS else None
    scene = CHAINS[name](n) if made is None else made[0]
    times.append(process_time())
    model = da.compile_model(scene, cache=False)
    times.append(process_time())
    start: dict[object, object] = {x: 0.3 / (i + 1) for i, x in enumerate(model.layout.coordinates)}
    start |= dict.fromkeys(model.layout.rates, 0.0)
    given: dict[object, object] = {x: VALUES[x.rstrip("0123456789")] for x in model.layout.parameters if made is None}
    if made is not None:
        given, start = {**made[1]}, {**made[2]}
    for _ in range(2):
        run = model.simulate((0.0, SPAN if made is None else LOOP_SPAN), start, given)
        times.append(process_time())
    if not run.success:
        raise RuntimeError(f"{name} of {n} ends with {run.status}: {run.message}")
    seconds = [later - earlier for earlier, later in pairwise(times)]
    state = np.concatenate([run.q[0], run.qdot[0]])
    evaluation = microseconds(model, state, model.parameter_vector(given))
    operations = len(model.stages.program.kernel("rhs").body)
    others = tuple(peers(name, n, model, run.q[0], given)) if made is None else ()
    rest = residual(name, n, model, given) if made is None else float("nan")
    return Growth(name, n, *seconds, operations, evaluation, rest, run.stats.steps, run.stats.method, others)


def residual(chain: str, n: int, model: CompiledModel, given: Mapping[object, object]) -> float:
    """Return the largest torque of the joints of a chain at a random state, relative to the sizes of its terms."""
    l, half = VALUES["l"], np.array([VALUES["l"] / 2, 0.0, 0.0])
    tree = []
    for i, axis in enumerate(_axes(chain, n)[:n]):
        place = np.array([l if i else 0.0, 0.0, 0.0])
        tree.append(Link(i - 1, "turn", "xyz".index(axis), place, VALUES["m"], half, np.array(MOMENTS)))
    q, qdot = np.random.default_rng(n).uniform(-1.0, 1.0, (2, n))
    found, sizes = torques(tree, q, qdot, model.accelerations(0.0, q, qdot, given), up=1 if chain == "planar" else 2)
    return float(np.max(np.abs(found) / sizes))


def microseconds(model: CompiledModel, y: NDArray[np.float64], p: NDArray[np.float64]) -> float:
    """Return the time of an evaluation of the right-hand side at a state."""
    engine = cast(CompiledEngine, model.engine)
    layout = model.stages.program.layout
    t, c, out = np.zeros(1), np.zeros(layout.constants or len(layout.parameters)), np.zeros(len(y))
    arguments = [a.ctypes.data for a in (t, y, c, c, out)]
    function = CFUNCTYPE(None, *[c_void_p] * 5)
    function(int(engine.steps.prepare()))(p.ctypes.data, y.ctypes.data, c.ctypes.data, c.ctypes.data, c.ctypes.data)
    call = function(int(engine.steps.kernel("rhs")))
    return 1e6 * least(lambda: call(*arguments))


def peers(chain: str, n: int, model: CompiledModel, q: NDArray[np.float64], given: dict[object, object]) -> list[str]:
    """Return names of peers that can be imported, each with the microseconds of its forward dynamics.

    Raises
    ------
    RuntimeError
        Where the accelerations of a peer are others.
    """
    own = model.accelerations(0.0, q, np.zeros(n), given)
    found = []
    for name, make in (("pinocchio", _pinocchio), ("mujoco", _mujoco)):
        try:
            evaluate = make(chain, n, q)
        except ImportError:
            continue
        apart = np.max(np.abs(evaluate() - own)) / np.max(np.abs(own))
        if apart > 1e-6:
            raise RuntimeError(f"{name}: accelerations of the {chain} chain of {n} differ by {apart:.1g}")
        found.append(f"{name} {1e6 * least(evaluate):.1f}")
    return found


def least(call: Callable[[], object], rounds: int = 30, calls: int = 20) -> float:
    """Return the least mean seconds of a call."""
    best = float("inf")
    for _ in range(rounds):
        begin = perf_counter()
        for _ in range(calls):
            call()
        best = min(best, (perf_counter() - begin) / calls)
    return best


def _axes(chain: str, n: int) -> str:
    return ("z" if chain == "planar" else "zyx") * n


MOMENTS = VALUES["Ix"], VALUES["Iy"], VALUES["Iz"]


def _pinocchio(chain: str, n: int, q: NDArray[np.float64]) -> Callable[[], NDArray[np.float64]]:
    """Return a call of Pinocchio's articulated-body algorithm for a chain at rest."""
    import pinocchio as pin

    model, joint, l = pin.Model(), 0, VALUES["l"]
    for i in range(n):
        turn = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}[_axes(chain, n)[i]]()
        place = pin.SE3(np.eye(3), np.array([l if i else 0.0, 0.0, 0.0]))
        joint = model.addJoint(joint, turn, place, f"q{i}")
        body = pin.Inertia(VALUES["m"], np.array([l / 2, 0.0, 0.0]), np.diag(MOMENTS))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.gravity.linear = np.array([0.0, -VALUES["g"], 0.0] if chain == "planar" else [0.0, 0.0, -VALUES["g"]])
    data, nothing = model.createData(), np.zeros(n)
    return lambda: np.asarray(pin.aba(model, data, q, nothing, nothing))


def _mujoco(chain: str, n: int, q: NDArray[np.float64]) -> Callable[[], NDArray[np.float64]]:
    """Return a call of MuJoCo's forward dynamics for a chain at rest."""
    import mujoco

    l, m = VALUES["l"], VALUES["m"]
    gravity = f"0 {-VALUES['g']} 0" if chain == "planar" else f"0 0 {-VALUES['g']}"
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    head = ""
    for i in range(n):
        head += f'<body pos="{l if i else 0} 0 0"><joint axis="{axes[_axes(chain, n)[i]]}"/>'
        head += f'<inertial pos="{l / 2} 0 0" mass="{m}" diaginertia="{" ".join(map(str, MOMENTS))}"/>'
    text = (
        f'<mujoco><compiler balanceinertia="false" boundmass="0"/><option gravity="{gravity}"/>'
        f"<worldbody>{head}{'</body>' * n}</worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = q

    def evaluate() -> NDArray[np.float64]:
        mujoco.mj_forward(model, data)
        return np.asarray(data.qacc)

    return evaluate


def measured(sizes: Mapping[str, Sequence[int]], limit: float) -> list[Growth]:
    """Return what chains and mechanisms take, size by size, up to those that take `limit` seconds."""
    found = []
    for name, own in sizes.items():
        for n in own:
            found.append(growth(name, n))
            print(row(found[-1]), flush=True)
            if found[-1].total > limit:
                break
    return found


HEADER = (
    "| chain | bodies | scene, s | compilation, s | first run, s | from scene to trajectory, s | next run, ms |"
    " operations | evaluation, us | residual | steps | peers, us |\n" + "| --- " * 12 + "|"
)


def row(g: Growth) -> str:
    """Return a line of the table."""
    return (
        f"| {g.chain} | {g.bodies} | {g.scene:.2f} | {g.compiled:.2f} | {g.first:.2f} | {g.total:.2f} |"
        f" {1e3 * g.later:.1f} | {g.operations:,} | {g.microseconds:.2f} | {g.residual:.0e} | {g.steps} {g.method} |"
        f" {', '.join(g.peers)} |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--chains", nargs="*", choices=CHAINS, default=list(CHAINS))
    parser.add_argument("--loops", nargs="*", choices=LOOPS, default=list(LOOPS))
    parser.add_argument("--limit", type=float, default=60.0)
    given = parser.parse_args()
    print(HEADER)
    sizes = {name: given.sizes for name in given.chains} | {name: LOOP_SIZES[name] for name in given.loops}
    measured(sizes, given.limit)
