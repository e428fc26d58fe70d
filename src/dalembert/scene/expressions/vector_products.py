"""Scalar products of vectors whose frames are many rotations apart, as SymPy expressions that are not multiplied out.

SymPy writes the product of n rotations about one axis as a polynomial of 2^n terms. `VectorProduct` keeps the
rotations: the reader takes it to the graph with operations that grow linearly with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from ..frames import Tree
from .identity import vanishes

_MOST = 8
"""Rotations up to which products are multiplied out."""


@final
class VectorProduct(sp.Expr):  # type: ignore[misc]
    """The scalar product of two vectors.

    Its arguments are the frames, parents first, each as the number of its parent, -1 for a common frame, and the matrix
    from components on the parent to its own; then the two vectors, each as numbers of frames with components on them.
    """

    is_commutative = True

    def value(self, entry: Callable[[Any], Any]) -> Any:
        """Return the product, with numbers, nodes or other values for the entries of matrices and components."""
        frames, *vectors = self.args
        matrices = [(int(parent), [[entry(x) for x in matrix.row(i)] for i in range(3)]) for parent, matrix in frames]
        a, b = (self._on_common(matrices, vector, entry) for vector in vectors)
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    @staticmethod
    def _on_common(matrices: Sequence[tuple[int, Any]], vector: Any, entry: Callable[[Any], Any]) -> list[Any]:
        """Return the components of a vector on the common frame."""
        zero = entry(sp.S.Zero)
        sums = [[zero] * 3 for _ in range(len(matrices) + 1)]  # the last is the common frame
        for number, components in vector:
            sums[int(number)] = [x + entry(y) for x, y in zip(sums[int(number)], components, strict=True)]
        for number in range(len(matrices) - 1, -1, -1):
            (parent, rows), own = matrices[number], sums[number]
            turned = [rows[0][j] * own[0] + rows[1][j] * own[1] + rows[2][j] * own[2] for j in range(3)]
            sums[parent] = [x + y for x, y in zip(sums[parent], turned, strict=True)]
        return sums[-1]

    def doit(self, **hints: Any) -> Any:
        """Return the product multiplied out."""
        return sp.expand(self.value(lambda x: x))

    def _eval_evalf(self, prec: int) -> Any:
        return self.value(lambda x: x._evalf(prec))

    def _eval_derivative(self, s: Any) -> Any:
        return self.doit().diff(s)

    def _sympystr(self, printer: Any) -> str:
        moving = sorted(map(str, self.atoms(AppliedUndef)), key=lambda name: (len(name), name))
        return f"a product of vectors, which depends on {', '.join(moving)}"


def product_of(root: ReferenceFrame, a: Vector, b: Vector) -> Any:
    """Return the scalar product of vectors on frames that are oriented in `root`; multiplied out where it is short."""
    tree = Tree(root, "_dcm_dict")
    own = [frame for vector in (a, b) for _, frame in vector.args]
    ways = [tree.path(frame) for frame in own]
    if any(way is None for way in ways):
        return a.dot(b)
    known = [[root, *(way or ())] for way in ways]
    shared = max((i for i, nodes in enumerate(zip(*known, strict=False)) if len(set(nodes)) == 1), default=0)
    frames = list(dict.fromkeys(frame for way in known for frame in way[shared + 1 :]))
    if len(frames) <= _MOST:
        return a.dot(b)
    numbers = {frame: i for i, frame in enumerate(frames)}
    matrices = [
        sp.Tuple(numbers.get(tree.parent[frame], -1), sp.ImmutableMatrix(frame._dcm_dict[tree.parent[frame]]))
        for frame in frames
    ]
    vectors = [
        sp.Tuple(*(sp.Tuple(numbers.get(frame, -1), sp.ImmutableMatrix(matrix)) for matrix, frame in vector.args))
        for vector in (a, b)
    ]
    return VectorProduct(sp.Tuple(*matrices), *vectors)


def components_on(frame: ReferenceFrame, vector: Vector) -> Any:
    """Return the components of a vector on a frame (3, 1), as products of matrices where many rotations lie between."""
    if not far(frame, vector):
        return vector.to_matrix(frame)
    total, tree = sp.zeros(3, 1), Tree(frame, "_dcm_dict")
    for matrix, own in vector.args:
        components = matrix
        for node in reversed(tree.path(own) or []):
            components = node._dcm_dict[tree.parent[node]].T * components
        total += components
    return sp.ImmutableMatrix(total)


def far(root: ReferenceFrame, vector: Vector) -> bool:
    """Return whether a vector is so many rotations from a frame that its components are not multiplied out."""
    return any(isinstance(product_of(root, vector, axis), VectorProduct) for axis in root)


def is_constant(root: ReferenceFrame, vector: Vector) -> bool:
    """Return whether the components of a vector on a frame do not vary: values at random points decide."""
    for axis in root:
        component = product_of(root, vector, axis)
        moving = sorted(component.atoms(AppliedUndef, dynamicsymbols._t), key=sp.default_sort_key)
        other = component.xreplace({x: sp.Dummy(f"{x}_2") for x in moving})
        if not vanishes(component - other):
            return False
    return True


def multiplied_out(expression: Any) -> Any:
    """Return an expression with its vector products multiplied out."""
    if not isinstance(expression, sp.Basic) or not expression.has(VectorProduct):
        return expression
    return expression.xreplace({product: product.doit() for product in expression.atoms(VectorProduct)})
