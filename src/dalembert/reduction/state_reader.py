"""`StateReader`: expressions of a scene as nodes in the state of a formulation, and the rounding errors of states.

A state that is projected onto constraints is off by what rounding makes of the residuals of the constraints: a
component that is zero in exact arithmetic is then off by the rounding of the others.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, final

from ..errors import EnergyWarning, ExpressionError, UnknownNameError, unknown_name
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..naming import acceleration_input, acceleration_name, rate_name, unwritable
from ..scene.scene import Scene
from ..scene.symbols import RESERVED_OUTPUTS, symbol_reader_of
from ..transforms.derivatives import tangents
from ..transforms.lower_kernels import lower_kernel
from .base import ReducedSystem
from .saddle import SaddlePoint, velocity_residuals

ARGUMENTS = ("t", "y", "c")


@final
class StateReader:
    """Reads expressions as nodes in the state of a formulation, on a graph of its own."""

    def __init__(self, scene: Scene, system: ReducedSystem) -> None:
        equations = system.equations
        self.symbols = equations.symbols
        self.energy_note = equations.load_energy.incomplete(equations.name)
        self.reactions = {name for item in scene.connections for name in item.components}
        reader = symbol_reader_of(scene)
        self.expressions = reader.expressions
        self.graph: Graph = self.expressions.graph
        self.inputs = self.graph.adopt(system.inputs)
        self.time = self.graph.input(self.symbols.time)
        self.parameters = {self.graph.input(name): ("c", i) for i, name in enumerate(self.symbols.parameters)}
        q, qdot = self.graph.adopt(system.coordinates), self.graph.adopt(system.rates)
        places = (*self.symbols.coordinates, *self.symbols.rates)
        self.table: dict[str, Node] = dict(zip(places, (*q, *qdot), strict=True))
        kinetic, potential = self._on_state(equations.energies(self.graph))
        outputs = dict(zip(system.outputs, self.graph.adopt(list(system.outputs.values())), strict=True))
        state = dict(zip(system.state, self.inputs, strict=True))
        named = zip(RESERVED_OUTPUTS, (kinetic + potential, kinetic, potential), strict=True)
        rates = dict(zip(map(rate_name, self.symbols.states), self.graph.adopt(system.state_rates), strict=True))
        self.table = state | rates | dict(named) | outputs | self.table
        self._accelerations = system.accelerations
        entered = [name for entry in self.symbols.entries for name in entry.names if name not in self.table]
        if entered:  # angles and angular velocities
            values = reader.named_values()
            self.table |= dict(zip(entered, self._on_state([values[name] for name in entered]), strict=True))

    def define(self, named: Mapping[str, Node]) -> None:
        """Give names to nodes of the equations."""
        if named:
            self.table |= dict(zip(named, self._on_state(self.graph.adopt(list(named.values()))), strict=True))

    def _on_state(self, nodes: Sequence[Node]) -> list[Node]:
        """Return nodes with every name in them replaced by its expression in terms of the state."""
        found = [node for node in self.graph.topological(nodes) if node.op == "input"]
        values = {node: self.table[str(node.payload)] for node in found if str(node.payload) in self.table}
        changed = {a: b for a, b in values.items() if a is not b}
        return self.graph.substitute(nodes, changed) if changed else list(nodes)

    def read(self, expression: Any, place: str) -> Node:
        """Return an expression or a named quantity in terms of time, state and parameters."""
        if isinstance(expression, str):
            if unwritable(expression):
                raise UnknownNameError(f"{place}: the name {expression!a} has a lone surrogate, half of a character")
            name = self.symbols.aliases.get(expression, expression)
            if name in ("energy", "potential_energy") and self.energy_note:
                warnings.warn(self.energy_note, EnergyWarning, stacklevel=2)
            if name in map(acceleration_name, self.symbols.coordinates) and name not in self.table:
                name = acceleration_input(name.removesuffix(acceleration_name("")))
                self._define_accelerations()
            node = self.graph.input(name if name in self.table else expression)
        else:
            node = self.expressions.read(expression, place, unknowns=True, accelerations=True)
        if self.expressions.faults:
            raise ExpressionError("\n".join(self.expressions.faults))
        if any(node.deps & self.graph.known_mask(acceleration_input(name)) for name in self.symbols.coordinates):
            self._define_accelerations()
        known = {*self.table, *self.symbols.parameters, self.symbols.time}
        for leaf in self.graph.topological([node]):
            if leaf.op == "input" and leaf.payload not in known:
                raise UnknownNameError(self._unknown(str(leaf.payload), place))
        return self._on_state([node])[0]

    def _define_accelerations(self) -> None:
        """Define second rates in terms of the state; called on demand, because few expressions contain them."""
        names = map(acceleration_input, self.symbols.coordinates)
        self.table |= dict(zip(names, self.graph.adopt(self._accelerations), strict=True))

    def _unknown(self, name: str, place: str) -> str:
        if name in self.symbols.unknowns or name in self.reactions:
            return f"{place}: {name!r} is a reaction; request it with compile_model(scene, outputs=[{name!r}])"
        names = [*self.table, *self.symbols.parameters, self.symbols.time]
        known = [each for each in names if " of " not in each]  # without those that modes of contacts add
        why = f"{place}: {unknown_name('name', name, known)}"
        if name in self.expressions.parameters:
            why += " A parameter that only events and reductions contain is given to the run with the others"
        return why

    def kernel(self, name: str, nodes: Sequence[Node], behind: Sequence[Node] = ()) -> Kernel:
        """Return the kernel of nodes that `read` returned; further inputs are `behind` the state."""
        inputs = {self.time: ("t", None), **self.parameters}
        inputs |= {node: ("y", i) for i, node in enumerate((*self.inputs, *behind))}
        return lower_kernel(self.graph, name, nodes, inputs, arguments=ARGUMENTS)

    def along(self, nodes: Sequence[Node], still: Sequence[Node]) -> Kernel:
        """Return a kernel of nodes for series expansion, with few products of varying values; `still` does not vary."""
        inputs: dict[Node, tuple[str, int | None]] = {self.time: ("t", None)}
        inputs |= {node: ("p", i) for node, (_, i) in self.parameters.items()}
        inputs |= {node: ("y", i) for i, node in enumerate(self.inputs)}
        kernel = lower_kernel(self.graph, "joint", nodes, inputs, fixed=(*self.parameters, *still))
        loads = tuple(replace(load, array="c") if load.array == "p" else load for load in kernel.loads)
        return replace(kernel, arguments=ARGUMENTS, loads=loads)


def coordinates_kernel(system: ReducedSystem) -> Kernel:
    """Return the kernel from (t, y, c), c beginning with the parameters, to coordinates, rates and states."""
    equations = system.equations
    graph, symbols = equations.graph, equations.symbols
    inputs: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}
    inputs |= {node: ("y", i) for node, i in system.places.items()}
    expanded = (*system.coordinates, *system.rates, *equations.states)
    return lower_kernel(graph, "expanded", expanded, inputs, arguments=ARGUMENTS)


def terms(system: ReducedSystem, graph: Graph, y: Sequence[Node], time: Node, nodes: Sequence[Node]) -> list[Node]:
    """Return the sizes of the terms that make up values: their rounding errors are small multiples of these.

    They are those of the components of the state and of time and, where steps of formulation "projected" end on
    constraints, those of the residuals of these.

    Parameters
    ----------
    system : ReducedSystem
    graph : Graph
        The graph of the other nodes.
    y : sequence of Node
        Components of the state of the system.
    time : Node
    nodes : sequence of Node
        The values.
    """
    residuals, changes = _residuals(system, graph)
    values = [*nodes, *residuals]
    sizes = [graph.zero for _ in values]
    for place in (*y, time):
        slopes = tangents(graph, values, {place: graph.one})
        sizes = [size + graph.call("abs", slope * place) for size, slope in zip(sizes, slopes, strict=True)]
    found, of_residuals = sizes[: len(nodes)], sizes[len(nodes) :]
    for residual, change in zip(of_residuals, changes, strict=True):
        slopes = tangents(graph, nodes, dict(zip(y, change, strict=False)))
        found = [size + graph.call("abs", slope) * residual for size, slope in zip(found, slopes, strict=True)]
    return found


@final
@frozen
class Slopes:
    """Derivatives of values along one direction, from which the sizes of `terms` follow by evaluation alone.

    Attributes
    ----------
    direction : tuple of Node
        Inputs: the direction in the state (n_y,), then in time.
    along : tuple of Node
        Derivatives of the values, then of the residuals of the constraints (k + n_residuals,).
    changes : tuple of tuple of Node
        For each residual the direction in the state (n_y,) by which it changes by 1, the others by 0.
    varying : tuple of int
        Places in the direction on which any derivative depends.
    """

    direction: tuple[Node, ...]
    along: tuple[Node, ...]
    changes: tuple[tuple[Node, ...], ...]
    varying: tuple[int, ...]


def slopes(system: ReducedSystem, graph: Graph, y: Sequence[Node], time: Node, nodes: Sequence[Node]) -> Slopes:
    """Return the derivatives along a direction for values as in `terms`.

    They are a few times as long as the values, where those by each component of the state are so many times longer.
    """
    residuals, changes = _residuals(system, graph)
    values, places = [*nodes, *residuals], [*y, time]
    direction = [graph.input(f"direction {i}") for i in range(len(places))]
    used = 0
    for node in values:
        used |= node.deps
    varying = [i for i, place in enumerate(places) if place.deps & used]
    along = tangents(graph, values, {places[i]: direction[i] for i in varying})
    padded = [(*change, *[graph.zero] * (len(y) - len(change))) for change in changes]
    return Slopes(tuple(direction), tuple(along), tuple(padded), tuple(varying))


def summands(graph: Graph, node: Node, products: int = 0) -> Node:
    """Return the sum of the sizes of the summands of a value: small multiples of it are rounding errors of the sum.

    Those of selected values, and of the factors of so many `products` in each other, are summed in them.
    """
    if node.op in ("add", "sub", "neg"):
        return graph.sum(summands(graph, arg, products) for arg in node.args)
    if node.op == "mul" and products > 0:
        first, second = (summands(graph, arg, products - 1) for arg in node.args)
        return first * second
    if node.op == "select":
        condition, *values = node.args
        return graph.call("select", condition, *(summands(graph, value, products) for value in values))
    return graph.call("abs", node)


def _residuals(system: ReducedSystem, graph: Graph) -> tuple[list[Node], list[list[Node]]]:
    """Return the residuals of positions and velocities, and the changes of q and q_dot that change one of each by 1.

    There are none where steps do not end on constraints.
    """
    if system.formulation != "projected" or not system.equations.constraints:
        return [], []
    whole = system.equations
    kept = tuple(row for i, row in enumerate(whole.constraints) if i not in system.left_out)
    redundancy = system.redundancy
    equations = replace(whole, constraints=kept if redundancy is None else redundancy.scaled(kept))
    nothing = [equations.graph.zero] * len(equations.q)
    saddle = SaddlePoint.of(equations, guarded=not system.regular, redundancy=redundancy)
    positions = [row.position for row in equations.constraints if row.position is not None]
    moves = [[*change, *nothing] for change in _changes(saddle, len(positions), equations.name)]
    rates = [[*nothing, *change] for change in _changes(saddle, len(equations.constraints), equations.name)]
    residuals = graph.adopt([*positions, *velocity_residuals(equations)])
    return residuals, [graph.adopt(change) for change in (*moves, *rates)]


def _changes(saddle: SaddlePoint, count: int, scene: str) -> list[list[Node]]:
    """Return the displacements (n_q,) by which one of the first `count` constraints changes by 1, the others by 0."""
    if count == 0:
        return []
    graph, factors = saddle.graph, saddle.schur(count, scene)
    nothing = [graph.zero] * len(saddle.forcing)
    units = [[graph.one if i == k else graph.zero for i in range(count)] for k in range(count)]
    return [saddle.combine(nothing, factors.solve(unit)) for unit in units]
