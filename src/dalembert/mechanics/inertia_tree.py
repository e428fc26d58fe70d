"""Bodies as a tree of steps, each of which turns a frame or moves its point; products with the mass matrix along it.

The kinematic screw (omega, v) of a step is that of its parent, carried to its point and frame, with the partial
kinematic screws of the coordinates that enter there. A coordinate may enter at several steps: an absolute angle turns
its own body and moves the point that the next one hangs from.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..scene.model import Components
from ..transforms.linear import Matrix
from . import screws as vec
from .kinematics import Motion, Pose
from .screws import (
    Inertia,
    Rows,
    Screw,
    Step,
    Twist,
    add_inertia,
    add_screw,
    carry_inertia,
    carry_screw,
    carry_twist,
    momentum,
    momentum_screw,
    moved_twist,
    power,
)

WORTH = 2000
"""Operations of the unrolled elimination of the mass matrix from which on that along the tree is tried."""
_ENTRY = 8
"""Operations of an entry of the mass matrix (measured on chains in the plane)."""


@final
@frozen
class TreeStep:
    """A step of the tree.

    Attributes
    ----------
    parent : int
        Number of the step where it starts; -1 for the origin.
    rotation, offset
        As in `Step`.
    motions : tuple of Motion
        Partial kinematic screws that enter.
    inertia : Inertia or None
        Of the bodies that have this frame and point.
    """

    parent: int
    rotation: Rows | None
    offset: Components | None
    motions: tuple[Motion, ...]
    inertia: Inertia | None


@final
@frozen
class InertiaTree:
    """The bodies of a scene as steps, parents before children.

    Attributes
    ----------
    size : int
        Number of coordinates, or of speeds.
    steps : tuple of TreeStep
    """

    size: int
    steps: tuple[TreeStep, ...]

    @staticmethod
    def of(size: int, poses: Sequence[Pose], inertias: Mapping[Pose, Inertia]) -> InertiaTree:
        """Return the tree of the poses that carry bodies, with the inertias at them."""
        held = set(inertias)
        for pose in reversed(poses):
            if pose in held and pose.parent is not None:
                held.add(pose.parent)
        held.add(poses[0])
        kept = [pose for pose in poses if pose in held]
        numbers: dict[Pose | None, int] = {None: -1} | {pose: i for i, pose in enumerate(kept)}
        return InertiaTree(
            size,
            tuple(
                TreeStep(numbers[pose.parent], pose.rotation, pose.offset, pose.motions, inertias.get(pose))
                for pose in kept
            ),
        )

    # -- structure ------------------------------------------------------------------------

    def dense_operations(self, limit: int, entry: int = _ENTRY) -> int:
        """Return the operations of a solution by the unrolled L D L^T, or some number above `limit`.

        An entry of the mass matrix is taken to have so many.
        """
        paths, near = [0] * len(self.steps), [0] * self.size
        for number, step in enumerate(self.steps):
            path = 0 if step.parent < 0 else paths[step.parent]
            for motion in step.motions:
                path |= 1 << motion.coordinate
            paths[number] = path
            if step.inertia is not None:
                for i in _places(path):
                    near[i] |= path
        count, left = entry * sum(row.bit_count() for row in near) // 2, set(range(self.size))
        while left and count <= limit:
            pivot = min(left, key=lambda i: (near[i].bit_count(), -i))
            left.remove(pivot)
            clique = near[pivot] & ~(1 << pivot)
            k = clique.bit_count()
            count += k * k + 6 * k + 1
            for i in _places(clique):
                near[i] = (near[i] | clique) & ~(1 << pivot)
        return count

    @property
    def moving(self) -> list[bool]:
        """Whether the kinematic screw of each step depends on any coordinate."""
        found: list[bool] = []
        for step in self.steps:
            found.append(bool(step.motions) or (step.parent >= 0 and found[step.parent]))
        return found

    def ancestors(self, number: int) -> Iterator[tuple[TreeStep, TreeStep]]:
        """Yield a step and its parent, from step `number` to the origin."""
        step = self.steps[number]
        while step.parent >= 0:
            parent = self.steps[step.parent]
            yield step, parent
            step = parent

    # -- other coordinates ----------------------------------------------------------------

    def substituted(self, graph: Graph, values: Mapping[Node, Node]) -> InertiaTree:
        """Return the tree with inputs replaced."""
        return self._mapped(lambda nodes: graph.substitute(nodes, values)) if values else self

    def in_speeds(self, graph: Graph, basis: Matrix) -> InertiaTree:
        """Return the tree of speeds u, where the rates of the coordinates are basis . u and what is given."""
        rows = [[(k, entry) for k, entry in enumerate(row) if not entry.is_zero] for row in basis]

        def combined(motions: Sequence[Motion]) -> tuple[Motion, ...]:
            found: dict[int, Components] = {}
            for motion in motions:
                for k, entry in rows[motion.coordinate]:
                    part = vec.scale(entry, motion.direction)
                    found[k] = vec.add(found[k], part) if k in found else part
            angular = any(motion.angular for motion in motions)
            return tuple(Motion(k, found[k], angular) for k in sorted(found) if not vec.is_zero(found[k]))

        steps = tuple(replace(step, motions=combined(step.motions)) for step in self.steps)
        return InertiaTree(len(basis[0]), steps)

    def _mapped(self, change: Callable[[Sequence[Node]], Sequence[Node]]) -> InertiaTree:
        """Return the tree with a function applied to the values of each part."""

        def components(a: Components) -> Components:
            x, y, z = change(a)
            return x, y, z

        def rows(a: Rows) -> Rows:
            return components(a[0]), components(a[1]), components(a[2])

        def inertia(old: Inertia) -> Inertia:
            return Inertia(change([old.mass])[0], components(old.moment), rows(old.second))

        return InertiaTree(
            self.size,
            tuple(
                TreeStep(
                    step.parent,
                    None if step.rotation is None else rows(step.rotation),
                    None if step.offset is None else components(step.offset),
                    tuple(Motion(m.coordinate, components(m.direction), m.angular) for m in step.motions),
                    None if step.inertia is None else inertia(step.inertia),
                )
                for step in self.steps
            ),
        )

    @property
    def nodes(self) -> list[Node]:
        """All values of the tree."""
        found: list[Node] = []

        def keep(nodes: Sequence[Node]) -> Sequence[Node]:
            found.extend(nodes)
            return nodes

        self._mapped(keep)
        return found

    # -- the mass matrix ------------------------------------------------------------------

    def mass_matrix(self, graph: Graph) -> Matrix:
        """Return the mass matrix, of composite bodies."""
        matrix: Matrix = [[graph.zero] * self.size for _ in range(self.size)]
        for number, composite in self._composites():
            fill_mass_matrix(matrix, self.steps[number].motions, composite, self.ancestors(number))
        return matrix

    def diagonal(self, graph: Graph) -> list[Node]:
        """Return the diagonal of the mass matrix."""
        counts = [0] * self.size
        for step in self.steps:
            for motion in step.motions:
                counts[motion.coordinate] += 1
        found = [graph.zero] * self.size
        for number, composite in self._composites():
            for motion in self.steps[number].motions:
                if counts[motion.coordinate] == 1:
                    found[motion.coordinate] = power(motion, momentum_screw(composite, motion))
        unit = [graph.zero] * self.size
        for i in (i for i, count in enumerate(counts) if count > 1):
            found[i] = self.product(graph, [*unit[:i], graph.one, *unit[i + 1 :]])[i]
        return found

    def first_moment(self, graph: Graph) -> Components:
        """Return the first moment of all bodies about the origin, on the frame of the scene."""
        last = dict(self._composites()).get(0)
        return vec.zero(graph) if last is None else last.moment

    def _composites(self) -> Iterator[tuple[int, Inertia]]:
        """Yield the steps that carry bodies, the last first, with the inertia of all bodies beyond each."""
        held = {number: step.inertia for number, step in enumerate(self.steps) if step.inertia is not None}
        for number in range(len(self.steps) - 1, -1, -1):
            composite = held.get(number)
            if composite is not None:
                yield number, composite
                step = self.steps[number]
                if step.parent >= 0:
                    held[step.parent] = add_inertia(held.get(step.parent), carry_inertia(step, composite))

    def product(self, graph: Graph, x: Sequence[Node]) -> list[Node]:
        """Return the mass matrix times a vector, in a number of operations that grows with that of the bodies."""
        twists: list[Twist | None] = []
        for step in self.steps:
            twist = twists[step.parent] if step.parent >= 0 else None
            twists.append(moved_twist(step.motions, None if twist is None else carry_twist(step, twist), x))
        found = [graph.zero] * self.size
        screws: dict[int, Screw] = {}
        for number in range(len(self.steps) - 1, -1, -1):
            step, twist, screw = self.steps[number], twists[number], screws.get(number)
            if step.inertia is not None and twist is not None:
                screw = add_screw(screw, momentum(step.inertia, twist))
            if screw is None:
                continue
            for motion in step.motions:
                found[motion.coordinate] = found[motion.coordinate] + power(motion, screw)
            if step.parent >= 0:
                screws[step.parent] = add_screw(screws.get(step.parent), carry_screw(step, screw))
        return found


def _places(bits: int) -> Iterator[int]:
    """Yield the places of the bits of a number that are set."""
    while bits:
        low = bits & -bits
        yield low.bit_length() - 1
        bits ^= low


def fill_mass_matrix(
    matrix: Matrix, motions: Sequence[Motion], composite: Inertia, ancestors: Iterable[tuple[Step, TreeStep | Pose]]
) -> None:
    """Add the entries of the coordinates of one step with those of the same and all earlier steps.

    `ancestors` are the step and those before it, each with its parent.
    """
    paths = list(ancestors) if motions else []
    for place, motion in enumerate(motions):
        screw = momentum_screw(composite, motion)
        for other in motions[: place + 1]:
            _add_entry(matrix, motion, other, power(other, screw), same=other is motion)
        for step, parent in paths:
            screw = carry_screw(step, screw)
            for other in parent.motions:
                _add_entry(matrix, motion, other, power(other, screw), same=False)


def _add_entry(matrix: Matrix, a: Motion, b: Motion, value: Node, *, same: bool) -> None:
    i, j = a.coordinate, b.coordinate
    if i != j:
        matrix[i][j] = matrix[i][j] + value
        matrix[j][i] = matrix[i][j]
    else:
        matrix[i][i] = matrix[i][i] + (value if same else 2 * value)
