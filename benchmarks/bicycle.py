"""The Whipple bicycle beside heyoka: one run and a sweep, microseconds against error.

``python benchmarks/bicycle.py [--write]`` prints a table in Markdown, or writes it into docs/benchmarks.md. heyoka
integrates the right-hand side that dalembert has derived, a graph of some 2,500 operations; its batches are compiled in
its compact mode, without which that takes many minutes. The reference is DOP853 at rtol 1e-13.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from measure import interleaved, machine
from numpy.typing import NDArray
from peers import installed
from report import describe_machine, fill_page

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import dalembert as da
from dalembert.ir.kernel import Kernel
from dalembert.starts.inputs import constants
from hard_cases.machines import bicycle_parameters, bicycle_scene, upright_bicycle

END, LANES, SPEED = 5.0, 8, 4.6
COUNTS = 1024, 16_384
"""Cases of sweeps; those of larger ones are those of the smallest, again and again."""
TOLERANCES, PEER_TOLERANCES = (1e-6, 1e-9, 1e-12), (1e-6, 1e-9)
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
MARKS = ("<!-- bicycle: benchmarks/bicycle.py --write -->", "<!-- end of bicycle -->")
FloatArray = NDArray[np.float64]
ARITHMETIC: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
}
FUNCTIONS = {"less": "lt"}
"""Functions that heyoka calls by another name."""


def system(heyoka: Any, rhs: Kernel) -> list[tuple[Any, Any]]:
    """Return a right-hand side as a system of heyoka: states y0, y1, ..., constants as its parameters."""
    states = heyoka.make_vars(*(f"y{i}" for i in range(len(rhs.outputs))))
    known: dict[str, Any] = {}
    for load in rhs.loads:
        known[load.target] = states[load.index] if load.array == "y" else heyoka.par[load.index]

    def value(operand: Any) -> Any:
        return known[operand] if isinstance(operand, str) else float(operand)

    for line in rhs.body:
        function = ARITHMETIC.get(line.op) or getattr(heyoka, FUNCTIONS.get(line.op, line.op))
        known[line.target] = function(*map(value, line.args))
    return [(state, heyoka.expression(value(rate))) for state, rate in zip(states, rhs.outputs, strict=True)]


def peer_run(
    heyoka: Any, equations: Any, rtol: float, start: FloatArray, given: FloatArray
) -> Callable[[], FloatArray]:
    """Return heyoka's run of one case."""
    integrator = heyoka.taylor_adaptive(equations, start.tolist(), pars=given.tolist(), tol=rtol, fast_math=True)

    def run() -> FloatArray:
        integrator.time = 0.0
        integrator.state[:] = start
        integrator.propagate_until(END)
        return np.array(integrator.state)

    return run


def peer_sweep(
    heyoka: Any, equations: Any, rtol: float, starts: FloatArray, given: FloatArray
) -> Callable[[], FloatArray]:
    """Return heyoka's sweep in batches."""
    pars = np.repeat(given[:, None], LANES, axis=1)
    integrator = heyoka.taylor_adaptive_batch(
        equations, starts[:, :LANES].copy(), pars=pars, tol=rtol, fast_math=True, compact_mode=True
    )
    out = np.empty_like(starts)

    def run() -> FloatArray:
        for i in range(0, starts.shape[1], LANES):
            integrator.set_time(0.0)
            integrator.state[:] = starts[:, i : i + LANES]
            integrator.propagate_until(END)
            out[:, i : i + LANES] = integrator.state
        return out

    return run


def measured() -> list[str]:
    """Return the lines of the table."""
    heyoka, about = installed("heyoka"), describe_machine(machine())  # before its own work
    model, p = da.compile_model(bicycle_scene()), bicycle_parameters()
    rhs, packed = model.stages.program.kernel("rhs"), model.parameter_vector(p)
    read = 1 + max(load.index or 0 for load in rhs.loads if load.array == "c")
    given = constants(model.stages.program, packed)[:read]
    rates = np.random.default_rng(3).uniform(0.3, 0.7, min(COUNTS))
    initial = [model.assemble(upright_bicycle(SPEED) | {"psi_dot": rate}, p) for rate in rates.tolist()]
    starts = np.stack([model.state(each, p) for each in initial], axis=1)
    given_initial = {name: np.array([each[name] for each in initial]) for name in initial[0]}
    names = (*model.layout.coordinates, *model.layout.rates)
    sweeps = [(rtol, count) for rtol in TOLERANCES for count in COUNTS]

    def own_run(rtol: float) -> Callable[[], FloatArray]:
        prepared = model.prepare((0.0, END), rtol=rtol, atol=rtol / 100)
        return lambda: prepared(starts[:, 0].copy(), packed)

    def own_sweep(rtol: float, count: int) -> Callable[[], FloatArray]:
        given = {name: np.resize(values, count) for name, values in given_initial.items()}

        def run() -> FloatArray:
            done = model.sweep((0.0, END), given, p, rtol=rtol, atol=rtol / 100, threads=1)
            return np.stack([done.final[name] for name in names])

        return run

    fine = model.sweep((0.0, END), given_initial, p, method="dop853", rtol=1e-13, atol=1e-15)
    exact = np.stack([fine.final[name] for name in names])
    equations = system(heyoka, rhs)
    tasks: dict[tuple[str, float, int], Callable[[], FloatArray]] = {}
    for rtol in TOLERANCES:
        tasks["dalembert", rtol, 1] = own_run(rtol)
        if rtol in PEER_TOLERANCES:
            tasks["heyoka", rtol, 1] = peer_run(heyoka, equations, rtol, starts[:, 0], given)
    for rtol, count in sweeps:
        tasks["dalembert", rtol, count] = own_sweep(rtol, count)
        if rtol in PEER_TOLERANCES:
            many = np.tile(starts, count // starts.shape[1])
            tasks["heyoka", rtol, count] = peer_sweep(heyoka, equations, rtol, many, given)
    ends = {key: run() for key, run in tasks.items()}
    times = interleaved(tasks, rounds=9, seconds_each=10.0)
    sizes = " | ".join(f"{count:,} cases" for count in COUNTS)
    lines = [f"| bicycle, us a case | rtol | one run | error | {sizes} | error |", "|---|--:|--:|--:|--:|--:|--:|"]
    for program in ("dalembert", "heyoka"):
        for rtol in TOLERANCES if program == "dalembert" else PEER_TOLERANCES:
            each = [f"{1e6 * times[program, rtol, count].least / count:.0f}" for count in (1, *COUNTS)]
            one = np.abs(ends[program, rtol, 1][: len(names)] - exact[:, 0]).max()
            most = np.abs(ends[program, rtol, min(COUNTS)][: len(names)] - exact).max()
            lines.append(f"| {program} | {rtol:g} | {each[0]} | {one:.0e} | {' | '.join(each[1:])} | {most:.0e} |")
    return [*lines, "", f"{END:g} s of motion, one thread. {about}"]


def main() -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the table into docs/benchmarks.md")
    text = "\n".join(measured())
    print(text)
    if parser.parse_args().write:
        fill_page(PAGE, MARKS, text)


if __name__ == "__main__":
    main()
