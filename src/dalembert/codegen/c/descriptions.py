"""The texts around the code of a simulator in C: header, example, and the page with its names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

from ...frozen import frozen
from ...ir.conditions import CONDITION_TIME
from ...ir.kernel import Kernel
from ...ir.program import Program, hidden_parameters
from ...lanes.sweep_arguments import SweepArguments
from ...reduction.sampling_kernels import SamplingKernels
from ...reduction.starting import Start
from ...stops.instants import InstantTable
from ...transforms.taylor.periodic import angles_of
from ...transforms.taylor.step import order_at
from .contact_loops import ContactLoop
from .library import CFunctions
from .printing import double, identifiers


@final
@frozen
class EventRun:
    """The loop of a run with events.

    Attributes
    ----------
    events : tuple of str
        Their names.
    arguments : SweepArguments
        Of the loop over lanes, for one case, whose record has room for one step.
    functions : CFunctions
        The kernels that stand at its addresses.
    implicit : bool
        Whether its steps are implicit.
    stops : bool
        Whether steps end at stops: inputs change, controllers act, or the run goes on behind its end.
    instants : InstantTable
        Of sampled controllers.
    values : Kernel
        The expressions of the events.
    """

    events: tuple[str, ...]
    arguments: SweepArguments
    functions: CFunctions
    implicit: bool
    stops: bool
    instants: InstantTable
    values: Kernel


@final
@frozen
class CSource:
    """Parts of a simulator in C.

    Attributes
    ----------
    program : Program
    start : Start
        From initial values to the state.
    admission : Kernel or None
        Test of parameters and states.
    dependent : bool
        Whether the last test of `admission` counts constraints that depend on others.
    method : str
        "taylor", "radau", a Runge-Kutta pair, or "rk4".
    tolerances : (float, float)
        Relative and absolute.
    forward_only : bool
        Whether starts depend on the direction of time.
    numbers : mapping of str to float
        Example values of initial values, parameters and inputs, where there are any.
    span : (float, float)
        Start and end of the example [s].
    locks, locking : Kernel or None, tuple of int
        Determinants of angles that may lock, whose signs tell, and those of them at which a run ends.
    contacts : ContactLoop or None
        The loops of a scene whose contacts change. The program is then that of the mode that makes starts consistent,
        and its state is coordinates, rates and first-order states.
    step : float or None
        Size of the steps of "rk4" [s].
    single : bool
        Whether it computes in single precision.
    sampling : SamplingKernels or None
        Sampled controllers.
    events : EventRun or None
        The loop of a run with events.
    continued : bool
        Whether its runs go on behind any end, as those of units do.
    """

    program: Program
    start: Start
    admission: Kernel | None
    dependent: bool
    method: str
    tolerances: tuple[float, float]
    forward_only: bool
    numbers: Mapping[str, float]
    span: tuple[float, float]
    locks: Kernel | None = None
    locking: tuple[int, ...] = ()
    contacts: ContactLoop | None = None
    step: float | None = None
    single: bool = False
    sampling: SamplingKernels | None = None
    events: EventRun | None = None
    continued: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that a user gives."""
        layout = self.program.layout
        hidden = {CONDITION_TIME, *(name for u in layout.inputs for name in hidden_parameters(u))}
        known = layout.parameters if self.contacts is None else self.contacts.parameters
        return tuple(name for name in known if name not in hidden)

    @property
    def angles(self) -> tuple[str, ...]:
        """Components of the state that matter modulo a turn."""
        if self.contacts is not None:
            return self.contacts.angles
        return tuple(self.program.layout.state[i] for i in angles_of(self.program))

    @property
    def watched(self) -> tuple[str, ...]:
        """Names of the events."""
        if self.contacts is not None:
            return self.contacts.events
        return () if self.events is None else self.events.events

    @property
    def goes_on(self) -> bool:
        """Whether a run can continue behind its end."""
        if self.contacts is None and (self.events is None or self.continued):
            return True
        return bool(self.program.layout.inputs)

    @property
    def begun(self) -> int:
        """Number of components of the state that starts make."""
        if self.contacts is None:
            return len(self.program.layout.state)
        return len(self.program.kernel("initial").outputs)

    @property
    def defaults(self) -> dict[str, float]:
        """Values of parameters that contacts add, which no user gives."""
        layout = self.program.layout
        if self.contacts is None:
            return {}
        return {name: layout.defaults[name] for name in layout.parameters if name not in self.contacts.parameters}

    @property
    def order(self) -> int:
        """Order of Taylor steps."""
        return order_at(*self.tolerances)


def step_of(source: CSource) -> str:
    """Return the literal of the size of a step, empty where steps are chosen."""
    return "" if source.step is None else double(source.step)


def names_and_numbers(source: CSource, prefix: str) -> dict[str, Any]:
    """Return what the header and the functions have in common."""
    layout = source.program.layout
    return {
        "prefix": prefix,
        "upper": prefix.upper(),
        "n_states": len(layout.state),
        "n_coordinates": len(layout.coordinates),
        "n_initial": len(source.start.given),
        "n_parameters": len(source.parameters),
        "n_inputs": len(layout.inputs),
        "n_outputs": len(layout.outputs),
    }


def enumerations(source: CSource) -> list[dict[str, Any]]:
    """Return the enumerations of the header."""
    layout = source.program.layout
    groups = [
        ("Components of the state", "state", layout.state),
        ("Coordinates, which their rates follow in the same order", "coordinate", layout.coordinates),
        ("Initial values of a start", "initial", source.start.given),
        ("Parameters", "parameter", source.parameters),
        ("Inputs", "input", layout.inputs),
        ("Outputs", "output", layout.outputs),
        ("Contacts", "contact", _contacts(source)),
        ("Events", "event", source.watched),
    ]
    return [{"title": title, "kind": kind, "entries": _entries(names)} for title, kind, names in groups]


def main_variables(source: CSource, prefix: str) -> dict[str, Any]:
    """Return the variables of ``c/main.c.j2``."""
    layout, numbers = source.program.layout, source.numbers
    wanted = [*source.start.given, *source.parameters, *layout.inputs]
    first = len(source.start.given) + len(source.parameters)
    real = "float" if source.single else "double"
    columns = ["t", *layout.coordinates, *layout.rates, *layout.states]
    printed = [(place, name) for place, name in enumerate(layout.outputs) if name not in columns]  # a law's are states
    columns += [name for _, name in printed]
    return {
        "prefix": prefix,
        "upper": prefix.upper(),
        "wanted": plain(", ".join(wanted)),
        "arguments": [quoted(name) for name in wanted],
        "values": [f"({real}){double(numbers.get(name, 0.0))}" for name in wanted],
        "real": real,
        "digits": 9 if source.single else 17,
        "complete": int(all(name in numbers for name in wanted)),
        "columns": quoted(",".join(columns)),
        "input_values": [first + number for number in range(len(layout.inputs))],
        "n_variables": len(source.program.kernel("expand").outputs),
        "n_states": len(layout.state),
        "n_outputs": len(layout.outputs),
        "printed_outputs": [place for place, _ in printed],
        "step": step_of(source),
        "begin": double(source.span[0]),
        "end": double(source.span[1]),
    }


def readme_variables(source: CSource, prefix: str) -> dict[str, Any]:
    """Return the variables of ``c/README.md.j2``."""
    layout, numbers = source.program.layout, source.numbers

    def rows(names: tuple[str, ...], *, given: bool) -> list[dict[str, str]]:
        values = [repr(float(numbers[name])) if given and name in numbers else "" for name in names]
        kinds = [", ".join(layout.assumptions.get(name, ())) if given else "" for name in names]
        named = [f"{name} ({kind})" if kind else name for name, kind in zip(names, kinds, strict=True)]
        return [{"name": plain(name), "value": value} for name, value in zip(named, values, strict=True)]

    groups = [
        ("Initial values", source.start.given, True),
        ("Parameters", source.parameters, True),
        ("Inputs", layout.inputs, True),
        ("Outputs", layout.outputs, False),
        ("State", layout.state, False),
        ("Coordinates", layout.coordinates, False),
        ("Contacts", _contacts(source), False),
        ("Events", source.watched, False),
    ]
    return {
        "prefix": prefix,
        "upper": prefix.upper(),
        "scene": plain(source.program.name),
        "formulation": source.program.formulation,
        "method": _steps(source),
        "rtol": repr(source.tolerances[0]),
        "atol": repr(source.tolerances[1]),
        "groups": [
            {"title": title, "column": "example" if given else "", "rows": rows(names, given=given)}
            for title, names, given in groups
        ],
        "constraints": [plain(label) for label in layout.constraints],
        "locks": bool(source.locking),
        "contacts": source.contacts is not None,
        "events": bool(source.watched),
        "controllers": plain(", ".join(action.name for action in source.sampling.actions)) if source.sampling else "",
        "goes_on": source.goes_on,
        "step": step_of(source),
        "single": source.single,
    }


def _steps(source: CSource) -> str:
    """Return what steps a simulator takes."""
    methods = [source.method] if source.contacts is None else [mode.method for mode in source.contacts.modes]
    named = {"taylor": f"Taylor steps of order {source.order}", "rk4": "Runge-Kutta steps of order 4"}
    return " and ".join(named.get(method, f"steps of the method {method}") for method in dict.fromkeys(methods))


def _contacts(source: CSource) -> tuple[str, ...]:
    return () if source.contacts is None else tuple(name for name, _ in source.contacts.contacts)


def _entries(names: tuple[str, ...]) -> list[dict[str, str]]:
    pairs = zip(identifiers(names), names, strict=True)
    return [{"identifier": identifier, "name": plain(name)} for identifier, name in pairs]


def plain(text: str) -> str:
    """Return text for a comment: one line of ASCII that does not end it."""
    return text.replace("*/", "* /").replace("/*", "/ *").encode("ascii", "replace").decode().replace("\n", " ")


def quoted(text: str) -> str:
    """Return text for a literal in C."""
    printable = text.encode("ascii", "replace").decode().replace("\n", " ")
    return printable.replace("\\", "\\\\").replace('"', '\\"').replace("??", "?")
