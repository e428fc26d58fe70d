"""Formulation `baumgarte`: acceleration constraints with stabilising position and velocity terms.

J q_ddot = bias - 2 alpha (J q_dot + drift) - beta^2 phi, so that each violation obeys the equation of a damped
oscillator (J. Baumgarte, Computer Methods in Applied Mechanics and Engineering 1 (1972) 1-16). Runs backward in time
take -|alpha| (`dalembert.ir.decay_rates`): with a positive one violations would grow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..ir.decay_rates import DECAY_RATE
from ..ir.graph import Node
from ..mechanics.equations import EquationsOfMotion
from .base import Formulation, ReducedSystem, ReductionSettings
from .saddle import SaddlePoint, reduce_saddle, velocity_residuals

__all__ = ["DEFAULT_GAIN", "GAINS", "Baumgarte"]

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
        if equations.constraints and settings.gains is None:
            symbols = equations.symbols
            equations = replace(equations, symbols=replace(symbols, parameters=(*symbols.parameters, *GAINS)))
            defaults = dict.fromkeys(GAINS, DEFAULT_GAIN)
            how = "of one over a run's typical step unless given as parameters"
        else:
            how = "given with the formulation"
        saddle = SaddlePoint.of(equations, guarded=not settings.regular)
        found = saddle.accelerations([row.bias for row in saddle.rows], equations.name)
        pulled = saddle.accelerations(_demand(equations, settings.gains), equations.name)
        note = f"q and q_dot, accelerations from the saddle-point system, stabilised with gains {how}"
        reduced = reduce_saddle(self.name, equations, requested, found, [note], saddle=saddle)
        return replace(
            reduced,
            rhs=(*equations.qdot, *pulled),
            start_projection=saddle.projection(equations),
            defaults=defaults,
        )


def _demand(equations: EquationsOfMotion, gains: tuple[float, float] | None) -> list[Node]:
    """Return the stabilised right-hand side of the acceleration constraints, J q_ddot = demand."""
    graph = equations.graph
    if gains is None:
        alpha, beta = (graph.input(name) for name in GAINS)
    else:
        alpha, beta = (graph.node(float(gain)) for gain in gains)
    demand = []
    for row, left in zip(equations.constraints, velocity_residuals(equations), strict=True):
        pull = 2 * alpha * left
        if row.position is not None:
            pull = pull + beta * beta * row.position
        demand.append(row.bias - pull)
    return demand
