"""Adjoints of traced runs, and which scenes they serve."""

from __future__ import annotations

from ...errors import OptionError
from ...integrators.jax.projection import CORRECTIONS
from ...ir.program import Program
from ...options import SolveOptions
from ...transforms.nonsmooth import decisions

__all__ = ["refuse_adjoint"]


def refuse_adjoint(program: Program, options: SolveOptions, *, implicit: bool) -> None:
    """Refuse an adjoint other than "recorded" where it would be wrong.

    Raises
    ------
    OptionError
    """
    adjoint, why = options.adjoint, ""
    if implicit:
        why = f"method={options.method!r} has derivatives of its own, with checkpoints"
    elif options.dense:
        why = "dense=True keeps a record of the run"
    elif decisions(program) is not None:
        why = "the rates of this scene may jump with its state, across which derivatives are found along a record"
    elif adjoint == "continuous" and any(name in program for name in CORRECTIONS):
        why = (
            f"the formulation {program.formulation!r} moves states onto the constraints after each step, of which the"
            ' continuous equations know nothing (formulation="minimal" and adjoint="recomputed" are allowed)'
        )
    if why:
        raise OptionError(f'adjoint={adjoint!r} does not serve here: {why}. Take adjoint="recorded"')
