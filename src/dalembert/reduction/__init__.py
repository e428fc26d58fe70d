"""Registry of formulations: [EquationsOfMotion] -> [ReducedSystem], one formulation a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..errors import ConstraintError, FormulationError, OptionError, unknown_name
from ..mechanics.equations import EquationsOfMotion
from .base import Formulation, Projection, ReducedSystem, ReductionSettings
from .dependent_rows import Redundancy
from .first_order_states import with_states
from .minimal import Minimal, prescribed
from .redundancy import independent_constraints
from .saddle import Augmented, Projected
from .stabilised import Baumgarte, GearGuptaLeimkuhler

__all__ = ["FORMULATIONS", "Formulation", "Projection", "ReducedSystem", "reduce"]

FORMULATIONS: dict[str, Formulation] = {
    f.name: f for f in (Minimal(), Projected(), Baumgarte(), GearGuptaLeimkuhler(), Augmented())
}
"""Every formulation by name; "auto" chooses among the first two."""


def reduce(
    equations: EquationsOfMotion,
    formulation: str = "auto",
    requested: Sequence[str] = (),
    without: Sequence[int] = (),
    redundancy: Redundancy | None = None,
) -> ReducedSystem:
    """Return the equations of motion in the given formulation.

    Parameters
    ----------
    equations : EquationsOfMotion
        Equations to reduce.
    formulation : str
        A name in `FORMULATIONS`, or "auto": `minimal` where a basis exists that divides by no function of the
        configuration, else `projected`.
    requested : sequence of str
        Outputs to compute, by name or text.
    without : sequence of int
        Constraints that a run found to follow from the others; they are monitored, but not enforced.
    redundancy : Redundancy, optional
        What a run found of the constraints that are left, all of which are enforced.

    Raises
    ------
    OptionError
        For an unknown formulation.
    FormulationError
        When the formulation does not support the scene.
    ConstraintError
        For constraints that contradict each other, and reactions that are not determined.
    """
    given: object = formulation
    if not isinstance(given, str) or given not in (*FORMULATIONS, "auto"):
        raise OptionError(unknown_name("formulation", str(formulation), ["auto", *FORMULATIONS]))
    if any(point.kind == "break" for point in equations.guards):
        still = prescribed(equations, requested)
        if still is not None:
            return with_states(still, equations)
    rows = equations.constraints
    left_out = unproven = tuple(without)
    enforced = equations
    if left_out:
        enforced = replace(equations, constraints=tuple(row for i, row in enumerate(rows) if i not in left_out))
    if redundancy is not None:
        reduced = _reduce_together(enforced, formulation, requested, redundancy)
        return replace(reduced, equations=replace(reduced.equations, constraints=rows), left_out=left_out)
    try:
        reduced = _reduce(enforced, formulation, requested)
    except ConstraintError:
        independent = independent_constraints(enforced)
        if not independent.decided:
            raise
        left_out = tuple(i for i, row in enumerate(rows) if i in left_out or any(row is d for d in independent.dropped))
        unproven = tuple(i for i in left_out if i in unproven or any(rows[i] is d for d in independent.unproven))
        reduced = _reduce(independent.equations, formulation, requested)
    reduced = with_states(reduced, reduced.equations)
    if not left_out:
        return reduced
    note = f"left out, because they follow from the other constraints: {', '.join(rows[i].label for i in left_out)}"
    whole = replace(reduced.equations, constraints=rows)
    return replace(reduced, equations=whole, notes=(*reduced.notes, note), left_out=left_out, unproven=unproven)


def _reduce_together(
    equations: EquationsOfMotion, formulation: str, requested: Sequence[str], redundancy: Redundancy
) -> ReducedSystem:
    """Return a system that enforces all rows of equations, of which some follow from others."""
    scaled = replace(equations, constraints=redundancy.scaled(equations.constraints))
    settings = ReductionSettings(regular=False, redundancy=redundancy)
    reduced = with_states(FORMULATIONS[formulation].reduce(scaled, requested, settings), scaled)
    count = len(equations.constraints)
    note = f"{count} constraints of rank {redundancy.rank} are enforced together: the others follow"
    return replace(reduced, regular=False, redundancy=redundancy, notes=(*reduced.notes, note))


def _reduce(equations: EquationsOfMotion, formulation: str, requested: Sequence[str]) -> ReducedSystem:
    if formulation == "minimal":
        return FORMULATIONS["minimal"].reduce(equations, requested)
    try:
        minimal = FORMULATIONS["minimal"].reduce(equations, requested if formulation == "auto" else ())
    except FormulationError as reason:
        settings = ReductionSettings(regular=False)
        if formulation != "auto":
            return replace(FORMULATIONS[formulation].reduce(equations, requested, settings), regular=False)
        reduced = replace(FORMULATIONS["projected"].reduce(equations, requested, settings), regular=False)
        why = str(reason).split(": ", 1)[1].split(". Use")[0]
        return replace(reduced, notes=(*reduced.notes, f"chosen because 'minimal' does not support the scene: {why}"))
    if formulation == "auto":
        why = "chosen because its basis is regular at every configuration"
        return minimal if not equations.constraints else replace(minimal, notes=(*minimal.notes, why))
    # what minimal has made offers the graph forms of the same accelerations that are often a third as long
    regular = not minimal.pivots  # which vanish at some parameters, where constraints may depend on each other
    reduced = FORMULATIONS[formulation].reduce(equations, requested, ReductionSettings(regular=regular))
    return replace(reduced, regular=regular)
