"""Potential energy of a scene: gravity, loads, and potentials declared by bodies."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, final

from ..errors import EnergyWarning, list_names
from ..frozen import frozen
from ..ir.algebra import Algebra
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.random_points import match
from ..ir.zero_tests import agree
from ..transforms.derivatives import tangents
from .kinematics import Kinematics
from .load_potentials import LoadPart, given_parts, load_parts
from .manifold import agree_on_manifold
from .virtual_power import Powers, load_powers

if TYPE_CHECKING:
    from .equations import ConstraintRow


_COMBINED = 8
"""Number of loads up to which every selection of them is compared with a declared potential energy."""


@final
@frozen
class LoadEnergy:
    """The potential energy of given loads, and the loads that it leaves out.

    Attributes
    ----------
    potential : Node or None
        On a graph of its own; None where no load has one, or bodies declare it.
    declared : Node or None
        The potential energy beside gravity that bodies declare, where it was found to be that of loads; on that graph.
    powers : tuple of Node, length n_q or 0
        Minus the gradient of both, in the form of the power coefficients of the loads: its branches are theirs.
    included : tuple of str
        Names of the loads that are in it.
    rates, time, unknown, states : tuple of str
        Names of loads that are not in it, or not wholly: those that depend on rates, those that depend on time
        explicitly, those that act at rest and have no potential that was found, and those that depend on states.
    """

    potential: Node | None = None
    declared: Node | None = None
    powers: tuple[Node, ...] = ()
    included: tuple[str, ...] = ()
    rates: tuple[str, ...] = ()
    time: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    states: tuple[str, ...] = ()

    def incomplete(self, scene: str) -> str:
        """Return the text of the warning for a requested energy that lacks potentials; empty where none is missing."""
        if not self.unknown:
            return ""
        return (
            f'scene {scene!r}: "energy" is without the work of {list_names(self.unknown)}: no potential energy is known'
            " for these loads, because they have none or because it was not found. If they have one, declare it:"
            " set potential_energy of a body to it. For others, such as forces that follow a body, the energy changes"
            " by their work"
        )


def warn_of_silent_potential(kinematics: Kinematics, power: Powers, forcing: Sequence[Node]) -> tuple[int, ...]:
    """Warn of a declared potential energy along which no load acts; return the numbers of those coordinates.

    Bodies declare it, as in SymPy, without any force.
    """
    graph, model = kinematics.graph, kinematics.model
    if all(declared.is_zero for declared in model.potentials):
        return ()
    still = graph.substitute(list(forcing), dict.fromkeys(kinematics.qdot, graph.zero))
    silent = []
    for i, (q, force) in enumerate(zip(kinematics.q, still, strict=True)):
        slope, weight = (tangents(graph, [x], {q: graph.one})[0] for x in (power.potential_energy, power.weighing))
        if not agree([slope], [weight]) and agree([force], [-weight]):
            silent.append(i)
    if silent:
        names = [model.symbols.coordinates[i] for i in silent]
        warnings.warn(
            f"scene {model.name!r}: the potential energy of its bodies depends on {list_names(names)}, along which no"
            " load acts. As in SymPy's System and KanesMethod it exerts no force, and counts in the energies alone: add"
            " the load that it stands for, minus its gradient, with add_loads, or remove it (that of"
            " apply_uniform_gravity need not be given)",
            EnergyWarning,
            stacklevel=2,
        )
    return tuple(silent)


def load_energy(
    kinematics: Kinematics, power: Powers, silent: Sequence[int], constraints: Sequence[ConstraintRow]
) -> LoadEnergy:
    """Return the potential energy of those loads of a scene whose potential no body declares.

    Parameters
    ----------
    kinematics : Kinematics
        Its graph stays as it is.
    power : Powers
    silent : sequence of int
        Numbers of coordinates that the declared potential energy depends on and no load acts along.
    constraints : sequence of ConstraintRow
        On velocities that they allow, a declared potential energy must have the power of its loads.
    """
    model = kinematics.model
    if not model.actions and (model.given is None or not model.given.loads):
        return LoadEnergy()
    graph = Graph()
    if model.given is None:
        parts = load_parts(kinematics, graph, constraints)
    else:
        named = [(load.name, load_powers(kinematics, [load])) for load in model.given.loads]
        parts = given_parts(kinematics, graph, named)
    slopes = _declared(kinematics, power, graph)
    replaced, same = ([], False) if slopes is None else _replaced(kinematics, parts, slopes, silent, constraints)
    kept = [part for part in parts if part not in replaced]
    counted = [part for part in kept if part.potential is not None and not part.potential.is_zero]
    total, weight = graph.adopt([power.potential_energy, power.weighing]) if same else (graph.zero, graph.zero)
    acting = [*counted, *(replaced if same else [])]
    return LoadEnergy(
        potential=graph.sum(part.potential for part in counted if part.potential is not None) if counted else None,
        declared=total - weight if same else None,
        powers=tuple(_total(graph, acting, range(len(kinematics.q)))) if acting else (),
        included=_names([*counted, *replaced]),
        rates=_names([part for part in parts if part.rates]),
        time=_names([part for part in kept if part.potential is None and part.time]),
        unknown=_names([part for part in kept if part.potential is None and not (part.time or part.states)]),
        states=_names([part for part in kept if part.potential is None and part.states and not part.time]),
    )


def _names(parts: Sequence[LoadPart]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for part in parts for name in part.names))


def _declared(kinematics: Kinematics, power: Powers, graph: Graph) -> list[Node] | None:
    """Return the slopes of the declared potential energy beside gravity, None where there is none."""
    model = kinematics.model
    if model.lagrangian is not None or all(declared.is_zero for declared in model.potentials):
        return None
    total, weight = graph.adopt([power.potential_energy, power.weighing])
    q = [graph.input(name) for name in model.symbols.coordinates]
    slopes = [tangents(graph, [total, weight], {x: graph.one}) for x in q]
    rest = [graph.zero if agree([a], [b]) else a - b for a, b in slopes]
    return None if all(slope.is_zero for slope in rest) else rest


def _replaced(
    kinematics: Kinematics,
    parts: Sequence[LoadPart],
    slopes: Sequence[Node],
    silent: Sequence[int],
    constraints: Sequence[ConstraintRow],
) -> tuple[list[LoadPart], bool]:
    """Return the loads that a declared potential energy stands for, and whether it is theirs; warn where it is not.

    It is not said to be theirs where it depends on a coordinate along which no load acts.
    """
    model, graph = kinematics.model, slopes[0].graph
    loud = [i for i in range(len(slopes)) if i not in silent]
    acting = [part for part in parts if any(not part.powers[i].is_zero and not slopes[i].is_zero for i in loud)]
    if not acting:
        return [], False
    target = [slopes[i] for i in loud]
    sizes = range(len(acting), 0, -1) if len(acting) <= _COMBINED else [len(acting)]
    for size in sizes:
        for some in combinations(acting, size):
            if match(target, [-x for x in _total(graph, some, loud)]):
                return list(some), not silent
    if constraints and not silent and _same_power(kinematics, slopes, acting, constraints):
        return acting, True
    differing = [
        model.symbols.coordinates[i]
        for i, slope, force in zip(loud, target, _total(graph, acting, loud), strict=True)
        if not match([slope], [-force])
    ]
    warnings.warn(
        f"scene {model.name!r}: the potential energy that its bodies declare is not that of their loads: along"
        f" {list_names(differing)}, minus its derivative is not the force of {list_names(_names(acting))} at rest. The"
        ' motion follows the loads, and "energy" the declared potential energy: correct one of them, or remove the'
        " potential energy, which is derived from loads that have one",
        EnergyWarning,
        stacklevel=2,
    )
    return acting, False


def _same_power(
    kinematics: Kinematics, slopes: Sequence[Node], parts: Sequence[LoadPart], constraints: Sequence[ConstraintRow]
) -> bool:
    """Whether minus the slopes of a potential energy have the power of loads on velocities that constraints allow."""
    graph = slopes[0].graph
    assert isinstance(graph, Graph)
    q = [graph.input(name) for name in kinematics.model.symbols.coordinates]
    positions = graph.adopt([row.position for row in constraints if row.position is not None])
    rows = [graph.adopt(row.jacobian) for row in constraints]
    return agree_on_manifold(q, slopes, [-x for x in _total(graph, parts, range(len(q)))], positions, rows)


def _total(graph: Algebra, parts: Sequence[LoadPart], places: Sequence[int]) -> list[Node]:
    return [graph.sum(part.powers[i] for part in parts) for i in places]
