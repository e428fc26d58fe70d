"""Prepared runs of scenes with contacts: fixed span, method and tolerances."""

from __future__ import annotations

from collections.abc import Callable
from threading import get_ident
from typing import final

import numpy as np

from ...arrays import FloatArray
from ...codegen.base import Final, Prepared, PreparedStates
from ...integrators.phase_tables import NOT_BEGUN
from ...integrators.workspace import RUNNING
from ...ir.program import Layout
from ...methods.status import Status
from ...options import PrepareOptions, SweepOptions
from ..reductions import Reduction
from .mode_models import ModeModels
from .output_values import BROKEN, OutputValues
from .phases import PhaseExecutor, compiled_phases
from .preview import case_table, no_samples
from .reductions import PhaseReductions
from .request import SweepRequest
from .state import HybridState
from .sweep import sweep

__all__ = ["prepared", "with_extension"]

_NOTHING: dict[str, Reduction] = {}


def prepared(modes: ModeModels, layout: Layout, t_span: tuple[float, float], options: PrepareOptions) -> Prepared:
    """Return a function from variables (2 n_q + n_z,) and parameters of the scene (n_p,) to the final variables.

    The loop over phases runs each motion, with memory that every thread keeps. Motions that it cannot run go phase by
    phase as in a sweep.
    """
    changing = options.inputs is not None and options.inputs.sampled
    compiled = compiled_phases(modes) and modes.conditions is None and not changing
    own: dict[int, _OneCase] = {}

    def run(x: FloatArray, p: FloatArray) -> Final:
        if not (np.isfinite(x.sum()) and np.isfinite(p.sum())):
            return np.full_like(x, np.nan), Status.NON_FINITE
        if compiled:
            held = own.get(get_ident())
            if held is None:
                held = own[get_ident()] = _OneCase(modes, layout, t_span, options)
            found = held.run(x, p)
            if found is not None:
                return found
        return _swept(modes, layout, t_span, options, x, p)

    return PreparedStates(run)


def with_extension(run: Prepared, extended: Callable[[FloatArray], FloatArray]) -> Prepared:
    """Return a prepared run that takes fewer parameters, from which `extended` makes all."""

    def called(x: FloatArray, p: FloatArray) -> Final:
        final = run(x, extended(p))
        return final, run.status()

    return PreparedStates(called)


@final
class _OneCase:
    """A case that is run again and again, and its memory."""

    def __init__(self, modes: ModeModels, layout: Layout, t_span: tuple[float, float], options: PrepareOptions) -> None:
        self.modes, self.layout = modes, layout
        contacts, nothing = len(modes.equations.contacts), PhaseReductions(_NOTHING, ())
        sizes = len(layout.variables), len(layout.parameters)
        t0, t1 = (np.array([t]) for t in t_span)
        x, c = (np.zeros((1, size)) for size in sizes)
        self.state = HybridState.starting(t0, x, c, t1 - t0, contacts, len(layout.states))
        table = case_table(self.state, t1, nothing, np.zeros(0), no_samples(), np.empty((0, 0)))
        self.executor = PhaseExecutor(modes, layout, options, 0, nothing, self.state, table, fits=False)
        self.numbers = table.numbers
        changing = (self.state.t, *self.state.cases, *self.numbers)
        self.begins = [(values, values.copy()) for values in changing]

    def run(self, x: FloatArray, p: FloatArray) -> Final | None:
        """Return the final state and the status; None where the loop over phases cannot run the motion."""
        for values, begin in self.begins:
            values[...] = begin
        state, numbers = self.state, self.numbers
        state.x[0], state.c[0], numbers.state[0], numbers.runner[0] = x, p, RUNNING, NOT_BEGUN
        while numbers.state[0] == RUNNING:
            if not self.executor.run_alone():
                return None
        status = Status(numbers.state[0])
        return state.x[0].copy(), self._jammed() if status in BROKEN else status

    def _jammed(self) -> Status:
        """Return the status of a failure, that of a paradox near one."""
        values = OutputValues(self.modes, self.layout, self.state.c)
        hopeless = values.jammed(self.state.states(np.zeros(1, np.intp), self.numbers.history))[0]
        return Status.CONTACT_IMPOSSIBLE if hopeless else Status(self.numbers.state[0])


def _swept(
    modes: ModeModels,
    layout: Layout,
    t_span: tuple[float, float],
    options: PrepareOptions,
    x: FloatArray,
    p: FloatArray,
) -> Final:
    """Return the final state and the status of a motion, as a sweep of it gives them."""
    t0, t1 = (np.array([t]) for t in t_span)
    request = SweepRequest(
        t=t0,
        t1=t1,
        x=x[np.newaxis],
        p=p[np.newaxis],
        status=np.array([RUNNING]),
        t_eval=None,
        reductions=PhaseReductions(_NOTHING, ()),
        jumps=None,
        options=SweepOptions(
            method=options.method,
            rtol=options.rtol,
            atol=options.atol,
            max_step=options.max_step,
            max_steps=options.max_steps,
            inputs=options.inputs,
        ),
        threads=1,
        layout=layout,
        varied=({}, {name: p[i : i + 1].copy() for i, name in enumerate(layout.parameters)}),
        axes={},
    )
    found = sweep(modes, request)
    final = np.array([found[name][0] for name in layout.variables])
    return final, Status(found.status[0])
