"""Axes of device meshes over which arrays vary or lie.

Within ``jax.shard_map``, JAX records for each array over which axes of the mesh it may differ from device to device,
and demands that what a loop carries does so from its beginning. Zeros and counters do not, until they are cast
(`varying_like`). On meshes of explicit axes the type of an array says how it lies there, and operations whose result
has no evident place are rejected: runs have these axes automatic inside (`laid_out`). Elsewhere nothing is done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jax.sharding import PartitionSpec as _PartitionSpec

_Spec: Any = _PartitionSpec  # which has no types


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


def explicit_mesh(tree: Any) -> Any:
    """Return the mesh of explicit axes that is traced for, or on which arrays of a tree lie; None without any."""
    types = (jax.typeof(leaf) for leaf in jax.tree.leaves(tree))
    meshes: list[Any] = [jax.sharding.get_abstract_mesh(), *(kind.sharding.mesh for kind in types)]
    mesh = next((each for each in meshes if not each.empty), meshes[0])
    return mesh if mesh.explicit_axes else None


def laid_out(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return ``function(*arguments)``; on a mesh of explicit axes, the compiler lays out what is computed inside.

    There results of one case lie on no axis; a batch by ``jax.vmap`` lies where its cases do.
    """
    arguments = varying_alike(arguments)
    mesh = explicit_mesh(arguments)
    if mesh is None:
        return function(*arguments)
    leaves, tree = jax.tree.flatten(arguments)  # functions of users are no trees of places

    def inside(*leaves: Any) -> Any:
        return function(*jax.tree.unflatten(tree, leaves))

    with jax.sharding.use_abstract_mesh(mesh):
        return jax.sharding.auto_axes(inside, out_sharding=_Spec())(*leaves)


def stack(arrays: Sequence[Any], axis: int = 0) -> Any:
    """Return ``jnp.stack(arrays, axis)``, in batches over explicit axes too.

    There JAX 0.10 does not stack what differs from case to case with what does not, and concatenates it.
    """
    if not jax.sharding.get_abstract_mesh().explicit_axes:
        return jnp.stack(arrays, axis)
    return jnp.concatenate([jnp.expand_dims(array, axis) for array in arrays], axis)
