"""Functions of many rows that do not wait for each other, taken in chunks: their changes, pulled back too.

A function g(fixed, rows, shared) gives rows, and sums over the rows of a chunk. `fixed` are rows that are not
differentiated, `shared` what all rows have in common.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp
from jax import lax

from .linear_maps import LinearMap, apply
from .mesh_axes import varying_like

RowFunction = Callable[[Any, Any, Any], tuple[Any, Any]]


@final
class Given(NamedTuple):
    """Arguments of a function of rows; `chunks` is how many chunks there are, a floating point number."""

    chunks: Any
    fixed: Any
    rows: Any
    shared: Any


def _moved(function: RowFunction, fixed: Any, rows: Any, shared: Any, moving: Any) -> Any:
    return jax.jvp(lambda *values: function(fixed, *values), (rows, shared), moving)[1]


def _back(function: RowFunction, fixed: Any, rows: Any, shared: Any, given: Any) -> Any:
    return jax.vjp(lambda *values: function(fixed, *values), rows, shared)[1](given)


@final
@dataclass(frozen=True)
class _Moved:
    """The change of a function of rows, as a function of rows."""

    function: RowFunction

    def __call__(self, fixed: Any, rows: Any, shared: Any) -> Any:
        (rows, drows), (shared, dshared) = rows, shared
        return _moved(self.function, fixed, rows, shared, (drows, dshared))


@final
@dataclass(frozen=True)
class _Back:
    """The cotangents of a function of rows, as a function of rows; those of what is shared are sums."""

    function: RowFunction

    def __call__(self, fixed: Any, rows: Any, shared: Any) -> Any:
        (rows, given), (shared, sums) = rows, shared
        return _back(self.function, fixed, rows, shared, (given, sums))


def _in_chunks(size: int, given: Given, moving: Any, one: Callable[..., Any]) -> Any:
    """Return rows and sums of ``one(fixed, rows, shared, (rows of moving, what it shares))`` over all chunks."""

    def sliced(tree: Any, first: Any) -> Any:
        return jax.tree.map(lambda rows: lax.dynamic_slice_in_dim(rows, first, size), tree)

    def at(first: Any) -> Any:
        fixed, rows, drows = (sliced(tree, first) for tree in (given.fixed, given.rows, moving[0]))
        return one(fixed, rows, given.shared, (drows, moving[1]))

    def chunk(number: Any, carry: Any) -> Any:
        rows, sums = carry
        new, added = at(number * size)
        rows = jax.tree.map(lambda a, b: lax.dynamic_update_slice_in_dim(a, b, number * size, 0), rows, new)
        return rows, jax.tree.map(jnp.add, sums, added)

    some, sums = jax.eval_shape(at, 0)
    room = jax.tree.leaves(given.fixed)[0].shape[0]
    begin = (
        jax.tree.map(lambda row: jnp.zeros((room, *row.shape[1:])), some),
        jax.tree.map(lambda value: jnp.zeros(value.shape), sums),
    )
    return lax.fori_loop(0, given.chunks.astype(int), chunk, varying_like(begin, (given, moving)))


def _changed(function: RowFunction, size: int, held: Given, dheld: Given, moving: Any) -> Any:
    """Return the change of a value at `held` and `moving` with `held`, where the value is a function of both."""
    both = Given(held.chunks, held.fixed, (held.rows, moving[0]), (held.shared, moving[1]))
    still = jax.tree.map(jnp.zeros_like, moving)
    return apply(PushedRows(function, size), both, ((dheld.rows, still[0]), (dheld.shared, still[1])))


@final
@dataclass(frozen=True)
class PushedRows:
    """The change of a function of rows with `moving` = (rows, shared), in chunks of `size` rows; `held` is `Given`."""

    function: RowFunction
    size: int

    def __call__(self, held: Given, moving: Any) -> Any:
        """Return the changes of rows and sums."""
        return _in_chunks(self.size, held, moving, lambda *values: _moved(self.function, *values))

    @property
    def transposed(self) -> LinearMap:
        """See `LinearMap`."""
        return _PulledRows(self.function, self.size)

    def change(self, held: Given, dheld: Given, moving: Any, still: Any) -> Any:
        """See `LinearMap`."""
        return _changed(_Moved(self.function), self.size, held, dheld, moving)


@final
@dataclass(frozen=True)
class _PulledRows:
    """The transpose of `PushedRows`: from cotangents of rows and sums to those of rows and of what is shared."""

    function: RowFunction
    size: int

    def __call__(self, held: Given, moving: Any) -> Any:
        return _in_chunks(self.size, held, moving, lambda *values: _back(self.function, *values))

    @property
    def transposed(self) -> LinearMap:
        return PushedRows(self.function, self.size)

    def change(self, held: Given, dheld: Given, moving: Any, still: Any) -> Any:
        return _changed(_Back(self.function), self.size, held, dheld, moving)
