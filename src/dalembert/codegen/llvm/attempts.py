"""Attempts of Runge-Kutta steps in assembly: as one straight line, or as calls where that would be too long."""

from __future__ import annotations

from ...ir.kernel import Kernel
from ...methods.tableau import Tableau
from ...transforms.runge_kutta import Pieces, attempt_kernel, attempt_pieces, start_kernel, start_pieces
from .assembly import assembly
from .vector_functions import vector

__all__ = ["LARGEST_INLINED", "attempt_assembly"]

LARGEST_INLINED = 1000
"""Operations of all evaluations of the right-hand side together, above which it is called instead of repeated. Below,
repeating it saves some 5% of the time of an attempt; above, calls are as fast and compile up to seven times faster
(measured on chains of pendulums)."""


def attempt_assembly(
    rhs: Kernel, tableau: Tableau, lanes: int, *, dense: bool, carried: bool, inline: bool | None = None
) -> str:
    """Return a module with the functions ``attempt`` and ``start`` of `dalembert.transforms.runge_kutta`.

    `inline` says whether the right-hand side is repeated once a stage; by default, its length decides.
    """
    if inline is None:
        inline = len(rhs.body) * (tableau.n_total if dense else tableau.end + 1) <= LARGEST_INLINED
    if inline:
        attempt = attempt_kernel(rhs, tableau, dense=dense, carried=carried)
        return assembly([("attempt", attempt), ("start", start_kernel(rhs, tableau, carried=carried))], lanes)
    parts = (
        attempt_pieces(rhs, tableau, dense=dense, carried=carried),
        start_pieces(rhs, tableau, carried=carried),
    )
    kernels = [parts[0].rhs, *(kernel for pieces in parts for _, kernel in pieces.stages)]
    kernels += [pieces.finish for pieces in parts]
    chains = [_chain(pieces, len(rhs.outputs), lanes) for pieces in parts]
    return "\n\n".join([assembly([(kernel.name, kernel) for kernel in kernels], lanes), *chains])


def _chain(pieces: Pieces, n: int, lanes: int) -> str:
    """Return the function that calls the pieces in turn; slopes and points lie on its stack."""
    v = vector(lanes)
    clock = len(pieces.moved)
    lines = [
        f"%k = alloca [{(pieces.stages[-1][0] + 1) * n} x {v}], align 64",
        f"%point = alloca [{clock + 1} x {v}], align 64",
        f"%clock = getelementptr {v}, ptr %point, i64 {clock}",
    ]
    for stage, kernel in pieces.stages:
        lines += [
            f"call void @{kernel.name}(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)",
            f"%slope.{stage} = getelementptr {v}, ptr %k, i64 {stage * n}",
            f"call void @{pieces.rhs.name}(ptr %clock, ptr %point, ptr %c, ptr %slope.{stage})",
        ]
    lines.append(f"call void @{pieces.finish.name}(ptr %t, ptr %y, ptr %s, ptr %k, ptr %out)")
    arguments = ", ".join(f"ptr noalias nocapture %{a}" for a in ("t", "y", "c", "s", "out"))
    body = "\n".join(f"  {line}" for line in lines)
    return f"define void @{pieces.name}({arguments}) nounwind {{\n{body}\n  ret void\n}}"
