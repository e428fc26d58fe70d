"""The JAX backend: generated Python on ``jax.numpy``, compiled by XLA and integrated by diffrax."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from ...arrays import FloatArray
from ...errors import MissingExtraError
from ...integrators.cases import BlockResult, CaseBlock
from ...integrators.problem import IntegrationProblem, Solution
from ...ir.program import Program
from ...methods.step_constants import SMALLEST_SCALE
from ...once import computed_once, once_property
from ...options import SolveOptions
from ...transforms.recurrences import Recurrences, recurrences
from ...transforms.taylor import clipped_tolerance, order_for, scale_floor, step_kernel
from ..base import Backend, Capability, Engine, RenderedModule
from ..host_runs import HostedRuns
from ..runs import Prepared
from ..step_blocks import growing_step_blocks

if TYPE_CHECKING:
    from ...reduction.starting import Start
    from ...scene.symbol_table import InputSymbol

try:
    import diffrax  # noqa: F401  # of the extra, too
    import jax
except ImportError as missing:
    raise MissingExtraError(
        f'the jax backend needs JAX and diffrax ({missing}): pip install "dalembert[jax]"'
    ) from missing

from ...integrators.jax.compiling import LARGEST_FUSED, compiled
from ...integrators.jax.kernels import CORRECTIONS, Kernels
from ...integrators.jax.lanes import Attempts, Batch, TaylorAttempts, run_batch
from ...integrators.jax.many import diffrax_batch
from ...integrators.jax.pairs import PairAttempts
from ...integrators.jax.precision import double_precision
from ...integrators.jax.run_data import Limits
from ...integrators.jax.series import TaylorIntegrator
from ...integrators.jax.solvers import METHODS, Integrator
from ...integrators.jax.solvers import Settings as SolverSettings
from .foreign import ForeignRuns, row_of_limits
from .hosted import HostedSolve
from .kernels import compile_kernel
from .modules import loaded, rendered_module
from .pieces import PAIRS, pieces_of
from .pointwise import StateFunctions, VectorField
from .prepared import Final, final_function, prepared_run
from .pure import Solve, register_static

__all__ = ["JaxBackend", "JaxEngine"]

_SMALLEST_BATCH = 16
_FIRST_BLOCK = 8
"""Attempts in the first block of a run with events: a call costs as much as many steps."""
_LOOSE = 1e-10
"""Tolerance down to which the pair of order 5 sweeps faster than that of order 8 (measured on unequal spheres)."""


def _padded(rows: FloatArray) -> FloatArray:
    """Return `rows` with the last one repeated until their number is a power of two."""
    size = max(_SMALLEST_BATCH, 1 << (len(rows) - 1).bit_length())
    return np.concatenate([rows, np.repeat(rows[-1:], size - len(rows), axis=0)])


def _columns(rows: FloatArray) -> tuple[FloatArray, ...]:
    """Return the columns of padded `rows`, one array each."""
    return tuple(np.ascontiguousarray(column) for column in _padded(rows).T)


@final
class JaxEngine(Engine):
    """Kernels of a module that JAX traces; each is compiled when first used.

    Parameters
    ----------
    program : Program
        What the module was rendered from.
    namespace : mapping of str to callable
        The module's kernels by name.
    """

    def __init__(self, program: Program, namespace: Mapping[str, Any]) -> None:
        if program.conditions is not None:  # what is only narrow is for runs that are cut into segments
            program = replace(program, conditions=program.conditions.deciding())
        self._program = program
        self._sizes = {kernel.name: len(kernel.outputs) for kernel in program}
        self.kernels = Kernels(program, namespace)
        self._batched = {
            name: compiled(jax.vmap(self.kernels[name], (0, 0, None)), len(program.kernel(name).body))
            for name in self.kernels.names
        }
        self._integrators: dict[tuple[str, int], Integrator | TaylorIntegrator] = {}
        self._batches: dict[tuple[str, int], Callable[..., Any]] = {}
        self._finals: dict[tuple[str, int], Final] = {}

    def accept_as_static(self, kind: type) -> None:
        """See `Engine.accept_as_static`."""
        register_static(kind)

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`. Batches are padded to a power of two, so that few sizes are ever compiled."""
        count = len(y)
        if count == 0:
            return np.empty((0, self._sizes[kernel]))
        with double_precision():
            out = self._batched[kernel](_padded(t), _padded(y), c)
            return np.array(np.asarray(out)[:count])

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """See `Engine.automatic`: many cases take Taylor steps where XLA can fuse them."""
        tolerance = clipped_tolerance(rtol, atol)
        if not many:
            return methods[0]
        known = self._recurrences if "taylor" in methods else None
        if known and not known.nonsmooth and known.unrolled_lines(order_for(tolerance)) <= LARGEST_FUSED:
            return "taylor"
        return "tsit5" if tolerance >= _LOOSE else "dopri8"

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        order = order_for(clipped_tolerance(problem.rtol, problem.atol)) if method == "taylor" else 0
        key = method, order

        def make() -> Integrator | TaylorIntegrator:
            if method != "taylor":
                return Integrator(self.kernels, method)
            step = step_kernel(self._recurrences, order, dense=True)
            operations = len(step.body) + self._projecting
            return TaylorIntegrator(
                compile_kernel(step),
                self.kernels,
                order,
                operations,
                step_growth_limited=self._recurrences.step_growth_limited,
            )

        return computed_once(self._integrators, key, make)(problem)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`: not much more is integrated than what is wanted."""
        yield from growing_step_blocks(lambda part: self.integrate(part, method), problem, _FIRST_BLOCK)

    def prepared(
        self, problem: IntegrationProblem, method: str, constants: Callable[[FloatArray], FloatArray]
    ) -> Prepared:
        """See `Engine.prepared`: one compiled function, constants included; other problems compile nothing anew."""
        if method in METHODS and METHODS[method].ends:
            return super().prepared(problem, method, constants)
        tolerance = clipped_tolerance(problem.rtol, problem.atol)
        key = method, order_for(tolerance) if method == "taylor" else 0

        def make() -> Final:
            # Taylor steps of one case are cut in blocks, which are to be fused.
            operations = 0 if method == "taylor" else len(self._program.kernel("rhs").body) + self._projecting
            pieces = pieces_of(self._program, self.kernels, *key)
            return final_function(pieces, self.kernels, operations)

        return prepared_run(computed_once(self._finals, key, make), problem)

    @once_property
    def vector_field(self) -> VectorField:
        """See `TracedEngine.vector_field`; args are the parameters p (n_p,)."""
        return VectorField(self._program)

    @once_property
    def state_functions(self) -> StateFunctions:
        """See `TracedEngine.state_functions`."""
        return StateFunctions(self._program)

    def solve_fn(self, start: Start | None, options: SolveOptions, inputs: tuple[InputSymbol, ...] = ()) -> Solve:
        """See `TracedEngine.solve_fn`."""
        return Solve(self._program, start, options, inputs)

    def hosted_solve_fn(self, start: Start | None, options: SolveOptions, hosted: HostedRuns) -> HostedSolve:
        """See `TracedEngine.hosted_solve_fn`."""
        plain = replace(options, dense=False, throw=False)
        native = None if hosted.watched is None else Solve(self._program, start, plain, hosted.inputs)
        return HostedSolve(hosted, options, native)

    whole_blocks: ClassVar[bool] = True

    def integrate_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """See `Engine.integrate_block`: all cases in one loop, padded to a power of two; one by one with events."""
        if block.watch is not None:
            super().integrate_block(block, method, result)
            return
        with double_precision():
            if method in METHODS and METHODS[method].ends:
                self._diffrax_block(block, method, result)
            elif self._calls_machine_code(method):
                self._called_block(block, method, result)
            else:
                self._own_block(block, method, result)

    def _calls_machine_code(self, method: str) -> bool:
        """Return whether machine code that XLA calls runs the cases: on CPUs."""
        device = jax.config.jax_default_device  # type: ignore[attr-defined]
        platform = getattr(device, "platform", device) or jax.default_backend()
        served = self._program.conditions is None and bool(self._program.layout.state)
        return platform == "cpu" and served and ForeignRuns(self._program, method).serves_batches

    def _called_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """Run cases in one call; those that pad their number to a power of two end where they begin."""
        tolerance = clipped_tolerance(block.rtol, block.atol)
        floor, least = scale_floor(block.rtol, block.atol), max(block.atol, SMALLEST_SCALE)
        limits = Limits(block.rtol, least, floor, block.max_step, block.max_steps)
        order, count = order_for(tolerance) if method == "taylor" else 0, len(block.y)

        def make() -> Callable[..., Any]:
            steps = pieces_of(self._program, self.kernels, method, order).steps
            return ForeignRuns(self._program, method).sweep(limits, steps)

        runner = computed_once(self._batches, (f"call {method}", order), make)
        t, states = _padded(block.spans), _padded(block.y)
        t[count:, 1] = t[count:, 0]
        if len(block.t_eval):  # whose span is that of all cases
            t = np.concatenate([t[:1, :1], block.t_eval[np.newaxis], t[:1, 1:]], axis=1)
            states[count:] = np.nan
        row = np.array([row_of_limits(limits, method)])
        out, samples = jax.device_get(runner(t, states, _padded(block.c), row))
        if len(block.t_eval):
            result.samples[:] = samples[:count, 1:-1]
        result.y[:] = out.end[:count]
        result.ends[:] = np.stack([out.reached, out.status, out.steps], axis=1)[:count]

    def _own_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        tolerance = clipped_tolerance(block.rtol, block.atol)
        key = method, order_for(tolerance) if method == "taylor" else 0
        runner = computed_once(self._batches, key, lambda: self._batch_runner(*key))
        batch = Batch(
            y=_columns(block.y),
            c=_columns(block.c),
            t0=_padded(block.spans[:, 0]),
            t1=_padded(block.spans[:, 1]),
            t_eval=np.asarray(block.t_eval, dtype=np.float64),
            floor=np.float64(scale_floor(block.rtol, block.atol)),
            rtol=np.float64(block.rtol),
            atol=np.float64(max(block.atol, SMALLEST_SCALE)),
            max_step=np.float64(block.max_step),
            max_steps=np.float64(block.max_steps),
        )
        out = jax.device_get(runner(batch))
        count = len(block.y)
        result.y[:] = np.stack(out.y, axis=1)[:count]
        result.ends[:] = np.stack([out.t, out.status, out.steps], axis=1)[:count]
        if len(block.t_eval):
            result.samples[:] = out.samples.transpose(2, 0, 1)[:count]

    def _batch_runner(self, method: str, order: int) -> Callable[..., Any]:
        """Return the loop of a method over a batch of cases."""
        projections = [
            (compile_kernel(self._program.kernel(name)), count)
            for name, count in CORRECTIONS.items()
            if name in self._program
        ]
        attempts: Attempts
        if method == "taylor":
            step = step_kernel(self._recurrences, order, dense=False)
            step_growth_limited = self._recurrences.step_growth_limited
            attempts, operations = (
                TaylorAttempts(compile_kernel(step), step_growth_limited=step_growth_limited),
                len(step.body),
            )
        else:
            rhs = self._program.kernel("rhs")
            knots = compile_kernel(self._program.kernel("knots")) if "knots" in self._program else None
            attempts = PairAttempts(
                compile_kernel(rhs), PAIRS[method], moved=bool(projections), knots=knots, operations=len(rhs.body)
            )
            operations = LARGEST_FUSED + 1
        return run_batch(attempts, projections, operations + self._projecting)

    def _diffrax_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        key = method, 0
        runner = computed_once(self._batches, key, lambda: diffrax_batch(self.kernels, method))
        spans = _padded(block.spans)
        direction = np.where(spans[:, 1] >= spans[:, 0], 1.0, -1.0)
        settings = SolverSettings(
            direction,
            direction * spans[:, 0],
            direction * spans[:, 1],
            _padded(block.c),
            np.float64(block.rtol),
            np.float64(block.atol),
            np.float64(0.0),
            np.float64(block.max_step),
        )
        t_eval, budget = np.asarray(block.t_eval, dtype=np.float64), np.int64(block.max_steps)
        out = jax.device_get(runner(settings, _padded(block.y), t_eval, budget))
        count = len(block.y)
        result.y[:], result.ends[:] = out[0][:count], out[2][:count]
        if len(t_eval):
            result.samples[:] = out[1][:count]

    @property
    def _projecting(self) -> int:
        """Operations of all corrections that follow a step."""
        kernels = ((self._program.kernel(name), n) for name, n in CORRECTIONS.items() if name in self._program)
        return sum(len(kernel.body) * count for kernel, count in kernels)

    @once_property
    def _recurrences(self) -> Recurrences:
        return recurrences(self._program.kernel("rhs"), step_growth_limited=self._program.nonanalytic)


@final
class JaxBackend(Backend):
    """For accelerators, and for programs that are JAX already."""

    name = "jax"
    series = ("taylor",)
    capabilities = frozenset({Capability.VECTOR_FIELD, Capability.STATE_FUNCTIONS, Capability.SOLVE_FUNCTION})
    methods: ClassVar[Mapping[str, str]] = {
        "dopri8": "explicit Runge-Kutta of order 8 (Prince and Dormand; diffrax, in sweeps DOP853)",
        "tsit5": "explicit Runge-Kutta of order 5 (Tsitouras; diffrax, in sweeps a loop of our own)",
        "taylor": "Taylor series, generated recurrences, order and step from the tolerance; what sweeps take",
        "kvaerno5": "implicit Runge-Kutta of order 5, for stiff scenes (Kvaerno; diffrax)",
    }

    def render(self, program: Program) -> RenderedModule:
        """See `Backend.render`."""
        return rendered_module(program)

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`; XLA compiles in memory, so that there is nothing to keep on disk."""
        register_static(Solve)
        register_static(HostedSolve)
        return JaxEngine(rendered.program, loaded(rendered))
