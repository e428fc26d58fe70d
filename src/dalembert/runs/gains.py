"""Gains of the formulation `baumgarte`, where they are not given, from the steps of a run without them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..codegen.engine import Engine
from ..ir.program import Layout, Program, along_run
from ..reduction.baumgarte import GAINS
from ..starts import inputs
from ..steps.problem import IntegrationProblem, Solution

if TYPE_CHECKING:
    from .case_settings import CaseSettings
    from .cases import Cases

_PILOT_STEPS = 24
_SHARE = 0.5
"""Product of gain and step: violations decay by two thirds over two steps, far within the stability of any method."""

Run = Callable[[IntegrationProblem], Solution]


def _left_out(layout: Layout, given: Mapping[Any, Any]) -> list[str]:
    if not layout.defaults:
        return []
    known = {layout.aliases.get(str(key), str(key)) for key in given}
    return [name for name in GAINS if name in layout.defaults and name not in known] if layout.state else []


def _gain_for(problem: IntegrationProblem, start: FloatArray, run: Run) -> float:
    """Return the gain [1/s] for both positions and velocities, or 0 where there is no step to go by.

    A short run with the constants `start` (n_c,), those without any gain, gives the step.
    """
    pilot = run(replace(problem, constants=start, t_eval=None, dense=False, max_steps=_PILOT_STEPS))
    sizes = np.abs(np.diff(pilot.t))
    return _SHARE / float(np.max(sizes)) if len(sizes) else 0.0


def with_gains(program: Program, run: Run, problem: IntegrationProblem, given: Mapping[Any, Any]) -> IntegrationProblem:
    """Return the problem with the gains that `given` parameters leave out, where the formulation has any."""
    layout = program.layout
    out = _left_out(layout, given)
    if not out:
        return problem

    def constants(gain: float) -> FloatArray:
        p = inputs.parameter_vector(layout, {**given, **dict.fromkeys(out, gain)})
        return inputs.constants(program, along_run(layout.parameters, p, backward=problem.t1 < problem.t0))

    return replace(problem, constants=constants(_gain_for(problem, constants(0.0), run)))


def give_gains(engine: Engine, cases: Cases, settings: CaseSettings, given: Mapping[Any, Any]) -> None:
    """Give all cases the gains that the first one would get alone, where the formulation has any left out."""
    out = _left_out(cases.program.layout, given)
    if not out:
        return
    from .cases import single_problem

    problem = single_problem(cases, settings, 0)
    if problem is None:
        return
    for name in out:
        cases.set_parameter(name, np.zeros(1))
    start = cases.constants(slice(0, 1))[0]
    gain = _gain_for(problem, start, lambda pilot: engine.integrate(pilot, settings.method))
    for name in out:
        cases.set_parameter(name, np.array([gain]))
