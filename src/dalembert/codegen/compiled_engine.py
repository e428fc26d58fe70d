"""The engine of backends that compile kernels to machine code, which compiled integrator loops call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, final

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseBlock, CaseColumns
from ..methods.status import Status
from ..once import computed_once, once_property
from ..options import DEFAULT_TOLERANCES, NamedTolerances
from ..steps.method_choice import runge_kutta_pays
from ..steps.problem import IntegrationProblem, Solution
from ..stops.segments import constants_at
from ..subset.arguments import NO_CODE, OwnedAddress
from ..transforms.taylor.step import clipped_tolerance, order_at, order_for
from .engine import Engine
from .host_code import raise_failure
from .kernel_code import KernelCode
from .library import LARGEST_UNROLLED, KernelLibrary
from .llvm.loops import loop_named
from .runs import CaseRun, Prepared, StartCode
from .steppers import Steppers, pair_named

if TYPE_CHECKING:
    from pathlib import Path

    from ..events.event_code import EventCode
    from ..events.recorded_motion import RecordedCase
    from ..lanes.sweep_arguments import KeptStarts
    from ..loops.taylor_runs import StepCode
    from ..reduction.starting import Start
    from ..steps.method_choice import Rates
    from .lane_runs import LaneRuns
    from .llvm.foreign_batch import ForeignCode, Interface
    from .llvm.prepared import Admission

_TIGHT = 1e-9
"""Tolerance below which Runge-Kutta steps come to an end where constraints lose rank."""

_LONG, _LONGEST_SCREENED = 2000, 20_000
"""Lines from which on rates are dear to interpret, and up to which they are compiled for the screens of sweeps."""

_STUCK = (Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED)
"""Statuses with which such runs end."""


@final
class CompiledEngine(Engine):
    """Compiled kernels of one program, and the integrator loops that call them.

    Parameters
    ----------
    program : Program
        Program to integrate.
    steps : KernelLibrary
        Gives the addresses of its kernels and steps, for so many lanes as the library says.
    """

    def __init__(self, program: Program, steps: KernelLibrary) -> None:
        self._program, self.steps = program, steps
        self._code = KernelCode(program, steps)
        self._sizes = self._code.sizes
        self._steppers = Steppers(steps, program)
        self._taylor_codes: dict[tuple[int, bool], StepCode] = {}

    @once_property
    def _lanes(self) -> LaneRuns:
        from .lane_runs import LaneRuns

        return LaneRuns(self.steps, self._code, self._steppers, self._program.layout)

    passes_stops: ClassVar[bool] = True

    @property
    def folder(self) -> Path | None:
        """See `Engine.folder`."""
        return self.steps.folder

    @property
    def functions(self) -> Any:
        """See `FunctionEngine.functions`; None where the library has none."""
        return self.steps.functions

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`."""
        return self._code.named(kernel, t, y, c)

    def rows(self, kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.rows`."""
        return self._code.rows(kernel, t, y, c)

    def code(self, kernel: Kernel) -> tuple[OwnedAddress, int]:
        """See `Engine.code`."""
        return self._code.of(kernel, self.steps.lanes), self.steps.lanes

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """See `Engine.automatic`: Taylor steps, or a Runge-Kutta pair for long rates and roots at rest.

        Kinks at which Taylor steps end are costs alone; at others, pairs feel their way.
        Where constraints may lose rank, sweeps to tight tolerances take Taylor steps; single runs can be repeated.
        """
        if "taylor" not in methods:
            return methods[0]
        if not self.steps.ends_at_kinks or self.steps.singular_at_rest:
            return "dop853"
        tolerance = clipped_tolerance(rtol, atol)
        order = order_for(tolerance)
        lines, control = self.steps.series_lines(order), self.steps.control(order)
        if many and tolerance < _TIGHT and self.steps.passes_lost_ranks(order):
            return "taylor"
        if self.too_long_for_series(rtol, atol):
            return "dop853"
        pays = not self.steps.poles and runge_kutta_pays(self._program.kernel("rhs"), lines, control, tolerance)
        return "dop853" if pays else "taylor"

    def too_long_for_series(self, rtol: float, atol: float) -> int:
        """See `Engine.too_long_for_series`."""
        lines = self.steps.series_lines(order_for(clipped_tolerance(rtol, atol)))
        return lines if lines > LARGEST_UNROLLED else 0

    def source_of(self, method: str, rtol: float, atol: float) -> str:
        """See `Engine.source_of`: the text of a single run."""
        return self.steps.source(method, order_at(rtol, atol))

    def prepare(self, problem: IntegrationProblem, method: str, watch: EventCode | None = None) -> None:
        """See `Engine.prepare`."""
        if watch is not None and self.records(method):
            stepper, _ = self._lanes.watched_steps(problem, method, watch)
            _ = loop_named("event_lane_loop" if stepper.rows is None else "implicit_lane_loop").call
            return
        _ = (
            self._taylor(problem)
            if method == "taylor"
            else self._steppers.implicit()
            if method == "radau"
            else self._steppers.explicit
        )

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        compiled = self._code.of_problem(problem)
        if method == "taylor":
            solution = self._taylor(problem).integrate(compiled)
            assert solution is not None
            return solution
        if method == "radau":
            from ..steps import implicit_loop as implicit

            own = self._steppers.implicit()
            found = implicit.integrate(loop_named("implicit_loop"), own.codes, compiled, own.multipliers, own.states)
            raise_failure()
            return found
        from ..steps import explicit_loop as explicit

        pair = pair_named(method, bounded=problem.bounded)
        run = explicit.integrate(loop_named("explicit_loop"), self._steppers.explicit, pair, compiled)
        assert isinstance(run, Solution)
        return run

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """See `Engine.integrate_automatic`: a run that proves stiff is repeated by "radau".

        One that ends where constraints may lose rank is repeated by "taylor".
        """
        reason = ""

        def watch(t: float, y: FloatArray, step: float) -> bool:
            from ..steps.method_choice import radau_pays, still_stiff

            nonlocal reason
            part = problem if problem.stops is None else problem.up_to_stop(t)
            rate = still_stiff(self._rates(problem), t, y, abs(part.t1 - t), step)
            if rate:
                reason = radau_pays(part, t, y, step, rate, self._radau, self._operations)
            return bool(reason)

        if method == "taylor":
            solution = self._taylor(problem).integrate(self._code.of_problem(problem), watch)
            return self._implicit_run(problem, reason) if solution is None else (solution, method, "")
        if method != "dop853":
            return super().integrate_automatic(problem, method)
        from ..steps import explicit_loop as explicit

        compiled = self._code.of_problem(problem)
        loop, pair = loop_named("explicit_loop"), pair_named(method)
        tried = explicit.integrate(loop, self._steppers.explicit, pair, compiled, stop_if_stiff=True)
        if isinstance(tried, Solution):
            order = order_at(problem.rtol, problem.atol)
            if tried.status not in _STUCK or not self.steps.passes_lost_ranks(order):
                return tried, method, ""
            reason = f"steps of {method!r} come to an end at t = {tried.end:.6g}, where the constraints lose rank"
            return self.integrate(problem, "taylor"), "taylor", reason
        if watch(tried.t, tried.y, tried.step):
            return self._implicit_run(problem, reason)
        return self.integrate(problem, method), method, ""

    def _radau(self, problem: IntegrationProblem) -> Solution:
        return self.integrate(problem, "radau")

    def _implicit_run(self, problem: IntegrationProblem, reason: str) -> tuple[Solution, str, str]:
        return self._radau(problem), "radau", reason

    def fit(self, problem: IntegrationProblem, method: str) -> tuple[str, str]:
        """See `Engine.fit`."""
        from ..steps.method_choice import fitting

        return fitting(problem, method, self._rates(problem), self.integrate, self._operations)

    @property
    def tries_first(self) -> bool:
        """See `Engine.tries_first`: where the rates, which are interpreted there, are long."""
        return self._operations > _LONG

    def surely_not_stiff(self, cases: CaseColumns, numbers: Sequence[int], method: str | None) -> bool:
        """See `Engine.surely_not_stiff`: cases of long right-hand sides are tried, which compiles nothing more."""
        tried, screened = method if self.tries_first else None, self._operations <= _LONGEST_SCREENED
        return self.steps.compiles_starts and self._lanes.surely_not_stiff(cases, numbers, tried, screened)

    def surely_independent(self, cases: CaseColumns, rows: Sequence[int]) -> bool:
        """See `Engine.surely_independent`."""
        return self.steps.compiles_starts and self._lanes.surely_independent(cases, rows)

    def keeps_signs(self, kernel: Kernel, block: CaseBlock, done: BlockResult) -> bool:
        """See `Engine.keeps_signs`."""
        return self.steps.compiles_starts and self._code.keeps_signs(kernel, block, done)

    def _rates(self, problem: IntegrationProblem) -> Rates:
        c = self.constants_along(problem)
        return lambda t, y: interpret_rows(self._program.kernel("rhs"), t, y, constants_at(c, t))

    @once_property
    def _operations(self) -> int:
        """Number of operations of a right-hand side."""
        return len(self._program.kernel("rhs").body)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`: a few steps at first, ever more later."""
        from .step_blocks import growing_step_blocks

        self.prepare(problem, method)
        yield from growing_step_blocks(lambda part: self.integrate(part, method), problem, 1)

    def records(self, method: str) -> bool:
        """See `Engine.records`: unless attempts of Runge-Kutta steps would take seconds to compile."""
        return bool(self._sizes["rhs"]) and (method in ("taylor", "radau") or self.steps.compiles_starts)

    def recorded(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
    ) -> RecordedCase:
        """See `Engine.recorded`: the case has one lane of the loop over lanes."""
        if not self.records(method):
            return super().recorded(problem, method, watch, carried)
        return self._lanes.recorded(problem, method, watch, carried)

    parallel: ClassVar[bool] = True

    def sweeper(
        self, cases: CaseColumns, method: str, result: BlockResult, kept: KeptStarts, share: int
    ) -> CaseRun | None:
        """See `Engine.sweeper`: lanes are refilled as cases end."""
        if not self._sizes["rhs"] and method != "taylor":  # other steps divide by the number of components
            return None
        return self._lanes.cases(cases, method, result, kept, share)

    def prepared(
        self,
        problem: IntegrationProblem,
        method: str,
        constants: Callable[[FloatArray], FloatArray],
        admission: Admission | None = None,
    ) -> Prepared:
        """See `Engine.prepared`."""
        if method == "radau":
            return super().prepared(problem, method, constants, admission)
        from ..loops.prepared_loop import PreparedKernels
        from .llvm.prepared import prepared_run

        sizes = (self._sizes["rhs"], len(self._program.layout.parameters), self._sizes["prepare"])
        stepper = self._steppers.stepper(method, (problem.rtol, problem.atol), 1, dense=False)
        tests = NO_CODE if admission is None else admission.code.address
        kernels = PreparedKernels(self.steps.prepare(), *stepper.codes, *self._steppers.projections(1), tests)
        return prepared_run(kernels, sizes, stepper.memory, stepper.settings, self._code.of_problem(problem), admission)

    def foreign_batch(
        self, method: str, order: int, interface: Interface, *, recorded: bool, alone: bool
    ) -> ForeignCode:
        """Return the handler of runs that XLA calls; see `dalembert.codegen.llvm.foreign_batch`.

        Taylor steps have this order. A run `alone` has one lane.
        """
        layout = self._program.layout
        constants = layout.constants or len(layout.parameters)
        return self._lanes.foreign_batch(method, order, constants, interface, recorded=recorded, alone=alone)

    def start_code(self, start: Start) -> StartCode | None:
        """See `Engine.start_code`."""
        steps = self.steps
        if not steps.compiles_starts:
            return None
        from .llvm.prepared import start_code

        given = len(self._program.layout.parameters), self._sizes["prepare"], len(start.given)
        sizes = *given, len(start.kernel.outputs)
        return start_code(steps.prepare(), steps.start(start, 1), sizes)

    def _taylor(self, problem: IntegrationProblem) -> StepCode:
        order, weighted = order_at(problem.rtol, problem.atol), isinstance(problem.atol, NamedTolerances)
        found = self._taylor_codes.get((order, weighted))
        if found is not None:
            return found

        def make() -> StepCode:
            from ..loops.taylor_runs import StepCode

            step, loop = self.steps.taylor(order, 1, dense=True, weighted=weighted), loop_named("taylor_loop")
            return StepCode(loop, order, step, *self._steppers.projections(1), self.steps.angles, weighted)

        return computed_once(self._taylor_codes, (order, weighted), make)


def default_source(program: Program, steps: KernelLibrary, methods: Iterable[str]) -> str:
    """Return the text of what runs by default, of these methods."""
    engine = CompiledEngine(program, steps)
    rtol, atol = DEFAULT_TOLERANCES
    return engine.source_of(engine.automatic(tuple(methods), rtol, atol), rtol, atol)
