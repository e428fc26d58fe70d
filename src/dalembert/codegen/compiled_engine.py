"""The engine of backends that compile kernels to machine code, which compiled integrator loops call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseColumns
from ..lanes.sweep_arguments import SweepKernels
from ..lanes.workspace import aligned
from ..once import BoundedTable, computed_once, once_property
from ..options import DEFAULT_TOLERANCES
from ..steps.method_choice import runge_kutta_pays
from ..steps.problem import IntegrationProblem, Solution
from ..steps.row_loops import KernelRowsArguments
from ..stops.segments import constants_at
from ..stops.stops import StopAction
from ..subset.addresses import NO_CODE, OwnedAddress
from ..transforms.taylor import clipped_tolerance, order_at, order_for
from .base import Engine
from .host_code import landing_code, raise_failure
from .library import LARGEST_UNROLLED, MOST_FURTHER, KernelLibrary
from .llvm.loops import loop_named
from .runs import CaseRun, Prepared, StartCode
from .steppers import Stepper, Steppers, pair_named

if TYPE_CHECKING:
    from pathlib import Path

    from ..events.event_code import EventCode
    from ..events.recorded_motion import RecordedCase
    from ..lanes.workspace import EventKernels
    from ..loops.taylor_runs import StepCode
    from ..reduction.starting import Start
    from ..steps.explicit_loop import ExplicitCode
    from ..steps.implicit_loop import ImplicitCode
    from ..steps.method_choice import Rates
    from .llvm.admission import Admission
    from .llvm.foreign_batch import ForeignCode, Interface
    from .llvm.recorded import RecordedLane

_MOST_LANES = 16
"""Sets of events and tolerances of which the memory of single runs is kept."""

METHODS: Mapping[str, str] = {
    "taylor": "Taylor series of an order chosen by the tolerance (Jorba and Zou)",
    "dop853": "explicit Runge-Kutta of order 8 (Hairer, Norsett and Wanner)",
    "tsit5": "explicit Runge-Kutta of order 5 (Tsitouras)",
    "radau": "implicit Runge-Kutta of order 5, for stiff scenes (Radau IIA; Hairer and Wanner)",
}
"""The methods of these backends by name, with descriptions."""


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
        self._extra_kernels: BoundedTable[tuple[int, int], tuple[Kernel, OwnedAddress]] = BoundedTable(MOST_FURTHER)
        self._taylor_codes: dict[int, StepCode] = {}
        self._recorded_lanes: BoundedTable[tuple[EventCode, str, float, float], list[RecordedLane]]
        self._recorded_lanes = BoundedTable(_MOST_LANES)
        self._steppers = Steppers(steps, self._sizes.get("rhs", 0))

    passes_stops: ClassVar[bool] = True

    @property
    def folder(self) -> Path | None:
        """See `Engine.folder`."""
        return self.steps.folder

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

    def _by_code(
        self, code: OwnedAddress, lanes: int, size: int, t: FloatArray, y: FloatArray, c: FloatArray
    ) -> FloatArray:
        """Return the outputs (k, size) of a compiled kernel at times (k,), states (k, n) and constants (k, n_c)."""
        out = np.empty((len(t), size))
        if len(t):
            room = [aligned(size, lanes) for size in (1, y.shape[1], c.shape[1], out.shape[1])]
            times, states, constants = (np.ascontiguousarray(a, np.float64) for a in (t, y, c))
            loop_named("kernel_rows")(KernelRowsArguments(code, times, states, constants, out, *room))
        return out

    def code(self, kernel: Kernel) -> tuple[OwnedAddress, int]:
        """See `Engine.code`."""
        return self._code(kernel, self.steps.lanes), self.steps.lanes

    def _code(self, kernel: Kernel, lanes: int) -> OwnedAddress:
        """Return the address of any kernel of (t, y, c) as code for so many lanes."""
        key = id(kernel), lanes  # the kernel is kept, so that no other can have its number
        return computed_once(self._extra_kernels, key, lambda: (kernel, self.steps.extra_kernel(kernel, lanes)))[1]

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """See `Engine.automatic`: Taylor steps, or a Runge-Kutta pair for long rates, kinks and roots at rest."""
        if "taylor" not in methods:
            return methods[0]
        if self.steps.nonsmooth or self.steps.singular_at_rest:
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
        return self.steps.source(method, order_at(rtol, atol))

    def prepare(self, problem: IntegrationProblem, method: str, watch: EventCode | None = None) -> None:
        """See `Engine.prepare`."""
        if watch is not None and self.records(method):
            _ = self._watched_steps(problem, method, watch), loop_named("event_lane_loop").call
            return
        _ = self._taylor(problem) if method == "taylor" else self._implicit if method == "radau" else self._explicit

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        compiled = self._with_codes(problem)
        if method == "taylor":
            solution = self._taylor(problem).integrate(compiled)
            assert solution is not None
            return solution
        if method == "radau":
            from ..steps import implicit_loop as implicit

            code, multipliers = self._implicit, self._multipliers(problem)
            if multipliers is not None and problem.inputs is not None:
                code = replace(code, multipliers=self.steps.kernel("multipliers"))
            return implicit.integrate(code, compiled, multipliers)
        from ..steps import explicit_loop as explicit

        pair = pair_named(method, bounded=problem.bounded)
        run = explicit.integrate(self._explicit, pair, compiled)
        assert isinstance(run, Solution)
        return run

    def _with_codes(self, problem: IntegrationProblem) -> IntegrationProblem:
        """Return a problem of one lane whose inputs have the code of `Program.knot_sides`, stops that of actions."""
        inputs, stops = problem.inputs, problem.stops
        if inputs is not None and inputs.sides is not None:
            problem = replace(problem, inputs=inputs.compiled(lambda sides: self.steps.kernel(sides.name)))
        if stops is None:
            return problem
        code = partial(self._action_code, lanes=1)
        return replace(problem, stops=stops.compiled(code, self.steps.prepare(), raise_failure))

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """See `Engine.integrate_automatic`: a run that proves stiff is repeated by "radau"."""
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
            solution = self._taylor(problem).integrate(self._with_codes(problem), watch)
            return self._implicit_run(problem, reason) if solution is None else (solution, method, "")
        if method != "dop853":
            return super().integrate_automatic(problem, method)
        from ..steps import explicit_loop as explicit

        tried = explicit.integrate(self._explicit, pair_named(method), self._with_codes(problem), stop_if_stiff=True)
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
        from ..steps.method_choice import fitting

        return fitting(problem, method, self._rates(problem), self.integrate, self._operations)

    def _rates(self, problem: IntegrationProblem) -> Rates:
        c = self.constants_along(problem)
        return lambda t, y: interpret_rows(self._program.kernel("rhs"), t, y, constants_at(c, t))

    @property
    def _operations(self) -> int:
        """Number of operations of a right-hand side."""
        return len(self._program.kernel("rhs").body)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`: a few steps at first, ever more later."""
        from .step_blocks import growing_step_blocks

        self.prepare(problem, method)
        yield from growing_step_blocks(lambda part: self.integrate(part, method), problem, 1)

    def records(self, method: str) -> bool:
        """See `Engine.records`: explicit steps, unless attempts of them would take seconds to compile."""
        return bool(self._sizes["rhs"]) and (method == "taylor" or (method != "radau" and self.steps.compiles_starts))

    def _watched_steps(
        self, problem: IntegrationProblem, method: str, watch: EventCode
    ) -> tuple[Stepper, EventKernels]:
        """Return the steps of runs with events, and the events."""
        stepper = self._steppers.stepper(method, (problem.rtol, problem.atol), 1, dense=True, bounded=True)
        return stepper, self._steppers.events(watch, method, stepper, 1, 0, tested=False)

    def recorded(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
    ) -> RecordedCase:
        """See `Engine.recorded`: explicit steps run in one lane of the loop over lanes."""
        if not self.records(method):
            return super().recorded(problem, method, watch, carried)
        again = carried is None and problem.inputs is None and problem.first_step is None
        lanes: list[RecordedLane] = []
        if again:
            lanes = computed_once(self._recorded_lanes, (watch, method, problem.rtol, problem.atol), list)
        try:
            lane = lanes.pop()
        except IndexError:
            lane = self._recorded_lane(problem, method, watch, carried)
        run = lane.run(problem)
        if again:
            lanes.append(lane)
        return run

    def _recorded_lane(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
    ) -> RecordedLane:
        """Return the memory for runs like a problem."""
        from .llvm.lane_kernels import check_inputs
        from .llvm.recorded import RecordedLane
        from .llvm.sweeps import SweepShape

        n = self._sizes["rhs"]
        stepper, events = self._watched_steps(problem, method, watch)
        own = self._with_codes(problem)
        prepare = NO_CODE if own.stops is None else own.stops.prepare
        kernels = SweepKernels(
            *stepper.codes, *self._steppers.projections(1), prepare, NO_CODE, NO_CODE, check_inputs(1)
        )
        shape = SweepShape(1, n, len(problem.constants), stepper.degree, stepper.memory, 1, dense=True)
        return RecordedLane(kernels, shape, stepper, own, watch, events, carried)

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
        each_step = cases.recorded > 0 or cases.part is not None
        dense = n_times > 0 or watched is not None or each_step
        projections = self._steppers.projections(lanes)
        projected = any(projections)
        from .llvm.lane_kernels import advance_lanes, check_inputs
        from .llvm.sweeps import SweepShape, case_run

        assert cases.start is not None

        with_series = 0
        if watched is not None and watched.smooth and method == "taylor" and not projected:
            with_series = len(watched.events)
        tolerances, series_of = (cases.rtol, cases.atol), watched if with_series else None
        located = watched is not None and bool(watched.events)  # on polynomials of steps
        stepper = self._steppers.stepper(method, tolerances, lanes, dense=dense, bounded=located, watched=series_of)
        nothing_each_step = watched is None or (with_series > 0 and not n_times and not watched.kinds)
        nothing_each_step = nothing_each_step and not cases.recorded and (watched is not None or not each_step)
        advance = advance_lanes(lanes) if nothing_each_step and not projected else NO_CODE
        prepare, start = self.steps.prepare(lanes), self.steps.start(cases.start, lanes)
        if cases.inputs is not None:
            cases = replace(cases, inputs=cases.inputs.compiled(lambda sides: self.steps.kernel(sides.name, lanes)))
        if cases.stops is not None:
            cases = replace(cases, stops=cases.stops.compiled(partial(self._action_code, lanes=lanes)))
        sizes = lanes, n, self._sizes["prepare"], stepper.degree, stepper.memory
        shape = SweepShape(*sizes, share, dense, with_series)
        return case_run(
            SweepKernels(*stepper.codes, *projections, prepare, start, advance, check_inputs(lanes)),
            shape,
            stepper.settings,
            cases,
            result,
            constants,
            self._steppers.events(watched, method, stepper, lanes, with_series),
            watched is not None or each_step,
        )

    def _action_code(self, action: StopAction, lanes: int) -> OwnedAddress:
        """Return the code of an action at stops."""
        if action.kernel is not None:
            return self._code(action.kernel, lanes)
        return landing_code(action, self._sizes["rhs"], self._sizes["prepare"], lanes)

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

        sizes = (self._sizes["rhs"], self._parameters, self._sizes["prepare"])
        stepper = self._steppers.stepper(method, (problem.rtol, problem.atol), 1, dense=False)
        tests = NO_CODE if admission is None else admission.code.address
        kernels = PreparedKernels(self.steps.prepare(), *stepper.codes, *self._steppers.projections(1), tests)
        return prepared_run(kernels, sizes, stepper.memory, stepper.settings, self._with_codes(problem), admission)

    def foreign_batch(
        self, method: str, order: int, interface: Interface, *, recorded: bool, alone: bool
    ) -> ForeignCode:
        """Return the handler of runs that XLA calls; see `dalembert.codegen.llvm.foreign_batch`.

        Taylor steps have this order. A run `alone` has one lane.
        """
        from .llvm.foreign_batch import BatchSizes, foreign_batch
        from .llvm.lane_kernels import advance_lanes, check_inputs

        lanes, layout = 1 if alone else self.steps.lanes, self._program.layout
        stepper = self._steppers.stepper(method, DEFAULT_TOLERANCES, lanes, dense=False, order=order)
        projections = self._steppers.projections(lanes)
        advance = NO_CODE if recorded or any(projections) else advance_lanes(lanes)
        kernels = SweepKernels(*stepper.codes, *projections, NO_CODE, NO_CODE, advance, check_inputs(lanes))
        constants = layout.constants or len(layout.parameters)
        sizes = BatchSizes(lanes, self._sizes["rhs"], constants, stepper.memory, 2 + len(stepper.settings))
        return foreign_batch(kernels, sizes, recorded, interface)

    def start_code(self, start: Start) -> StartCode | None:
        """See `Engine.start_code`."""
        steps = self.steps
        if not steps.compiles_starts:
            return None
        from .llvm.prepared import start_code

        sizes = (self._parameters, self._sizes["prepare"], len(start.given), len(start.kernel.outputs))
        return start_code(steps.prepare(), steps.start(start, 1), sizes)

    def _kernels(self) -> list[OwnedAddress]:
        return [self.steps.kernel("rhs"), *self._steppers.projections(1), self.steps.kernel("knots")]

    @once_property
    def _explicit(self) -> ExplicitCode:
        from ..steps.explicit_loop import ExplicitCode

        return ExplicitCode(loop_named("explicit_loop"), *self._kernels())

    @once_property
    def _implicit(self) -> ImplicitCode:
        from ..steps.implicit_loop import ImplicitCode

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
        order = order_at(problem.rtol, problem.atol)
        found = self._taylor_codes.get(order)
        if found is not None:
            return found

        def make() -> StepCode:
            from ..loops.taylor_runs import StepCode

            step = self.steps.taylor(order, 1, dense=True)
            return StepCode(loop_named("taylor_loop"), order, step, *self._steppers.projections(1), self.steps.angles)

        return computed_once(self._taylor_codes, order, make)


def default_source(program: Program, steps: KernelLibrary, methods: Iterable[str]) -> str:
    """Return the text of what runs by default, of these methods."""
    engine = CompiledEngine(program, steps)
    rtol, atol = DEFAULT_TOLERANCES
    return engine.source_of(engine.automatic(tuple(methods), rtol, atol), rtol, atol)
