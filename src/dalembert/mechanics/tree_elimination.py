"""Elimination of a mass matrix along the tree of bodies, in a number of operations that grows linearly with theirs.

The articulated-body method (R. Featherstone, Rigid Body Dynamics Algorithms, chapter 7) as an L D L^T: from the leaves
to the root each step has a quadratic form in the twist V of its parent and in the rates that enter beyond,

    V.I V / 2 + sum_k (U_k . V) x_k + sum_jk D_jk x_j x_k / 2.

A rate is eliminated as soon as all steps where its coordinate enters are in the form: with relative coordinates where
it enters, with absolute angles at the body before. The rest of I is the inertia of an articulated body.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import vanishes
from ..scene.model import Components
from ..transforms.linear import Factors, SingularMatrix
from . import screws as vec
from .inertia_tree import InertiaTree
from .kinematics import Motion
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
    momentum_screw,
    moved_twist,
    power,
    symmetric,
    turned,
)


@final
@frozen
class _Articulated:
    """Inertia of bodies that move against each other: resultant = A v + B omega, moment = B^T v + J omega."""

    linear: Rows
    coupling: Rows
    angular: Rows

    @staticmethod
    def of(body: Inertia) -> _Articulated:
        """Return the inertia of one body."""
        nothing, m, (x, y, z) = body.mass.graph.zero, body.mass, body.moment
        linear = ((m, nothing, nothing), (nothing, m, nothing), (nothing, nothing, m))
        return _Articulated(linear, ((nothing, z, -y), (-z, nothing, x), (y, -x, nothing)), body.second)

    def plus(self, other: _Articulated) -> _Articulated:
        """Return the sum of two inertias about one point."""
        return _Articulated(
            _sum(self.linear, other.linear), _sum(self.coupling, other.coupling), _sum(self.angular, other.angular)
        )

    def screw(self, motion: Motion) -> Screw:
        """Return the momentum of a motion with a partial kinematic screw."""
        a = motion.direction
        if motion.angular:
            return vec.rotate(self.coupling, a), vec.rotate(self.angular, a)
        return vec.rotate(self.linear, a), vec.rotate_back(self.coupling, a)

    def less_dyad(self, a: Screw, b: Screw) -> _Articulated:
        """Return the inertia less the symmetric dyad of two screws that are multiples of each other."""
        (r, m), (p, q) = a, b
        size = range(3)

        def lower(rows: Rows, left: Components, right: Components) -> Rows:
            entries = [[rows[max(i, j)][min(i, j)] - left[max(i, j)] * right[min(i, j)] for i in size] for j in size]
            return symmetric([(c[0], c[1], c[2]) for c in entries])

        x, y, z = (
            (self.coupling[i][0] - r[i] * q[0], self.coupling[i][1] - r[i] * q[1], self.coupling[i][2] - r[i] * q[2])
            for i in size
        )
        return _Articulated(lower(self.linear, r, p), (x, y, z), lower(self.angular, m, q))

    def carried(self, step: Step) -> _Articulated:
        """Return the inertia about the point, and in the components, of the parent of a step."""
        if step.rotation is not None:
            c = step.rotation
            return _Articulated(*(turned(c, rows) for rows in (self.linear, self.coupling, self.angular)))
        r = step.offset
        assert r is not None
        # resultant = A (v + omega x r) + B omega, and the moment is that about r with r x resultant
        shift = [vec.cross(r, row) for row in self.linear]
        x, y, z = (vec.add(row, more) for row, more in zip(self.coupling, shift, strict=True))
        coupling = (x, y, z)
        across = [vec.cross(r, column) for column in zip(*coupling, strict=True)]  # column j of [r x] B
        back = [vec.cross(r, column) for column in zip(*self.coupling, strict=True)]
        columns = []
        for j in range(3):
            column = [self.angular[i][j] + across[j][i] + back[i][j] for i in range(3)]
            columns.append((column[0], column[1], column[2]))
        return _Articulated(self.linear, coupling, symmetric(columns))


def _sum(a: Rows, b: Rows) -> Rows:
    return vec.add(a[0], b[0]), vec.add(a[1], b[1]), vec.add(a[2], b[2])


@final
@dataclass(slots=True)
class _Form:
    """The quadratic form of a step: I (None where the twist is zero), U_k, D_jk with j >= k.

    `seen` counts the steps where each rate enters; `reduced` says whether any rate has been eliminated beyond.
    """

    inertia: Inertia | _Articulated | None = None
    columns: dict[int, Screw] = field(default_factory=dict)
    among: dict[tuple[int, int], Node] = field(default_factory=dict)
    seen: Counter[int] = field(default_factory=Counter)
    reduced: bool = False

    def add(self, j: int, k: int, value: Node) -> None:
        """Add to an entry of D."""
        key = (max(j, k), min(j, k))
        self.among[key] = self.among[key] + value if key in self.among else value

    def add_inertia(self, new: Inertia | _Articulated) -> None:
        """Add bodies that have the twist of the step."""
        old = self.inertia
        if isinstance(new, Inertia) and (old is None or isinstance(old, Inertia)):
            self.inertia = add_inertia(old, new)
            return
        new = _Articulated.of(new) if isinstance(new, Inertia) else new
        self.inertia = new if old is None else (_Articulated.of(old) if isinstance(old, Inertia) else old).plus(new)

    def merge(self, other: _Form) -> None:
        """Add the form of another step that has the same twist."""
        if other.inertia is not None:
            self.add_inertia(other.inertia)
        for k, screw in other.columns.items():
            self.columns[k] = add_screw(self.columns.get(k), screw)
        for (j, k), value in other.among.items():
            self.add(j, k, value)
        self.seen.update(other.seen)
        self.reduced = self.reduced or other.reduced

    def move(self, motions: Sequence[Motion]) -> None:
        """Replace the twist by that before the motions of a step, which add their rates to it."""
        assert self.inertia is not None
        body = self.inertia
        for place, motion in enumerate(motions):
            k = motion.coordinate
            for j, column in self.columns.items():
                value = power(motion, column)
                self.add(j, k, 2 * value if j == k else value)
            screw = momentum_screw(body, motion) if isinstance(body, Inertia) else body.screw(motion)
            self.add(k, k, power(motion, screw))
            self.columns[k] = add_screw(self.columns.get(k), screw)
            self.seen[k] += 1
            assert all(other.coordinate != k for other in motions[:place])

    def carried(self, step: Step) -> _Form:
        """Return the form in the twist of the parent of a step."""
        body = self.inertia
        assert body is not None
        moved = carry_inertia(step, body) if isinstance(body, Inertia) else body.carried(step)
        columns = {k: carry_screw(step, u) for k, u in self.columns.items()}
        return _Form(moved, columns, self.among, self.seen, self.reduced)


@final
@frozen
class _Elimination:
    """A rate x_k = half / pivot - weights . V - sum of ratios x_j, where half is the rest of the demand."""

    coordinate: int
    pivot: Node
    weights: Screw | None
    ratios: tuple[tuple[int, Node], ...]


@final
class TreeFactorization(Factors):
    """P M P^T = L D L^T of the mass matrix of a tree, where L is known by its steps.

    Raises
    ------
    SingularMatrix
        When a pivot is identically zero, up to the rounding of decimals.
    """

    def __init__(self, graph: Graph, tree: InertiaTree) -> None:
        self.graph, self.tree = graph, tree
        size = len(tree.steps)
        self._ends: list[list[_Elimination]] = [[] for _ in range(size)]
        self._starts: list[list[_Elimination]] = [[] for _ in range(size)]
        self._moving = tree.moving
        self._total = Counter(motion.coordinate for step in tree.steps for motion in step.motions)
        lost = [k for k in range(tree.size) if not self._total[k]]
        if lost:
            raise SingularMatrix(lost[0])
        self._order, self._pivots = list[int](), list[Node]()
        self.order, self.pivots = self._order, self._pivots
        self._reduced: list[bool] = []
        forms = [_Form() for _ in range(size)]
        for number in range(size - 1, -1, -1):
            step, form = tree.steps[number], forms[number]
            if step.inertia is not None:
                form.add_inertia(step.inertia)
            if form.inertia is None and not form.seen:  # nothing beyond moves
                continue
            before = step.parent >= 0 and self._moving[step.parent]
            self._ends[number] = self._eliminate(form, twist=self._moving[number])
            if step.motions:
                form.move(step.motions)
                self._starts[number] = self._eliminate(form, twist=before)
            if step.parent >= 0:
                carried = form.carried(step) if before else _Form(None, {}, form.among, form.seen, form.reduced)
                forms[step.parent].merge(carried)
        self._needed = [bool(ends or starts) for ends, starts in zip(self._ends, self._starts, strict=True)]
        for number in range(size - 1, 0, -1):
            if self._needed[number]:
                self._needed[tree.steps[number].parent] = True

    @property
    def reduced(self) -> Sequence[bool]:
        """See `Factors.reduced`."""
        return self._reduced

    def _eliminate(self, form: _Form, *, twist: bool) -> list[_Elimination]:
        """Eliminate the rates of a form that enter nowhere else, the last first; `twist` where V may not be zero."""
        if not twist:
            form.columns = {}
        found = []
        ready = sorted((k for k, count in form.seen.items() if count == self._total[k]), reverse=True)
        for k in ready:
            pivot = form.among.pop((k, k))
            if vanishes(pivot):
                raise SingularMatrix(k, exact=pivot.is_zero)
            del form.seen[k]
            others = [(j, form.among.pop((max(j, k), min(j, k)), None)) for j in form.seen]
            coupled = [(j, value) for j, value in others if value is not None and not vanishes(value)]
            ratios = tuple((j, value / pivot) for j, value in coupled)
            weights, column = None, form.columns.pop(k, None)
            if column is not None:
                x, y = (tuple(entry / pivot for entry in part) for part in column)
                weights = ((x[0], x[1], x[2]), (y[0], y[1], y[2]))
                body = form.inertia
                assert body is not None
                body = _Articulated.of(body) if isinstance(body, Inertia) else body
                form.inertia = body.less_dyad(column, weights)
                for j, ratio in ratios:
                    minus = (vec.scale(-ratio, column[0]), vec.scale(-ratio, column[1]))
                    form.columns[j] = add_screw(form.columns.get(j), minus)
            for place, (i, value) in enumerate(coupled):
                for j, ratio in ratios[: place + 1]:
                    form.add(i, j, -(value * ratio))
            found.append(_Elimination(k, pivot, weights, ratios))
            self._order.append(k)
            self._pivots.append(pivot)
            self._reduced.append(form.reduced)
            form.reduced = form.reduced or weights is not None or bool(ratios)
        return found

    def half_solve(self, b: Sequence[Node]) -> list[Node]:
        """See `Factors.half_solve`: demands are gathered from the leaves to the root."""
        rest, screws, halves = list(b), dict[int, Screw](), list[Node]()

        def take(eliminations: Sequence[_Elimination], screw: Screw | None) -> Screw | None:
            for each in eliminations:
                half = rest[each.coordinate]
                halves.append(half)
                if half.is_zero:
                    continue
                if each.weights is not None:
                    minus = (vec.scale(-half, each.weights[0]), vec.scale(-half, each.weights[1]))
                    screw = add_screw(screw, minus)
                for j, ratio in each.ratios:
                    rest[j] = rest[j] - ratio * half
            return screw

        for number in range(len(self.tree.steps) - 1, -1, -1):
            step = self.tree.steps[number]
            screw = take(self._ends[number], screws.pop(number, None))
            if screw is not None:
                for motion in step.motions:
                    rest[motion.coordinate] = rest[motion.coordinate] + power(motion, screw)
            screw = take(self._starts[number], screw)
            if screw is not None and step.parent >= 0 and self._moving[step.parent]:
                screws[step.parent] = add_screw(screws.get(step.parent), carry_screw(step, screw))
        return halves

    def finish(self, half: Sequence[Node]) -> list[Node]:
        """See `Factors.finish`: rates follow from the root to the leaves."""
        quotients = {k: value / pivot for k, value, pivot in zip(self.order, half, self.pivots, strict=True)}
        found = [self.graph.zero] * self.tree.size
        twists: list[Twist | None] = []

        def give(eliminations: Sequence[_Elimination], twist: Twist | None) -> None:
            for each in reversed(eliminations):
                value = quotients[each.coordinate]
                if each.weights is not None and twist is not None:
                    value = value - (vec.dot(each.weights[0], twist[1]) + vec.dot(each.weights[1], twist[0]))
                for j, ratio in each.ratios:
                    value = value - ratio * found[j]
                found[each.coordinate] = value

        for number, step in enumerate(self.tree.steps):
            twist = twists[step.parent] if step.parent >= 0 else None
            if self._needed[number]:
                twist = None if twist is None else carry_twist(step, twist)
                give(self._starts[number], twist)
                twist = moved_twist(step.motions, twist, found)
                give(self._ends[number], twist)
            twists.append(twist)
        return found
