"""Memory of steps on rows: those of single runs, which cases take that are in the lanes of a loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from ..arrays import FloatArray, aligned
from ..frozen import frozen
from ..methods.step_constants import SMALLEST_SCALE
from ..once import once
from ..options import MAX_STEPS
from ..steps.newton import ROWS, NewtonWorkspace, newton_workspace
from ..steps.packed_tableaus import ALLOWED
from ..steps.recorded_runs import Progress, Run, RunCodes, RunSettings
from ..stops.stops import no_stops
from ..subset.arguments import NO_CODE, IntVector
from ..subset.packing import constant_group


class RowSteps(NamedTuple):
    """The workspace of steps on rows; their constants are those of the lanes.

    ``known`` is 1 where a step from the present state of a lane was attempted before, so that its slope is known.
    """

    codes: RunCodes
    settings: RunSettings
    space: NewtonWorkspace
    run: Run
    known: IntVector


@final
@frozen
class ImplicitSteps:
    """Steps of the implicit method of a program, of states of `n` components.

    Attributes
    ----------
    codes : RunCodes
    n, multipliers, states : int
        Components of the state, components without rates behind them, and first-order states at the end of the state.
    degree : int
        Of the polynomials of steps.
    """

    codes: RunCodes
    n: int
    multipliers: int
    states: int
    degree: int

    def memory(
        self,
        constants: FloatArray,
        tolerances: Sequence[float],
        allowed: FloatArray,
        max_step: float,
        first_step: float,
    ) -> RowSteps:
        """Return the memory of a thread.

        Parameters
        ----------
        constants : (n_c, lanes)
            Those of the lanes.
        tolerances, allowed
            Relative and smallest absolute one; absolute ones (n,) of the components.
        max_step, first_step
            Largest size of a step, and that of the first, 0 where it is chosen.
        """
        n, width, lanes = self.n, self.n + self.multipliers, constants.shape[1]
        work = aligned(ROWS, width * lanes)
        rtol, atol = tolerances[0], max(tolerances[1], SMALLEST_SCALE)
        work[ALLOWED] = atol
        work[ALLOWED, : n * lanes] = np.repeat(np.maximum(allowed, SMALLEST_SCALE), lanes)
        return RowSteps(
            codes=self.codes,
            settings=RunSettings(
                t0=0.0,
                rtol=rtol,
                atol=atol,
                first_step=first_step,
                max_step=max_step,
                max_steps=MAX_STEPS,
                kept=n,
                degree=self.degree,
                sampled=False,
                dense=False,
                stop_if_stiff=False,
                behind=False,
            ),
            space=newton_workspace(width, n - self.states, lanes),
            run=_run(work, constants, n, self.degree),
            known=np.zeros(lanes, np.int64),
        )


def _run(work: FloatArray, constants: FloatArray, n: int, degree: int) -> Run:
    lanes = constants.shape[1]
    return Run(
        clock=np.zeros((1, lanes)),
        constants=constants,
        t_eval=np.zeros(0),
        work=work,
        delta=np.zeros((n, lanes)),
        mark=np.zeros(lanes, np.int64),
        progress=Progress(),
        knot=np.zeros((1, 2 * lanes)),
        rows=np.zeros((0, 1 + n)),
        pieces=np.zeros((1, 1 + (degree + 1) * n)),
        stops=no_stops(),
        prepare=NO_CODE,
    )


@once
def no_row_steps() -> RowSteps:
    """Return empty memory, for steps that are compiled."""
    made = ImplicitSteps(RunCodes(NO_CODE), 0, 0, 0, 0).memory(np.zeros((0, 1)), (0.0, 0.0), np.zeros(0), 0.0, 0.0)
    return constant_group(made)
