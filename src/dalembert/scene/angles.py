"""Expressions in angles that quaternions replace, rewritten in the quaternions where that is regular.

An expression in the angles beside the orientation itself (a rolling constraint, a weight's potential) is regular
when it is affine in the entries of the rotation matrix and in the angular velocity. The coefficients are found from
values at ten attitudes, and the result is compared with the expression as functions, by their fingerprints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import product
from typing import Any, final

import sympy as sp
from sympy.physics.vector import Vector, dynamicsymbols

from ..errors import list_names
from ..ir.graph import Graph
from ..ir.node import Node
from ..naming import rate_name
from ..transforms.derivatives import tangents
from ..transforms.linear import rotation_entries, spin_matrix
from .expressions.reader import ExpressionReader
from .orientation import FreeOrientation

_QUARTERS = tuple((Fraction(a), Fraction(b)) for a, b in ((1, 0), (0, 1), (-1, 0), (0, -1)))
_SECONDS = tuple((Fraction(a, 5), Fraction(b, 5)) for a, b in ((3, 4), (4, 3), (-3, 4), (4, -3), (3, -4)))


_COMPOSED = ("add", "sub", "mul", "div", "neg", "sqrt")
"""Operations whose operands may be written in quaternions one by one."""


@final
class Angles:
    """Reads expressions and vectors that contain the angles of one orientation.

    Parameters
    ----------
    main : ExpressionReader
        Of the scene, in which the angles are read as functions of the quaternion; its symbols and faults are shared.
    orientation : FreeOrientation
        With a sequence of angles.
    """

    def __init__(self, main: ExpressionReader, orientation: FreeOrientation) -> None:
        self.orientation, self.graph = orientation, main.graph
        graph, time = self.graph, dynamicsymbols._t
        names = [a.func.__name__ for a in orientation.angles]
        self.angles = [graph.input(name) for name in names]
        self.rates = [graph.input(rate_name(name)) for name in names]
        leaves = dict(main.leaves)
        leaves |= dict(zip(orientation.angles, self.angles, strict=True))
        leaves |= {sp.Derivative(a, time): rate for a, rate in zip(orientation.angles, self.rates, strict=True)}
        self.reader = ExpressionReader(graph, leaves)
        self.reader.parameters, self.reader.unknowns, self.reader.faults = main.parameters, main.unknowns, main.faults
        e = [main.leaves[x] for x in orientation.quaternion]
        e_dot = [main.leaves[sp.Derivative(x, time)] for x in orientation.quaternion]
        self._known = rotation_entries(e)
        self._matrix = self._read_matrix(orientation.base.dcm(orientation.frame))
        self._omega = {
            body: [2 * w for w in _contract(graph, spin_matrix(e, body=body), e_dot)] for body in (True, False)
        }
        self._spins = [graph.input(f"spin {axis} of {orientation.frame.name}") for axis in "xyz"]
        self._in_spins = {body: self._solved(body=body) for body in (True, False)}
        self._places, self._inverse = self._samples()

    def concerns(self, item: Any) -> bool:
        """Return whether an expression or a vector depends on these angles or on a frame between them."""
        if isinstance(item, Vector):
            between = self.orientation.between
            return any(frame in between or self.concerns(matrix) for matrix, frame in item.args)
        return bool(hasattr(item, "has") and item.has(*self.orientation.angles))

    def scalar(self, expression: Any, place: str, *, unknowns: bool = False) -> Node | None:
        """Return an expression in terms of the quaternion, or None where that is not regular."""
        return self.written(self.reader.read(expression, place, unknowns=unknowns))

    def vector(self, vector: Vector, place: str, *, unknowns: bool = False) -> list[tuple[Any, list[Node]]] | None:
        """Return a vector as pieces of frame and components, or None where they are not regular."""
        pieces = []
        for matrix, frame in vector.args:
            components = [self.reader.read(x, place, unknowns=unknowns) for x in matrix]
            found = self._turned(components, frame)
            if found is None:
                return None
            pieces.append(found)
        return pieces

    def _turned(self, components: Sequence[Node], frame: Any) -> tuple[Any, list[Node]] | None:
        base, own = self.orientation.base, self.orientation.frame
        best: tuple[Any, list[Node]] | None = None
        for target in (own, base) if frame in self.orientation.between else (frame,):
            matrix = sp.eye(3) if target is frame else target.dcm(frame)
            turned = _contract(self.graph, list(zip(*self._read_matrix(matrix), strict=True)), components)
            found = [self.written(node) for node in turned]
            whole = [node for node in found if node is not None]
            if len(whole) == 3 and (best is None or sum(x.cost for x in whole) < sum(x.cost for x in best[1])):
                best = target, whole
        return best

    def _read_matrix(self, matrix: Any) -> list[list[Node]]:
        return [[self.reader.read(matrix[i, j], "orientation") for j in range(3)] for i in range(3)]

    def _solved(self, *, body: bool) -> list[Node]:
        """Return the rates of the angles in terms of components of the angular velocity."""
        graph, r = self.graph, self._matrix
        columns = []
        for angle in self.angles:
            rate = [tangents(graph, row, {angle: graph.one}) for row in r]
            if body:  # R^T dR, else dR R^T
                w = [[graph.sum(r[m][i] * rate[m][j] for m in range(3)) for j in range(3)] for i in range(3)]
            else:
                w = [[graph.sum(rate[i][m] * r[j][m] for m in range(3)) for j in range(3)] for i in range(3)]
            columns.append([w[2][1], w[0][2], w[1][0]])
        cofactors = [_cross(columns[(m + 1) % 3], columns[(m + 2) % 3]) for m in range(3)]
        determinant = graph.sum(a * b for a, b in zip(columns[0], cofactors[0], strict=True))
        return [graph.sum(a / determinant * w for a, w in zip(row, self._spins, strict=True)) for row in cofactors]

    def written(self, node: Node) -> Node | None:
        """Return a node in terms of the quaternion, or None where it is no function of what is affine in it.

        Sums of entries of rotation and spin are; of quotients and roots, as for the lowest point of a disc, operands.
        """
        found = self._linear(node)
        return self._composed(node) if found is None else found

    def _composed(self, node: Node) -> Node | None:
        """Return a node whose operands can be written; a squared sine is 1 less the squared cosine."""
        if node.op not in _COMPOSED:
            return None
        first = node.args[0]
        if node.op == "mul" and first is node.args[1] and first.op == "sin":
            cosine = self.written(self.graph.cos(first.args[0]))
            return None if cosine is None else 1 - cosine * cosine
        parts = [self.written(arg) for arg in node.args]
        whole = [part for part in parts if part is not None]
        return self.graph.call(node.op, *whole) if len(whole) == len(parts) else None

    def _linear(self, node: Node) -> Node | None:
        """Return a node in terms of the quaternion, or None where it is not affine in rotation and spin."""
        graph, spins = self.graph, self._spins
        for body in (False, True):
            moved = graph.substitute([node], dict(zip(self.rates, self._in_spins[body], strict=True)))[0]
            slopes = [graph.freed_of(tangents(graph, [moved], {w: graph.one})[0], spins) for w in spins]
            rest = graph.substitute([moved], dict.fromkeys(spins, graph.zero))[0]
            parts = [None if part is None else self._affine(part) for part in (*slopes, rest)]
            whole = [part for part in parts if part is not None]
            if len(whole) == 4:
                return graph.sum(a * w for a, w in zip(whole, self._omega[body], strict=False)) + whole[3]
        return None

    # -- values at some attitudes ---------------------------------------------------------

    def _affine(self, node: Node) -> Node | None:
        """Return an expression of the angles as a sum of entries of the rotation matrix, if it is one."""
        free = self.graph.freed_of(node, self.angles)
        if free is not None:
            return free
        try:
            found = [self.graph.substitute([node], place)[0] for place in self._places]
        except ZeroDivisionError:
            return None
        values = [free for x in found if (free := self.graph.freed_of(x, self.angles)) is not None]
        if len(values) < len(found):
            return None
        weights = [self.graph.sum(a * x for a, x in zip(row, values, strict=True)) for row in self._inverse]
        by_angles = [self.graph.one, *(x for row in self._matrix for x in row)]
        if self.graph.sum(a * x for a, x in zip(weights, by_angles, strict=True)) is not node:
            return None
        known = [self.graph.one, *(x for row in self._known for x in row)]
        return self.graph.sum(a * x for a, x in zip(weights, known, strict=True))

    def _samples(self) -> tuple[list[dict[Node, Node]], list[list[Node]]]:
        """Return ten attitudes, and the matrix from values there to coefficients of one and the nine entries."""
        graph = self.graph
        places: list[dict[Node, Node]] = []
        rows: list[list[Fraction]] = []
        for place in self._attitudes():
            entries = graph.substitute([x for row in self._matrix for x in row], place)
            numbers = [Fraction(1)] + [x.number for x in entries if x.number is not None]
            if len(numbers) == 10 and sp.Matrix([*rows, numbers]).rank() > len(rows):
                places.append(place)
                rows.append(numbers)
            if len(rows) == 10:
                break
        inverse = sp.Matrix(rows).inv()
        exact = [[Fraction(int(x.p), int(x.q)) for x in inverse[i, :]] for i in range(10)]
        return places, [[graph.const(x) for x in row] for row in exact]

    def _attitudes(self) -> Iterator[dict[Node, Node]]:
        graph = self.graph
        for first, second, third in product(_QUARTERS, _SECONDS, _QUARTERS):
            place = dict(zip(self.angles, self.angles, strict=True))  # so that what is neither sine nor cosine shows
            for angle, (cosine, sine) in zip(self.angles, (first, second, third), strict=True):
                place[graph.cos(angle)], place[graph.sin(angle)] = graph.node(cosine), graph.node(sine)
            yield place

    def complaint(self, item: Any) -> str:
        """Return the fault of an expression that cannot be read."""
        names = list_names(a.func.__name__ for a in self.orientation.angles)
        own, base = self.orientation.frame.name, self.orientation.base.name
        return (
            f"{item} depends on the angles {names} other than through the orientation of {own!r} and its angular"
            f" velocity, so that orientation='quaternion' is not supported: write it with vectors of {own!r} and"
            f" {base!r}, or leave the option out"
        )


def _contract(graph: Graph, matrix: Sequence[Sequence[Node]], vector: Sequence[Node]) -> list[Node]:
    """Return matrix^T vector."""
    return [graph.sum(row[i] * x for row, x in zip(matrix, vector, strict=True)) for i in range(len(matrix[0]))]


def _cross(a: Sequence[Node], b: Sequence[Node]) -> list[Node]:
    return [a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3] for i in range(3)]
