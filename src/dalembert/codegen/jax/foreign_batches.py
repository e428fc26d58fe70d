"""Batches of runs in traced programs as calls of machine code, on rows of cases.

Arguments are rows of times, first states and constants, one for each case or one for all, and of limits. A batch of
batches is one batch. Where the compiler lays a batch over devices, each calls the machine code for its own cases. On
other devices than CPUs the same is done in a traced loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NoReturn, Protocol, final

import jax
import jax.numpy as jnp
from jax.experimental.custom_partitioning import custom_partitioning
from jax.sharding import NamedSharding
from jax.sharding import PartitionSpec as _PartitionSpec

from ...integrators.jax.derivatives import Record
from ...integrators.jax.mesh_axes import varying_alike, varying_like
from ...processors import available_threads
from ..llvm.foreign import ForeignCode

__all__ = ["BatchRun", "handled", "on_processors", "run_batch", "run_sweep"]

_Spec: Any = _PartitionSpec  # which has no types
_Struct: Any = jax.ShapeDtypeStruct
_NUMBERS = 5
_PER_THREAD = 64
"""Cases below which a thread is not worth its start."""


class BatchRun(Protocol):
    """Runs with a handler: those of the same program, method and limits compare equal."""

    def batch_code(self, *, recorded: bool) -> tuple[str, ForeignCode]:
        """Return the name of the handler of batches, and what it is."""
        ...

    @property
    def row_of_limits(self) -> tuple[float, ...]:
        """Largest step, number of attempts, and what steps read of tolerances."""
        ...


@final
@dataclass(frozen=True)
class _Shape:
    """Number of cases, rows of a record that each has, and numbers in a row."""

    cases: int
    room: int
    width: int


def run_batch(
    run: BatchRun, room: int, traced: Callable[..., Record], size: int, given: Sequence[Any], batched: Sequence[bool]
) -> Record:
    """Return the results of `size` runs, whose times, first states and constants `given` are own ones or common.

    `traced` does the same in a traced loop, for rows of cases.
    """
    t, y, c = (value if own else value[jnp.newaxis] for value, own in zip(given, batched, strict=True))
    timed = not room and t.shape[1] > 2
    shape = _Shape(size, t.shape[1] if timed else room, y.shape[1] + (1 if timed else 2))
    limits = varying_like(jnp.array([run.row_of_limits]), y)
    return _recorded(run, shape, traced, t, y, c, limits)


def run_sweep(run: BatchRun, t: Any, y: Any, c: Any, limits: Any) -> Record:
    """Return the results of runs on CPUs, with rows of times, states (k, n_y) and constants, and of limits (1, m).

    Times are (k, 2), or (1, n_t) for all cases, between whose ends the record has where the steps began that pass over.
    """
    shape = _Shape(len(y), 0, y.shape[1] + 2) if t.shape[1] == 2 else _Shape(len(y), t.shape[1], y.shape[1] + 1)
    return _recorded(run, shape, _elsewhere, t, y, c, limits)


def _elsewhere(*rows: Any) -> NoReturn:
    raise AssertionError("runs of a sweep are calls of machine code on CPUs alone")


def _recorded(run: BatchRun, shape: _Shape, traced: Callable[..., Any], *rows: Any) -> Record:
    end, numbers, *records = _Batch(run, shape, traced)(*varying_alike(rows))
    reached, status, steps, attempts, count = numbers.T
    taken = records[0].reshape(len(end), shape.room, shape.width) if records else jnp.zeros((len(end), 0, shape.width))
    return Record(jnp.max(count, initial=0.0).astype(int), taken, end, reached, status, steps, attempts)


@final
@dataclass(frozen=True)
class _Batch:
    """A batch as a function of rows of times, states, constants and limits to last states, numbers and records."""

    run: BatchRun
    shape: _Shape
    traced: Callable[..., Any]

    def __call__(self, *rows: Any) -> tuple[Any, ...]:
        """Return the result of the batch; a batch of batches is one batch."""
        batch = jax.custom_batching.custom_vmap(partial(on_processors, self._laid, self._in_loops))
        batch.def_vmap(self._of_batches)
        found: tuple[Any, ...] = batch(*rows)
        return found

    def _of_batches(self, size: int, batched: Any, *rows: Any) -> tuple[Any, Any]:
        shape = self.shape
        whole = replace(self, shape=replace(shape, cases=size * shape.cases))
        given = [_flat(row, yes, size, shape.cases) for row, yes in zip(rows[:3], batched[:3], strict=True)]
        found = whole(*given, rows[3])
        split = tuple(value.reshape(size, -1, value.shape[1]) for value in found)
        return split, tuple(True for _ in split)

    def _in_loops(self, t: Any, y: Any, c: Any, limits: Any) -> tuple[Any, ...]:
        """Return the result by traced loops."""
        shape = self.shape
        rows = [jnp.broadcast_to(value, (shape.cases, value.shape[1])) for value in (t, y, c)]
        record = self.traced(*rows)
        count = jnp.broadcast_to(record.count, record.reached.shape)
        numbers = [record.reached, record.status, record.steps, record.attempts, count]
        found = record.end, jnp.stack([jnp.asarray(number, float) for number in numbers], axis=1)
        return (*found, record.taken.reshape(shape.cases * shape.room, shape.width)) if shape.room else found

    def _called(self, *rows: Any) -> tuple[Any, ...]:
        """Return the result by a call of the handler."""
        shape = self.shape
        name, code = self.run.batch_code(recorded=shape.room > 0)
        threads = min(available_threads(), max(1, shape.cases // _PER_THREAD))
        shapes = [(shape.cases, rows[1].shape[1]), (shape.cases, _NUMBERS), (shape.cases * shape.room, shape.width)]
        return handled(name, shapes[: 3 if shape.room else 2], (threads, code.memory), rows)

    def _laid(self, *rows: Any) -> Any:
        """Return the result by calls; where the compiler lays the batch over devices, each runs its own cases."""
        if jax.device_count() == 1:
            return self._called(*rows)
        shape = self.shape

        def partition(mesh: Any, arguments: Any, results: Any) -> Any:
            own = results[0].sharding.spec
            axes = own[0] if len(own) else None
            names = () if axes is None else axes if isinstance(axes, tuple) else (axes,)
            parts = math.prod(mesh.shape[name] for name in names)
            if shape.cases % parts:
                axes, parts = None, 1
            along, common = NamedSharding(mesh, _Spec(axes)), NamedSharding(mesh, _Spec())
            given = tuple(along if _is_own(value, shape) else common for value in arguments)
            local = replace(self, shape=replace(shape, cases=shape.cases // parts))
            return mesh, local._called, tuple(along for _ in results), given

        marks = (f"k a{i}" if _is_own(row, shape) else f"b{i} a{i}" for i, row in enumerate(rows))
        rule = f"{', '.join(marks)} -> k e, k m" + (", (k r) w" if shape.room else "")
        partitioned: Any = custom_partitioning(self._called)  # type: ignore[no-untyped-call]
        partitioned.def_partition(partition=partition, sharding_rule=rule, **({"r": shape.room} if shape.room else {}))
        return partitioned(*rows)


def on_processors(called: Callable[..., Any], in_loop: Callable[..., Any], *given: Any) -> Any:
    """Return the result of `called` on CPUs, and of `in_loop`, which does the same, on other devices."""
    if jax.default_backend() == "cpu":
        return called(*given)
    return jax.lax.platform_dependent(*given, cpu=called, default=in_loop)


def handled(name: str, shapes: Sequence[Any], memory: tuple[int, ...], given: Sequence[Any]) -> tuple[Any, ...]:
    """Return the arrays, of some shapes, that a handler computes in memory of another shape."""
    results = [_Struct(shape, given[1].dtype) for shape in (*shapes, memory)]
    found = jax.ffi.ffi_call(name, results)(*given)
    return varying_like(tuple(found[:-1]), given)


def _flat(value: Any, batched: bool, size: int, cases: int) -> Any:
    """Return an argument of a batch of batches as rows of all cases, or one row where it is common to all."""
    if not batched:
        return value if len(value) == 1 else jnp.tile(value, (size, 1))
    return jnp.broadcast_to(value, (size, cases, value.shape[2])).reshape(size * cases, value.shape[2])


def _is_own(value: Any, shape: _Shape) -> bool:
    """Return whether an argument has a row for each case."""
    return bool(value.shape[0] == shape.cases and shape.cases > 1)
