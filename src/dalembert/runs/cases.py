"""Cases of a sweep: parameters, initial values and spans as given."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import Column, FloatArray, arrays_of, finite_rows, part_of
from ..errors import UnknownNameError, list_names
from ..ir.interpret import Rows, interpret, interpret_rows
from ..ir.program import DIRECTION, Program, directed_rates
from ..lanes.cases import CaseBlock, CaseColumns
from ..lanes.sweep_arguments import KeptStarts
from ..methods.status import Status
from ..reduction.starting import Start
from ..starts import inputs
from ..starts.input_values import GivenInputs
from ..steps.problem import IntegrationProblem
from ..stops.breakpoints import CaseBreaks
from ..stops.input_records import InputRecords
from .case_columns import Columns, case_readers, common_length
from .case_settings import CaseSettings, spans_of

if TYPE_CHECKING:
    from ..starts.initial_states import QuickStart


_NO_TIMES = np.empty(0)


@final
class Cases:
    """Parameters, initial values and spans of all cases, as given: one value for all, or one a case.

    They are `together` where one finite span serves all, whose `ends` are numbers, and `changing` where constants
    change along runs.
    """

    def __init__(
        self,
        program: Program,
        start: Callable[[Iterable[str]], Start],
        t_span: Any,
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        given: GivenInputs | None = None,
    ) -> None:
        layout = program.layout
        self.program = program
        self.records = None if given is None else given.records(layout, program.knot_sides)
        conditions = program.conditions
        self.changing = self.records is not None or (conditions is not None and conditions.decides)
        readers = case_readers(layout)
        lengths: set[int] = set()
        self._initial = readers.initial(initial, lengths)
        inputs.refuse_inputs(layout, parameters)
        self._parameters = readers.parameters(parameters, lengths)
        for name, value in layout.defaults.items():
            self._parameters.setdefault(name, float(value))
        if len(self._parameters) < len(layout.parameters):
            missing = [name for name in layout.parameters if name not in self._parameters]
            raise UnknownNameError(
                f"missing parameters: {list_names(missing)}. The scene needs: {list_names(layout.given)}."
            )
        first, last = spans_of(t_span)
        self.span = {"start": first, "end": last}
        self._whole: tuple[CaseSettings, CaseColumns] | None = None
        lengths.update([len(times) for times in (first, last) if times.size != 1])
        self.count = common_length(layout, lengths, self._parameters, self._initial, self.span)
        self.refused = readers.refused(self._initial, self._parameters)
        self._begin = first if self.refused is None else np.where(self.refused, np.nan, first)  # NaN is not run
        self._values: Columns = self._initial
        one = first.shape == last.shape == (1,)
        self.ends = ends = (float(first[0]), float(last[0])) if one else (math.nan, math.nan)
        self.together = math.isfinite(ends[0]) and math.isfinite(ends[1])
        if ends[1] < ends[0] if self.together else np.any(last < first):
            self._values = {**self._initial, DIRECTION: np.where(last < first, -1.0, 1.0)}
        self.start = start(self._values)

    @property
    def duration(self) -> float:
        """Duration of the longest run [s]."""
        return float(np.max(np.abs(self.span["end"] - self.span["start"])))

    @property
    def initial(self) -> dict[str, FloatArray]:
        """Initial values (1,) or (k,) by name."""
        return arrays_of(self._initial)

    @property
    def parameters(self) -> dict[str, FloatArray]:
        """Parameters (1,) or (k,) by name."""
        return arrays_of(self._parameters)

    @property
    def given(self) -> tuple[Columns, Columns]:
        """Initial values and parameters."""
        return self._initial, self._parameters

    def constants(self, block: slice) -> FloatArray:
        """Return the constants c (k, n_c) of a block of cases."""
        count = len(range(*block.indices(self.count)))
        names = self.program.layout.parameters
        p = np.empty((count, len(names)))
        for i, column in enumerate(self._parameter_columns(block)):
            p[:, i] = column
        self._decide(p, block)
        return inputs.prepare_rows(self.program, p)

    def parameters_of(self, block: slice) -> Columns:
        """Return the columns of parameters of a block of cases by name, as their runs take them."""
        return dict(zip(self.program.layout.parameters, self._parameter_columns(block), strict=True))

    def _parameter_columns(self, block: slice) -> tuple[Column, ...]:
        layout = self.program.layout
        columns = self._parts(map(self._parameters.__getitem__, layout.parameters), block)
        if layout.decay_rate is None:
            return columns
        place = layout.parameters.index(layout.decay_rate)
        backward = part_of(self.span["end"], block) < part_of(self.span["start"], block)
        return (*columns[:place], directed_rates(columns[place], backward), *columns[place + 1 :])

    def _decide(self, p: FloatArray, block: slice) -> None:
        """Set conditions in parameters p (k, n_p) to those of the first segment of each case."""
        conditions = self.program.conditions
        if conditions is None or not conditions.decides:
            return
        t0, t1 = (np.broadcast_to(part_of(self.span[end], block), len(p)) for end in ("start", "end"))
        conditions.decide_at(p, CaseBreaks.of(conditions, p, t0, t1).middles(np.arange(len(p)), t0))

    def constants_at(self, block: slice, t: FloatArray) -> FloatArray:
        """Return the constants (k m, n_c) of a block of cases at times (k, m) of each."""
        count, width = t.shape
        c, conditions = self.constants(block), self.program.conditions
        t0, t1 = (np.broadcast_to(part_of(self.span[end], block), count) for end in ("start", "end"))
        each = np.repeat(np.arange(count), width)
        if conditions is None or not conditions.decides:
            rows = np.repeat(c, width, axis=0)
        else:
            p = c[:, : len(self.program.layout.parameters)]
            breaks = CaseBreaks.of(conditions, p, t0, t1)
            p = np.repeat(p, width, axis=0)
            conditions.decide_at(p, breaks.middles(each, t.ravel()))
            rows = inputs.prepare_rows(self.program, p)
        records = self._records_of(block)
        if records is not None:
            forward, last = (t1 >= t0)[each], t.ravel() == t1[each]
            records.write(rows, t.ravel(), each, forward != last)
        return rows

    def _records_of(self, block: slice) -> InputRecords | None:
        """Return the inputs with knots of a block of cases, None without any."""
        return None if self.records is None else self.records.part(block, self.count)

    @property
    def plain(self) -> bool:
        """Whether the constants of a case are those of its parameters alone."""
        return self.records is None and self.program.conditions is None

    def columns(self, block: slice, settings: CaseSettings) -> CaseColumns:
        """Return a block of cases as they were given."""
        if not self._is_whole(block):
            return self._new_columns(block, settings)
        kept = self._whole  # the choice of the method and the run read the same
        if kept is None or kept[0] is not settings:
            kept = self._whole = settings, self._new_columns(block, settings)
        return kept[1]

    def set_parameter(self, name: str, values: FloatArray) -> None:
        """Give all cases another value (1,), or others (k,), of a parameter."""
        self._parameters[name], self._whole = values, None

    def _is_whole(self, block: slice) -> bool:
        return block.start == 0 and block.stop == self.count and block.step is None

    def _parts(self, columns: Iterable[Column], block: slice) -> tuple[Column, ...]:
        if self._is_whole(block):
            return tuple(columns)
        return tuple([part_of(values, block) for values in columns])

    def _new_columns(self, block: slice, settings: CaseSettings) -> CaseColumns:
        t_eval = _NO_TIMES if settings.t_eval is None else settings.t_eval
        return CaseColumns(
            self.count if self._is_whole(block) else len(range(*block.indices(self.count))),
            (part_of(self._begin, block), part_of(self.span["end"], block)),
            self._parameter_columns(block),
            self._parts(map(self._values.__getitem__, self.start.given), block),
            self.start,
            t_eval,
            settings.rtol,
            settings.atol,
            settings.max_step,
            settings.max_steps,
            settings.watch,
            self._records_of(block),
            carried=None if settings.carried is None else settings.carried[block],
            constants_at=partial(self.constants_at, block) if self.changing else None,
        )

    def block(
        self, block: slice, settings: CaseSettings, rows: Rows = interpret_rows, *, exact: bool = False
    ) -> tuple[CaseBlock, FloatArray]:
        """Return a block of cases ready to run, and the status of those that cannot (k,), -1 for the others.

        `rows` evaluates the start. With `exact` each starts from the very bits of the case alone, whose sines are not
        those of arrays.
        """
        c = self.constants(block)
        count, size = len(c), len(self.program.layout.state)
        spans = self._spans(block, count)
        given = self._given(block, count)
        out = rows(self.start.kernel, spans[:, 0], given, c)
        finite = finite_rows(c) & finite_rows(spans) & finite_rows(given)
        if exact:
            self._refine(c, spans[:, 0], given, out, np.flatnonzero(finite & finite_rows(out)))
        checks = out[:, size:]
        started = finite_rows(out)
        for residual, tolerance in zip(checks.T[::2], checks.T[1::2], strict=True):
            started &= np.abs(residual) <= tolerance
        status = np.where(started, -1.0, float(Status.INITIAL_STATE))
        status[~finite] = float(Status.NON_FINITE)
        if self.refused is not None:
            status[self.refused[block]] = float(Status.ASSUMPTION)
        return self._started(block, settings, np.ascontiguousarray(out[:, :size]), c), status

    def _started(self, block: slice, settings: CaseSettings, y: FloatArray, c: FloatArray) -> CaseBlock:
        """Return a block of cases with their states and constants."""
        return CaseBlock(
            y,
            c,
            self._spans(block, len(y)),
            _NO_TIMES if settings.t_eval is None else settings.t_eval,
            settings.rtol,
            settings.atol,
            settings.max_step,
            settings.max_steps,
            settings.watch,
            self._records_of(block),
            None if settings.carried is None else settings.carried[block],
        )

    def _spans(self, block: slice, count: int) -> FloatArray:
        """Return starts and ends (count, 2) of a block of cases; a start is NaN where the case is not run."""
        spans = np.empty((count, 2))
        spans[:, 0], spans[:, 1] = part_of(self._begin, block), part_of(self.span["end"], block)
        return spans

    def alone(
        self, number: int, settings: CaseSettings, quick_start: Callable[[Iterable[str]], QuickStart]
    ) -> CaseBlock | None:
        """Return a case by the start of single runs; None where that does not support it, or finds something wrong."""
        if not self.plain or (self.refused is not None and self.refused[number]):
            return None
        block = slice(number, number + 1)
        spans = self._spans(block, 1)
        values = {name: float(np.ravel(part_of(column, block))[0]) for name, column in self._values.items()}
        p = np.array([np.ravel(column)[0] for column in self._parameter_columns(block)])
        found = quick_start(self._values)(float(spans[0, 0]), values, p) if np.all(np.isfinite(spans)) else None
        return None if found is None else self._started(block, settings, found[0][np.newaxis], found[1][np.newaxis])

    def to_keep(self, count: int, settings: CaseSettings) -> KeptStarts:
        """Return arrays for what a run of `count` cases keeps of their starts: what checks of the results look at."""
        layout = self.program.layout
        if settings.judge is None or self.changing:
            return KeptStarts.nothing()
        return KeptStarts(np.zeros((count, layout.constants)), np.zeros((count, len(layout.state))))  # some may not run

    def of_run(self, block: slice, settings: CaseSettings, kept: KeptStarts) -> CaseBlock:
        """Return a block of cases that have run, whose run has `kept` their starts; else they are made again."""
        if not len(kept.states):
            return self.block(block, settings)[0]
        return self._started(block, settings, kept.states, kept.constants)

    def _given(self, block: slice, count: int) -> FloatArray:
        """Return the given initial values (count, n) of a block of cases, in the order of the start."""
        given = np.empty((count, len(self.start.given)))
        for i, name in enumerate(self.start.given):
            given[:, i] = part_of(self._values[name], block)
        return given

    def leave_out(self, which: NDArray[np.bool_]) -> None:
        """Run none of the cases `which` (k,): their starts are NaN."""
        self._begin, self._whole = np.where(which, np.nan, self._begin), None

    def lost_pivots(self, block: slice) -> NDArray[np.bool_]:
        """Return in which cases of a block (k,) the formulation divides a constraint by something that vanishes."""
        c = self.constants(block)
        t = np.broadcast_to(part_of(self._begin, block), (len(c),))
        out = interpret_rows(self.start.kernel, t, self._given(block, len(c)), c)
        checks = out[:, len(self.program.layout.state) :]
        lost = np.zeros(len(c), bool)
        for i, (kind, _) in enumerate(self.start.labels):
            if kind == "pivots":
                lost |= ~(checks[:, 2 * i] <= checks[:, 2 * i + 1])
        return lost

    def _refine(self, c: FloatArray, t: FloatArray, given: FloatArray, out: FloatArray, some: NDArray[np.intp]) -> None:
        """Write constants and starts of some cases as they are made for each alone."""
        parameters = len(self.program.layout.parameters)
        for i in some:
            c[i] = interpret(self.program.kernel("prepare"), {"p": c[i, :parameters].tolist()})
            out[i] = interpret(self.start.kernel, {"t": float(t[i]), "y": given[i].tolist(), "c": c[i].tolist()})


def single_problem(
    cases: Cases,
    settings: CaseSettings,
    number: int,
    quick_start: Callable[[Iterable[str]], QuickStart] | None = None,
) -> IntegrationProblem | None:
    """Return a case alone, or None where it cannot start.

    `quick_start` gives starts of single runs by the names of given values; with one the case starts from the very bits
    of a run alone.
    """
    found = None if quick_start is None else cases.alone(number, settings, quick_start)
    if found is not None:
        return found.problem(0)
    block, status = cases.block(slice(number, number + 1), settings, exact=quick_start is not None)
    if not len(status) or status[0] >= 0:
        return None
    return block.problem(0)
