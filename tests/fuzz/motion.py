"""Motions of the reference: DOP853 on the second rates, several cases side by side, stopped where time breaks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from fuzz.jets import Kinks
from fuzz.kinematics import Environment
from fuzz.newton_euler import Reference
from fuzz.solving import solved

__all__ = ["Motion", "breaks", "integrated"]

SAMPLES = 4001
"""Points at which conditions of time are sampled for sign changes."""


@dataclass(frozen=True, eq=False)
class Motion:
    """States (n_t, 2 n, C) at times (n_t,), and the worst of what was met on the way.

    `failed` says why there is none. `gap` and `regular` are the smallest of `Solved`, `ranks` all ranks met.
    """

    t: Any
    y: Any
    gap: float
    regular: float
    ranks: frozenset[int]
    evaluations: int
    failed: str = ""


def breaks(kinks: tuple[Kinks, ...], span: tuple[float, float], parameters: dict[str, Any]) -> list[float]:
    """Return the times within a span at which a condition of time alone changes, in any case."""
    indicators = [f for kink in kinks for f in kink.indicators]
    t0, t1 = span
    times = np.linspace(t0, t1, SAMPLES)
    found: set[float] = set()
    for indicator in indicators:

        def level(t: Any, indicator: Any = indicator) -> Any:
            return np.asarray(indicator(Environment([], [], np.asarray(t)[..., None], parameters)))

        values = level(times)
        values = np.broadcast_to(values, (len(times), values.shape[-1]))
        for i, c in zip(*np.nonzero(values[1:] != values[:-1]), strict=True):
            low, high = times[i], times[i + 1]
            while high - low > 4e-16 * max(1.0, abs(low)):
                middle = 0.5 * (low + high)
                if middle in (low, high):
                    break
                here = np.broadcast_to(level(np.array([middle])), (1, values.shape[1]))[0, c]
                low, high = (middle, high) if here == values[i, c] else (low, middle)
            found.add(float(high))
    merged: list[float] = []
    for t in sorted(found):
        if t0 + 1e-12 < t < t1 - 1e-12 and (not merged or t - merged[-1] > 1e-12):
            merged.append(t)
    return merged


def integrated(
    reference: Reference,
    y0: Any,
    parameters: dict[str, Any],
    times: Any,
    stops: list[float],
    *,
    rtol: float,
    budget: int = 8_000,
) -> Motion:
    """Return the motions from states y0 (2 n, C) at the first of some times, recorded at all of them."""
    n, count = reference.size, y0.shape[1]
    worst = {"gap": np.inf, "regular": np.inf, "evaluations": 0}
    ranks: set[int] = set()
    middle = 0.0

    def rates(t: float, y: Any) -> Any:
        worst["evaluations"] += 1
        if worst["evaluations"] > budget:
            raise _TooLongError
        y = y.reshape(2 * n, count)
        found = solved(reference.equations(t, y, parameters, middle))
        worst["gap"] = min(worst["gap"], float(found.gap.min()))
        worst["regular"] = min(worst["regular"], float(found.regular.min()))
        ranks.update(map(int, found.rank))
        return np.concatenate([y[n:].ravel(), found.qdd.T.ravel()])

    edges = [float(times[0]), *stops, float(times[-1])]
    recorded, y, failed = [np.array(y0)], np.array(y0).ravel(), ""
    try:
        with np.errstate(all="ignore"):
            for low, high in pairwise(edges):
                middle = 0.5 * (low + high)
                here = [t for t in times[1:] if low < t <= high]
                wanted = here if here and here[-1] == high else [*here, high]
                run = solve_ivp(
                    rates,
                    (low, high),
                    y,
                    method="DOP853",
                    t_eval=wanted,
                    rtol=rtol,
                    atol=rtol * 0.1,
                    first_step=min(1e-2, 0.25 * (high - low)),
                )
                if not run.success or run.y.shape[1] < len(wanted) or not np.isfinite(run.y).all():
                    failed = "the reference does not reach the end"
                    break
                y = run.y[:, -1]
                recorded += [run.y[:, i].reshape(2 * n, count) for i in range(len(here))]
    except _TooLongError:
        failed = "the reference takes too many steps"
    except (np.linalg.LinAlgError, ValueError) as reason:
        failed = f"the reference fails: {type(reason).__name__}"
    states = np.array(recorded) if not failed else np.zeros((0, 2 * n, count))
    return Motion(times, states, worst["gap"], worst["regular"], frozenset(ranks), int(worst["evaluations"]), failed)


class _TooLongError(Exception):
    """The budget of evaluations is used up."""
