"""One file of Python that simulates a scene with numba and NumPy alone."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from typing import Any

from ..codegen.c.descriptions import CSource, plain, readme_variables
from ..codegen.c.run_loops import RunLoop, explicit_loop_of, taylor_loop_of
from ..codegen.numba import texts
from ..codegen.numba.specialised_loops import RunMemory, SpecialisedLoops
from ..codegen.rendering import render
from ..errors import CapabilityError, OptionError
from ..ir.kernel import Kernel
from ..ir.program import coefficient_places
from ..methods.status import RUNNING, Status
from ..options import MAX_STEPS
from ..transforms.passes import EliminateDeadCode
from ..transforms.taylor.periodic import angles_of
from ..transforms.taylor.recurrences import recurrences
from ..transforms.taylor.step import STEP_ARGUMENTS
from .python_files import descriptions, parameter_places, settings, start_numbers, statuses

_PUBLIC = frozenset(
    (
        "simulate sweep start advance run_through run_cases new_run record row flat element fma square sqrt exp log"
        " kernel constants initial_state admission locks expanded energies outputs is_finite"
    ).split()
)
"""Names that functions of the integrator do not have."""


_KERNEL = re.compile(r"@numba\.njit\(\*\*ENTRY\)(\ndef (\w+)\()")
"""A function of a kernel as text."""


def numba_text(source: CSource) -> str:
    """Return the text of a simulator for numba.

    Raises
    ------
    CapabilityError
        For Runge-Kutta pairs and tables.
    OptionError
        For the method "radau".
    """
    if source.method == "radau":
        raise OptionError(
            'files for numba take Taylor steps and Runge-Kutta pairs, not "radau": give method="dop853", or take'
            ' kind="c"'
        )
    if source.method != "taylor" and "knots" in source.program:
        raise CapabilityError(
            f"files for numba carry tables with Taylor steps alone, and {source.program.name!r} has some: give"
            ' method="taylor", or take kind="c"'
        )
    kernels, loop, names = _kernels(source)
    loops = SpecialisedLoops(loop, names, _PUBLIC | frozenset(kernels))
    calls = {"take_step": loops.entry(loop.step), "sample": loops.entry(loop.sample)}
    memory = RunMemory(loop.arguments, loops.read | _set_by_runs(loop))
    printed = texts.joined(*kernels.values())
    digest = hashlib.sha256(printed.encode()).hexdigest()[:16]
    steps = readme_variables(source, "")["method"]
    kind, varied = ("parameters", source.parameters) if source.parameters else ("initial", source.start.given)
    tables = texts.table_definitions(printed).strip()
    equations = _KERNEL.sub(lambda found: f"@kernel{found[1]}" if found[2] in kernels else found[0], printed)
    constants = [f"{name} = {value}" for name, value in sorted(loops.constants.items())]
    runs = {
        **settings(source),
        **_numbers(source, loop),
        **calls,
        "checks": ascii([f"{kind}: {label}" for kind, label in source.start.labels]),
        "status": statuses(_TESTED),
        "types": memory.types,
        "resets": memory.resets,
        "memory": memory.value,
    }
    head = {**descriptions(source), "kind": kind, "example": plain(varied[0]), "steps": steps}
    parts = [
        render("numba/simulator_head.py.j2", head),
        texts.prelude(None),
        render("numba/simulator_prelude.py.j2", {"digest": digest}),
        *(["# Tables.", tables] if tables else []),
        "# Equations of the scene.",
        equations,
        "# The integrator: one step, and the state within it.",
        "\n".join(constants),
        *loops.texts,
        render("numba/simulator.py.j2", runs),
    ]
    return "\n\n\n".join(part.strip() for part in parts) + "\n"


def _kernels(source: CSource) -> tuple[dict[str, str], RunLoop, dict[str, str]]:
    """Return the texts of kernels, the loop, and the names of the kernels that it calls by their keys."""
    program, layout = source.program, source.program.layout
    printed: dict[str, str] = {}

    def add(name: str, kernel: Kernel | None) -> bool:
        if kernel is not None:
            printed[name] = texts.kernel(name, kernel)
        return kernel is not None

    def of_program(name: str, key: str) -> bool:
        return add(name, program.kernel(key) if key in program else None)

    printed["constants"] = texts.kernel("constants", program.kernel("prepare"), 1, ("p", *STEP_ARGUMENTS[1:], "out"))
    add("initial_state", source.start.kernel)
    add("admission", source.admission)
    of_program("expanded", "expand")
    of_program("energies", "energy")
    if layout.outputs:
        of_program("outputs", "outputs")
    if source.locks is not None and source.locking:
        outputs = tuple(source.locks.outputs[group] for group in source.locking)
        add("locks", EliminateDeadCode()(replace(source.locks, arguments=STEP_ARGUMENTS, outputs=outputs)))
    has = {kind: of_program(f"project_{kind}", f"project_{kind}") for kind in ("position", "velocity")}
    names = {kind: f"project_{kind}" for kind in has}
    sizes = len(layout.state), len(program.kernel("prepare").outputs)
    if source.method == "taylor":
        known = recurrences(program.kernel("rhs"), step_growth_limited=program.nonanalytic)
        printed["series"] = texts.taylor_step("series", known, source.order, dense=True)
        has["step"], names["step"] = True, "series"
        return printed, taylor_loop_of(sizes, source.order, source.tolerances, angles_of(program), has), names
    has["rhs"], names["rhs"] = of_program("rates", "rhs"), "rates"
    return printed, explicit_loop_of(source.method, sizes, source.tolerances, has), names


_TESTED = (
    Status.INITIAL_STATE,
    Status.ASSUMPTION,
    Status.NON_FINITE,
    Status.SINGULAR_CONFIGURATION,
    Status.SINGULAR_COORDINATES,
    Status.TIMES_IN_NO_ORDER,
)
"""Statuses of starts, times and angles, which the file gives by itself."""


def _places(loop: RunLoop) -> dict[str, str]:
    """Return the members of a run that runs set and read, as Python has them."""
    at = {key: value for key, value in loop.at.items() if key != "now"}
    if at["direction"] == "run.settings[1]":
        at["direction"] = "run.settings[0, 1]"
    return at | {"row": f"{at['time'][:-1]}row"}


def _set_by_runs(loop: RunLoop) -> set[str]:
    """Return the dotted names of what runs set and read besides the functions of the loop."""
    wanted = {re.sub(r"\[.*", "", value) for value in _places(loop).values()}
    return wanted | {"sampled", "place"} | {name for name in loop.given if name != "run.limits.patience"}


def _numbers(source: CSource, loop: RunLoop) -> dict[str, Any]:
    """Return the places and sizes of what runs are given and write."""
    program, layout, at = source.program, source.program.layout, _places(loop)
    inputs, first = coefficient_places(layout.parameters, layout.inputs), len(source.start.given)
    locks = len(source.locking) if source.locks is not None else 0
    variables, starts = len(program.kernel("expand").outputs), start_numbers(source)
    given = {
        "t0": "t0",
        "t1": "t1",
        "time": "t0",
        "largest": "np.inf",
        "attempts": str(MAX_STEPS),
        "direction": "1.0 if t1 >= t0 else -1.0",
    }
    return {
        **starts,
        "at": {name: at[name] for name in ("constants", "row", "state", "time")},
        "settings": [(at[key], value) for key, value in given.items()],
        "after_step": [(name, "1") for name, _ in loop.after_step],
        "running": RUNNING,
        "parameter_pairs": [(place, first + k) for k, place in enumerate(parameter_places(source))],
        "input_pairs": [(place, first + len(source.parameters) + k) for k, place in enumerate(inputs)],
        "first_energy": variables + len(layout.outputs),
        "n_given": len(source.start.given) + len(source.parameters) + len(layout.inputs),
        "n_found": max(len(source.start.kernel.outputs), 1),
        "n_checks": len(source.start.labels),
        "n_tests": max(starts["n_admission"], 1),
        "n_locks": max(locks, 1),
        "n_real_locks": locks,
        "n_variables": variables,
        "n_row": variables + len(layout.outputs) + 2,
    }
