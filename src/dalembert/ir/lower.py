"""[ReducedSystem] -> [Program]: graph nodes become straight-line kernels on named arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

from ..errors import ExpressionError
from ..naming import Namer
from .conditions import CONDITION_TIME, Conditions, decide
from .forms import Forms
from .graph import Graph, Node
from .ops import OPERATIONS
from .passes import eliminate_dead_code, group_products, hoist_parameters, run, share_equal, share_reciprocals
from .program import Assignment, Kernel, Layout, Load, Operand, Program
from .rewriting import rewritten

if TYPE_CHECKING:
    from ..mechanics.equations import EquationsOfMotion
    from ..reduction import ReducedSystem

__all__ = ["decided", "lower", "lower_kernel"]

PASSES = (group_products, share_reciprocals, share_equal, eliminate_dead_code)
ARGUMENTS = ("t", "y", "p")


def lower(system: ReducedSystem) -> Program:
    """Return the program of a reduced system.

    Besides ``prepare(p)`` every kernel takes ``(t, y, c)``. In ``rhs``, ``expand``, ``outputs`` and the
    projections y is the state of the formulation; in the others it is (q, q_dot).
    """
    equations = system.equations
    graph, symbols = equations.graph, equations.symbols
    parameters = {graph.input(name): ("p", i) for i, name in enumerate(symbols.parameters)}
    common: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None), **parameters}
    state = common | {node: ("y", i) for node, i in system.places.items()}
    scene = common | {node: ("y", i) for i, node in enumerate((*equations.q, *equations.qdot))}
    rows = equations.constraints
    residuals = [
        graph.sum(a * b for a, b in zip(row.jacobian, equations.qdot, strict=True)) + row.drift for row in rows
    ]
    definitions = dict(zip(system.inputs, system.initial, strict=True))
    back = {a: b for a, b in definitions.items() if a is not b}
    # Speeds that were tried may cancel in a form only while unit quaternions stand for the coordinates.
    graph.heal(system.accelerations, (*system.inputs, equations.time, *parameters))
    on_state = {
        "expand": (*system.coordinates, *system.rates),
        "outputs": tuple(system.outputs.values()),
    }
    if system.projection is not None:
        on_state |= system.projection.kernels()
    on_scene = {
        "initial": system.initial,
        "mass_matrix": tuple(entry for row in equations.mass_matrix for entry in row),
        "forcing": equations.forcing,
        "accelerations": tuple(graph.substitute(system.accelerations, back)),
        "energy": (equations.kinetic_energy, equations.potential_energy),  # and that of loads, see below
        "constraint_jacobian": tuple(entry for row in rows for entry in row.jacobian),
        "position_residual": tuple(row.position for row in rows if row.position is not None),
        "velocity_residual": tuple(residuals),
    }
    if not system.regular and set(system.outputs) & set(symbols.unknowns):
        on_scene["reaction_matrix"] = tuple(entry for row in equations.reactions for entry in row)
    still = [node for node, rate in zip(system.inputs, system.rhs, strict=True) if rate.is_zero]
    kernels = [lower_kernel(graph, "rhs", system.rhs, state, fixed=(*parameters, *still))]
    kernels += [lower_kernel(graph, name, nodes, state) for name, nodes in on_state.items() if nodes]
    for name, nodes in on_scene.items():
        if name == "energy" and equations.load_energy.potential is not None:
            kernels.append(_energies(equations, scene))
        elif nodes:
            kernels.append(lower_kernel(graph, name, nodes, scene))
    if system.stages is not None:
        whole = common | {node: ("y", i) for i, node in enumerate(system.stages.inputs)}
        kernels.append(lower_kernel(graph, "stages", system.stages.rhs, whole))
        kernels.append(lower_kernel(graph, "multipliers", system.stages.multipliers, state))
    hoisted = hoist_parameters(kernels, symbols.parameters)
    layout = Layout(
        coordinates=symbols.coordinates,
        rates=symbols.rates,
        parameters=symbols.parameters,
        unknowns=symbols.unknowns,
        undetermined=system.undetermined,
        state=system.state,
        outputs=tuple(system.outputs),
        constraints=tuple(row.label for row in rows),
        holonomic=sum(row.position is not None for row in rows),
        constants=len(hoisted.prepare.outputs),
        aliases=dict(symbols.aliases),
        defaults={
            **equations.defaults,
            **system.defaults,
            **({CONDITION_TIME: 0.0} if decide(equations.conditions) else {}),
        },
        entries=tuple(name for entry in symbols.entries for name in entry.names),
        assumptions=dict(symbols.assumptions),
    )
    everything = (hoisted.prepare, *hoisted.kernels)
    note = equations.load_energy.incomplete(equations.name)
    return Program(
        equations.name,
        system.formulation,
        layout,
        everything,
        system.notes,
        equations.sudden,
        note,
        decided(equations),
    )


def _energies(equations: EquationsOfMotion, inputs: Mapping[Node, tuple[str, int | None]]) -> Kernel:
    """Return the kernel of the energies with that of loads, on a graph of its own: no other kernel depends on it."""
    graph = Graph()
    places = {graph.input(str(node.payload)): place for node, place in inputs.items()}
    return lower_kernel(graph, "energy", equations.energies(graph), places)


def decided(equations: EquationsOfMotion) -> Conditions | None:
    """Return the conditions that are decided for segments of runs, None where there are none."""
    if not equations.conditions:
        return None
    graph, parameters = equations.graph, equations.symbols.parameters
    inputs: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None)}
    inputs |= {graph.input(name): ("p", i) for i, name in enumerate(parameters)}
    functions = [condition.function for condition in equations.conditions]
    within = graph.input(CONDITION_TIME).deps

    def lowered(node: Node) -> Kernel:
        return lower_kernel(graph, "condition", [node], inputs, arguments=("t", "p"))

    return Conditions(
        place=parameters.index(CONDITION_TIME) if CONDITION_TIME in parameters else None,
        functions=tuple(map(lowered, functions)),
        kinds=tuple(condition.kind for condition in equations.conditions),
        nested=tuple(bool(node.deps & within) for node in functions),
        sharpness=tuple(None if c.sharpness is None else lowered(c.sharpness) for c in equations.conditions),
    )


def lower_kernel(
    graph: Graph,
    name: str,
    nodes: Sequence[Node],
    inputs: Mapping[Node, tuple[str, int | None]],
    arguments: tuple[str, ...] = ARGUMENTS,
    *,
    fixed: Sequence[Node] | None = None,
) -> Kernel:
    """Return the kernel that computes `nodes` from `inputs` (node -> array and index), after all passes.

    With `fixed`, the inputs that stay the same along a motion, it has few products of the others.

    Raises
    ------
    ExpressionError
        When a node depends on an input that is not given, or a constant is not finite.
    """
    graph.heal(nodes, inputs.keys())
    places = {str(node.payload): place for node, place in inputs.items()}
    forms = Forms(graph)
    if fixed is not None:
        forms, nodes = rewritten(graph, nodes, [str(node.payload) for node in fixed])
    namer = Namer()
    operands: dict[int, Operand] = {}
    loads: list[Load] = []
    body: list[Assignment] = []
    for node in graph.topological(nodes, forms.args):
        op, values = forms.of(node)
        if op == "input":
            if node.payload not in places:
                raise ExpressionError(f"kernel {name!r} depends on {node.payload!r}, which it is not given")
            array, index = places[str(node.payload)]
            target = namer(str(node.payload).removeprefix("speed ").removeprefix("unit "))
            loads.append(Load(target, array, index))
            operands[node.index] = target
        elif node.deps == 0:
            operands[node.index] = _literal(node, [operands[arg.index] for arg in node.args])
        else:
            args = tuple(operands[arg.index] for arg in values)
            target = namer(_wish(op, args))
            body.append(Assignment(target, op, args))
            operands[node.index] = target
    loads.sort(key=lambda load: (load.array, load.index or 0))
    outputs = tuple(operands[node.index] for node in nodes)
    return run(Kernel(name, arguments, tuple(loads), tuple(body), outputs), PASSES)


def _literal(node: Node, args: list[Operand]) -> float:
    """Return the value of a node that depends on no input."""
    if node.op == "const":
        assert isinstance(node.payload, Fraction | float)
        try:
            return float(node.payload)
        except OverflowError:
            raise ExpressionError(
                "a constant is beyond the range of double precision (1.8e308), in which models are computed; choose"
                " units in which the numbers of the scene are smaller"
            ) from None
    value = float(OPERATIONS[node.op].evaluate(*args))
    if not math.isfinite(value):
        raise ExpressionError(f"the constant {node.op}({', '.join(map(str, args))}) is not finite")
    return value


def _wish(op: str, args: tuple[Operand, ...]) -> str:
    """Return a readable name for a value."""
    if len(args) == 1 and isinstance(args[0], str) and op != "neg":
        return f"{op}_{args[0]}"
    return "z"
