"""The JAX backend: generated Python on ``jax.numpy``, compiled by XLA; trajectories of `simulate` by diffrax."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from ..arrays import FloatArray
from ..codegen.base import Backend, Capability, RenderedModule
from ..codegen.engine import Engine
from ..codegen.runs import HostedRuns, Prepared
from ..codegen.step_blocks import growing_step_blocks
from ..errors import CapabilityError, MissingExtraError, list_names
from ..ir.calls import function_of
from ..ir.kernel import calls_in
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.names import TRACED
from ..once import computed_once, once_property
from ..options import NamedTolerances, SolveOptions
from ..steps.problem import IntegrationProblem, Solution
from ..transforms.taylor.recurrences import Recurrences, recurrences
from ..transforms.taylor.roots_at_rest import roots_vanish_at_rest
from ..transforms.taylor.step import clipped_tolerance, order_at, order_for, step_kernel

if TYPE_CHECKING:
    from ..codegen.llvm.prepared import Admission
    from ..reduction.starting import Start
    from ..scene.symbol_table import InputSymbol

try:
    import diffrax  # noqa: F401  # of the extra, too
    import jax
except ImportError as missing:
    raise MissingExtraError(
        f'the jax backend needs JAX and diffrax ({missing}): pip install "dalembert[jax]"'
    ) from missing

from .compiled_runs import BlockSweeps, Final, final_function, padded, prepared_run
from .hosted import HostedSolve
from .modules import loaded, rendered_module
from .pieces import pieces_of, series_attempts
from .pointwise import StateFunctions, VectorField
from .pure import Solve, register_static
from .runs.precision import LARGEST_FUSED, compiled, double_precision
from .runs.run_constants import ArrayKernels
from .runs.series import TaylorIntegrator
from .runs.solvers import Integrator

_FIRST_BLOCK = 8
"""Attempts in the first block of a run with events: a call costs as much as many steps."""
_LOOSE = 1e-10
"""Tolerance down to which the pair of order 5 sweeps faster than that of order 8 (measured on unequal spheres)."""


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
        self.kernels = ArrayKernels(program, namespace)
        self._batched = {
            name: compiled(jax.vmap(self.kernels[name], (0, 0, None)), len(program.kernel(name).body))
            for name in self.kernels.names
        }
        self._integrators: dict[tuple[str, int, bool], Integrator | TaylorIntegrator] = {}
        self._finals: dict[tuple[str, int, bool], Final] = {}

    def accept_as_static(self, kind: type) -> None:
        """See `Engine.accept_as_static`."""
        register_static(kind)

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`. Batches are padded to a power of two, so that few sizes are ever compiled."""
        count = len(y)
        if count == 0:
            return np.empty((0, self._sizes[kernel]))
        with double_precision():
            out = self._batched[kernel](padded(t), padded(y), c)
            return np.array(np.asarray(out)[:count])

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """See `Engine.automatic`: many cases take Taylor steps where XLA can fuse them."""
        tolerance = clipped_tolerance(rtol, atol)
        if not many:
            return methods[0]
        known = self._recurrences if "taylor" in methods else None
        fused = known and not known.nonsmooth and known.unrolled_lines(order_for(tolerance)) <= LARGEST_FUSED
        if fused and not roots_vanish_at_rest(self._program):
            return "taylor"
        return "tsit5" if tolerance >= _LOOSE else "dopri8"

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        order = order_at(problem.rtol, problem.atol) if method == "taylor" else 0
        weighted = isinstance(problem.atol, NamedTolerances)
        key = method, order, weighted

        def make() -> Integrator | TaylorIntegrator:
            if method != "taylor":
                return Integrator(self.kernels, method)
            known, size = replace(self._recurrences, weighted=weighted), len(self._program.layout.state)
            step = step_kernel(known, order, dense=True)
            attempts = series_attempts(step, size, step_growth_limited=known.step_growth_limited)
            operations = len(step.body) + self.kernels.correction_operations
            return TaylorIntegrator(attempts, self.kernels, order, operations)

        return computed_once(self._integrators, key, make)(problem)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`: not much more is integrated than what is wanted."""
        yield from growing_step_blocks(lambda part: self.integrate(part, method), problem, _FIRST_BLOCK)

    def prepared(
        self,
        problem: IntegrationProblem,
        method: str,
        constants: Callable[[FloatArray], FloatArray],
        admission: Admission | None = None,
    ) -> Prepared:
        """See `Engine.prepared`: one compiled function, constants included; other problems compile nothing anew."""
        tolerance = clipped_tolerance(problem.rtol, problem.atol)
        weighted = isinstance(problem.atol, NamedTolerances)
        key = method, order_for(tolerance) if method == "taylor" else 0, weighted

        def make() -> Final:
            # Taylor steps of one case are cut in blocks, which are to be fused.
            operations = (
                0 if method == "taylor" else len(self._program.kernel("rhs").body) + self.kernels.correction_operations
            )
            pieces = pieces_of(self._program, self.kernels, *key[:2], None, weighted)
            return final_function(pieces, self.kernels, operations)

        return prepared_run(self._program, computed_once(self._finals, key, make), problem, admission)

    @once_property
    def vector_field(self) -> VectorField:
        """See `TracedEngine.vector_field`; args are the parameters p (n_p,)."""
        return VectorField(self._program)

    @once_property
    def state_functions(self) -> StateFunctions:
        """See `TracedEngine.state_functions`."""
        return StateFunctions(self._program)

    def solve_fn(
        self,
        start: Start | None,
        options: SolveOptions,
        inputs: tuple[InputSymbol, ...] = (),
        dependence: Start | None = None,
    ) -> Solve:
        """See `TracedEngine.solve_fn`."""
        return Solve(self._program, start, options, inputs, dependence)

    def hosted_solve_fn(
        self, start: Start | None, options: SolveOptions, hosted: HostedRuns, dependence: Start | None = None
    ) -> HostedSolve:
        """See `TracedEngine.hosted_solve_fn`."""
        plain = replace(options, dense=False, throw=False)
        native = None if hosted.watched is None else Solve(self._program, start, plain, hosted.inputs, dependence)
        return HostedSolve(hosted, options, native)

    whole_blocks: ClassVar[bool] = True

    def integrate_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """See `Engine.integrate_block`: all cases at once; one by one with events."""
        if block.watch is not None:
            super().integrate_block(block, method, result)
        else:
            self._blocks.integrate(block, method, result)

    @once_property
    def _recurrences(self) -> Recurrences:
        return recurrences(self._program.kernel("rhs"), step_growth_limited=self._program.nonanalytic)

    @once_property
    def _blocks(self) -> BlockSweeps:
        return BlockSweeps(self._program, self.kernels, lambda: self._recurrences)


@final
class JaxBackend(Backend):
    """For accelerators, and for programs that are JAX already."""

    name = "jax"
    largest = 4_000
    series = ("taylor",)
    capabilities = frozenset({Capability.VECTOR_FIELD, Capability.STATE_FUNCTIONS, Capability.SOLVE_FUNCTION})

    @property
    def methods(self) -> Mapping[str, str]:
        """See `Backend.methods`."""
        return {name: method.description for name, method in TRACED.items()}

    def serving(self, program: Program) -> Mapping[str, str]:
        """See `Backend.serving`; an error for programs that call compiled functions."""
        called = dict.fromkeys(key for kernel in program for key in calls_in(kernel))
        if called:
            names = list_names(repr(function_of(key).name) for key in called)
            raise CapabilityError(
                f"the backend 'jax' traces programs, and cannot look into compiled functions ({names}) of scene"
                f' {program.name!r}: write them in SymPy or as da.table, or take backend="llvm" or "numba"'
            )
        return super().serving(program)

    def render(self, program: Program) -> RenderedModule:
        """See `Backend.render`."""
        return rendered_module(program)

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`; XLA compiles in memory, so that there is nothing to keep on disk."""
        register_static(Solve)
        register_static(HostedSolve)
        return JaxEngine(rendered.program, loaded(rendered))
