"""Stops of many cases: changes of conditions on time, and instants of controllers, in the order of their runs."""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.conditions import NO_CONDITIONS
from ..ir.program import Program
from ..lanes.cases import CaseColumns
from ..methods.step_constants import SMALLEST_OF_TIME
from ..steps.problem import IntegrationProblem, SamplingClock
from ..stops.breakpoints import CaseBreaks
from ..stops.input_records import InputRecords
from ..stops.segments import Segments
from ..stops.stops import CaseStops, Landing, StopAction, StopLists
from .sampling import NoInstants, Sampling

IntArray = NDArray[np.int64]


@final
@frozen(eq=False)
class Stopping:
    """Where the cases of a program stop.

    Attributes
    ----------
    program : Program
    lists : StopLists
    actions : tuple of StopAction
    begin : ndarray (k,)
        When conditions are decided at the starts [s].
    bad : ndarray (k,) of bool
        Whether the controllers of a case have no instants.
    """

    program: Program
    lists: StopLists
    actions: tuple[StopAction, ...]
    begin: FloatArray
    bad: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        program: Program,
        p: FloatArray,
        spans: tuple[FloatArray, FloatArray],
        t_eval: FloatArray | None,
        *,
        sampling: Sampling | None,
        landing: Landing | None,
        many: bool = True,
        clock: SamplingClock | None = None,
        breaks: CaseBreaks | None = None,
    ) -> Stopping:
        """Return the stops of cases with parameters (k, n_p), starts and ends (k,) and times to record (n_t,).

        `landing` gives states behind jumps of prescribed velocities; for `many` and `clock` see `stop_lists`. `breaks`
        are those of the conditions, where they are known.
        """
        breaks = breaks or CaseBreaks.of(program.conditions or NO_CONDITIONS, p, *spans)
        where, _, middles = segments_of_cases(breaks)
        actions = [] if sampling is None else sampling.stop_actions
        jump = 0 if landing is None else 1 << len(actions)
        lists, bad = stop_lists(breaks, sampling, p, t_eval, jump, many=many, clock=clock)
        if landing is not None:
            actions = [*actions, StopAction(tuple(range(len(program.layout.state))), function=landing)]
        return cls(program, lists, tuple(actions), middles[where[:-1]], bad)

    def decide(self, p: FloatArray, some: NDArray[np.intp], times: FloatArray) -> None:
        """Set when conditions are decided in the parameters (k, n_p) of some cases (m,)."""
        if self._place is not None:
            p[some, self._place] = times

    def columns(self, cases: CaseColumns) -> CaseColumns:
        """Return cases with their stops; those whose controllers have no instants have no start."""
        parameters, spans = [*cases.parameters], cases.spans
        if self._place is not None:
            parameters[self._place] = self.begin
        if np.any(self.bad):
            spans = np.where(self.bad, np.nan, spans[0]), spans[1]
        cases = replace(cases, parameters=tuple(parameters), spans=spans)
        if not len(self.lists.times):
            return cases
        return replace(cases, inputs=self.inputs(cases.inputs), stops=self.stops)

    def problem(
        self, problem: IntegrationProblem, along: Segments | None = None, *, behind: bool = False
    ) -> IntegrationProblem:
        """Return the problem of a case that is alone, with its stops; for `along` and `behind` see `CaseStops`."""
        stops = replace(self.stops, along=along, behind=behind)
        return replace(problem, inputs=self.inputs(problem.inputs), stops=stops)

    @property
    def _place(self) -> int | None:
        return None if self.program.conditions is None else self.program.conditions.place

    @property
    def stops(self) -> CaseStops:
        """The lists with their actions."""
        return CaseStops(self.lists, self._place, self.actions)

    def inputs(self, given: InputRecords | None) -> InputRecords:
        """Return the given inputs; without any, records of none, which say where states go at stops."""
        return given or InputRecords((), (), np.zeros(1), sides=self.program.knot_sides)


def segments_of_cases(breaks: CaseBreaks) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the segments of many runs: where those of each begin (k + 1,), their starts and their middles (n,)."""
    where = (breaks.starts + np.arange(len(breaks.starts))).astype(np.int64)
    edges = np.insert(breaks.times, breaks.starts[:-1], breaks.t0)
    ends = np.append(edges[1:], 0.0)[: len(edges)]
    ends[where[1:] - 1] = breaks.t1
    return where, edges, edges + 0.5 * (ends - edges)


def stop_lists(
    breaks: CaseBreaks,
    sampling: Sampling | None,
    p: FloatArray,
    t_eval: FloatArray | None,
    landing: int = 0,
    *,
    at_start: bool = False,
    many: bool = True,
    clock: SamplingClock | None = None,
) -> tuple[StopLists, NDArray[np.bool_]]:
    """Return the stops of cases, and in which of them (k,) controllers have no instants.

    Parameters
    ----------
    breaks : CaseBreaks
        Changes of conditions on time.
    sampling : Sampling or None
        Controllers, whose actions have the bits from 0 on.
    p : ndarray (k, n_p)
        Parameters.
    t_eval : ndarray (n_t,) or None
        Times to record [s].
    landing : int
        Bit of the action at changes of conditions, 0 for none.
    at_start : bool
        Whether what is decided at the start is a stop, too.
    many : bool
        Whether cases without instants are marked, or raise an error.
    clock : SamplingClock, optional
        From which instants count, of cases that continue others.

    Raises
    ------
    NoInstants, OptionError
        See `Sampling.instants`.
    """
    where, times, middles = segments_of_cases(breaks)
    acts = np.full(len(times), landing, np.int64)
    acts[where[:-1]] = 0
    if breaks.place is None:
        middles[:] = np.nan
    first = where[:-1] + (0 if at_start and breaks.place is not None else 1)
    lists = StopLists(first, where[1:].copy(), times, acts, middles)
    if sampling is None:
        return lists, np.zeros(len(p), np.bool_)
    return _with_instants(breaks, lists, where[:-1], sampling, p, t_eval, many, clock)


_List = tuple[FloatArray, IntArray, FloatArray]
"""Times, acts and middles."""


def _with_instants(
    breaks: CaseBreaks,
    lists: StopLists,
    begin: IntArray,
    sampling: Sampling,
    p: FloatArray,
    t_eval: FloatArray | None,
    many: bool,
    clock: SamplingClock | None,
) -> tuple[StopLists, NDArray[np.bool_]]:
    """Return lists with the instants of controllers; cases with equal stops share one.

    The first segment of each case is at `begin` (k,) in the lists.
    """
    schedules = sampling.schedules(p)
    parts: list[_List] = [(np.zeros(0), np.zeros(0, np.int64), np.zeros(0))]
    known: dict[bytes, int] = {}
    each = np.zeros(len(p), np.int64)
    for i, (t0, t1) in enumerate(zip(breaks.t0.tolist(), breaks.t1.tolist(), strict=True)):
        own = slice(lists.first[i], lists.last[i])
        key = np.array([t0, t1]).tobytes() + lists.times[own].tobytes() + schedules[i].tobytes()
        if key not in known and np.isfinite(t0 + t1):
            try:
                found = sampling.instants(schedules[i], t0, t1, clock, t_eval)
            except NoInstants:
                if not many:
                    raise
                known[key] = -1
            else:
                known[key] = len(parts)
                decided = None if breaks.place is None else (t0, float(lists.middles[begin[i]]))
                parts.append(_in_order((lists.times[own], lists.acts[own], lists.middles[own]), *found, decided))
        each[i] = known.get(key, 0)
    bad = each < 0
    sizes = np.array([len(times) for times, _, _ in parts])
    ends = np.cumsum(sizes)
    times, acts, middles = (np.concatenate(column) for column in zip(*parts, strict=True))
    each[bad] = 0
    return StopLists(ends[each] - sizes[each], ends[each], times, acts, middles), bad


def _in_order(own: _List, instants: FloatArray, acts: IntArray, decided: tuple[float, float] | None) -> _List:
    """Return changes of conditions and instants of controllers in one list, in the order of time.

    Where both are at one time but for rounding, controllers act with conditions as of that very time, and so they do at
    the start. `decided` is the start, and when conditions are decided from there on; None where nothing is decided.
    """
    times, changes, middles = own
    when = np.full(len(instants), np.nan)
    if decided is None:
        after, then = np.zeros(0), np.zeros(0)
    else:
        edges, following = np.append(decided[0], times), np.append(decided[1], middles)
        last = np.searchsorted(edges, instants, side="right") - 1
        nearest = np.minimum(instants - edges[last], np.append(times, np.inf)[last] - instants)
        together = nearest <= SMALLEST_OF_TIME * np.abs(instants)
        when[together], after, then = instants[together], instants[together], following[last[together]]
    every = np.concatenate([times, instants, after])
    order = np.argsort(every, kind="stable")
    done = np.concatenate([changes, acts, np.zeros(len(after), np.int64)])
    return every[order], done[order], np.concatenate([middles, when, then])[order]
