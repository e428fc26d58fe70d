"""Attempt of an adaptive Runge-Kutta step as straight-line code: [Kernel, Tableau] -> [Kernel].

An attempt evaluates the stages of a method between its parts of `dalembert.transforms.runge_kutta_parts`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import final

from ..frozen import frozen
from ..ir.kernel import Kernel, Load
from ..methods.tableau import Tableau
from .pipelines import PRODUCT_FUSION, STEP_PASSES
from .runge_kutta_parts import Attempt, Parts, Start, Vector, inlined, loads_of, names_of

_ARGUMENTS = ("t", "y", "c", "s")


def attempt_kernel(
    rhs: Kernel,
    tableau: Tableau,
    *,
    dense: bool,
    carried: bool,
    knots: Kernel | None = None,
    weighted: bool = False,
) -> Kernel:
    """Return one attempt as a kernel of the arguments (t, y, c, s).

    s holds the `SETTINGS` of `dalembert.transforms.runge_kutta_parts`. The outputs are the new state (n_y), the size of
    the step (0 where it is rejected), a number that is not 0 where a value is not finite, `CONTROL`, the slopes (n_y)
    if `carried`, and, if `dense`, the coefficients of each component in turn, in powers of the fraction of the step.
    Slopes can be carried from the end of a step to the next where nothing changes the state in between. `knots` has
    the largest sizes of a step, forward and backward in time, that knots of tables allow. Where `weighted`, s has an
    absolute tolerance for each component of the state.
    """
    parts = Attempt(rhs, tableau, carried=carried, dense=dense, knots=knots, weighted=weighted)
    return _straight("attempt", rhs, parts, knots)


def start_kernel(rhs: Kernel, tableau: Tableau, *, carried: bool, weighted: bool = False) -> Kernel:
    """Return the kernel of the inputs of the first attempt: the outputs of an attempt that ended at the initial state.

    The size of the first step is that of Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I,
    section II.4; it is 0 where the slopes are not finite.
    """
    return _straight("start", rhs, Start(rhs, tableau, carried=carried, weighted=weighted))


def _straight(name: str, rhs: Kernel, parts: Parts, knots: Kernel | None = None) -> Kernel:
    evaluate = inlined(parts.lines, PRODUCT_FUSION(rhs))
    for stage in parts.stages():
        parts.slopes[stage] = evaluate(parts.time(stage), parts.point(stage))
    outputs = tuple(parts.outputs())
    constants = dict.fromkeys([*_constants(rhs), *(_constants(knots) if knots else ())])
    kernel = Kernel(name, _ARGUMENTS, (*parts.loads, *constants), tuple(parts.lines.body), outputs)
    return STEP_PASSES(kernel)


@final
@frozen
class AttemptPieces:
    """An attempt or a start in pieces, for a right-hand side too large to be inlined in every stage.

    Attributes
    ----------
    name : str
        Prefix of the names of its kernels.
    rhs : Kernel
        The right-hand side, of a state that holds only the components `moved`.
    moved : tuple of int
        Components of the state that the right-hand side reads.
    stages : tuple of (int, Kernel)
        The number of each stage that is evaluated, in order, and a kernel of (t, y, s, k) that gives the point of
        its evaluation: the components `moved`, then the time. k holds the slopes of stage i from i * n_y on.
    finish : Kernel
        The outputs, from (t, y, s, k).
    knots : Kernel or None
        Largest sizes of a step, from (t, y, c), called first; its two outputs lie in k behind all slopes.
    """

    name: str
    rhs: Kernel
    moved: tuple[int, ...]
    stages: tuple[tuple[int, Kernel], ...]
    finish: Kernel
    knots: Kernel | None = None

    @property
    def slopes(self) -> int:
        """Number of slopes of all stages in k."""
        return (self.stages[-1][0] + 1) * len(self.rhs.outputs)

    @property
    def held(self) -> int:
        """Number of values in k."""
        return self.slopes if self.knots is None else self.slopes + len(self.knots.outputs)


def attempt_pieces(
    rhs: Kernel,
    tableau: Tableau,
    *,
    dense: bool,
    carried: bool,
    knots: Kernel | None = None,
    weighted: bool = False,
) -> AttemptPieces:
    """Return the attempt of `attempt_kernel` in pieces; together they compute the same bits."""

    def make(limits: tuple[str, str] | None = None) -> Attempt:
        return Attempt(rhs, tableau, carried=carried, dense=dense, knots=limits, weighted=weighted)

    return pieces_of("attempt", rhs, make) if knots is None else pieces_of("attempt", rhs, make, knots)


def start_pieces(rhs: Kernel, tableau: Tableau, *, carried: bool, weighted: bool = False) -> AttemptPieces:
    """Return the start of `start_kernel` in pieces; together they compute the same bits."""
    return pieces_of("start", rhs, lambda limits: Start(rhs, tableau, carried=carried, weighted=weighted))


def pieces_of(
    name: str, rhs: Kernel, make: Callable[[tuple[str, str] | None], Parts], knots: Kernel | None = None
) -> AttemptPieces:
    """Return a step in pieces; `make` gives its parts, from the names of the two limits where `knots` has some."""
    n, limits = len(rhs.outputs), None if knots is None else ("limit_forward", "limit_backward")
    slopes = (make(limits).stages()[-1] + 1) * n
    moved = tuple(sorted({load.index for load in rhs.loads if load.array == "y" and load.index is not None}))

    def piece(label: str, build: Callable[[Parts], Vector]) -> Kernel:
        parts = make(limits)
        held = [] if limits is None else [*loads_of(limits, "k", slopes)]
        for stage in parts.stages():
            parts.slopes[stage] = names_of(f"k_{stage}", n)
            held += loads_of(parts.slopes[stage], "k", stage * n)
        outputs = tuple(build(parts))
        arguments = ("t", "y", "s", "k")
        kernel = Kernel(f"{name}_{label}", arguments, (*parts.loads, *held), tuple(parts.lines.body), outputs)
        return STEP_PASSES(kernel)

    def point(stage: int) -> Callable[[Parts], Vector]:
        return lambda parts: [*(parts.point(stage)[i] for i in moved), parts.time(stage)]

    places = {index: place for place, index in enumerate(moved)}
    loads = tuple(
        replace(load, index=places[load.index]) if load.array == "y" and load.index is not None else load
        for load in rhs.loads
    )
    return AttemptPieces(
        name=name,
        rhs=replace(PRODUCT_FUSION(rhs), loads=loads),
        moved=moved,
        stages=tuple((stage, piece(f"stage{stage}", point(stage))) for stage in make(limits).stages()),
        finish=piece("finish", lambda parts: parts.outputs()),
        knots=None if knots is None else replace(knots, name="attempt_limits"),
    )


def _constants(rhs: Kernel) -> tuple[Load, ...]:
    used = sorted({load.index or 0 for load in rhs.loads if load.array == "c"})
    return tuple(Load(f"c_{index}_", "c", index) for index in used)
