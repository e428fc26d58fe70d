"""Backward differentiation formulas beside Radau IIA, on the stiff governor and on a stiff pendulum.

SciPy's implementations of both run the same plain kernels, so that what differs is the methods: evaluations of the
right-hand side, of its Jacobian and factorisations at the same error. The compiled `radau` stands beside them.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import dalembert as da
from hard_cases import hard_case

__all__ = ["stiff_methods"]

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
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


def stiff_methods() -> str:
    """Return a table of the methods at falling tolerances."""
    rows = [
        "| case | method | rtol | error | steps | evaluations | ms |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for name in CASES:
        case = hard_case(name)
        plain, compiled = (
            da.compile_model(case.scene, backend=backend, outputs=case.outputs) for backend in ("numpy", "numba")
        )
        compiled.simulate((0, 1e-6), case.initial, case.parameters, method="radau")
        for rtol in TOLERANCES:
            rows += [_row(name, plain, method, rtol) for method in ("bdf", "radau")]
            rows.append(_row(name, compiled, "radau", rtol))
            print(*rows[-3:], sep="\n", flush=True)
    return "\n".join(rows)


if __name__ == "__main__":
    np.seterr(all="ignore")
    stiff_methods()
