"""Runs that end where the argument of a table leaves its knots: the status that says so, and which table it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..integrators.cases import BlockResult, CaseBlock
from ..integrators.problem import IntegrationProblem, Solution
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..ir.tables import Table, table_of
from ..methods.status import Status
from ..transforms.passes import EliminateDeadCode

__all__ = ["TableRange", "ended_outside", "outside_cases", "table_range"]

_FAILED = (Status.STEP_TOO_SMALL, Status.NON_FINITE)
_NEAR = 1e-6
"""Share of its range by which the argument of a table may be within where a step that leaves it has failed."""


@final
@dataclass(frozen=True, eq=False)
class TableRange:
    """The tables in the rates that have values within their knots only, and the kernel of their arguments."""

    tables: tuple[Table, ...]
    arguments: Kernel

    def outside(self, t: FloatArray, y: FloatArray, c: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the arguments (k, n) at times (k,) and states, and which are at an end of the knots or beyond."""
        values = interpret_rows(self.arguments, t, y, c)
        low = np.array([table.first + _NEAR * (table.last - table.first) for table in self.tables])
        high = np.array([table.last - _NEAR * (table.last - table.first) for table in self.tables])
        with np.errstate(invalid="ignore"):
            return values, (values <= low) | (values >= high)


def table_range(program: Program) -> TableRange | None:
    """Return the tables of a program that have values within their knots only; None where there are none."""
    rhs = program.kernel("rhs")
    found = {
        line.args[0]: table_of(float(line.args[1]))
        for line in rhs.body
        if line.op == "piece" and table_of(float(line.args[1])).bounded
    }
    if not found:
        return None
    arguments = EliminateDeadCode()(replace(rhs, name="table_arguments", outputs=tuple(found)))
    return TableRange(tuple(found.values()), arguments)


def ended_outside(
    found: TableRange | None, problem: IntegrationProblem, solution: Solution, c: Constants
) -> tuple[Solution, str]:
    """Return a run that failed at an end of a table with the status that says so, and which table it is."""
    if found is None or solution.status not in _FAILED:
        return solution, ""
    t, y = (solution.t[-1], solution.y[-1]) if len(solution.t) else (problem.t0, problem.y0)
    if solution.end is not None and solution.last is not None:
        t, y = solution.end, solution.last
    times = np.array([float(t)])
    values, met = found.outside(times, y[np.newaxis], constants_at(c, times))
    places = np.flatnonzero(met[0])
    if not len(places):
        return solution, ""
    table, x = found.tables[places[0]], values[0, places[0]]
    where = (
        f"the knots of the table {table.name!r} go from {table.first:.9g} to {table.last:.9g}, and its argument left"
        f" them at {x:.9g} at t = {float(t):.9g}"
    )
    return replace(solution, status=Status.OUTSIDE_TABLE), where


def outside_cases(found: TableRange, block: CaseBlock, done: BlockResult) -> None:
    """Set the status of cases of a sweep that failed at an end of a table."""
    failed = np.isin(done.ends[:, 1], _FAILED)
    if np.any(failed):
        _, met = found.outside(done.ends[:, 0], done.y, block.c)
        done.ends[failed & np.any(met, axis=1), 1] = float(Status.OUTSIDE_TABLE)
