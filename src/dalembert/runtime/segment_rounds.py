"""Runs of whole blocks of cases from stop to stop, for engines whose loops pass none (`Engine.whole_blocks`)."""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.base import Engine
from ..integrators.cases import BlockResult, CaseBlock
from ..ir.program import KnotSides
from ..methods.status import Status
from .inputs import prepare_rows
from .stop_lists import Stopping

__all__ = ["SegmentRounds"]

IntArray = NDArray[np.intp]


@final
class SegmentRounds:
    """Many cases, of which every round takes those that are left to their next stops, side by side.

    Nothing is watched, there are no times to record, and no inputs with knots.
    """

    def __init__(self, engine: Engine, block: CaseBlock, found: Stopping) -> None:
        self.engine, self.block, self.found, self.program = engine, block, found, found.program
        self.t, self.y, self.number = block.spans[:, 0].copy(), block.y.copy(), found.lists.first.copy()
        self.p = block.c[:, : len(self.program.layout.parameters)].copy()
        found.decide(self.p, np.arange(len(self.p)), found.begin)

    def run(self, method: str, result: BlockResult) -> None:
        """Write the ends of the cases."""
        block, lists = self.block, self.found.lists
        result.y[:], result.ends[:, 0], result.ends[:, 1:] = self.y, self.t, (Status.NON_FINITE, 0.0)
        some = np.flatnonzero(~self.found.bad)
        while len(some):
            self._take_stops(some)
            further, ends = self.number[some] < lists.last[some], block.spans[some, 1]
            ends[further] = lists.times[self.number[some[further]]]
            done = BlockResult.empty(len(some), self.y.shape[1], 0)
            spans = np.stack([self.t[some], ends], axis=1)
            self.engine.integrate_block(
                replace(block, y=self.y[some], c=self._constants(some), spans=spans), method, done
            )
            self.t[some], self.y[some] = done.ends[:, 0], done.y
            status, steps = done.ends[:, 1], result.ends[some, 2] + done.ends[:, 2]
            further &= status == Status.SUCCESS
            spent = further & (steps >= block.max_steps)
            status[spent], status[further & ~spent] = Status.MAX_STEPS, Status.INTERRUPTED
            result.y[some], result.ends[some] = done.y, np.stack([self.t[some], status, steps], axis=1)
            some = some[further & ~spent]

    def _constants(self, some: IntArray) -> FloatArray:
        return prepare_rows(self.program, self.p[some])

    def _take_stops(self, some: IntArray) -> None:
        """Take the stops of cases at their present times, and move states to the sides that follow."""
        passed = due = self._due(some)
        before = self._constants(due) if any(action.function for action in self.found.actions) else self.p[due]
        while len(due):
            middles = self.found.lists.middles[self.number[due]]
            decided = np.isfinite(middles)
            self.found.decide(self.p, due[decided], middles[decided])
            if np.any(self.found.lists.acts[self.number[due]]):
                self._act(due, before[np.isin(passed, due)])
            self.number[due] += 1
            due = self._due(due)
        if self.program.knot_sides is not None and len(passed):
            self._take_sides(self.program.knot_sides, passed)

    def _due(self, some: IntArray) -> IntArray:
        """Return those of some cases that have reached their next stops."""
        lists, number = self.found.lists, self.number
        left = some[number[some] < lists.last[some]]
        return left[lists.times[number[left]] == self.t[left]]

    def _act(self, due: IntArray, before: FloatArray) -> None:
        """Apply the actions at the next stops of cases, whose constants were those `before`."""
        acts, after = self.found.lists.acts[self.number[due]], self._constants(due)
        for a, action in enumerate(self.found.actions):
            acting = acts >> a & 1 == 1
            cases, own = due[acting], after[acting]
            if action.kernel is not None and len(cases):
                values = self.engine.rows(action.kernel, self.t[cases], self.y[cases], own)
                self.y[cases[:, np.newaxis], np.array(action.places)] = values
            if action.function is not None:
                for i, earlier, later in zip(cases, before[acting], own, strict=True):
                    self.y[i] = action.function(float(self.t[i]), self.y[i], earlier, later)

    def _take_sides(self, sides: KnotSides, some: IntArray) -> None:
        """Move the states of cases to the sides of knots and switches that their motions go to."""
        c, n = self._constants(some), self.y.shape[1]
        near = self.engine.rows(sides.near, self.t[some], self.y[some], c)[:, 0] != 0.0
        some, c = some[near], c[near]
        if len(some):
            found = self.engine.rows(sides.sides, self.t[some], self.y[some], c)
            forward = self.block.spans[some, 1] >= self.block.spans[some, 0]
            self.y[some] = np.where(forward[:, np.newaxis], found[:, :n], found[:, n : 2 * n])
