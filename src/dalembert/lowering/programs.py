"""Lowering: [ReducedSystem] -> [Program] of straight-line kernels on named arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..ir.program import Layout, Program
from ..reduction.base import condition_kernels
from ..reduction.knot_starts import knot_sides
from ..reduction.reactions import shared_reactions
from ..reduction.saddle import velocity_residuals
from ..transforms.conditions import decide
from ..transforms.lower_kernels import lower_kernel
from ..transforms.passes import EliminateDeadCode
from ..transforms.pipelines import PROGRAM_PASSES, PassRecord
from ..transforms.step_limits import step_limits

if TYPE_CHECKING:
    from ..mechanics.equations import EquationsOfMotion
    from ..reduction import ReducedSystem


def lower(system: ReducedSystem, records: list[PassRecord] | None = None) -> Program:
    """Return the program of a reduced system.

    Besides ``prepare(p)`` every kernel takes ``(t, y, c)``. In ``rhs``, ``expand``, ``outputs`` and the
    projections y is the state of the formulation; in the others it is (q, q_dot, first-order states).

    Parameters
    ----------
    system : ReducedSystem
        In any formulation.
    records : list of PassRecord, optional
        Gets a record of each pass on each kernel.
    """
    equations = system.equations
    graph = equations.graph
    parameters = {graph.input(name): ("p", i) for i, name in enumerate(equations.symbols.parameters)}
    common: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None), **parameters}
    state = common | {node: ("y", i) for node, i in system.places.items()}
    scene = common | {node: ("y", i) for i, node in enumerate(equations.variables)}
    residuals = velocity_residuals(equations)
    # Speeds that were tried may cancel in a form only while unit quaternions stand for the coordinates.
    graph.heal(system.accelerations, (*system.inputs, equations.time, *parameters))
    on_state, on_scene = _values_on_state(system), _values_on_scene(system, residuals)
    still = [node for node, rate in zip(system.inputs, system.rhs, strict=True) if rate.is_zero]
    kernels = [lower_kernel(graph, "rhs", system.rhs, state, fixed=(*parameters, *still), records=records)]
    moved = dict(zip((*equations.q, *equations.qdot), (*system.coordinates, *system.rates), strict=True))
    aside = graph.substitute(equations.behind_guards, {a: b for a, b in moved.items() if a is not b})
    limits = step_limits(graph, system.rhs, system.inputs, equations.time, equations.symbols.parameters, aside)
    if limits is not None:
        on_state["knots"] = limits
    kernels += knot_sides(system, state, records)
    kernels += [lower_kernel(graph, name, nodes, state, records=records) for name, nodes in on_state.items() if nodes]
    for name, nodes in on_scene.items():
        if name == "energy" and equations.load_energy.potential is not None:
            kernels.append(_energies(equations, scene, records))
        elif name == "accelerations" and _ends_in(system, nodes) and state == scene:
            kernels.append(_without_coordinates(kernels[0], name, len(nodes)))
        elif nodes or name == "initial":  # a mode may prescribe the whole motion
            kernels.append(lower_kernel(graph, name, nodes, scene, records=records))
    shared = shared_reactions(system)
    if shared is not None:
        first = len(system.places)
        wide = state | {node: ("y", first + i) for i, node in enumerate(equations.unknowns)}
        kernels.append(lower_kernel(graph, "shared_loads", shared[0], state, records=records))
        kernels.append(lower_kernel(graph, "outputs_of_reactions", shared[1], wide, records=records))
    if system.stages is not None:
        whole = common | {node: ("y", i) for i, node in enumerate(system.stages.inputs)}
        kernels.append(lower_kernel(graph, "stages", system.stages.rhs, whole, records=records))
        kernels.append(lower_kernel(graph, "multipliers", system.stages.multipliers, state, records=records))
    unprepared = Program(
        equations.name,
        system.formulation,
        _layout(system),
        tuple(kernels),
        system.notes,
        equations.nonanalytic,
        equations.load_energy.incomplete(equations.name),
        condition_kernels(equations),
    )
    return PROGRAM_PASSES(unprepared, records)


def _values_on_state(system: ReducedSystem) -> dict[str, Sequence[Node]]:
    """Return the outputs of the kernels of the state of the formulation, by the names of the kernels."""
    values: dict[str, Sequence[Node]] = {
        "expand": (*system.coordinates, *system.rates, *system.equations.states),
        "outputs": tuple(system.outputs.values()),
    }
    return values if system.projection is None else values | system.projection.kernels()


def _values_on_scene(system: ReducedSystem, residuals: Sequence[Node]) -> dict[str, Sequence[Node]]:
    """Return the outputs of the kernels of coordinates, rates and first-order states, by the names of the kernels.

    `residuals` are those of the velocity constraints. The energies are here without the potential energy of loads.
    """
    equations, rows = system.equations, system.equations.constraints
    back = {a: b for a, b in zip(system.inputs, system.initial, strict=True) if a is not b}
    values: dict[str, Sequence[Node]] = {
        "initial": system.initial,
        **_inertia(equations),
        "forcing": equations.forcing,
        "accelerations": tuple(equations.graph.substitute(system.accelerations, back)),
        "energy": (equations.kinetic_energy, equations.potential_energy),
        "constraint_jacobian": tuple(entry for row in rows for entry in row.jacobian),
        "position_residual": tuple(row.position for row in rows if row.position is not None),
        "velocity_residual": tuple(residuals),
    }
    if not system.regular and set(system.outputs) & set(equations.symbols.unknowns):
        zero, own = equations.graph.zero, [name not in system.balanced for name in equations.symbols.unknowns]
        powers = (entry if kept else zero for row in equations.reactions for entry, kept in zip(row, own, strict=True))
        values["reaction_matrix"] = tuple(powers)
    return values


def _inertia(equations: EquationsOfMotion) -> dict[str, Sequence[Node]]:
    """Return the mass matrix or, of many bodies, its product with the rates, of which one column at a time is made."""
    if equations.dense is None:
        return {"momenta": equations.momenta(equations.qdot)}
    return {"mass_matrix": tuple(entry for row in equations.dense for entry in row)}


def _layout(system: ReducedSystem) -> Layout:
    """Return the layout of the program before parameters are hoisted."""
    equations, symbols = system.equations, system.equations.symbols
    condition_time = {CONDITION_TIME: 0.0} if decide(equations.conditions) else {}
    return Layout(
        coordinates=symbols.coordinates,
        rates=symbols.rates,
        parameters=symbols.parameters,
        unknowns=symbols.unknowns,
        undetermined=tuple(n for n in symbols.unknowns if n in (*system.undetermined, *system.balanced)),
        state=system.state,
        outputs=tuple(system.outputs),
        constraints=tuple(row.label for row in equations.constraints),
        holonomic=sum(row.position is not None for row in equations.constraints),
        constants=0,
        aliases=dict(symbols.aliases),
        defaults={**equations.defaults, **system.defaults, **condition_time},
        entries=tuple(name for entry in symbols.entries for name in entry.names),
        assumptions=dict(symbols.assumptions),
        inputs=symbols.input_names,
        states=symbols.states,
        held=symbols.held,
        angles=equations.angles,
    )


def _ends_in(system: ReducedSystem, nodes: Sequence[Node]) -> bool:
    """Return whether the right-hand side of many bodies ends in these values, and so need not be lowered twice."""
    return system.equations.tree is not None and tuple(system.rhs[-len(nodes) :]) == tuple(nodes)


def _without_coordinates(rhs: Kernel, name: str, count: int) -> Kernel:
    """Return the kernel of the last outputs of a right-hand side, where its state is that of the scene."""
    return EliminateDeadCode()(replace(rhs, name=name, outputs=rhs.outputs[-count:]))


def _energies(
    equations: EquationsOfMotion, inputs: Mapping[Node, tuple[str, int | None]], records: list[PassRecord] | None
) -> Kernel:
    """Return the kernel of the energies with that of loads, on a graph of its own: no other kernel depends on it."""
    graph = Graph()
    places = {graph.input(str(node.payload)): place for node, place in inputs.items()}
    return lower_kernel(graph, "energy", equations.energies(graph), places, records=records)
