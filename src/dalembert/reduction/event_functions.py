"""Event functions and jumps of the state, as kernels on the state of a formulation.

Expressions may contain coordinates, rates, parameters and time, and all else that a model has by name: components of
its state, requested outputs and energies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, final

from ..errors import ExpressionError, UnknownNameError, list_names, unknown_name
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..methods.step_constants import EPSILON
from ..once import once_property
from ..scene.scene import Scene
from ..scene.symbol_table import Entry
from ..transforms.derivatives import tangents
from .base import ReducedSystem
from .state_reader import StateReader, slopes, summands, terms

ROUNDINGS = 64 * EPSILON
_AT_LIMIT = 1024 * EPSILON
"""Share of a friction force and its limit up to which their difference counts as zero: what rounding leaves of it in
the series of a step that touches the limit, and in one that ends just behind a knot of a table."""

_PRODUCTS = {"break": 0, "share": 1}
"""Guards that are such differences, or sums of them with weights, and the products to look through for the terms."""


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
    reader = StateReader(scene, system)
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
        kernel = reader.kernel("watch_slopes", found.along, found.direction)
        directional = DirectionalSlopes(kernel, found.varying, len(found.changes))
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
    reader, symbols = StateReader(scene, system), system.equations.symbols
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


def _on_zero(reader: StateReader, system: ReducedSystem, value: Node, names: set[str]) -> dict[str, Node]:
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
