"""Linear maps with transposes of their own, as an operation of JAX: differentiated, transposed and vectorised.

JAX has functions with derivatives of their own for one kind of derivative at a time. A linear map that is an operation
serves all: what is pushed forward applies it, what is pulled back applies its transpose, which is such an operation
again, and the derivative by what it hangs on is made of such operations, so that derivatives may be nested.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, final

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive, jaxpr_as_fun
from jax.interpreters import ad as _ad
from jax.interpreters import batching, mlir

from .mesh_axes import axes_of_cases, laid_alike, mesh_of, on_devices, varying_alike, varying_like

__all__ = ["LinearMap", "apply"]


class LinearMap(Protocol):
    """A linear map of `moving`, which hangs on `held`; both are trees of arrays of floating point numbers.

    Instances hold no arrays of JAX, and are hashable.
    """

    def __call__(self, held: Any, moving: Any) -> Any:
        """Return the value, a tree of arrays."""

    @property
    def transposed(self) -> LinearMap:
        """The transpose: from `held` and cotangents of the value to those of `moving`."""

    @property
    def in_batches(self) -> LinearMap:
        """The same map in the form that is vectorised."""

    def change(self, held: Any, dheld: Any, moving: Any, value: Any, still: Any) -> Any:
        """Return the change of the value with that of `held`, by operations that are linear in `dheld`.

        `still` is a tree like `held` of whether each array is known not to change.
        """


def apply(function: LinearMap, held: Any, moving: Any) -> Any:
    """Return the value of a linear map."""
    held, moving = varying_alike((held, moving))
    held_leaves, held_tree = jax.tree.flatten(held)
    moving_leaves, moving_tree = jax.tree.flatten(moving)
    with mesh_of((held_leaves, moving_leaves)):
        code, shapes = jax.make_jaxpr(partial(_alike, function), return_shape=True)(held, moving)
        trees = held_tree, moving_tree, jax.tree.structure(shapes)
        found = _applied.bind(*held_leaves, *moving_leaves, map=function, code=code, trees=trees)
    return jax.tree.unflatten(trees[2], found)


def _alike(function: LinearMap, held: Any, moving: Any) -> Any:
    """Return the value, which varies over the mesh axes that its arguments vary over."""
    return varying_like(function(held, moving), (held, moving))


@final
@dataclass(frozen=True)
class _Batched:
    """A map over a batch, on leaves: those of `held` have a leading axis where `axes` says 0."""

    map: LinearMap
    axes: tuple[int | None, ...]
    tree: Any

    def __call__(self, held: Any, moving: Any) -> Any:
        def one(leaves: Any, moving: Any) -> Any:
            return self.map(jax.tree.unflatten(self.tree, leaves), moving)

        many, leaves = jax.vmap(one, (list(self.axes), 0)), jax.tree.leaves(held)
        rows = [leaf for leaf, axis in zip(leaves, self.axes, strict=True) if axis is not None]
        spread = axes_of_cases((rows, moving))
        if not spread:
            return many(leaves, moving)
        batched = [axis is not None for axis in self.axes], jax.tree.map(lambda _: True, moving)
        return on_devices(many, spread, batched, True, leaves, moving)

    @property
    def transposed(self) -> LinearMap:
        return _Batched(self.map.transposed, self.axes, self.tree)

    @property
    def in_batches(self) -> LinearMap:
        return self

    def change(self, held: Any, dheld: Any, moving: Any, value: Any, still: Any) -> Any:
        def one(leaves: Any, changes: Any, moving: Any, value: Any) -> Any:
            held, dheld = (jax.tree.unflatten(self.tree, part) for part in (leaves, changes))
            return self.map.change(held, dheld, moving, value, still)

        axes = list(self.axes)
        return jax.vmap(one, (axes, axes, 0, 0))(jax.tree.leaves(held), jax.tree.leaves(dheld), moving, value)


ad: Any = _ad  # whose functions have no types
_applied: Any = Primitive("dalembert_linear_map")
_applied.multiple_results = True


def _evaluate(*leaves: Any, map: LinearMap, code: Any, trees: Any) -> Any:
    return jaxpr_as_fun(code)(*leaves)


_applied.def_impl(_evaluate)
_applied.def_abstract_eval(lambda *_, map, code, trees: code.out_avals)
mlir.register_lowering(_applied, mlir.lower_fun(_evaluate, multiple_results=True))


def _split(leaves: Any, trees: Any) -> tuple[Any, Any]:
    count = trees[0].num_leaves
    return jax.tree.unflatten(trees[0], leaves[:count]), jax.tree.unflatten(trees[1], leaves[count:])


def _pushed(primals: Any, tangents: Any, *, map: LinearMap, code: Any, trees: Any) -> tuple[Any, Any]:
    count = trees[0].num_leaves
    value = _applied.bind(*primals, map=map, code=code, trees=trees)
    still = [isinstance(tangent, ad.Zero) for tangent in tangents]
    filled = [ad.instantiate_zeros(tangent) for tangent in tangents]
    found = []
    if not all(still[count:]):
        found.append(_applied.bind(*primals[:count], *filled[count:], map=map, code=code, trees=trees))
    if not all(still[:count]):
        (held, moving), (dheld, _) = _split(primals, trees), _split(filled, trees)
        fixed, found_value = jax.tree.unflatten(trees[0], still[:count]), jax.tree.unflatten(trees[2], value)
        found.append(jax.tree.leaves(map.change(held, dheld, moving, found_value, fixed)))
    if not found:
        return value, [jnp.zeros_like(leaf) for leaf in value]
    return value, [a + b for a, b in zip(*found, strict=True)] if len(found) > 1 else found[0]


def _pulled(cotangents: Any, *leaves: Any, map: LinearMap, code: Any, trees: Any) -> list[Any]:
    count = trees[0].num_leaves
    given = jax.tree.unflatten(trees[2], [ad.instantiate_zeros(cotangent) for cotangent in cotangents])
    found = apply(map.transposed, jax.tree.unflatten(trees[0], leaves[:count]), given)
    wanted = (ad.is_undefined_primal(leaf) for leaf in leaves[count:])
    own = zip(jax.tree.leaves(found), wanted, strict=True)
    return [None] * count + [cotangent if yes else None for cotangent, yes in own]


def _vectorised(leaves: Any, axes: Any, *, map: LinearMap, code: Any, trees: Any) -> tuple[Any, Any]:
    count = trees[0].num_leaves
    mapped = [axis is not None for axis in axes]  # None stands for what is the same in all cases
    rows = [jnp.moveaxis(leaf, axis, 0) if yes else leaf for leaf, axis, yes in zip(leaves, axes, mapped, strict=True)]
    size = next(row.shape[0] for row, yes in zip(rows, mapped, strict=True) if yes)
    for i in range(count, len(rows)):
        if not mapped[i]:
            rows[i] = jnp.broadcast_to(rows[i], (size, *rows[i].shape))
    cases = [i for i in range(len(rows)) if i >= count or mapped[i]]
    for i, row in zip(cases, laid_alike([rows[i] for i in cases]), strict=True):
        rows[i] = row
    own = tuple(0 if yes else None for yes in mapped[:count])
    found = jax.tree.leaves(apply(_Batched(map.in_batches, own, trees[0]), *_split(rows, trees)))
    return found, [0] * len(found)


ad.primitive_jvps[_applied] = _pushed
ad.primitive_transposes[_applied] = _pulled
batching.primitive_batchers[_applied] = _vectorised
