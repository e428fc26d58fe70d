"""Sliding friction as a given force: the normal reactions that it is proportional to, solved for on the graph.

Friction is -kappa N. Without it the normal reactions would be N_0, each unit of N_s adds B_rs to N_r, and
(I - B) N = N_0. That matrix loses its regularity where the law of friction has no or several solutions
(P. Painleve, Comptes Rendus 121 (1895) 112-115).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import final

from ..errors import ConstraintError
from ..ir.graph import Graph, Node
from ..ir.linear import Matrix, determinant_and_solution, factorize, matmul, matvec, transpose
from ..mechanics.equations import ContactRow, EquationsOfMotion
from .reactions import independent_columns
from .saddle import SaddlePoint

__all__ = ["Rubbed", "Rubbing", "rub"]


@final
@dataclass(frozen=True)
class Rubbing:
    """A contact that slides; `factors` gives kappa, one a direction, from what N would be without friction."""

    contact: ContactRow
    factors: Callable[[Node], list[Node]]


@final
@dataclass(frozen=True)
class Rubbed:
    """The forcing with friction (n_q,), kappa of each contact, and det(I - B)."""

    forcing: tuple[Node, ...]
    factors: tuple[list[Node], ...]
    determinant: Node


def rub(bare: EquationsOfMotion, whole: EquationsOfMotion, kept: Sequence[int], rubbing: Sequence[Rubbing]) -> Rubbed:
    """Return what sliding friction adds to equations.

    Parameters
    ----------
    bare : EquationsOfMotion
        Without friction, with the constraints that hold.
    whole : EquationsOfMotion
        Of the scene, with all its reactions.
    kept : sequence of int
        Which of these `bare` has.
    rubbing : sequence of Rubbing

    Raises
    ------
    ConstraintError
        When the equations do not determine the normal reaction of a contact that slides.
    """
    graph = bare.graph
    if not rubbing:
        return Rubbed(tuple(bare.forcing), (), graph.one)
    saddle = SaddlePoint.of(bare, guarded=False)
    normals = _normals(bare, whole, kept, rubbing)
    free = saddle.accelerations([row.bias for row in bare.constraints], bare.name)
    n0 = normals(_residual(bare, free, bare.forcing))
    factors = [item.factors(normal) for item, normal in zip(rubbing, n0, strict=True)]
    directions = []
    for item, kappa in zip(rubbing, factors, strict=True):
        rows = ([row[i] for i in item.contact.tangential] for row in whole.reactions)
        directions.append([-graph.sum(k * c for k, c in zip(kappa, row, strict=True)) for row in rows])
    nothing = [graph.zero for _ in bare.constraints]
    added = []
    for direction in directions:
        pushed = replace(saddle, forcing=tuple(direction)).accelerations(nothing, bare.name)
        added.append(normals(_residual(bare, pushed, direction)))
    size = range(len(n0))
    matrix: Matrix = [[(graph.one if i == j else graph.zero) - added[j][i] for j in size] for i in size]
    determinant, pressing = determinant_and_solution(graph, matrix, n0)
    forcing = list(bare.forcing)
    for direction, normal in zip(directions, pressing, strict=True):
        forcing = [f + d * normal for f, d in zip(forcing, direction, strict=True)]
    return Rubbed(tuple(forcing), tuple(factors), determinant)


def _residual(bare: EquationsOfMotion, a: Sequence[Node], forcing: Sequence[Node]) -> list[Node]:
    """Return what reactions have to supply."""
    return [x - f for x, f in zip(matvec(bare.graph, bare.mass_matrix, a), forcing, strict=True)]


def _normals(
    bare: EquationsOfMotion, whole: EquationsOfMotion, kept: Sequence[int], rubbing: Sequence[Rubbing]
) -> Callable[[Sequence[Node]], list[Node]]:
    """Return the function from what reactions have to supply to the normal reactions of what slides."""
    graph: Graph = bare.graph
    independent, undetermined = independent_columns(graph, bare.reactions)
    places = []
    for item in rubbing:
        place = list(kept).index(item.contact.normal)
        if place in undetermined:
            name = whole.symbols.unknowns[item.contact.normal]
            raise ConstraintError(
                f"scene {bare.name!r}: friction {item.contact.name!r} needs {name}, which the equations of motion do"
                " not determine: only a combination of it with other reactions appears in them, or none. Give back the"
                " coordinate that hides it, with scene.release(coordinate, point, direction)"
            )
        places.append(independent.index(place))
    columns = transpose([[row[i] for i in independent] for row in bare.reactions])
    normal = factorize(graph, matmul(graph, columns, transpose(columns)))

    def normals(residual: Sequence[Node]) -> list[Node]:
        found = normal.solve(matvec(graph, columns, residual))
        return [found[place] for place in places]

    return normals
