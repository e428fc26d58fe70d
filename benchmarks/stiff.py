"""Backward differentiation formulas and a Rosenbrock method beside Radau IIA, on stiff scenes.

SciPy's BDF and Radau IIA, and RODAS (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section VII.4:
order 4, six stages, stiffly accurate), run the same plain kernels, so that what differs is the methods: evaluations of
the right-hand side, Jacobians and factorisations at the same error. The compiled `radau` stands beside them.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import dalembert as da
from dalembert.ir.interpret import interpret
from dalembert.starts.inputs import constants
from hard_cases import hard_case

__all__ = ["stiff_methods"]

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
LEAST_OF_RODAS = 1e-8
GAMMA = 0.25
STAGES = (
    (),
    (1.544,),
    (0.9466785280815826, 0.2557011698983284),
    (3.314825187068521, 2.896124015972201, 0.9986419139977817),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0),
)
"""Weights of the stages before in the state at which each stage evaluates."""

COUPLINGS = (
    (),
    (-5.6688,),
    (-2.430093356833875, -0.2063599157091915),
    (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
    (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160),
    (8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054),
)
"""The same, over the step, on its right."""
CASES = ("stiff flyball governor", "stiff spring pendulum")


def _row(name: str, model: Any, method: str, rtol: float) -> str:
    case = hard_case(name)
    times = case.times()[:2]
    options = {"t_eval": [0.0, *times], "method": method, "rtol": rtol, "atol": rtol / 100, "dense": False}
    start = time.perf_counter()
    run = model.simulate((0.0, times[-1]), case.initial, case.parameters, max_steps=10_000_000, **options)
    seconds = time.perf_counter() - start
    error = f"{case.error(run):.0e}" if run.success else run.status.name
    return (
        f"| {name} | {model.backend} {method} | {rtol:g} | {error} | {run.stats.steps:,} | {run.stats.evaluations:,} |"
        f" {1e3 * seconds:.3g} |"
    )


def rodas(
    rates: Any, y: np.ndarray, span: tuple[float, float], rtol: float, atol: float
) -> tuple[np.ndarray, int, int]:
    """Return the last state, the steps and the attempts of RODAS for y' = rates(y), with Jacobians by differences.

    Each attempt takes six evaluations and a factorisation, each accepted step a Jacobian more.
    """
    t, end, h, n = *span, 1e-6, len(y)
    steps = attempts = 0
    jacobian = _jacobian(rates, y)
    while end - t > 1e-14 * end:
        h = min(h, end - t)
        matrix = np.linalg.inv(np.eye(n) / (GAMMA * h) - jacobian)
        u: list[np.ndarray] = []
        for weights, couplings in zip(STAGES, COUPLINGS, strict=True):
            place = y + sum((w * k for w, k in zip(weights, u, strict=True)), np.zeros(n))
            right = sum((c * k for c, k in zip(couplings, u, strict=True)), np.zeros(n)) / h
            u.append(matrix @ (rates(place) + right))
        new = place + u[-1]
        error = float(np.sqrt(np.mean((u[-1] / (atol + rtol * np.maximum(np.abs(y), np.abs(new)))) ** 2)))
        attempts += 1
        if error <= 1.0:
            t, y, steps = t + h, new, steps + 1
            jacobian = _jacobian(rates, y)
        h *= min(6.0, max(0.2, 0.9 * error**-0.25))
    return y, steps, attempts


def _jacobian(rates: Any, y: np.ndarray) -> np.ndarray:
    """Return the derivatives of the rates by central differences."""
    columns = []
    for i in range(len(y)):
        unit = np.zeros(len(y))
        unit[i] = 1e-6 * max(1.0, abs(float(y[i])))
        columns.append((rates(y + unit) - rates(y - unit)) / (2.0 * unit[i]))
    return np.array(columns).T


def _rosenbrock_row(name: str, model: Any, rtol: float) -> str:
    case = hard_case(name)
    end = case.times()[1]
    program, p = model.stages.program, model.parameter_vector(case.parameters)
    c = constants(program, p)
    kernel, start = program.kernel("rhs"), model.state(case.initial, case.parameters)

    def rates(y: np.ndarray) -> np.ndarray:
        return np.array(interpret(kernel, {"t": 0.0, "y": y.tolist(), "c": c.tolist()}))

    begin = time.perf_counter()
    y, steps, attempts = rodas(rates, start, (0.0, end), rtol, rtol / 100)
    seconds = time.perf_counter() - begin
    found = model.expand(end, y, case.parameters)
    names = (*model.layout.coordinates, *model.layout.rates)
    exact = dict(zip(map(str, case.observed), case.expected([end])[0], strict=True))
    gaps = [abs(found[i] - exact[x]) / max(1.0, abs(exact[x])) for i, x in enumerate(names) if x in exact]
    work = f"{6 * attempts:,} + {steps:,} J"
    return f"| {name} | numpy RODAS | {rtol:g} | {max(gaps):.0e} | {steps:,} | {work} | {1e3 * seconds:.3g} |"


def stiff_methods() -> str:
    """Return a table of the methods at falling tolerances."""
    rows = [
        "| case | method | rtol | error | steps | evaluations | ms |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for name in CASES:
        case = hard_case(name)
        plain, compiled = (
            da.compile_model(case.scene, backend=backend, outputs=case.outputs) for backend in ("numpy", "llvm")
        )
        compiled.simulate((0, 1e-6), case.initial, case.parameters, method="radau")
        for rtol in TOLERANCES:
            rows += [_row(name, plain, method, rtol) for method in ("bdf", "radau")]
            if rtol >= LEAST_OF_RODAS:
                rows.append(_rosenbrock_row(name, plain, rtol))
            rows.append(_row(name, compiled, "radau", rtol))
            print(*rows[-4:], sep="\n", flush=True)
    return "\n".join(rows)


if __name__ == "__main__":
    np.seterr(all="ignore")
    stiff_methods()
