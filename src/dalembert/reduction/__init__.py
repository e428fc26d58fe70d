"""[EquationsOfMotion] -> [ReducedSystem]: one formulation a file, all registered here."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from ..errors import FormulationError, OptionError, unknown_name
from ..mechanics.equations import EquationsOfMotion
from .base import Formulation, Projection, ReducedSystem
from .minimal import Minimal
from .saddle import Augmented, Projected

__all__ = ["FORMULATIONS", "Formulation", "Projection", "ReducedSystem", "reduce"]

FORMULATIONS: dict[str, Formulation] = {f.name: f for f in (Minimal(), Projected(), Augmented())}
"""Every formulation by name; "auto" chooses among the first two."""


def reduce(equations: EquationsOfMotion, formulation: str = "auto", requested: Sequence[str] = ()) -> ReducedSystem:
    """Return the equations of motion in the given formulation.

    Parameters
    ----------
    equations : EquationsOfMotion
        What to reduce.
    formulation : str
        A name in `FORMULATIONS`, or "auto": `minimal` where a basis exists that divides by no function of the
        configuration, else `projected`.
    requested : sequence of str
        Outputs to compute, by name or text.

    Raises
    ------
    OptionError
        For an unknown formulation.
    FormulationError
        When the formulation cannot serve the scene.
    """
    if formulation not in (*FORMULATIONS, "auto"):
        raise OptionError(unknown_name("formulation", str(formulation), ["auto", *FORMULATIONS]))
    if formulation == "minimal":
        return FORMULATIONS["minimal"].reduce(equations, requested)
    if formulation != "auto":
        # the reduced equations offer the graph forms of the same accelerations that are often a third as long
        with contextlib.suppress(FormulationError):
            FORMULATIONS["minimal"].reduce(equations, ())
        return FORMULATIONS[formulation].reduce(equations, requested)
    try:
        return FORMULATIONS["minimal"].reduce(equations, requested)
    except FormulationError as reason:
        reduced = FORMULATIONS["projected"].reduce(equations, requested)
        why = str(reason).split(": ", 1)[1].split(". Use")[0]
        notes = (*reduced.notes, f"chosen because 'minimal' cannot serve: {why}")
        return ReducedSystem(**{**{f: getattr(reduced, f) for f in reduced.__dataclass_fields__}, "notes": notes})
