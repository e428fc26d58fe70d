"""Runs that end where the argument of a table leaves its knots: the status that says so, and which table it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..integrators.cases import BlockResult, CaseBlock
from ..integrators.problem import Solution
from ..integrators.segments import constants_at
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.tables import Table, table_of
from ..methods.status import Status
from ..transforms.passes import EliminateDeadCode
from .run_check import EndedRun, RunCheck

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["TableCheck"]

_FAILED = (Status.STEP_TOO_SMALL, Status.NON_FINITE)
_NEAR = 1e-6
"""Share of its range by which the argument of a table may be within where a step that leaves it has failed."""


@final
@dataclass(frozen=True, eq=False)
class TableCheck(RunCheck):
    """The tables in the rates that have values within their knots only, and the kernel of their arguments."""

    tables: tuple[Table, ...]
    arguments: Kernel

    @classmethod
    def of(cls, model: CompiledModel) -> TableCheck | None:
        """Return the check of a model; None where every table goes on beyond its knots."""
        rhs = model.stages.program.kernel("rhs")
        found = {
            line.args[0]: table_of(float(line.args[1]))
            for line in rhs.body
            if line.op == "piece" and table_of(float(line.args[1])).bounded
        }
        if not found:
            return None
        arguments = EliminateDeadCode()(replace(rhs, name="table_arguments", outputs=tuple(found)))
        return cls(tuple(found.values()), arguments)

    def after(self, run: EndedRun) -> tuple[Solution, str]:
        """See `RunCheck.after`: a run that failed at an end of a table has the status that says so."""
        solution, problem = run.solution, run.problem
        if solution.status not in _FAILED:
            return solution, ""
        t, y = (solution.t[-1], solution.y[-1]) if len(solution.t) else (problem.t0, problem.y0)
        if solution.end is not None and solution.last is not None:
            t, y = solution.end, solution.last
        times = np.array([float(t)])
        values, met = self._outside(times, y[np.newaxis], constants_at(run.constants, times))
        places = np.flatnonzero(met[0])
        if not len(places):
            return solution, ""
        table, x = self.tables[places[0]], values[0, places[0]]
        where = (
            f"the knots of the table {table.name!r} go from {table.first:.9g} to {table.last:.9g}, and its argument"
            f" left them at {x:.9g} at t = {float(t):.9g}"
        )
        return replace(solution, status=Status.OUTSIDE_TABLE), where

    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """See `RunCheck.after_cases`."""
        failed = np.isin(done.ends[:, 1], _FAILED)
        if np.any(failed):
            _, met = self._outside(done.ends[:, 0], done.y, block.c)
            done.ends[failed & np.any(met, axis=1), 1] = float(Status.OUTSIDE_TABLE)

    def _outside(self, t: FloatArray, y: FloatArray, c: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the arguments (k, n) at times (k,) and states, and which are at an end of the knots or beyond."""
        values = interpret_rows(self.arguments, t, y, c)
        low = np.array([table.first + _NEAR * (table.last - table.first) for table in self.tables])
        high = np.array([table.last - _NEAR * (table.last - table.first) for table in self.tables])
        with np.errstate(invalid="ignore"):
            return values, (values <= low) | (values >= high)
