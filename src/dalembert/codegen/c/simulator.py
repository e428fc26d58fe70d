"""The files of a simulator in C99: [Program, ...] -> texts, through the templates of ``codegen_templates/c``."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any, final

from ...ir.kernel import Kernel
from ...ir.program import coefficient_places
from ...methods.status import Status
from ...options import MAX_STEPS
from ...transforms.passes import EliminateDeadCode
from ...transforms.periodic import angles_of
from ...transforms.recurrences import recurrences
from ...transforms.taylor import STEP_ARGUMENTS, step_kernel
from ..library import derivative_of
from ..llvm.vector_functions import shared_constants
from ..rendering import banner_lines, render
from .descriptions import (
    CSource,
    enumerations,
    main_variables,
    names_and_numbers,
    plain,
    quoted,
    readme_variables,
)
from .kernels import kernel_variables, table_variables
from .order_loops import order_loop_variables
from .printing import double, prefix_of
from .run_loops import RunLoop, explicit_loop_of, implicit_loop_of, taylor_loop_of
from .source import LoopSource
from .workspace import workspace_of

LARGEST_STRAIGHT = 1000
"""Lines up to which a Taylor step is written out; loops over the orders are shorter, and faster than longer code."""

_STATUSES = (
    Status.SUCCESS,
    Status.MAX_STEPS,
    Status.STEP_TOO_SMALL,
    Status.NON_FINITE,
    Status.PROJECTION_FAILED,
    Status.INITIAL_STATE,
    Status.SINGULAR_CONFIGURATION,
    Status.SINGULAR_COORDINATES,
    Status.ASSUMPTION,
    Status.TIMES_IN_NO_ORDER,
)
"""Statuses of exported runs."""

_PUBLIC = (
    *("run", "start", "step", "at", "continue", "set_input", "simulate", "time", "expand", "outputs", "energy"),
    *("check_text", "status_text"),
)
"""Ends of the names of public functions."""

_TEXTS = {
    Status.TIMES_IN_NO_ORDER: "The times are not finite, not sorted, or before the last step.",
    Status.INITIAL_STATE: "The initial values contradict a constraint: see the number of the check.",
    Status.ASSUMPTION: "A parameter or an initial value contradicts what its symbol was declared to be.",
    Status.SINGULAR_CONFIGURATION: "Constraints depend on each other at the start, or do not determine the motion.",
}


def c_files(source: CSource) -> dict[str, str]:
    """Return the texts of the files of a simulator, by their names."""
    return Simulator(source).files


@final
class Simulator:
    """A simulator in C99.

    Attributes
    ----------
    files : dict of str to str
        The texts of its files, by their names.
    prefix : str
        Of all public names.
    at : mapping of str to str
        Members of a run, see `dalembert.codegen.c.run_loops.RunLoop`.
    """

    def __init__(self, source: CSource) -> None:
        self.source, self.program, self.layout = source, source.program, source.program.layout
        self.prefix = prefix_of(source.program.name)
        self.kernels: list[dict[str, Any]] = []
        self.order_loops: list[str] = []
        self.source_code, self.at = "", dict[str, str]()
        variables, prefix = self._variables(), self.prefix
        self.files = {
            f"{prefix}.h": render("c/header.h.j2", variables["header"]),
            f"{prefix}.c": self.source_code + render("c/functions.c.j2", variables["functions"]),
            "main.c": render("c/main.c.j2", variables["main"]),
            "Makefile": render("c/Makefile.j2", {"prefix": prefix}),
            "README.md": render("c/README.md.j2", variables["readme"]),
        }

    # -- kernels ----------------------------------------------------------------------------

    def _name(self, what: str) -> str:
        return f"{self.prefix}_{what}"

    def _print(self, what: str, kernel: Kernel, meaning: str, *, exact: bool = False) -> None:
        self.kernels.append(kernel_variables(self._name(what), kernel, meaning, exact=exact))

    def _program_kernel(self, what: str, name: str, meaning: str, *, exact: bool = False) -> bool:
        if name not in self.program:
            return False
        arguments = ("p", "y", "c", "s") if name == "prepare" else STEP_ARGUMENTS
        self._print(what, replace(self.program.kernel(name), arguments=arguments), meaning, exact=exact)
        return True

    def _step(self) -> None:
        """Print the Taylor step."""
        program, order = self.program, self.source.order
        known = recurrences(program.kernel("rhs"), step_growth_limited=program.nonanalytic)
        if known.unrolled_lines(order) <= LARGEST_STRAIGHT:
            self._print("series", step_kernel(known, order, dense=True), f"A Taylor step of order {order}")
            return
        self.order_loops.append(render("c/order_loop.c.j2", order_loop_variables(self._name("series"), known, order)))

    def _loop(self) -> tuple[RunLoop, dict[str, str]]:
        """Print the kernels of the loop; return it, and the names of kernels by their keys."""
        source, sizes = self.source, (len(self.layout.state), len(self.program.kernel("prepare").outputs))
        corrected = "Correction of the state onto the {} constraints"
        has = {
            kind: self._program_kernel(kind, f"project_{kind}", corrected.format(kind))
            for kind in ("position", "velocity")
        }
        if source.method == "taylor":
            self._step()
            has |= {"step": True}
            names = {kind: self._name(kind) for kind in has} | {"step": self._name("series")}
            return taylor_loop_of(sizes, source.order, source.tolerances, angles_of(self.program), has), names
        has["rhs"] = self._program_kernel("rates", "rhs", "Rate of the state")
        has["knots"] = self._program_kernel("knots", "knots", "Largest steps, forward and backward, at knots of tables")
        if source.method == "radau":
            made, derivative = derivative_of(self.program.kernel("rhs"))
            self._print(made, derivative, "Derivatives of the rates by the state")
            has[made] = True
        names = {kind: self._name(kind) for kind in has} | {"rhs": self._name("rates")}
        if source.method == "radau":
            return implicit_loop_of(sizes, source.tolerances, has), names
        return explicit_loop_of(source.method, sizes, source.tolerances, has), names

    def _all_kernels(self) -> None:
        source = self.source
        self._program_kernel("constants", "prepare", "Constants c from parameters p", exact=True)
        start = replace(source.start.kernel, arguments=STEP_ARGUMENTS)
        self._print("initial", start, "State, and what a start contradicts, from initial values", exact=True)
        if source.admission is not None:
            admission = replace(source.admission, arguments=STEP_ARGUMENTS)
            self._print("admission", admission, "Tests of parameters and states")
        if source.locks is not None and source.locking:
            outputs = tuple(source.locks.outputs[group] for group in source.locking)
            locks = EliminateDeadCode()(replace(source.locks, arguments=STEP_ARGUMENTS, outputs=outputs))
            self._print("locks", locks, "Determinants of angles, which vanish where they lock")
        self._program_kernel("expanded", "expand", "q and q_dot from the state")
        if self.layout.outputs:
            self._program_kernel("output", "outputs", "Outputs from the state")
        self._program_kernel("energies", "energy", "Kinetic and potential energy at y = (q, q_dot)")

    # -- variables --------------------------------------------------------------------------

    def _variables(self) -> dict[str, dict[str, Any]]:
        """Return the variables of each template."""
        source = self.source
        self._all_kernels()
        loop, names = self._loop()
        self.at |= loop.at
        space = workspace_of(
            loop.arguments,
            loop.given,
            loop.constant,
            {number: names[key] for number, key in enumerate(loop.kernels, 1)},
        )
        taken = {kernel["name"] for kernel in self.kernels} | {self._name(what) for what in ("series", *_PUBLIC)}
        code = LoopSource(space, self.prefix, "fused", frozenset(taken))
        kind = type(loop.arguments)
        calls = {"take_step": code.entry(loop.step, kind), "sample": code.entry(loop.sample, kind, "t")}
        renew = [] if loop.renew is None or not self.layout.inputs else [code.entry(loop.renew, kind)]
        common = names_and_numbers(source, self.prefix)
        banner = [plain(line) for line in banner_lines(self.program)]
        printed = render("c/kernels.c.j2", {"kernels": self.kernels}) + "".join(self.order_loops)
        self.source_code = source_of(banner, [f"{self.prefix}.h"], printed, code.text, code.used)
        shared = {key: common[key] for key in ("prefix", "upper", "n_states", "n_inputs", "n_outputs")}
        n_locks = len(source.locking) if source.locks is not None else 0
        header = {
            **common,
            "banner": banner,
            "statuses": [{"name": status.name, "number": int(status)} for status in _STATUSES],
            "guard": f"{self.prefix.upper()}_H",
            "enumerations": enumerations(source),
            "members": space.members_used(code.text, {*loop.at.values(), "sampled", "place"}),
            "max_steps": MAX_STEPS,
            "n_further": len(self.layout.states),
            "n_locks": n_locks,
        }
        parameters, admission = self.layout.parameters, source.admission
        functions = {
            **shared,
            "statuses": [
                {"name": status.name, "text": quoted(_TEXTS.get(status, status.message))} for status in _STATUSES
            ],
            **calls,
            "at": self.at,
            "beginning": _elements(space.beginning),
            "after_step": _elements(loop.after_step),
            "continuing": _elements(loop.continuing),
            "renew": renew,
            "parameter_places": [parameters.index(name) for name in source.parameters],
            "input_places": list(coefficient_places(parameters, self.layout.inputs)),
            "n_given": max(len(parameters), 1),
            "n_initial": len(source.start.given),
            "n_started": max(len(source.start.kernel.outputs), 1),
            "n_checks": len(source.start.labels),
            "checks": [quoted(f"{kind}: {label}") for kind, label in source.start.labels],
            "n_tests": 0 if admission is None else len(admission.outputs),
            "dependent_tests": self._dependent_tests(),
            "n_constants": len(self.program.kernel("prepare").outputs),
            "n_variables": len(self.program.kernel("expand").outputs),
            "forward_only": source.forward_only,
            "max_steps": MAX_STEPS,
            "n_locks": n_locks,
        }
        files = {"main": main_variables(source, self.prefix), "readme": readme_variables(source, self.prefix)}
        return {"header": header, "functions": functions, **files}

    def _dependent_tests(self) -> list[tuple[int, int]]:
        """Return the places of the number of constraints that depend on others and of its limit, where it is tested."""
        if self.source.admission is None or not self.source.dependent:
            return []
        count = len(self.source.admission.outputs)
        return [(count - 2, count - 1)]


def _elements(pairs: Sequence[tuple[str, str]]) -> list[dict[str, str]]:
    return [{"member": member, "value": value} for member, value in pairs]


def _numbers(value: Any) -> Any:
    """Return numbers as literals, in tuples and mappings."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    return [_numbers(item) for item in value] if isinstance(value, tuple) else double(value)


def source_of(
    banner: Sequence[str], headers: Sequence[str], printed: str, loops: str = "", used: Collection[str] = ()
) -> str:
    """Return a source without its public functions: what is called, tables, printed kernels, and loops.

    `used` are the functions of the prelude that the loops call.
    """
    tables = table_variables(printed)
    prelude = {
        "banner": list(banner),
        "headers": list(headers),
        "used": _used(printed + loops, used),
        "constants": {key: _numbers(value) for key, value in shared_constants().items()},
    }
    text = render("c/prelude.c.j2", prelude)
    return text + (render("c/tables.c.j2", {"tables": tables}) if tables else "") + printed + loops


_PRELUDE = re.compile(r"\b(fused|angle_of|rough_log2|rough_exp2)\b")


def _used(text: str, loops: Collection[str]) -> list[str]:
    """Return the functions of the prelude that a text calls."""
    used = {*loops, *_PRELUDE.findall(text)}
    if used & {"angle_of", "rough_log2", "rough_exp2"}:
        used.add("fused")
    return sorted(used)
