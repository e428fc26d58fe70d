"""Linear maps with transposes of their own in JAX: differentiated, transposed and vectorised; also row by row.

JAX has one public operation that takes its transpose from the user and has derivatives and batches of both:
``jax.lax.custom_linear_solve``. The value of a map L is therefore the solution of a linear system in (a, b, c, d),
where a and c are like what the map is applied to, b and d like its values. From what is given to the solution:

    (a, b, -, -) -> (0, 0, a, L a + b),    transposed    (-, -, c, d) -> (c + L' d, d, 0, 0)

The derivative of a solution follows from that of the system by what L hangs on (`_system`): forward b changes by dL c,
and transposed c by dL' b. Each direction ignores what is added for the other.

A function g(fixed, rows, shared) gives rows, and sums over the rows of a chunk. `fixed` are rows that are not
differentiated, `shared` what all rows have in common.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol, final

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero

from ...frozen import frozen
from .derivatives import instantiate
from .mesh_axes import varying_alike, varying_like


class LinearMap(Protocol):
    """A linear map of `moving`, which hangs on `held`; both are trees of arrays of floating point numbers.

    Instances hold no arrays of JAX, and are hashable.
    """

    def __call__(self, held: Any, moving: Any) -> Any:
        """Return the value, a tree of arrays."""

    def back(self, held: Any, given: Any) -> Any:
        """Return the value of the transpose: from cotangents of the value to those of `moving`."""

    def change(self, held: Any, dheld: Any, moving: Any, still: Any) -> Any:
        """Return the change of the value with that of `held`, by operations that are linear in `dheld`.

        `still` is a tree like `held` of whether each array is known not to change.
        """

    def change_back(self, held: Any, dheld: Any, given: Any, still: Any) -> Any:
        """Return the change of the value of the transpose, as `change` does."""

    @property
    def transposed(self) -> LinearMap:
        """The transpose, a linear map."""
        return _Transposed(self)


@final
@frozen
class _Transposed(LinearMap):
    """The transpose of a map."""

    of: LinearMap

    def __call__(self, held: Any, moving: Any) -> Any:
        return self.of.back(held, moving)

    def back(self, held: Any, given: Any) -> Any:
        return self.of(held, given)

    def change(self, held: Any, dheld: Any, moving: Any, still: Any) -> Any:
        return self.of.change_back(held, dheld, moving, still)

    def change_back(self, held: Any, dheld: Any, given: Any, still: Any) -> Any:
        return self.of.change(held, dheld, given, still)

    @property
    def transposed(self) -> LinearMap:
        return self.of


def apply(function: LinearMap, held: Any, moving: Any) -> Any:
    """Return the value of a linear map."""
    held, moving = varying_alike((held, moving))
    zero = _zero((jax.lax.stop_gradient(held), moving))  # cases differ where any of these does
    nothing = _zeros(jax.eval_shape(partial(_value, function), held, moving), zero)
    start = jax.tree.map(lambda leaf: leaf + zero, moving)

    def forward(_: Any, given: Any) -> Any:
        value = _value(function, held, given[0])
        return *_still(given[:2]), given[0], jax.tree.map(jnp.add, value, given[1])

    def backward(_: Any, given: Any) -> Any:
        value = _value(function.transposed, held, given[3])
        return jax.tree.map(jnp.add, value, given[2]), given[3], *_still(given[2:])

    given = (start, nothing, _zeros(moving, zero), nothing)
    system = partial(_system, function, held)
    return jax.lax.custom_linear_solve(system, given, forward, backward, symmetric=True)[3]


@partial(jax.jit, static_argnums=0)
def _value(function: LinearMap, held: Any, moving: Any) -> Any:
    """Return the value, which varies over the mesh axes that its arguments vary over; traced once for equal maps."""
    return varying_like(function(held, moving), (held, moving))


def _still(tree: Any) -> Any:
    """Return zeros like arrays."""
    return varying_like(jax.tree.map(jnp.zeros_like, tree), tree)


def _zero(tree: Any) -> Any:
    """Return zero () as a sum over parts of arrays: linear in them, as all must be that is solved for."""
    return sum(jnp.sum(leaf[jnp.newaxis][:0]) for leaf in jax.tree.leaves(tree))


def _zeros(tree: Any, zero: Any) -> Any:
    return jax.tree.map(lambda leaf: jnp.broadcast_to(zero, leaf.shape), tree)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _system(function: LinearMap, held: Any, x: Any) -> Any:
    """Return the left-hand side of the system, of which JAX reads its change with `held`, and which cases differ."""
    zero = _zero((held, x))  # each part of the change may differ where any of these does
    return jax.tree.map(lambda leaf: leaf + zero, x)


@partial(_system.defjvp, symbolic_zeros=True)
def _(function: LinearMap, values: Any, tangents: Any) -> tuple[Any, Any]:
    (held, x), dheld = values, tangents[0]
    still = jax.tree.map(lambda change: isinstance(change, SymbolicZero), dheld)
    changes = jax.tree.map(instantiate, dheld)
    zero = _zero([change for change in jax.tree.leaves(dheld) if not isinstance(change, SymbolicZero)])
    forward = function.change(held, changes, x[2], still)
    backward = function.transposed.change(held, changes, x[1], still)
    nothing = _zeros(x, zero)
    ahead, back = jax.tree.map(jnp.subtract, nothing[1:3], (forward, backward))
    return _system(function, held, x), (nothing[0], ahead, back, nothing[3])


RowFunction = Callable[[Any, Any, Any], tuple[Any, Any]]


@final
class Given(NamedTuple):
    """Arguments of a function of rows; `chunks` is how many chunks there are, a floating point number."""

    chunks: Any
    fixed: Any
    rows: Any
    shared: Any


@final
@frozen
class Moved:
    """The change of a function of rows, as a function of rows."""

    function: RowFunction

    def __call__(self, fixed: Any, rows: Any, shared: Any) -> Any:
        """Return the changes of rows and sums, from rows and what is shared, each with its change."""
        (rows, drows), (shared, dshared) = rows, shared
        return jax.jvp(partial(self.function, fixed), (rows, shared), (drows, dshared))[1]


@final
@frozen
class Back:
    """The cotangents of a function of rows, as a function of rows; those of what is shared are sums."""

    function: RowFunction

    def __call__(self, fixed: Any, rows: Any, shared: Any) -> Any:
        """Return the cotangents, from rows and what is shared, each with cotangents: those of rows, and of sums."""
        (rows, given), (shared, sums) = rows, shared
        return jax.vjp(partial(self.function, fixed), rows, shared)[1]((given, sums))


def _in_chunks(function: RowFunction, size: int, given: Given, moving: Any) -> Any:
    """Return rows and sums of ``function(fixed, (rows, those of moving), (shared, that of moving))`` of all chunks."""

    def sliced(tree: Any, first: Any) -> Any:
        return jax.tree.map(lambda rows: lax.dynamic_slice_in_dim(rows, first, size), tree)

    def at(first: Any) -> Any:
        fixed, rows, drows = (sliced(tree, first) for tree in (given.fixed, given.rows, moving[0]))
        return function(fixed, (rows, drows), (given.shared, moving[1]))

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


@final
@frozen
class PushedRows(LinearMap):
    """The change of a function of rows with `moving` = (rows, shared), in chunks of `size` rows; `held` is `Given`."""

    function: RowFunction
    size: int

    def __call__(self, held: Given, moving: Any) -> Any:
        """Return the changes of rows and sums."""
        return _in_chunks(Moved(self.function), self.size, held, moving)

    def back(self, held: Given, given: Any) -> Any:
        """See `LinearMap`."""
        return _in_chunks(Back(self.function), self.size, held, given)

    def change(self, held: Given, dheld: Given, moving: Any, still: Any) -> Any:
        """See `LinearMap`."""
        return changed(Moved(self.function), self.size, held, dheld, moving)

    def change_back(self, held: Given, dheld: Given, given: Any, still: Any) -> Any:
        """See `LinearMap`."""
        return changed(Back(self.function), self.size, held, dheld, given)


def changed(function: RowFunction, size: int, held: Given, dheld: Given, moving: Any) -> Any:
    """Return the change of a value at `held` and `moving` with `held`, where the value is a function of both."""
    both = Given(held.chunks, held.fixed, (held.rows, moving[0]), (held.shared, moving[1]))
    still = jax.tree.map(jnp.zeros_like, moving)
    return apply(PushedRows(function, size), both, ((dheld.rows, still[0]), (dheld.shared, still[1])))
