"""Formulations `baumgarte` and `ggl`: terms and multipliers that keep positions and velocities on the constraints.

In `baumgarte`, J q_ddot = bias - 2 alpha (J q_dot + drift) - beta^2 phi, so that each violation obeys the equation of a
damped oscillator (J. Baumgarte, Computer Methods in Applied Mechanics and Engineering 1 (1972) 1-16). Runs backward in
time take -|alpha| (`dalembert.ir.program`): with a positive one violations would grow.

In `ggl`, q_dot = v + J^T mu, M v_dot = forcing + J^T lam, phi(q) = 0, J v + drift = 0: the stabilised index-2 system of
C. W. Gear, B. Leimkuhler and G. K. Gupta, Journal of Computational and Applied Mathematics 12 & 13 (1985) 77-90. mu
vanishes along exact motions; nonholonomic constraints have no position and no mu.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..ir.node import Node
from ..ir.program import DECAY_RATE, FIXED_GAINS
from ..mechanics.equations import EquationsOfMotion
from .base import Formulation, ReducedSystem, ReductionSettings, StageSystem
from .dependent_rows import RankSolver
from .grouped_rows import GroupSolver
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


_WEIGHT = 1e-4
"""Weight of multipliers beside residuals, which takes what iterations leave of them out of the estimates of errors."""


@final
class GearGuptaLeimkuhler(Formulation):
    """State q, q_dot; multipliers are unknowns of every stage of an implicit method."""

    name = "ggl"

    def reduce(
        self,
        equations: EquationsOfMotion,
        requested: Sequence[str],
        settings: ReductionSettings = ReductionSettings(),  # noqa: B008 - frozen
    ) -> ReducedSystem:
        """See `Formulation.reduce`."""
        saddle = SaddlePoint.of(equations, guarded=not settings.regular, redundancy=settings.redundancy)
        demand = [row.bias for row in saddle.rows]
        found = saddle.accelerations(demand, equations.name)
        note = "q and q_dot with multipliers at every stage of an implicit method, which hold positions and velocities"
        reduced = reduce_saddle(self.name, equations, requested, found, [note], saddle=saddle)
        if not saddle.rows:
            return reduced
        return replace(
            reduced,
            start_projection=saddle.projection(equations),
            stages=_stages(equations, saddle, saddle.multipliers(demand, equations.name)),
        )


def _with_rest(saddle: SaddlePoint, residuals: Sequence[Node], multipliers: Sequence[Node]) -> list[Node]:
    """Return what constraints leave that depend on each other, and what of multipliers is to vanish in their place."""
    solver, graph = saddle.schur(len(residuals), ""), saddle.graph
    assert isinstance(solver, RankSolver | GroupSolver)
    weight = graph.node(_WEIGHT) * graph.sum(solver.matrix[i][i] for i in range(len(residuals)))
    rest = [weight * value for value in multipliers]
    within = solver.within([a - b for a, b in zip(residuals, rest, strict=True)])
    return [a + b for a, b in zip(within, rest, strict=True)]


def _stages(equations: EquationsOfMotion, saddle: SaddlePoint, start: Sequence[Node]) -> StageSystem:
    graph, rows = equations.graph, saddle.rows
    positions = [row for row in rows if row.position is not None]
    lam = [graph.input(f"multiplier {i}") for i in range(len(rows))]
    mu = [graph.input(f"shift {i}") for i in range(len(positions))]
    rates = [
        speed + graph.sum(row.jacobian[i] * weight for row, weight in zip(positions, mu, strict=True))
        for i, speed in enumerate(equations.qdot)
    ]
    accelerations = saddle.combine(saddle.mass.half_solve(saddle.forcing), lam)
    left = [*velocity_residuals(equations), *(row.position for row in positions if row.position is not None)]
    if saddle.redundancy is not None:
        left = [*_with_rest(saddle, left[: len(rows)], lam), *_with_rest(saddle, left[len(rows) :], mu)]
    return StageSystem(
        inputs=(*equations.q, *equations.qdot, *lam, *mu),
        rhs=(*rates, *accelerations, *left),
        multipliers=(*start, *([graph.zero] * len(mu))),
    )
