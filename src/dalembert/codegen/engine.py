"""Interface of a loaded module: its kernels, and the integrators that call them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..lanes.cases import BlockResult, CaseBlock, CaseColumns
from ..methods.status import Status
from ..once import BoundedTable, computed_once, once_property
from ..steps.problem import IntegrationProblem, Solution
from ..steps.projection import projected
from ..stops.segments import Segments
from ..subset.arguments import OwnedAddress
from .host_code import HOST_LANES, interpreted_code
from .library import MOST_FURTHER
from .runs import CaseRun, Final, Prepared, PreparedStates, StartCode

if TYPE_CHECKING:
    from pathlib import Path

    from ..events.event_code import EventCode
    from ..events.recorded_motion import Occurrence, RecordedCase
    from ..lanes.sweep_arguments import KeptStarts
    from ..lanes.workspace import EventKernels
    from ..options import SolveOptions
    from ..reduction.starting import Start
    from ..scene.symbol_table import InputSymbol
    from .llvm.prepared import Admission
    from .runs import HostedRuns


class Engine(ABC):
    """A loaded module: kernels that can be called, and the integrators that call them."""

    def accept_as_static(self, kind: type) -> None:  # noqa: B027
        """Treat instances of a class as constants in the transformations of the backend, where it has any."""

    @property
    def folder(self) -> Path | None:
        """Where compiled code of the program is kept, None where nothing is."""
        return None

    @abstractmethod
    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs (k, n_out) of a kernel at times t (k,), states y (k, n) and constants c (n_c,)."""

    def rows(self, kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs (k, n_out) of any kernel of (t, y, c) at times (k,), states (k, n) and constants (k, n_c).

        Values that are not finite are kept.
        """
        return interpret_rows(kernel, t, y, c)

    def source_of(self, method: str, rtol: float, atol: float) -> str:
        """Return the text of what runs by a method at these tolerances; nothing where it is the module's own text."""
        return ""

    def constants_along(self, problem: IntegrationProblem) -> Any:
        """Return the constants along a run: those of the problem, or of its segments where they change."""
        if problem.stops is not None and problem.stops.along is not None:
            return problem.stops.along
        if problem.inputs is None:
            return problem.constants
        edges = np.array([problem.t0, problem.t1])
        return Segments(edges, problem.constants[np.newaxis], problem.inputs)

    passes_stops: ClassVar[bool] = False
    """Whether `integrate`, `sweeper` and `prepared` pass stops of a problem in place, and knots of its inputs."""

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """Return the method that "auto" takes at these tolerances; the first one unless an engine overrides this.

        `many` says that it is to run many cases at once.
        """
        return methods[0]

    def too_long_for_series(self, rtol: float, atol: float) -> int:
        """Return the lines of the recurrences of a Taylor step, written out, where "auto" takes none for them; or 0."""
        return 0

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """Return the solution by `method`, unless that turns out to be unfit: with the method taken, and why."""
        return self.integrate(problem, method), method, ""

    def fit(self, problem: IntegrationProblem, method: str) -> tuple[str, str]:
        """Return the method to take in place of `method` for problems like this one, and why."""
        return method, ""

    @property
    def tries_first(self) -> bool:
        """Whether some hundred explicit steps take less time than `fit`, so that runs are tried with these before."""
        return False

    def surely_not_stiff(self, cases: CaseColumns, numbers: Sequence[int], method: str | None) -> bool:
        """Return whether `fit` certainly keeps the method of the cases of these numbers.

        They are without inputs, conditions and stops, and are to be run by `method`; None where they are not run as
        they are. Where that would take longer to find out than `fit`, the answer is False.
        """
        return False

    def surely_independent(self, cases: CaseColumns, rows: Sequence[int]) -> bool:
        """Return whether all cases can start, and constraints of these numbers are independent by far in each.

        Cases are as for `surely_not_stiff`, and the answer is False where that would take longer to find out than by
        values of the Jacobian.
        """
        return False

    def keeps_signs(self, kernel: Kernel, block: CaseBlock, done: BlockResult) -> bool:
        """Return whether cases of a block have all succeeded, and a kernel certainly has the same signs at their ends.

        Where that would take longer to find out than by values of the kernel, the answer is False.
        """
        return False

    def prepare(self, problem: IntegrationProblem, method: str, watch: EventCode | None = None) -> None:  # noqa: B027
        """Compile what `integrate` will need for such a problem, or `recorded`, where that is still to be done."""

    @abstractmethod
    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """Return the solution of an initial value problem in the state of the formulation."""

    def integrate_watched(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None = None
    ) -> tuple[Solution, list[Occurrence]]:
        """Return the solution of a problem with events, and what occurred, in the order of time.

        Where a state jumps, accepted steps hold the time twice. `carried` (2 n_events,) are signs with which a motion
        continues after a stop (`EventWorkspace.carried`): expressions that change theirs by what happens at the stop
        occur at once. It gets the signs with which this part of the motion ends.
        """
        run = self.recorded(problem, method, watch, carried)
        settle = partial(projected, watch.program, self.constants_along(problem))
        return run.solution(problem, settle, right=self.controlled), run.occurrences(settle)

    def records(self, method: str) -> bool:
        """Whether a loop takes runs with events by a method to their ends, and records them on the way."""
        return False

    def recorded(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
    ) -> RecordedCase:
        """Return the records of a run with events; here blocks of its steps are searched.

        An engine that `records` them passes the stops of the problem.
        """
        from .step_blocks import recorded_in_blocks

        return recorded_in_blocks(self, problem, method, watch, carried)

    @once_property
    def block_events(self) -> BoundedTable[EventCode, EventKernels]:
        """Interpreted kernels of sets of events."""
        return BoundedTable(MOST_FURTHER)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """Yield the solution of a problem in blocks of steps, for callers that may stop early.

        Each has its accepted steps, from the end of the one before, and continuous output over them; the status of the
        last is that of the whole. Here it is one block.
        """
        yield self.integrate(problem, method)

    def prepared(
        self,
        problem: IntegrationProblem,
        method: str,
        constants: Callable[[FloatArray], FloatArray],
        admission: Admission | None = None,
    ) -> Prepared:
        """Return a prepared run; but for states and parameters everything is as in `problem`.

        `constants` gives c (n_c,) of parameters (n_p,); `admission` tests what the run is given.
        """

        def run(state: FloatArray, p: FloatArray) -> Final:
            c = constants(p)
            solution = self.integrate(replace(problem, y0=state, constants=c, t_eval=np.array([problem.t1])), method)
            return (solution.y[-1] if len(solution.y) else np.full_like(state, np.nan)), Status(solution.status)

        return PreparedStates(run, admission)

    cuts: ClassVar[bool] = False
    """Whether runs are cut in segments, also those without a state."""

    controlled: bool = False
    """Whether controllers act along runs, so that accepted steps hold the states behind their actions."""

    parallel: ClassVar[bool] = False
    """Whether `integrate_block` releases the interpreter, so that threads help."""

    whole_blocks: ClassVar[bool] = False
    """Whether cases are best handed to `integrate_block` as many at a time as there may be."""

    def sweeper(
        self, cases: CaseColumns, method: str, result: BlockResult, kept: KeptStarts, share: int
    ) -> CaseRun | None:
        """Return a run of cases that loads its own states and constants; None where the engine has no such run.

        Cases that cannot start get NaN and their status. What is `kept` of the starts is filled in. A thread takes
        `share` cases at a time.
        """
        return None

    def start_code(self, start: Start) -> StartCode | None:
        """Return the start of single runs as compiled code with the bits of interpreted kernels, None without any."""
        return None

    def code(self, kernel: Kernel) -> tuple[OwnedAddress, int]:
        """Return the address of any kernel of (t, y, c) as code that loops call, and its lanes.

        Here it is interpreted.
        """
        kept = computed_once(self._interpreted, id(kernel), lambda: (kernel, interpreted_code(kernel)))
        return kept[1], HOST_LANES

    @once_property
    def _interpreted(self) -> BoundedTable[int, tuple[Kernel, OwnedAddress]]:
        return BoundedTable(MOST_FURTHER)  # with the kernels, so that no other can have their numbers

    @property
    def for_segments(self) -> Engine:
        """The engine for a segment of a run, which ignores knots, breaks and controllers."""
        return self

    def after_start(self, problem: IntegrationProblem) -> IntegrationProblem:
        """Return a problem that events will cut into parts, after the actions at its start."""
        return problem

    def integrate_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """Write the results of many cases; here one after the other."""
        for i in range(len(block.y)):
            self.integrate_case(block, i, method, result)

    def integrate_case(self, block: CaseBlock, i: int, method: str, result: BlockResult) -> None:
        """Write the results of case i of a block, as `integrate` does it."""
        times = block.times(i)
        problem = block.problem(i, t_eval=np.append(block.t_eval[times], block.spans[i, 1]))
        if block.watch is not None:
            from .step_blocks import watched_case

            watched_case(self, block, i, problem, method, result)
            return
        solution = self.integrate(problem, method)
        end, last = (solution.t[-1], solution.y[-1]) if len(solution.t) else (problem.t0, problem.y0)
        if not solution.success and solution.end is not None and solution.last is not None:
            end, last = solution.end, solution.last
        result.y[i], result.ends[i] = last, (end, solution.status, solution.steps)
        recorded = result.samples[i, times]
        count = min(len(solution.y), len(recorded))
        recorded[:count] = solution.y[:count]


class FunctionEngine(Protocol):
    """An engine whose backend declares the capability `KERNEL_FUNCTIONS`."""

    @property
    def functions(self) -> Any:
        """The kernels as functions for users' own compiled code."""
        ...


class TracedEngine(Protocol):
    """An engine of functions that JAX traces, whose backend declares the capabilities for them."""

    @property
    def vector_field(self) -> Callable[[Any, Any, Any], Any]:
        """The rate of the state, a traced function of (t, y, args); those of equal programs are equal."""
        ...

    @property
    def state_functions(self) -> Any:
        """Traced functions of a state: energy, mass matrix and so on."""
        ...

    def solve_fn(
        self,
        start: Start | None,
        options: SolveOptions,
        inputs: tuple[InputSymbol, ...] = (),
        dependence: Start | None = None,
    ) -> Any:
        """Return a traced function that solves from given values, or from the state where `start` is None.

        `inputs` are those of the scene.
        """
        ...

    def hosted_solve_fn(
        self, start: Start | None, options: SolveOptions, hosted: HostedRuns, dependence: Start | None = None
    ) -> Any:
        """Return a traced function whose runs are left to the host: those with events, reductions or contacts."""
        ...
