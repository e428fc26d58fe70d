"""Jumps of the forces of a scene along which a run that used up its steps slides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from ..arrays import FloatArray
from ..errors import list_names
from ..integrators.problem import Solution
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..reduction.event_functions import event_functions
from ..scene.expressions import short
from ..scene.tables import TableFunction
from ..scene.unknowns import Unknown

if TYPE_CHECKING:
    from ..scene import Scene
    from .model import CompiledModel

__all__ = ["slid_along"]

_LAST, _OTHERS = 100, 200
"""Steps at the end of a run that are looked at, and how many of the others give the scale."""
_NEAR = 1e-3
"""Share of its largest distance from a jump within which a motion stays that slides along it."""
_CROSSINGS = 4
"""Steps for each crossing of a jump, at most, of a motion that slides along it."""


@final
@dataclass(frozen=True, eq=False)
class _Jump:
    """What jumps, as text, its argument, and the values (k,) of the argument at which it jumps."""

    text: str
    argument: Any
    places: FloatArray

    def holds(self, values: FloatArray) -> bool:
        """Return whether values (k,) of the argument, the last `_LAST` of steps in a row, stay where it jumps."""
        if not np.all(np.isfinite(values)):
            return False
        distances = values - self.places[np.argmin(np.abs(self.places - values[-1]))]
        last = distances[-_LAST:]
        crossings = np.count_nonzero(np.diff(np.sign(last)))
        return bool(np.max(np.abs(last)) < _NEAR * np.max(np.abs(distances)) or crossings * _CROSSINGS >= _LAST)


def slid_along(model: CompiledModel, solution: Solution, c: Constants) -> str:
    """Return along which jumps a run slid that used up its steps, and what helps; "" for none."""
    if solution.status is not Status.MAX_STEPS:
        return ""
    t = solution.t if solution.dense is None else solution.dense.knots
    jumps = [jump for jump in _jumps(model.stages.scene) if not jump.argument.atoms(Unknown)]
    jumps = list({jump.text: jump for jump in jumps}.values())
    if not jumps or len(t) <= _LAST:
        return ""
    chosen = np.union1d(np.linspace(0, len(t) - 1, _OTHERS).astype(int), np.arange(len(t) - _LAST, len(t)))
    times = np.asarray(t)[chosen]
    y = solution.y[chosen] if solution.dense is None else solution.dense(times)
    arguments = [jump.argument for jump in jumps]
    kernel = event_functions(model.stages.scene, model.stages.reduced, arguments, "jump", moving=False).values
    values = interpret_rows(kernel, times, y, constants_at(c, times))
    met = [jump.text for jump, column in zip(jumps, values.T, strict=True) if jump.holds(column)]
    if not met:
        return ""
    return (
        f"the last {_LAST} steps, {abs(times[-1] - times[-_LAST]):.2g} s, stay where {list_names(met)}"
        f" {'changes' if len(met) == 1 else 'change'}: the motion slides along this jump, which more steps do"
        " not pass. Replace it by a steep smooth function, such as tanh, and dry friction by a CoulombFriction"
    )


def _jumps(scene: Scene) -> Iterator[_Jump]:
    """Yield what jumps with the motion in the forces and rates of a scene."""
    for expression in _expressions(scene):
        for found in sorted(expression.atoms(sp.sign, sp.Heaviside), key=sp.default_sort_key):
            yield _Jump(short(found), found.args[0], np.zeros(1))
        for relation in sorted(expression.atoms(Relational), key=sp.default_sort_key):
            yield _Jump(f"the condition {short(relation)}", relation.lhs - relation.rhs, np.zeros(1))
        for table in sorted(expression.atoms(TableFunction), key=sp.default_sort_key):
            if table.curve.table.smoothness < table.curve.order:
                yield _Jump(f"the table {table.curve.table.name!r}", table.args[0], table.curve.table.edges)


def _expressions(scene: Scene) -> Iterator[Any]:
    """Yield the expressions of a scene that decide its accelerations and rates."""
    given = [*scene.loads, *(load for actuator in scene.actuators for load in actuator.to_loads())]
    vectors = [load[1] for load in given]
    vectors += [vector for joint in scene.joints for vector in (joint.force, joint.torque)]
    for vector in vectors:
        for matrix, _ in getattr(vector, "args", ()):
            yield from matrix
    yield from map(sp.sympify, (*scene.nonholonomic_constraints, *(rate for _, rate in scene.states)))
