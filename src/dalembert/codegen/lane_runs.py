"""Runs of one program by the loop over lanes: of many cases, of one whose steps are recorded, of batches in XLA."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..events.event_code import EventCode
from ..lanes.cases import BlockResult, CaseColumns
from ..lanes.sweep_arguments import KeptStarts, SweepKernels
from ..lanes.workspace import EventKernels
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_OF_REST, SMALLEST_OF_TIME
from ..once import BoundedTable, computed_once, once
from ..options import DEFAULT_TOLERANCES
from ..steps.method_choice import EXPLICIT_STEPS
from ..steps.problem import IntegrationProblem
from ..subset.arguments import NO_CODE, OwnedAddress
from .kernel_code import INTERPRETED, KernelCode
from .library import KernelLibrary
from .llvm.assembly import LoadedCode
from .llvm.loops import library_code
from .llvm.sweep_memory import SweepRunner
from .llvm.sweeps import SweepShape
from .llvm.target import bits, constant, suffix, vector
from .rendering import render
from .runs import CaseRun
from .steppers import Stepper, Steppers

if TYPE_CHECKING:
    from ..events.recorded_motion import RecordedCase
    from ..ir.program import Layout
    from ..loops.screened_starts import StartKernels
    from ..reduction.starting import Start
    from .llvm.foreign_batch import ForeignCode, Interface
    from .llvm.recorded import RecordedLane
    from .llvm.screens import RankScreen, StartSizes, StiffnessScreen


def advance_lanes_assembly(lanes: int) -> str:
    """Return a module that defines ``i64 advance_lanes(ptr clock, ptr step, ptr tally, ptr settings, ptr limits)``.

    It moves the time of every lane whose step was made and neither ends the case nor passes the next time to record,
    counts an attempt, and sets the largest next step. The lanes where more is to be done are left as they are, and
    are the bits of the number that it returns (see `dalembert.loops.lane_loop`).
    """
    variables = {
        "lanes": lanes,
        "third_row": 2 * lanes,
        "vector": vector(lanes),
        "flags": vector(lanes, "i1"),
        "bits": bits(lanes),
        "suffix": suffix(lanes),
        "zero": constant(0.0, lanes),
        "one": constant(1.0, lanes),
        "smallest_of_time": constant(SMALLEST_OF_TIME, lanes),
        "smallest_of_rest": constant(SMALLEST_OF_REST, lanes),
    }
    return render("llvm/advance_lanes.ll.j2", variables)


@once
def _advance_code(lanes: int) -> LoadedCode:
    return library_code(f"advance_lanes_{lanes}", lambda: advance_lanes_assembly(lanes))


def advance_lanes(lanes: int) -> OwnedAddress:
    """Return the code for so many lanes."""
    return _advance_code(lanes).address("advance_lanes")


# Check of the initial values of cases, in all lanes at once.


def check_inputs_assembly(lanes: int) -> str:
    """Return a module that defines ``i64 check_inputs(ptr rows, i64 plain, i64 checks, i64, i64)``.

    The lanes where the first `plain` rows and the `checks` behind them are finite, and in these the magnitude of every
    other number is at most the number in the next row, are the bits of what it returns.
    """
    variables = {
        "lanes": lanes,
        "vector": vector(lanes),
        "flags": vector(lanes, "i1"),
        "bits": bits(lanes),
        "suffix": suffix(lanes),
        "zero": constant(0.0, lanes),
    }
    return render("llvm/check_inputs.ll.j2", variables)


@once
def _check_code(lanes: int) -> LoadedCode:
    return library_code(f"check_inputs_{lanes}", lambda: check_inputs_assembly(lanes))


def check_inputs(lanes: int) -> OwnedAddress:
    """Return the code for so many lanes."""
    return _check_code(lanes).address("check_inputs")


_MOST_LANES = 16
"""Sets of events and tolerances of which the memory of single runs is cached, and kinds of cases of sweeps."""


@final
class LaneRuns:
    """Runs of one program in lanes.

    Parameters
    ----------
    library : KernelLibrary
    code : KernelCode
        Of the kernels of the program.
    steppers : Steppers
        Of the steps of the program.
    layout : Layout
        Of the program.
    """

    def __init__(self, library: KernelLibrary, code: KernelCode, steppers: Steppers, layout: Layout) -> None:
        self._library, self._code, self._steppers, self._layout = library, code, steppers, layout
        self._recorded_lanes: BoundedTable[tuple[EventCode, str, float, float, float], list[RecordedLane]]
        self._recorded_lanes = BoundedTable(_MOST_LANES)
        self._looked = self._ranks_looked = 0
        self._screens: BoundedTable[int, StiffnessScreen] = BoundedTable(_MOST_LANES)
        self._rank_screens: BoundedTable[tuple[int, tuple[int, ...]], RankScreen] = BoundedTable(_MOST_LANES)
        self._runners: BoundedTable[tuple[Any, ...], tuple[Start | None, EventCode | None, SweepRunner]]
        self._runners = BoundedTable(_MOST_LANES)

    def _kernels(
        self,
        stepper: Stepper,
        lanes: int,
        *,
        prepare: OwnedAddress = NO_CODE,
        start: OwnedAddress = NO_CODE,
        advance: bool = False,
    ) -> SweepKernels:
        """Return what the loop calls; where steps `advance`, those without projections are accepted in all lanes."""
        projections = self._steppers.projections(lanes)
        accept = advance_lanes(lanes) if advance and not any(projections) else NO_CODE
        return SweepKernels(*stepper.codes, *projections, prepare, start, accept, check_inputs(lanes))

    def cases(self, cases: CaseColumns, method: str, result: BlockResult, kept: KeptStarts, share: int) -> CaseRun:
        """Return a run of cases in lanes, refilled as cases end; see `Engine.sweeper`."""
        watched = None if cases.watch is None or not cases.watch.along else cases.watch
        # where something is looked at in each step, and whether that is more than the samples
        each_step = cases.recorded > 0, cases.part is not None
        sampled = len(cases.t_eval) > 0
        key = method, cases.rtol, cases.atol, id(cases.start), id(watched), sampled, *each_step
        found = self._runners.get(key)
        if found is None or found[0] is not cases.start or found[1] is not watched:
            made = self._runner(cases, method, watched)
            found = self._runners[key] = cases.start, watched, made
        lanes = found[2].shape.lanes
        if cases.inputs is not None:
            cases = replace(cases, inputs=cases.inputs.compiled(lambda sides: self._library.kernel(sides.name, lanes)))
        if cases.stops is not None:
            cases = replace(cases, stops=self._code.of_stops(cases.stops, lanes))
        return found[2].run(cases, result, kept, share)

    def _runner(self, cases: CaseColumns, method: str, watched: EventCode | None) -> SweepRunner:
        """Return what runs cases like these."""
        sampled, sizes, implicit = len(cases.t_eval) > 0, self._code.sizes, method == "radau"
        alone = cases.recorded > 0 and cases.part is None
        lanes = 1 if alone else self._library.lanes  # no empty lanes, and less to compile
        each_step = cases.recorded > 0 or cases.part is not None
        dense = sampled or watched is not None or each_step
        with_series = 0
        if watched is not None and watched.smooth and method == "taylor" and not any(self._steppers.projections(lanes)):
            with_series = len(watched.events)
        tolerances, series_of = (cases.rtol, cases.atol), watched if with_series else None
        located = watched is not None and bool(watched.events)  # on polynomials of steps
        stepper = self._steppers.stepper(method, tolerances, lanes, dense=dense, bounded=located, watched=series_of)
        nothing_each_step = watched is None or not sampled
        nothing_each_step = nothing_each_step and not cases.recorded and (watched is not None or not each_step)
        nothing_each_step = nothing_each_step and not implicit
        assert cases.start is not None
        prepare, start = self._library.prepare(lanes), self._library.start(cases.start, lanes)
        of_step = sizes["rhs"], sizes["prepare"], stepper.degree, stepper.memory
        return SweepRunner(
            self._kernels(stepper, lanes, prepare=prepare, start=start, advance=nothing_each_step),
            SweepShape(lanes, *of_step, dense, with_series),
            stepper,
            self._steppers.events(watched, method, stepper, lanes, with_series),
            watched=watched is not None or each_step or implicit,
        )

    def surely_not_stiff(self, cases: CaseColumns, numbers: Sequence[int], tried: str | None, screened: bool) -> bool:
        """Return whether a screen, or a trial by a method, finds that no motion from these cases is stiff.

        The screen comes first where it is compiled: by sweeps whose cases take many steps, and have no longer ones.
        """
        ready = screened and self._looked >= INTERPRETED
        if ready and self._decay_slowly(cases, numbers):
            return True
        if tried is not None and self.end_soon(cases, numbers, tried):
            return True
        return screened and not ready and self._decay_slowly(cases, numbers)

    def end_soon(self, cases: CaseColumns, numbers: Sequence[int], method: str) -> bool:
        """Return whether the cases of these numbers end within `EXPLICIT_STEPS` attempts, so that none is stiff."""
        some = cases.some(numbers)
        some.max_steps = min(cases.max_steps, EXPLICIT_STEPS)
        tried = BlockResult.empty(some.count, self._code.sizes["rhs"], len(some.t_eval))
        if some.watch is not None:
            tried.happened, tried.totals = tried.at_start(some.count, len(some.watch.events), some.watch.kinds)
        self.cases(some, method, tried, KeptStarts.nothing(), some.count).work()
        return not np.any(tried.ends[:, 1] == Status.MAX_STEPS)

    def _decay_slowly(self, cases: CaseColumns, numbers: Sequence[int]) -> bool:
        """Return whether a screen finds that the cases of these numbers start, and no mode can decay so fast."""
        if self._looked < INTERPRETED:
            self._looked += 1
            return False
        screen = self._screens.get(id(cases.start))
        if screen is None or screen.start is not cases.start:
            from .llvm.screens import StiffnessScreen

            start, library = _start_of(cases), self._library

            def kernels() -> tuple[StartKernels, OwnedAddress]:
                return self._start_kernels(start), library.kernel("rhs", library.lanes)

            screen = self._screens[id(start)] = StiffnessScreen(start, kernels, self._start_sizes)
        return screen(cases, numbers)

    def surely_independent(self, cases: CaseColumns, rows: Sequence[int]) -> bool:
        """See `Engine.surely_independent`."""
        if self._ranks_looked < INTERPRETED:
            self._ranks_looked += 1
            return False
        key = id(cases.start), tuple(rows)
        screen = self._rank_screens.get(key)
        if screen is None or screen.start is not cases.start:
            from .llvm.screens import RankKernels, RankScreen

            start, library, sizes, layout = _start_of(cases), self._library, self._code.sizes, self._layout
            lanes, by_rates = library.lanes, "mass_matrix" not in sizes

            def kernels() -> RankKernels:
                codes = self._start_kernels(start), library.kernel("expand", lanes)
                masses = library.kernel("momenta" if by_rates else "mass_matrix", lanes)
                return RankKernels(*codes, library.kernel("constraint_jacobian", lanes), masses, by_rates)

            of_rows = sizes["expand"], len(layout.constraints)
            angles = [name in layout.angles for name in layout.coordinates]
            screen = RankScreen(start, kernels, self._start_sizes, *of_rows, angles, rows)
            self._rank_screens[key] = screen
        return screen(cases)

    def _start_kernels(self, start: Start) -> StartKernels:
        from ..loops.screened_starts import StartKernels

        library, lanes = self._library, self._library.lanes
        return StartKernels(library.prepare(lanes), library.start(start, lanes), check_inputs(lanes))

    @property
    def _start_sizes(self) -> StartSizes:
        from .llvm.screens import StartSizes

        sizes = self._code.sizes
        return StartSizes(self._library.lanes, sizes["rhs"], len(self._layout.parameters), sizes["prepare"])

    def watched_steps(self, problem: IntegrationProblem, method: str, watch: EventCode) -> tuple[Stepper, EventKernels]:
        """Return the steps of single runs with events, and the events."""
        stepper = self._steppers.stepper(method, (problem.rtol, problem.atol), 1, dense=True, bounded=True)
        return stepper, self._steppers.events(watch, method, stepper, 1, 0, tested=False)

    def recorded(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
    ) -> RecordedCase:
        """Return the records of a run with events, in one lane; see `Engine.recorded`."""
        again = carried is None and problem.inputs is None and problem.first_step is None
        kept: list[RecordedLane] = []
        if again:
            like = watch, method, problem.rtol, problem.atol, problem.max_step
            kept = computed_once(self._recorded_lanes, like, list)
        try:
            lane = kept.pop()
        except IndexError:
            lane = self.recorded_lane(problem, method, watch, carried)
        run = lane.run(problem)
        if again:
            kept.append(lane)
        return run

    def recorded_lane(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
    ) -> RecordedLane:
        """Return the memory for runs like a problem."""
        from .llvm.recorded import RecordedLane

        stepper, events = self.watched_steps(problem, method, watch)
        own = self._code.of_problem(problem)
        kernels = self._kernels(stepper, 1, prepare=NO_CODE if own.stops is None else own.stops.prepare)
        sizes = self._code.sizes["rhs"], len(problem.constants)
        shape = SweepShape(1, *sizes, stepper.degree, stepper.memory, dense=True)
        return RecordedLane(kernels, shape, stepper, own, watch, events, carried)

    def foreign_batch(
        self, method: str, order: int, constants: int, interface: Interface, *, recorded: bool, alone: bool
    ) -> ForeignCode:
        """Return the handler of runs with so many constants that XLA calls; see `CompiledEngine.foreign_batch`."""
        from .llvm.foreign_batch import BatchSizes, foreign_batch

        lanes = 1 if alone else self._library.lanes
        stepper = self._steppers.stepper(method, DEFAULT_TOLERANCES, lanes, dense=False, order=order)
        kernels = self._kernels(stepper, lanes, advance=not recorded)
        sizes = BatchSizes(lanes, self._code.sizes["rhs"], constants, stepper.memory, 2 + len(stepper.settings))
        return foreign_batch(kernels, sizes, recorded, interface)


def _start_of(cases: CaseColumns) -> Start:
    assert cases.start is not None
    return cases.start
