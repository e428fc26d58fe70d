"""Functional mock-up units: the simulator in C with the functions of FMI, its description, and binaries."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from ..codegen.c.contact_simulator import ContactUnitSimulator
from ..codegen.c.descriptions import CSource
from ..codegen.c.event_simulator import EventUnitSimulator
from ..codegen.c.printing import double, rows_of
from ..codegen.c.unit_simulator import UnitSimulator
from ..codegen.rendering import render
from ..errors import CapabilityError, OptionError, list_names, unknown_name
from ..values import listed
from ..version import __version__
from .compilers import c_compiler, foreign_library, shared_library
from .unit_variables import AnyUnit, UnitVariable, UnitVariables, absent_functions, nominal_of, unit_variables

_TARGETS = {
    "linux64": ("x86_64-linux-gnu.2.17", "so", "x86_64-linux"),
    "win64": ("x86_64-windows-gnu", "dll", "x86_64-windows"),
    "darwin64": ("x86_64-macos", "dylib", "x86_64-darwin"),
    "aarch64-linux": ("aarch64-linux-gnu.2.17", "so", "aarch64-linux"),
    "aarch64-darwin": ("aarch64-macos", "dylib", "aarch64-darwin"),
}
"""Targets of ziglang, suffixes of libraries and folders of FMI 3.0, by names of platforms: those of FMI 2.0, if any."""

_PLATFORMS = {
    ("Linux", "x86_64"): "linux64",
    ("Darwin", "x86_64"): "darwin64",
    ("Linux", "aarch64"): "aarch64-linux",
    ("Darwin", "arm64"): "aarch64-darwin",
}
"""Names of the platforms of machines; those for arm64 have none in FMI 2.0."""

_OTHER_TYPES = {
    "2.0": [("Integer", "integers"), ("Boolean", "booleans"), ("String", "strings")],
    "3.0": [
        ("Float32", "numbers of 32 bits"),
        *((f"{sign}Int{bits}", "integers") for bits in (8, 16, 32, 64) for sign in ("", "U")),
        ("Boolean", "booleans"),
        ("String", "strings"),
    ],
}
"""Types of variables that no unit has, by versions, and what to call them."""

_EVERYWHERE = "contacts events exchanged n_states prefix stops upper"

_PARTS = {
    "unit": "corrected first_input guid indicated inputs n_given n_knowns n_locks n_slopes rtol span starts"
    " state_references version",
    "unit_values": "ended first_input first_known_parameter inputs n_all n_known_parameters n_known_states n_knowns"
    " n_references n_values n_wanted",
    "unit_exchange": "controlled corrected first_indicator looked_at n_indicators n_locks n_values nominal updated",
}
"""Templates of the functions of a unit, in their order, and the variables of each besides those `_EVERYWHERE`."""


def fmu_files(source: CSource, platforms: Sequence[str] | None = None, version: str = "2.0") -> dict[str, str | bytes]:
    """Return the files of a unit by their names in the archive.

    Binaries are for some platforms, by default for this machine where it has a C compiler.

    Raises
    ------
    MissingExtraError
        For platforms that are named, without the package ziglang.
    CapabilityError
        Where initial values or parameters of the example are missing, which are the start values of the unit.
    OptionError
        Where the compiler fails.
    """
    refuse_missing(source, "a unit")
    simulator = unit_simulator(source)
    prefix, digit = simulator.prefix, version[0]
    texts = {name: simulator.files[name] for name in (f"{prefix}.c", f"{prefix}.h")}
    guid = hashlib.sha256("".join(texts.values()).encode()).hexdigest()[:32]
    variables = unit_variables(simulator, independent=version != "2.0")
    functions = _functions(simulator, variables, version) | {"guid": guid}
    parts = [
        render(f"fmi/{name}.c.j2", {key: functions[key] for key in f"{_EVERYWHERE} {own}".split()})
        for name, own in _PARTS.items()
    ]
    texts[f"fmi{digit}.c"] = "".join(parts) + _interface(simulator, functions, digit)
    sources = [f"{prefix}.c", f"fmi{digit}.c"]
    described = _description(simulator, variables, digit, sources) | {"guid": guid}
    files: dict[str, str | bytes] = {"modelDescription.xml": render(f"fmi/fmi{digit}.xml.j2", described)}
    files |= {f"sources/{name}": text for name, text in texts.items()}
    if version != "2.0":
        files["sources/buildDescription.xml"] = render(
            "fmi/build_description.xml.j2", {"prefix": prefix, "sources": sources}
        )
    files["documentation/README.md"] = simulator.files["README.md"]
    for name, library in _libraries(texts, platforms, version).items():
        _, suffix, folder = _TARGETS[name]
        files[f"binaries/{name if version == '2.0' else folder}/{prefix}.{suffix}"] = library
    return files


def unit_simulator(source: CSource) -> AnyUnit:
    """Return the simulator of a unit."""
    if source.contacts is not None:
        return ContactUnitSimulator(source)
    return UnitSimulator(source) if source.events is None else EventUnitSimulator(source)


def _libraries(texts: Mapping[str, str], platforms: Sequence[str] | None, version: str) -> dict[str, bytes]:
    """Return binaries by names of platforms."""
    if platforms is not None:
        return {name: foreign_library(_TARGETS[name][0], texts) for name in checked_platforms(platforms)}
    here, compiler = _PLATFORMS.get((platform.system(), platform.machine())), c_compiler()
    if here is None or compiler is None or (version == "2.0" and here.startswith("aarch64")):
        return {}
    return {here: shared_library(compiler, texts)}


def checked_platforms(platforms: Any) -> list[str]:
    """Return names of platforms.

    Raises
    ------
    OptionError
        For names that are not known.
    """
    names = [str(name) for name in listed("platforms", platforms, "names of platforms")]
    unknown = [name for name in names if name not in _TARGETS]
    if unknown:
        raise OptionError(unknown_name("platform", unknown[0], _TARGETS))
    return names


def refuse_missing(source: CSource, what: str) -> None:
    """Reject an export that starts with its example, where numbers of that are missing.

    Raises
    ------
    CapabilityError
        With their names.
    """
    missing = [name for name in (*source.start.given, *source.parameters) if name not in source.numbers]
    if missing:
        raise CapabilityError(
            f"{what} needs a start value for each of its variables: give initial= and parameters=. Missing:"
            f" {list_names(missing)}"
        )


def _functions(simulator: AnyUnit, variables: UnitVariables, version: str) -> dict[str, Any]:
    """Return the variables of the templates of the functions of a unit."""
    source, layout = simulator.source, simulator.layout
    wanted = [*source.start.given, *source.parameters, *layout.inputs]
    n_locks = len(source.locking) if simulator.exchanged else 0
    updated = source.contacts is not None or bool(source.watched)
    first_indicator = simulator.n_values - len(variables.indicators) if variables.indicators else 0
    return {
        "version": version,
        "prefix": simulator.prefix,
        "upper": simulator.prefix.upper(),
        "exchanged": simulator.exchanged,
        "corrected": simulator.corrected,
        "n_given": max(len(wanted), 1),
        "n_wanted": len(wanted),
        "n_slopes": max(len(layout.inputs), 1),
        "n_states": len(layout.state),
        "n_values": simulator.n_values,
        "n_knowns": simulator.n_knowns,
        "n_locks": n_locks,
        "indicated": [(first_indicator, simulator.n_values)] if n_locks else [],
        "n_indicators": len(variables.indicators),
        "first_input": len(wanted) - len(layout.inputs),
        "starts": rows_of([double(float(source.numbers.get(name, 0.0))) for name in wanted] or ["0.0"]),
        "state_references": ", ".join(str(variable.number) for variable in variables.states),
        "rtol": double(source.tolerances[0]) if simulator.corrected else "",
        "nominal": double(nominal_of(source.tolerances)),
        "contacts": source.contacts is not None,
        "controlled": source.sampling is not None,
        "events": bool(source.watched),
        "updated": updated,
        "looked_at": bool(n_locks or simulator.corrected or updated or source.sampling is not None),
        "event_status": f"{simulator.prefix.upper()}_EVENT" if source.watched else "",
        "ended": ("UNIT_DISCARD" if version == "2.0" else "UNIT_OK") if source.watched else "",
        "stops": source.contacts is not None and version != "2.0",
        "span": "" if source.contacts is None else double(abs(source.span[1] - source.span[0])),
        "inputs": len(layout.inputs),
        "first_indicator": first_indicator,
        "n_all": simulator.n_values + 1,
        "n_references": len(wanted) + simulator.n_values,
        "n_known_states": simulator.n_known_states,
        "n_known_parameters": len(source.parameters) if simulator.n_knowns else 0,
        "first_known_parameter": simulator.n_known_states + len(layout.inputs),
    }


def _interface(simulator: AnyUnit, functions: Mapping[str, Any], digit: str) -> str:
    """Return the functions of a version of the standard."""
    if digit == "2":
        names = ("controlled", "exchanged", "first_input", "n_wanted", "prefix", "upper")
        given = {name: functions[name] for name in names} | {"other_types": _OTHER_TYPES["2.0"]}
    else:
        given = {
            name: functions[name]
            for name in ("contacts", "controlled", "event_status", "exchanged", "n_indicators", "n_states", "prefix")
        }
        has = {"exchanged": simulator.exchanged, "events": simulator.exchanged or functions["contacts"]}
        given["absent"] = absent_functions(_OTHER_TYPES["3.0"], **has)
    return render(f"fmi/fmi{digit}.c.j2", given)


def _description(simulator: AnyUnit, variables: UnitVariables, digit: str, sources: list[str]) -> dict[str, Any]:
    """Return the variables of the template of a description."""
    source, place = simulator.source, "place" if digit == "2" else "number"
    outputs = [variable for variable in variables.all if variable.causality == "output"]
    unknowns = {variable.place: variable for variable in (*outputs, *variables.states, *variables.rates)}
    text = f"scene {source.program.name}, formulation {source.program.formulation}"
    text += "" if simulator.exchanged else "; for co-simulation alone, because rates jump or have pulses"

    def references(some: Iterable[UnitVariable]) -> list[dict[str, int]]:
        return [{place: getattr(variable, place)} for variable in some]

    fields = ["name", "number", "text", "causality", "variability", "initial", "start", "nominal"]
    fields += [] if digit == "2" else ["unit"]
    found = {
        "model": escape(source.program.name),
        "prefix": simulator.prefix,
        "description": escape(text),
        "tool": f"dalembert {__version__}",
        "kinds": [*(["ModelExchange"] if simulator.exchanged else []), "CoSimulation"],
        "differentiated": simulator.n_knowns > 0,
        "needs_steps": simulator.corrected or bool(variables.indicators),
        "begin": repr(float(source.span[0])),
        "end": repr(float(source.span[1])),
        "rtol": repr(source.tolerances[0]),
        "variables": [
            {name: getattr(each, name) for name in fields}
            | {"derivative": "" if each.state is None else str(getattr(each.state, place))}
            for each in variables.all
        ],
        "outputs": references(outputs),
        "rates": references(variables.rates),
        "unknowns": references(unknowns[number] for number in sorted(unknowns)),
    }
    if digit == "2":
        return found | {"n_indicators": len(variables.indicators), "sources": sources}
    found["contacts"] = source.contacts is not None
    return found | {"indicators": references(variables.indicators)}
