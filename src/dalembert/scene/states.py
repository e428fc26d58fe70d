"""First-order states of a scene: their symbols, names and rates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.vector import dynamicsymbols

from ..errors import list_names
from ..naming import rate_name, unwritable
from .controllers import controller_symbols

if TYPE_CHECKING:
    from ..ir.graph import Node
    from .expressions import ExpressionReader
    from .scene import Scene

__all__ = ["read_rates", "refuse_states", "state_symbols"]

_TO_DO = "make it with dynamicsymbols, as in F = dynamicsymbols('F')"


def state_symbols(scene: Scene, coordinates: Sequence[Any], fault: Callable[[str], Any]) -> tuple[Any, ...]:
    """Return the symbols of the first-order states of a scene, without those for which `fault` is called.

    Parameters
    ----------
    scene : Scene
    coordinates : sequence of dynamicsymbols
        Its coordinates.
    fault : callable
        Records a fault.
    """
    others = {str(q.func.__name__): "a coordinate of the scene" for q in coordinates}
    angles = [angle for item in scene.orientations for angle in item.angles]
    others |= {str(q.func.__name__): "a coordinate that the scene eliminates" for q, _ in scene.imposed}
    others |= {str(q.func.__name__): "an angle that a quaternion replaces" for q in angles}
    others |= {str(u.func.__name__): "a speed of the scene" for u in scene.speeds}
    others |= {str(u.func.__name__): "an input of the scene" for u in scene.inputs if hasattr(u, "func")}
    sampled = controller_symbols(scene)
    for u in scene.inputs:
        if u in sampled:
            others.pop(str(u.func.__name__), None)
    good: dict[str, Any] = {}
    for z in (*(z for z, _ in scene.states), *sampled):
        if not (isinstance(z, AppliedUndef) and z.args == (dynamicsymbols._t,)):
            fault(f"state {z!r} is not a function of time; {_TO_DO}")
            continue
        name = str(z.func.__name__)
        if name in others:
            fault(f"state {name!r} is {others[name]} too; a state has a rate of first order alone: rename one of them")
        elif name in good:
            fault(f"state {name!r} is given twice; write one rate for it")
        elif unwritable(name):
            fault(f"the name of state {name!a} has a lone surrogate, half of a character; use another name")
        else:
            good[name] = z
    return tuple(good.values())


def read_rates(
    scene: Scene, symbols: Sequence[Any], reader: ExpressionReader, read: Callable[[Any, str], Node]
) -> tuple[Node, ...]:
    """Return the rates of first-order states; from now on their derivatives are read as these.

    Parameters
    ----------
    scene : Scene
    symbols : sequence of dynamicsymbols
        Its states, of `state_symbols`.
    reader : ExpressionReader
        Gets the rates.
    read : callable
        Returns an expression that the motion depends on, at a place, as a node.
    """
    time = dynamicsymbols._t
    written = dict.fromkeys(symbols, sp.S.Zero) | dict(scene.states)
    names = [rate_name(z.func.__name__) for z in symbols]
    mask, rates = reader.graph.mask(names), []
    for z in symbols:
        place = f"rate of state {z.func.__name__!r}"
        node = read(written[z], place)
        if node.deps & mask:
            used = [name for name in names if node.deps & reader.graph.input(name).deps]
            reader.faults.append(f"{place}: it contains {list_names(used)}; write the expression of that rate instead")
            node = reader.graph.zero
        rates.append(node)
    reader.define({z.diff(time): node for z, node in zip(symbols, rates, strict=True)})
    return tuple(rates)


def refuse_states(reader: ExpressionReader, symbols: Sequence[Any], nodes: Sequence[Node], place: str) -> None:
    """Record a fault where a position or an energy depends on first-order states."""
    deps = 0
    for node in nodes:
        deps |= node.deps
    used = [z for z in symbols if deps & reader.graph.input(z.func.__name__).deps]
    if used:
        reader.faults.append(
            f"{place}: it depends on the first-order states {list_names(str(z.func.__name__) for z in used)}, which"
            " have no accelerations. They may stand in loads, joints, nonholonomic constraints, laws of friction, rates"
            " of states, outputs and events; what moves a body must be a coordinate or a function of time"
        )
