"""Guard of loops that rules of ours differentiate, against programs in which JAX drops such rules.

Where JAX differentiates ``jax.lax.scan`` forward over reverse, it takes functions with derivatives of their own apart
and differentiates what is inside: a loop without a derivative, or one whose derivative is another. It leaves functions
with batches of their own whole, with what they hold.
"""

from __future__ import annotations

from typing import Any, NoReturn

import jax

from ...errors import CapabilityError


@jax.custom_batching.custom_vmap
def ruled(*values: Any) -> Any:
    """Return values from which something is computed that has derivatives by a rule alone.

    Differentiating them raises a `CapabilityError`.
    """
    return _guarded(*values)


@ruled.def_vmap
def _(size: int, batched: Any, *values: Any) -> tuple[Any, Any]:
    return ruled(*values), tuple(batched)


@jax.custom_jvp
def _guarded(*values: Any) -> Any:
    return values


@_guarded.defjvp
def _(primals: Any, tangents: Any) -> NoReturn:
    raise CapabilityError(
        "JAX has dropped the rule by which a run is differentiated, as it does where jax.lax.scan or jax.lax.map is"
        " differentiated forward over reverse (jax.hessian, jax.jacfwd of jax.grad). Use jax.jacrev(jax.jacfwd(f)) or"
        " jax.jacfwd(jax.jacfwd(f)) there, or jax.vmap in place of jax.lax.map"
    )
