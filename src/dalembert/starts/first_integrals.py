"""First integrals of a motion: which of the candidates are conserved, their values, and those that a run keeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError, OptionError, UnknownNameError, list_names, unknown_name
from ..events.event_code import event_list
from ..ir.interpret import Rows, interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import WIDTH, Program, coefficient_places
from ..mechanics.equations import EquationsOfMotion
from ..reduction.integrals import why_not
from ..reduction.invariant_projection import TIME_SCALE, initial_name
from ..reduction.invariants import InvariantCandidates
from ..values import listed
from . import inputs
from .assembly import assembled
from .initial_states import initial_state
from .segment_constants import starting_constants
from .state_sizes import coordinate_sizes

if TYPE_CHECKING:
    from ..model.model import CompiledModel


_TRIALS = 8
_CASE_TRIALS = 4
_DRAWS = 64
"""Values of the free arguments in each trial."""
_SPREAD = 0.2
_STILL = 1e-9
"""Rate of change, over the sum of its terms' sizes, that rounding explains."""


def conserved(
    program: Program, found: InvariantCandidates, c: FloatArray, t: FloatArray, x: FloatArray
) -> dict[str, FloatArray]:
    """Return the first integrals along a motion t (n_t,) as arrays (n_t,) by name.

    The rows of x (n_t, 2 n_q + n_z) are coordinates, rates and first-order states. A candidate that is not certain
    counts as conserved when its rate vanishes in random states around the motion that satisfy the constraints, at times
    of the motion and others, with random inputs and in all branches of the equations; the random numbers are the same
    in every run.
    """
    kept, _ = _kept(program, found, c, t, x)
    values = interpret_rows(found.values, t, x, c)
    return {name: values[:, i] for i, name in enumerate(found.names) if kept[i]}


def _kept(
    program: Program, found: InvariantCandidates, c: FloatArray, t: FloatArray, x: FloatArray
) -> tuple[np.ndarray[tuple[int], np.dtype[np.bool_]], bool]:
    """Return which candidates are conserved, see `conserved`, and whether that was seen in all trials."""
    certain = np.array(found.certain)
    if np.all(certain) or not len(t):
        return certain, True
    still, trials = _still(program, found, c, t, x)
    return certain | still, trials == _TRIALS


def changing(
    program: Program, found: InvariantCandidates, c: FloatArray, t: FloatArray, y: FloatArray, rows: Rows
) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Return which candidates change (k, n) in which cases, from starts at t (k,) in y (k, n_y) with c (k, n_c).

    Each case is evaluated at random speeds, with free arguments on both sides of their centres; the numbers are the
    same for all cases. Cases that are not finite do not count.
    """
    random, count = np.random.default_rng(2), len(found.names)
    moves = np.zeros((len(t), count), bool)
    speeds = np.array([name not in program.layout.coordinates for name in program.layout.state])
    size = 1.0 + np.max(np.abs(y), axis=1, initial=0.0, keepdims=True)
    centres = np.array([where.centre for where in found.free])
    free = np.empty(0)
    for trial in range(_CASE_TRIALS):
        state = y + np.where(speeds, random.standard_normal(len(speeds)), 0.0) * size
        if "project_velocity" in program:
            for _ in range(2):
                state = state + rows(program.kernel("project_velocity"), t, state, c)
        x = rows(program.kernel("expand"), t, state, c)
        second = rows(program.kernel("accelerations"), t, x, c)
        drawn = [where.draw(random, 1)[0] for where in found.free]
        free = 2.0 * centres - free if trial % 2 else np.array(drawn)
        for kernel, further in (found.changes, second), (found.branches, np.tile(free, (len(t), 1))):
            out = rows(kernel, t, np.hstack([x, further]), c)
            moves |= np.abs(out[:, :count]) > _STILL * out[:, count:]
    return moves & ~np.array(found.certain)


def _still(
    program: Program, found: InvariantCandidates, c: FloatArray, t: FloatArray, x: FloatArray
) -> tuple[np.ndarray[tuple[int], np.dtype[np.bool_]], int]:
    """Return which candidates do not change in any of the random states, and how many states there were."""
    layout, random = program.layout, np.random.default_rng(1)
    count, size = len(found.names), len(layout.coordinates)
    still, trials = np.ones(count, bool), 0
    for trial, place in enumerate(np.linspace(0, len(t) - 1, _TRIALS).astype(int)):
        now = t[place : place + 1] + trial % 2 * random.standard_normal()
        own = (c if c.ndim == 1 else c[place]).copy()
        sizes = coordinate_sizes(program, t[place : place + 1], x[place : place + 1], own)[0]
        speed = _speed(program, t[place : place + 1], x[place : place + 1], own, sizes)
        start = np.concatenate([x[place, :size], np.zeros(size), x[place, 2 * size :]])
        spread = np.concatenate([_SPREAD * sizes, speed * sizes])
        start[: 2 * size] += spread * random.standard_normal(2 * size)
        start[2 * size :] += random.standard_normal(len(layout.states))
        guess = dict(zip(layout.variables, start.tolist(), strict=True))
        for first in coefficient_places(layout.parameters, layout.inputs):  # conserved whatever the inputs are
            own[first + 1 : first + WIDTH] += random.standard_normal(WIDTH - 1)
        try:
            state = assembled(program, own, float(now[0]), guess, ())
        except (InitialStateError, np.linalg.LinAlgError):
            continue
        y = np.array([[state[name] for name in layout.variables]])
        draws = _DRAWS if found.free else 1
        drawn = [where.draw(random, draws) for where in found.free]
        rows = np.hstack([np.repeat(y, draws, 0), *(values[:, np.newaxis] for values in drawn)])
        with np.errstate(all="ignore"):
            second = interpret_rows(program.kernel("accelerations"), now, y, own)
            out = interpret_rows(found.changes, now, np.hstack([y, second]), own)
            branches = interpret_rows(found.branches, np.repeat(now, draws), rows, own)
        if np.all(np.isfinite(out)):
            for values in (out, branches[np.all(np.isfinite(branches), axis=1)]):
                still &= np.all(np.abs(values[:, :count]) <= _STILL * values[:, count:], axis=0)
            trials += 1
    return still & (trials > 0), trials


def _speed(program: Program, t: FloatArray, x: FloatArray, c: FloatArray, sizes: FloatArray) -> float:
    """Return a speed of the motion at a state x (1, 2 n_q + n_z), in sizes of coordinates in a unit of time.

    The largest of its rates, and of what accelerations make of rest over the sizes; one where nothing moves.
    """
    n = len(sizes)
    with np.errstate(all="ignore"):
        second = np.abs(interpret_rows(program.kernel("accelerations"), t, x, c)[0]) / sizes
    fastest = np.max(np.abs(x[0, n : 2 * n]) / sizes, initial=0.0)
    speed = float(np.fmax(fastest, np.sqrt(np.max(second[np.isfinite(second)], initial=0.0))))
    return speed if speed > 0.0 else 1.0


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
    """Return the model that keeps first integrals, and their names, for a start at t0 in y (n_y,) with c (n_c,).

    What is conserved is so in all states: it is found out once for constants. `requested` and errors as for
    `kept_names`.
    """
    stages, found = model.stages, model.derived.invariants
    refuse_unknown(requested, found)
    known = model.derived.conserved
    able = known.get(key := c.tobytes())
    if able is None:
        times = np.array([t0])
        x = interpret_rows(stages.program.kernel("expand"), times, y[np.newaxis], c)
        kept, tried = _kept(stages.program, found, c, times, x)
        able = tuple(name for name, each in zip(found.names, kept, strict=True) if each)
        if tried:
            known[key] = able
    names = kept_names(requested, stages.equations, found, able)
    return model.variants.keeping_invariants(names), names


def kept_names(
    requested: Any, equations: EquationsOfMotion, found: InvariantCandidates, able: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the names of the first integrals to keep: all that are conserved, or the requested ones.

    `requested` is True, a name, or an iterable of names; `able` are those that are conserved.

    Raises
    ------
    OptionError
        For what is not conserved, with the reason, and where nothing is; and where no name is given.
    """
    if requested is True:
        if not able:
            raise OptionError(
                f"project_invariants: nothing is known to be conserved in {equations.name!r}. The energy is not:"
                f" {why_not(equations, 'energy')}"
            )
        return able
    names = _listed(requested)
    if not names:
        raise OptionError(
            "project_invariants: no first integral is named. Give names, True for all that are conserved, or False."
            f" Conserved in {equations.name!r}: {list_names(able) or 'nothing that is known'}"
        )
    lost = [f"{name!r} is not conserved: {why_not(equations, name)}" for name in names if name not in able]
    if lost:
        raise OptionError(
            f"project_invariants: {'; '.join(lost)}. Conserved in {equations.name!r}:"
            f" {list_names(able) or 'nothing that is known'}"
        )
    return tuple(name for name in found.names if name in names)


def _listed(requested: Any) -> list[str]:
    given = listed("project_invariants", requested, "names") if isinstance(requested, Iterable) else [requested]
    return [str(name) for name in given if name is not None]


def refuse_unknown(requested: Any, found: InvariantCandidates) -> None:
    """Reject names of first integrals that a scene cannot have.

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
    """Reject events that jump: first integrals change there.

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
