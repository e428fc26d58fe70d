"""Check that the normal reactions of contacts that open act along their gaps."""

from __future__ import annotations

from ..errors import ConstraintError
from ..mechanics.equations import EquationsOfMotion
from ..mechanics.manifold import outside_span_on_manifold
from ..mechanics.reaction_checks import parallel

__all__ = ["require_normals_along_gaps"]


def require_normals_along_gaps(equations: EquationsOfMotion) -> None:
    """Raise unless every contact that opens can be held closed by normal reactions, without its friction.

    Impacts and the selection of modes take the reaction of a gap to have power along it, and none along the slip
    velocity; with another direction sliding has no equations.

    Raises
    ------
    ConstraintError
        With the contact, the coordinates along which power is missing, and what to do.
    """
    tangential = {i for contact in equations.contacts for i in contact.tangential}
    opening = {contact.constraint for contact in equations.contacts}
    rows = equations.constraints
    lasting = [row for i, row in enumerate(rows) if i not in opening]
    names = equations.symbols.unknowns
    others = [[row[i] for row in equations.reactions] for i in range(len(names)) if i not in tangential]
    for contact in equations.contacts:
        if contact.constraint is None:
            continue
        gap = rows[contact.constraint]
        if parallel(equations.graph, gap.jacobian, [row[contact.normal] for row in equations.reactions]):
            continue
        covectors = [*others, *(row.jacobian for row in lasting)]
        positions = [row.position for row in (gap, *lasting) if row.position is not None]
        missing = outside_span_on_manifold(equations.q, covectors, positions, [gap.jacobian])
        if missing:
            along = ", ".join(equations.symbols.coordinates[i] for i in missing)
            raise ConstraintError(
                f"scene {equations.name!r}: the normal reaction {names[contact.normal]!r} of the contact"
                f" {contact.name!r} does not act along its gap (their powers on {along} differ): it would have power on"
                " motions that keep the gap. Let its force in the joint be normal to the surfaces that touch, and"
                " friction the rest"
            )
