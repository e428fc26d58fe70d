"""Runs in traced programs as calls of machine code: on CPUs, in double precision.

XLA takes a microsecond to start each fused loop, of which a step of one case has dozens. A run without inputs and
conditions on time is therefore one operation of the traced program, which XLA calls as a foreign function: the compiled
loop of prepared runs (`dalembert.integrators.foreign_loop`). A batch of such runs is one operation, too: the compiled
loop over lanes (`dalembert.codegen.jax.foreign_batches`). On other devices these operations are traced loops.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import jax
import jax.numpy as jnp

from ...integrators.jax.derivatives import Record, Steps
from ...integrators.jax.projection import ANY_START
from ...integrators.jax.run_data import Limits, Stepping
from ...ir.program import Program
from ...once import computed_once, once
from ...transforms.taylor import order_at
from ..cache import digest_of
from ..llvm.loops import debugging
from .foreign_batches import handled, on_processors, run_batch, run_sweep
from .foreign_interface import foreign_interface

if TYPE_CHECKING:
    from ..llvm.foreign import ForeignCode
    from ..llvm.foreign_batch import Interface

__all__ = ["ForeignRuns", "row_of_limits"]

_COMPILED = {"dopri8": "dop853", "tsit5": "tsit5", "taylor": "taylor"}
"""Methods of traced runs, and what compiled loops call them."""

_NUMBERS = 5


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
        return self._serves_on(jax.sharding.AxisType.Auto)

    @property
    def serves_batches(self) -> bool:
        """Whether the present trace may call machine code for batches; on axes of ``jax.shard_map``, too."""
        return self._serves_on(jax.sharding.AxisType.Auto, jax.sharding.AxisType.Manual)

    def _serves_on(self, *kinds: Any) -> bool:
        types = jax.sharding.get_abstract_mesh().axis_types
        wide: bool = jax.config.jax_enable_x64  # type: ignore[attr-defined]
        return wide and all(kind in kinds for kind in types) and foreign_interface() is not None and not debugging()

    def __call__(self, limits: Limits, room: int, traced: Callable[..., Record], t: Any, y: Any, c: Any) -> Record:
        """Return the result, for `Motion`, of a run at times t (n_t,) from y (n_y,) with constants c (n_c,).

        `traced` is the function of (t, y, c) that does the same in a traced loop.
        """
        rows = (room, 2 + len(y)) if room or len(t) <= 2 else (len(t), 1 + len(y))
        run = _Run(self.program, self.method, limits)

        def called(*given: Any) -> tuple[Any, ...]:
            name, code = run.code
            return handled(name, (y.shape, (_NUMBERS,), rows), (code.memory,), given)

        def in_loop(*given: Any) -> tuple[Any, ...]:
            record = traced(*given)
            numbers = record.count, record.reached, record.status, record.steps, record.attempts
            return record.end, jnp.stack([jnp.asarray(number, float) for number in numbers]), record.taken

        end, numbers, taken = on_processors(called, in_loop, t, y, c)
        count, reached, status, steps, attempts = numbers
        return Record(count.astype(int), taken, end, reached, status, steps, attempts)

    def batch(
        self,
        limits: Limits,
        room: int,
        traced: Callable[..., Record],
        size: int,
        given: Sequence[Any],
        batched: Sequence[bool],
    ) -> Record:
        """Return the results of `size` runs; see `dalembert.codegen.jax.foreign_batches.run_batch`."""
        return run_batch(_Run(self.program, self.method, limits), room, traced, size, given, batched)

    def sweep(self, limits: Limits, steps: Stepping) -> Callable[..., tuple[Record, Any]]:
        """Return the function that runs a sweep, compiled once for all limits.

        It is one of rows (t, y, c, limits) as `run_sweep` has them, and returns how the runs went, and states (k, n_t,
        n_y) at times between ends, by shorter `steps`, NaN where a run did not reach them. Taylor steps have the order
        of the `limits` given here.
        """
        run = _Run(self.program, self.method, limits)

        def swept(t: Any, y: Any, c: Any, limits: Any) -> tuple[Record, Any]:
            record = run_sweep(run, t, y, c, limits)
            if t.shape[1] == 2:
                return record, jnp.zeros((len(y), 0, y.shape[1]))
            begins, known = record.taken[:, :, 0], jnp.abs(t - t[:, :1]) <= jnp.abs(record.reached[:, None] - t[:, :1])
            sizes = jnp.where(known, t - begins, 0.0)

            def ends(begins: Any, sizes: Any, states: Any, c: Any) -> Any:
                return jnp.stack(steps(Steps(begins, sizes, tuple(states.T), tuple(c), record.count > 0)), axis=1)

            states = jax.vmap(ends)(begins, sizes, record.taken[:, :, 1:], c)
            return record, jnp.where(known[:, :, None], states, jnp.nan)

        return jax.jit(swept)


def row_of_limits(limits: Limits, method: str) -> tuple[float, ...]:
    """Return the largest step, the number of attempts, and what steps of a method and projections read."""
    read = (limits.floor,) if method == "taylor" else (limits.rtol, limits.atol)
    return limits.max_step, float(limits.max_steps), *read, ANY_START, limits.atol


@final
@dataclass(frozen=True)
class _Run:
    """Program, method and limits of a handler."""

    program: Program
    method: str
    limits: Limits

    @property
    def code(self) -> tuple[str, ForeignCode]:
        """The name of the handler of single runs, and what it is."""
        return _of_one(self)

    def batch_code(self, *, recorded: bool) -> tuple[str, ForeignCode]:
        """See `BatchRun`."""
        return _of_many(self, recorded)

    @property
    def row_of_limits(self) -> tuple[float, ...]:
        """See `BatchRun`."""
        return row_of_limits(self.limits, self.method)


@once
def _of_one(run: _Run) -> tuple[str, ForeignCode]:
    """Return the handler of single runs, and its name."""
    limits = run.limits
    given = _COMPILED[run.method], (limits.rtol, limits.atol), (limits.max_step, limits.max_steps)

    def made(engine: Any, interface: Interface) -> ForeignCode:
        code: ForeignCode = engine.foreign(*given, interface.version)
        return code

    return _registered("run", run.program, (run.method, limits), made)


@once
def _of_many(run: _Run, recorded: bool) -> tuple[str, ForeignCode]:
    """Return the handler of batches, with records or without, and its name: one for all tolerances."""
    tolerances = run.limits.rtol, run.limits.atol
    order = order_at(*tolerances) if run.method == "taylor" else 0

    def made(engine: Any, interface: Interface) -> ForeignCode:
        code: ForeignCode = engine.foreign_batch(_COMPILED[run.method], tolerances, interface, recorded=recorded)
        return code

    return _registered("recorded_batch" if recorded else "batch", run.program, (run.method, order), made)


def _registered(
    kind: str, program: Program, settings: Any, made: Callable[[Any, Interface], ForeignCode]
) -> tuple[str, ForeignCode]:
    """Return a handler, which XLA knows from now on by a name that is the same in every process.

    `made` makes it of the compiled engine and the interface.
    """
    from ..llvm.backend import LLVMBackend
    from ..llvm.target import target

    backend, interface = LLVMBackend(), foreign_interface()
    assert interface is not None
    rendered = backend.render(program)
    layout = program.layout
    sizes = len(layout.state), layout.constants or len(layout.parameters)
    name = f"dalembert_{kind}_{digest_of(rendered.digest, repr((settings, interface, target().key, sizes)))}"

    def make() -> ForeignCode:
        code = made(backend.load(rendered, cache=True), interface)
        ffi: Any = jax.ffi  # which has no types throughout
        ffi.register_ffi_target(name, ffi.pycapsule(ctypes.c_void_p(code.address)), platform="cpu")
        return code

    return name, computed_once(_NAMED, name, make)


_NAMED: dict[str, ForeignCode] = {}
"""Handlers that XLA knows, by name, for the life of the process; programs with the same kernels and sizes share one."""
