"""Attempts of Runge-Kutta steps in assembly: straight-line code, or calls where that is too long."""

from __future__ import annotations

from typing import Any

from ...ir.kernel import Kernel
from ...methods.tableau import Tableau
from ...transforms.runge_kutta import Pieces, attempt_kernel, attempt_pieces, start_kernel, start_pieces
from ..rendering import render
from .assembly import assembly, kernel_variables, stack_alignment
from .lane_types import vector
from .vector_functions import prelude_variables

__all__ = ["LARGEST_INLINED", "attempt_assembly"]

LARGEST_INLINED = 1000
"""Operations of all evaluations of the right-hand side together, above which it is called instead of repeated. Below,
repeating it saves some 5% of the time of an attempt; above, calls are as fast and compile up to seven times faster
(measured on chains of pendulums)."""


def attempt_assembly(
    rhs: Kernel,
    tableau: Tableau,
    lanes: int,
    *,
    dense: bool,
    carried: bool,
    inline: bool | None = None,
    knots: Kernel | None = None,
) -> str:
    """Return a module with the functions ``attempt`` and ``start`` of `dalembert.transforms.runge_kutta`.

    `inline` says whether the right-hand side is repeated once a stage; by default, its length decides. Steps end at
    `knots` of tables.
    """
    if inline is None:
        inline = len(rhs.body) * (tableau.n_total if dense else tableau.end + 1) <= LARGEST_INLINED
    if inline:
        attempt = attempt_kernel(rhs, tableau, dense=dense, carried=carried, knots=knots)
        return assembly([("attempt", attempt), ("start", start_kernel(rhs, tableau, carried=carried))], lanes)
    parts = (
        attempt_pieces(rhs, tableau, dense=dense, carried=carried, knots=knots),
        start_pieces(rhs, tableau, carried=carried),
    )
    kernels = [parts[0].rhs, *(kernel for pieces in parts for _, kernel in pieces.stages)]
    kernels += [pieces.finish for pieces in parts]
    kernels += [pieces.knots for pieces in parts if pieces.knots is not None]
    variables = {
        "prelude": prelude_variables(lanes),
        "vector": vector(lanes),
        "kernels": [kernel_variables(kernel.name, kernel, lanes) for kernel in kernels],
        "stack_alignment": stack_alignment(lanes),
        "chains": [_chain_variables(pieces, len(rhs.outputs)) for pieces in parts],
    }
    return render("llvm/attempt_calls.ll.j2", variables)


def _chain_variables(pieces: Pieces, n: int) -> dict[str, Any]:
    """Return names and sizes of the function that calls the pieces in turn; `n` is the length of the state."""
    clock = len(pieces.moved)
    return {
        "name": pieces.name,
        "rhs": pieces.rhs.name,
        "finish": pieces.finish.name,
        "held": pieces.held,
        "limits": [] if pieces.knots is None else [{"name": pieces.knots.name, "place": pieces.slopes}],
        "point": clock + 1,
        "clock": clock,
        "stages": [{"name": kernel.name, "number": stage, "place": stage * n} for stage, kernel in pieces.stages],
    }
