"""Derivatives that are not known, made NaN: behind the end of a run, behind jumps, and of events without a rate."""

from __future__ import annotations

from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp

from ...frozen import frozen
from .linear_maps import LinearMap, apply


@final
class Known(NamedTuple):
    """Marks of the derivatives of states (n_t, n_y) that are known.

    Attributes
    ----------
    known : Array (n_t,)
        1 where they are, else 0.
    moved : Array (n_t,)
        1 where those by the constants `moved_by` are not.
    c : Array (n_c,)
        The constants.
    """

    known: Any
    moved: Any
    c: Any


@final
@frozen
class OrNan(LinearMap):
    """Changes of states (n_t, n_y) as they are, or NaN; they come with those of what they follow from.

    These are (of the times (n_t,), of the first state (n_y,), of the constants (n_c,)): what is pulled back to them is
    NaN where something was asked of states that are not known, however little they have to do with it.
    """

    moved_by: tuple[int, ...]

    def __call__(self, held: Known, moving: Any) -> Any:
        """See `LinearMap`."""
        rows, (_, _, dc) = moving
        known = held.known > 0.0
        if self.moved_by:
            known &= ~((held.moved > 0.0) & jnp.any(dc[jnp.array(self.moved_by)] != 0.0))
        return jnp.where(known[:, None], rows, jnp.nan)

    def back(self, held: Known, given: Any) -> Any:
        """See `LinearMap`."""
        known = held.known > 0.0
        asked = jnp.any(given != 0.0, axis=1)
        lost = jnp.where(jnp.any(~known & asked), jnp.nan, 0.0)
        share = jnp.full_like(held.c, lost)
        if self.moved_by:
            by = jnp.zeros(len(held.c), dtype=bool).at[jnp.array(self.moved_by)].set(True)
            share = jnp.where(by & jnp.any((held.moved > 0.0) & asked), jnp.nan, share)
        first = jnp.full(given.shape[1], lost)
        return jnp.where(known[:, None], given, 0.0), (jnp.full(len(known), lost), first, share)

    def change(self, held: Known, dheld: Known, moving: Any, still: Any) -> Any:
        """See `LinearMap`: zero, or NaN where the value is, and where the constants move what is not known."""
        none = jax.tree.map(jnp.zeros_like, moving)
        known = held.known * jnp.all(jnp.isfinite(self(held, moving)), axis=1)
        return apply(self, held._replace(known=known), (none[0], (*none[1][:2], dheld.c)))

    def change_back(self, held: Known, dheld: Known, given: Any, still: Any) -> Any:
        """Return zero, NaN where the value is NaN or a requested value depends on the constants."""
        changes = jax.tree.map(lambda found: jnp.where(jnp.isfinite(found), 0.0, jnp.nan), self.back(held, given))
        if not self.moved_by:
            return changes
        asked = held.moved * jnp.any(given != 0.0, axis=1)
        once = Known(jnp.ones(1), jnp.max(asked, initial=0.0)[None], held.c)
        none = jnp.zeros(1), jnp.zeros(1)
        lost = apply(OrNan(self.moved_by), once, (jnp.zeros((1, 1)), (*none, dheld.c)))[0, 0]
        return jax.tree.map(lambda found: found + lost, changes)


@final
@frozen
class Sloped(LinearMap):
    """Changes of numbers: those of others times slopes, which are NaN where they are not known.

    Backward, an unknown slope makes NaN only of what was asked for, so that other results keep their derivatives.
    """

    def __call__(self, held: Any, moving: Any) -> Any:
        """See `LinearMap`."""
        return held * moving

    def back(self, held: Any, given: Any) -> Any:
        """See `LinearMap`."""
        return jnp.where(given != 0.0, held * given, 0.0)

    def change(self, held: Any, dheld: Any, moving: Any, still: Any) -> Any:
        """See `LinearMap`."""
        return apply(self, jax.lax.stop_gradient(moving), dheld)

    def change_back(self, held: Any, dheld: Any, given: Any, still: Any) -> Any:
        """See `LinearMap`."""
        return apply(self.transposed, jax.lax.stop_gradient(given), dheld)


@jax.custom_jvp
def without_derivative(values: Any, but: Any, sources: Any) -> Any:
    """Return numbers that have the derivative NaN by all `sources`, zero where `but` is true."""
    return values


@without_derivative.defjvp
def _(values: Any, tangents: Any) -> tuple[Any, Any]:
    moved = sum(jnp.sum(change) for change in jax.tree.leaves(tangents[2]))
    slopes = jnp.broadcast_to(jnp.where(values[1], 0.0, jnp.nan), jnp.shape(values[0]))
    return values[0], apply(Sloped(), slopes, jnp.broadcast_to(moved, slopes.shape))
