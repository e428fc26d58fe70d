"""Normal reactions of friction that the coordinates hide: [EquationsOfMotion] -> [EquationsOfMotion].

A block in the coordinate along its floor has no equation across it. Where the balance of its bodies gives the normal
reaction without accelerations and without other reactions, its friction is that of a given load. Otherwise friction
and the normal reaction depend on each other, which needs the coordinate that `Scene.release` adds.
"""

from __future__ import annotations

from dataclasses import replace

from ..errors import ConstraintError
from ..ir.node import Node
from ..ir.zero_tests import vanishes
from ..mechanics.equations import ContactRow, EquationsOfMotion
from ..mechanics.released_balances import released_balances
from ..naming import acceleration_input
from ..transforms.derivatives import tangents


def with_hidden_normals(equations: EquationsOfMotion) -> EquationsOfMotion:
    """Return equations in which friction has the hidden normal reactions that balances of bodies give.

    Others stay as they are. So do all in scenes with contacts that open: an impact may press on a hidden reaction, and
    transmits no friction of a given load.
    """
    contacts = equations.contacts
    if equations.scene is None or any(contact.gap is not None for contact in contacts):
        return equations
    found = tuple(_with_balance(equations, contact) for contact in contacts)
    return replace(equations, contacts=found)


def _with_balance(equations: EquationsOfMotion, contact: ContactRow) -> ContactRow:
    hidden = all(vanishes(row[contact.normal]) for row in equations.reactions)
    if contact.normal_load is not None or not contact.tangential or not hidden:
        return contact
    value = _by_balance(equations, contact.normal)
    if value is None:
        return contact
    return replace(contact, normal_load=equations.graph.call("abs", value), normal_value=value)


def _by_balance(equations: EquationsOfMotion, number: int) -> Node | None:
    """Return a reaction by one balance in terms of coordinates, rates, states and time; None where there is none."""
    graph, unknown = equations.graph, equations.unknowns[number]
    try:
        released = released_balances(equations, [equations.symbols.unknowns[number]])
    except ConstraintError:
        return None
    if len(released.balances) != 1:
        return None
    (balance,) = released.balances
    if balance.power is None or balance.unknowns != (number,):
        return None
    (power,) = graph.adopt([balance.power])
    slope = graph.freed_of(tangents(graph, [power], {unknown: graph.one})[0], equations.unknowns)
    (rest,) = graph.substitute([power], dict.fromkeys(equations.unknowns, graph.zero))
    seconds = graph.mask(map(acceleration_input, equations.symbols.coordinates))
    if slope is None or (slope.deps | rest.deps) & seconds:
        return None
    return -rest / slope
