"""Systems without degrees of freedom: q_dot is a function of q and time, as when all contacts stick."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.node import Node
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..transforms.linear import SingularMatrix, factorize, matmul, matvec, transpose
from .base import ReducedSystem
from .reactions import requested_outputs


def prescribed(equations: EquationsOfMotion, requested: Sequence[str]) -> ReducedSystem | None:
    """Return the system with the state q of a scene whose constraints fix every rate; None where they do not.

    Coordinates at rest stay exactly where they are: no rounding of accelerations is integrated.
    """
    graph, size = equations.graph, len(equations.q)
    rows: list[ConstraintRow] = []
    for row in equations.constraints:
        trial = [list(r.jacobian) for r in (*rows, row)]
        try:
            factorize(graph, matmul(graph, trial, transpose(trial)))
        except SingularMatrix:
            continue
        rows.append(row)
        if len(rows) == size:
            break
    if len(rows) < size:
        return None
    matrix = [list(row.jacobian) for row in rows]
    across = transpose(matrix)
    normal = factorize(graph, matmul(graph, across, matrix))

    def solved(demand: Sequence[Node]) -> list[Node]:
        return normal.solve(matvec(graph, across, demand))

    rates = solved([-row.drift for row in rows])
    known = {a: b for a, b in zip(equations.qdot, rates, strict=True) if a is not b}
    accelerations = solved(graph.substitute([row.bias for row in rows], known))
    wanted = requested_outputs(equations, requested, known, accelerations)
    still = all(rate.is_zero for rate in rates)
    return ReducedSystem(
        formulation="prescribed",
        equations=equations,
        state=equations.symbols.coordinates,
        inputs=equations.q,
        rhs=tuple(rates),
        coordinates=equations.q,
        rates=tuple(rates),
        accelerations=tuple(accelerations),
        initial=equations.q,
        projection=None,
        outputs=wanted.outputs,
        undetermined=wanted.undetermined,
        released=wanted.released,
        balanced=wanted.balanced,
        notes=("all contacts stick: nothing moves" if still else "all contacts stick: the constraints fix every rate",),
    )
