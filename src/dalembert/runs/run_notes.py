"""Notes on runs and sweeps: jumps along which they slide, pathways of length zero, reactions without a value."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..errors import list_names
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..reduction.event_functions import event_functions
from ..scene.actuators import straight_parts
from ..scene.expressions.force_jumps import force_jumps
from ..steps.problem import Solution
from ..stops.segments import Constants, constants_at

if TYPE_CHECKING:
    from ..model.model import CompiledModel
    from ..results.sweep import Sweep


_LAST, _OTHERS = 100, 200
"""Steps at the end of a run that are looked at, and how many of the others give the scale."""
_NEAR = 1e-3
"""Share of its largest distance from a jump within which a motion stays that slides along it."""
_CROSSINGS = 4
"""Steps for each crossing of a jump, at most, of a motion that slides along it."""


def slid_along(model: CompiledModel, solution: Solution, c: Constants) -> str:
    """Return along which jumps a run slid that used up its steps, and what helps; "" for none."""
    if solution.status is not Status.MAX_STEPS:
        return ""
    t = solution.t if solution.dense is None else solution.dense.knots
    jumps = force_jumps(model.stages.scene)
    if not jumps or len(t) <= _LAST:
        return ""
    chosen = np.union1d(np.linspace(0, len(t) - 1, _OTHERS).astype(int), np.arange(len(t) - _LAST, len(t)))
    times = np.asarray(t)[chosen]
    y = solution.y[chosen] if solution.dense is None else solution.dense(times)
    arguments = [jump.argument for jump in jumps]
    kernel = event_functions(model.stages.scene, model.stages.reduced, arguments, "jump", moving=False).values
    values = interpret_rows(kernel, times, y, constants_at(c, times))
    met = [jump.text for jump, column in zip(jumps, values.T, strict=True) if _holds(column, jump.places)]
    if not met:
        return ""
    return (
        f"the last {_LAST} steps, {abs(times[-1] - times[-_LAST]):.2g} s, stay where {list_names(met)}"
        f" {'changes' if len(met) == 1 else 'change'}: the motion slides along this jump, which more steps do"
        " not pass. Replace it by a steep smooth function, such as tanh, and dry friction by a CoulombFriction"
    )


def _holds(values: FloatArray, places: FloatArray) -> bool:
    """Return whether values (k,) of an argument, the last `_LAST` of steps in a row, stay where a force jumps."""
    if not np.all(np.isfinite(values)):
        return False
    distances = values - places[np.argmin(np.abs(places - values[-1]))]
    last = distances[-_LAST:]
    crossings = np.count_nonzero(np.diff(np.sign(last)))
    return bool(np.max(np.abs(last)) < _NEAR * np.max(np.abs(distances)) or crossings * _CROSSINGS >= _LAST)


# Actuators whose pathway has length zero where a run ended.

_NOTHING = 1e-12
"""Share of its largest length in a run at which a part of a pathway counts as zero."""


def lost_directions(model: CompiledModel, solution: Solution, c: Constants) -> str:
    """Return which pathways of actuators have the length zero where the rates of a run are not finite, "" for none."""
    scene = model.stages.scene
    if solution.status != Status.NON_FINITE or not scene.actuators or not len(solution.t):
        return ""
    parts = straight_parts(scene)
    lengths = [length for _, _, length in parts]
    kernel = event_functions(scene, model.stages.reduced, lengths, "pathway", moving=False).values
    found = np.abs(interpret_rows(kernel, solution.t, solution.y, constants_at(c, solution.t)))
    lost = [
        f"{name} has no direction, because {ends} are at the same place"
        for (name, ends, _), length, largest in zip(parts, found[-1], np.max(found, axis=0), strict=True)
        if length <= _NOTHING * largest
    ]
    return f"at t = {solution.t[-1]:.6g} {'; '.join(lost)}" if lost else ""


# Reactions that have no value where a run began or ended.

_SINGULAR = (
    "the configuration is singular for them, or on another branch of a root or an absolute value than where they were"
    " derived"
)


def lost_reactions(model: CompiledModel, solution: Solution, c: Constants) -> str:
    """Return which requested reactions are NaN where a run began or ended in numbers, "" for none."""
    layout, program = model.layout, model.stages.program
    asked = [(i, name) for i, name in enumerate(layout.outputs) if name in layout.unknowns]
    if not asked or not len(solution.t):
        return ""
    t, y = solution.t[[0, -1]], solution.y[[0, -1]]
    values = interpret_rows(program.kernel("outputs"), t, y, constants_at(c, t))
    lost = np.isnan(values) & np.all(np.isfinite(y), axis=1)[:, np.newaxis]
    names = [name for i, name in asked if lost[:, i].any()]
    if not names:
        return ""
    at = ", ".join(f"{time:.6g}" for time, row in zip(t, lost, strict=True) if any(row[i] for i, _ in asked))
    return f"the reactions {list_names(names)} are not determined at t = {at}, and NaN: {_SINGULAR}"


def with_lost_reactions(model: CompiledModel, sweep: Sweep) -> Sweep:
    """Return a sweep whose note has the requested reactions that are NaN where some cases end in numbers."""
    asked = [name for name in model.layout.outputs if name in model.layout.unknowns]
    if not asked or not len(sweep):
        return sweep
    found = sweep._states.at_ends([*asked, *model.layout.variables])
    known = np.all(np.isfinite(found[len(asked) :]), axis=0)
    lost = {name: int(np.sum(np.isnan(values) & known)) for name, values in zip(asked, found, strict=False)}
    texts = [f"{name} in {count} of {len(sweep)} cases" for name, count in lost.items() if count]
    if texts:
        note = f"reactions are not determined at the end, and NaN: {', '.join(texts)}; {_SINGULAR}"
        sweep.stats = replace(sweep.stats, note="; ".join(text for text in (sweep.stats.note, note) if text))
    return sweep
