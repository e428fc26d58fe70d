"""Scenes and programs that exports do not carry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..arrays import FloatArray
from ..errors import CapabilityError, list_names
from ..ir.calls import function_of
from ..ir.conditions import CONDITION_TIME
from ..ir.kernel import calls_in
from ..ir.ops import TABLE_OPERATIONS
from ..ir.program import WIDTH, Program, coefficient_places
from ..reduction.starting import Start
from ..runs.impulses import impulses_of
from ..scene.model import ControllerModel
from ..starts.constraint_choice import dependent_at_start

if TYPE_CHECKING:
    from ..model.model import CompiledModel
    from ..phases.mode_models import ModeModels

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


def _refuse_controllers(model: CompiledModel) -> None:
    _refuse_functions(model.controllers)
    if model.controllers and model.stages.program.knot_sides is not None:
        raise CapabilityError(
            f"{model.name!r} has both sampled controllers and tables or forces that jump, which exports do not carry"
            " together yet: smooth the jumps"
        )


def _refuse_functions(controllers: Sequence[ControllerModel]) -> None:
    functions = [item.name for item in controllers if item.function is not None]
    if functions:
        raise CapabilityError(
            f"laws of controllers in Python ({list_names(functions)}) are code of this process, which no export can"
            " hold: write them as expressions, with states= and inputs= of da.Controller"
        )


def refuse_scene(model: CompiledModel) -> None:
    """Reject a model that no export carries.

    Raises
    ------
    CapabilityError
        With what it has that is not exported, and the remedy.
    """
    program, reduced = model.stages.program, model.stages.reduced
    _refuse_controllers(model)
    refuse_program(program)
    functions = () if program.conditions is None else program.conditions.functions
    if any(line.op in TABLE_OPERATIONS for function in functions for line in function.body):
        raise CapabilityError(
            f"{program.name!r} has functions of time with kinks, jumps or pulses whose conditions have tables, of which"
            " exports compute no bounds: write the curves as expressions"
        )
    if impulses_of(model.stages.equations, program) is not None:
        raise CapabilityError(
            f"{program.name!r} has prescribed velocities that jump, with impulses of its constraints, which exports do"
            " not carry: smooth them, as by tanh"
        )
    if reduced.unproven or reduced.redundancy is not None:
        raise CapabilityError(
            f"{program.name!r} has constraints that follow from others at some places only, which simulate looks at"
            " along the run; exports do not: remove the constraints that are not needed"
        )
    if not program.layout.state:
        raise CapabilityError(f"the constraints of {program.name!r} prescribe its motion: there is nothing to simulate")


def refuse_dependent(model: CompiledModel, state: FloatArray, p: FloatArray, span: tuple[float, float]) -> None:
    """Reject an example that starts where constraints depend on each other: a state (n_y,) with parameters (n_p,).

    Raises
    ------
    CapabilityError
    """
    start = model.derived.dependence
    if start is not None and dependent_at_start(model.stages.program, start, span, state, p):
        raise CapabilityError(
            f"constraints of {model.name!r} depend on each other at this start; simulate leaves out those that follow"
            " from others there, and exports do not: remove the constraints that are not needed"
        )


def refuse_inputs(model: CompiledModel, start: Start) -> None:
    """Reject inputs that cannot be set between steps.

    Raises
    ------
    CapabilityError
        With the inputs, and the remedy.
    """
    program, layout = model.stages.program, model.layout
    if not layout.inputs:
        return
    if program.knot_sides is not None:
        raise CapabilityError(
            f"{program.name!r} has both inputs and tables or forces that jump, which exports do not carry together yet:"
            " make the inputs parameters, or smooth the jumps"
        )
    read = {load.index for load in start.kernel.loads if load.array == "c"}
    places = coefficient_places(layout.parameters, layout.inputs)
    moving = [
        f"{u.name} ({u.where})" if u.where else u.name
        for u, first in zip(model.inputs, places, strict=True)
        if u.smoothness >= 0 or read & set(range(first, first + WIDTH))
    ]
    if moving:
        raise CapabilityError(
            f"exports carry inputs that may jump, and not those that move bodies or constraints: {list_names(moving)}."
            " Write such a motion as an expression of time, with parameters"
        )


def refuse_contact_scene(modes: ModeModels) -> None:
    """Reject scenes with contacts that no export carries.

    Raises
    ------
    CapabilityError
        With what they have that is not exported, and the remedy.
    """
    name, equations = modes.equations.name, modes.equations
    _refuse_functions(equations.controllers)
    if modes.conditions is not None or CONDITION_TIME in modes.layout.parameters:
        raise CapabilityError(
            f"{name!r} has functions of time with kinks or jumps, at which runs are cut; exports of scenes with"
            " contacts that change do not carry them yet: smooth them, as by a ramp or tanh"
        )
