"""Functional mock-up units: the simulator in C with the functions of FMI 2.0, its description, and a binary."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from ..codegen.c.contact_simulator import c_files
from ..codegen.c.descriptions import CSource
from ..codegen.c.printing import double, prefix_of, rows_of
from ..codegen.rendering import render
from ..errors import CapabilityError, OptionError, list_names, unknown_name
from ..values import listed
from ..version import __version__
from .compilers import c_compiler, foreign_library, shared_library

if TYPE_CHECKING:
    pass

_TARGETS = {
    "linux64": ("x86_64-linux-gnu.2.17", "so"),
    "win64": ("x86_64-windows-gnu", "dll"),
    "darwin64": ("x86_64-macos", "dylib"),
    "aarch64-linux": ("aarch64-linux-gnu.2.17", "so"),
    "aarch64-darwin": ("aarch64-macos", "dylib"),
}
"""Targets of ziglang and suffixes of libraries, by names of platforms: of FMI 2.0, and for arm64 of FMI 3.0."""

_PLATFORMS = {("Linux", "x86_64"): ("linux64", "so"), ("Darwin", "x86_64"): ("darwin64", "dylib")}
"""Names of platforms in FMI 2.0, and suffixes of their libraries."""


def fmu_files(source: CSource, platforms: Sequence[str] | None = None) -> dict[str, str | bytes]:
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
    prefix, texts = prefix_of(source.program.name), c_files(source)
    simulator = {name: texts[name] for name in (f"{prefix}.c", f"{prefix}.h")}
    guid = hashlib.sha256("".join(simulator.values()).encode()).hexdigest()[:32]
    simulator["fmi2.c"] = render("fmi/fmi2.c.j2", _functions(source, prefix, guid))
    files: dict[str, str | bytes] = {"modelDescription.xml": _description(source, prefix, guid)}
    files |= {f"sources/{name}": text for name, text in simulator.items()}
    files["documentation/README.md"] = texts["README.md"]
    if platforms is not None:
        for name in checked_platforms(platforms):
            target, suffix = _TARGETS[name]
            files[f"binaries/{name}/{prefix}.{suffix}"] = foreign_library(target, simulator)
        return files
    where, compiler = _PLATFORMS.get((platform.system(), platform.machine())), c_compiler()
    if where is not None and compiler is not None:
        folder, suffix = where
        files[f"binaries/{folder}/{prefix}.{suffix}"] = shared_library(compiler, simulator)
    return files


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


def _wanted(source: CSource) -> list[str]:
    return [*source.start.given, *source.parameters, *source.program.layout.inputs]


def _functions(source: CSource, prefix: str, guid: str) -> dict[str, Any]:
    """Return the variables of ``fmi/fmi2.c.j2``."""
    layout, wanted = source.program.layout, _wanted(source)
    variables = len(source.program.kernel("expand").outputs)
    return {
        "prefix": prefix,
        "upper": prefix.upper(),
        "guid": guid,
        "n_given": max(len(wanted), 1),
        "n_wanted": len(wanted),
        "n_slopes": max(len(layout.inputs), 1),
        "n_states": len(layout.state),
        "n_variables": variables,
        "n_values": variables + len(layout.outputs),
        "n_references": len(wanted) + variables + len(layout.outputs),
        "first_input": len(wanted) - len(layout.inputs),
        "starts": rows_of([double(float(source.numbers.get(name, 0.0))) for name in wanted] or ["0.0"]),
        "inputs": len(layout.inputs),
        "outputs": len(layout.outputs),
    }


def _description(source: CSource, prefix: str, guid: str) -> str:
    """Return the description of a unit; the numbers of variables are their value references."""
    layout, numbers = source.program.layout, source.numbers
    computed = [*layout.coordinates, *layout.rates, *layout.states, *layout.outputs]
    taken, given = {*computed, *source.parameters, *layout.inputs}, list[dict[str, Any]]()
    for name in source.start.given:
        own = f"{name}_start"
        while own in taken:
            own += "_"
        taken.add(own)
        given.append(_variable(own, f"initial value of {name}", "parameter", "fixed", "exact", numbers[name]))
    given += [_variable(name, "", "parameter", "fixed", "exact", numbers[name]) for name in source.parameters]
    given += [_variable(name, "", "input", "continuous", "", numbers.get(name, 0.0)) for name in layout.inputs]
    given = [{**variable, "number": number} for number, variable in enumerate(given)]
    named = {*layout.inputs}  # models have them among their outputs, too, and perhaps coordinates
    outputs = []
    for number, name in enumerate(computed):
        if name not in named:
            outputs.append({"name": escape(name), "number": len(given) + number, "text": ""})
            named.add(name)
    variables = {
        "model": escape(source.program.name),
        "prefix": prefix,
        "guid": guid,
        "description": escape(f"scene {source.program.name}, formulation {source.program.formulation}"),
        "tool": f"dalembert {__version__}",
        "sources": [f"{prefix}.c", "fmi2.c"],
        "begin": repr(float(source.span[0])),
        "end": repr(float(source.span[1])),
        "rtol": repr(source.tolerances[0]),
        "given": given,
        "computed": outputs,
        "places": [len(given) + 1 + number for number in range(len(outputs))],
    }
    return render("fmi/model_description.xml.j2", variables)


def _variable(
    name: str, text: str, causality: str, variability: str, initial: str, start: float
) -> dict[str, str | int]:
    return {
        "name": escape(name),
        "text": escape(text),
        "causality": causality,
        "variability": variability,
        "initial": initial,
        "start": repr(float(start)),
    }
