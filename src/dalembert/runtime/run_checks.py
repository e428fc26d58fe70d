"""The checks of runs: all there are, which of them a model has, and how they are applied.

A further check is a class in a module of its own and a line in `CHECKS`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..integrators.cases import BlockResult, CaseBlock
from ..integrators.problem import IntegrationProblem, Solution
from .constraint_check import ConstraintCheck
from .gimbal import GimbalCheck
from .run_check import EndedRun, RunCheck
from .table_range import TableCheck

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["CHECKS", "checked", "checked_cases", "run_checks"]

CHECKS = (TableCheck, GimbalCheck, ConstraintCheck)
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


def checked_cases(model: CompiledModel, method: str, block: CaseBlock, done: BlockResult) -> None:
    """End the cases of a block that should have ended."""
    for check in model.checks:
        check.after_cases(method, block, done)
