"""Constants along traced runs: times at which conditions on time change, what is decided there, and inputs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import FloatArray
from ..ir.conditions import Conditions
from ..ir.program import Program, coefficient_places
from ..methods.status import Status
from ..stops.breakpoints import break_times_of_cases
from ..stops.feedback import Feedback
from ..stops.samples import Samples
from .arguments import COLUMNS, knots_of, out_of_reach, polynomials, with_knots
from .feedback import FeedbackKernels, weights_of
from .host_calls import on_host
from .pieces import place_of
from .run_inputs import Given, feedback_kernels
from .runs.run_constants import ArrayKernels, RunConstants, TracedInputs
from .runs.run_data import middles

if TYPE_CHECKING:
    from ..scene.symbol_table import InputSymbol


def traced_breaks(conditions: Conditions, p: Any, t: Any, most: int) -> tuple[Any, Any]:
    """Return the breaks (most,) of a run along times t (n_t,) of parameters p (n_p,), and which move with parameters.

    Breaks are times since t[0] in the order of the run, infinite behind the last. More than a run may take steps are
    left out, as it ends before. Derivatives do not pass.
    """
    times, moved = on_host(partial(_breaks, conditions, most), ((most,), (most,)), p, t[0], t[-1])
    return times, moved


def _breaks(
    conditions: Conditions, most: int, rows: FloatArray, begin: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return breaks (k, most) of runs with parameters (k, n_p) from `begin` to `end` (k,), and 1 where they move."""
    times = np.repeat(np.where(end >= begin, np.inf, -np.inf)[:, np.newaxis], most, axis=1)
    moved = np.zeros_like(times)
    starts, found = break_times_of_cases(conditions, rows, begin, end)
    moving = _moving(conditions)
    others = break_times_of_cases(moving, rows, begin, end) if moving.functions else (0 * starts, found[:0])
    for i in range(len(rows)):
        own, some = (values[first[i] : first[i + 1]] for first, values in ((starts, found), others))
        own = own[:most]
        times[i, : len(own)] = own - begin[i]
        moved[i, : len(own)] = np.isclose(own[:, np.newaxis], some, rtol=1e-14, atol=0.0).any(axis=1)
    return times, moved


def _moving(conditions: Conditions) -> Conditions:
    """Return the conditions whose changes depend on parameters, and those within which they are nested."""
    own = [
        any(load.array == "p" and load.index != conditions.place for load in function.loads)
        for function in conditions.functions
    ]
    around = [moves and nested for moves, nested in zip(own, conditions.nested, strict=True)]
    kept = [i for i, moves in enumerate(own) if moves or any(around[i:])]
    return replace(
        conditions,
        functions=tuple(conditions.functions[i] for i in kept),
        kinds=tuple(conditions.kinds[i] for i in kept),
        nested=tuple(conditions.nested[i] for i in kept),
        sharpness=tuple(conditions.sharpness[i] for i in kept),
    )


@final
class Course(NamedTuple):
    """Constants along a run: at the times (n_c,) or (n_t, n_c), at the first, in steps; breaks, and which move.

    With inputs that are functions, also what the constants in steps are, what is wrong with the inputs, and those that
    are functions of the state.
    """

    rows: Any
    first: Any
    run: Any
    breaks: Any
    moved: Any
    constants: RunConstants | None = None
    wrong: Any = None
    feedback: FeedbackKernels | None = None


@final
class Courses:
    """Constants along the runs of one program.

    Parameters
    ----------
    program : Program
    kernels : Kernels
        Its kernels.
    inputs : tuple of InputSymbol
        Inputs of the scene.
    max_steps : int
        The most breaks of a run.
    in_elapsed : bool
        Whether steps count time from the start of the run, which then follows the constants.
    """

    def __init__(
        self,
        program: Program,
        kernels: ArrayKernels,
        inputs: tuple[InputSymbol, ...],
        max_steps: int,
        *,
        in_elapsed: bool,
    ) -> None:
        self._program, self._kernels, self._inputs = program, kernels, inputs
        self._max_steps, self._in_elapsed = max_steps, in_elapsed

    def of(self, t: Any, p: Any) -> Course:
        """Return the constants along a run without inputs."""
        conditions, constants = self._program.conditions, self._kernels.constants
        if conditions is None:
            c = constants(p)
            return Course(c, c, jnp.append(c, t[0]) if self._in_elapsed else c, (), ())
        start = jax.lax.stop_gradient(t[0])
        breaks, moved = traced_breaks(conditions, p, t, self._max_steps)
        rows = self.decided(p, start + middles(jax.lax.stop_gradient(t) - start, breaks))
        return Course(rows, rows[0], jnp.append(p, start), breaks, moved)

    def with_inputs(self, t: Any, p: Any, given: Given) -> Course:
        """Return the constants along a run with inputs that are functions of time.

        They are those of the kernels, the knots and polynomials of each record, and the weights of functions; NaN where
        records do not cover the run.
        """
        start, before, layout = jax.lax.stop_gradient(t[0]), self.of(t, p), self._program.layout
        base = jnp.append(self._kernels.constants(p) if self._program.conditions is None else p, start)
        known = {symbol.name: symbol for symbol in self._inputs}
        records = {name: value for name, value in given.items() if isinstance(value, Samples)}
        functions = [value for value in given.values() if isinstance(value, Feedback)]
        rows, (breaks, moved) = before.rows, (before.breaks, before.moved)
        if records and rows.ndim == 1:
            rows = jnp.broadcast_to(rows, (len(t), len(rows)))
        tables: list[TracedInputs] = []
        parts, order, beyond = [base], jnp.asarray(False), jnp.asarray(False)
        for name, where in zip(records, coefficient_places(layout.parameters, tuple(records)), strict=True):
            record, (begin, stop) = records[name], COLUMNS[records[name].kind]
            knots = knots_of(known[name], record)
            found = polynomials(knots, record)
            first = tables[-1].end if tables else len(base)
            table = TracedInputs(first, len(record.t), stop - begin, where + begin)
            rows = rows.at[:, table.place : table.place + table.width].set(found[_ahead(table, knots, t)])
            tables.append(table)
            parts += [jax.lax.stop_gradient(knots - t[0]), found.ravel()]
            lost, short = out_of_reach(known[name], record, t)
            order, beyond = order | lost, beyond | short
        if records:
            breaks, moved = with_knots(tuple(records.values()), t, breaks, moved)
        weights = [weights_of(value) for value in functions]
        wrong = jnp.where(beyond, int(Status.OUTSIDE_TABLE), int(Status.SUCCESS))
        wrong = jnp.where(order, int(Status.TIMES_IN_NO_ORDER), wrong)
        run = jnp.where(wrong == int(Status.SUCCESS), jnp.concatenate(parts + weights), jnp.nan)
        place, many = place_of(self._program), sum(map(len, weights))
        constants = RunConstants(place, len(base), tuple(tables), many, bool(functions))
        feedback = feedback_kernels(self._program, given, constants.count - 1)
        return Course(rows, rows if rows.ndim == 1 else rows[0], run, breaks, moved, constants, wrong, feedback)

    def decided(self, p: Any, t: Any) -> Any:
        """Return the constants (n_t, n_c) with conditions decided at times t (n_t,)."""
        assert self._program.conditions is not None
        place = self._program.conditions.place
        return jax.vmap(lambda time: self._kernels.constants(p.at[place].set(time)))(t)


def _ahead(table: TracedInputs, knots: Any, t: Any) -> Any:
    """Return the numbers of the polynomials at the times t (n_t,) of a run: at a knot, that ahead."""
    before = jnp.searchsorted(*jax.lax.stop_gradient((knots, t)), side="left")
    at_end = (t == t[-1]) & (t[0] != t[-1])  # where nothing is ahead any more
    return jnp.where((t[-1] >= t[0]) != at_end, table.piece(knots, t), before)
