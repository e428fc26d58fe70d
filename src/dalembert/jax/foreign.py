"""Runs in traced programs as calls of machine code, on rows of cases: on CPUs, in double precision.

XLA takes a microsecond to start each fused loop, of which a step of one case has dozens. Runs without inputs and
conditions on time are therefore one operation of the traced program, which XLA calls as a foreign function: the
compiled loop over lanes. A single run is a batch of one case, in one lane, and a batch of batches is one batch.

Arguments are rows of times, first states and constants, one for each case or one for all, and of limits. Where the
compiler lays a batch over devices, each calls the machine code for its own cases. On other devices than CPUs the same
is done in a traced loop.
"""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import jax
import jax.numpy as jnp
from jax.experimental.custom_partitioning import custom_partitioning
from jax.sharding import NamedSharding
from jax.sharding import PartitionSpec as _PartitionSpec

from ..codegen.cache import digest_of
from ..codegen.llvm.foreign_batch import Interface
from ..codegen.llvm.loops import debugging
from ..frozen import frozen
from ..ir.program import Program
from ..methods.names import TRACED
from ..methods.step_constants import ANY_START
from ..once import computed_once, once
from ..threads import available_threads
from .runs.derivatives import StepsRecord
from .runs.mesh_axes import varying_alike, varying_like
from .runs.precision import CONFIG
from .runs.run_data import Limits

if TYPE_CHECKING:
    from ..codegen.llvm.foreign_batch import ForeignCode

_Spec: Any = _PartitionSpec  # which has no types
_Struct: Any = jax.ShapeDtypeStruct
_NUMBERS = 5
_PER_THREAD = 64
"""Cases below which a thread is not worth its start."""
_KNOWN_VERSION = 0, 5
"""The major version of XLA's interface that the handlers are written for, and its last minor one: a later one may add
fields to what the handlers read."""
_BEFORE = 6
"""Words before the first function of the interface."""


@once
def foreign_interface() -> Interface | None:
    """Return XLA's interface for foreign functions, as the headers that come with JAX have it; None if unknown."""
    header = Path(jax.ffi.include_dir()) / "xla" / "ffi" / "api" / "c_api.h"
    try:
        text = header.read_text(encoding="utf-8")
    except OSError:
        return None
    found = [re.search(rf"#define XLA_FFI_API_{part} (\d+)", text) for part in ("MAJOR", "MINOR")]
    if found[0] is None or found[1] is None:
        return None
    version = int(found[0][1]), int(found[1][1])
    if version[0] != _KNOWN_VERSION[0] or version[1] > _KNOWN_VERSION[1]:
        return None
    functions = re.findall(r"^ *_XLA_FFI_API_STRUCT_FIELD\(XLA_FFI_(\w+)\);", text, re.MULTILINE)
    return Interface(version, {name: _BEFORE + place for place, name in enumerate(functions)})


@final
@frozen
class ForeignRuns:
    """Runs of a program by a method, as calls of machine code.

    Attributes
    ----------
    program : Program
        Without conditions on time.
    method : str
        A method of traced runs that is compiled.
    order : int
        Order of Taylor steps, 0 for others.
    """

    program: Program
    method: str
    order: int

    @property
    def serves(self) -> bool:
        """Whether the present trace may call machine code.

        It computes in 64 bits, its mesh has no explicit axes, and loops are not to run as plain Python.
        """
        kinds = jax.sharding.AxisType.Auto, jax.sharding.AxisType.Manual
        types = jax.sharding.get_abstract_mesh().axis_types
        wide: bool = CONFIG.jax_enable_x64
        return wide and all(kind in kinds for kind in types) and foreign_interface() is not None and not debugging()

    def __call__(
        self, limits: Limits, room: int, traced: Callable[..., StepsRecord], cases: int, t: Any, y: Any, c: Any
    ) -> StepsRecord:
        """Return the results of runs, for `Motion`, with rows of times, first states and constants.

        There is one row for each case, or one for all. `traced` does the same in a traced loop, for rows of all cases.
        """
        timed = not room and t.shape[1] > 2
        shape = _Shape(cases, t.shape[1] if timed else room, y.shape[1] + (1 if timed else 2))
        read = (limits.floor,) if self.method == "taylor" else (limits.rtol, limits.atol)
        row = jnp.array([[limits.max_step, limits.max_steps, *read, ANY_START, limits.atol]], dtype=float)
        rows = varying_alike((t, y, c, varying_like(row, y)))
        end, numbers, *records = _Runs(self, shape, traced)(*rows)
        reached, status, steps, attempts, count = numbers.T
        taken = jnp.zeros((cases, 0, shape.width))
        if records:
            taken = records[0].reshape(cases, shape.room, shape.width)
        return StepsRecord(jnp.max(count, initial=0.0).astype(int), taken, end, reached, status, steps, attempts)


@final
@frozen
class _Shape:
    """Number of cases, rows of a record that each has, and numbers in a row."""

    cases: int
    room: int
    width: int


@final
@frozen
class _Runs:
    """Cases as a function of rows of times, states, constants and limits to last states, numbers and records."""

    foreign: ForeignRuns
    shape: _Shape
    traced: Callable[..., Any]

    def __call__(self, *rows: Any) -> tuple[Any, ...]:
        """Return the results; a batch of batches is one batch."""
        cases = jax.custom_batching.custom_vmap(self._on_device)
        cases.def_vmap(self._of_batches)
        found: tuple[Any, ...] = cases(*rows)
        return found

    def _on_device(self, *rows: Any) -> Any:
        """Return the results of calls on CPUs, and of traced loops elsewhere."""
        if jax.default_backend() == "cpu":
            return self._laid(*rows)
        return jax.lax.platform_dependent(*rows, cpu=self._laid, default=self._in_loops)

    def _of_batches(self, size: int, batched: Any, *rows: Any) -> tuple[Any, Any]:
        cases = self.shape.cases
        whole = replace(self, shape=replace(self.shape, cases=size * cases))
        given = [_flat(row, yes, size, cases) for row, yes in zip(rows[:3], batched[:3], strict=True)]
        found = whole(*given, rows[3])
        split = tuple(value.reshape(size, -1, value.shape[1]) for value in found)
        return split, tuple(True for _ in split)

    def _in_loops(self, t: Any, y: Any, c: Any, limits: Any) -> tuple[Any, ...]:
        """Return the results of traced loops."""
        shape = self.shape
        rows = [jnp.broadcast_to(value, (shape.cases, value.shape[1])) for value in (t, y, c)]
        record = self.traced(*rows)
        count = jnp.broadcast_to(record.count, record.reached.shape)
        numbers = [record.reached, record.status, record.steps, record.attempts, count]
        found = record.end, jnp.stack([jnp.asarray(number, float) for number in numbers], axis=1)
        return (*found, record.taken.reshape(shape.cases * shape.room, shape.width)) if shape.room else found

    def _called(self, *rows: Any) -> tuple[Any, ...]:
        """Return the results of a call of the handler, which may compute in memory for each thread."""
        shape = self.shape
        name, code = _handler(self.foreign, shape.room > 0, shape.cases == 1)
        threads = min(available_threads(), max(1, shape.cases // _PER_THREAD))
        shapes = [(shape.cases, rows[1].shape[1]), (shape.cases, _NUMBERS)]
        shapes += [(shape.cases * shape.room, shape.width)] if shape.room else []
        memory = [(threads, code.memory)] if code.memory else []
        results = [_Struct(shape, rows[1].dtype) for shape in (*shapes, *memory)]
        return varying_like(tuple(jax.ffi.ffi_call(name, results)(*rows)[: len(shapes)]), rows)

    def _laid(self, *rows: Any) -> Any:
        """Return the results of calls; where the compiler lays the cases over devices, each runs its own."""
        shape = self.shape
        if jax.device_count() == 1 or shape.cases == 1:
            return self._called(*rows)

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


def _flat(value: Any, batched: bool, size: int, cases: int) -> Any:
    """Return an argument of a batch of batches as rows of all cases, or one row where it is common to all."""
    if not batched:
        return value if len(value) == 1 else jnp.tile(value, (size, 1))
    return jnp.broadcast_to(value, (size, cases, value.shape[2])).reshape(size * cases, value.shape[2])


def _is_own(value: Any, shape: _Shape) -> bool:
    """Return whether an argument has a row for each case."""
    return bool(value.shape[0] == shape.cases and shape.cases > 1)


@once
def _handler(runs: ForeignRuns, recorded: bool, alone: bool) -> tuple[str, ForeignCode]:
    """Return the handler of cases, with records or without, and its name, by which XLA knows it from now on.

    The name is the same in every process; the handler is one for all limits.
    """
    from ..codegen.llvm.backend import LLVMBackend
    from ..codegen.llvm.target import target

    backend, interface, layout = LLVMBackend(), foreign_interface(), runs.program.layout
    assert interface is not None
    rendered = backend.render(runs.program)
    sizes = len(layout.state), layout.constants or len(layout.parameters)
    kind = ("recorded_" if recorded else "") + ("run" if alone else "batch")
    about = runs.method, runs.order, interface, target().key, sizes
    name = f"dalembert_{kind}_{digest_of(rendered.digest, repr(about))}"

    def make() -> ForeignCode:
        engine: Any = backend.load(rendered, cache=True)
        method = TRACED[runs.method].compiled
        code: ForeignCode = engine.foreign_batch(method, runs.order, interface, recorded=recorded, alone=alone)
        ffi: Any = jax.ffi  # which has no types throughout
        ffi.register_ffi_target(name, ffi.pycapsule(ctypes.c_void_p(code.address)), platform="cpu")
        return code

    return name, computed_once(_NAMED, name, make)


_NAMED: dict[str, ForeignCode] = {}
"""Handlers that XLA knows, by name, for the life of the process; programs with the same kernels and sizes share one."""
