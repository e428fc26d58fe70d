"""Event functions and jumps of the state, as kernels on the state of a formulation.

Expressions may contain coordinates, rates, parameters and time, and all else that a model has by name: components of
its state, requested outputs and energies.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, final

from ..errors import EnergyWarning, ExpressionError, UnknownNameError, list_names, unknown_name
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..methods.step_constants import EPSILON
from ..naming import acceleration_input, acceleration_name, rate_name, unwritable
from ..once import once_property
from ..scene.scene import Scene
from ..scene.symbol_table import Entry
from ..scene.symbols import RESERVED_OUTPUTS, symbol_reader_of
from ..transforms.derivatives import tangents
from ..transforms.lower_kernels import lower_kernel
from .base import ReducedSystem
from .state_noise import Slopes, slopes, summands, terms

ROUNDINGS = 64 * EPSILON
_AT_LIMIT = 1024 * EPSILON
"""Share of a friction force and its limit up to which their difference counts as zero: what rounding leaves of it in
the series of a step that touches the limit, and in one that ends just behind a knot of a table."""

_PRODUCTS = {"break": 0, "share": 1}
"""Guards that are such differences, or sums of them with weights, and the products to look through for the terms."""

_ARGUMENTS = ("t", "y", "c")


@final
@frozen(eq=False)
class EventFunctions:
    """Kernels of (t, y, c), c beginning with the parameters.

    Attributes
    ----------
    values : Kernel
        The value of each expression (k,).
    begins : Kernel
        For each expression its value, its rate along the motion, and what rounding of the state may make of the
        value where it should be zero (3 k,). That of a friction force at its limit follows from these two: they
        may stay equal, and depend on nothing but parameters. With `slopes`, what these need instead: the values (k,),
        what rounding makes of forces at their limits (k,), the rates of the state (n_y,), and the direction (n_y,) of
        each residual.
    slopes : DirectionalSlopes or None
        Where the partial derivatives by all components of the state would be long.
    """

    values: Kernel
    begins: Kernel
    slopes: DirectionalSlopes | None
    _join: Callable[[], Kernel]
    _rate: Callable[[], Kernel]

    @once_property
    def joint(self) -> Kernel:
        """Kernel of the right-hand side of the system followed by the values; they share subexpressions."""
        return self._join()

    @once_property
    def rates(self) -> Kernel:
        """Kernel of the rates of the expressions along the motion (k,)."""
        return self._rate()


@final
@frozen(eq=False)
class DirectionalSlopes:
    """Derivatives of k expressions along a direction, evaluated once for each component of the state.

    Attributes
    ----------
    kernel : Kernel
        Of (t, y, c), where y is the state (n_y,), a direction in it (n_y,) and one in time. It gives the derivatives of
        the expressions, then of the residuals of the constraints that steps end on.
    varying : tuple of int
        Places in the direction on which they depend; n_y is time.
    residuals : int
        Number of residuals.
    """

    kernel: Kernel
    varying: tuple[int, ...]
    residuals: int


_LONGEST = 40_000
"""Operations of the expressions times components of the state up to which all partial derivatives are written out: one
to two seconds of compilation there (measured on legs in a plane and in space)."""


def event_functions(
    scene: Scene,
    system: ReducedSystem,
    expressions: Sequence[Any],
    what: str,
    *,
    moving: bool,
    names: Mapping[str, Node] | None = None,
) -> EventFunctions:
    """Return the kernels of event functions or reductions.

    Parameters
    ----------
    scene : Scene
        Scene of the system.
    system : ReducedSystem
        System whose state is the argument y of the kernels.
    expressions : sequence of str or SymPy expressions
        Names, or expressions of the scene's symbols.
    what : str
        "event" or "reduction", for messages.
    moving : bool
        Whether an expression that is constant along every motion is an error.
    names : mapping of str to Node, optional
        Further names that expressions may contain, as nodes of the system's equations.

    Raises
    ------
    UnknownNameError
        For a name that the model does not have.
    ExpressionError
        For an expression that cannot be compiled, or that is constant.
    """
    reader = _Reader(scene, system)
    reader.define(names or {})
    nodes = [reader.read(expression, f"{what} {expression}") for expression in expressions]
    graph, y, time = reader.graph, reader.inputs, reader.time
    for expression, node in zip(expressions, nodes, strict=True):
        if moving and graph.freed_of(node, [*y, *graph.adopt(system.equations.timing)]) is not None:
            raise ExpressionError(
                f"{what} {expression} is constant along every motion, so it has no events: write it in"
                " coordinates, rates, outputs or time"
            )
    flow = dict(zip(y, graph.adopt(system.rhs), strict=True)) | {time: graph.one}
    products = {guard.output: _PRODUCTS[guard.kind] for guard in system.equations.guards if guard.kind in _PRODUCTS}
    at_limit = [
        graph.node(_AT_LIMIT) * summands(graph, node, products[expression]) if expression in products else graph.zero
        for expression, node in zip(expressions, nodes, strict=True)
    ]
    if len(y) * sum(node.op not in ("input", "const") for node in graph.topological(nodes)) > _LONGEST:
        found = slopes(system, graph, y, time, nodes)
        rhs = [flow[place] if i in found.varying else graph.zero for i, place in enumerate(y)]
        begins = [*nodes, *at_limit, *rhs, *(entry for change in found.changes for entry in change)]
        directional = reader.slopes(found)
    else:
        sizes = terms(system, graph, y, time, nodes)
        noise = [graph.node(ROUNDINGS) * size + own for size, own in zip(sizes, at_limit, strict=True)]
        rates = tangents(graph, nodes, flow)
        begins = [node for row in zip(nodes, rates, noise, strict=True) for node in row]
        directional = None
    still = [place for place in y if flow[place].is_zero]
    rhs = [flow[place] for place in y]
    return EventFunctions(
        reader.kernel("watch", nodes),
        reader.kernel("watch_begins", begins),
        directional,
        lambda: reader.along([*rhs, *nodes], still),
        lambda: reader.kernel("watch_rates", tangents(graph, nodes, flow)),
    )


_ON_ZERO = 1024 * EPSILON
"""Share of the terms of an expression, and of its change since the start, within which its zero is located."""


def jump_kernel(scene: Scene, system: ReducedSystem, event: Any, changes: Mapping[Any, Any], what: str) -> Kernel:
    """Return the kernel from (t, y, c) to coordinates, rates and states (2 n_q + n_z,) after a jump.

    A coordinate that alone decides about the event, and does not jump, is where the event's expression vanishes: a body
    that stops there is not left beside it by the rounding of times, from where it would cross again.

    Parameters
    ----------
    event : str or SymPy expression
        The expression that has vanished.
    changes : mapping of symbols or names to expressions
        Coordinates, rates and states that jump, with their values after the jump in terms of the state before; others
        are unchanged. Angles of a quaternion, their rates and angular velocities may jump in place of the former.

    Raises
    ------
    UnknownNameError
        For a key that is no coordinate, rate or state, and for a name that the model does not have.
    ExpressionError
        For an expression that cannot be compiled.
    """
    reader, symbols = _Reader(scene, system), system.equations.symbols
    known = [*symbols.variables, *(name for entry in symbols.entries for name in entry.names)]
    after = {name: reader.table[name] for name in known}
    changed = set()
    for key, expression in changes.items():
        name = symbols.aliases.get(str(key), str(key))
        if name not in known:
            why = unknown_name("coordinate, rate or state", name, known)
            raise UnknownNameError(f"{what} applies to {str(key)!r}, which does not jump: {why}")
        after[name] = reader.read(expression, f"{what}, {name} after it")
        changed.add(name)
    after |= _on_zero(reader, system, reader.read(event, f"{what} {event}"), {*symbols.coordinates} - changed)
    for entry in _entries(symbols.entries, changed, what):
        values = dict(zip(map(reader.graph.input, after), after.values(), strict=True))
        found = reader.graph.substitute(reader.graph.adopt(entry.values), values)
        after |= dict(zip(entry.targets, found, strict=True))
    return reader.kernel("jump", [after[name] for name in symbols.variables])


def _on_zero(reader: _Reader, system: ReducedSystem, value: Node, names: set[str]) -> dict[str, Node]:
    """Return the coordinate where a value vanishes that it alone of the state decides about, linearly; else nothing."""
    graph = reader.graph
    used = [place for place in reader.inputs if place.deps & value.deps]
    found = [name for name in sorted(names) if used == [reader.table[name]]]
    if not found:
        return {}
    (place,) = used
    (slope,) = tangents(graph, [value], {place: graph.one})
    if slope.is_zero or slope.deps & (place.deps | reader.time.deps):
        return {}
    rate = dict(zip(reader.inputs, graph.adopt(system.rhs), strict=True))[place]
    change, beside = value / slope, graph.call("abs", rate * reader.time) + graph.call("abs", place)
    small = graph.call("less", graph.call("abs", change), graph.node(_ON_ZERO) * beside)
    return {found[0]: graph.call("select", small, place - change, place)}


def _entries(entries: Sequence[Entry], changed: set[str], what: str) -> Iterator[Entry]:
    """Yield the entries by which other variables change; where angles alone are named, their rates remain."""
    used = [entry for entry in entries if changed & {*entry.names}]
    targets = [*changed, *(name for entry in used for name in entry.targets)]
    twice = [name for name in dict.fromkeys(targets) if targets.count(name) > 1]
    if twice:
        names = list_names(name for entry in used for name in entry.names if name in changed)
        raise ExpressionError(
            f"{what} applies to {names}, which determine {list_names(twice)} twice: name one of the two"
        )
    for entry in entries:
        if entry in used or (changed & {*entry.needs} and not {*entry.targets} & {*targets}):
            yield entry


def coordinates_kernel(system: ReducedSystem) -> Kernel:
    """Return the kernel from (t, y, c), c beginning with the parameters, to coordinates, rates and states."""
    equations = system.equations
    graph, symbols = equations.graph, equations.symbols
    inputs: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}
    inputs |= {node: ("y", i) for node, i in system.places.items()}
    expanded = (*system.coordinates, *system.rates, *equations.states)
    return lower_kernel(graph, "expanded", expanded, inputs, arguments=_ARGUMENTS)


@final
class _Reader:
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
        return lower_kernel(self.graph, name, nodes, inputs, arguments=_ARGUMENTS)

    def slopes(self, found: Slopes) -> DirectionalSlopes:
        """Return the kernel of derivatives along a direction."""
        kernel = self.kernel("watch_slopes", found.along, found.direction)
        return DirectionalSlopes(kernel, found.varying, len(found.changes))

    def along(self, nodes: Sequence[Node], still: Sequence[Node]) -> Kernel:
        """Return a kernel of nodes for series expansion, with few products of varying values; `still` does not vary."""
        inputs: dict[Node, tuple[str, int | None]] = {self.time: ("t", None)}
        inputs |= {node: ("p", i) for node, (_, i) in self.parameters.items()}
        inputs |= {node: ("y", i) for i, node in enumerate(self.inputs)}
        kernel = lower_kernel(self.graph, "joint", nodes, inputs, fixed=(*self.parameters, *still))
        loads = tuple(replace(load, array="c") if load.array == "p" else load for load in kernel.loads)
        return replace(kernel, arguments=_ARGUMENTS, loads=loads)
