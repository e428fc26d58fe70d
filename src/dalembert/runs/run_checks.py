"""The checks of runs: which of them a model has, how they are applied, and that of tables.

A further check is a class in a module of its own and a line in `CHECKS`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.tables import Table, table_of
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import SUSPECT, Status
from ..steps.problem import IntegrationProblem, Solution
from ..stops.segments import constants_at
from ..transforms.passes import EliminateDeadCode
from .constraint_check import ConstraintCheck
from .coordinate_checks import EndCheck, GimbalCheck
from .run_check import EndedRun, RunCheck
from .sampling import DivergenceCheck

if TYPE_CHECKING:
    from ..model.model import CompiledModel


# Runs that end where the argument of a table leaves its knots: the status that says so, and which table it is.

_FAILED_AT_KNOT = (Status.STEP_TOO_SMALL, Status.NON_FINITE)
_NEAR_KNOT = 1e-6
"""Share of its range by which the argument of a table may be within where a step that leaves it has failed."""


@final
@frozen(eq=False)
class TableCheck(RunCheck):
    """The tables in the rates that have values within their knots only, and the kernel of their arguments."""

    tables: tuple[Table, ...]
    arguments: Kernel

    @classmethod
    def of(cls, model: CompiledModel) -> TableCheck | None:
        """Return the check of a model; None where every table continues beyond its knots."""
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
        """See `RunCheck.after`: a run that failed at an end of a table has that status."""
        solution = run.solution
        if solution.status not in _FAILED_AT_KNOT:
            return solution, ""
        t, y = run.stop
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
        failed = np.isin(done.ends[:, 1], _FAILED_AT_KNOT)
        if np.any(failed):
            _, met = self._outside(done.ends[:, 0], done.y, block.c)
            done.ends[failed & np.any(met, axis=1), 1] = float(Status.OUTSIDE_TABLE)

    def _outside(self, t: FloatArray, y: FloatArray, c: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the arguments (k, n) at times (k,) and states, and which are at an end of the knots or beyond."""
        values = interpret_rows(self.arguments, t, y, c)
        low = np.array([table.first + _NEAR_KNOT * (table.last - table.first) for table in self.tables])
        high = np.array([table.last - _NEAR_KNOT * (table.last - table.first) for table in self.tables])
        with np.errstate(invalid="ignore"):
            return values, (values <= low) | (values >= high)


CHECKS = (TableCheck, DivergenceCheck, GimbalCheck, EndCheck, ConstraintCheck)
"""In this order: the first that ends a run says why."""


def run_checks(model: CompiledModel) -> tuple[RunCheck, ...]:
    """Return the checks that runs of a model need."""
    found = (check.of(model) for check in CHECKS)
    return tuple(check for check in found if check is not None)


def checked(
    model: CompiledModel, problem: IntegrationProblem, method: str, solution: Solution
) -> tuple[Solution, list[str]]:
    """Return a run, ended where a check finds that it should have been, and notes on that."""
    if not model.checks:
        return solution, []
    run, notes = EndedRun(model, problem, method, solution), []
    for check in model.checks:
        found, note = check.after(run)
        notes.append(note)
        if found.status is not solution.status:
            return found, notes
    return solution, notes


def checked_cases(checks: Sequence[RunCheck], method: str, block: CaseBlock, done: BlockResult) -> None:
    """End the cases of a block that should have ended."""
    for check in checks:
        check.after_cases(method, block, done)
    status = done.ends[:, 1]
    marked = status <= SUSPECT
    status[marked] = SUSPECT - status[marked]
