"""The loops of exported runs with contacts: the loop over phases, the decisions, and the loop over lanes of each mode.

They are those of this process, with arguments that were made for one case; `ContactLoop` names what stands for code.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from ...contacts.contact_decisions import DecisionArguments
from ...contacts.contact_steps import (
    ContactPlace,
    ContactSteps,
    begin_motion_instants,
    contact_step,
    correct_phase,
    cut_phase,
    mapped_contact_step,
    run_implicit_phase,
    run_phase,
    sample_end,
    sample_phase,
    select_modes,
)
from ...contacts.phase_loop import PhaseArguments
from ...contacts.phase_maps import EventMaps
from ...frozen import frozen
from ...ir.kernel import Kernel
from ...ir.program import Program
from ...lanes.sweep_arguments import SweepArguments
from ...stops.instants import InstantTable
from ...subset.arguments import AddressTable, OwnedAddress, Vector, kind_of
from ...subset.compiled_subset import INTEGER, NUMBER, Group
from ..subset.target import Value
from .library import CFunctions
from .printing import Known, Loop
from .source import LoopSource
from .workspace import Workspace, workspace_of

CHECK = "inputs_fit"
"""Name in C of the test of what a case is made from."""


@final
@frozen
class ContactMode:
    """A mode as an export runs it.

    Attributes
    ----------
    states : tuple of str
        What each contact does.
    method : str
        "taylor", "radau", or a Runge-Kutta pair.
    arguments : SweepArguments
        Of its loop over lanes, for one case.
    program : Program
    outputs, guards, expansion : Kernel
        Outputs of the scene, the guards of the mode, and coordinates and rates, from its state.
    places : tuple of int
        Where the values of its parameters are: among those of the scene, then those that contacts add.
    """

    states: tuple[str, ...]
    method: str
    arguments: SweepArguments
    program: Program
    outputs: Kernel
    guards: Kernel
    expansion: Kernel
    places: tuple[int, ...]


@final
@frozen
class ContactLoop:
    """Parts of a run with contacts.

    Attributes
    ----------
    phases : PhaseArguments
    decision : DecisionArguments
    modes : tuple of ContactMode
        In the order of the runners of `phases`.
    functions : CFunctions
        The kernels that stand at their addresses.
    variables, parameters, inputs : tuple of str
        Names of coordinates, rates and first-order states, of the parameters of the scene, those that stand for inputs
        among them, and of the inputs.
    angles : tuple of str
        Coordinates that matter modulo a turn.
    contacts : tuple of (str, tuple of str)
        Name of each contact, and what it may do.
    events : tuple of str
        Names of events that users watch.
    maps : EventMaps
        Their maps.
    instants : InstantTable
        Of sampled controllers.
    """

    phases: PhaseArguments
    decision: DecisionArguments
    modes: tuple[ContactMode, ...]
    functions: CFunctions
    variables: tuple[str, ...]
    parameters: tuple[str, ...]
    inputs: tuple[str, ...]
    angles: tuple[str, ...]
    contacts: tuple[tuple[str, tuple[str, ...]], ...]
    events: tuple[str, ...]
    maps: EventMaps
    instants: InstantTable


CONSTANT_OF_LANE = "events.directions events.last events.used events.kinds events.read columns.stride"
"""Arrays among the arguments of a loop over lanes that never change."""

_CONSTANT = {
    "decision.system": "leader constraint sense normal first row width closed sided given jumping tangential slides_by"
    " row_owner owner angle",
    "phases.plan": "columns guards terminal jumps runners.mode runners.size runners.parameters runners.events"
    " runners.first_guard runners.inside",
    "maps": "terminal columns defaults",
    "mode": CONSTANT_OF_LANE,
}
"""Arrays that never change; "mode" is that of each."""

_GIVEN = frozenset({"phases.plan.most_steps"})


@final
class ContactSource:
    """The text of the loops of a run with contacts.

    Attributes
    ----------
    space : Workspace
        The memory of a run.
    code : LoopSource
    take_step : str
        How a step is taken.
    samples : list of str
        How the state at a time ``t`` within a step is computed, for each mode.
    sample_end : str
        How the state is taken where a run is over.
    cuts : list of str
        How the run of a phase is ended where inputs change, for each mode; empty without inputs.
    begins : str
        How controllers begin at a time ``t0``; empty without controllers.
    """

    corrections: Sequence[str] = ()
    """Calls that put coordinates and rates at a time ``t`` onto the constraints, one a mode; units alone have them."""

    def __init__(self, loop: ContactLoop, prefix: str, reserved: Collection[str], *, corrected: bool = False) -> None:
        self.space, places = _memory(loop, prefix)
        self.code = code = LoopSource(self.space, prefix, "fused", frozenset(reserved))
        steps = Value(kind_of(ContactSteps), (), "run", 0)
        runners = [places[f"mode_{i}"] for i in range(len(loop.modes))]
        self._made(code.call(select_modes, [places["decision"]]), _loop_name(prefix, "select_modes", 0))
        for i, (mode, runner) in enumerate(zip(loop.modes, runners, strict=True)):
            function = run_implicit_phase if mode.method == "radau" else run_phase
            made = code.call(function, [steps, runner, Value(INTEGER, (str(i),))])
            self._made(made, _loop_name(prefix, "run_phase", i))
        code.add_tables_of_loops()
        step = mapped_contact_step if loop.maps.jumps.size else contact_step
        self.take_step = code.call(step, [steps])[0]
        time = Value(NUMBER, ("t",))
        self.samples = [code.call(sample_phase, [steps, runner, time])[0] for runner in runners]
        self.sample_end = code.call(sample_end, [steps])[0]
        self.cuts = [code.call(cut_phase, [steps, runner])[0] for runner in runners] if loop.inputs else []
        controlled, start = loop.instants.listed.size > 0, Value(NUMBER, ("t0",))
        self.begins = code.call(begin_motion_instants, [steps, start])[0] if controlled else ""
        if corrected:
            self.corrections = [code.call(correct_phase, [steps, runner, time])[0] for runner in runners]

    @staticmethod
    def _made(call: tuple[str, Any, Any], name: str) -> None:
        assert call[0] == f"{name}(run)", call[0]


def _loop_name(prefix: str, function: str, number: int) -> str:
    return f"{prefix}_{function}{f'_{number + 1}' if number else ''}"


def _memory(loop: ContactLoop, prefix: str) -> tuple[Workspace, dict[str, Value]]:
    """Return the memory of a run, and where in it the arguments of the loops are."""
    codes: dict[int, str] = dict(loop.functions.names)

    def entry(function: str, number: int = 0) -> OwnedAddress:
        address = OwnedAddress(-1 - len(codes), None)
        codes[address] = Loop(_loop_name(prefix, function, number))
        return address

    phases, modes = loop.phases, [mode.arguments for mode in loop.modes]
    codes |= {int(mode.kernels.check): Known(CHECK) for mode in modes}
    entries = AddressTable([entry("run_phase", i) for i in range(len(modes))])
    packed = np.empty((len(modes), 0), np.int64)  # loops in C read the run; packed arguments are addresses in a process
    phases = phases._replace(
        plan=phases.plan._replace(decide=entry("select_modes")),
        space=phases.space._replace(entries=entries, packed_args=packed, decision=packed[:1]),
    )
    sampled = phases.table.cases.x[0].copy()
    own = np.zeros(max(len(mode.program.kernel("initial").outputs) for mode in loop.modes))
    fields: list[tuple[str, Any]] = [("phases", PhaseArguments), ("sampled", Vector), ("place", ContactPlace)]
    fields += [("own", Vector), ("maps", EventMaps), ("instants", InstantTable)]
    fields += [("decision", DecisionArguments), *((f"mode_{i}", SweepArguments) for i in range(len(modes)))]
    kind: Callable[..., Any] = NamedTuple("ContactRun", fields)  # type: ignore[misc]
    arguments: Any = kind(*(phases, sampled, ContactPlace(), own, loop.maps, loop.instants, loop.decision, *modes))
    constant = {
        f"{path}.{name}"
        for part, names in _CONSTANT.items()
        for path in ([part] if part != "mode" else [f"mode_{i}" for i in range(len(modes))])
        for name in names.split()
    }
    return workspace_of(arguments, _GIVEN, frozenset(constant), codes), _places(kind_of(kind))


def _places(kind: Any) -> dict[str, Value]:
    """Return the parts of the arguments of all loops by name."""
    assert isinstance(kind, Group)
    found, first = {}, 0
    for name, part in zip(kind.names, kind.parts, strict=True):
        found[name] = Value(part, (), "run", first)
        first += len(part.words)
    return found
