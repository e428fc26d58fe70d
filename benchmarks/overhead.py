"""Overhead of `simulate()` and `sweep()`: what a call costs beyond the runs themselves in compiled code.

``python benchmarks/overhead.py [--rounds N]`` prints microseconds of a warm call at the default options, of the
compiled loop that takes and records its steps, and of their difference, which is what Python adds: reading what is
given, the consistent start, the choice of the method, and the results. Of sweeps it prints a call with two cases of one
short step each, and what each further case adds, also with events, reductions and times to record; prepared runs of
one short step; how long after the first thread the second begins to take steps, and how long any thread takes to wake.
Calls are measured by processor time. The least of many short samples counts, because other work of the machine only
adds to it.
"""

from __future__ import annotations

import argparse
import threading
from collections.abc import Callable, Mapping
from time import perf_counter, process_time, sleep
from typing import Any, NamedTuple

import numpy as np
from cases import END, PROBLEMS, Problem
from sympy import Symbol
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm import sweep_memory
from dalembert.starts import inputs
from dalembert.steps.problem import IntegrationProblem
from hard_cases import hard_case
from hard_cases.contacts import contact_motion

SCENES = ("sleigh", "sphere")
LOOPS = ("double pendulum, Cartesian", "four-bar")
WITH_CONTACTS = "block on a belt"
"""Hard cases of which one call is measured, too."""
CALLS = 20
SHORT, FEW, MANY = 1e-3, 64, 4096
"""Duration of the cases of sweeps [s], and numbers of cases between which one more is measured."""

WORK: dict[str, tuple[str, Mapping[str, Any]]] = {
    "": ("minimal", {}),
    "by radau": ("minimal", {"method": "radau"}),
    "with an event": ("minimal", {"events": ["x"]}),
    "with a maximum": ("minimal", {"reduce": {"largest": da.maximum("x")}}),
    "with two times": ("minimal", {"t_eval": np.array([0.0, SHORT])}),
    "projected": ("projected", {}),
    "keeping first integrals": ("minimal", {"project_invariants": True}),
}
"""Formulation and options of sweeps by name."""


class Overhead(NamedTuple):
    """Seconds of a call and of its compiled loop, and the steps of the run."""

    scene: str
    called: float
    loop: float
    steps: int

    @property
    def beyond(self) -> float:
        """Seconds beyond the run itself."""
        return self.called - self.loop


def overhead(name: str, problem: Problem, rounds: int) -> Overhead:
    """Return the overhead of one scene."""
    model = da.compile_model(problem.build())

    def call() -> Any:
        return model.simulate((0.0, END), problem.initial, problem.parameters)

    steps = call().stats.steps
    return Overhead(name, _least(call, rounds), _loop(model, problem, rounds), steps)


class SweepOverhead(NamedTuple):
    """Seconds of a sweep of two short cases, and of each further one on one thread, steps included."""

    scene: str
    called: float
    case: float


def sweep_overhead(name: str, problem: Problem, rounds: int, work: str = "") -> SweepOverhead:
    """Return the overhead of sweeps of one scene."""
    formulation, options = WORK[work]
    model = da.compile_model(problem.build(), formulation=formulation)
    two, few = (_least(_sweep(model, problem, count, **options), rounds) for count in (2, FEW))
    many = _least(_sweep(model, problem, MANY, **options), max(1, rounds // 10), calls=1)
    return SweepOverhead(f"{name} {work}".strip(), two, (many - few) / (MANY - FEW))


def prepared_call(model: Any, initial: Any, parameters: Any, rounds: int, inputs: tuple[float, ...] = ()) -> float:
    """Return the seconds of a prepared run of one short step, with values of inputs given in the call."""
    held = {"inputs": dict.fromkeys(model.layout.inputs, 0.0)} if inputs else {}
    state, p = model.state(initial, parameters, **held), model.parameter_vector(parameters, **held)
    run, given = model.prepare((0.0, SHORT)), (np.array(inputs),) if inputs else ()
    return _least(lambda: run(state, p, *given), rounds)


def pushed_cart() -> tuple[Any, dict[str, float], dict[str, float]]:
    """Return a cart that an input pushes, an initial state, and parameters."""
    x, u, N, O = *dynamicsymbols("x u"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("cart", P, Symbol("m")))
    scene.add_inputs(u)
    scene.add_loads((P, u * N.x))
    return da.compile_model(scene), {"x": 0.0, "x_dot": 1.0}, {"m": 2.0}


def loop_overhead(name: str, rounds: int) -> float:
    """Return the seconds of a sweep of two equal short cases of a hard case."""
    case = contact_motion(name).motion if name == WITH_CONTACTS else hard_case(name)
    first, value = next(iter(case.initial.items()))
    given = {**case.initial, first: np.full(2, value)}, case.parameters
    return _least(_warm_sweep(case.compile("auto"), *given, threads=1), rounds)


def _sweep(model: Any, problem: Problem, count: int, threads: int = 1, **options: Any) -> Callable[[], Any]:
    """Return a sweep of so many short cases, for which everything is compiled."""
    initial = {**problem.initial, "x": problem.initial["x"] + np.linspace(0.0, 1.0, count)}
    return _warm_sweep(model, initial, problem.parameters, threads=threads, **options)


def _warm_sweep(model: Any, initial: Any, parameters: Any, **options: Any) -> Callable[[], Any]:
    def call() -> Any:
        return model.sweep((0.0, SHORT), initial, parameters, **options)

    for _ in range(CALLS):
        call()
    return call


def second_thread(problem: Problem, rounds: int) -> float:
    """Return the seconds from the first step of a sweep of `MANY` cases to the first step of its second thread."""
    call, begun, best = _sweep(da.compile_model(problem.build()), problem, MANY, threads=2), list[float](), float("inf")
    loop = sweep_memory.run_loop

    def timed(*arguments: Any) -> bool:
        begun.append(perf_counter())
        return loop(*arguments)

    sweep_memory.run_loop = timed
    try:
        for _ in range(rounds):
            begun.clear()
            call()
            best = min(best, begun[1] - begun[0] if len(begun) > 1 else best)
    finally:
        sweep_memory.run_loop = loop
    return best


def waking_thread(rounds: int) -> float:
    """Return the seconds from the release of a lock until a thread that has waited for it runs, the least."""
    going, woken, found, awake = threading.Lock(), threading.Lock(), list[float](), [0.0]
    going.acquire()
    woken.acquire()

    def wait() -> None:
        for _ in range(rounds):
            going.acquire()
            awake[0] = perf_counter()
            woken.release()

    thread = threading.Thread(target=wait)
    thread.start()
    for _ in range(rounds):
        sleep(SHORT)
        begin = perf_counter()
        going.release()
        woken.acquire()
        found.append(awake[0] - begin)
    thread.join()
    return min(found)


def _least(call: Callable[[], Any], rounds: int, calls: int = CALLS) -> float:
    """Return the least seconds of a call on the processor, of samples of some calls in a row."""
    best = float("inf")
    for _ in range(rounds):
        begin = process_time()
        for _ in range(calls):
            call()
        best = min(best, (process_time() - begin) / calls)
    return best


def _loop(model: Any, problem: Problem, rounds: int) -> float:
    """Return the least seconds of the compiled loop of a run that `simulate` makes by Taylor steps."""
    program = model.stages.program
    given = IntegrationProblem(
        t0=0.0,
        t1=END,
        y0=model.state(problem.initial, problem.parameters),
        constants=inputs.constants(program, model.parameter_vector(problem.parameters)),
        dense=True,
    )
    model.engine.integrate(given, "taylor")
    (code,) = model.engine._taylor_codes.values()
    work, best = code.workspaces[-1], float("inf")
    for _ in range(rounds * CALLS):
        work.begin(given)
        begin = perf_counter()
        code.loop.call(work.address)
        best = min(best, perf_counter() - begin)
    return best


def table(found: list[Overhead]) -> str:
    """Return the overheads as a table in Markdown."""
    lines = ["| scene | steps | simulate() [us] | compiled run [us] | beyond it [us] |", "|---|---|---|---|---|"]
    for each in found:
        times = " | ".join(f"{1e6 * value:.1f}" for value in (each.called, each.loop, each.beyond))
        lines.append(f"| {each.scene} | {each.steps} | {times} |")
    return "\n".join(lines)


def sweep_table(found: list[SweepOverhead]) -> str:
    """Return the overheads of sweeps as a table in Markdown."""
    lines = ["| scene | sweep() of two cases [us] | each further case [us] |", "|---|---|---|"]
    lines += [f"| {each.scene} | {1e6 * each.called:.0f} | {1e6 * each.case:.3f} |" for each in found]
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=500, help="samples of 20 calls")
    rounds = parser.parse_args().rounds
    print(table([overhead(name, PROBLEMS[name], rounds) for name in SCENES]))
    print()
    print(sweep_table([sweep_overhead(name, PROBLEMS[name], rounds, work) for name in SCENES for work in WORK]))
    print()
    for name in SCENES:
        problem = PROBLEMS[name]
        seconds = prepared_call(da.compile_model(problem.build()), problem.initial, problem.parameters, rounds)
        print(f"{name}: a prepared run of one short step takes {1e6 * seconds:.2f} us")
    seconds = prepared_call(*pushed_cart(), rounds, inputs=(0.3,))
    print(f"cart with an input: a prepared run of one short step takes {1e6 * seconds:.2f} us")
    for name in (*LOOPS, WITH_CONTACTS):
        print(f"{name}: a sweep of two cases takes {1e6 * loop_overhead(name, rounds):.0f} us")
    for name in SCENES:
        seconds = second_thread(PROBLEMS[name], rounds)
        print(f"{name}: a second thread begins {1e6 * seconds:.0f} us after the first")
    print(f"a thread that waits for a lock wakes {1e6 * waking_thread(rounds):.0f} us after its release")


if __name__ == "__main__":
    main()
