"""Time at equal error: curves of time against error, read at the same errors, and ratios to a reference solver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["TARGETS", "ratios", "time_at"]

Record = Mapping[str, Any]
TARGETS = (1e-6, 1e-9, 1e-12)
_TIME = {"sweep": "us", "trajectory": "run_us"}


def time_at(points: Sequence[tuple[float, float]], error: float) -> float | None:
    """Return the time at which a solver reaches an error; None where it was not measured on both sides of it.

    Parameters
    ----------
    points : sequence of (error, time)
        One a tolerance; between them the logarithm of time is linear in that of the error.
    """
    best: list[tuple[float, float]] = []
    for e, t in sorted(points, reverse=True):  # a point that another one beats in both says nothing
        while best and best[-1][1] >= t:
            best.pop()
        best.append((e, t))
    if not best or best[-1][0] > error:
        return None
    if best[0][0] <= error:
        return best[0][1]
    logs = np.log([(e, t) for e, t in reversed(best)])
    return float(np.exp(np.interp(np.log(error), logs[:, 0], logs[:, 1])))


def ratios(records: Sequence[Record], kind: str, reference: str) -> list[dict[str, Any]]:
    """Return, a scene and label, the times at `TARGETS` and how often the reference's label fits into them.

    `kind` is "sweep" or "trajectory"; `reference` is the label by whose times the others are divided.
    """
    rows = []
    for scene in dict.fromkeys(r["scene"] for r in records):
        curves: dict[str, list[tuple[float, float]]] = {}
        for r in records:
            if r["scene"] == scene:
                curves.setdefault(r["label"], []).append((r["error"], r[_TIME[kind]]["median"]))
        own = [time_at(curves.get(reference, []), target) for target in TARGETS]
        for label, curve in curves.items():
            times = [time_at(curve, target) for target in TARGETS]
            shares = [None if a is None or b is None else a / b for a, b in zip(times, own, strict=True)]
            rows.append({"scene": scene, "label": label, "times": times, "ratios": shares})
    return rows
