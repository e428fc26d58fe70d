"""The table of what each kind of export carries, and errors for scenes and programs beyond it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..arrays import FloatArray
from ..errors import CapabilityError, list_names
from ..events.event_code import Event
from ..ir.calls import function_of
from ..ir.conditions import CONDITION_TIME
from ..ir.kernel import calls_in
from ..ir.ops import TABLE_OPERATIONS
from ..ir.program import WIDTH, Program, coefficient_places
from ..reduction.starting import Start
from ..runs.capabilities import WITHOUT
from ..runs.impulses import impulses_of
from ..scene.model import ControllerModel
from ..starts.constraint_choice import dependent_at_start
from ..transforms.taylor.nonsmooth import decisions

if TYPE_CHECKING:
    from ..model.model import CompiledModel
    from ..phases.mode_models import ModeModels

_EVERY = ("c", "fmu", "page", "wheel", "numba", "jax")
"""Kinds of exports."""

FIXED = "rk4"
"""The method whose steps have a fixed size, which kind "c" has."""

_COMPILED, _ALONE = ("c", "fmu", "page", "wheel"), ("c", "page", "wheel")

LOCKS = "angles that may lock"
MOMENTS = "functions of time with kinks, jumps or pulses"

_TOGETHER = "leave one of them out"
_AS_INPUTS = "make them inputs (add_inputs), which are set during a run, or smooth them"
CARRIED: dict[str, tuple[tuple[str, ...], str]] = {
    "events": (_COMPILED, "leave the events out"),
    "sampled controllers": (_COMPILED, WITHOUT),
    "contacts that change": (_COMPILED, "export one mode, model.mode(...).export(...)"),
    "contacts that change beside events": (_ALONE, _TOGETHER),
    "contacts that change beside sampled controllers": (_ALONE, _TOGETHER),
    "tables": ((*_COMPILED, "numba"), "write the curves as expressions"),
    MOMENTS: (_COMPILED, _AS_INPUTS),
    f"{MOMENTS} beside sampled controllers": (_ALONE, _AS_INPUTS),
    "rates that jump with the state": (_EVERY, "smooth the jumps, as by tanh"),
    LOCKS: (
        (*_COMPILED, "numba", FIXED),
        "give the example (initial=, parameters=) if its motion is regular there",
    ),
}
"""Kinds that carry a feature, `FIXED` among them where its steps do, and the remedy for others."""


def refuse_kind(model: CompiledModel, kind: str, method: str, events: Sequence[Event]) -> None:
    """Reject a model with events of a kind, or of the method `FIXED`, that does not carry what they have.

    Raises
    ------
    CapabilityError
        With what that is, and what carries it.
    """
    column = FIXED if method == FIXED else kind
    for feature, names in _features(model, column, events):
        refuse_feature(feature, column, names)


def refuse_feature(feature: str, kind: str, names: Sequence[str]) -> None:
    """Reject a feature of a scene, and the names of what has it, where a kind or the method `FIXED` does not carry it.

    Raises
    ------
    CapabilityError
    """
    kinds, remedy = CARRIED[feature]
    if kind in kinds:
        return
    others = list_names(repr(other) for other in kinds if other != FIXED)
    if kind == FIXED:
        raise CapabilityError(
            f"method={FIXED!r} does not carry {feature} ({list_names(names)}): its steps do not end where these break"
            f' the motion. Take method="auto", which chooses its steps, with one of the kinds {others}, or {remedy}'
        )
    raise CapabilityError(
        f"kind={kind!r} does not carry {feature} ({list_names(names)}): take one of the kinds {others}, or {remedy}"
    )


def _features(model: CompiledModel, column: str, events: Sequence[Event]) -> Iterator[tuple[str, list[str]]]:
    """Yield the features of a scene with events that count in a column of the table, and the names of what has them."""
    labels, contacts = [event.label for event in events], [] if model.modes is None else list(model.contacts)
    controllers = [item.name for item in model.controllers]
    if contacts:
        yield "contacts that change", contacts
    if labels:
        yield "events", labels
    if controllers:
        yield "sampled controllers", controllers
    if contacts and labels:
        yield "contacts that change beside events", [*contacts, *labels]
    if contacts and controllers:
        yield "contacts that change beside sampled controllers", [*contacts, *controllers]
    if contacts:  # the modes have the rest
        return
    program = model.stages.program
    kernels = [program.kernel("rhs")] if column == FIXED else program
    if any(line.op in TABLE_OPERATIONS for kernel in kernels for line in kernel.body):
        yield "tables", [program.name]
    if program.conditions is not None:
        yield MOMENTS, [program.name]
        if controllers:
            yield f"{MOMENTS} beside sampled controllers", [program.name, *controllers]
    if decisions(program) is not None:
        yield "rates that jump with the state", [program.name]


def table_of_kinds() -> str:
    """Return the table of what kinds carry, in Markdown, for `docs/export.md`."""
    columns = ("c", FIXED, *_EVERY[1:])
    names = [f'`"{kind}"`' if kind != FIXED else f'`method="{FIXED}"`' for kind in columns]
    lines = [f"| | {' | '.join(names)} |", f"|---|{'---|' * len(columns)}"]
    for feature, (kinds, _) in CARRIED.items():
        lines.append(f"| {feature} | {' | '.join('yes' if kind in kinds else 'no' for kind in columns)} |")
    return "\n".join(lines)


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
