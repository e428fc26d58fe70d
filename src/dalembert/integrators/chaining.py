"""Runs from segment to segment, chained: solutions and blocks of steps of the parts, as those of the whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret
from ..ir.program import KnotSides
from ..methods.status import Status
from .dense_output import DenseOutput, JoinedOutput, PiecewisePolynomial
from .problem import IntegrationProblem, Solution, prescribed
from .segments import KnotSegments, Segments

__all__ = [
    "Landing",
    "between_knots",
    "blocks_between_knots",
    "chained",
    "chained_blocks",
    "in_turn",
    "joined",
    "parts_of",
    "side_landing",
]

Landing = Callable[[float, FloatArray, FloatArray, FloatArray], FloatArray]
"""From a time, a state (n_y,) and the constants (n_c,) before and after it to the state after it."""


def side_landing(sides: KnotSides | None, forward: bool) -> Landing | None:
    """Return the move of a state to the sides of knots and switches that its motion goes to in a direction of time.

    `sides` is `Program.knot_sides`; None where that is None.
    """
    if sides is None:
        return None

    def landing(t: float, y: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        values = {"t": t, "y": y.tolist(), "c": after.tolist()}
        if not interpret(sides.near, values)[0]:
            return y
        found = interpret(sides.sides, values)
        return np.array(found[: len(y)] if forward else found[len(y) : 2 * len(y)])

    return landing


def in_turn(*landings: Landing | None) -> Landing | None:
    """Return several landings as one, each on the state that the one before it gives; None without any."""
    present = [landing for landing in landings if landing is not None]
    if len(present) < 2:
        return present[0] if present else None

    def landing(t: float, y: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        for one in present:
            y = one(t, y, before, after)
        return y

    return landing


def _side_landing(problem: IntegrationProblem) -> Landing | None:
    return None if problem.inputs is None else side_landing(problem.inputs.sides, problem.t1 >= problem.t0)


def parts_of(problem: IntegrationProblem, segments: Segments | KnotSegments) -> Iterator[IntegrationProblem]:
    """Yield the problem of each segment; one with times to record records its end, too, one without its steps.

    Where segments go from knot to knot, inputs have no knots in them.
    """
    inputs = None if isinstance(segments, KnotSegments) else problem.inputs
    edges, requested = segments.edges, problem.t_eval
    forward = 1.0 if problem.t1 >= problem.t0 else -1.0
    places = None if requested is None else np.searchsorted(forward * requested, forward * edges[1:-1], side="left")
    bounds = None if places is None or requested is None else [0, *places.tolist(), len(requested)]
    for k in range(len(segments)):
        times = None
        if requested is not None and bounds is not None and bounds[k] < bounds[k + 1]:
            times = np.append(requested[bounds[k] : bounds[k + 1]], edges[k + 1])
        yield replace(
            problem,
            t0=float(edges[k]),
            t1=float(edges[k + 1]),
            constants=segments.of(k),
            t_eval=times,
            first_step=problem.first_step if k == 0 else None,
            inputs=inputs,
        )


def between_knots(integrate: Callable[[IntegrationProblem], Solution]) -> Callable[[IntegrationProblem], Solution]:
    """Return an integration of problems with knots by an integration of problems without knots."""

    def run(problem: IntegrationProblem) -> Solution:
        if problem.inputs is None:
            return integrate(problem)
        segments = KnotSegments(problem)
        whole = replace(problem, constants=segments.of(0), inputs=None)
        return integrate(whole) if len(segments) == 1 else chained(integrate, problem, segments, _side_landing(problem))

    return run


def blocks_between_knots(
    step_blocks: Callable[[IntegrationProblem], Iterator[Solution]], problem: IntegrationProblem
) -> Iterator[Solution]:
    """Yield the solution of a problem in blocks of steps, none of which reaches beyond a knot of an input."""
    if problem.inputs is None:
        yield from step_blocks(problem)
        return
    segments = KnotSegments(problem)
    parts = parts_of(replace(problem, t_eval=None), segments)
    yield from chained_blocks(parts, problem, step_blocks, _side_landing(problem), lambda k: segments.of(k))


def chained_blocks(
    parts: Iterator[IntegrationProblem],
    problem: IntegrationProblem,
    step_blocks: Callable[[IntegrationProblem], Iterator[Solution]],
    landing: Landing | None,
    endings: Callable[[int], FloatArray] | None = None,
) -> Iterator[Solution]:
    """Yield the solutions of the parts of a problem in blocks of steps."""
    y, left, first = problem.y0, problem.max_steps, problem.first_step
    for k, part in enumerate(parts):
        status = Status.SUCCESS
        if k and landing is not None and endings is not None and len(y):
            y = landing(part.t0, y, endings(k - 1), part.constants)
        own = replace(part, y0=y, max_steps=left, first_step=first)
        for block in step_blocks(own) if len(y) else [prescribed(own)]:
            status = Status(block.status)
            left -= block.steps + block.rejected
            y = block.y[-1] if len(block.y) else y
            yield block
        if status is not Status.SUCCESS or left <= 0:
            return
        first = None


def chained(
    integrate: Callable[[IntegrationProblem], Solution],
    problem: IntegrationProblem,
    segments: Segments | KnotSegments,
    landing: Landing | None,
    *,
    right: bool = False,
) -> Solution:
    """Return the solution of a problem, segment by segment.

    Of the states on both sides of a break, accepted steps hold the first, or where `right` the second.
    """
    if len(segments) == 1:
        return integrate(replace(problem, constants=segments.of(0)))
    y, left = problem.y0, problem.max_steps
    done: list[Solution] = []
    recorded = problem.t_eval is not None
    for k, part in enumerate(parts_of(problem, segments)):
        if k and landing is not None:
            y = landing(part.t0, y, segments.of(k - 1, ending=True), part.constants)
        if left <= 0:
            done[-1] = replace(done[-1], status=Status.MAX_STEPS)
            break
        solution = integrate(replace(part, y0=y, max_steps=left))
        left -= solution.steps + solution.rejected
        if not solution.success:
            done.append(_requested(solution, part.t_eval, whole=True) if recorded else solution)
            break
        y = solution.y[-1]
        done.append(_requested(solution, part.t_eval) if recorded else solution)
    return joined(done, recorded=recorded, right=right)


def _requested(solution: Solution, times: FloatArray | None, *, whole: bool = False) -> Solution:
    """Return a solution with the requested times only, without its end."""
    last = 0 if times is None else len(solution.t) - (not whole)
    wrapped = None if solution.wrapped is None else solution.wrapped[:last]
    end = solution.end
    if end is None and len(solution.t):
        end = float(solution.t[-1])
    return replace(solution, t=solution.t[:last], y=solution.y[:last], wrapped=wrapped, end=end)


def joined(done: Sequence[Solution], *, recorded: bool, right: bool) -> Solution:
    """Return consecutive solutions as one; states that accepted steps share are kept once.

    `recorded` means that they are at requested times, `right` is as in `chained`.
    """
    if right and not recorded:
        done = [*(_requested(part, part.t) for part in done[:-1]), done[-1]]
    first = [0 if recorded or right or k == 0 else 1 for k in range(len(done))]
    wrapped = None
    if any(part.wrapped is not None for part in done):
        wrapped = np.concatenate(
            [(part.y if part.wrapped is None else part.wrapped)[i:] for i, part in zip(first, done, strict=True)]
        )
    return Solution(
        status=done[-1].status,
        t=np.concatenate([part.t[i:] for i, part in zip(first, done, strict=True)]),
        y=np.concatenate([part.y[i:] for i, part in zip(first, done, strict=True)]),
        steps=sum(part.steps for part in done),
        rejected=sum(part.rejected for part in done),
        evaluations=sum(part.evaluations for part in done),
        dense=_dense([part.dense for part in done]),
        wrapped=wrapped,
        end=done[-1].end,
    )


def _dense(parts: Sequence[DenseOutput | None]) -> DenseOutput | None:
    """Return consecutive continuous outputs as one; None where there is none."""
    found = [part for part in parts if part is not None and len(part.knots) > 1]
    if not found:
        return parts[0]
    polynomials = [part for part in found if isinstance(part, PiecewisePolynomial)]
    if len(polynomials) == len(found) and len({part.coefficients.shape[1] for part in polynomials}) == 1:
        knots = np.concatenate([found[0].knots[:1], *(part.knots[1:] for part in found)])
        return PiecewisePolynomial(knots, np.concatenate([part.coefficients for part in polynomials]))
    edges = np.array([float(found[0].knots[0]), *(float(part.knots[-1]) for part in found)])
    return JoinedOutput(edges, found)
