"""Guard of loops that rules of ours differentiate, against programs in which JAX drops such rules.

Where JAX differentiates ``jax.lax.scan`` forward over reverse, it takes functions with derivatives of their own apart
and differentiates what is inside: a loop without a derivative, or one whose derivative is another.
"""

from __future__ import annotations

from typing import Any, NoReturn

from jax.extend.core import Primitive
from jax.interpreters import ad as _ad
from jax.interpreters import batching, mlir

from ...errors import CapabilityError

__all__ = ["ruled"]

ad: Any = _ad  # whose functions have no types
_ruled: Any = Primitive("dalembert_ruled")
_ruled.multiple_results = True


def ruled(*values: Any) -> tuple[Any, ...]:
    """Return values from which something is computed that has derivatives by a rule alone.

    Differentiating them raises a `CapabilityError`.
    """
    found: list[Any] = _ruled.bind(*values)
    return tuple(found)


def _pushed(primals: Any, tangents: Any) -> NoReturn:
    raise CapabilityError(
        "JAX has dropped the rule by which a run is differentiated, as it does where jax.lax.scan or jax.lax.map is"
        " differentiated forward over reverse (jax.hessian, jax.jacfwd of jax.grad). Use jax.jacrev(jax.jacfwd(f)) or"
        " jax.jacfwd(jax.jacfwd(f)) there, or jax.vmap in place of jax.lax.map"
    )


def _vectorised(values: Any, axes: Any) -> tuple[Any, Any]:
    return _ruled.bind(*values), axes


_ruled.def_impl(lambda *values: list(values))
_ruled.def_abstract_eval(lambda *values: list(values))
ad.primitive_jvps[_ruled] = _pushed
batching.primitive_batchers[_ruled] = _vectorised
mlir.register_lowering(_ruled, lambda context, *values: list(values))
