"""One file of Python that simulates a scene with JAX alone."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

from ..codegen.c.descriptions import CSource
from ..codegen.printers import JAX
from ..codegen.rendering import render
from ..errors import OptionError
from ..ir.kernel import Kernel, describe_counts
from ..ir.program import coefficient_places
from ..methods.names import CORRECTIONS, PAIRS
from ..methods.status import Status
from ..methods.step_constants import (
    LARGEST_GROWTH,
    LARGEST_REDUCTION,
    SAFETY,
    SMALLEST_OF_TIME,
)
from ..options import MAX_STEPS
from .kinds import LOCKS, refuse_feature
from .python_files import descriptions, parameter_places, settings, start_numbers, statuses

_TESTED = (
    Status.INITIAL_STATE,
    Status.ASSUMPTION,
    Status.MAX_STEPS,
    Status.NON_FINITE,
    Status.SINGULAR_CONFIGURATION,
    Status.STEP_TOO_SMALL,
    Status.TIMES_IN_NO_ORDER,
)
"""Statuses that the file gives."""


def jax_text(source: CSource) -> str:
    """Return the text of a simulator for JAX.

    Raises
    ------
    CapabilityError
        For angles that may lock.
    OptionError
        For another method than "dop853".
    """
    if source.method != "dop853":
        raise OptionError(f'files for JAX take steps of "dop853", not of {source.method!r}: give method="dop853"')
    if source.locking:
        refuse_feature(LOCKS, "jax", [source.program.name])
    tableau = PAIRS["dop853"].tableau
    count = tableau.end + 1
    kernels = [_variables(name, kernel) for name, kernel in _kernels(source)]
    called = set(re.findall(r"fn\.(\w+)\(", "\n".join(line for kernel in kernels for line in kernel["lines"])))
    for kernel in kernels:
        kernel["lines"] = [re.sub(r"\bfn\.", "safe_", line) for line in kernel["lines"]]
    tolerances = {"rtol": repr(source.tolerances[0]), "atol": repr(source.tolerances[1])}
    runs = {
        **tolerances,
        **start_numbers(source),
        "parameter_places": parameter_places(source),
        "status": statuses(_TESTED),
        "kernels": kernels,
        "nodes": repr(tableau.c[:count].tolist()),
        "matrix": repr(tableau.A[:count, :count].tolist()),
        "errors": repr(tableau.error[:, :count].tolist()),
        "exponent": repr(1.0 / (tableau.error_order + 1)),
        "safety": repr(SAFETY),
        "least": repr(LARGEST_REDUCTION),
        "most": repr(LARGEST_GROWTH),
        "smallest": repr(SMALLEST_OF_TIME),
        "max_steps": MAX_STEPS,
        "corrections": [(name, tries) for name, tries in CORRECTIONS.items() if name in source.program],
        "input_places": list(coefficient_places(source.program.layout.parameters, source.program.layout.inputs)),
    }
    parts = [
        render("jax/simulator_head.py.j2", descriptions(source) | settings(source)),
        *(["# Functions whose derivatives are finite.", *_functions(called)] if called else []),
        render("jax/simulator.py.j2", runs),
    ]
    return "\n\n\n".join(part.strip() for part in parts) + "\n"


def _kernels(source: CSource) -> list[tuple[str, Kernel]]:
    program = source.program
    found = [("constants", program.kernel("prepare")), ("initial_state", source.start.kernel)]
    if source.admission is not None:
        found.append(("admission", source.admission))
    named = {"rates": "rhs", "expanded": "expand", "energies": "energy"}
    named |= {name: name for name in ("project_position", "project_velocity") if name in program}
    named |= {"outputs": "outputs"} if program.layout.outputs else {}
    return found + [(name, program.kernel(key)) for name, key in named.items()]


def _variables(name: str, kernel: Kernel) -> dict[str, Any]:
    arguments = ("p",) if name == "constants" else ("t", "y", "c")
    return {
        "name": name,
        "arguments": ", ".join(arguments),
        "doc": f"{len(kernel.outputs)} values, {describe_counts(kernel)}.",
        "lines": JAX.lines(kernel),
        "outputs": JAX.outputs(kernel),
    }


def _functions(called: set[str]) -> list[str]:
    """Return the source of functions of `dalembert.jax.functions` that kernels call, with names that no value has."""
    text = (Path(__file__).parents[1] / "jax" / "functions.py").read_text(encoding="utf-8")
    found = list[str]()
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef) and node.name in called:
            for argument in node.args.args:
                argument.annotation = None
            if node.args.vararg is not None:
                node.args.vararg.annotation = None
            node.returns, node.name = None, f"safe_{node.name}"
            for inner in ast.walk(node):
                if isinstance(inner, ast.FunctionDef) and inner is not node:
                    inner.returns = None
                    for argument in inner.args.args:
                        argument.annotation = None
            found.append(ast.unparse(node))
    return found
