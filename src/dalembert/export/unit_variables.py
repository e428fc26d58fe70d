"""Variables of functional mock-up units, in the terms of the standard, and its functions for what a unit has none of.

These functions of FMI 3.0 answer with an error that says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, final

from ..codegen.c.contact_simulator import ContactUnitSimulator
from ..codegen.c.unit_simulator import UnitSimulator
from ..contacts.equations.contact_laws import STATES
from ..frozen import frozen

AnyUnit = UnitSimulator | ContactUnitSimulator


@final
@frozen
class UnitVariable:
    """A variable of the description of a unit, in its terms.

    Attributes
    ----------
    number, place : int
        Its value reference, and its place among the variables, from 1 on.
    start, nominal : str
        Its start value and nominal value, empty where it has none.
    state : UnitVariable or None
        What it is the derivative of.
    """

    name: str
    text: str
    number: int
    place: int
    causality: str
    variability: str = "continuous"
    initial: str = ""
    start: str = ""
    nominal: str = ""
    unit: str = ""
    state: UnitVariable | None = None


@final
class UnitVariables:
    """The variables of a unit, whose value references are places in what `unit_get` computes.

    Attributes
    ----------
    all : list of UnitVariable
        In the order of the description.
    states, rates, indicators : list of UnitVariable
        Components of the state, their derivatives, and determinants of angles.
    """

    def __init__(self) -> None:
        self.all, self.rates, self.indicators = list[UnitVariable](), list[UnitVariable](), list[UnitVariable]()
        self.states: list[UnitVariable] = []
        self._taken: set[str] = set()

    def reserve(self, names: Iterable[str]) -> None:
        """Keep names for variables to come."""
        self._taken |= {*names}

    def add(
        self, name: str, text: str, number: int, causality: str, *, own: bool = False, **further: Any
    ) -> UnitVariable:
        """Add a variable; a name that is not one of the scene's but the unit's `own` gets "_" where it is taken."""
        while own and name in self._taken:
            name += "_"
        self._taken.add(name)
        place = len(self.all) + 1
        self.all.append(UnitVariable(escape(name), escape(text), number, place, causality, **further))
        return self.all[-1]


def unit_variables(simulator: AnyUnit, *, independent: bool) -> UnitVariables:
    """Return the variables of a unit; the time is one where `independent`."""
    source, layout = simulator.source, simulator.layout
    numbers, found = source.numbers, UnitVariables()
    computed = [*layout.coordinates, *layout.rates, *layout.states, *layout.outputs]
    found.reserve((*computed, *source.parameters, *layout.inputs, *layout.state))
    fixed: dict[str, Any] = {"variability": "fixed", "initial": "exact"}
    for number, name in enumerate(source.start.given):
        start = repr(float(numbers[name]))
        found.add(f"{name}_start", f"initial value of {name}", number, "parameter", own=True, start=start, **fixed)
    for name in source.parameters:
        found.add(name, "", len(found.all), "parameter", start=repr(float(numbers[name])), **fixed)
    for name in layout.inputs:
        found.add(name, "", len(found.all), "input", start=repr(float(numbers.get(name, 0.0))))
    first = len(found.all)
    copies = _copied_states(simulator)
    nominal = repr(nominal_of(source.tolerances))
    named = {*layout.inputs}  # models have them among their outputs, too, and perhaps coordinates
    states: dict[int, UnitVariable] = {}
    for number, name in enumerate(computed):
        if name not in named:
            place = copies.get(number)
            given: dict[str, Any] = {"nominal": nominal} if place is not None else {}
            variable = found.add(name, "", first + number, "output", initial="calculated", **given)
            states |= {} if place is None else {place: variable}
            named.add(name)
    first += len(computed)
    contacts = () if source.contacts is None else source.contacts.contacts
    states_of_contacts = ", ".join(f"{number} {state}" for number, state in enumerate(STATES))
    for number, (name, _) in enumerate(contacts):
        text, kind = f"what the contact does: {states_of_contacts}", "discrete"
        found.add(f"mode({name})", text, first + number, "output", own=True, variability=kind, initial="calculated")
    first += len(contacts)
    for number, label in enumerate(source.watched):
        text = f"how often the event {label} has occurred"
        found.add(
            f"count({label})", text, first + number, "output", own=True, variability="discrete", initial="calculated"
        )
    first += len(source.watched)
    if simulator.exchanged:
        _add_exchanged(found, simulator, states, first)
    if independent:
        found.add("time", "", first + simulator.n_values - simulator.n_computed, "independent", own=True, unit="s")
    return found


def _copied_states(simulator: AnyUnit) -> dict[int, int]:
    """Return the places in the state of those coordinates, rates and first-order states that are components of it."""
    if not simulator.exchanged:
        return {}
    if simulator.source.contacts is not None:
        return {place: place for place in range(len(simulator.source.contacts.variables))}
    expand = simulator.program.kernel("expand")
    loads = {load.target: load.index for load in expand.loads if load.array == "y"}
    pairs = ((number, loads.get(output)) for number, output in enumerate(expand.outputs) if isinstance(output, str))
    found: dict[int, int] = {}
    for number, place in pairs:
        if place is not None and place not in found.values():
            found[number] = place
    return found


def _add_exchanged(found: UnitVariables, simulator: AnyUnit, states: Mapping[int, UnitVariable], first: int) -> None:
    """Add components of the state that no variable has yet, their derivatives, and determinants of angles."""
    contacts = simulator.source.contacts
    names = simulator.layout.state if contacts is None else contacts.variables
    nominal = repr(nominal_of(simulator.source.tolerances))
    calculated: dict[str, Any] = {"causality": "local", "initial": "calculated"}
    for place, name in enumerate(names):
        own = escape(name) in {variable.name for variable in found.all}
        state = states.get(place) or found.add(
            name, "component of the state", first + place, own=own, nominal=nominal, **calculated
        )
        found.states.append(state)
    first += len(names)
    for place, (name, state) in enumerate(zip(names, found.states, strict=True)):
        found.rates.append(
            found.add(f"der({name})", f"derivative of {name}", first + place, own=True, state=state, **calculated)
        )
    first += len(names)
    for place, (name, text) in enumerate(_indicators(simulator)):
        found.indicators.append(found.add(name, text, first + place, own=True, **calculated))


def _indicators(simulator: AnyUnit) -> list[tuple[str, str]]:
    """Return names and texts of the event indicators."""
    if isinstance(simulator, ContactUnitSimulator):
        text = "guard of what contacts do, which change where it falls through zero"
        return [(f"guard_{number + 1}", text) for number in range(simulator.n_guards)]
    text = "determinant of angles, which lock where it vanishes"
    found = [(f"lock_{number + 1}", text) for number in range(len(simulator.source.locking))]
    text = "expression of the event, which occurs where it vanishes"
    return found + [(f"event({label})", text) for label in simulator.source.watched]


def nominal_of(tolerances: tuple[float, float]) -> float:
    """Return the nominal value of states: the absolute tolerance of the export relative to its relative one."""
    rtol, atol = tolerances
    return atol / rtol if rtol > 0.0 and atol > 0.0 else 1.0


_REFERENCES = ("const fmi3ValueReference", "references[]")
_COUNT = ("size_t", "count")
_N_VALUES = ("size_t", "n_values")
_CLOCKS = "there are no clocks"
_QUALIFIERS = ("fmi3IntervalQualifier", "qualifiers[]")

_EVENTS = (
    ("EnterEventMode", ()),
    ("EvaluateDiscreteStates", ()),
    (
        "UpdateDiscreteStates",
        (
            *(("fmi3Boolean *", name) for name in ("needs_update", "terminate", "nominals_changed", "values_changed")),
            ("fmi3Boolean *", "next_defined"),
            ("fmi3Float64 *", "next_time"),
        ),
    ),
)
_NUMBERS = (("fmi3Float64", "values[]"), _COUNT)
_GIVEN = (("const fmi3Float64", "values[]"), _COUNT)
_EXCHANGE = (
    ("EnterContinuousTimeMode", ()),
    (
        "CompletedIntegratorStep",
        (
            ("fmi3Boolean", "no_set_before"),
            *(("fmi3Boolean *", name) for name in ("enter_event_mode", "terminate")),
        ),
    ),
    ("SetTime", (("fmi3Float64", "t"),)),
    ("SetContinuousStates", _GIVEN),
    ("GetContinuousStates", _NUMBERS),
    ("GetContinuousStateDerivatives", _NUMBERS),
    ("GetNominalsOfContinuousStates", _NUMBERS),
    ("GetEventIndicators", _NUMBERS),
    ("GetNumberOfEventIndicators", (("size_t *", "count"),)),
    ("GetNumberOfContinuousStates", (("size_t *", "count"),)),
)
_COUNTED = (
    ("GetBinary", (("size_t", "sizes[]"), ("fmi3Binary", "values[]"), _N_VALUES), "there are no binaries"),
    ("SetBinary", (("const size_t", "sizes[]"), ("const fmi3Binary", "values[]"), _N_VALUES), "there are no binaries"),
    ("GetClock", (("fmi3Clock", "values[]"),), _CLOCKS),
    ("SetClock", (("const fmi3Clock", "values[]"),), _CLOCKS),
    ("GetIntervalDecimal", (("fmi3Float64", "intervals[]"), _QUALIFIERS), _CLOCKS),
    ("GetIntervalFraction", (("fmi3UInt64", "counters[]"), ("fmi3UInt64", "resolutions[]"), _QUALIFIERS), _CLOCKS),
    ("GetShiftDecimal", (("fmi3Float64", "shifts[]"),), _CLOCKS),
    ("GetShiftFraction", (("fmi3UInt64", "counters[]"), ("fmi3UInt64", "resolutions[]")), _CLOCKS),
    ("SetIntervalDecimal", (("const fmi3Float64", "intervals[]"),), _CLOCKS),
    ("SetIntervalFraction", (("const fmi3UInt64", "counters[]"), ("const fmi3UInt64", "resolutions[]")), _CLOCKS),
    ("SetShiftDecimal", (("const fmi3Float64", "shifts[]"),), _CLOCKS),
    ("SetShiftFraction", (("const fmi3UInt64", "counters[]"), ("const fmi3UInt64", "resolutions[]")), _CLOCKS),
    (
        "GetOutputDerivatives",
        (("const fmi3Int32", "orders[]"), ("fmi3Float64", "values[]"), _N_VALUES),
        "there are no derivatives of outputs",
    ),
)
_OTHERS = (
    (
        "GetNumberOfVariableDependencies",
        (("fmi3ValueReference", "variable"), ("size_t *", "count")),
        "dependencies are those of the description",
    ),
    (
        "GetVariableDependencies",
        (
            ("fmi3ValueReference", "variable"),
            ("size_t", "elements[]"),
            ("fmi3ValueReference", "references[]"),
            ("size_t", "others[]"),
            ("fmi3DependencyKind", "kinds[]"),
            _COUNT,
        ),
        "dependencies are those of the description",
    ),
    (
        "GetAdjointDerivative",
        (
            ("const fmi3ValueReference", "unknowns[]"),
            ("size_t", "n_unknowns"),
            ("const fmi3ValueReference", "knowns[]"),
            ("size_t", "n_knowns"),
            ("const fmi3Float64", "seed[]"),
            ("size_t", "n_seed"),
            ("fmi3Float64", "sensitivity[]"),
            ("size_t", "n_sensitivity"),
        ),
        "there are no adjoint derivatives",
    ),
    ("EnterConfigurationMode", (), "there are no structural parameters"),
    ("ExitConfigurationMode", (), "there are no structural parameters"),
    ("ActivateModelPartition", (("fmi3ValueReference", "clock"), ("fmi3Float64", "t")), _CLOCKS),
)


def absent_functions(types: Iterable[tuple[str, str]], *, exchanged: bool, events: bool) -> list[dict[str, Any]]:
    """Return the functions as variables of their template; `types` are those of which there are no variables.

    Those of model exchange are among them unless a unit is `exchanged`, and those of events unless it has `events`.
    """
    found = []
    if not events:
        text = "the unit is one for co-simulation, without events"
        found += [_function(name, parameters, text) for name, parameters in _EVENTS]
    if not exchanged:
        text = "the unit is one for co-simulation alone"
        found += [_function(name, parameters, text) for name, parameters in _EXCHANGE]
    for kind, what in types:
        for verb, const in (("Get", ""), ("Set", "const ")):
            values = ((f"{const}fmi3{kind}", "values[]"), _N_VALUES)
            found.append(
                _function(f"{verb}{kind}", (_REFERENCES, _COUNT, *values), f"there are no {what}", counted=True)
            )
    for name, further, text in _COUNTED:
        found.append(_function(name, (_REFERENCES, _COUNT, *further), text, counted=True))
    return [*found, *(_function(name, parameters, text) for name, parameters, text in _OTHERS)]


def _function(
    name: str, parameters: Sequence[tuple[str, str]], reason: str, *, counted: bool = False
) -> dict[str, Any]:
    """Return the variables of one function; `counted`: it is no error where nothing is asked for."""
    named = [
        {"kind": kind if kind.endswith("*") else f"{kind} ", "declared": declared, "name": declared.removesuffix("[]")}
        for kind, declared in parameters
    ]
    return {"name": name, "parameters": named, "reason": reason, "counted": counted}
