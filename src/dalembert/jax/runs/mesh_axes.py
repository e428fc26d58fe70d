"""Axes of device meshes over which arrays vary or lie.

Within ``jax.shard_map``, JAX records for each array over which axes of the mesh it may differ from device to device,
and demands that what a loop carries does so from its beginning. Zeros and counters do not, until they are cast
(`varying_like`). On meshes of explicit axes the type of an array says how it lies there, and operations whose result
has no evident place are rejected: there each device computes its own cases, as in ``shard_map`` (`on_devices`).
Elsewhere nothing is done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jax.sharding import PartitionSpec as _PartitionSpec

_Spec: Any = _PartitionSpec  # what has no types of its own
_reshard: Any = jax.sharding.reshard
_pmax: Any = lax.pmax

Axes = tuple[str, ...]
"""Names of axes of the mesh, in order."""


def varying_alike(tree: Any) -> Any:
    """Return arrays, each of which varies over all axes over which any of them does."""
    return varying_like(tree, tree)


def varying_like(tree: Any, like: Any) -> Any:
    """Return arrays that vary over the axes, too, over which any array of the tree `like` does."""
    if not jax.sharding.get_abstract_mesh().manual_axes:
        return tree
    axes: frozenset[str] = frozenset().union(*(_varying(leaf) for leaf in jax.tree.leaves(like)))

    def cast(leaf: Any) -> Any:
        missing = tuple(sorted(axes - _varying(leaf)))
        return lax.pcast(leaf, missing, to="varying") if missing else leaf

    return jax.tree.map(cast, tree) if axes else tree


def _varying(value: Any) -> frozenset[str]:
    """Return the axes over which an array, a number or a tangent varies; functions vary over none."""
    if callable(value):
        return frozenset()
    kind: Any = value.aval if isinstance(value, SymbolicZero) else jax.typeof(value)
    found: frozenset[str] = kind.mat.varying if hasattr(kind, "mat") else kind.vma
    return found


def mesh_of(tree: Any) -> AbstractContextManager[Any]:
    """Return a context in which what is traced knows the mesh on which arrays of a tree lie, as their types say."""
    if jax.sharding.get_abstract_mesh().empty:
        for leaf in jax.tree.leaves(tree):
            mesh = jax.typeof(leaf).sharding.mesh
            if not mesh.empty:
                return jax.sharding.use_abstract_mesh(mesh)
    return nullcontext()


def laid_on_mesh(tree: Any) -> Any:
    """Return arrays that all lie on the mesh that is traced for, where it has explicit axes: as copies, if nowhere."""
    if not has_explicit_axes():
        return tree

    def lay(leaf: Any) -> Any:
        nowhere = jax.typeof(leaf).sharding.mesh.empty
        return _reshard(leaf, _Spec()) if nowhere else leaf

    return jax.tree.map(lay, tree)


def has_explicit_axes() -> bool:
    """Return whether the program is traced for a mesh with explicit axes."""
    return bool(jax.sharding.get_abstract_mesh().explicit_axes)


def axes_of_cases(rows: Any) -> Axes:
    """Return the explicit axes over which the first axis of any array of a tree lies."""
    for leaf in jax.tree.leaves(rows):
        spec = jax.typeof(leaf).sharding.spec
        first = spec[0] if len(spec) else None
        if first is not None:
            return first if isinstance(first, tuple) else (first,)
    return ()


def stack(arrays: Sequence[Any], axis: int = 0) -> Any:
    """Return ``jnp.stack(arrays, axis)``, in batches over explicit axes too.

    There JAX 0.10 does not stack what differs from case to case with what does not, and concatenates it.
    """
    if not has_explicit_axes():
        return jnp.stack(arrays, axis)
    return jnp.concatenate([jnp.expand_dims(array, axis) for array in arrays], axis)


def on_devices(function: Callable[..., Any], axes: Axes, batched: Any, whole: Any, *arguments: Any) -> Any:
    """Return ``function(*arguments)``, where each device computes the cases that lie on it.

    Parameters
    ----------
    function
        Of trees of arrays, to a tree of arrays.
    axes
        The axes of the mesh over which cases lie.
    batched
        Tuple of trees, one for each argument, of whether the first axis of an array counts cases.
    whole
        Tree of whether the first axis of a result does, or True, where all do; of others, the largest of all devices
        is returned.
    """
    own, common = _Spec(axes), _Spec()
    given = jax.tree.map(lambda yes: own if yes else common, batched)
    found = jax.tree.map(lambda yes: own if yes else common, whole)

    def here(*arguments: Any) -> Any:
        result = function(*arguments)
        if whole is True:
            return result
        return jax.tree.map(lambda yes, value: value if yes else _pmax(value, axes), whole, result)

    with mesh_of(arguments):
        explicit = set(jax.sharding.get_abstract_mesh().explicit_axes)
        spread = jax.shard_map(here, in_specs=given, out_specs=found, axis_names=explicit, check_vma=False)
        return spread(*jax.tree.map(_reshard, arguments, given))


def vectorised(function: Callable[..., Any], whole: Any, *arguments: Any) -> Any:
    """Return ``function(*arguments)``, made so that batches whose cases lie over explicit axes are taken on devices.

    `whole` is a tree like the result of whether, in a batch, each case has its own array, or True, where all have.
    """
    if not has_explicit_axes():
        return function(*arguments)

    @jax.custom_batching.custom_vmap
    def one(*arguments: Any) -> Any:
        return function(*arguments)

    @one.def_vmap
    def _(size: int, batched: Any, *arguments: Any) -> tuple[Any, Any]:
        flags, (given, found) = tuple(batched), (jax.tree.map(_first, tree) for tree in (tuple(batched), whole))
        many = jax.vmap(function, given, found)
        axes = axes_of_cases([leaf for leaf, yes in zip(*map(jax.tree.leaves, (arguments, flags)), strict=True) if yes])
        spread = partial(on_devices, many, axes, flags, whole) if axes else partial(vectorised, many, whole)
        result = spread(*arguments)
        return result, jax.tree.map(lambda _: True, result) if whole is True else whole

    return one(*arguments)


def _first(batched: bool) -> int | None:
    """Return which axis of an array counts cases."""
    return 0 if batched else None
