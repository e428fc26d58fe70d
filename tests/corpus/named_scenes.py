"""Named scenes of the corpus: hard cases, motions with contacts, ready scenes; with references of their own.

An entry records final coordinates and rates, the reactions that are determined, and the phases of contacts. What the
references of `tests/hard_cases` do not hold was recorded from the code, and two formulations agreed on it: `doubt` is
their difference.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import dalembert as da
from hard_cases import CASES, hard_case
from hard_cases.contacts import CONTACT_CASES, contact_motion

__all__ = ["NAMES", "checked", "frozen"]

LONG = 8.0
"""Seconds of processor time of a run that is left out of the corpus."""


@dataclass(frozen=True)
class Ready:
    """A run of a ready scene."""

    build: Callable[[], da.Scene]
    initial: dict[str, float]
    parameters: dict[str, float]
    span: tuple[float, float] = (0.0, 2.0)


_ANGLES = {"psi": 0.3, "theta": 0.7, "phi": -0.2, "psi_dot": 0.5, "theta_dot": -0.4, "phi_dot": 1.1}
READY = {
    "ready: chaplygin_sleigh": Ready(
        da.scenes.chaplygin_sleigh,
        {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0},
        {"m": 1, "b": 0.3, "I_C": 0.5},
    ),
    "ready: rolling_sphere": Ready(
        da.scenes.rolling_sphere, {"x": 0, "y": 0.1, **_ANGLES}, {"m": 2, "r": 0.5, "g": 9.81}
    ),
    "ready: corner_plate": Ready(
        da.scenes.corner_plate,
        {"x": -0.8 / math.tan(1.0), "theta": 1.0, "theta_dot": 0.3},
        {"m": 1, "l": 1, "h": 0.8, "g": 9.81, "F_A": 4},
        (0.0, 0.3),
    ),
    "ready: edge_plate": Ready(
        da.scenes.edge_plate,
        {"x": 0, "y": 0, "psi": 0.1, "theta": 0.6, "x_dot": 0.4, "y_dot": 0, "psi_dot": 0.5, "theta_dot": 0.2},
        {"m": 1, "A": 0.4, "B": 0.3, "C": 0.6, "F": 0.05, "h": 0.5, "g": 9.81},
        (0.0, 0.5),
    ),
}
NAMES = (*READY, *CASES, *CONTACT_CASES)


def frozen(name: str) -> dict[str, Any] | None:
    """Return the entry of a scene, or None for a run that is too long for the corpus or that may fail."""
    values, reactions, phases, seconds = _observed(name, "auto", None)
    if seconds > LONG:
        return None
    twin = values
    if name not in CONTACT_CASES:
        try:
            twin = _observed(name, "projected", list(reactions))[0]
        except da.errors.DalembertError:
            twin = values
    doubt = max((abs(values[key] - twin[key]) / max(1.0, abs(values[key])) for key in values), default=0.0)
    entry: dict[str, Any] = {"name": name, "final": values, "reactions": reactions, "phases": phases}
    error = _error(name)
    return entry | {
        "error": None if error is None else float(f"{error:.1e}"),
        "source": "recorded" if error is None else _motion(name).source,
        "doubt": float(f"{doubt:.1e}"),
        "bound": float(f"{max(10 * doubt, 10 * (error or 0.0), 1e-9):.1e}"),
    }


def _motion(name: str) -> Any:
    return contact_motion(name).motion if name in CONTACT_CASES else hard_case(name)


def _error(name: str) -> float | None:
    """Return the error against the case's own reference values, over their size; None without such values."""
    if name in READY:
        return None
    motion = _motion(name)
    return float(motion.error(motion.simulate(motion.compile("auto"))))


def _observed(
    name: str, formulation: str, wanted: list[str] | None
) -> tuple[dict[str, float], dict[str, float], list[Any], float]:
    """Return final coordinates and rates, reactions (those wanted, or all determined ones), phases, and seconds."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if name in READY:
            ready = READY[name]
            scene, initial, parameters, span = ready.build(), ready.initial, ready.parameters, ready.span
            options: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-14}
        else:
            motion = _motion(name)
            scene, initial, parameters = motion.scene, motion.initial, motion.parameters
            span, options = (0.0, motion.times()[-1]), {"rtol": motion.rtol, "atol": motion.atol}
        outputs = _determined(scene, formulation) if wanted is None else wanted
        model = da.compile_model(scene, formulation=formulation, outputs=outputs)
        begin = time.process_time()
        run = model.simulate(span, initial, parameters, t_eval=span, max_steps=10_000_000, **options)
        seconds = time.process_time() - begin
    if not run.success:
        raise da.errors.DalembertError(f"{name}: {run.status.name}: {run.message}")
    layout = model.layout
    values = {key: float(run[key][-1]) for key in (*layout.coordinates, *layout.rates)}
    reactions = {key: float(run[key][-1]) for key in outputs}
    phases = [[phase.t0, dict(phase.modes)] for phase in run.phases] if name in CONTACT_CASES else []
    return values, reactions, phases, seconds


def _determined(scene: da.Scene, formulation: str) -> list[str]:
    """Return the unknown reactions that the equations of a scene determine."""
    vectors = [vector for joint in scene.joints for vector in (joint.force, joint.torque) if vector != 0]
    unknowns: set[str] = set()
    for vector in vectors:
        for column, _ in vector.args:
            unknowns |= {s.name for s in column.free_symbols if type(s).__name__ == "Unknown"}
    kept = []
    for unknown in sorted(unknowns):
        try:
            da.compile_model(scene, formulation=formulation, backend="numpy", outputs=[unknown])
        except da.errors.DalembertError:
            continue
        kept.append(unknown)
    return kept


def checked(entry: dict[str, Any]) -> tuple[dict[str, float], list[str]]:
    """Return the errors of an entry on this tree, and what is beyond its bound, in words."""
    name, bad = entry["name"], []
    values, reactions, phases, _ = _observed(name, "auto", list(entry["reactions"]))
    errors = {"final": _largest(values, entry["final"])}
    if reactions:
        errors["reactions"] = _largest(reactions, entry["reactions"])
    if entry["phases"]:
        same = [modes for _, modes in phases] == [modes for _, modes in entry["phases"]]
        gaps = [abs(t - kept) / max(1.0, kept) for (t, _), (kept, _) in zip(phases, entry["phases"], strict=False)]
        errors["phases"] = max(gaps) if same else math.inf
    bad += [
        f"{what} off by {e:.1e}, bound {entry['bound']:.0e}" for what, e in errors.items() if not e <= entry["bound"]
    ]
    error = _error(name)
    if error is not None:
        errors["reference"] = error
        if not error <= _motion(name).bound:
            bad.append(f"error against the reference {error:.1e}, bound {_motion(name).bound:.0e}")
    return errors, bad


def _largest(ours: dict[str, float], kept: dict[str, float]) -> float:
    scale = np.maximum(1.0, np.abs(list(kept.values())))
    return float(np.max(np.abs([ours[key] - x for key, x in kept.items()]) / scale))
