"""Prepared runs of scenes with contacts: fixed span, method and tolerances."""

from __future__ import annotations

from threading import get_ident
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..codegen.llvm.prepared import Admission
from ..codegen.runs import Final, Prepared, PreparedStates
from ..ir.program import along_run
from ..methods.status import Status
from ..options import PrepareOptions
from ..starts.inputs import warn_below_floor
from .case_runs import CaseRuns
from .given_values import refuse_kept_invariants, refuse_open_gains
from .mode_models import ModeModels
from .output_values import PhaseReductions
from .runner_choice import RunnerChoice
from .stops import stops_of

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def prepare_with_contacts(
    model: CompiledModel, t_span: tuple[float, float], options: PrepareOptions
) -> tuple[str, Prepared]:
    """Return the method and the run of a model with several modes, in the time of the model."""
    modes = refuse_kept_invariants(model, options.project_invariants)
    warn_below_floor(options.rtol, options.atol)
    refuse_open_gains(modes)
    opened = modes.model(modes.open_mode)
    method = opened.choose_method(options.method, options.rtol, options.atol, many=True)
    return method, _prepared(modes, t_span, options)


def _prepared(modes: ModeModels, t_span: tuple[float, float], options: PrepareOptions) -> Prepared:
    """Return a function from variables (2 n_q + n_z,) and parameters of the scene (n_p,) to the final variables.

    Every thread keeps its memory.
    """
    tests = modes.admission
    admission = None if tests is None else Admission(tests, t_span[0], options.rtol)
    spans = np.array([t_span[0]]), np.array([t_span[1]])
    stopping = modes.changes or (options.inputs is not None and options.inputs.sampled)
    names, backward = modes.layout.parameters, t_span[1] < t_span[0]
    own: dict[int, CaseRuns] = {}

    def run(x: FloatArray, p: FloatArray) -> Final:
        if not (np.isfinite(x.sum()) and np.isfinite(p.sum())):
            return np.full_like(x, np.nan), Status.NON_FINITE
        p = along_run(names, p, backward=backward)
        case = own.get(get_ident())
        if case is None:
            case = own[get_ident()] = CaseRuns(RunnerChoice(modes, options, PhaseReductions({}, ())))
        stops = stops_of(modes, options.inputs, p[np.newaxis], spans) if stopping else None
        case.begin(*t_span, x, p, stops)
        case.run()
        return case.cases.x[0].copy(), case.status

    return PreparedStates(run, admission)
