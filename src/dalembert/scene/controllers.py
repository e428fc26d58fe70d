"""Sampled controllers: `Controller`, and its reader onto the graph."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, final

from sympy.core.function import AppliedUndef
from sympy.physics.vector import dynamicsymbols

from ..errors import list_names
from ..frozen import frozen
from .model import ControllerModel

if TYPE_CHECKING:
    from ..ir.graph import Graph
    from ..ir.node import Node
    from .scene import Scene

_MOST = 60
"""Number of controllers of a scene, which are counted in the bits of a word."""


@final
@frozen(eq=False)
class Controller:
    """A controller that acts at sampling instants and holds its inputs in between.

    It acts at the start of a run and every `period` after it, `offset` later where that is given; not at the end of the
    run. At an instant its inputs are computed first, from the states as they are, then its states, from their old
    values and the new inputs. Controllers that act at one instant do so in the order in which they were added.

    Parameters
    ----------
    name : str
        Name, for messages.
    period : Expr or number
        Time between instants [s], of parameters alone.
    offset : Expr or number
        Time of the first instant after the start of a run [s]. Where it is not the number 0, initial values of the
        inputs must be given, which hold until then.
    states : mapping of dynamicsymbol to Expr, or sequence of dynamicsymbols
        New values of its own states, in time, coordinates, rates, states, inputs and parameters. Initial values are
        given with those of the coordinates. A sequence with `function`.
    inputs : mapping of dynamicsymbol to Expr, or sequence of dynamicsymbols
        Values of the inputs that it sets, which the scene has by ``add_inputs``. A sequence with `function`.
    function : callable, optional
        ``function(t, q, qdot, states, parameters) -> (inputs, states)`` in place of expressions, for single runs only:
        q and qdot are arrays (n_q,), states and parameters mappings of names to numbers, the results sequences in the
        order above or mappings of names to numbers.

    Examples
    --------
    A force on the pendulum of `Scene` that is set every 10 ms::

        u, k = dynamicsymbols("u"), symbols("k")
        scene.add_inputs(u)
        scene.add_loads((P, u * N.x))
        scene.add_controllers(da.Controller("brake", period=0.01, inputs={u: -k * theta.diff()}))
    """

    name: str
    period: Any
    offset: Any = 0
    states: Mapping[Any, Any] | Sequence[Any] = field(default_factory=dict)
    inputs: Mapping[Any, Any] | Sequence[Any] = field(default_factory=dict)
    function: Callable[..., Any] | None = None


def _listed(given: Any) -> list[Any]:
    return list(given) if isinstance(given, Iterable) and not isinstance(given, str) else []


def _items(scene: Scene) -> list[Controller]:
    given: Any = scene.controllers
    return [item for item in given if isinstance(item, Controller)]


def controlled_inputs(scene: Scene) -> tuple[Any, ...]:
    """Return the symbols of the inputs that the controllers of a scene set, in their order."""
    return tuple(u for item in _items(scene) for u in _listed(item.inputs))


def controller_symbols(scene: Scene) -> tuple[Any, ...]:
    """Return the symbols of the states of controllers, then those of the inputs that they set."""
    states = [z for item in _items(scene) for z in _listed(item.states)]
    known = [*states, *(u for u in controlled_inputs(scene) if u in scene.inputs)]
    return tuple(dict.fromkeys(x for x in known if isinstance(x, AppliedUndef) and x.args == (dynamicsymbols._t,)))


def read_controllers(
    scene: Scene, graph: Graph, read: Callable[[Any, str], Node], parameters: Callable[[], int], faults: list[str]
) -> tuple[ControllerModel, ...]:
    """Return the controllers of a scene on the graph.

    Parameters
    ----------
    scene : Scene
    graph : Graph
    read : callable
        Returns an expression that stands in some place as a node.
    parameters : callable
        Returns the dependency bits of the parameters that were read.
    faults : list of str
        Gets what is wrong.
    """
    _name_faults(scene, faults)
    found = []
    for item in _items(scene):
        if _fits(item, faults):
            place = f"controller {item.name!r}"
            period, offset = (
                _duration(read(value, f"{what} of {place}"), (what, place), parameters(), faults)
                for what, value in (("period", item.period), ("offset", item.offset))
            )
            states, inputs = _names(item.states), _names(item.inputs)
            changes = {} if item.function is not None else _changes(item, graph, read)
            found.append(ControllerModel(item.name, period, offset, states, inputs, changes, item.function))
    return tuple(found)


def _names(symbols: Any) -> tuple[str, ...]:
    return tuple(str(x.func.__name__) for x in _listed(symbols) if isinstance(x, AppliedUndef))


def _fits(item: Controller, faults: list[str]) -> bool:
    """Return whether a controller has either expressions or a function."""
    place, function = f"controller {item.name!r}", item.function
    laws: tuple[Any, Any] = (item.states, item.inputs)
    if item.function is None:
        if all(isinstance(law, Mapping) for law in laws):
            return True
        faults.append(f"{place}: without function=, states and inputs must be mappings of symbols to expressions")
        return False
    if callable(function) and not any(isinstance(law, Mapping) and law for law in laws):
        return True
    faults.append(f"{place}: with function=, which must be callable, states and inputs list symbols alone")
    return False


def _duration(node: Node, where: tuple[str, str], parameters: int, faults: list[str]) -> Node:
    """Return a period or an offset; record a fault for other values."""
    what, place = where
    if node.deps & ~parameters:
        faults.append(f"the {what} of {place} must be a number or a function of parameters alone")
    least = "positive" if what == "period" else "zero or positive"
    if node.number is not None and not (node.number > 0 if what == "period" else node.number >= 0):
        faults.append(f"the {what} of {place} is {float(node.number):g} s; it must be {least}")
    return node


def _changes(item: Controller, graph: Graph, read: Callable[[Any, str], Node]) -> dict[str, Node]:
    """Return the values that a controller sets: inputs from all former values, then states with the new inputs."""
    place, laws = f"controller {item.name!r}", (dict(item.inputs), dict(item.states))
    inputs, states = (
        {name: read(e, f"{what} {name!r} of {place}") for name, e in zip(_names(law), law.values(), strict=False)}
        for what, law in zip(("input", "state"), laws, strict=True)
    )
    new = {graph.input(name): node for name, node in inputs.items()}
    return inputs | dict(zip(states, graph.substitute(list(states.values()), new), strict=True))


def _name_faults(scene: Scene, faults: list[str]) -> None:
    items, given = _items(scene), list(scene.controllers)
    faults += [f"{item!r} is not a Controller" for item in given if item not in items]
    if len(items) > _MOST:
        faults.append(f"the scene has {len(items)} controllers; {_MOST} are allowed")
    names = [item.name for item in items]
    faults += [
        f"two controllers are called {name!r}; give each its own name"
        for name in sorted({str(n) for n in names if names.count(n) > 1})
    ]
    owners: dict[Any, str] = {}
    known = list_names(str(u.func.__name__) for u in scene.inputs if isinstance(u, AppliedUndef)) or "none"
    for item in items:
        place = f"controller {item.name!r}"
        if not _listed(item.inputs):
            faults.append(f"{place} gives no inputs; name those that it sets, which the scene has by add_inputs")
        for symbol in (*_listed(item.inputs), *_listed(item.states)):
            what = "input" if symbol in _listed(item.inputs) else "state"
            if not (isinstance(symbol, AppliedUndef) and symbol.args == (dynamicsymbols._t,)):
                faults.append(f"{place}: its {what} {symbol!r} is not a function of time; make it with dynamicsymbols")
                continue
            name = str(symbol.func.__name__)
            if what == "input" and symbol not in scene.inputs:
                faults.append(
                    f"{place} gives {name!r}, which is no input of the scene; declare it with add_inputs"
                    f" (known: {known})"
                )
            if symbol in owners:
                faults.append(f"{place}: {name!r} belongs to controller {owners[symbol]!r} too; let one of them set it")
            owners.setdefault(symbol, item.name)
