"""A Runge-Kutta step of fixed size as straight-line kernels: its stages, its corrections, and the tests of its end.

Its work is the same in every step, so the operations of these kernels are those of a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..ir.kernel import Assignment, Kernel, Lines, Load, Operand
from ..methods.names import FixedTableau
from ..methods.step_constants import LINEAR_CHANGE, SMALL_COMPONENT
from .pipelines import STEP_PASSES
from .runge_kutta import AttemptPieces, pieces_of
from .runge_kutta_parts import Parts, Vector, loads_of, names_of
from .taylor.step import STEP_ARGUMENTS


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
