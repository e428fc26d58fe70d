"""Potential energies of given loads, derived on a graph of its own.

The power coefficients Q_i of a load at zero rates are compared with candidates: Q = -dV/dq. Candidates are what an
actuator is known to store, constant forces (V = -F . r), components of a force that are a function of their own
coordinate of the point, or of the vector between the points of two forces, central forces between two points, functions
of one inner value u with Q parallel to grad u (a spring along a coordinate, a distance, the length of a pathway, a
relative angle), and antiderivatives coordinate by coordinate. A candidate counts only where its gradient is Q.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, final

from ..frozen import frozen
from ..ir.calls import CALLS
from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.random_points import directions, jumps, lost_at_zero, match, probe
from ..scene.model import Components
from ..transforms.antiderivatives import Antiderivatives
from . import screws as vec
from .kinematics import Kinematics
from .loads_at_rest import LoadAtRest, LoadReader
from .manifold import agree_on_manifold

if TYPE_CHECKING:
    from .equations import ConstraintRow


_TOGETHER = 4
"""Most loads in a row that may be those of one spring: two for one between points, more over a pathway."""
_PAIRED = 6
"""Most loads without a potential that are tried in pairs."""
_POINTS = 3
_SIZE = 40_000
"""Nodes of the graph from which on no further potential is looked for."""


@final
@frozen
class LoadPart:
    """Loads that belong together, with their power coefficients and what is known of their potential energy.

    Attributes
    ----------
    names : tuple of str
        Names of the loads in messages.
    powers : tuple of Node, length n_q
        Power coefficients at zero rates.
    potential : Node or None
        V with powers = -dV/dq; zero where they vanish, None where none was found.
    rates, time, states : bool
        Whether the loads depend on rates, and their power coefficients at zero rates on time explicitly, and on
        first-order states.
    """

    names: tuple[str, ...]
    powers: tuple[Node, ...]
    potential: Node | None
    rates: bool
    time: bool
    states: bool = False


def load_parts(kinematics: Kinematics, graph: Graph, constraints: Sequence[ConstraintRow]) -> list[LoadPart]:
    """Return the loads of a scene, those together that have one potential energy.

    Parameters
    ----------
    kinematics : Kinematics
        Its poses are read; its graph stays as it is.
    graph : Graph
        Where the results are.
    constraints : sequence of ConstraintRow
        Where a unit quaternion is among the coordinates, a potential has the powers of its loads on them only.
    """
    search = _Search(kinematics, graph, constraints)
    given = [action for action in kinematics.model.actions if not action.of_joint]
    parts = search.parts([search.load(action) for action in given if action.actuator is None])
    for number, stored in enumerate(kinematics.model.stored):
        loads = [search.load(action) for action in given if action.actuator == number]
        parts.append(search.part(loads, () if stored is None else search.adopt([stored])))
    return parts


def given_parts(kinematics: Kinematics, graph: Graph, named: Sequence[tuple[str, Sequence[Node]]]) -> list[LoadPart]:
    """Return the loads of a scene that gives velocities; `named` are their names and power coefficients."""
    search = _Search(kinematics, graph, ())
    return search.parts([search.named(name, powers) for name, powers in named])


@final
class _Search(LoadReader):
    """The search for the potentials of the loads of one scene."""

    def __init__(self, kinematics: Kinematics, graph: Graph, constraints: Sequence[ConstraintRow]) -> None:
        super().__init__(kinematics, graph)
        self.constraints = constraints
        symbols = kinematics.model.symbols
        self.time = graph.input(symbols.time)
        self.states = [graph.input(name) for name in symbols.states]
        self.timing = [self.time, *([graph.input(CONDITION_TIME)] if CONDITION_TIME in symbols.parameters else [])]
        self.moving = [*self.q, *self.timing, *self.states]

    # -- loads that belong together -------------------------------------------------------

    def parts(self, loads: Sequence[LoadAtRest]) -> list[LoadPart]:
        """Return the loads with potentials; where one alone has none, neighbours are tried together, then others."""
        found: list[tuple[list[LoadAtRest], LoadPart]] = []
        start = 0
        while start < len(loads):
            count, part = 1, self.part(loads[start : start + 1])
            while part.potential is None and count < min(_TOGETHER, len(loads) - start):
                count += 1
                part = self.part(loads[start : start + count])
            if part.potential is None:
                count, part = 1, self.part(loads[start : start + 1])
            found.append((list(loads[start : start + count]), part))
            start += count
        return [part for _, part in self._regrouped(found)]

    def _regrouped(self, found: list[tuple[list[LoadAtRest], LoadPart]]) -> list[tuple[list[LoadAtRest], LoadPart]]:
        """Join loads without a potential, by pairs and then all of them, where that has one."""
        rest = [item for item in found if item[1].potential is None]
        groups = [[a, b] for i, a in enumerate(rest) for b in rest[i + 1 :]] if len(rest) <= _PAIRED else []
        for group in [*groups, rest] if len(rest) > 1 else []:
            if any(item not in found for item in group):
                continue
            members = [load for item in group for load in item[0]]
            joined = self.part(members)
            if joined.potential is not None:
                found = [item for item in found if item not in group] + [(members, joined)]
        return found

    def part(self, loads: Sequence[LoadAtRest], known: Sequence[Node] = ()) -> LoadPart:
        """Return the part of some loads; `known` are candidates for its potential, tried before others."""
        g = self.graph
        powers = tuple(g.sum(load.powers[i] for load in loads) for i in range(len(self.q)))
        rates = any(load.rates for load in loads)
        time, states = (any(p.deps & x.deps for p in powers for x in some) for some in (self.timing, self.states))
        potential: Node | None = None
        if all(power.is_zero for power in powers):
            potential = g.zero
        elif len(g.nodes) < _SIZE and not any(node.op in CALLS for node in g.topological(powers)):
            least: int | None = None
            for candidate in chain(() if states else known, self._candidates(loads, powers)):
                if self._verified(candidate, powers):
                    lost = lost_at_zero(candidate, powers, self.moving)
                    if least is None or lost < least:
                        potential, least = candidate, lost
                    if not lost:
                        break
        return LoadPart(tuple(load.name for load in loads), powers, potential, rates, time, states)

    def _verified(self, candidate: Node, powers: Sequence[Node]) -> bool:
        """Whether powers are minus the gradient of a continuous candidate, on velocities that constraints allow."""
        gradient = [-x for x in self._gradient(candidate)]
        return (match(gradient, powers) or self._match_on_manifold(gradient, powers)) and not jumps(candidate, self.q)

    def _match_on_manifold(self, gradient: Sequence[Node], powers: Sequence[Node]) -> bool:
        if not self.constraints:
            return False
        positions = self.adopt([row.position for row in self.constraints if row.position is not None])
        rows = [self.adopt(row.jacobian) for row in self.constraints]
        return agree_on_manifold(self.q, gradient, powers, positions, rows)

    def _gradient(self, node: Node) -> list[Node]:
        tool = Antiderivatives(self.graph, self.moving)
        return [tool.slope(node, x) if x.deps & node.deps else self.graph.zero for x in self.q]

    # -- candidates -----------------------------------------------------------------------

    def _candidates(self, loads: Sequence[LoadAtRest], powers: Sequence[Node]) -> Iterator[Node]:
        """Yield potentials that loads may have."""
        ways = [self._by_components, self._by_distance, self._by_components_between]
        if self._integrable(powers):
            ways += [self._by_inner_value, self._by_coordinates]
        for way in ways:
            try:
                found = way(loads, powers)
            except ZeroDivisionError:
                continue
            if found is not None:
                yield found

    def _by_components(self, loads: Sequence[LoadAtRest], powers: Sequence[Node]) -> Node | None:
        """Return V of forces whose components on the root frame are functions of that component of the position."""
        placed = [(load.force, load.position) for load in loads if load.force is not None and load.position is not None]
        return self._of_components(placed) if len(placed) == len(loads) else None

    def _of_components(self, placed: Sequence[tuple[Components, Components]]) -> Node | None:
        """Return V of forces (3,) whose components are functions of those of positions (3,)."""
        tool = Antiderivatives(self.graph, self.moving)
        total = self.graph.zero
        for forces, places in placed:
            for force, place in zip(forces, places, strict=True):
                if force.is_zero or not any(place.deps & x.deps for x in self.q):
                    continue
                found = tool.along(force, place)
                if found is None:
                    return None
                total = total - found
        return total

    def _by_distance(self, loads: Sequence[LoadAtRest], powers: Sequence[Node]) -> Node | None:
        """Return V of two opposite forces along the line between their points, by the distance."""
        opposite = self._opposite(loads)
        if opposite is None:
            return None
        force, d = opposite
        distance = self.graph.call("sqrt", vec.dot(d, d))
        found = Antiderivatives(self.graph, self.moving).along(vec.dot(force, d) / distance, distance)
        return None if found is None else -found

    def _by_components_between(self, loads: Sequence[LoadAtRest], powers: Sequence[Node]) -> Node | None:
        """Return V of two opposite forces whose components are functions of those of the vector between their points.

        Such are the forces of springs that resist displacements in all directions.
        """
        opposite = self._opposite(loads)
        return None if opposite is None else self._of_components([opposite])

    def _opposite(self, loads: Sequence[LoadAtRest]) -> tuple[Components, Components] | None:
        """Return the first of two opposite forces, and its point's position relative to the other's."""
        if len(loads) != 2 or any(load.force is None or load.position is None for load in loads):
            return None
        (first, place), (second, other) = ((load.force, load.position) for load in loads)
        assert first is not None and second is not None and place is not None and other is not None
        return (first, vec.subtract(place, other)) if vec.is_zero(vec.add(first, second)) else None

    def _by_inner_value(self, loads: Sequence[LoadAtRest], powers: Sequence[Node]) -> Node | None:
        """Return V of power coefficients that are parallel to the gradient of a value: the simplest one found."""
        tool = Antiderivatives(self.graph, self.moving)
        still = Antiderivatives(self.graph, self.q)
        best: tuple[tuple[int, float], Node] | None = None
        values = [*self._distances(loads), *tool.inner_values(powers, self.moving)]
        for u in still.with_gradient_along(values, powers):
            slopes = ((power, still.slope(u, x)) for power, x in zip(powers, self.q, strict=True) if not power.is_zero)
            place = next(((power, slope) for power, slope in slopes if not slope.is_zero), None)
            found = None if place is None else tool.along(self.graph.div(*place), u)
            if found is not None:
                key = (lost_at_zero(found, powers, self.moving), found.cost)
                best = min(best or (key, found), (key, found), key=lambda item: item[0])
        return None if best is None else -best[1]

    def _integrable(self, powers: Sequence[Node]) -> bool:
        """Whether dQ_i/dq_j = dQ_j/dq_i at random points, without which there is no potential."""
        if sum(not power.is_zero for power in powers) == 1 and len(self.q) == 1:
            return True
        for seed in range(_POINTS):
            probes = probe(powers, self.q, seed)
            if not all(math.isfinite(item.a + item.b) for item in probes):
                continue
            a, b = directions(self.q, seed)
            left = sum(x * item.b for x, item in zip(a, probes, strict=True))
            right = sum(x * item.a for x, item in zip(b, probes, strict=True))
            size = max(max(abs(item.a), abs(item.b)) for item in probes)
            if abs(left - right) > 1e-5 * len(powers) * size:
                return False
        return True

    def _distances(self, loads: Sequence[LoadAtRest]) -> list[Node]:
        """Return the distance of two points of forces, and its square."""
        placed = [load.position for load in loads if load.position is not None]
        if len(loads) != 2 or len(placed) != 2:
            return []
        d = vec.subtract(placed[0], placed[1])
        square = vec.dot(d, d)
        return [square, self.graph.call("sqrt", square)]

    def _by_coordinates(self, loads: Sequence[LoadAtRest], powers: Sequence[Node]) -> Node | None:
        """Return V by antiderivatives along one coordinate after the other."""
        if any(power.deps & x.deps for power in powers for x in (*self.timing, *self.states)):
            return None
        tool = Antiderivatives(self.graph, self.moving)
        total = self.graph.zero
        for power, x in zip(powers, self.q, strict=True):
            rest = power + (tool.slope(total, x) if x.deps & total.deps else self.graph.zero)
            if rest.is_zero:
                continue
            found = tool.by_input(rest, x)
            if found is None:
                return None
            total = total - found
        return total
