"""How scenes of many bodies grow: seconds from a scene to its first run, and the time of an evaluation beside others.

    pip install pin mujoco drake exudyn
    python benchmarks/bodies.py                                    # prints tables of chains and of closed loops
    python benchmarks/bodies.py --write                           # writes many_bodies_*.csv, and a picture
    python benchmarks/bodies.py --sizes 10 30 --chains planar --loops --limit 30
    python benchmarks/bodies.py --only-growth                      # without evaluations

Seconds are those of the processor, so that other work of the machine does not count. A size is left out where the one
before took `limit` seconds in all.

An evaluation of the accelerations of a chain at a random state is measured in turn with those of the peers that are
installed (`chain_peers`), the least of many samples less the same call for nothing: ours of an empty compiled function,
those of peers for a chain without bodies. Torques recomputed from the accelerations of each by the recursion of
`tests/mechanics/bodies.py`, in plain NumPy, are its residual.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from ctypes import CFUNCTYPE, c_void_p
from itertools import pairwise
from multiprocessing import get_context
from time import perf_counter, process_time
from typing import Any, NamedTuple, cast

import numpy as np
from chain_peers import LARGEST, MOMENTS, PEERS, VALUES, Evaluation, axes
from chains import CHAINS
from exact import ROOT  # puts tests/ on the path
from figures import growth_picture
from measure import interleaved
from mechanism_peers import installed
from numba import cfunc
from numpy.typing import NDArray
from saved_tables import save

import dalembert as da
from dalembert.codegen.compiled_engine import CompiledEngine
from dalembert.model.model import CompiledModel
from loops import LOOPS
from mechanics.bodies import Link, torques

PICTURE = ROOT / "docs" / "pictures" / "many_bodies.png"
Vector = NDArray[np.float64]
SIZES = (2, 7, 12, 30, 50, 100, 300, 1000)
SPAN = 1.0
LOOP_SIZES = {
    "windows": (10, 20, 40, 100),
    "track": (10, 20, 40, 80),
    "arch": (10, 20, 40, 80),
    "net": (3, 5, 7, 10, 20),
}
LOOP_SPAN = 0.1
"""Seconds of motion; windows reach a singular position soon after."""
RESIDUAL = 1e-5
"""Largest residual of accelerations, relative to the terms of the torques, that is taken for the same chain."""
MODULES = {"Pinocchio": "pinocchio", "MuJoCo": "mujoco", "Drake": "pydrake", "Exudyn": "exudyn"}


class Growth(NamedTuple):
    """One chain or mechanism: seconds of the scene in SymPy, of its compilation, of the first run and of a later one.

    `operations` are those of an evaluation, `steps` and `method` those of the run. `evaluations` are microseconds of an
    evaluation, and `residuals` the largest torque that the recursion of Newton and Euler recomputes from accelerations
    of a chain, relative to the sizes of its terms, both by the names of programs.
    """

    name: str
    bodies: int
    scene: float
    compiled: float
    first: float
    later: float
    operations: int
    steps: int
    method: str
    evaluations: dict[str, float]
    residuals: dict[str, float]

    @property
    def total(self) -> float:
        """Seconds from nothing to the first trajectory."""
        return self.scene + self.compiled + self.first


def growth(name: str, n: int, *, evaluated: bool = True) -> Growth:
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
    operations = len(model.stages.program.kernel("rhs").body)
    if made is None:
        found = evaluations(name, n, model, given) if evaluated else ({}, {})
    else:
        found = microseconds({"dalembert": own(model, run.q[0], run.qdot[0], given)}), {}
    return Growth(name, n, *seconds, operations, run.stats.steps, run.stats.method, *found)


def evaluations(
    chain: str, n: int, model: CompiledModel, given: Mapping[Any, Any]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return microseconds of an evaluation of a chain at a random state, and residuals, by the names of programs.

    Raises
    ------
    RuntimeError
        Where residuals are not those of rounding.
    """
    q, qdot = np.random.default_rng(n).uniform(-1.0, 1.0, (2, n))
    every = {"dalembert": own(model, q, qdot, given)}
    served = [peer for peer in PEERS if installed(MODULES[peer]) and n <= LARGEST.get(peer, n)]
    every |= {peer: PEERS[peer](chain, q, qdot) for peer in served}
    residuals = {program: residual(chain, q, qdot, each.accelerations) for program, each in every.items()}
    wrong = {program: size for program, size in residuals.items() if not size < RESIDUAL}
    if wrong:
        raise RuntimeError(f"{chain} chain of {n}: the accelerations leave residuals {wrong}")
    return microseconds(every), residuals


def residual(chain: str, q: Vector, qdot: Vector, accelerations: Vector) -> float:
    """Return the largest torque of the joints of a chain, relative to the sizes of its terms."""
    l, half, tree = VALUES["l"], np.array([VALUES["l"] / 2, 0.0, 0.0]), []
    for i, axis in enumerate(axes(chain, len(q))):
        place = np.array([l if i else 0.0, 0.0, 0.0])
        tree.append(Link(i - 1, "turn", "xyz".index(axis), place, VALUES["m"], half, np.array(MOMENTS)))
    found, sizes = torques(tree, q, qdot, accelerations, up=1 if chain == "planar" else 2)
    return float(np.max(np.abs(found) / sizes))


_FUNCTION = CFUNCTYPE(None, *[c_void_p] * 5)


def own(model: CompiledModel, q: Vector, qdot: Vector, given: Mapping[Any, Any]) -> Evaluation:
    """Return the evaluation of the compiled right-hand side at a state, called through `ctypes`."""
    engine, layout = cast(CompiledEngine, model.engine), model.stages.program.layout
    p, y = model.parameter_vector(given), np.concatenate([q, qdot])
    t, c, out = np.zeros(1), np.zeros(layout.constants or len(layout.parameters)), np.zeros(len(y))
    _FUNCTION(int(engine.steps.prepare()))(*(a.ctypes.data for a in (p, y, c, c, c)))
    call, arguments = _FUNCTION(int(engine.steps.kernel("rhs"))), [a.ctypes.data for a in (t, y, c, c, out)]
    call(*arguments)
    nothing = cfunc("void(voidptr, voidptr, voidptr, voidptr, voidptr)")(lambda t, y, c, s, out: None)
    empty, keep = _FUNCTION(nothing.address), (t, y, c, out, nothing)
    return Evaluation(out[len(q) :].copy(), lambda: (call(*arguments), keep), lambda: (empty(*arguments), keep))


def microseconds(every: Mapping[str, Evaluation]) -> dict[str, float]:
    """Return the time of an evaluation by each program, measured in turn."""
    tasks = {(name, part): getattr(each, part) for name, each in every.items() for part in ("call", "empty")}
    found = interleaved(tasks, rounds=60, seconds_each=3.0)
    return {
        name: 1e6 * (found[name, "call"].least - found[name, "empty"].least) / each.count
        for name, each in every.items()
    }


def least(call: Callable[[], object], rounds: int = 30, calls: int = 20) -> float:
    """Return the least mean seconds of a call."""
    best = float("inf")
    for _ in range(rounds):
        begin = perf_counter()
        for _ in range(calls):
            call()
        best = min(best, (perf_counter() - begin) / calls)
    return best


def measured(sizes: Mapping[str, Sequence[int]], limit: float, *, evaluated: bool = True) -> list[Growth]:
    """Return what chains and mechanisms take, size by size, up to those that take `limit` seconds.

    Each has a process of its own, in which nothing of those before is left.
    """
    found = []
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        for name, each in sizes.items():
            for n in each:
                found.append(pool.submit(growth, name, n, evaluated=evaluated).result())
                print(found[-1], flush=True)
                if found[-1].total > limit:
                    break
    return found


# Tables.

PROGRAMS = ("dalembert", *PEERS)
SECONDS = "scene, s | compilation, s | first run, s | in all, s | next run, ms | operations"


def growth_table(found: Sequence[Growth]) -> str:
    """Return seconds from scenes to trajectories; of mechanisms with the time of an evaluation."""
    loops = any(g.name in LOOPS for g in found)
    last = "evaluation, us" if loops else "method | steps"
    lines = [f"| {'mechanism | n' if loops else 'chain | bodies'} | {SECONDS} | {last} |"]
    lines.append("|---|" + "--:|" * (lines[0].count("|") - 2))
    for g in found:
        end = f"{g.evaluations['dalembert']:.2f}" if loops else f"{g.method} | {g.steps}"
        lines.append(
            f"| {g.name} | {g.bodies:,} | {g.scene:.2f} | {g.compiled:.2f} | {g.first:.2f} | {g.total:.2f} |"
            f" {1e3 * g.later:.1f} | {g.operations:,} | {end} |"
        )
    return "\n".join(lines)


def evaluation_table(found: Sequence[Growth]) -> str:
    """Return microseconds of an evaluation of the accelerations by each program."""
    lines = [f"| chain | bodies | {' | '.join(PROGRAMS)} |", "|---|" + "--:|" * (1 + len(PROGRAMS))]
    for g in found:
        cells = (_digits(g.evaluations[program]) if program in g.evaluations else "" for program in PROGRAMS)
        lines.append(f"| {g.name} | {g.bodies:,} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _digits(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}" if value >= 1 else f"{value:.2f}"


def residual_table(found: Sequence[Growth]) -> str:
    """Return the residuals of each program at each size."""
    sizes = list(dict.fromkeys(g.bodies for g in found))
    lines = [f"| chain | by | {' | '.join(f'{n:,}' for n in sizes)} |", "|---|---|" + "--:|" * len(sizes)]
    for name in dict.fromkeys(g.name for g in found):
        for program in PROGRAMS:
            sized = {g.bodies: g.residuals[program] for g in found if g.name == name and program in g.residuals}
            cells = (f"{sized[n]:.0e}" if n in sized else "" for n in sizes)
            lines.append(f"| {name} | {program} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Print the tables, or save them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--chains", nargs="*", choices=CHAINS, default=list(CHAINS))
    parser.add_argument("--loops", nargs="*", choices=LOOPS, default=list(LOOP_SIZES))
    parser.add_argument("--limit", type=float, default=60.0)
    parser.add_argument("--only-growth", action="store_true", help="of chains, without evaluations")
    parser.add_argument("--write", action="store_true", help="save the tables, for docs/many_bodies_measured.md")
    given = parser.parse_args()
    chains = measured({name: given.sizes for name in given.chains}, given.limit, evaluated=not given.only_growth)
    loops = measured({name: LOOP_SIZES[name] for name in given.loops}, given.limit)
    tables: dict[str, str] = {}
    if chains:
        tables["growth"] = growth_table(chains)
    if chains and not given.only_growth:
        tables |= {"evaluations": evaluation_table(chains), "residuals": residual_table(chains)}
    if loops:
        tables["loops"] = growth_table(loops)
    for name, table in tables.items():
        print(f"\n{table}")
        if given.write:
            save(f"many_bodies_{name}", table)
    if "evaluations" in tables and given.write:
        growth_picture(chains, PICTURE)


if __name__ == "__main__":
    main()
