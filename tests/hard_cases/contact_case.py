"""`ContactCase`: a motion with friction or contacts, with reference values, and reference times of its transitions."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, final

import numpy as np

from hard_cases.case import HardCase

__all__ = ["ContactCase", "contact_case", "contact_reference"]


@cache
def _references() -> dict[str, Any]:
    return json.loads(Path(__file__).with_name("friction_references.json").read_text())


def contact_reference(name: str) -> Any:
    """Return an entry of ``friction_references.json``."""
    return _references()[name]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ContactCase:
    """A motion in phases.

    Attributes
    ----------
    motion : HardCase
        Scene, start, parameters, what is observed with its reference values, and bounds.
    phases : sequence of (float, mapping of str to str)
        Starts of the phases, and what each contact does in them.
    bound : float
        Largest error allowed of a start, over max(1, its time).
    """

    motion: HardCase
    phases: Sequence[tuple[float, Mapping[str, str]]]
    bound: float = 1e-12

    def modes(self) -> list[dict[str, str]]:
        """Return what the contacts do, a phase each."""
        return [dict(modes) for _, modes in self.phases]

    def transition_error(self, run: Any) -> float:
        """Return the largest error of the start of a phase, over max(1, its time)."""
        ours = np.array([phase.t0 for phase in run.phases])
        theirs = np.array([t for t, _ in self.phases])
        return float(np.max(np.abs(ours - theirs) / np.maximum(1.0, theirs)))


def contact_case(
    name: str,
    scene: Any,
    initial: Mapping[str, float],
    observed: Sequence[Any],
    *,
    bound: float,
    time_bound: float = 1e-12,
    renamed: Mapping[str, str] | None = None,
    quantity: str = "",
    scale: Sequence[float] = (),
) -> ContactCase:
    """Return the case of an entry of the references; `renamed` says which parameters the scene calls otherwise."""
    entry = contact_reference(name)
    names = dict(renamed or {})
    motion = HardCase(
        scene=scene,
        parameters={names.get(key, key): float(value) for key, value in entry["parameters"].items()},
        initial=initial,
        observed=observed,
        quantity=quantity,
        scale=scale,
        values={float(row["t"]): row["state"] for row in entry["rows"]},
        source=entry["source"],
        bound=bound,
        conserved=(),
        rtol=1e-14,
        atol=1e-16,
    )
    return ContactCase(
        motion=motion, phases=[(float(phase["t"]), phase["modes"]) for phase in entry["phases"]], bound=time_bound
    )
