"""Prepared runs of scenes with contacts: fixed span, method and tolerances."""

from __future__ import annotations

from collections.abc import Callable
from threading import get_ident

import numpy as np

from ...arrays import FloatArray
from ...codegen.runs import Final, Prepared, PreparedStates
from ...integrators.workspace import RUNNING
from ...ir.program import Layout
from ...methods.status import Status
from ...options import PrepareOptions, SweepOptions
from .lone_case import LoneCase
from .mode_models import ModeModels
from .phases import compiled_phases
from .reductions import PhaseReductions
from .request import SweepRequest
from .stops import stops_of
from .sweep import sweep

__all__ = ["prepared", "with_extension"]


def prepared(modes: ModeModels, layout: Layout, t_span: tuple[float, float], options: PrepareOptions) -> Prepared:
    """Return a function from variables (2 n_q + n_z,) and parameters of the scene (n_p,) to the final variables.

    The loop over phases runs each motion, with memory that every thread keeps. Motions that it cannot run go phase by
    phase as in a sweep.
    """
    given = None if options.inputs is None or not options.inputs.sampled else options.inputs
    spans = np.array([t_span[0]]), np.array([t_span[1]])
    compiled, stopping = compiled_phases(modes), given is not None or modes.changes
    own: dict[int, LoneCase] = {}

    def run(x: FloatArray, p: FloatArray) -> Final:
        if not (np.isfinite(x.sum()) and np.isfinite(p.sum())):
            return np.full_like(x, np.nan), Status.NON_FINITE
        if compiled:
            case = own.get(get_ident())
            if case is None:
                case = own[get_ident()] = LoneCase(modes, layout, options, PhaseReductions({}, ()))
            if stopping:
                case.stop_at(stops_of(modes, layout, given, p[np.newaxis], spans))
            case.begin(*t_span, x, p)
            if case.run():
                return case.state.x[0].copy(), Status(int(case.table.numbers.state[0]))
        return _swept(modes, layout, t_span, options, x, p)

    return PreparedStates(run)


def with_extension(run: Prepared, extended: Callable[[FloatArray], FloatArray]) -> Prepared:
    """Return a prepared run that takes fewer parameters, from which `extended` makes all."""

    def called(x: FloatArray, p: FloatArray) -> Final:
        final = run(x, extended(p))
        return final, run.status()

    return PreparedStates(called)


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
        reductions=PhaseReductions({}, ()),
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
