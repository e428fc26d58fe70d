"""Choice of the constraints that a run enforces: those that depend on each other around its start are dropped."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..methods.status import Status
from ..reduction.dependent_rows import Redundancy
from ..reduction.starting import Start
from ..results.parts import Part
from ..results.statistics import RunStatistics
from ..results.trajectory import Trajectory
from ..steps.problem import IntegrationProblem
from . import inputs
from .branches import branches
from .constraint_rank import StartRows
from .initial_states import initial_state, pivots_vanish, vanishing_pivots
from .segment_constants import starting_constants

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def independent_model(
    model: CompiledModel, problem: IntegrationProblem, method: str, begin: float
) -> CompiledModel | Trajectory:
    """Return the model for the constraints that follow from others around the start of a problem.

    It enforces all of them together, or else those do not that follow. Where only the start itself is singular, return
    the run that ends there.
    """
    enforced, program, reduced = model.derived.enforced, model.stages.program, model.stages.reduced
    if not enforced or reduced.redundancy is not None:
        return model
    start = StartRows(program, problem.t0, problem.y0, problem.constants, enforced)
    found = start.redundant()
    joint = _enforced_together(model, start, found)
    if joint is not None:
        return model.variants.enforcing_all(joint)
    note = _singular_start(start) if found is None else start.nearly_redundant() if found else ""
    if found is not None and not note:
        return model.variants.without_constraints(found) if found else model
    statistics = RunStatistics(method, 0, 0, 0, 0.0, time.perf_counter() - begin, note)
    times = np.array([problem.t0]) if problem.t_eval is None else problem.t_eval[problem.t_eval == problem.t0]
    states = np.repeat(problem.y0[np.newaxis], len(times), axis=0)
    about = None, problem.t0, model.stages.scene, model.monitors
    part = Part(program, problem.constants, times, states, *about)
    return Trajectory((part,), Status.SINGULAR_CONFIGURATION, statistics)


def _singular_start(start: StartRows) -> str:
    """Return the note of a run that would start at a singular configuration, with the branches that meet there."""
    met = branches(start.program, start.t, start.y, start.c, start.rows)
    note = f"{start.where_dependent()}, and not around it: start elsewhere, or use other coordinates"
    return f"{note}{met and f'; {met}'}"


def _enforced_together(model: CompiledModel, start: StartRows, found: tuple[int, ...] | None) -> Redundancy | None:
    """Return what it takes to enforce all constraints at a start; None where none follow, or it is not supported.

    `found` are those that follow from others among the ones that the model enforces.
    """
    stages, reduced = model.stages, model.stages.reduced
    if stages.kept or model.dropped or not _served_in_modes(model):
        return None
    rows = sorted({*model.derived.enforced, *reduced.unproven})
    if rows != list(model.derived.enforced):
        start = StartRows(start.program, start.t, start.y, start.c, rows)
        found = start.redundant()
    if not found or start.nearly_redundant():
        return None
    return start.together(found)


def _served_in_modes(model: CompiledModel) -> bool:
    """Return whether contacts allow that constraints are enforced together: without friction, where steps project."""
    stages = model.stages
    frictionless = not any(contact.tangential for contact in stages.derivation.equations.contacts)
    return stages.mode is None or (frictionless and stages.reduced.formulation == "projected")


def divisible_model(
    model: CompiledModel, t0: float, initial: Mapping[Any, Any], parameters: Mapping[Any, Any]
) -> CompiledModel:
    """Return the model without the constraints that this one divides by something that vanishes at the parameters.

    Raises
    ------
    InitialStateError
        Where one of them does not follow from the others there.
    """
    if not model.stages.reduced.pivots:
        return model
    p = model.parameter_vector(parameters)
    values = model.initial_values(initial)
    labels = vanishing_pivots(model.derived.start(values), t0, values, p)
    if not labels:
        return model
    names = model.layout.constraints
    fewer = model.variants.without_constraints([names.index(label) for label in labels])
    further = divisible_model(fewer, t0, initial, parameters)
    if further is not fewer:
        return further
    program, rows, left_out = fewer.stages.program, range(len(names)), fewer.stages.reduced.left_out
    c = inputs.constants(program, p)
    y = initial_state(fewer.derived.start(values), t0, values, c, program)
    rest = [i for i in rows if i not in left_out]
    found = StartRows(program, t0, y, c, rows).redundant()
    follow = found is not None and len(found) == len(left_out)
    follow = follow and StartRows(program, t0, y, c, rest).redundant() == ()
    if not follow:
        raise pivots_vanish(model.stages.program, p, labels)
    return fewer


def dependent_at_start(
    program: Program, start: Start, t_span: tuple[float, float], state: FloatArray, p: FloatArray
) -> bool:
    """Return whether constraints depend on each other at a state (n_y,), at the start of a span."""
    c = starting_constants(program, inputs.constants(program, p), *t_span)
    return bool(interpret_rows(start.kernel, np.array(t_span[:1]), state[np.newaxis], c)[0, 0])
