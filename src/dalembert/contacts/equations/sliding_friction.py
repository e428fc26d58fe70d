"""Sliding friction as a given force: the normal reactions that it is proportional to, solved for on the graph.

Friction is -kappa N. Without it the normal reactions would be N_0, each unit of N_s adds B_rs to N_r, and
(I - B) N = N_0. That matrix loses its regularity where the law of friction has no or several solutions
(P. Painleve, Comptes Rendus 121 (1895) 112-115).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import final

from ...errors import RELEASE, ConstraintError, list_names
from ...frozen import frozen
from ...ir.node import Node
from ...ir.zero_tests import vanishes
from ...mechanics.equations import ContactRow, EquationsOfMotion
from ...reduction.reaction_columns import independent_columns
from ...reduction.reaction_solutions import reaction_solver
from ...reduction.saddle import SaddlePoint
from ...transforms.linear import Matrix, SingularMatrix, determinant_and_solution, factorize, matmul, matvec, transpose


@final
@frozen
class SlidingContact:
    """A contact that slides; `factors` gives kappa, one a direction, from what N would be without friction."""

    contact: ContactRow
    factors: Callable[[Node], list[Node]]


@final
@frozen
class SlidingFriction:
    """The forcing with friction (n_q,), kappa of each contact, and det(I - B)."""

    forcing: tuple[Node, ...]
    factors: tuple[list[Node], ...]
    determinant: Node


def sliding_friction(
    frictionless: EquationsOfMotion,
    whole: EquationsOfMotion,
    kept: Sequence[int],
    sliding: Sequence[SlidingContact],
    idle: Mapping[str, Sequence[int]] | None = None,
) -> SlidingFriction:
    """Return what sliding friction adds to equations.

    Parameters
    ----------
    frictionless : EquationsOfMotion
        Without friction, with the constraints that hold.
    whole : EquationsOfMotion
        Of the scene, with all its reactions.
    kept : sequence of int
        Which of these `frictionless` has.
    sliding : sequence of SlidingContact
    idle : dict of str to sequence of int
        Friction forces of sticking contacts, by their names, along which constraints keep these from slipping: they are
        taken as zero.

    Raises
    ------
    ConstraintError
        When the equations do not determine the normal reaction of a contact that slides, or the motion depends on what
        friction of the idle contacts takes of it.
    """
    graph = frictionless.graph
    if not sliding:
        return SlidingFriction(tuple(frictionless.forcing), (), graph.one)
    loaded = [item for item in sliding if item.contact.normal_load is not None]
    known = {item.contact.name: item.factors(item.contact.normal_load or graph.zero) for item in loaded}
    forcing = list(frictionless.forcing)
    for item in loaded:
        direction, load = _direction(whole, item, known[item.contact.name]), item.contact.normal_load or graph.zero
        forcing = [f + d * load for f, d in zip(forcing, direction, strict=True)]
    frictionless = replace(frictionless, forcing=tuple(forcing))
    unknown = [item for item in sliding if item.contact.normal_load is None]
    if not unknown:
        return SlidingFriction(tuple(forcing), tuple(known[item.contact.name] for item in sliding), graph.one)
    accelerations = _accelerations(frictionless)
    normals = _normals(frictionless, whole, kept, unknown)
    free = accelerations(frictionless.forcing, [row.bias for row in frictionless.constraints])
    n0 = normals(_residual(frictionless, free, frictionless.forcing))
    known |= {item.contact.name: item.factors(normal) for item, normal in zip(unknown, n0, strict=True)}
    directions = [_direction(whole, item, known[item.contact.name]) for item in unknown]
    nothing = [graph.zero for _ in frictionless.constraints]
    added, moving = [], list[SlidingContact]()
    for item, direction in zip(unknown, directions, strict=True):
        pushed = accelerations(direction, nothing)
        added.append(normals(_residual(frictionless, pushed, direction)))
        moving += [] if all(vanishes(a) for a in pushed) else [item]
    _require_idle_apart(whole, kept, moving, idle or {})
    size = range(len(n0))
    matrix: Matrix = [[(graph.one if i == j else graph.zero) - added[j][i] for j in size] for i in size]
    determinant, pressing = determinant_and_solution(graph, matrix, n0)
    for direction, normal in zip(directions, pressing, strict=True):
        forcing = [f + d * normal for f, d in zip(forcing, direction, strict=True)]
    return SlidingFriction(tuple(forcing), tuple(known[item.contact.name] for item in sliding), determinant)


def _require_idle_apart(
    whole: EquationsOfMotion,
    kept: Sequence[int],
    moving: Sequence[SlidingContact],
    idle: Mapping[str, Sequence[int]],
) -> None:
    """Raise where friction that moves something needs a normal reaction that friction of idle contacts may share."""
    if not idle or not moving:
        return
    numbers = [*kept, *(i for forces in idle.values() for i in forces)]
    _, undetermined = independent_columns([[row[i] for i in numbers] for row in whole.reactions])
    shared = {numbers[place] for place in undetermined}
    names = [repr(item.contact.name) for item in moving if item.contact.normal in shared]
    if names:
        held = list_names(map(repr, idle))
        raise ConstraintError(
            f"scene {whole.name!r}: other contacts keep {held} from slipping, so that friction there may take any part"
            f" of what presses {list_names(names)}, which slides: the motion is not determined. Give the former"
            " friction=0 or a regularization"
        )


def _direction(whole: EquationsOfMotion, item: SlidingContact, kappa: Sequence[Node]) -> list[Node]:
    """Return the forcing (n_q,) of the friction of a contact for a unit of its normal reaction."""
    rows = ([row[i] for i in item.contact.tangential] for row in whole.reactions)
    return [-whole.graph.sum(k * c for k, c in zip(kappa, row, strict=True)) for row in rows]


Accelerations = Callable[[Sequence[Node], Sequence[Node]], list[Node]]
"""From forcing (n_q,) and what the constraints demand (n_constraints,) to second rates (n_q,)."""


def _accelerations(frictionless: EquationsOfMotion) -> Accelerations:
    """Return what solves for second rates: on the directions that the constraints leave free, where these are plain.

    That takes half the operations of the saddle-point system, and shares most of them with `minimal`.
    """
    directions = _free_directions(frictionless)
    if directions is not None:
        graph, (basis, held) = frictionless.graph, directions
        across = transpose(basis)
        loaded = matmul(graph, frictionless.mass_matrix, basis)
        try:
            inertia = factorize(graph, matmul(graph, across, loaded))
        except SingularMatrix:
            return _by_saddle(frictionless)

        def solve(forcing: Sequence[Node], demand: Sequence[Node]) -> list[Node]:
            fixed = matvec(graph, held, demand)
            rest = [f - b for f, b in zip(forcing, matvec(graph, frictionless.mass_matrix, fixed), strict=True)]
            moved = matvec(graph, basis, inertia.solve(matvec(graph, across, rest)))
            return [a + b for a, b in zip(moved, fixed, strict=True)]

        return solve
    return _by_saddle(frictionless)


def _by_saddle(frictionless: EquationsOfMotion) -> Accelerations:
    saddle = SaddlePoint.of(frictionless, guarded=False)
    return lambda forcing, demand: replace(saddle, forcing=tuple(forcing)).accelerations(demand, frictionless.name)


Solved = dict[int, tuple[list[Node], list[Node]]]
"""For second rates by number: their slopes by the others (n_q,), and by what constraints demand (n_constraints,)."""


def _solved_rates(frictionless: EquationsOfMotion) -> Solved | None:
    """Return the second rates that constraints are solved for, one each.

    Their coefficients are numbers, so that nothing is divided by; None where a constraint has none.
    """
    graph, size, count = frictionless.graph, len(frictionless.q), len(frictionless.constraints)
    solved: Solved = {}
    for place, row in enumerate(frictionless.constraints):
        slopes = list(row.jacobian)
        given = [graph.one if i == place else graph.zero for i in range(count)]
        for known, (others, demands) in solved.items():
            factor, slopes[known] = slopes[known], graph.zero
            slopes = [a + factor * b for a, b in zip(slopes, others, strict=True)]
            given = [a - factor * b for a, b in zip(given, demands, strict=True)]
        pivot = next((i for i in range(size) if slopes[i].deps == 0 and not vanishes(slopes[i])), None)
        if pivot is None:
            return None
        scale = -1 / slopes[pivot]
        slopes[pivot] = graph.zero
        own = [scale * a for a in slopes], [-scale * a for a in given]
        for known, (others, demands) in list(solved.items()):
            factor, others[pivot] = others[pivot], graph.zero
            solved[known] = (
                [a + factor * b for a, b in zip(others, own[0], strict=True)],
                [a + factor * b for a, b in zip(demands, own[1], strict=True)],
            )
        solved[pivot] = own
    return solved


def _free_directions(frictionless: EquationsOfMotion) -> tuple[Matrix, Matrix] | None:
    """Return S (n_q, n_free) and H (n_q, n_constraints) with q_ddot = S u_dot + H demand, where that is plain."""
    graph, size, solved = frictionless.graph, len(frictionless.q), _solved_rates(frictionless)
    if solved is None:
        return None
    free = [i for i in range(size) if i not in solved]
    nothing = [graph.zero] * len(frictionless.constraints)
    basis = [[solved[i][0][j] if i in solved else graph.const(int(i == j)) for j in free] for i in range(size)]
    return basis, [solved[i][1] if i in solved else nothing for i in range(size)]


def _residual(frictionless: EquationsOfMotion, a: Sequence[Node], forcing: Sequence[Node]) -> list[Node]:
    """Return what reactions have to supply."""
    return [x - f for x, f in zip(matvec(frictionless.graph, frictionless.mass_matrix, a), forcing, strict=True)]


def _remedy(shared: Sequence[str]) -> str:
    """Return what helps where a normal reaction is not determined, by the contacts with a gap that share the load."""
    if len(shared) > 1:
        return (
            f"The contacts {list_names(map(repr, shared))} share a load: let at most three contacts of a rigid body"
            " with friction touch a plane, give all of them friction=0, or write their normal reactions as springs"
            " and dampers with a smooth law of friction (docs/friction.md)"
        )
    return f"Release the coordinate along which it acts: {RELEASE}"


def _normals(
    frictionless: EquationsOfMotion, whole: EquationsOfMotion, kept: Sequence[int], sliding: Sequence[SlidingContact]
) -> Callable[[Sequence[Node]], list[Node]]:
    """Return the function from what reactions have to supply to the normal reactions of what slides."""
    independent, undetermined = independent_columns(frictionless.reactions)
    places = []
    for item in sliding:
        place = list(kept).index(item.contact.normal)
        if place in undetermined:
            name, shared = whole.symbols.unknowns[item.contact.normal], {kept[i] for i in undetermined}
            raise ConstraintError(
                f"scene {whole.name!r}: friction {item.contact.name!r} needs {name}, which the equations of motion"
                " do not determine: only a combination of it with other reactions appears in them, or none."
                f" {_remedy([c.name for c in whole.contacts if c.constraint is not None and c.normal in shared])}"
            )
        places.append(independent.index(place))
    solved = _solved_rates(frictionless)
    if solved is not None and len(solved) == len(independent) == 1:
        # the only reaction does what the only multiplier does, which the rate tells that its constraint is solved for
        (rate,), (unknown,) = solved, independent
        return lambda residual: [residual[rate] / frictionless.reactions[rate][unknown]] * len(places)
    reactions = [[row[i] for i in independent] for row in frictionless.reactions]
    solve = reaction_solver(frictionless, reactions)

    def normals(residual: Sequence[Node]) -> list[Node]:
        found = solve(residual)
        return [found[place] for place in places]

    return normals
