"""Choice of the model that the cases of a sweep run: which constraints it enforces, which first integrals it keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError, ValueInputError
from ..ir.interpret import interpret_rows
from ..results.cases import CaseSet
from ..starts.constraint_choice import divisible_model, independent_model
from ..starts.constraint_rank import unlike
from ..starts.first_integrals import case_by_case, keeping_model, kept_values
from .case_settings import CaseSettings, with_grid
from .cases import Cases, single_problem

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def keeping_cases(
    model: CompiledModel,
    requested: Any,
    t_span: tuple[Any, Any],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    grid: CaseSet | None,
) -> tuple[CompiledModel, dict[str, FloatArray]]:
    """Return the model that keeps first integrals after every step, and its further parameters for all cases."""
    if grid is not None:
        initial, parameters = with_grid(model.layout, grid, initial, parameters)
    program = model.stages.program
    cases = Cases(program, model.derived.start, t_span, initial, parameters)
    rows = model.engine.rows if model.engine.parallel else None
    nothing = CaseSettings(None, "", 1.0, 1.0, np.inf, 1, 1, False)
    block, status = cases.block(slice(0, cases.count), nothing, rows or interpret_rows, exact=rows is None)
    y, c, t, able = block.y, block.c, block.spans[:, 0], np.flatnonzero(status < 0)
    if not len(able):
        raise ValueInputError("project_invariants: no case of the sweep can start, so that nothing is to be kept")
    first = able[0]
    keeper, names = keeping_model(model, requested, c[first], float(t[first]), y[first])
    return keeper, kept_values(names, program, model.derived.invariants, c, t, y, rows or case_by_case)


def divisible_cases(model: CompiledModel, cases: Cases) -> CompiledModel:
    """Return the model without the constraints whose pivots vanish in every case.

    Where it vanishes in some cases only, those have a status.
    """
    if not model.stages.reduced.pivots or not np.any(cases.lost_pivots(slice(0, 1))):
        return model
    if not np.all(cases.lost_pivots(slice(0, cases.count))):
        return model
    initial, parameters = ({n: float(v[0]) for n, v in t.items()} for t in (cases.initial, cases.parameters))
    try:
        return divisible_model(model, float(cases.span["start"][0]), initial, parameters)
    except (InitialStateError, ValueInputError):
        return model


def surely_independent(model: CompiledModel, cases: Cases, settings: CaseSettings) -> bool:
    """Return whether all cases can start, and their constraints are independent by far."""
    enforced, reduced = model.derived.enforced, model.stages.reduced
    if not enforced or model.dropped or reduced.redundancy is not None or not cases.plain:
        return False
    rows = sorted({*enforced, *reduced.unproven})
    return model.engine.surely_independent(cases.columns(slice(0, cases.count), settings), rows)


def independent_cases(model: CompiledModel, cases: Cases, settings: CaseSettings, begin: float) -> CompiledModel:
    """Return the model that enforces no constraint which follows from others around the first start."""
    if not model.derived.enforced:
        return model
    tried = (single_problem(cases, settings, i, model.derived.quick_start) for i in range(cases.count))
    first = next((problem for problem in tried if problem is not None), None)
    able = model if first is None else independent_model(model, first, settings.method, begin)
    return able if isinstance(able, type(model)) else model


def unlike_left_out(model: CompiledModel, cases: Cases, settings: CaseSettings) -> CaseSettings:
    """Return settings that do not run cases in which other constraints follow from others than in the first."""
    enforced, dropped, redundancy = model.derived.enforced, model.dropped, model.stages.reduced.redundancy
    if not enforced and not dropped:
        return settings
    rows = sorted({*enforced, *dropped})
    if dropped and not enforced:  # `minimal` enforces all others
        rows = list(range(len(model.layout.constraints)))
    if cases.count < 2 or len(rows) < 2 or not model.layout.state:
        return settings
    block, status = cases.block(slice(0, cases.count), settings)
    rank = None if redundancy is None else redundancy.ranks
    starts = block.spans[:, 0], block.y, block.c
    different = unlike(model.stages.program, *starts, rows, lost=bool(dropped), rank=rank)
    different &= status < 0
    count = int(np.sum(different))
    if not count:
        return settings
    cases.leave_out(different)
    note = (
        f"in {count} of {cases.count} cases other constraints follow from each other around the start than in the"
        " first: these were not run; give them a sweep of their own"
    )
    return replace(settings, apart=different, note="; ".join(text for text in (settings.note, note) if text))
