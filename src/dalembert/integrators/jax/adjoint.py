"""Cotangents of a run of one case pulled back along its stages, one after the other.

XLA on CPU turns a loop whose iterations touch less than a kilobyte into one machine function, which takes fractions
of a microsecond a stage, where starting every operation of many stages taken together takes a microsecond each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, final

import jax.numpy as jnp
import numpy as np
from jax import lax

from ...methods.tableau import Tableau
from .derivatives import Record

__all__ = ["InTurn", "Pull"]

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
@dataclass(frozen=True)
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

    def __call__(self, record: Record, c: Any, given: tuple[Any, ...], end: Any) -> tuple[Any, Any]:
        """Return the cotangents of the first state (n_y,) and of the constants (n_c,).

        Parameters
        ----------
        record, c
            The run, and its constants (n_c,).
        given
            Nothing, or the cotangents (room, n_y) of the states at the starts of attempts.
        end
            Cotangent of the last state (n_y,).
        """
        pull, chunks = self.pulling(), -(-record.count // _CHUNK)

        def chunk(number: Any, carry: Any) -> Any:
            ahead, memory = carry
            first = (chunks - 1 - number) * _CHUNK
            count = jnp.minimum(record.count - first, _CHUNK)
            return self._back(record, first, count, given, ahead, memory, self._points(record, first, count, c))

        ahead, memory = lax.fori_loop(0, chunks, chunk, (end, pull.begin(c)))
        return ahead, pull.sums(memory)

    def _points(self, record: Record, first: Any, count: Any, c: Any) -> Any:
        """Return the states (attempts * stages, n_y) at which the stages of attempts evaluate the rates."""
        stages, n = self.tableau.end, len(record.end)
        matrix, nodes = jnp.asarray(self.tableau.A[:stages, :stages]), jnp.asarray(self.tableau.c[:stages])

        def one(number: Any, carry: Any) -> Any:
            slopes, points = carry
            attempt, stage = first + number // stages, number % stages
            t, h, y = _attempt(record, attempt)
            # Slopes of later stages are those of the attempt before; their weights are zero.
            point = y + h * (matrix[stage] @ slopes)
            rates = self.rates(t + nodes[stage] * h, point, c)
            slopes = lax.dynamic_update_index_in_dim(slopes, rates, stage, 0)
            return slopes, lax.dynamic_update_index_in_dim(points, point, number, 0)

        kept = jnp.zeros((stages, n)), jnp.zeros((_CHUNK * stages, n))
        points: Any = lax.fori_loop(0, count * stages, one, kept)[1]
        return points

    def _back(
        self, record: Record, first: Any, count: Any, given: Any, ahead: Any, memory: Any, points: Any
    ) -> tuple[Any, Any]:
        """Return the cotangent of the state where a chunk of attempts starts, and the memory."""
        pull, stages = self.pulling(), self.tableau.end
        weights, nodes = jnp.asarray(self.tableau.b[:stages]), jnp.asarray(self.tableau.c[:stages])
        matrix = jnp.asarray(np.ascontiguousarray(self.tableau.A[:stages, :stages].T))

        def one(number: Any, carry: Any) -> Any:
            end, start, within, memory = carry
            number = count * stages - 1 - number
            attempt, stage = first + number // stages, number % stages
            t, h, _ = _attempt(record, attempt)
            # What earlier stages had in the attempt before has no weight.
            rates = h * (weights[stage] * end + matrix[stage] @ within)
            memory, back = pull(memory, t + nodes[stage] * h, points[number], rates)
            start = start + back
            within = lax.dynamic_update_index_in_dim(within, back, stage, 0)
            done = stage == 0
            if given:
                start = jnp.where(done, start + given[0][attempt], start)
            return jnp.where(done, start, end), start, within, memory

        ahead, _, _, memory = lax.fori_loop(
            0, count * stages, one, (ahead, ahead, jnp.zeros((stages, len(ahead))), memory)
        )
        return ahead, memory


def _attempt(record: Record, number: Any) -> tuple[Any, Any, Any]:
    """Return start, size and state of an attempt; where nothing moved, a state that the run ended with."""
    row = record.taken[number]
    return row[0], row[1], jnp.where(row[1] != 0.0, row[2:], record.end)
