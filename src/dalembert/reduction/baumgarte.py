"""Formulation `baumgarte`: acceleration constraints with stabilising position and velocity terms.

J q_ddot = bias - 2 alpha (J q_dot + drift) - beta^2 phi, so that each violation obeys the equation of a damped
oscillator (J. Baumgarte, Computer Methods in Applied Mechanics and Engineering 1 (1972) 1-16). Runs backward in time
take -|alpha| (`dalembert.ir.program`): with a positive one violations would grow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..ir.node import Node
from ..ir.program import DECAY_RATE, FIXED_GAINS
from ..mechanics.equations import EquationsOfMotion
from .base import Formulation, ReducedSystem, ReductionSettings
from .saddle import SaddlePoint, reduce_saddle, velocity_residuals

GAINS = (DECAY_RATE, "baumgarte_beta")
"""Parameters that the formulation adds where the gains are not given; they may be left out."""

DEFAULT_GAIN = 10.0
"""Their value [1/s] where no run says how long its steps are."""


@final
class Baumgarte(Formulation):
    """State q, q_dot; stabilised acceleration constraints."""

    name = "baumgarte"

    def reduce(
        self,
        equations: EquationsOfMotion,
        requested: Sequence[str],
        settings: ReductionSettings = ReductionSettings(),  # noqa: B008 - frozen
    ) -> ReducedSystem:
        """See `Formulation.reduce`."""
        defaults: dict[str, float] = {}
        fixed = FIXED_GAINS[0] in equations.symbols.parameters
        if equations.constraints and not fixed:
            defaults = dict.fromkeys(GAINS, DEFAULT_GAIN)
            equations = _with_parameters(equations, GAINS)
            how = "of one over a run's typical step unless given as parameters"
        else:
            how = "given with the formulation"
        saddle = SaddlePoint.of(equations, guarded=not settings.regular, redundancy=settings.redundancy)
        found = saddle.accelerations([row.bias for row in saddle.rows], equations.name)
        pulled = saddle.accelerations(_demand(equations, saddle, FIXED_GAINS if fixed else GAINS), equations.name)
        note = f"q and q_dot, accelerations from the saddle-point system, stabilised with gains {how}"
        reduced = reduce_saddle(self.name, equations, requested, found, [note], saddle=saddle)
        return replace(
            reduced,
            rhs=(*equations.qdot, *pulled),
            start_projection=saddle.projection(equations),
            defaults=defaults,
        )


def with_fixed_gains(equations: EquationsOfMotion, gains: tuple[float, float] | None) -> EquationsOfMotion:
    """Return equations whose parameters include gains [1/s] that are given with the formulation, if there are any."""
    if gains is None or not equations.constraints:
        return equations
    known = dict(zip(FIXED_GAINS, gains, strict=True))
    return replace(_with_parameters(equations, FIXED_GAINS), defaults={**equations.defaults, **known})


def _with_parameters(equations: EquationsOfMotion, names: tuple[str, ...]) -> EquationsOfMotion:
    symbols = equations.symbols
    return replace(equations, symbols=replace(symbols, parameters=(*symbols.parameters, *names)))


def _demand(equations: EquationsOfMotion, saddle: SaddlePoint, gains: Sequence[str]) -> list[Node]:
    """Return the stabilised right-hand side of the acceleration constraints, J q_ddot = demand, for gains by name."""
    alpha, beta = (equations.graph.input(name) for name in gains)
    demand = []
    rows = zip(equations.constraints, saddle.demand(equations), velocity_residuals(equations), strict=True)
    for row, wanted, left in rows:
        pull = 2 * alpha * left
        if row.position is not None:
            pull = pull + beta * beta * row.position
        demand.append(wanted - pull)
    return demand
