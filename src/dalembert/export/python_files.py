"""Parts that files of Python for numba and for JAX share: symbol tables, default values, sizes and statuses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..codegen.c.descriptions import CSource, plain, readme_variables
from ..codegen.c.template_variables import STATUS_TEXTS, STATUSES
from ..methods.status import Status
from ..version import __version__


def statuses(given: Iterable[Status]) -> dict[str, int]:
    """Return the numbers of statuses by their names."""
    return {status.name: int(status) for status in given}


def start_numbers(source: CSource) -> dict[str, Any]:
    """Return the sizes and places of what starts are given and test, and numbers of statuses."""
    layout, tests = source.program.layout, 0 if source.admission is None else len(source.admission.outputs)
    return {
        "n_admission": tests,
        "dependent_tests": [(tests - 2, tests - 1)] if tests and source.dependent else [],
        "n_states": len(layout.state),
        "n_outputs": len(layout.outputs),
        "n_parameters": max(len(layout.parameters), 1),
        "forward_only": source.forward_only,
    }


def parameter_places(source: CSource) -> list[int]:
    """Return the places of the parameters that a user gives among all of the program."""
    return [source.program.layout.parameters.index(name) for name in source.parameters]


def settings(source: CSource) -> dict[str, Any]:
    """Return what a simulator takes and returns by default, as Python prints it."""
    layout, numbers = source.program.layout, source.numbers

    def known(names: tuple[str, ...], otherwise: float | None = None) -> str:
        return ascii({name: float(numbers[name]) if name in numbers else otherwise for name in names})

    return {
        "initial": known(source.start.given),
        "parameters": known(source.parameters),
        "inputs": known(layout.inputs, 0.0),
        "names": ascii(_results(source)),
        "statuses": ascii({int(status): STATUS_TEXTS.get(status, status.message) for status in STATUSES}),
    }


def _results(source: CSource) -> list[str]:
    """Return the names of results, in the order of their rows."""
    layout = source.program.layout
    return [*layout.coordinates, *layout.rates, *layout.states, *layout.outputs, "kinetic", "potential"]


def descriptions(source: CSource) -> dict[str, Any]:
    """Return the symbol table of a simulator, and what stands at its head besides."""
    read, names = readme_variables(source, ""), _results(source)
    titles = ("Initial values", "Parameters", "Inputs", "State")
    shown = [(group["title"], group["rows"]) for group in read["groups"] if group["title"] in titles]
    shown.append(("Results", [{"name": plain(name), "value": ""} for name in names]))
    return {
        "scene": plain(source.program.name).replace("\\", "/"),
        "first": plain(names[0]),
        "rtol": read["rtol"],
        "atol": read["atol"],
        "formulation": source.program.formulation,
        "groups": [
            {"title": title, "rows": [{"name": row["name"], "value": row["value"]} for row in rows]}
            for title, rows in shown
        ],
        "version": __version__,
    }
