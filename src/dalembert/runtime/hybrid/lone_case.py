"""One case in the loop over phases, with memory that is kept from motion to motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from ...arrays import FloatArray
from ...integrators.phase_stops import no_stops
from ...integrators.phase_tables import JUMPS, NOT_BEGUN
from ...integrators.workspace import RUNNING
from ...ir.program import Layout
from ...methods.status import Status
from ...options import StepOptions
from ...results.hybrid_sweep import States
from .case_table import case_table
from .event_jumps import EventJumps
from .mode_models import ModeModels
from .output_values import BROKEN, OutputValues
from .phases import PhaseExecutor
from .reductions import PhaseReductions
from .state import HybridState
from .stops import Stops

__all__ = ["LoneCase"]


@final
class LoneCase:
    """A case that is run again and again.

    Parameters
    ----------
    modes : ModeModels
    layout : Layout
        Of the scene.
    options : StepOptions
        Method, tolerances, largest step and number of steps.
    watched : PhaseReductions
        The events that users watch.
    lines : int
        Lines of the log of phases; 0: there is none, and no step is recorded.
    fits : bool
        Whether "auto" looks at each motion to find a method that fits.
    first_step : float or None
        Size of the first step of a motion that is recorded; None where it is to be chosen.
    """

    def __init__(
        self,
        modes: ModeModels,
        layout: Layout,
        options: StepOptions,
        watched: PhaseReductions,
        *,
        lines: int = 0,
        fits: bool = False,
        first_step: float | None = None,
    ) -> None:
        self.first_step = first_step
        self.modes, self.layout = modes, layout
        contacts, n, zero = len(modes.equations.contacts), len(layout.variables), np.zeros(1)
        x, c = np.zeros((1, n)), np.zeros((1, len(layout.parameters)))
        self.state = HybridState.starting(zero, x, c, zero, contacts, len(layout.states))
        self.log = np.empty((lines, 2 + 5 * contacts + n))
        nothing = States.nothing_yet(0, n, contacts)
        self.table = table = case_table(self.state, zero.copy(), watched, None, nothing, self.log)
        known = modes, layout, options, 0, watched, self.state, table
        self.executor = PhaseExecutor(*known, fits=fits, recorded=lines > 0)
        changing = (*self.state.cases, *table.numbers, table.occurred)
        self._begins = [(values, values.copy()) for values in changing]

    def begin(self, t0: float, t1: float, x: FloatArray, p: FloatArray) -> None:
        """Begin a motion from x (2 n_q + n_z,) with parameters p (n_p,); its mode is to be selected."""
        for values, first in self._begins:
            values[...] = first
        state, numbers = self.state, self.table.numbers
        state.t[0], self.table.t1[0], state.cases.span[0] = t0, t1, t1 - t0
        self.table.begun[0] = t0
        state.x[0], state.c[0] = x, p
        numbers.state[0], numbers.runner[0] = RUNNING, NOT_BEGUN
        self.executor.forget_methods()
        self.executor.compile_seconds, self.executor.first_step = 0.0, self.first_step

    def stop_at(self, stops: Stops | None) -> None:
        """Let the motion that begins next stop at the stops of one case."""
        if stops is not None or len(self.executor.table.stops.first):
            self.executor.stop_at(no_stops() if stops is None else stops.table)

    @property
    def status(self) -> Status:
        """The status with which the motion ended."""
        return Status(int(self.table.numbers.state[0]))

    def run(
        self,
        jumps: EventJumps | None = None,
        paused: Callable[[], None] | None = None,
        jumped: Callable[[], None] | None = None,
    ) -> None:
        """Run the motion to its end.

        Parameters
        ----------
        jumps : EventJumps, optional
            Maps of the state by events.
        paused : function, optional
            Called whenever the loop has returned.
        jumped : function, optional
            Called when the state has jumped.
        """
        numbers, executor = self.table.numbers, self.executor
        while numbers.state[0] == RUNNING:
            executor.run_alone(paused)
            if paused is not None:
                paused()
            if numbers.runner[0] == JUMPS and numbers.state[0] == RUNNING:
                assert jumps is not None
                numbers.state[:] = jumps.apply(self.state, self.table.occurred, np.zeros(1, np.intp))
                numbers.runner[:] = NOT_BEGUN
                if jumped is not None:
                    jumped()
        if numbers.state[0] in BROKEN:
            self._tell_paradox()

    def _tell_paradox(self) -> None:
        """Tell a failure near Painleve's paradox from others."""
        numbers, value = self.table.numbers, OutputValues(self.modes, self.layout, self.state.c)
        if value.jammed(self.state.states(np.zeros(1, np.intp), numbers.history))[0]:
            numbers.state[0] = Status.CONTACT_IMPOSSIBLE
