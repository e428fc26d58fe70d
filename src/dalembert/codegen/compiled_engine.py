"""The engine of backends that compile kernels to machine code, which compiled integrator loops call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from ..arrays import FloatArray
from ..integrators.cases import BlockResult, CaseColumns
from ..integrators.kernel_rows import KernelRowsArguments
from ..integrators.method_choice import runge_kutta_pays
from ..integrators.problem import IntegrationProblem, Solution
from ..integrators.segments import constants_at
from ..integrators.sweep_arguments import SweepKernels
from ..integrators.workspace import EventKernels, aligned, no_events
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..methods.step_constants import SMALLEST_SCALE
from ..once import computed_once, once_property
from ..options import DEFAULT_TOLERANCES
from ..transforms.runge_kutta_parts import memory_size
from ..transforms.taylor import clipped_tolerance, order_for, scale_floor
from .base import Engine
from .library import LARGEST_UNROLLED, KernelLibrary
from .llvm.loops import loop_named
from .runs import CaseRun, Prepared, StartCode

if TYPE_CHECKING:
    from ..integrators.event_code import EventCode
    from ..integrators.explicit_loop import ExplicitCode
    from ..integrators.implicit_loop import ImplicitCode
    from ..integrators.stiffness import Rates
    from ..integrators.taylor_runs import StepCode
    from ..methods.tableau import Tableau
    from ..reduction.starting import Start
    from .llvm.foreign import ForeignCode
    from .llvm.foreign_batch import Interface

__all__ = ["METHODS", "CompiledEngine", "default_source"]

METHODS: Mapping[str, str] = {
    "taylor": "Taylor series of an order chosen by the tolerance (Jorba and Zou)",
    "dop853": "explicit Runge-Kutta of order 8 (Hairer, Norsett and Wanner)",
    "tsit5": "explicit Runge-Kutta of order 5 (Tsitouras)",
    "radau": "implicit Runge-Kutta of order 5, for stiff scenes (Radau IIA; Hairer and Wanner)",
}
"""The methods of these backends by name, with descriptions."""

_MOST_EVENT_KERNELS = 64


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
        self._sizes = {kernel.name: len(kernel.outputs) for kernel in program}
        self._program = program
        self._parameters = len(program.layout.parameters)
        self.steps = steps
        self._extra_kernels: dict[int, tuple[Kernel, int]] = {}
        self._taylor_codes: dict[int, StepCode] = {}
        self._event_kernels: dict[tuple[EventCode, str, tuple[int, int], int, int], EventKernels] = {}

    @property
    def follows_inputs(self) -> bool:
        """See `Engine.follows_inputs`: multipliers that a formulation solves for are those of the start of a run."""
        return "stages" not in self._sizes

    @property
    def functions(self) -> Any:
        """See `FunctionEngine.functions`; None where the library has none."""
        return self.steps.functions

    @property
    def _rhs(self) -> Kernel:
        return self._program.kernel("rhs")

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`."""
        lanes = self.steps.lanes
        constants = np.broadcast_to(c, (len(t), len(c)))
        return self._by_code(self.steps.kernel(kernel, lanes), lanes, self._sizes[kernel], t, y, constants)

    def rows(self, kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.rows`."""
        return self._by_code(*self.code(kernel), len(kernel.outputs), t, y, c)

    def _by_code(self, code: int, lanes: int, size: int, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs (k, size) of a compiled kernel at times (k,), states (k, n) and constants (k, n_c)."""
        out = np.empty((len(t), size))
        if len(t):
            room = [aligned(size, lanes) for size in (1, y.shape[1], c.shape[1], out.shape[1])]
            times, states, constants = (np.ascontiguousarray(a, np.float64) for a in (t, y, c))
            loop_named("kernel_rows")(KernelRowsArguments(code, times, states, constants, out, *room))
        return out

    def code(self, kernel: Kernel) -> tuple[int, int]:
        """See `Engine.code`."""
        lanes = self.steps.lanes
        # the kernel is kept, so that no other can have its number
        kept = computed_once(self._extra_kernels, id(kernel), lambda: (kernel, self.steps.extra_kernel(kernel, lanes)))
        return kept[1], lanes

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """See `Engine.automatic`: Taylor steps, or a Runge-Kutta pair for long right-hand sides and kinks."""
        if "taylor" not in methods:
            return methods[0]
        if self.steps.nonsmooth:
            return "dop853"
        tolerance = clipped_tolerance(rtol, atol)
        order = order_for(tolerance)
        lines, control = self.steps.series_lines(order), self.steps.control(order)
        if lines > LARGEST_UNROLLED:
            return "dop853"
        pays = not self.steps.poles and runge_kutta_pays(self._program.kernel("rhs"), lines, control, tolerance)
        return "dop853" if pays else "taylor"

    def source_of(self, method: str, rtol: float, atol: float) -> str:
        """See `Engine.source_of`: the text of a single run."""
        return self.steps.source(method, order_for(clipped_tolerance(rtol, atol)))

    def prepare(self, problem: IntegrationProblem, method: str) -> None:
        """See `Engine.prepare`."""
        _ = self._taylor(problem) if method == "taylor" else self._implicit if method == "radau" else self._explicit

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        if method == "taylor":
            from ..integrators import taylor_runs as series

            solution = series.integrate(self._taylor(problem), problem)
            assert solution is not None
            return solution
        if method == "radau":
            from ..integrators import implicit_loop as implicit

            return implicit.integrate(self._implicit, problem, self._multipliers(problem))
        from ..integrators import explicit_loop as explicit

        run = explicit.integrate(self._explicit, _pair(method), problem)
        assert isinstance(run, Solution)
        return run

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """See `Engine.integrate_automatic`: a run that proves stiff is repeated by "radau"."""
        reason = ""

        def watch(t: float, y: FloatArray, step: float) -> bool:
            from ..integrators.stiffness import radau_pays, still_stiff

            nonlocal reason
            rate = still_stiff(self._rates(problem), t, y, abs(problem.t1 - t), step)
            if rate:
                reason = radau_pays(problem, t, y, step, rate, self._radau, self._operations)
            return bool(reason)

        if method == "taylor":
            from ..integrators import taylor_runs as series

            solution = series.integrate(self._taylor(problem), problem, watch)
            return self._implicit_run(problem, reason) if solution is None else (solution, method, "")
        if method != "dop853":
            return super().integrate_automatic(problem, method)
        from ..integrators import explicit_loop as explicit

        tried = explicit.integrate(self._explicit, _pair(method), problem, stop_if_stiff=True)
        if isinstance(tried, Solution):
            return tried, method, ""
        if watch(tried.t, tried.y, tried.step):
            return self._implicit_run(problem, reason)
        return self.integrate(problem, method), method, ""

    def _radau(self, problem: IntegrationProblem) -> Solution:
        return self.integrate(problem, "radau")

    def _implicit_run(self, problem: IntegrationProblem, reason: str) -> tuple[Solution, str, str]:
        return self._radau(problem), "radau", reason

    def fit(self, problem: IntegrationProblem, method: str) -> tuple[str, str]:
        """See `Engine.fit`."""
        from ..integrators.stiffness import fitting

        return fitting(problem, method, self._rates(problem), self.integrate, self._operations)

    def _rates(self, problem: IntegrationProblem) -> Rates:
        course = self.course(problem)
        return lambda t, y: interpret_rows(self._program.kernel("rhs"), t, y, constants_at(course, t))

    @property
    def _operations(self) -> int:
        """Number of operations of a right-hand side."""
        return len(self._program.kernel("rhs").body)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`: a few steps at first, ever more later."""
        from .step_blocks import growing_step_blocks

        self.prepare(problem, method)
        yield from growing_step_blocks(lambda part: self.integrate(part, method), problem, 1)

    parallel: ClassVar[bool] = True

    def sweeper(
        self, cases: CaseColumns, method: str, result: BlockResult, constants: FloatArray, share: int
    ) -> CaseRun | None:
        """See `Engine.sweeper`: explicit steps run in lanes, refilled as cases end."""
        n = self._sizes["rhs"]
        if method == "radau" or not n:
            return None
        watched = None if cases.watch is None or not cases.watch.along else cases.watch
        n_times, lanes = len(cases.t_eval), self.steps.lanes
        dense = n_times > 0 or watched is not None or cases.recorded > 0
        position, velocity = (self.steps.kernel(name, lanes) for name in ("project_position", "project_velocity"))
        if cases.inputs is not None and (
            (watched is not None and watched.reads_inputs) or (n_times and (position or velocity))
        ):
            return None  # events of inputs, and projected samples, need the inputs within the step
        from .llvm.advance_lanes import advance_lanes
        from .llvm.check_inputs import check_inputs
        from .llvm.sweeps import SweepShape, case_run

        with_series = 0
        if watched is not None and watched.smooth and method == "taylor" and not (position or velocity):
            with_series = len(watched.events)
        codes, memory, degree, settings = self._stepping(
            method,
            cases.rtol,
            cases.atol,
            lanes,
            dense=dense,
            bounded=cases.bounded,
            watched=watched if with_series else None,
        )
        nothing_each_step = watched is None or (with_series > 0 and not n_times and not watched.kinds)
        nothing_each_step = nothing_each_step and not cases.recorded
        advance = advance_lanes(lanes) if nothing_each_step and not (position or velocity) else 0
        prepare, start = self.steps.prepare(lanes), self.steps.start(cases.start, lanes)
        shape = SweepShape(lanes, n, self._sizes["prepare"], degree, memory, share, dense, with_series)
        return case_run(
            (*codes, position, velocity, prepare, start, advance, check_inputs(lanes)),
            shape,
            settings,
            cases,
            result,
            constants,
            self._events_compiled(watched, method, (degree, memory), lanes, with_series),
            watched is not None or cases.recorded > 0,
        )

    def prepared(
        self, problem: IntegrationProblem, method: str, constants: Callable[[FloatArray], FloatArray]
    ) -> Prepared:
        """See `Engine.prepared`."""
        if method == "radau":
            return super().prepared(problem, method, constants)
        from .llvm.prepared import prepared_run

        sizes = (self._sizes["rhs"], self._parameters, self._sizes["prepare"])
        codes, memory, settings = self._codes_of_one(method, problem.rtol, problem.atol)
        return prepared_run((self.steps.prepare(), *codes), sizes, memory, settings, problem, self.steps)

    def foreign(
        self, method: str, tolerances: tuple[float, float], limits: tuple[float, int], version: tuple[int, int]
    ) -> ForeignCode:
        """Return the handler of runs that XLA calls, by an explicit method; see `dalembert.codegen.llvm.foreign`."""
        from .llvm.foreign import foreign_code

        codes, memory, settings = self._codes_of_one(method, *tolerances)
        layout = self._program.layout
        sizes = (self._sizes["rhs"], layout.constants or len(layout.parameters), memory)
        return foreign_code((0, *codes), sizes, settings, limits, version, self.steps)

    def foreign_batch(
        self, method: str, tolerances: tuple[float, float], interface: Interface, *, recorded: bool
    ) -> ForeignCode:
        """Return the handler of batches that XLA calls; see `dalembert.codegen.llvm.foreign_batch`.

        Of the tolerances, Taylor steps have their order.
        """
        from .llvm.advance_lanes import advance_lanes
        from .llvm.check_inputs import check_inputs
        from .llvm.foreign_batch import BatchSizes, foreign_batch

        lanes, layout = self.steps.lanes, self._program.layout
        codes, memory, _, settings = self._stepping(method, *tolerances, lanes, dense=False)
        position, velocity = (self.steps.kernel(name, lanes) for name in ("project_position", "project_velocity"))
        advance = 0 if recorded or position or velocity else advance_lanes(lanes)
        kernels = SweepKernels(*codes, position, velocity, 0, 0, advance, check_inputs(lanes))
        constants = layout.constants or len(layout.parameters)
        sizes = BatchSizes(lanes, self._sizes["rhs"], constants, memory, 2 + len(settings))
        return foreign_batch(kernels, sizes, recorded, interface, self.steps)

    def _codes_of_one(
        self, method: str, rtol: float, atol: float
    ) -> tuple[tuple[int, int, int, int], int, list[float]]:
        """Return addresses of steps of one case, of their start and projections, how much they remember and read."""
        codes, memory, _, settings = self._stepping(method, rtol, atol, 1, dense=False)
        position, velocity = (self.steps.kernel(name) for name in ("project_position", "project_velocity"))
        return (*codes, position, velocity), memory, settings

    def start_code(self, start: Start) -> StartCode | None:
        """See `Engine.start_code`."""
        steps = self.steps
        if not steps.compiles_starts:
            return None
        from .llvm.starts import start_code

        sizes = (self._parameters, self._sizes["prepare"], len(start.given), len(start.kernel.outputs))
        return start_code(steps.prepare(), steps.start(start, 1), sizes, steps)

    def _stepping(
        self,
        method: str,
        rtol: float,
        atol: float,
        lanes: int,
        *,
        dense: bool,
        bounded: bool = False,
        watched: EventCode | None = None,
    ) -> tuple[tuple[int, int], int, int, list[float]]:
        """Return the addresses of a step and of what precedes the first, how much it remembers, degree and settings.

        With `watched` a Taylor step writes the series of these events too. If `bounded`, the error of polynomials of
        Runge-Kutta steps counts, too.
        """
        if method == "taylor":
            order, floor = order_for(clipped_tolerance(rtol, atol)), scale_floor(rtol, atol)
            if watched is not None:
                step = self.steps.with_event_series(watched.watch.joint, len(watched.events), order, lanes)
                return (step, 0), 0, order, [floor]
            return (self.steps.taylor(order, lanes, dense=dense), 0), 0, order, [floor]
        tableau = _pair(method, bounded=bounded)
        memory = memory_size(self._sizes["rhs"], self.steps.carried)
        codes = self.steps.attempt(tableau, lanes, dense=dense)
        return codes, memory, tableau.degree, [rtol, max(atol, SMALLEST_SCALE)]

    def _events_compiled(
        self, code: EventCode | None, method: str, shape: tuple[int, int], lanes: int, with_series: int
    ) -> EventKernels:
        """Return compiled events, for steps of a method with polynomials and a memory of that shape.

        So many of them have series that the steps write: all or none.
        """
        if code is None:
            return no_events()
        if len(self._event_kernels) >= _MOST_EVENT_KERNELS:
            self._event_kernels.clear()

        def make() -> EventKernels:
            from .event_kernels import event_kernels

            tableau = None if method == "taylor" else _pair(method)
            return event_kernels(self.steps, code, tableau, (self._sizes["rhs"], *shape), lanes, with_series)

        return computed_once(self._event_kernels, (code, method, shape, lanes, with_series), make)

    def _kernels(self) -> list[int]:
        return [self.steps.kernel(name) for name in ("rhs", "project_position", "project_velocity", "knots")]

    @once_property
    def _explicit(self) -> ExplicitCode:
        from ..integrators.explicit_loop import ExplicitCode

        return ExplicitCode(loop_named("explicit_loop"), *self._kernels())

    @once_property
    def _implicit(self) -> ImplicitCode:
        from ..integrators.implicit_loop import ImplicitCode

        loop = loop_named("implicit_loop")
        if "stages" in self._sizes:
            states, knots = len(self._program.layout.states), self.steps.kernel("knots")
            stages = self.steps.kernel("stages"), *self.steps.derivative("stages")
            return ImplicitCode(loop, *stages, states=states, knots=knots)
        rhs, *projections = self._kernels()
        return ImplicitCode(loop, rhs, *self.steps.derivative("rhs"), *projections)

    def _multipliers(self, problem: IntegrationProblem) -> FloatArray | None:
        """Return the multipliers (k,) at the start, where the implicit method has any."""
        if "stages" not in self._sizes:
            return None
        kernel = self._program.kernel("multipliers")
        return interpret_rows(kernel, np.array([problem.t0]), problem.y0[np.newaxis], problem.constants)[0]

    def _taylor(self, problem: IntegrationProblem) -> StepCode:
        from ..integrators.taylor_runs import StepCode

        order = order_for(clipped_tolerance(problem.rtol, problem.atol))
        found = self._taylor_codes.get(order)
        if found is not None:
            return found

        def make() -> StepCode:
            position, velocity = (self.steps.kernel(name) for name in ("project_position", "project_velocity"))
            step = self.steps.taylor(order, 1, dense=True)
            return StepCode(loop_named("taylor_loop"), order, step, position, velocity, self.steps.angles)

        return computed_once(self._taylor_codes, order, make)


def _pair(name: str, *, bounded: bool = False) -> Tableau:
    """Return a Runge-Kutta pair by its name; imported here, because checking all pairs takes time."""
    from ..methods import tableaus

    pair = next(tableau for tableau in tableaus.TABLEAUS if tableau.name == name)
    return tableaus.bounded(pair) if bounded else pair


def default_source(program: Program, steps: KernelLibrary, methods: Iterable[str]) -> str:
    """Return the text of what runs by default, of these methods."""
    engine = CompiledEngine(program, steps)
    rtol, atol = DEFAULT_TOLERANCES
    return engine.source_of(engine.automatic(tuple(methods), rtol, atol), rtol, atol)
