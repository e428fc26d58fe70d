"""The files of a simulator in C99: [Program, ...] -> texts, through the templates of ``codegen_templates/c``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from ...ir.kernel import Kernel
from ...loops.steps_at_instants import decided, find
from ...methods.step_constants import RESOLUTION
from ...reduction.sampling_kernels import SamplingAction
from ...stops.break_tables import break_kernels
from ...transforms.passes import EliminateDeadCode
from ...transforms.taylor.periodic import angles_of
from ...transforms.taylor.recurrences import recurrences
from ...transforms.taylor.step import STEP_ARGUMENTS, step_kernel
from ..library import derivative_of
from ..rendering import banner_lines, render
from .descriptions import CSource, plain
from .kernels import kernel_variables, source_of
from .library import LARGEST_STRAIGHT
from .order_loops import order_loop_variables
from .printing import double
from .run_loops import RunLoop, explicit_loop_of, implicit_loop_of, taylor_loop_of
from .run_stops import LAW, PREPARE, SCHEDULE, RunStops
from .source import LoopSource
from .template_variables import TemplateVariables
from .workspace import workspace_of

_PUBLIC = (
    *("run", "start", "step", "at", "continue", "set_input", "simulate", "time", "expand", "outputs", "energy"),
    *("check_text", "status_text", "contact", "event"),
)
"""Ends of the names of public functions."""


class Simulator(TemplateVariables):
    """A simulator in C99 of a scene without contacts that change.

    Attributes
    ----------
    files : dict of str to str
        The texts of its files, by their names.
    """

    template: ClassVar[str] = "c/functions.c.j2"
    """Template of the public functions."""

    def __init__(self, source: CSource) -> None:
        super().__init__(source)
        self.kernels: list[dict[str, Any]] = []
        self.order_loops: list[str] = []
        self.source_code = ""
        variables, prefix = self._variables(), self.prefix
        self.files = {
            f"{prefix}.h": render("c/header.h.j2", variables["header"]),
            f"{prefix}.c": self.source_code
            + render("c/starts.c.j2", variables["starts"])
            + (render("c/locks.c.j2", variables["locks"]) if "locks" in variables else "")
            + render(self.template, variables["functions"])
            + (render("c/changing_steps.c.j2", variables["steps"]) if "steps" in variables else "")
            + (render("c/state_functions.c.j2", variables["state"]) if "state" in variables else "")
            + self._further_functions(variables)
            + render("c/texts.c.j2", variables["texts"]),
            "main.c": render("c/main.c.j2", variables["main"]),
            "Makefile": render("c/Makefile.j2", {"prefix": prefix}),
            "README.md": render("c/README.md.j2", variables["readme"])
            + (render("c/operations.md.j2", variables["operations"]) if "operations" in variables else ""),
        }

    def _further_functions(self, variables: Mapping[str, Any]) -> str:
        """Return the text of public functions besides those of every simulator."""
        return ""

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

    def _taylor_step(self) -> None:
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
        acts = [action.places for action in self.actions]
        at = RunStops(acts, self.program.conditions, len(self.layout.parameters))
        constants = {PREPARE: self._name("constants")}
        corrected = "Correction of the state onto the {} constraints"
        has = {
            kind: self._program_kernel(kind, f"project_{kind}", corrected.format(kind))
            for kind in ("position", "velocity")
        }
        has |= self._law_kernels() | self._condition_kernels()
        if source.method == "taylor":
            self._taylor_step()
            has |= {"step": True}
            names = {kind: self._name(kind) for kind in has} | {"step": self._name("series")} | constants
            return taylor_loop_of(sizes, source.order, source.tolerances, angles_of(self.program), has, at), names
        has["rhs"] = self._program_kernel("rates", "rhs", "Rate of the state")
        has["knots"] = self._program_kernel("knots", "knots", "Largest steps, forward and backward, at knots of tables")
        if source.method == "radau":
            made, derivative = derivative_of(self.program.kernel("rhs"))
            self._print(made, derivative, "Derivatives of the rates by the state")
            has[made] = True
        names = {kind: self._name(kind) for kind in has} | {"rhs": self._name("rates")} | constants
        if source.method == "radau":
            return implicit_loop_of(sizes, source.tolerances, has, at), names
        return explicit_loop_of(source.method, sizes, source.tolerances, has, at), names

    @property
    def actions(self) -> tuple[SamplingAction, ...]:
        """What the sampled controllers do at their instants."""
        return () if self.source.sampling is None else self.source.sampling.actions

    def _law_kernels(self) -> dict[str, bool]:
        """Print the kernels of sampled controllers; return their keys."""
        if self.source.sampling is None:
            return {}
        times = replace(self.source.sampling.times, arguments=STEP_ARGUMENTS)
        self._print(SCHEDULE, times, "Periods of controllers, then their offsets")
        for number, action in enumerate(self.actions):
            assert action.kernel is not None
            law = replace(action.kernel, arguments=STEP_ARGUMENTS)
            self._print(LAW.format(number), law, f"What the controller {action.name!r} sets")
        return dict.fromkeys((SCHEDULE, *(LAW.format(number) for number in range(len(self.actions)))), True)

    def _condition_kernels(self) -> dict[str, bool]:
        """Print the kernels of conditions on time; return their keys."""
        conditions = self.program.conditions
        if conditions is None:
            return {}
        kernels = break_kernels(conditions)
        for name, (kernel, meaning) in kernels.items():
            self._print(name, kernel, meaning, exact=True)
        return dict.fromkeys((PREPARE, *kernels), True)

    def _start_kernels(self) -> None:
        """Print the kernels of starts, and of what follows from coordinates and rates."""
        source = self.source
        self._program_kernel("constants", "prepare", "Constants c from parameters p", exact=True)
        start = replace(source.start.kernel, arguments=STEP_ARGUMENTS)
        self._print("initial", start, "State, and what a start contradicts, from initial values", exact=True)
        if source.admission is not None:
            admission = replace(source.admission, arguments=STEP_ARGUMENTS)
            self._print("admission", admission, "Tests of parameters and states")
        self._program_kernel("expanded", "expand", "q and q_dot from the state")
        self._program_kernel("energies", "energy", "Kinetic and potential energy at y = (q, q_dot)")

    def _state_kernels(self) -> None:
        """Print the kernels of what follows from the state alone."""
        locks = self._locks()
        if locks is not None:
            self._print("locks", locks, "Determinants of angles, which vanish where they lock")
        if self.layout.outputs:
            self._program_kernel("output", "outputs", "Outputs from the state")

    def _locks(self) -> Kernel | None:
        """Return the kernel of the determinants of angles at whose change of sign a run ends, None without any."""
        source = self.source
        if source.locks is None or not source.locking:
            return None
        outputs = tuple(source.locks.outputs[group] for group in source.locking)
        return EliminateDeadCode()(replace(source.locks, arguments=STEP_ARGUMENTS, outputs=outputs))

    def _further_calls(self, loop: Any, kind: type[tuple[Any, ...]], code: LoopSource) -> dict[str, Any]:
        """Translate functions of the loop that further public functions call; return the calls.

        ``loop`` has those of `dalembert.codegen.c.run_loops.RunLoop`.
        """
        return {}

    # -- variables --------------------------------------------------------------------------

    def _variables(self) -> dict[str, dict[str, Any]]:
        """Return the variables of each template."""
        source = self.source
        self._start_kernels()
        self._state_kernels()
        loop, names = self._loop()
        self.at |= loop.at
        space = workspace_of(
            loop.arguments,
            loop.given,
            loop.constant,
            {number: names[key] for number, key in enumerate(loop.kernels, 1)},
        )
        code = LoopSource(space, self.prefix, "fused", self._taken())
        kind = type(loop.arguments)
        calls = {"take_step": code.entry(loop.step, kind), "sample": code.entry(loop.sample, kind, "t")}
        further = self._further_calls(loop, kind, code)
        renew = [] if loop.renew is None or not self.layout.inputs else [code.entry(loop.renew, kind)]
        stops = bool(self.actions) or self.program.conditions is not None
        extend = [code.entry(loop.extend, kind, "t1")] if stops else []
        resume = self._breaks(loop, kind, code)
        begins = code.entry(loop.instants, kind, "t0") if self.actions else ""
        settle = code.entry(loop.settle, kind) if self.actions else ""
        printed = render("c/kernels.c.j2", {"kernels": self.kernels}) + "".join(self.order_loops)
        self._finish(printed, code)
        n_locks = len(source.locking)
        needed = {*loop.at.values(), "sampled", "place"}
        members = space.members_used(code.text, needed)
        functions = {
            **self._function_variables(),
            **calls,
            "at": {name: self.at[name] for name in self.at if name != "evaluated"},
            "forward_only": source.forward_only,
            "after_step": _elements(loop.after_step),
            "continuing": _elements(loop.continuing),
            "n_locks": n_locks,
            "begins": begins,
            "extend": extend,
            "resume": resume,
            "settle": [(settle, double(RESOLUTION))] if self.actions else [],
        }
        return {
            "header": self._header_variables(members) | {"n_locks": n_locks},
            "functions": functions,
            "calls": further,
            **self._state_variables(renew),
            **self._further_variables(space.beginning_used(code.text, needed), "advance"),
        }

    def _breaks(self, loop: Any, kind: type[tuple[Any, ...]], code: LoopSource) -> str:
        """Translate the search for breaks; return its call where a run continues, empty without conditions.

        ``loop`` has the functions of `dalembert.codegen.c.run_loops.RunLoop`.
        """
        conditions = self.program.conditions
        if conditions is None:
            return ""
        self.at_start = {"find": code.entry(find, kind, "t0", "t1"), "decided": []}
        if conditions.place is not None:
            self.at_start["decided"] = [(conditions.place, code.entry(decided, kind))]
            self.before = "instants.breaks.before"
        return code.entry(loop.resume, kind, "t1") if self.source.goes_on else ""

    def _taken(self) -> frozenset[str]:
        """Return the names of functions that are not those of loops."""
        kernels = {kernel["name"] for kernel in self.kernels}
        return frozenset(kernels | {self._name(what) for what in ("series", *_PUBLIC)})

    def _finish(self, printed: str, code: LoopSource | None = None) -> None:
        """Write the source without its public functions: printed kernels and translated loops."""
        banner = [plain(line) for line in banner_lines(self.program)]
        loops: tuple[Any, ...] = () if code is None else (code.text, code.used, self._name("run"))
        self.source_code = source_of(banner, [f"{self.prefix}.h"], printed, *loops)


def _elements(pairs: Sequence[tuple[str, str]]) -> list[dict[str, str]]:
    return [{"member": member, "value": value} for member, value in pairs]
