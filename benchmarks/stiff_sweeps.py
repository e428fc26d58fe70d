"""Stiff sweeps by radau: cases side by side in lanes, beside one case at a time and beside implicit peers.

``python benchmarks/stiff_sweeps.py [--cases N] [--seconds S] [--write]`` sweeps five stiff scenes on one thread. "One
at a time" is the same method with one lane. The peers integrate equations written by hand, case by case (CVODES by
CasADi: BDF and Newton's iteration) or in one vectorised program (Kvaerno5 by diffrax). Errors are the largest at the
end, over all cases, relative where a value is above one, against radau at a tolerance of 1e-11. Calls are timed in
turn, and the least time counts. With ``--write`` the tables go to ``docs/speed.md``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from cases import PROBLEMS
from measure import interleaved, machine
from report import describe_machine, fill_page
from sympy import symbols, tanh
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.codegen.llvm.backend import LLVMLibrary
from hard_cases import hard_case

TOLERANCES = (1e-4, 1e-6, 1e-8)
SHOWN = 1e-6
"""The tolerance whose rows the page has; all are printed."""
REFERENCE = 1e-11
PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
MARKS = ("<!-- stiff sweeps: benchmarks/stiff_sweeps.py --write -->", "<!-- end of stiff sweeps -->")


class Work(NamedTuple):
    """A scene, its start, parameters of which one is an array over the cases, and the end of its runs."""

    scene: Any
    initial: Mapping[str, float]
    parameters: Mapping[str, Any]
    end: float


def _hard(name: str, varied: str, low: float, high: float, end: float) -> Callable[[int], Work]:
    def build(cases: int) -> Work:
        case = hard_case(name)
        return Work(case.scene, case.initial, {**case.parameters, varied: np.linspace(low, high, cases)}, end)

    return build


def _sleigh(cases: int) -> Work:
    problem = PROBLEMS["stiff sleigh"]
    return Work(problem.build(), problem.initial, {**problem.parameters, "b": np.linspace(0.2, 0.5, cases)}, 10.0)


def _belt(cases: int) -> Work:
    """Return a block on a belt, whose friction is smoothed by tanh(slip / eps)."""
    x, (m, k, mu, g, v, eps) = dynamicsymbols("x"), symbols("m k mu g v eps", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("belt", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, m))
    scene.add_loads((P, (mu * m * g * tanh((v - x.diff()) / eps) - k * x) * N.x))
    parameters = {"m": 1.0, "k": 10.0, "mu": np.linspace(0.2, 0.6, cases), "g": 9.81, "v": 0.5, "eps": 1e-3}
    return Work(scene, {"x": 0.0, "x_dot": 0.0}, parameters, 10.0)


def _chain(cases: int) -> Work:
    """Return six links, on springs and dampers that hold them nearly straight."""
    q, (g, k, d) = dynamicsymbols("q1:7"), symbols("g k d", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene, end, before = da.Scene("stiff_chain", frame=N, origin=O, coordinates=list(q)), O, N
    for i, angle in enumerate(q):
        link = N.orientnew(f"A{i}", "Axis", (angle, N.z))
        centre = end.locatenew(f"G{i}", link.x / 2)
        scene.add_bodies(RigidBody(f"link{i}", centre, link, 1.0, (inertia(link, 0, 0, 1 / 12), centre)))
        torque = -d * angle.diff() if i == 0 else -k * (angle - q[i - 1]) - d * (angle.diff() - q[i - 1].diff())
        scene.add_loads((link, torque * N.z))
        if i > 0:
            scene.add_loads((before, -torque * N.z))
        end, before = end.locatenew(f"P{i}", link.x), link
    scene.apply_uniform_gravity(-g * N.y)
    start = {f"q{i + 1}": 0.1 * i for i in range(6)} | {f"q{i + 1}_dot": 0.0 for i in range(6)}
    return Work(scene, start, {"g": 9.81, "k": np.linspace(1e5, 2e5, cases), "d": 1e3}, 5.0)


SCENES: dict[str, Callable[[int], Work]] = {
    "stiff sleigh": _sleigh,
    "stiff spring pendulum": _hard("stiff spring pendulum", "k", 5e5, 1.5e6, 0.1),
    "stiff flyball governor": _hard("stiff flyball governor", "K", 6e5, 1e6, 1.0),
    "smooth friction": _belt,
    "stiff chain of six": _chain,
}
BY_HAND = ("stiff spring pendulum", "smooth friction")
"""Scenes of which the peers have equations (`_rates`)."""


def _rates(name: str, functions: Any, y: Any, p: Mapping[str, Any]) -> list[Any]:
    """Return the rates of a scene, its equations written by hand."""
    if name == "smooth friction":
        x, v = y
        return [v, p["mu"] * p["g"] * functions.tanh((p["v"] - v) / p["eps"]) - p["k"] / p["m"] * x]
    x, z, v, w = y
    length = functions.sqrt(x * x + z * z)
    pull = p["k"] / p["m"] * (length - p["l"]) / length
    return [v, w, -pull * x, -pull * z - p["g"]]


class Contender(NamedTuple):
    """What is timed, and the final states (cases, n) that it gives."""

    run: Callable[[], Any]
    final: Callable[[], np.ndarray]


def _own(model: Any, work: Work, rtol: float) -> Contender:
    names = (*model.layout.coordinates, *model.layout.rates)

    def run() -> Any:
        options = {"method": "radau", "rtol": rtol, "atol": rtol / 100, "threads": 1, "max_steps": 10_000_000}
        return model.sweep((0.0, work.end), work.initial, work.parameters, **options)

    def final() -> np.ndarray:
        swept = run()
        assert np.all(swept.status == 0)
        return np.column_stack([swept.final[name] for name in names])

    return Contender(run, final)


def _start(model: Any, work: Work, cases: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    first = {name: float(np.ravel(value)[0]) for name, value in work.parameters.items()}
    parameters = {name: np.broadcast_to(np.asarray(value, float), cases) for name, value in work.parameters.items()}
    return model.state(work.initial, first), parameters


def _diffrax(name: str, model: Any, work: Work, rtol: float, cases: int) -> Contender:
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    start, parameters = _start(model, work, cases)
    term = diffrax.ODETerm(lambda t, y, p: jnp.stack(_rates(name, jnp, list(y), p)))
    control = diffrax.PIDController(rtol=rtol, atol=rtol / 100)

    def one(p: Any) -> Any:
        found = diffrax.diffeqsolve(
            term, diffrax.Kvaerno5(), 0.0, work.end, None, jnp.array(start), args=p, stepsize_controller=control,
            max_steps=1_000_000, throw=False, saveat=diffrax.SaveAt(t1=True), adjoint=diffrax.ForwardMode(),
        )  # fmt: skip
        return found.ys[-1]

    solve = jax.jit(jax.vmap(one))
    given = {key: jnp.array(value) for key, value in parameters.items()}
    return Contender(lambda: solve(given).block_until_ready(), lambda: np.array(solve(given)))


def _cvodes(name: str, model: Any, work: Work, rtol: float, cases: int) -> Contender:
    import casadi

    start, parameters = _start(model, work, cases)
    y, p = casadi.SX.sym("y", len(start)), casadi.SX.sym("p", len(parameters))
    rates = _rates(name, casadi, casadi.vertsplit(y), dict(zip(parameters, casadi.vertsplit(p), strict=True)))
    system = {"x": y, "p": p, "ode": casadi.vertcat(*rates)}
    options = {"reltol": rtol, "abstol": rtol / 100, "linear_multistep_method": "bdf", "max_num_steps": 1_000_000}
    solve = casadi.integrator("solve", "cvodes", system, 0.0, work.end, options).map(cases)
    states, values = np.tile(start[:, np.newaxis], cases), np.array(list(parameters.values()))

    def run() -> Any:
        return solve(x0=states, p=values)["xf"]

    return Contender(run, lambda: np.array(run()).T)


def _contenders(name: str, model: Any, single: Any, work: Work, rtol: float, cases: int) -> dict[str, Contender]:
    found = {"in lanes": _own(model, work, rtol), "one at a time": _own(single, work, rtol)}
    with patch.object(LLVMLibrary, "lanes", 1):
        found["one at a time"].run()
    if name in BY_HAND:
        found |= {
            "diffrax": _diffrax(name, model, work, rtol, cases),
            "CVODES": _cvodes(name, model, work, rtol, cases),
        }
    return found


def _row(name: str, model: Any, work: Work, rtol: float, cases: int, seconds: float, exact: np.ndarray) -> str:
    contenders = _contenders(name, model, da.compile_model(work.scene), work, rtol, cases)
    errors = {}
    for who, contender in contenders.items():
        gaps = np.abs(contender.final() - exact) / np.maximum(1.0, np.abs(exact))
        errors[who] = float(np.max(gaps))
    times = interleaved({who: each.run for who, each in contenders.items()}, rounds=40, seconds_each=seconds)
    least = {who: 1e6 * timing.least / cases for who, timing in times.items()}
    cells = [f"{least['in lanes']:.3g}", f"{least['one at a time']:.3g}", f"{errors['in lanes']:.0e}"]
    cells.append(f"{least['one at a time'] / least['in lanes']:.1f}")
    for who in ("diffrax", "CVODES"):
        cells.append(f"{least[who]:.3g} ({errors[who]:.0e})" if who in least else "")
    return f"| {name} | {rtol:g} | {' | '.join(cells)} |"


def stiff_sweeps(cases: int, seconds: float) -> str:
    """Return the table of the page, and print the rows of all tolerances."""
    rows = [
        "| scene | rtol | in lanes, us a case | one at a time | error | ratio | diffrax | CVODES |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    print(*rows, sep="\n", flush=True)
    for name, build in SCENES.items():
        work = build(cases)
        model = da.compile_model(work.scene)
        exact = _own(model, work, REFERENCE).final()
        for rtol in TOLERANCES:
            row = _row(name, model, work, rtol, cases, seconds, exact)
            print(row, flush=True)
            rows += [row] if rtol == SHOWN else []
    return "\n".join(rows)


def main() -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=256)
    parser.add_argument("--seconds", type=float, default=2.0, help="of a contender in a row")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    table = stiff_sweeps(options.cases, options.seconds)
    if options.write:
        note = f"{options.cases} cases, one thread, {describe_machine(machine())}."
        fill_page(PAGE, MARKS, f"{table}\n\n{note}")


if __name__ == "__main__":
    main()
