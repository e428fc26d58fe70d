"""Equilibria and steady motions, by Newton's method on chosen values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError, OptionError, ValueInputError, list_names
from ..ir.interpret import interpret_rows
from ..options import TrimOptions
from ..results.analyses import OperatingPoint
from ..runs.capabilities import WITHOUT, refuse_sampling
from ..starts import inputs as run_input
from ..starts.assembly import assembled
from ..starts.constraint_rank import StartRows
from ..starts.constraint_rows import row_lengths
from ..starts.input_values import held_at
from ..starts.state_sizes import distance_sizes
from .newton import Root, Units, newton
from .steady_conditions import SteadyConditions
from .trim_report import TrimChoice, TrimReport, given_places

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_RANK = 1e-9
_SPREAD = 4.0
"""Largest ratio of the residual of a condition to its spread by rounding."""

_ROUNDING = 4e-15
"""Rounding error of a condition, as a share of its change with the free values."""


def find_operating_point(
    model: CompiledModel, guess: Mapping[Any, Any], parameters: Mapping[Any, Any], options: TrimOptions
) -> OperatingPoint:
    """Return an equilibrium or a steady motion; see `CompiledModel.trim`."""
    refuse_sampling(model.stages.equations.controllers, "trim", WITHOUT)
    values = run_input.guessed_values(model.layout, model.equations.symbols.entries, guess)
    p = held_at(model.layout, model.parameter_vector(parameters), options.t)
    free = _free_names(model, options.free)
    follow = tuple(name for name in model.layout.rates if name not in values)
    able, values = _regular(model, options.t, values, p, free, follow)
    conditions, chosen = _conditions(able, options, values, p, free, follow)
    with np.errstate(all="ignore"):
        root, share = _solved(conditions, options)
    if root.iterations == 0 and not np.all(np.isfinite(root.residual)):
        raise ValueInputError(
            "the accelerations or constraints are not finite at the guess: start from other values, or check the"
            " parameters that the scene divides by"
        )
    return TrimReport(able, conditions, root, chosen, share).point()


def _solved(conditions: SteadyConditions, options: TrimOptions) -> tuple[Root, FloatArray]:
    """Return the root of the conditions, and their residuals as shares of the tolerance.

    Steps that stay near are tried first. Where they do not arrive, Newton's method is, and then steps along the
    constraints that all reduce the rest, from the same start.
    """
    units = conditions.units()
    near = _nearest(conditions, units, options.max_iterations)
    if near is not None:
        share = _shares(conditions, units, near, options.tolerance)
        if np.all(share <= 1.0):
            return near, share
    what = conditions.equations, conditions.start, units, options.max_iterations
    root = newton(*what)
    share = _shares(conditions, units, root, options.tolerance)
    if np.all(share <= 1.0):
        return root, share
    other = newton(*what, first=(0, 1))
    others = _shares(conditions, units, other, options.tolerance)
    return (other, others) if np.max(others) < np.max(share) else (root, share)


def _nearest(conditions: SteadyConditions, units: Units, most: int) -> Root | None:
    """Return the root where short steps end that reduce forces, None where no angle is free or they do not arrive."""
    longest = conditions.short_steps()
    if not np.any(np.isfinite(longest)):
        return None
    near = newton(partial(conditions.equations, forces=True), conditions.start, units, most, longest=longest)
    if near.iterations == most:
        return None
    root = newton(conditions.equations, near.unknowns, units, most - near.iterations, longest=longest)
    return replace(root, iterations=near.iterations + root.iterations)


def _shares(conditions: SteadyConditions, units: Units, root: Root, tolerance: float) -> FloatArray:
    """Return residuals (m,) as shares of those allowed by the tolerance and by rounding of free values."""
    if not np.all(np.isfinite(root.residual)):
        return np.full(len(root.residual), np.inf)
    terms = units.floored(conditions.terms(root.unknowns))
    limits = tolerance * terms + _ROUNDING * root.scale + _SPREAD * conditions.rounding(root.unknowns)
    return np.abs(root.residual) / limits


def _free_names(model: CompiledModel, given: Iterable[Any] | None) -> list[str]:
    """Return the names of the free values."""
    layout = model.layout
    if given is None:
        return [*layout.coordinates, *layout.states]
    known = (*layout.variables, *layout.given, *layout.inputs)
    free = list(dict.fromkeys(run_input.resolve_names("free value", given, known, layout.aliases)))
    if not free:
        raise OptionError(
            "free names nothing that may change: name coordinates, rates, states, parameters or inputs, or leave it"
            f" out for all coordinates and states. Known: {list_names(known)}"
        )
    return free


def _regular(
    model: CompiledModel,
    t: float,
    values: dict[str, float],
    p: FloatArray,
    free: Sequence[str],
    follow: Sequence[str],
) -> tuple[CompiledModel, dict[str, float]]:
    """Return the model without constraints that follow from others, and the guess moved onto the constraints."""
    layout, program = model.layout, model.stages.program
    lacking = [name for name in layout.states if name not in values]
    if lacking:
        raise InitialStateError(
            f"values are missing for the first-order states {list_names(lacking)}: give them in the guess, roughly"
            " where they are free"
        )
    c = run_input.constants(program, p)
    try:
        values = values | assembled(program, c, t, values, [name for name in values if name not in free])
    except InitialStateError:
        if any(name not in values for name in layout.coordinates):
            raise
    q = np.array([values[name] for name in layout.coordinates])
    x = np.concatenate([q, [values.get(name, 0.0) for name in (*layout.rates, *layout.states)]])
    if follow:
        _refuse_undetermined(model, t, x, c, follow)
    enforced = model.derived.enforced
    if not enforced:
        return model, values
    y = interpret_rows(program.kernel("initial"), np.array([t]), x[np.newaxis], c)[0]
    found = StartRows(program, t, y, c, enforced).redundant()
    if found is None:
        raise InitialStateError(
            "the constraints lose rank at the guess alone, where accelerations are not determined: start from another"
            " configuration"
        )
    return (model.variants.without_constraints(found) if found else model), values


def _refuse_undetermined(model: CompiledModel, t: float, x: FloatArray, c: FloatArray, missing: Sequence[str]) -> None:
    """Reject rates that were left out and that the constraints do not fix."""
    layout = model.layout
    columns = [layout.rates.index(name) for name in missing]
    program, count = model.stages.program, len(layout.constraints)
    rows = model.derived.partials.value("constraint_jacobian", t, x, c).reshape(count, len(layout.rates))
    if count:
        lengths = row_lengths(program, np.array([t]), x[np.newaxis], c, range(count))[0]
        rows = rows * distance_sizes(program, t, x, c) / lengths[:, np.newaxis]
    if not count or np.linalg.matrix_rank(rows[:, columns], tol=_RANK) < len(missing):
        raise InitialStateError(
            f"values are missing for the rates {list_names(missing)}: the constraints do not fix all of them, and"
            " nothing defaults to zero. Give them in the guess, 0 for an equilibrium"
        )


def _conditions(
    model: CompiledModel,
    options: TrimOptions,
    values: Mapping[str, float],
    p: FloatArray,
    free: Sequence[str],
    follow: tuple[str, ...],
) -> tuple[SteadyConditions, TrimChoice]:
    layout = model.layout
    names = layout.variables
    given = given_places(layout)
    nonholonomic = len(layout.constraints) > layout.holonomic
    if options.steady is None:
        steady = [name for name in layout.rates if not (nonholonomic and name in follow)] + [*layout.states]
    else:
        steady = run_input.resolve_names("steady value", options.steady, names, layout.aliases)
        if not steady:
            raise OptionError(
                "steady names nothing that must not change in time: name coordinates, rates and states, or leave it out"
                f" for all rates and states. Known: {list_names(names)}"
            )
    changing = {*free, *follow}
    conditions = SteadyConditions(
        program=model.stages.program,
        partials=model.derived.partials,
        t=options.t,
        x=np.array([values.get(name, 0.0) for name in names]),
        p=p,
        free_x=tuple(i for i, name in enumerate(names) if name in changing),
        free_p=tuple(i for name, i in given.items() if name in changing),
        steady=tuple(i for i, name in enumerate(names) if name in steady),
    )
    return conditions, TrimChoice(tuple(free), follow, options.steady is None)
