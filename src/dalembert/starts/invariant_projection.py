"""First integrals that a run keeps: which they are, their initial values, and the model that projects onto them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, list_names, unknown_name
from ..events.event_code import event_list
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..mechanics.equations import EquationsOfMotion
from ..reduction.invariant_projection import TIME_SCALE, initial_name
from ..reduction.invariants import InvariantCandidates, why_not
from ..values import listed
from . import inputs
from .initial_states import initial_state
from .monitors import Rows, changing, conserved
from .segment_constants import starting_constants

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_SMALL = 1e-5
"""Share of the state by which it is moved for differences."""


def keeping_from(
    model: CompiledModel,
    requested: Any,
    span: tuple[float, float],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
) -> tuple[CompiledModel, dict[str, float]]:
    """Return the model that keeps first integrals after every step, and its further parameters for a start."""
    t0, program = span[0], model.stages.program
    c = inputs.constants(program, model.parameter_vector(parameters))
    c = starting_constants(program, c, *span)
    values = model.initial_values(initial)
    y = initial_state(model.derived.start(values), t0, values, c, program)
    keeper, names = keeping_model(model, requested, c, t0, y)
    found = kept_values(names, program, model.derived.invariants, c[np.newaxis], np.array([t0]), y[np.newaxis])
    return keeper, {name: float(column[0]) for name, column in found.items()}


def keeping_model(
    model: CompiledModel, requested: Any, c: FloatArray, t0: float, y: FloatArray
) -> tuple[CompiledModel, tuple[str, ...]]:
    """Return the model that keeps first integrals, and their names; `requested` and errors as for `kept_names`."""
    stages = model.stages
    names = kept_names(requested, stages.equations, stages.program, model.derived.invariants, c, t0, y)
    return model.variants.keeping_invariants(names), names


def kept_names(
    requested: Any,
    equations: EquationsOfMotion,
    program: Program,
    found: InvariantCandidates,
    c: FloatArray,
    t: float,
    y: FloatArray,
) -> tuple[str, ...]:
    """Return the names of the first integrals to keep: all that are conserved, or the requested ones.

    Parameters
    ----------
    requested : True, a name, or an iterable of names
    equations, program, found
        Of the model.
    c, t, y
        Constants (n_c,), time and state (n_y,) at a start.

    Raises
    ------
    UnknownNameError
        For a name that is no candidate.
    OptionError
        For what is not conserved, with the reason, and where nothing is; and where no name is given.
    """
    refuse_unknown(requested, found)
    x = interpret_rows(program.kernel("expand"), np.array([t]), y[np.newaxis], c)
    able = tuple(conserved(program, found, c, np.array([t]), x))
    if requested is True:
        if not able:
            raise OptionError(
                f"project_invariants: nothing is known to be conserved in {program.name!r}. The energy is not:"
                f" {why_not(equations, 'energy')}"
            )
        return able
    names = _listed(requested)
    if not names:
        raise OptionError(
            "project_invariants: no first integral is named. Give names, True for all that are conserved, or False."
            f" Conserved in {program.name!r}: {list_names(able) or 'nothing that is known'}"
        )
    lost = [f"{name!r} is not conserved: {why_not(equations, name)}" for name in names if name not in able]
    if lost:
        raise OptionError(
            f"project_invariants: {'; '.join(lost)}. Conserved in {program.name!r}:"
            f" {list_names(able) or 'nothing that is known'}"
        )
    return tuple(name for name in found.names if name in names)


def _listed(requested: Any) -> list[str]:
    given = listed("project_invariants", requested, "names") if isinstance(requested, Iterable) else [requested]
    return [str(name) for name in given if name is not None]


def refuse_unknown(requested: Any, found: InvariantCandidates) -> None:
    """Refuse names of first integrals that a scene cannot have.

    Raises
    ------
    UnknownNameError
        Naming them.
    """
    names = [] if requested is True else _listed(requested)
    unknown = [unknown_name("first integral", name, found.names) for name in names if name not in found.names]
    if unknown:
        raise UnknownNameError("\n".join(unknown))


def refuse_jumps(events: Any, aliases: Any) -> None:
    """Refuse events that jump: first integrals change there.

    Raises
    ------
    OptionError
        Naming them.
    """
    jumps = [event.label for event in event_list(events, aliases) if event.apply is not None]
    if jumps:
        raise OptionError(
            f"project_invariants keeps first integrals at their initial values, and the state jumps at the events"
            f" {list_names(jumps)}: leave out one of the two"
        )


def case_by_case(kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
    """Return a kernel's outputs case by case, so that those of a case are the bits of the case alone."""
    return np.stack([interpret_rows(kernel, t[i : i + 1], y[i : i + 1], c[i])[0] for i in range(len(t))])


def kept_values(
    names: Iterable[str],
    program: Program,
    found: InvariantCandidates,
    c: FloatArray,
    t: FloatArray,
    y: FloatArray,
    rows: Rows = case_by_case,
) -> dict[str, FloatArray]:
    """Return the parameters that `project_invariants` adds, for starts at t (k,) in y (k, n_y) with c (k, n_c).

    `rows` evaluates kernels.

    Raises
    ------
    OptionError
        For what some case does not conserve, with its number.
    """
    with np.errstate(all="ignore"):
        if not all(found.certain[found.names.index(name)] for name in names):
            together = interpret_rows if rows is case_by_case else rows
            _refuse_changing(list(names), program, found, changing(program, found, c, t, y, together))
        values = rows(found.values, t, rows(program.kernel("expand"), t, y, c), c)
        given = {initial_name(name): np.nan_to_num(values[:, found.names.index(name)]) for name in names}
        return given | {TIME_SCALE: _time_scale(program, c, t, y, rows)}


def _refuse_changing(
    names: list[str],
    program: Program,
    found: InvariantCandidates,
    moves: np.ndarray[tuple[int, int], np.dtype[np.bool_]],
) -> None:
    lost = {name: np.flatnonzero(moves[:, found.names.index(name)]) for name in names}
    told = [
        f"{name!r} is not conserved {f'in case {cases[0]}' if len(moves) > 1 else 'with these parameters'}"
        for name, cases in lost.items()
        if len(cases)
    ]
    if told:
        raise OptionError(
            f"project_invariants: {'; '.join(told)}, but is in the first run of {program.name!r}. Name what all runs"
            " conserve, or keep those apart that conserve it"
        )


def _time_scale(program: Program, c: FloatArray, t: FloatArray, y: FloatArray, rows: Rows) -> FloatArray:
    """Return times (k,) over which motions change, as powers of two: for y' = f, of |f| over |f' f' f|.

    An oscillation about an equilibrium of the frequency w has 1/w, in whatever phase it starts.
    """
    kernel = program.kernel("rhs")
    slope = rows(kernel, t, y, c)
    along = slope
    size = np.maximum(1.0, np.max(np.abs(y), axis=1, initial=0.0))
    for _ in range(2):
        length = np.max(np.abs(along), axis=1, initial=0.0)
        share = (_SMALL * size / np.where(length > 0.0, length, 1.0))[:, np.newaxis]
        along = (rows(kernel, t, y + share * along, c) - slope) / share
    ratio = np.linalg.norm(along, axis=1) / np.linalg.norm(slope, axis=1)
    fine = np.isfinite(ratio) & (ratio > 1e-12)
    scale: FloatArray = np.where(fine, np.exp2(-np.round(0.5 * np.log2(np.where(fine, ratio, 1.0)))), 1.0)
    return scale
