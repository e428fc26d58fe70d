"""First integrals among functions of coordinates and rates: rates of change, and where these vanish.

With p = M q_dot + a(q, t), a momentum I = p . xi has the rate (dI/dq . q_dot + dI/dt + xi . forcing) + xi . J^T lam
along every motion. With xi = q_dot this is the rate of the energy and of Jacobi's integral, where J q_dot = -drift.
Where the graph sees these vanish identically, the integral is certain. Where they may vanish on the constraints only,
as with a quaternion of norm one, the rate of change is returned as a kernel, to be evaluated at states that satisfy the
constraints, and so is the rate with the arguments of switches, tables and steep functions free: what such functions do
elsewhere counts too. There, a potential energy that was verified to be that of loads changes by minus their power at
rest: its own branches may have other conditions than those of the loads, as that of max(0, min(x, 1)) has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node, deps_of
from ..ir.zero_tests import terms_of
from ..mechanics.equations import EquationsOfMotion
from ..transforms.derivatives import tangents
from ..transforms.linear import matvec
from ..transforms.lower_kernels import lower_kernel
from ..transforms.step_limits import own_tables
from .integrals import ENERGY, JACOBI, integrals, momenta_of

# Expressions whose switches, tables and steep functions are independent of the state.
#
# A rate that vanishes around a state need not vanish elsewhere: a damper that begins to act later, or beyond a stop,
# has no power before. Where decisions and arguments of such functions are free, any state shows all of their branches.

_DECIDING = frozenset({"abs", "sign", "min", "max", "less", "less_equal"})
_OF_ARGUMENTS = frozenset({"floor", "table", "surface", "exp", "sinh", "cosh", "tanh"})
"""Functions with many pieces, and such as may be below rounding at one state and large at another."""


@final
@frozen
class FreeArgument:
    """Distribution of a free value, around `centre` and within `width` for the most part."""

    centre: float = 0.0
    width: float = 1.0

    def draw(self, random: np.random.Generator, count: int) -> FloatArray:
        """Return random values (count,), some much closer to the centre and some farther away."""
        sizes = 10.0 ** random.uniform(-1.0, 1.0, count)
        return self.centre + self.width * sizes * random.standard_normal(count)


def free_arguments(
    graph: Graph, nodes: Sequence[Node], variables: int
) -> tuple[list[Node], list[tuple[Node, FreeArgument]]]:
    """Return `nodes` with free decisions and arguments, and these as inputs.

    Decisions by one expression, or by its negative, are one input; and so is an argument, wherever it stands.

    Parameters
    ----------
    graph : Graph
    nodes : sequence of Node
    variables : int
        The inputs that change in a run, as `Node.deps` has them. What depends on none of them stays.
    """
    rebuilding = _Rebuilding(graph, variables)
    done: dict[int, Node] = {}
    graph.visit(nodes, done, lambda node: rebuilding.rebuilt(node, [done[arg.index] for arg in node.args]))
    return [done[node.index] for node in nodes], list(rebuilding.free.values())


def has_branches(graph: Graph, nodes: Sequence[Node], variables: int) -> bool:
    """Return whether a function with free decisions or arguments is among what nodes depend on."""
    return any(_branches(node, variables) for node in graph.topological(nodes))


def _branches(node: Node, variables: int) -> bool:
    return node.op in _DECIDING | _OF_ARGUMENTS and bool(node.deps & variables)


@final
@frozen
class _Rebuilding:
    """Inputs that replace decisions and arguments, by the number of the node that each stands for."""

    graph: Graph
    variables: int
    free: dict[int, tuple[Node, FreeArgument]] = field(default_factory=dict)

    def rebuilt(self, node: Node, args: list[Node]) -> Node:
        """Return a node of rebuilt operands."""
        if not node.args:
            return node
        if _branches(node, self.variables):
            if node.op in _DECIDING:
                return self._decided(node, args)
            for place, where in enumerate(_ranges(node)):
                args[place] = self._input(node.args[place], where)
        return self.graph.call(node.op, *args)

    def _decided(self, node: Node, args: list[Node]) -> Node:
        """Return the value of a function on the side of its switch that a free number decides."""
        graph = self.graph
        sign = self._sign(node.args[0] - node.args[1] if len(node.args) == 2 else node.args[0])
        if node.op in ("less", "less_equal"):
            return graph.call("less", sign, graph.zero)
        if node.op in ("sign", "abs"):
            return sign if node.op == "sign" else sign * args[0]
        return graph.call("select", graph.call("less", sign, graph.zero), *args[:: 1 if node.op == "min" else -1])

    def _sign(self, node: Node) -> Node:
        opposite = -node
        first = node if node.index < opposite.index else opposite
        sign = self.graph.call("sign", self._input(first, FreeArgument()))
        return sign if first is node else -sign

    def _input(self, node: Node, where: FreeArgument) -> Node:
        if node.index not in self.free:
            self.free[node.index] = self.graph.input(f"free argument {len(self.free)}"), where
        return self.free[node.index][0]


def _ranges(node: Node) -> list[FreeArgument]:
    """Return where the arguments of a function have to be, so that its pieces are met."""
    found = [table for _, table, _ in own_tables(node)]
    ranges = [((table.first + table.last) / 2, (table.last - table.first) / 2 or 1.0) for table in found]
    return [FreeArgument(*each) for each in ranges] or [FreeArgument()]


@final
@frozen
class InvariantCandidates:
    """Functions that may be first integrals.

    Attributes
    ----------
    names : tuple of str
        Those of `dalembert.reduction.integrals.integrals`.
    certain : tuple of bool
        Whether each is conserved whatever the state.
    values : Kernel
        Of arguments (t, y, c), y = (q, q_dot, states) and c beginning with the parameters.
    changes : Kernel
        Alike, with y = (q, q_dot, states, q_ddot): the rate of each, and the sum of the sizes of its terms.
    branches : Kernel
        Alike, with y = (q, q_dot, states, free arguments), see `free_arguments`.
    free : tuple of FreeArgument
        Where these are.
    """

    names: tuple[str, ...]
    certain: tuple[bool, ...]
    values: Kernel
    changes: Kernel
    branches: Kernel
    free: tuple[FreeArgument, ...]


def candidates(equations: EquationsOfMotion) -> InvariantCandidates:
    """Return the functions of a scene that may be first integrals."""
    symbols = equations.symbols
    graph = Graph()  # a graph of its own, so that the kernels depend on the scene alone
    q, qdot = graph.adopt(equations.q), graph.adopt(equations.qdot)
    states = graph.adopt(equations.states)
    time, decided = graph.input(symbols.time), graph.input(CONDITION_TIME)
    second = [graph.input(f"{name} of {name}_dot") for name in symbols.coordinates]
    along = {time: graph.one, **dict(zip(q, qdot, strict=True))}
    found = _found(equations, graph, along)
    nodes = [each.value for each in found]
    rates = tangents(graph, nodes, along | dict(zip(qdot, second, strict=True)))
    certain = [each.certain for each in found]
    direct = [each.branches for each in found]
    if CONDITION_TIME in symbols.parameters:  # conditions on time change the equations at their breaks
        for k, node in enumerate(nodes):
            if graph.freed_of(node, [decided]) is None:
                certain[k], direct[k] = False, graph.one
    variables = deps_of((*q, *qdot, *states, time, decided))
    unclear = has_branches(graph, _equations(equations, graph), variables)
    shown = [(graph.one if unclear else graph.zero) if each is None else each for each in direct]
    branches, free = free_arguments(graph, shown, variables)
    inputs: dict[Node, tuple[str, int | None]] = {time: ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}

    def kernel(name: str, outputs: Sequence[Node], *further: Node) -> Kernel:
        places = {node: ("y", i) for i, node in enumerate((*q, *qdot, *states, *further))}
        return lower_kernel(graph, name, outputs, inputs | places, arguments=("t", "y", "c"))

    return InvariantCandidates(
        tuple(each.name for each in found),
        tuple(certain),
        kernel("invariants", nodes),
        kernel("changes", [*rates, *_sizes(graph, rates)], *second),
        kernel("branches", [*branches, *_sizes(graph, branches)], *(node for node, _ in free)),
        tuple(where for _, where in free),
    )


@final
@frozen
class _Candidate:
    """A function, and its rate without reactions; None where reactions may contribute to it.

    `branches` is that rate, in the form whose decisions may be free.
    """

    name: str
    value: Node
    direct: Node | None
    branches: Node | None

    @property
    def certain(self) -> bool:
        return self.direct is not None and self.direct.is_zero


def _found(equations: EquationsOfMotion, graph: Graph, along: Mapping[Node, Node]) -> list[_Candidate]:
    """Return the candidates; `along` has the rates of time and coordinates."""
    qdot, forcing = graph.adopt(equations.qdot), graph.adopt(equations.forcing)
    mass = [graph.adopt(row) for row in equations.mass_matrix]
    jacobian = [graph.adopt(row.jacobian) for row in equations.constraints]
    drifts = graph.adopt([row.drift for row in equations.constraints])
    momenta = momenta_of(graph, equations.energies(graph)[0], qdot)
    rest = [a - b for a, b in zip(momenta, matvec(graph, mass, qdot), strict=True)]
    at_rest = graph.substitute(rest, dict.fromkeys(qdot, graph.zero))
    plain = all(node.is_zero for node in rest)
    affine = all((a - b).is_zero for a, b in zip(rest, at_rest, strict=True))
    functions = integrals(equations, graph)
    changes = tangents(graph, [each.value for each in functions.values()], along)
    stored = _change_by_loads(equations, graph, along) - changes[0]
    found = []
    for change, (name, each) in zip(changes, functions.items(), strict=True):
        power, *powers = (
            graph.sum(a * b for a, b in zip(row, each.along, strict=True) if not b.is_zero)
            for row in (forcing, *jacobian)
        )
        of_energy = name in (ENERGY, JACOBI)
        silent = all(node.is_zero for node in (drifts if of_energy else powers))
        direct = branches = None
        if silent and (plain if name == ENERGY else affine):
            direct = power + change
            branches = direct + stored if of_energy else direct
        found.append(_Candidate(name, each.value, direct, branches))
    return found


def _change_by_loads(equations: EquationsOfMotion, graph: Graph, along: Mapping[Node, Node]) -> Node:
    """Return the rate of the energy along `along`, that of loads by their power at rest."""
    loads, time = equations.load_energy, {graph.input(equations.symbols.time): graph.one}
    own = tangents(graph, graph.adopt([equations.kinetic_energy, equations.potential_energy]), along)
    if not loads.powers:
        return graph.sum(own)
    stored = graph.adopt([node for node in (loads.potential, loads.declared) if node is not None])
    beside = graph.zero if loads.declared is None else tangents(graph, stored[-1:], along)[0]
    given = graph.sum(a * along[q] for q, a in zip(graph.adopt(equations.q), graph.adopt(loads.powers), strict=True))
    return own[0] + (own[1] - beside) - given + graph.sum(tangents(graph, stored, time))


def _equations(equations: EquationsOfMotion, graph: Graph) -> list[Node]:
    """Return what accelerations and the energy depend on."""
    rows = [equations.inertia, *(row.jacobian for row in equations.constraints)]
    nodes = [
        *equations.forcing,
        *(row.drift for row in equations.constraints),
        *(entry for row in rows for entry in row),
    ]
    return [*graph.adopt(nodes), *equations.energies(graph)]


def _sizes(graph: Graph, rates: Sequence[Node]) -> list[Node]:
    """Return what the rounding of each rate is relative to: 1e-16 of it is the error of a sum of its terms."""
    return [terms_of(graph, rate) for rate in rates]
