"""Batches of runs in traced programs as calls of machine code: an operation of JAX on rows of cases.

Arguments are rows of times, first states and constants, one for each case or one for all, and of limits. A batch of
batches is one batch. Where the compiler lays a batch over devices, each calls the machine code for its own cases. On
other devices than CPUs, and in programs that are exported, the same operation is the traced loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn, Protocol, final

import jax
import jax.numpy as jnp
from jax.experimental.custom_partitioning import custom_partitioning
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir
from jax.sharding import NamedSharding
from jax.sharding import PartitionSpec as _PartitionSpec

from ...integrators.jax.derivatives import Record
from ...integrators.jax.mesh_axes import varying_like
from ...once import once
from ...processors import available_threads
from ..llvm.foreign import ForeignCode

__all__ = ["BatchRun", "Traced", "run_batch", "run_sweep"]

_Spec: Any = _PartitionSpec  # which has no types
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


@final
class Traced:
    """A function that traces runs; those with the same key are the same."""

    def __init__(self, function: Callable[..., Any], key: Any) -> None:
        self.function, self._key = function, key

    def __call__(self, *arguments: Any) -> Any:
        """Return the result of the function."""
        return self.function(*arguments)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Traced) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


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
    return _bound(t, y, c, limits, run=run, shape=shape, traced=Traced(traced, (run, room)))


def run_sweep(run: BatchRun, t: Any, y: Any, c: Any, limits: Any) -> Record:
    """Return the results of runs on CPUs, with rows of times, states (k, n_y) and constants, and of limits (1, m).

    Times are (k, 2), or (1, n_t) for all cases, between whose ends the record has where the steps began that pass over.
    """
    shape = _Shape(len(y), 0, y.shape[1] + 2) if t.shape[1] == 2 else _Shape(len(y), t.shape[1], y.shape[1] + 1)
    return _bound(t, y, c, limits, run=run, shape=shape, traced=Traced(_elsewhere, run))


def _elsewhere(*rows: Any) -> NoReturn:
    raise AssertionError("runs of a sweep are calls of machine code on CPUs alone")


def _bound(t: Any, y: Any, c: Any, limits: Any, *, run: BatchRun, shape: _Shape, traced: Traced) -> Record:
    bind: Any = _RUNS.bind
    end, numbers, *records = bind(t, y, c, limits, run=run, shape=shape, traced=traced)
    reached, status, steps, attempts, count = numbers.T
    taken = records[0].reshape(len(end), shape.room, shape.width) if records else jnp.zeros((len(end), 0, shape.width))
    return Record(jnp.max(count, initial=0.0).astype(int), taken, end, reached, status, steps, attempts)


_RUNS = Primitive("dalembert_runs")
_RUNS.multiple_results = True


def _in_loops(t: Any, y: Any, c: Any, limits: Any, *, shape: _Shape, traced: Traced, **_: Any) -> Sequence[Any]:
    """Return the result of the operation, by traced loops."""
    rows = [jnp.broadcast_to(value, (shape.cases, value.shape[1])) for value in (t, y, c)]
    record = traced(*rows)
    count = jnp.broadcast_to(record.count, record.reached.shape)
    numbers = [record.reached, record.status, record.steps, record.attempts, count]
    found = [record.end, jnp.stack([jnp.asarray(number, float) for number in numbers], axis=1)]
    return [*found, record.taken.reshape(shape.cases * shape.room, shape.width)] if shape.room else found


_RUNS.def_impl(_in_loops)  # type: ignore[no-untyped-call]


@_RUNS.def_abstract_eval
def _shapes(t: Any, y: Any, c: Any, limits: Any, *, run: BatchRun, shape: _Shape, traced: Traced) -> Sequence[Any]:
    """Return the shapes of last states, numbers and records."""
    shapes = [(shape.cases, y.shape[1]), (shape.cases, _NUMBERS), (shape.cases * shape.room, shape.width)]
    return tuple(y.update(shape=own) for own in shapes[: 3 if shape.room else 2])


def _batched(
    arguments: Sequence[Any], axes: Sequence[Any], *, run: BatchRun, shape: _Shape, traced: Traced
) -> tuple[Sequence[Any], Sequence[int]]:
    """Return the results of a batch of batches, which is one batch."""
    (size,) = {value.shape[axis] for value, axis in zip(arguments, axes, strict=True) if axis is not None}
    rows = [_flat(value, axis, size, shape.cases) for value, axis in zip(arguments[:3], axes[:3], strict=True)]
    whole = _Shape(size * shape.cases, shape.room, shape.width)
    bind: Any = _RUNS.bind
    found = bind(*rows, arguments[3], run=run, shape=whole, traced=traced)
    counts = shape.cases, shape.cases, shape.cases * shape.room
    split = [value.reshape(size, own, value.shape[1]) for value, own in zip(found, counts, strict=False)]
    return split, [0] * len(split)


def _flat(value: Any, axis: Any, size: int, cases: int) -> Any:
    """Return an argument of a batch of batches as rows of all cases, or one row where it is common to all."""
    if axis is None:
        return value if len(value) == 1 else jnp.tile(value, (size, 1))
    value = jnp.moveaxis(value, axis, 0)
    return jnp.broadcast_to(value, (size, cases, value.shape[2])).reshape(size * cases, value.shape[2])


batching.primitive_batchers[_RUNS] = _batched


def _lower_traced(context: Any, *values: Any, **parameters: Any) -> Sequence[Any]:
    """Lower to the traced loop."""
    found: Sequence[Any] = mlir.lower_fun(_in_loops, multiple_results=True)(context, *values, **parameters)
    return found


def _lower_called(context: Any, *values: Any, run: BatchRun, shape: _Shape, traced: Traced) -> Sequence[Any]:
    """Lower to a call of the handler."""
    module = context.module_context
    if module.lowering_parameters.for_export:
        return _lower_traced(context, *values, run=run, shape=shape, traced=traced)
    if not _is_local(module.axis_context):
        if not _lowered_with_devices():
            return _lower_traced(context, *values, run=run, shape=shape, traced=traced)
        laid = mlir.lower_fun(_over_devices(run, shape, traced), multiple_results=True)
        return list(laid(context, *values))
    name, code = run.batch_code(recorded=shape.room > 0)
    threads = min(available_threads(), max(1, shape.cases // _PER_THREAD))
    memory = jax.core.ShapedArray((threads, code.memory), context.avals_in[1].dtype)
    found = jax.ffi.ffi_lowering(name)(context.replace(avals_out=[*context.avals_out, memory]), *values)
    return list(found)[: len(context.avals_out)]


@once
def _lowered_with_devices() -> bool:
    """Make JAX lower programs with this operation for the devices that they run on; return whether it can.

    `custom_partitioning` needs that; JAX has no public name for it.
    """
    try:
        from jax._src.dispatch import prim_requires_devices_during_lowering as known
    except ImportError:
        return False
    known.add(_RUNS)
    return True


def _over_devices(run: BatchRun, shape: _Shape, traced: Traced) -> Callable[..., Sequence[Any]]:
    """Return the operation for a batch that the compiler lays over devices, each of which runs its own cases."""

    def bound(shape: _Shape) -> Callable[..., Any]:
        bind: Any = _RUNS.bind
        return lambda *rows: tuple(bind(*rows, run=run, shape=shape, traced=traced))

    def partition(mesh: Any, arguments: Any, results: Any) -> Any:
        own = results[0].sharding.spec
        axes = own[0] if len(own) else None
        names = () if axes is None else axes if isinstance(axes, tuple) else (axes,)
        parts = math.prod(mesh.shape[name] for name in names)
        if shape.cases % parts:
            axes, parts = None, 1
        along, common = NamedSharding(mesh, _Spec(axes)), NamedSharding(mesh, _Spec())
        given = tuple(along if _is_own(value, shape) else common for value in arguments)
        local = replace(shape, cases=shape.cases // parts)
        return mesh, bound(local), tuple(along for _ in results), given

    def rule(*arguments: Any) -> str:
        given = ", ".join(f"k a{i}" if _is_own(value, shape) else f"b{i} a{i}" for i, value in enumerate(arguments))
        return f"{given} -> k e, k m" + (", (k r) w" if shape.room else "")

    def laid(*rows: Any) -> Any:
        partitioned: Any = custom_partitioning(bound(shape))  # type: ignore[no-untyped-call]
        sizes = {"r": shape.room} if shape.room else {}
        partitioned.def_partition(partition=partition, sharding_rule=rule(*rows), **sizes)
        return partitioned(*rows)

    return laid


def _is_own(value: Any, shape: _Shape) -> bool:
    """Return whether an argument has a row for each case."""
    return bool(value.shape[0] == shape.cases and shape.cases > 1)


def _is_local(axes: Any) -> bool:
    """Return whether what is lowered runs as it is on each device, and the compiler lays nothing over several."""
    if hasattr(axes, "manual_axes"):
        return set(axes.mesh.axis_names) == set(axes.manual_axes)
    return getattr(axes, "num_devices", 1) == 1


_lowered_with_devices()
mlir.register_lowering(_RUNS, _lower_traced)
mlir.register_lowering(_RUNS, _lower_called, platform="cpu")
