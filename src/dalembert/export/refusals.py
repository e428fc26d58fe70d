"""Programs that exports do not carry."""

from __future__ import annotations

from ..errors import CapabilityError, list_names
from ..ir.calls import function_of
from ..ir.kernel import calls_in
from ..ir.program import Program

FORMULATIONS = ("minimal", "projected", "augmented")
"""Formulations whose runs need nothing but their kernels and a loop."""


def refuse_program(program: Program, further: tuple[str, ...] = ()) -> None:
    """Reject a program that no export carries; `further` are formulations that are carried too.

    Raises
    ------
    CapabilityError
        With what it has that is not exported, and the remedy.
    """
    called = [key for kernel in program for key in calls_in(kernel)]
    if called:
        names = list_names(dict.fromkeys(repr(function_of(key).name) for key in called))
        raise CapabilityError(
            f"compiled functions ({names}) are machine code of this process, which no export can hold: write them in"
            " SymPy or as da.table"
        )
    if program.formulation not in (*FORMULATIONS, *further):
        raise CapabilityError(
            f"exports carry the formulations {list_names(FORMULATIONS)}, and this model is {program.formulation!r}:"
            f" compile it with formulation={FORMULATIONS[1]!r}"
        )
    if "shared_loads" in program:
        raise CapabilityError(
            f"outputs of {program.name!r} are reactions that the equations do not determine, of least norm, which"
            " exports do not compute: compile the model without these outputs"
        )
