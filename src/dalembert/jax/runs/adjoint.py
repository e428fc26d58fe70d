"""Cotangents of a run of one case pulled back along its stages, one after the other.

XLA on CPU turns a loop whose iterations touch less than a kilobyte into one machine function, which takes fractions
of a microsecond a stage, where starting every operation of many stages taken together takes a microsecond each.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, final

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...frozen import frozen
from ...methods.tableau import Tableau
from .derivatives import Over, StepsRecord
from .mesh_axes import varying_like
from .precision import product

_CHUNK = 64
"""Attempts whose stages are kept together."""


class Pull(Protocol):
    """Cotangents of one evaluation of the right-hand side; those of the constants are summed in a memory."""

    def begin(self, c: Any) -> Any:
        """Return the memory before the first evaluation."""

    def __call__(self, memory: Any, t: Any, y: Any, rates: Any) -> tuple[Any, Any]:
        """Return the memory, and the cotangent (n_y,) of a state from that of its rates."""

    def sums(self, memory: Any) -> Any:
        """Return the cotangents (n_c,) of the constants."""


@final
@frozen
class _Rows:
    """Steps to go back over: the attempts of a run, and behind them those to requested times, where there are any."""

    record: StepsRecord
    given: tuple[Any, ...]
    end: Any
    over: Over | None = None
    cotangents: Any = None
    firsts: Any = None

    @property
    def count(self) -> Any:
        """Number of the steps."""
        return self.record.count if self.over is None else self.record.count + len(self.over.at)

    def attempt(self, number: Any) -> tuple[Any, Any, Any]:
        """Return start, size and state of a step; where nothing moved, a state that the run ended with."""
        if self.over is None:
            row = self.record.taken[number]
            return row[0], row[1], jnp.where(row[1] != 0.0, row[2:], self.record.end)
        k = number - self.record.count
        behind = k >= 0
        row = self.record.taken[jnp.where(behind, self.over.at[k], number)]
        t, h = jnp.where(behind, self.over.begins[k], row[0]), jnp.where(behind, self.over.sizes[k], row[1])
        return t, h, jnp.where(h != 0.0, row[2:], self.record.end)

    def entered(self, number: Any, enters: Any, end: Any, start: Any) -> tuple[Any, Any]:
        """Return the cotangents of the end and of the start of a step; where one `enters`, both are that of its end."""
        if self.over is None:
            return end, start
        k = number - self.record.count
        head = jnp.where(k >= 0, self.cotangents[k], jnp.where(k == -1, self.end, end))
        return jnp.where(enters, head, end), jnp.where(enters, head, start)

    def left(self, number: Any, leaves: Any, start: Any, kept: Any) -> tuple[Any, Any]:
        """Return the cotangent of the start of a step where one `leaves` it, and what is kept of steps to times.

        That is their cotangents (n_t, n_y), of an attempt all at the first time it passes over, and the last such time
        that no attempt has had.
        """
        if self.given:
            given = jnp.where(leaves & (number < self.record.count), self.given[0][number], 0.0)
            start = start + given
        if self.over is None:
            return start, kept
        starts, last = kept
        k = number - self.record.count
        behind = k >= 0
        own = leaves & ~behind & (last >= 0) & (self.over.at[last] == number)
        row = jnp.where(behind, self.firsts[k], last)
        before = starts[row]
        starts = starts.at[row].set(jnp.where(leaves & behind, before + start, before))
        last = jnp.where(own, jnp.where(last > 0, self.firsts[last - 1], -1), last)
        return jnp.where(own, start + before, start), (starts, last)

    @property
    def kept(self) -> Any:
        """The initial value of what is kept of steps to requested times."""
        return () if self.over is None else (jnp.zeros_like(self.cotangents), self.firsts[-1])


@final
@frozen
class InTurn:
    """The stages of the steps of a pair, one after the other.

    Attributes
    ----------
    tableau
        The pair.
    rates
        The right-hand side (t, y, c) -> rates of one case, on arrays.
    pulling
        What makes its cotangents, when a gradient is first asked for.
    """

    tableau: Tableau
    rates: Callable[[Any, Any, Any], Any]
    pulling: Callable[[], Pull]

    def ends(self, over: Over, states: Any, c: Any) -> Any:
        """Return the ends (n_t, n_y) of steps from states (n_t, n_y), by constants (n_c,)."""
        stages, weights = self.tableau.end, jnp.asarray(self.tableau.b[: self.tableau.end])

        def one(number: Any, carry: Any) -> Any:
            slopes, ends = carry
            step, stage = number // stages, number % stages
            h, y = over.sizes[step], states[step]
            slopes, _ = self._stage(slopes, stage, (over.begins[step], h, y), c)
            # Only after the last stage, which is the last to be written, are all slopes those of this step.
            return slopes, lax.dynamic_update_index_in_dim(ends, y + h * product(weights, slopes), step, 0)

        first = jnp.zeros((stages, states.shape[1])), jnp.zeros(states.shape)
        ends: Any = lax.fori_loop(0, len(states) * stages, one, varying_like(first, (over, states, c)))[1]
        return ends

    def __call__(
        self, record: StepsRecord, c: Any, given: tuple[Any, ...], end: Any, over: tuple[Any, ...] = ()
    ) -> tuple[Any, Any]:
        """Return the cotangents of the first state (n_y,) and of the constants (n_c,).

        Parameters
        ----------
        record, c
            The run, and its constants (n_c,).
        given
            Nothing, or the cotangents (room, n_y) of the states at the starts of attempts.
        end
            Cotangent of the last state (n_y,).
        over
            Nothing, or steps to requested times (see `Over`) and the cotangents (n_t, n_y) of their ends.
        """
        # The numbers of the first step to a time from the start of the same attempt come with the steps.
        rows = _Rows(record, given, end, *(*over, jnp.searchsorted(over[0].at, over[0].at)) if over else ())
        pull, chunks = self.pulling(), -(-rows.count // _CHUNK)
        begin = varying_like((end, pull.begin(c), rows.kept), (record, end, c))

        def chunk(number: Any, carry: Any) -> Any:
            first = (chunks - 1 - number) * _CHUNK
            count = jnp.minimum(rows.count - first, _CHUNK)
            return self._back(rows, (first, count, self._points(rows, first, count, c)), carry)

        ahead, memory, _ = lax.fori_loop(0, chunks, chunk, begin)
        return (jnp.where(record.count > 0, ahead, end) if over else ahead), pull.sums(memory)

    def _stage(self, slopes: Any, stage: Any, step: Any, c: Any) -> tuple[Any, Any]:
        """Return slopes (stages, n_y) with that of one stage of a step (t, h, y), and the state it is evaluated at.

        Slopes of later stages are those of the step before; their weights are zero.
        """
        t, h, y = step
        count = self.tableau.end
        matrix, nodes = jnp.asarray(self.tableau.A[:count, :count]), jnp.asarray(self.tableau.c[:count])
        point = y + h * product(matrix[stage], slopes)
        rates = self.rates(t + nodes[stage] * h, point, c)
        return lax.dynamic_update_index_in_dim(slopes, rates, stage, 0), point

    def _points(self, rows: _Rows, first: Any, count: Any, c: Any) -> Any:
        """Return the states (attempts * stages, n_y) at which the stages of attempts evaluate the rates."""
        stages, n = self.tableau.end, len(rows.record.end)

        def one(number: Any, carry: Any) -> Any:
            slopes, points = carry
            slopes, point = self._stage(slopes, number % stages, rows.attempt(first + number // stages), c)
            return slopes, lax.dynamic_update_index_in_dim(points, point, number, 0)

        kept = jnp.zeros((stages, n)), jnp.zeros((_CHUNK * stages, n))
        points: Any = lax.fori_loop(0, count * stages, one, varying_like(kept, (rows.record, c)))[1]
        return points

    def _back(self, rows: _Rows, chunk: tuple[Any, Any, Any], carry: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        """Return `carry` before a chunk of steps: the cotangent there, the memory, what is kept of steps to times."""
        (first, count, points), (ahead, memory, kept) = chunk, carry
        pull, stages = self.pulling(), self.tableau.end
        weights, nodes = jnp.asarray(self.tableau.b[:stages]), jnp.asarray(self.tableau.c[:stages])
        matrix = jnp.asarray(np.ascontiguousarray(self.tableau.A[:stages, :stages].T))

        def one(number: Any, carry: Any) -> Any:
            end, start, within, memory, kept = carry
            number = count * stages - 1 - number
            attempt, stage = first + number // stages, number % stages
            t, h, _ = rows.attempt(attempt)
            end, start = rows.entered(attempt, stage == stages - 1, end, start)
            # What earlier stages had in the attempt before has no weight.
            rates = h * (weights[stage] * end + product(matrix[stage], within))
            memory, back = pull(memory, t + nodes[stage] * h, points[number], rates)
            start = start + back
            within = lax.dynamic_update_index_in_dim(within, back, stage, 0)
            done = stage == 0
            start, kept = rows.left(attempt, done, start, kept)
            return jnp.where(done, start, end), start, within, memory, kept

        ahead, _, _, memory, kept = lax.fori_loop(
            0, count * stages, one, varying_like((ahead, ahead, jnp.zeros((stages, len(ahead))), memory, kept), carry)
        )
        return ahead, memory, kept
