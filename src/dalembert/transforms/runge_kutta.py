"""Runge-Kutta steps as straight-line code: [Kernel, tableau] -> kernels of an adaptive attempt, or of a fixed step.

Both evaluate the stages of a method between their parts of `dalembert.transforms.runge_kutta_parts`. The work of a
fixed step is the same in every step, so the operations of its kernels (stages, corrections, and the tests of its end)
are those of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import final

from ..frozen import frozen
from ..ir.kernel import Assignment, Kernel, Lines, Load, Operand
from ..methods.names import FixedTableau
from ..methods.step_constants import LINEAR_CHANGE, SMALL_COMPONENT
from ..methods.tableau import Tableau
from .pipelines import PRODUCT_FUSION, STEP_PASSES
from .runge_kutta_parts import Attempt, Parts, Start, Vector, inlined, loads_of, names_of
from .taylor.step import STEP_ARGUMENTS

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


@final
class FixedStep(Parts):
    """The stages and the end of a step of fixed size.

    Parameters
    ----------
    rhs : Kernel
    tableau : FixedTableau
    step : float
        Size of the step [s].
    """

    def __init__(self, rhs: Kernel, tableau: FixedTableau, step: float) -> None:
        super().__init__(rhs, weighted=False)
        self.tableau, self.step = tableau, step

    def stages(self) -> tuple[int, ...]:
        """See `Parts.stages`."""
        return tuple(range(len(self.tableau.nodes)))

    def time(self, stage: int) -> Operand:
        """See `Parts.time`."""
        return self.lines.add("t_", self.tableau.nodes[stage] * self.step)

    def point(self, stage: int) -> Vector:
        """See `Parts.point`."""
        return self._moved(self.tableau.rows[stage])

    def outputs(self) -> Vector:
        """See `Parts.outputs`."""
        return self._moved(self.tableau.weights)

    def _moved(self, weights: Sequence[float]) -> Vector:
        """Return the state after a step along a sum of slopes, which a single weight is not multiplied into."""
        used = [(stage, weight) for stage, weight in enumerate(weights) if weight]
        if len(used) == 1:
            ((stage, weight),) = used
            pairs = zip(self.slopes[stage], self.y, strict=True)
            return [self.lines.fma(slope, weight * self.step, y) for slope, y in pairs]
        sums: Vector = [0.0] * self.n
        for stage, weight in used:
            sums = [self.lines.fma(k, weight, total) for k, total in zip(self.slopes[stage], sums, strict=True)]
        return [self.lines.fma(total, self.step, y) for total, y in zip(sums, self.y, strict=True)]


def fixed_step_pieces(rhs: Kernel, tableau: FixedTableau, step: float) -> AttemptPieces:
    """Return a step of fixed size in pieces: points of stages, right-hand side, and the new state (n_y) at the end."""
    return pieces_of("step", rhs, lambda limits: FixedStep(rhs, tableau, step))


def corrected_kernel(correction: Kernel) -> Kernel:
    """Return the kernel of a state after a correction, which projects it onto constraints."""
    loaded = {load.index: load.target for load in correction.loads if load.array == "y"}
    loads, body, outputs = list(correction.loads), list(correction.body), list[Operand]()
    for i, change in enumerate(correction.outputs):
        if i not in loaded:
            loads.append(Load(f"y_{i}_", "y", i))
        old = loaded.get(i, f"y_{i}_")
        if change != 0.0:
            body.append(Assignment(f"new_{i}_", "add", (old, change)))
        outputs.append(f"new_{i}_" if change != 0.0 else old)
    return STEP_PASSES(replace(correction, loads=tuple(loads), body=tuple(body), outputs=tuple(outputs)))


def excess_kernel(correction: Kernel) -> Kernel:
    """Return by how much the last correction is too large for a state on the constraints, at most 0 where it is small.

    Arguments are the state after it, y, and before it, s; a component may change by the share `LINEAR_CHANGE` of its
    size and of `SMALL_COMPONENT` of the largest one.
    """
    lines = Lines()
    places = [i for i, change in enumerate(correction.outputs) if change != 0.0]
    new, old = ([f"{stem}_{i}_" for i in places] for stem in ("y", "s"))
    sizes = [lines.op("abs", value) for value in new]
    largest = sizes[0]
    for size in sizes[1:]:
        largest = lines.op("max", size, largest)
    least, excess = lines.mul(largest, LINEAR_CHANGE * SMALL_COMPONENT), list[Operand]()
    for value, size, before in zip(new, sizes, old, strict=True):
        change = lines.op("abs", lines.sub(value, before))
        excess.append(lines.sub(lines.fma(size, -LINEAR_CHANGE, change), least))
    total = excess[0]
    for one in excess[1:]:
        total = lines.op("max", one, total)
    loads = [
        Load(name, array, i) for names, array in ((new, "y"), (old, "s")) for name, i in zip(names, places, strict=True)
    ]
    return STEP_PASSES(Kernel("excess", STEP_ARGUMENTS, tuple(loads), tuple(lines.body), (total,)))


def finite_kernel(n: int) -> Kernel:
    """Return a kernel that is 0 where a state (n,) is finite, else NaN."""
    lines, names = Lines(), names_of("y", n)
    total: Operand = lines.op("mul", names[0], 0.0)
    for name in names[1:]:
        total = lines.op("fma", name, 0.0, total)
    return Kernel("finite", STEP_ARGUMENTS, loads_of(names, "y", 0), tuple(lines.body), (total,))
