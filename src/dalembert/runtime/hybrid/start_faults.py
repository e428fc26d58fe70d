"""Faults of initial states and parameters of scenes with contacts."""

from __future__ import annotations

from ...errors import InitialStateError, ValueInputError
from ...integrators.contact_cases import ContactCases
from ...integrators.contact_system import opening_power
from .mode_models import ModeModels

__all__ = ["start_error"]


def start_error(modes: ModeModels, cases: ContactCases) -> Exception | None:
    """Return what is wrong with the start of a motion, None where nothing is."""
    decisions = modes.decisions
    system = decisions.system(decisions.values(cases.t, cases.x, cases.p)[0])
    mu, static, e = system.mu, system.mu_static, system.restitution
    faults = []
    for i, contact in enumerate(modes.equations.contacts):
        if mu[i] < 0.0:
            faults.append(f"mu of {contact.name!r} is {mu[i]:g}; it must not be negative")
        elif static[i] < mu[i]:
            faults.append(
                f"mu_static of {contact.name!r} is {static[i]:g}, less than mu = {mu[i]:g}; raise it, or leave it out"
            )
        if not 0.0 <= e[i] <= 1.0:
            faults.append(f"restitution of {contact.name!r} is {e[i]:g}; it must lie between 0 and 1")
    if faults:
        return ValueInputError("; ".join(faults))
    for i, contact in enumerate(modes.equations.contacts):
        name = modes.equations.symbols.unknowns[contact.normal]
        if contact.constraint is None:
            continue
        if not opening_power(system, i) > 0.0:
            faults.append(
                f"contact {contact.name!r}: {name} pushes its gap closed here; turn the sign of the gap, or the"
                " direction of the force in the joint"
            )
        elif system.gap[i] < 0.0:
            faults.append(f"contact {contact.name!r} penetrates: its gap is {system.gap[i]:.3g}; start with gap >= 0")
    if not faults:
        return None
    return InitialStateError("the initial state contradicts the contacts:\n  " + "\n  ".join(faults))
