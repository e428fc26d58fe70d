"""Changes of states at times, which change with the times, too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp

from .linear_maps import LinearMap

Rates = Callable[[Any, Any, Any, Any], Any]
"""From times (n_t,), states (n_t, n_y), constants (n_c,) and breaks (n,) to rates (n_t, n_y)."""


@final
class At(NamedTuple):
    """Times (n_t,), the states there (n_t, n_y), constants (n_c,), and breaks (n,)."""

    t: Any
    y: Any
    c: Any
    breaks: Any


def _changed(rates: Rates, at: At, dy: Any, dc: Any) -> Any:
    """Return the changes of rates (n_t, n_y)."""
    return jax.jvp(lambda y, c: rates(at.t, y, c, at.breaks), (at.y, at.c), (dy, dc))[1]


@final
@dataclass(frozen=True)
class Timed:
    """Changes of states (n_t, n_y) as they are, given with those of the constants (n_c,).

    With the times, they change as the rates do.
    """

    rates: Rates

    def __call__(self, held: At, moving: Any) -> Any:
        """See `LinearMap`."""
        return moving[0]

    @property
    def transposed(self) -> LinearMap:
        """See `LinearMap`."""
        return _Given(self.rates)

    def change(self, held: At, dheld: At, moving: Any, still: At) -> Any:
        """See `LinearMap`."""
        if still.t:
            return jnp.zeros_like(held.y)
        return dheld.t[:, None] * _changed(self.rates, held, *moving)


@final
@dataclass(frozen=True)
class _Given:
    """The transpose of `Timed`."""

    rates: Rates

    def __call__(self, held: At, moving: Any) -> Any:
        return moving, jnp.zeros_like(held.c)

    @property
    def transposed(self) -> LinearMap:
        return Timed(self.rates)

    def change(self, held: At, dheld: At, moving: Any, still: At) -> Any:
        if still.t:
            return jnp.zeros_like(held.y), jnp.zeros_like(held.c)
        back = jax.vjp(partial(_changed, self.rates, held), held.y, held.c)[1]
        return back(dheld.t[:, None] * moving)
