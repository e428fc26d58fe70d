"""Functions of FMI 3.0 for what a unit has none of: they answer with an error that says so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

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
