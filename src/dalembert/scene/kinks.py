"""Kinks of constraints, which are faults of a scene, and of gaps of contacts, with what changes its sign there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..ir.graph import Graph
from ..naming import rate_name
from .expressions.kink_checks import kinked_constraints, kinks_of_gap
from .model import ConstraintModel, ContactModel


def faults_of_kinks(
    graph: Graph,
    coordinates: Sequence[str],
    holonomic: Sequence[ConstraintModel],
    nonholonomic: Sequence[ConstraintModel],
) -> list[str]:
    """Return a fault for every constraint on whose velocities a kink would impose a jump."""
    moving = [graph.input(name) for name in coordinates]
    rates = [graph.input(rate_name(name)) for name in coordinates]
    faults: list[str] = []
    for rows, by in ((holonomic, moving), (nonholonomic, rates)):
        faults += kinked_constraints(graph, [(row.label, row.expression) for row in rows], moving, by)
    return faults


def contacts_with_kinks(
    graph: Graph, coordinates: Sequence[str], contacts: Sequence[ContactModel]
) -> tuple[list[ContactModel], list[str]]:
    """Return contacts with what changes its sign at kinks of their gaps, and a fault for each that is not known."""
    moving, found, faults = [graph.input(name) for name in coordinates], list[ContactModel](), list[str]()
    for contact in contacts:
        kinks, wrong = ((), []) if contact.gap is None else kinks_of_gap(graph, contact.name, contact.gap, moving)
        found.append(replace(contact, kinks=kinks))
        faults += wrong
    return found, faults
