"""Runs that come to the end of what a root in the positions is defined for: they end there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import Status
from ..reduction.margins import ROOT_END, root_ends
from ..steps.problem import IntegrationProblem, Solution
from ..stops.segments import constants_at
from .run_check import EndedRun, RunCheck, end_suspects
from .singular import cut

if TYPE_CHECKING:
    from ..model.model import CompiledModel


@final
@frozen(eq=False)
class RootCheck(RunCheck):
    """The arguments of the roots in positions and constraints of a model that may vanish."""

    model: CompiledModel
    ends: Kernel

    @classmethod
    def of(cls, model: CompiledModel) -> RootCheck | None:
        """Return the check of a model; None without such roots, and for the modes of contacts."""
        ends = None if model.stages.mode is not None else root_ends(model.stages.reduced)
        return None if ends is None else cls(model, ends)

    def before(self, problem: IntegrationProblem) -> IntegrationProblem:
        """See `RunCheck.before`: all steps are looked at."""
        return replace(problem, dense=True)

    def after(self, run: EndedRun) -> tuple[Solution, str]:
        """See `RunCheck.after`: also of runs that failed later."""
        solution, steps = run.solution, run.steps
        if not len(steps.t):
            return solution, ""
        values = interpret_rows(self.ends, steps.t, steps.y, constants_at(run.constants, steps.t))
        arguments, sizes = np.hsplit(values, 2)
        largest = np.max(np.nan_to_num(sizes, nan=0.0), axis=0)
        ended = np.flatnonzero(~np.all(arguments > ROOT_END * largest, axis=1))  # or not a number
        if not len(ended):
            return solution, ""
        t = float(steps.t[ended[0]])
        note = (
            f"at t = {t:.6g} a root in the positions or constraints came to the end of what it is defined for, where"
            " the coordinates are singular: take coordinates that are regular there, as an angle in place of"
            " sqrt(L**2 - x**2)"
        )
        return cut(solution, t, run.span, Status.NON_FINITE), note

    def guards(self, method: str) -> str:
        """See `RunCheck.guards`."""
        return "roots"

    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """See `RunCheck.after_cases`: cases that came to an end run alone once more."""
        end_suspects(self, self.model, method, block, done, Status.NON_FINITE)
