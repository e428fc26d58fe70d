"""Random scenes of the corpus: descriptions with final states, reactions and an event of the independent reference."""

from __future__ import annotations

import math
import sys
import warnings
from typing import Any

import numpy as np

import dalembert as da
from fuzz.compare import ATOL, RTOL
from fuzz.description import PointCondition, from_json, to_json
from fuzz.generator import generated
from fuzz.motion import integrated
from fuzz.scene_builder import SceneBuilder
from fuzz.verdicts import FINE, Judge

__all__ = ["checked", "frozen"]

LARGEST = 2800
"""Characters that a description may take."""


def frozen(seed: int) -> dict[str, Any] | None:
    """Return the entry of a seed, or None if the code is not right, or the reference is not sure of itself."""
    description = generated(seed)
    text = to_json(description)
    if len(text) > LARGEST:
        return None
    judge = Judge(description)
    if judge.verdict.kind != "regular" or judge.motion.failed:
        return None
    if judge.uncertainty > 1e-8:
        return None
    final = judge.motion.y[-1, :, 2]
    entry: dict[str, Any] = {"seed": seed, "family": description.family, "style": description.style}
    entry |= {"final": [float(x) for x in final], "reactions": _reactions(judge), "event": _crossing(judge)}
    entry |= {"description": text, "bound": math.inf}
    errors, bad = checked(entry)
    error = max(errors.values())
    if bad or error > 1e-7:
        print(f"seed {seed}: left out: {errors}, {bad}", file=sys.stderr)
        return None
    return entry | {"error": float(f"{error:.1e}"), "bound": max(10 * float(f"{error:.1e}"), 1e-9)}


def _reactions(judge: Judge) -> dict[str, float]:
    """Return the unknown reactions at the end."""
    items = judge.description.constraints
    multipliers = judge.solved_along()[-1][2].multipliers[0]
    named = [(item.reaction, x) for item, x in zip(items, multipliers, strict=True) if isinstance(item, PointCondition)]
    return {name: float(x) for name, x in named if name}


def _crossing(judge: Judge) -> dict[str, Any] | None:
    """Return a coordinate that crosses a level once, the level, and when; None where none does so plainly."""
    y, parameters = judge._single()
    t0, t1 = judge.description.span
    n = len(judge.names)

    def states(times: Any) -> Any:
        stops = [t for t in judge.stops if t < times[-1]]
        return integrated(judge.reference, y, parameters, times, stops, rtol=FINE).y[:, :, 0]

    times = np.linspace(t0, t1, 61)
    rows = states(times)
    for i in np.argsort(-np.abs(rows[-1, :n] - rows[0, :n])):
        level = round(float(0.5 * (rows[0, i] + rows[-1, i])), 4)
        above = rows[:, i] > level
        (changes,) = np.nonzero(above[1:] != above[:-1])
        if len(changes) != 1 or abs(rows[changes[0], n + i]) < 0.05:
            continue
        t = float(times[changes[0]]) + 1e-4
        for _ in range(3):
            here = states(np.array([t0, t]))[-1]
            t += (level - here[i]) / here[n + i]
        if abs(level - here[i]) > 1e-12 or any(abs(t - stop) < 1e-6 for stop in judge.stops):
            continue
        return {"coordinate": int(i), "level": level, "t": float(t)}
    return None


def checked(entry: dict[str, Any]) -> tuple[dict[str, float], list[str]]:
    """Return the errors of an entry on this tree, and what is beyond its bound, in words."""
    description = from_json(entry["description"])
    builder = SceneBuilder(description)
    names = list(description.coordinates)
    initial = {key: x for key, x in description.start.items() if key not in description.left_out}
    event = entry["event"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = da.compile_model(builder.scene, outputs=list(entry["reactions"]))
        known = {key: x for key, x in description.parameters.items() if key in model.layout.parameters}
        watched = [da.Event(builder.q[event["coordinate"]] - event["level"], name="crossing")] if event else []
        run = model.simulate(description.span, initial, known, rtol=RTOL, atol=ATOL, events=watched)
    if not run.success:
        return {"final": math.inf}, [f"ended with {run.status.name}: {run.message}"]
    final, sizes = np.array(entry["final"]), np.maximum(1.0, np.abs(entry["final"]))
    ours = np.array([run[key][-1] for key in (*names, *(f"{name}_dot" for name in names))])
    errors = {"final": float(np.max(np.abs(ours - final) / sizes))}
    if entry["reactions"]:
        scale = max(1.0, *map(abs, entry["reactions"].values()))
        gaps = [abs(run[name][-1] - x) / scale for name, x in entry["reactions"].items()]
        errors["reactions"] = float(max(gaps))
    if event:
        times = run.events["crossing"].t
        errors["event"] = abs(float(times[0]) - event["t"]) if len(times) == 1 else math.inf
    bad = [
        f"{what} off by {e:.1e}, bound {entry['bound']:.0e}" for what, e in errors.items() if not e <= entry["bound"]
    ]
    return errors, bad
