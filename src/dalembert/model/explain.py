"""Explanation of a compiled model: choices and their reasons, what was left out, and operation counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ..codegen import backend_named
from ..contacts.equations.modes import mode_equations
from ..contacts.equations.switched_modes import any_mode
from ..errors import ConstraintError, FormulationError, list_names
from ..ir.conditions import NARROW
from ..ir.kernel import describe_counts
from ..ir.program import Program
from ..lowering.programs import lower
from ..mechanics.equations import copied
from ..methods.names import CORRECTIONS
from ..once import deriving
from ..reduction import FORMULATIONS, reduce
from ..transforms.taylor.nonsmooth import nonanalytic_operations
from ..transforms.taylor.recurrences import recurrences
from ..transforms.taylor.roots_at_rest import roots_vanish_at_rest

if TYPE_CHECKING:
    from ..pipeline import Stages
    from ..scene import Scene
    from .model import CompiledModel


_RTOL = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
"""Tolerances for which the method of "auto" is shown."""


def explain(model: CompiledModel, *, passes: bool, formulations: bool) -> str:
    """Return the explanation of a compiled model as text; see `CompiledModel.explain`."""
    if model.modes is not None:
        contacts, modes = list_names(model.contacts), model.modes
        which = f"a model for each mode, compiled when it is met, because {modes.why_separate}"
        if not modes.why_separate:
            which = "one program serves all modes, but for those whose contacts share loads in other ways than in pairs"
        lines = [f"{model.name}: contacts {contacts}; {which}", *_made_contacts(modes.several.scene), *_impacts(model)]
        for mode, each in modes.compiled.items():
            states = ", ".join(f"{name}: {state}" for name, state in modes.named(mode).items())
            every = mode == any_mode(len(mode))
            title = "all modes" if every else f"mode {states}"
            lines += ["", title, *_program_lines(each, passes, formulations and not every)]
        return "\n".join(lines)
    return "\n".join([*_program_lines(model, passes, formulations), *_made_contacts(model.stages.scene)])


def _made_contacts(scene: Scene) -> list[str]:
    """Return a line for each contact made by geometry: what touches what, its reactions and their directions."""
    return [f"contact       {item.name}: {item.text}" for item in scene.made_contacts]


def _impacts(model: CompiledModel) -> list[str]:
    """Return a line on the law of impacts of contacts that open, where there are several or it is Poisson's."""
    automaton = model.modes.automaton if model.modes is not None else None
    opening = sum(contact.constraint is not None for contact in automaton.contacts) if automaton is not None else 0
    if automaton is None or opening < (1 if automaton.impacts == "poisson" else 2):
        return []
    how = {
        "newton": "all contacts that touch take part at once",
        "poisson": "all contacts that touch take part at once, and each returns its restitution times its impulse",
        "sequence": "the contact that approaches fastest is struck alone, then the next",
    }
    return [f"impacts       {automaton.impacts}: {how[automaton.impacts]}"]


def _program_lines(model: CompiledModel, passes: bool, formulations: bool) -> list[str]:
    """Return the lines on the program of a model, of one mode where there are several."""
    stages, methods = model.stages, model.method_descriptions
    program, layout = stages.program, stages.program.layout
    automatic = {rtol: model.choose_method("auto", rtol, rtol) for rtol in _RTOL}
    taken = dict.fromkeys(automatic.values())
    others = [name for name in methods if name not in taken]
    lines = [
        f"{program.name}: {_counted(layout.coordinates, 'coordinate')}, {_counted(layout.constraints, 'constraint')}"
        f" ({layout.holonomic} holonomic), {_counted(layout.unknowns, 'unknown reaction component')}",
        f"formulation   {program.formulation}: {program.notes[0]}",
        *(f"              {note}" for note in program.notes[1:]),
        f"state         {list_names(layout.state)}",
        *([f"first order   {list_names(layout.states)}"] if layout.states else []),
        *_controllers(stages),
        *([f"inputs        {list_names(layout.inputs)}"] if layout.inputs else []),
        f"backend       {stages.rendered.backend}",
        f"method        auto takes {_automatic(methods, automatic)}; also: {list_names(others)}",
        *_long_series(model),
        *_stiff(methods),
        *_nonanalytic(stages, methods),
        *_conditions(program),
        f"right side    {describe_counts(program.kernel('rhs'))} per evaluation",
        *_energy(stages),
        *(f"projection    {name}: {describe_counts(program.kernel(name))}" for name in CORRECTIONS if name in program),
        *_outputs(stages),
        f"prepared      {layout.constants - len(layout.parameters)} expressions of parameters alone, once a run",
        f"left out      {'; '.join(_left_out(stages)) or 'nothing'}",
        f"formulations  {_formulations(model, every=formulations)}",
        "compilation   " + ", ".join(f"{stage} {1e3 * s:.0f} ms" for stage, s in stages.seconds.items()),
    ]
    lines += [f"joint         {item.name}: {item.text}" for item in stages.scene.connections if item.text]
    return [*lines, *(_passes(stages) if passes else [])]


def _counted(items: Sequence[str], noun: str) -> str:
    return f"{len(items)} {noun}" if len(items) == 1 else f"{len(items)} {noun}s"


def _controllers(stages: Stages) -> list[str]:
    """Return a line for each controller: the values that it sets at its instants."""
    lines = []
    for item in stages.equations.controllers:
        law = "a Python function" if item.function is not None else "expressions"
        own = f", with the states {list_names(item.states)}" if item.states else ""
        lines.append(f"{item.name} sets {list_names(item.inputs)} by {law}{own}, and holds them in between")
    return [f"{'controllers   ' if i == 0 else ' ' * 14}{line}" for i, line in enumerate(lines)]


def _automatic(methods: Mapping[str, str], automatic: Mapping[float, str]) -> str:
    """Return the methods that auto takes: one, or each with the tolerances from which on it does."""
    taken = list(dict.fromkeys(automatic.values()))
    if len(taken) == 1:
        return f"{taken[0]}, {methods[taken[0]]}"
    spans = {name: [rtol for rtol in automatic if automatic[rtol] == name] for name in taken}
    return "; ".join(f"{name} at rtol {max(s):g} to {min(s):g}, {methods[name]}" for name, s in spans.items())


def _long_series(model: CompiledModel) -> list[str]:
    """Return a line that says from which tolerance on auto takes no Taylor steps because their series are long."""
    found = [(rtol, lines) for rtol in _RTOL if (lines := model.engine.too_long_for_series(rtol, rtol))]
    if not found:
        return []
    rtol, lines = found[0]
    return [f"              no Taylor steps from rtol {rtol:g} on, because their series have {lines:,} lines or more"]


def _stiff(methods: Mapping[str, str]) -> list[str]:
    first = next(iter(methods))
    if "radau" not in methods or first == "radau":
        return []
    return ["              auto takes radau for stiff runs, where components that have decayed limit the steps"]


def _nonanalytic(stages: Stages, methods: Mapping[str, str]) -> list[str]:
    series = [name for name in backend_named(stages.rendered.backend).series if name in methods]
    rhs = stages.program.kernel("rhs") if series else None
    if rhs is None or not (nonanalytic_operations(rhs) or roots_vanish_at_rest(stages.program)):
        return []
    known, lines = recurrences(rhs), []
    if roots_vanish_at_rest(stages.program):
        lines.append(
            "              roots vanish at rest, where they have no power series: auto takes another method than"
            f" {list_names(series)}"
        )
    ends = known.ends_at_kinks and next(iter(methods)) in series
    rough = ", and auto takes another method because of the kinks" if known.nonsmooth and not ends else ""
    if known.hidden:
        lines.append(
            f"              a power series may not show {list_names(sorted(set(known.hidden)))} of state or time:"
            f" {list_names(series)} checks the residual of its steps{rough}"
        )
        rough = ""
    if known.switches:
        operations = list_names(sorted({switch.line.op for switch in known.switches}))
        lines.append(
            f"              kinks and jumps ({operations}): steps of {list_names(series)} end at them, those of other"
            f" methods before and behind short passages{rough}"
        )
    return lines


def _energy(stages: Stages) -> list[str]:
    """Return the parts of the energy, where loads act, and the loads that it leaves out."""
    loads = stages.equations.load_energy
    lines = []
    if loads.included:
        lines.append(f"energy        with the potential energy of {list_names(loads.included)}")
    left = [
        (loads.rates, " (as far as it depends on rates)"),
        (loads.time, " (depends on time)"),
        (loads.states, " (depends on states)"),
        (loads.unknown, " (no potential energy known)"),
    ]
    out = [f"{name}{why}" for names, why in left for name in names]
    with_friction = [contact.name for contact in stages.equations.contacts if contact.tangential]
    if with_friction:
        out.append(f"the friction at {list_names(with_friction)}")
    if out:
        lines.append(f"{'              ' if lines else 'energy        '}without the work of {', '.join(out)}")
    return lines


def _conditions(program: Program) -> list[str]:
    if program.conditions is None:
        return []
    kinds = program.conditions.kinds
    count, narrow = sum(kind != NARROW for kind in kinds), NARROW in kinds
    lines = [f"conditions    {count} on time and parameters alone: a step ends wherever one changes"] if count else []
    return (
        [*lines, "pulses        of time and parameters alone are looked for; steps end about narrow ones"]
        if narrow
        else lines
    )


def _outputs(stages: Stages) -> list[str]:
    """Return a line for the outputs, and one for the guards of a mode, which only its own model gives as outputs."""
    program, guards = stages.program, {guard.output for guard in stages.equations.guards}
    names = program.layout.outputs
    counts = describe_counts(program.kernel("outputs")) if names else ""
    own, ends = ([name for name in names if (name in guards) == guard] for guard in (False, True))
    released = [f"released      {stages.reduced.released}"] if stages.reduced.released else []
    if not ends:
        return [f"outputs       {list_names(own)}" + (f" ({counts})" if own else ""), *released]
    alone = "outputs of the model of this mode alone, not of a run"
    guarding = f"guards        {list_names(ends)} (with outputs {counts}): {alone}"
    return [f"outputs       {list_names(own)}", guarding, *released]


def _left_out(stages: Stages) -> list[str]:
    """Return the parts of the scene that no output or state depends on."""
    program, layout = stages.program, stages.program.layout
    out = []
    reactions = [name for name in layout.unknowns if name not in {*layout.outputs, *layout.undetermined}]
    if reactions:
        out.append(f"the reactions {list_names(reactions)}, which no output needs")
    read = {joint.name for joint in stages.scene.joints}
    silent = [item.name for item in stages.scene.connections if item.name not in read]
    if silent:
        out.append(f"the reactions of {list_names(map(repr, silent))}, such as '{silent[0]}.force_x'")
    if hidden := [name for name in layout.undetermined if name not in layout.outputs]:
        out.append(f"{list_names(hidden)}, which the equations do not determine")
    if stages.equations.reaction_values:
        out.append("constraints: reactions are given forces")
    elif not layout.constraints:
        out.append("constraint machinery: the scene has no constraints")
    elif "project_velocity" not in program and program.formulation == "minimal":
        what = "multipliers" if "project_position" in program else "multipliers and projections"
        out.append(f"{what}: the speeds satisfy the constraints")
    rhs = {load.index for load in program.kernel("rhs").loads if load.array == "y"}
    idle = [name for i, name in enumerate(layout.state) if i not in rhs]
    if idle:
        out.append(f"nothing depends on {list_names(idle)}: quadratures")
    return out


def _formulations(model: CompiledModel, *, every: bool) -> str:
    """Return the operation counts of right-hand sides: of the formulations that are compiled, or of every one."""
    known = {model.formulation: model} | model.variants.in_formulations()
    counts = {
        name: describe_counts(known[name].stages.program.kernel("rhs")) if name in known else _count(model.stages, name)
        for name in FORMULATIONS
        if every or name in known
    }
    text = "; ".join(f"{name}: {count}" for name, count in counts.items())
    return text if every else f"{text} (explain(formulations=True) counts those of the others)"


@deriving
def _count(stages: Stages, formulation: str) -> str:
    """Return the operation count of the right-hand side in a formulation, as far as that can serve the scene."""
    equations = copied(stages.derivation.equations)
    try:
        reduced = reduce(equations if stages.mode is None else mode_equations(equations, stages.mode), formulation)
        return describe_counts(lower(reduced).kernel("rhs"))
    except (FormulationError, ConstraintError):
        return "not supported"


def _passes(stages: Stages) -> list[str]:
    """Return a line for each pass that made the program: its name, its time in all kernels, what it did to each."""
    seconds: dict[str, float] = {}
    removed: dict[str, Counter[str]] = {}
    for record in stages.passes:
        seconds[record.name] = seconds.get(record.name, 0.0) + record.seconds
        change = removed.setdefault(record.name, Counter())
        for kernel in {**record.before, **record.after}:
            change[kernel] += record.before.get(kernel, 0) - record.after.get(kernel, 0)
    lines = [f"{name:<20} {1e3 * seconds[name]:7.2f} ms  {_change(removed[name])}" for name in removed]
    return [f"{'' if i else 'passes':<13} {line}" for i, line in enumerate(lines)]


def _change(removed: Counter[str]) -> str:
    """Return how many operations a pass removed and added, in total and in each kernel."""
    parts = []
    for verb, sign in (("removed", 1), ("added", -1)):
        kernels = {kernel: sign * count for kernel, count in removed.items() if sign * count > 0}
        if kernels:
            total = sum(kernels.values())
            counts = ", ".join(f"{kernel} {count}" for kernel, count in kernels.items())
            parts.append(f"{total} operation{'s' if total > 1 else ''} {verb}: {counts}")
    return "; ".join(parts) or "no operations removed"
