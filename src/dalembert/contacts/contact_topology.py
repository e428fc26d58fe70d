"""The contacts of a scene as `ContactSystem`: what its constraints, reactions and slip velocities are, and memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph
from ..ir.node import Node
from ..options.other_calls import IMPACTS
from ..subset.arguments import IntVector
from ..transforms.linear import dependence
from .contact_system import ContactSystem, Solved
from .equations.contact_laws import NUMBERS, STATES
from .selection.dense_solve import dense_workspace

if TYPE_CHECKING:
    from ..mechanics.equations import ContactRow, EquationsOfMotion
    from .automaton import HybridAutomaton

_KEPT_RESPONSES = 8
"""Sets of open contacts whose responses are kept during one decision."""


def contact_system(automaton: HybridAutomaton) -> ContactSystem:
    """Return the contacts of a scene, with memory of their own."""
    equations, k = automaton.equations, len(automaton.contacts)
    n, m, u = len(equations.q), len(equations.constraints), len(equations.symbols.unknowns)
    s = sum(len(contact.slips) for contact in automaton.contacts)
    r, size, one_each = m + s, max(n + m, u, s, 1), dict.fromkeys(NUMBERS, (k,))
    motion = {"mass": (n, n), "forcing": (n,), "jacobian": (r, n), "bias": (r,), "velocity": (r,), "power": (u, n)}
    values, numbers = _views(**motion, **one_each)
    solution, solved = _views(motion=(n,), press=(k,), opening=(k,), slip=(s,))
    entries = [not entry.is_zero for contact in automaton.contacts for row in contact.slips for entry in row.jacobian]
    named: dict[str, Any] = {**_topology(automaton), **numbers, **solved}
    return ContactSystem(
        coordinates=n,
        constraints=m,
        contacts=k,
        slips=s,
        impacts=IMPACTS.index(automaton.impacts),
        several=int(any(contact.leader is not None for contact in automaton.contacts)),
        **named,
        slides_by=np.array(entries, np.int64).reshape(s, n),
        loose=_loose(equations),
        values=values,
        rates=np.zeros(n),
        weight=np.ones(k),
        load=np.zeros(n),
        demand=np.zeros(r),
        restored=np.zeros(k),
        responses=np.zeros((_KEPT_RESPONSES * len(solution), 1 + s)),
        kept=np.zeros(_KEPT_RESPONSES, np.int64),
        scales=np.ones(n + m + u),
        saddle=np.zeros((size, size)),
        saddle_right=np.zeros((size, 1 + s + k)),
        compliances=np.zeros((s + k, 1 + s + k)),
        square=np.zeros((size, size)),
        square_right=np.zeros((size, 1 + s)),
        laws=np.zeros((s, s)),
        forces=np.zeros((s, 1)),
        held=np.zeros(m, np.int64),
        columns=np.zeros(u, np.int64),
        column=np.zeros(k, np.int64),
        solution=solution,
        free=np.zeros((s, s)),
        solved=Solved(),
        dense=dense_workspace(size),
    )


def _topology(automaton: HybridAutomaton) -> dict[str, IntVector]:
    """Return by name what `ContactSystem` holds of constraints, reactions and slip velocities of the contacts."""
    equations, contacts = automaton.equations, automaton.contacts
    m, ends = len(equations.constraints), np.cumsum([0, *(len(contact.slips) for contact in contacts)])
    row_owner, owner = np.full(m + ends[-1], -1), np.full(len(equations.symbols.unknowns), -1)
    for i, contact in enumerate(contacts):
        row_owner[m + ends[i] : m + ends[i + 1]] = i
        owner[contact.normal] = i if contact.leader is None else contact.leader
        owner[list(contact.tangential)] = -2
        if contact.constraint is not None:
            row_owner[contact.constraint] = i
    columns = {
        "leader": [i if c.leader is None else c.leader for i, c in enumerate(contacts)],
        "constraint": [-1 if c.constraint is None else c.constraint for c in contacts],
        "sense": [c.sense for c in contacts],
        "normal": [c.normal for c in contacts],
        "first": ends[:-1],
        "row": m + ends[:-1],
        "width": [len(c.slips) for c in contacts],
        "closed": [STATES.index(automaton.states(i)[0]) for i in range(len(contacts))],
        "sided": [not c.opens and len(c.tangential) > 0 and c.normal_load is None for c in contacts],
        "soft": [equations.symbols.unknowns[c.normal] in equations.compliances for c in contacts],
        "given": [c.normal_load is not None for c in contacts],
        "jumping": [_may_jump(equations, contact) for contact in contacts],
        "tangential": [unknown for c in contacts for unknown in c.tangential],
        "row_owner": row_owner,
        "owner": owner,
        "angle": _angles(equations),
    }
    return {name: np.array(column, np.int64) for name, column in columns.items()}


def _angles(equations: EquationsOfMotion) -> list[int]:
    """Return 0 for coordinates with a unit, 1 for those without, and a number for those of each unit quaternion."""
    found = [int(name in equations.angles) for name in equations.symbols.coordinates]
    for number, group in enumerate(group for group in equations.groups if group.norm):
        for place in group.coordinates:
            found[place] = 2 + number
    return found


def _loose(equations: EquationsOfMotion) -> IntVector:
    """Return `ContactSystem.loose`, of scenes without quaternions."""
    own, slips = Graph(), [row for contact in equations.contacts for row in contact.slips]
    if any(group.norm for group in equations.groups):
        return np.zeros(len(slips), np.int64)
    held, opening = list[list[Node]](), {contact.constraint for contact in equations.contacts}
    for row in (row for i, row in enumerate(equations.constraints) if i not in opening):
        slopes = own.adopt(row.jacobian)
        if dependence(own, held, slopes) is None:
            held.append(slopes)
    return np.array([dependence(own, held, own.adopt(row.jacobian)) is None for row in slips], np.int64)


def _may_jump(equations: EquationsOfMotion, contact: ContactRow) -> bool:
    """Return whether a condition on time stands in a slip velocity of a contact."""
    if CONDITION_TIME not in equations.symbols.parameters:
        return False
    decided = equations.graph.input(CONDITION_TIME).deps
    return any(node.deps & decided for slip in contact.slips for node in (slip.drift, *slip.jacobian))


def _views(**shapes: tuple[int, ...]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return memory for arrays one after the other, and these by name, which are views of it."""
    sizes = [int(np.prod(shape)) for shape in shapes.values()]
    memory = np.zeros(sum(sizes))
    parts = np.split(memory, np.cumsum(sizes)[:-1])
    return memory, {name: part.reshape(shapes[name]) for name, part in zip(shapes, parts, strict=True)}
