"""Single runs in traced programs as calls of machine code: on CPUs, in double precision.

XLA takes a microsecond to start each fused loop, of which a step of one case has dozens. A run without inputs and
conditions on time is therefore one operation of the traced program, which XLA calls as a foreign function: the compiled
loop of prepared runs (`dalembert.integrators.foreign_loop`). On other devices, and in programs that are exported, the
same operation is the traced loop.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import mlir

from ...integrators.jax.derivatives import Record
from ...integrators.jax.motion import Limits
from ...ir.program import Program
from ...once import computed_once, once
from ..cache import digest_of
from ..llvm.loops import debugging

if TYPE_CHECKING:
    from ..llvm.foreign import ForeignCode

__all__ = ["ForeignRuns"]

_COMPILED = {"dopri8": "dop853", "tsit5": "tsit5", "taylor": "taylor"}
"""Methods of traced runs, and what compiled loops call them."""

_NUMBERS = 5
_KNOWN_VERSION = 0, 3
"""The major version of XLA's interface for foreign functions that the handlers are written for, and its last minor one:
a later one may add fields to what the handlers read."""


@final
@dataclass(frozen=True)
class ForeignRuns:
    """Runs of a program by a method, as calls of machine code.

    Attributes
    ----------
    program : Program
        Without conditions on time.
    method : str
        A method of traced runs that is compiled.
    """

    program: Program
    method: str

    @property
    def serves(self) -> bool:
        """Whether the present trace may call machine code.

        It computes in 64 bits, is not told apart by mesh axes, and gives way where loops are to run as plain Python.
        """
        types = jax.sharding.get_abstract_mesh().axis_types
        automatic = all(kind == jax.sharding.AxisType.Auto for kind in types)
        wide: bool = jax.config.jax_enable_x64  # type: ignore[attr-defined]
        return wide and automatic and _version() is not None and not debugging()

    def __call__(self, limits: Limits, room: int, traced: Callable[..., Record], t: Any, y: Any, c: Any) -> Record:
        """Return how the run went at times t (n_t,) from y (n_y,) with constants c (n_c,), as `Motion` wants it.

        `traced` is the function of (t, y, c) that does the same in a traced loop.
        """
        rows = (room, 2 + len(y)) if room or len(t) <= 2 else (len(t), 1 + len(y))
        run = _Run(self.program, self.method, limits)
        bind: Any = _RUN.bind
        end, numbers, taken = bind(t, y, c, run=run, rows=rows, traced=_Traced(traced, (run, rows)))
        count, reached, status, steps, attempts = numbers
        return Record(count.astype(int), taken, end, reached, status, steps, attempts)


@final
@dataclass(frozen=True)
class _Run:
    """Program, method and limits of a handler."""

    program: Program
    method: str
    limits: Limits

    @property
    def code(self) -> tuple[str, ForeignCode]:
        """The name of the handler, and what it is."""
        return _registered(self)


@final
class _Traced:
    """A function of (t, y, c) that traces a run; those of the same run are the same."""

    def __init__(self, function: Callable[..., Record], key: Any) -> None:
        self._function, self._key = function, key

    def __call__(self, t: Any, y: Any, c: Any) -> tuple[Any, ...]:
        """Return the last state, the numbers and the rows."""
        record = self._function(t, y, c)
        numbers = record.count, record.reached, record.status, record.steps, record.attempts
        return record.end, jnp.stack([jnp.asarray(number, float) for number in numbers]), record.taken

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Traced) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@once
def _version() -> tuple[int, int] | None:
    """Return the version of XLA's interface for foreign functions; None where it is not one that is known."""
    header = Path(jax.ffi.include_dir()) / "xla" / "ffi" / "api" / "c_api.h"
    try:
        text = header.read_text(encoding="utf-8")
    except OSError:
        return None
    found = [re.search(rf"#define XLA_FFI_API_{part} (\d+)", text) for part in ("MAJOR", "MINOR")]
    if found[0] is None or found[1] is None:
        return None
    version = int(found[0][1]), int(found[1][1])
    return version if version[0] == _KNOWN_VERSION[0] and version[1] <= _KNOWN_VERSION[1] else None


@once
def _registered(run: _Run) -> tuple[str, ForeignCode]:
    """Return the handler of runs, which XLA knows from now on by a name that is the same in every process."""
    from ..llvm.backend import LLVMBackend
    from ..llvm.target import target

    backend, limits, version = LLVMBackend(), run.limits, _version()
    assert version is not None
    rendered = backend.render(run.program)
    layout = run.program.layout
    sizes = len(layout.state), layout.constants or len(layout.parameters)
    settings = repr((_COMPILED[run.method], limits, version, target().key, sizes))
    name = f"dalembert_run_{digest_of(rendered.digest, settings)}"

    def make() -> ForeignCode:
        engine: Any = backend.load(rendered, cache=True)
        tolerances, allowed = (limits.rtol, limits.atol), (limits.max_step, limits.max_steps)
        code: ForeignCode = engine.foreign(_COMPILED[run.method], tolerances, allowed, version)
        ffi: Any = jax.ffi  # which has no types throughout
        ffi.register_ffi_target(name, ffi.pycapsule(ctypes.c_void_p(code.address)), platform="cpu")
        return code

    return name, computed_once(_NAMED, name, make)


_NAMED: dict[str, ForeignCode] = {}
"""Handlers that XLA knows, by name, for the life of the process; programs with the same kernels and sizes share one."""

_RUN = Primitive("dalembert_run")
_RUN.multiple_results = True


@_RUN.def_impl
def _run_at_once(t: Any, y: Any, c: Any, *, run: _Run, rows: tuple[int, int], traced: _Traced) -> Sequence[Any]:
    """Return what `traced` does: the operation is compiled wherever a trace is."""
    return traced(t, y, c)


@_RUN.def_abstract_eval
def _shapes(t: Any, y: Any, c: Any, *, run: _Run, rows: tuple[int, int], traced: _Traced) -> Sequence[Any]:
    """Return the shapes of the last state, the numbers and the rows."""
    return tuple(jax.core.ShapedArray(shape, y.dtype) for shape in (y.shape, (_NUMBERS,), rows))


def _lower_traced(context: Any, *values: Any, run: _Run, rows: tuple[int, int], traced: _Traced) -> Sequence[Any]:
    """Lower to the traced loop."""
    return mlir.lower_fun(traced, multiple_results=True)(context, *values)


def _lower_called(context: Any, *values: Any, run: _Run, rows: tuple[int, int], traced: _Traced) -> Sequence[Any]:
    """Lower to a call of the handler."""
    if context.module_context.lowering_parameters.for_export:
        return _lower_traced(context, *values, run=run, rows=rows, traced=traced)
    name, code = run.code
    memory = jax.core.ShapedArray((code.memory,), context.avals_in[1].dtype)
    lower = jax.ffi.ffi_lowering(name)
    found = lower(context.replace(avals_out=[*context.avals_out, memory]), *values)
    return list(found)[: len(context.avals_out)]


mlir.register_lowering(_RUN, _lower_traced)
mlir.register_lowering(_RUN, _lower_called, platform="cpu")
