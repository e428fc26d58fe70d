"""Jumps of the forces and rates of a scene: where `sign`, `Heaviside`, conditions and tables change."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, final

import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from ...arrays import FloatArray
from ...frozen import frozen
from ..joints.joints import Unknown
from .reader import short
from .table_functions import TableFunction

if TYPE_CHECKING:
    from ..scene import Scene


@final
@frozen(eq=False)
class ForceJump:
    """An expression that jumps, as text, its argument, and the values (k,) of the argument at which it jumps."""

    text: str
    argument: Any
    places: FloatArray


def force_jumps(scene: Scene) -> list[ForceJump]:
    """Return what jumps with the motion in the forces and rates of a scene, each once; not what unknowns decide."""
    jumps = [jump for jump in _jumps(scene) if not jump.argument.atoms(Unknown)]
    return list({jump.text: jump for jump in jumps}.values())


def _jumps(scene: Scene) -> Iterator[ForceJump]:
    """Yield what jumps, as often as it stands in the scene."""
    for expression in _expressions(scene):
        for found in sorted(expression.atoms(sp.sign, sp.Heaviside), key=sp.default_sort_key):
            yield ForceJump(short(found), found.args[0], np.zeros(1))
        for relation in sorted(expression.atoms(Relational), key=sp.default_sort_key):
            yield ForceJump(f"the condition {short(relation)}", relation.lhs - relation.rhs, np.zeros(1))
        for table in sorted(expression.atoms(TableFunction), key=sp.default_sort_key):
            for x, axis, order in table.axes():
                if axis.smoothness < order:
                    yield ForceJump(f"the table {axis.name!r}", x, axis.edges)


def _expressions(scene: Scene) -> Iterator[Any]:
    """Yield the expressions of a scene that decide its accelerations and rates."""
    given = [*scene.loads, *(load for actuator in scene.actuators for load in actuator.to_loads())]
    vectors = [load[-1] for load in given]
    vectors += [vector for joint in scene.joints for vector in (joint.force, joint.torque)]
    for vector in vectors:
        for matrix, _ in getattr(vector, "args", ()):
            yield from matrix
    yield from map(sp.sympify, (*scene.nonholonomic_constraints, *(rate for _, rate in scene.states)))
