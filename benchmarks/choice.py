"""What "auto" loses where it takes the slower of Taylor steps and DOP853, single runs and sweeps of the hard cases.

A motion is as long as some 60 Taylor steps. Times are compared at equal error: that of Taylor steps at a tolerance, and
DOP853's time at the same error. Options: ``--case NAME`` (part of a name) measures these alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from equal_error import time_at
from measure import interleaved

import dalembert as da
from hard_cases import CASES, hard_case

METHODS, TOLERANCES = ("taylor", "dop853"), tuple(10.0**-k for k in range(4, 13))
MANY, STEPS, FINEST = 256, 60, 1e-12
"""Cases of a sweep, Taylor steps of a motion at rtol 1e-8, and the least error that is compared."""
Ends = Callable[..., np.ndarray]


def kinds(model: da.CompiledModel, initial: Mapping[str, float], parameters: Mapping[Any, float]) -> dict[str, Ends]:
    """Return, by kind, what returns the function of a run to a time by a method and a tolerance."""
    names = (*model.layout.coordinates, *model.layout.rates)
    state, packed = model.state(initial, parameters), model.parameter_vector(parameters)
    first = next(iter(initial))
    many = dict(initial) | {first: np.full(MANY, initial[first])}

    def alone(span: float, method: str, rtol: float) -> Callable[[], np.ndarray]:
        run = model.prepare((0.0, span), method=method, rtol=rtol, atol=rtol / 100)
        return lambda: np.array(run(state, packed)[: len(names)])

    def swept(span: float, method: str, rtol: float) -> Callable[[], np.ndarray]:
        options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": rtol / 100, "threads": 1}
        return lambda: np.array([model.sweep((0.0, span), many, parameters, **options)[name][0] for name in names])

    return {"run": alone, "sweep": swept}


def rows(name: str) -> Iterator[tuple[str, float, str, float]]:
    """Yield kind, tolerance, what "auto" takes, and DOP853's time over that of Taylor steps at equal error."""
    case = hard_case(name)
    model = da.compile_model(case.scene)
    if model.modes is not None or "taylor" not in model.methods:
        return
    initial = {str(key): float(value) for key, value in case.initial.items()}
    short = model.simulate((0.0, 1.0), initial, case.parameters, rtol=1e-8, atol=1e-10, method="taylor")
    if not short.success:
        return
    span = min(20.0, max(0.02, STEPS / max(short.stats.steps, 1)))
    for kind, made in kinds(model, initial, case.parameters).items():
        exact = made(span, "taylor", 1e-14)()
        size, errors = np.maximum(np.abs(exact), 1e-3), {}
        tasks = {(method, rtol): made(span, method, rtol) for method in METHODS for rtol in TOLERANCES}
        for key, task in tasks.items():
            errors[key] = float(np.max(np.abs(task() - exact) / size))
        times = interleaved(tasks, rounds=7, seconds_each=0.05)
        curve = [(errors["dop853", rtol], times["dop853", rtol].least) for rtol in TOLERANCES]
        for rtol in TOLERANCES:
            other = time_at(curve, errors["taylor", rtol])
            if other is not None and errors["taylor", rtol] > FINEST:
                chosen = model.engine.automatic(model.methods, rtol, rtol / 100, many=kind == "sweep")
                yield kind, rtol, chosen, other / times["taylor", rtol].least


def main() -> None:
    """Print a line for each case and kind, and what is lost in all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", default="")
    lost: dict[str, list[float]] = {"run": [], "sweep": []}
    for name in (name for name in CASES if parser.parse_args().case in name):
        found = list(rows(name))
        for kind in lost:
            own = [(ratio, chosen) for each, _, chosen, ratio in found if each == kind]
            lost[kind] += [(ratio if chosen == "dop853" else 1.0) / min(ratio, 1.0) for ratio, chosen in own]
            texts = (f"{ratio:.2f}{'*' if chosen == 'dop853' else ' '}" for ratio, chosen in own)
            print(f"{name:40s} {kind:6s} {' '.join(texts)}", flush=True)
    for kind, values in lost.items():
        if values:
            print(f'{kind}: "auto" takes {np.mean(values):.3f} times the faster method, at most {max(values):.2f}')


if __name__ == "__main__":
    main()
