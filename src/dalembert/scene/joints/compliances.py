"""Compliances of reaction components, by which joints share a load that rigid bodies leave undetermined.

Of all reactions that balance the bodies, those of elastic supports in the limit of great stiffness minimise the elastic
energy, 1/2 sum c_i R_i^2 (Menabrea's theorem). Only the ratios of the compliances matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import sympy as sp

from ...errors import SceneError, list_names, unknown_name
from ...ir.node import Node
from .joints import Unknown
from .reactions import Connection

if TYPE_CHECKING:
    from ..scene import Scene

_SHARED = "a load that contacts with friction share indeterminately has the least norm, or a lawful share near it"


def add_compliances(self: Scene, compliances: Mapping[Any, Any]) -> None:
    """Add compliances of reaction components, by which joints share a load that rigid bodies leave undetermined.

    Of all reactions that balance the bodies, those are returned that minimise the elastic energy, 1/2 sum c_i
    R_i^2, as those of elastic supports do in the limit of great stiffness. The motion does not depend on them, nor
    does any reaction that the balances determine; only the ratios of the compliances matter.

    Parameters
    ----------
    compliances : mapping of names or unknowns to Expr or number
        For each reaction component its positive compliance [m/N], or [rad/(N m)] of a torque: a number, or an
        expression of parameters that are declared positive.

    Raises
    ------
    SceneError
        For what is no mapping; everything else is checked when the scene is compiled.

    Examples
    --------
    A door whose upper hinge is softer than its lower one along their common axis::

        c_1, c_2 = symbols("c_1 c_2", positive=True)
        scene.add_compliances({"upper.force_z": c_1, "lower.force_z": c_2})
    """
    given: Any = compliances
    if not isinstance(given, Mapping):
        what = f"add_compliances takes a mapping of reaction components to compliances, not {compliances!r}"
        raise SceneError(self.name, [what])
    self.compliances += tuple(given.items())


def read_compliances(
    scene: Scene, scalar: Callable[[Any, str], Node], moving: int, record: Callable[[str], None]
) -> dict[str, Node]:
    """Return the compliances by the names of the unknown reaction components, and record faults.

    Parameters
    ----------
    scene : Scene
    scalar : function
        Reader of an expression at a place that messages name.
    moving : int
        Dependency bits of all that changes along a motion.
    record : function
    """
    if not scene.compliances:
        return {}
    own = {str(x): x for joint in scene.joints for x in _unknowns([joint.force, joint.torque])}
    offered = {name: value for item in scene.connections for name, value in item.components.items()}
    known: dict[str, Any] = {**offered, **own, **{str(x): x for item in scene.connections for x in item.unknowns}}
    found: dict[str, Node] = {}
    for key, value in scene.compliances:
        place = f"compliance of {str(key)!r}"
        name = _component(str(key), known, scene.connections, place, record)
        expression = _expression(value)
        positive = expression is not None and expression.is_positive is True
        node = scalar(expression, place) if expression is not None and (positive or expression.free_symbols) else None
        if node is not None and node.deps & moving:
            record(f"{place} ({expression}) changes along the motion; write it in numbers and parameters")
        elif node is None or not positive:
            record(
                f"{place} is {value}, which is not known to be positive and finite: give a positive number, or an"
                " expression of symbols that are declared positive, such as symbols('c', positive=True)"
            )
            continue
        if name in found:
            record(f"{place} is given twice; a reaction component has one")
        if name is not None and node is not None:
            found[name] = node
    if scene.frictions or any(getattr(contact, "tangential", None) is not None for contact in scene.contacts):
        record(
            f"compliances are given in a scene with friction: {_SHARED}. Leave them out, or give the contacts a law of"
            " force of their own by add_loads"
        )
    return found


def _expression(value: Any) -> Any:
    """Return a compliance as SymPy's; None for what is none."""
    if isinstance(value, bool | str):
        return None
    try:
        expression = sp.sympify(value)
    except (sp.SympifyError, TypeError, AttributeError):
        return None
    return expression if isinstance(expression, sp.Expr) else None


def _unknowns(vectors: Iterable[Any]) -> list[Unknown]:
    """Return the unknown components of vectors."""
    matrices = [matrix for vector in vectors for matrix, _ in getattr(vector, "args", ())]
    return sorted({x for matrix in matrices for x in matrix.atoms(Unknown)}, key=str)


def _component(
    key: str, known: dict[str, Any], connections: Iterable[Connection], place: str, record: Callable[[str], None]
) -> str | None:
    """Return the name of the unknown that a name stands for; a fault where it is none."""
    if key not in known:
        names = [name for name, value in known.items() if isinstance(value, Unknown)]
        record(f"{place}: {unknown_name('reaction component', key, names)}")
        return None
    value = known[key]
    for one in (value, -value):
        if isinstance(one, Unknown):
            return str(one)
    parts = sorted(map(str, getattr(value, "atoms", lambda _: ())(Unknown)))
    if not parts:
        owner = next((item.name for item in connections if key in item.components), key)
        record(f"{place}: the joint {owner!r} leaves that direction free, so that it carries nothing there")
    else:
        record(f"{place} is made of {list_names(parts)}; give each of these its own compliance")
    return None
