"""Requested outputs, and the unknown reaction components among them.

Along a motion, reactions . X = M q_ddot - forcing =: r. The components that these equations
determine solve the normal equations of that system; it is consistent whenever the joints of
the scene can exert the reactions of its constraints, which is checked: exactly, or at
random positions that satisfy the constraints, where a pin that closes a loop can only then.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import final

from ..errors import ConstraintError, UnknownNameError, list_names, unknown_name
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import vanishes
from ..mechanics.balance_choice import Released
from ..mechanics.equations import EquationsOfMotion
from ..mechanics.manifold import outside_span_on_manifold
from ..mechanics.released_balances import released_balances, require_balance
from ..naming import acceleration_input, acceleration_name, rate_name
from ..transforms.linear import matvec, transpose
from .base import ReducedSystem
from .reaction_columns import (
    branches,
    compliances_serve,
    independent_columns,
    loose_on_constraints,
    solve_released,
    where_determined,
    with_shared,
)
from .reaction_solutions import least_energy, minimum_norm, reaction_solver
from .unit_sphere import unit_values


@final
@frozen
class Requested:
    """Outputs by name, in terms of t and the state; reactions that no equation determines; what was released.

    `balanced` are the reactions that balances of bodies or compliances give.
    """

    outputs: Mapping[str, Node]
    undetermined: tuple[str, ...]
    released: str = ""
    balanced: tuple[str, ...] = ()


def undetermined_unknowns(equations: EquationsOfMotion) -> tuple[str, ...]:
    """Return the names of the reaction components that no equation determines."""
    if equations.reaction_values:
        return ()
    _, free = independent_columns(equations.reactions)
    return tuple(equations.symbols.unknowns[i] for i in sorted(free))


def _requested_node(
    equations: EquationsOfMotion,
    name: str,
    energies: Mapping[str, Node],
    state_rates: Mapping[str, Node],
    seconds: Mapping[str, str],
) -> Node:
    """Return a requested output in terms of coordinates, rates, states, accelerations and reactions as inputs."""
    graph, symbols = equations.graph, equations.symbols
    if name in equations.outputs:
        return equations.outputs[name]
    if name in (*symbols.unknowns, *symbols.variables):
        return graph.input(name)
    if name in state_rates:
        return state_rates[name]
    if name in energies:
        return energies[name]
    if name in seconds:
        return graph.input(seconds[name])
    known = [*symbols.unknowns, *symbols.variables, *state_rates, *seconds]
    raise UnknownNameError(
        unknown_name("output", name, known) + " A SymPy expression of them serves too, and a Point as it is (not its"
        " name), which gives its position. A reaction is an unknown component of a joint (scene.add_joints)."
    )


def requested_outputs(
    equations: EquationsOfMotion,
    requested: Sequence[str],
    values: Mapping[Node, Node],
    accelerations: Sequence[Node],
    plain: Sequence[Node] | None = None,
    *,
    solve: bool = True,
) -> Requested:
    """Return the requested outputs.

    Parameters
    ----------
    equations : EquationsOfMotion
        The scene's.
    requested : sequence of str
        Names of reactions, coordinates or rates, or the texts of expressions of the scene's symbols.
    values : mapping of Node to Node
        Coordinates and rates in terms of the state.
    accelerations : sequence of Node
        Second rates in terms of the state.
    plain : sequence of Node, optional
        The same without guards, where the constraints may come to depend on each other. Reactions that are not
        determined then are those of minimum norm.
    solve : bool
        Whether reactions are replaced by their values; they stay inputs otherwise.

    Raises
    ------
    UnknownNameError
        For a name that the scene does not have.
    OptionError
        For a name that an acceleration has and something else, too.
    ConstraintError
        For a reaction that the equations do not determine.
    """
    graph, symbols = equations.graph, equations.symbols
    symbols.refuse_ambiguous([name for name in requested if name not in equations.outputs])
    undetermined = undetermined_unknowns(equations)
    energies: dict[str, Node] = {}
    held = _inputs_of(equations.outputs[name] for name in requested if name in equations.outputs)
    if {*requested, *held} & {"energy", "kinetic_energy", "potential_energy"}:
        kinetic, potential = equations.energies(graph)
        energies = {"energy": kinetic + potential, "kinetic_energy": kinetic, "potential_energy": potential}
    state_rates = dict(zip(map(rate_name, symbols.states), equations.state_rates, strict=True))
    seconds = {acceleration_name(name): acceleration_input(name) for name in symbols.coordinates}
    nodes = {name: _requested_node(equations, name, energies, state_rates, seconds) for name in requested}
    if energies and held:
        nodes = dict(zip(nodes, _with_energies(graph, list(nodes.values()), energies), strict=True))
    needed = _needed_unknowns(equations, nodes)
    known = dict(values)
    held = _inputs_of(nodes.values())
    known |= {graph.input(x): a for x, a in zip(seconds.values(), accelerations, strict=True) if x in held}
    if held & set(state_rates):
        rates = graph.substitute(list(state_rates.values()), values)
        known |= dict(zip(map(graph.input, state_rates), rates, strict=True))
    released = Released((), (), "")
    if needed and solve:
        solved, released = _solved(equations, needed, undetermined, (values, accelerations, plain))
        known.update(solved)
    found = graph.substitute(list(nodes.values()), known)
    given = dict(zip(nodes, found, strict=True))
    return Requested(given, undetermined, released.text, released.unknowns)


def _solved(
    equations: EquationsOfMotion,
    needed: Sequence[str],
    undetermined: Sequence[str],
    motion: tuple[Mapping[Node, Node], Sequence[Node], Sequence[Node] | None],
) -> tuple[dict[Node, Node], Released]:
    """Return reactions in terms of the state, and those that balances of bodies or compliances decide.

    Those that the coordinates hide, identically or on the constraints, and all where no joint exerts the reactions of
    some constraint, come from balances of bodies. Those that redundant constraints share are the least ones, or share
    their load by compliances.
    """
    names, graph = equations.symbols.unknowns, equations.graph
    silent = {x for x in names if all(vanishes(row[names.index(x)]) for row in equations.reactions)}
    in_modes = bool(equations.reaction_values or equations.guards)  # contacts judge their reactions themselves
    without, shared = (set(), set()) if in_modes else loose_on_constraints(equations)
    hidden = silent & {*undetermined} if equations.minimum_norm else {*undetermined}
    lost = [x for x in needed if x in hidden | without]
    tied = [] if equations.minimum_norm else [x for x in needed if x in shared and x not in lost]
    solved: dict[Node, Node] = {}
    if len(lost) < len(needed):
        try:
            solved = _solve(equations, *motion, loose=bool(without - silent or shared))
        except ConstraintError:
            lost, tied = list(needed), []
    idle = [x for x in needed if (value := solved.get(graph.input(x))) is not None and value.is_zero]
    if idle and not equations.contacts:
        require_balance(equations, idle)
    sharing: list[str] = []
    try:
        released = released_balances(equations, [*lost, *tied]) if lost or tied else None
    except ConstraintError:
        if not tied or motion[2] is None:
            raise
        sharing = tied if compliances_serve(equations, tied, shared) else []
        released = released_balances(equations, lost) if lost else None
    found = solve_released(equations, released, *motion[:2]) if released is not None else {}
    solved = {x: v for x, v in solved.items() if x not in found} | found
    for x in needed:
        node = graph.input(x)
        column = [row[names.index(x)] for row in equations.reactions]
        own = node not in found and not equations.minimum_norm and not in_modes and branches(column)
        if (x in without or own) and not all(entry.is_zero for entry in column):
            value = where_determined(graph, solved[node], column, hidden=x in without)
            solved[node] = graph.substitute([value], motion[0])[0]
    return solved, with_shared(released or Released((), (), ""), sharing)


def _inputs_of(nodes: Iterable[Node]) -> set[str]:
    """Return the names of the inputs that nodes depend on."""
    return {str(node.payload) for node in Graph.topological(list(nodes)) if node.op == "input"}


def _with_energies(graph: Graph, nodes: Sequence[Node], energies: Mapping[str, Node]) -> list[Node]:
    """Return nodes with energies in place of inputs that are called like them."""
    return graph.substitute(nodes, {graph.input(name): node for name, node in energies.items()})


def _needed_unknowns(equations: EquationsOfMotion, nodes: Mapping[str, Node]) -> list[str]:
    deps = 0
    for node in nodes.values():
        deps |= node.deps
    names = equations.symbols.unknowns
    return [name for name, node in zip(names, equations.unknowns, strict=True) if node.deps & deps]


def _solve(
    equations: EquationsOfMotion,
    values: Mapping[Node, Node],
    accelerations: Sequence[Node],
    plain: Sequence[Node] | None,
    *,
    loose: bool,
) -> dict[Node, Node]:
    """Return the determined reactions in terms of the state; with `loose` some are not, where the constraints hold."""
    graph, given = equations.graph, equations.reaction_values
    if given:
        return dict(zip(map(graph.input, given), graph.substitute(list(given.values()), values), strict=True))
    size = len(equations.q)
    columns = equations.reactions
    if loose:  # constraints may make them dependent in terms of the state
        entries = graph.substitute([entry for row in columns for entry in row], values)
        columns = [entries[i * len(columns[0]) : (i + 1) * len(columns[0])] for i in range(size)]
    independent, _ = independent_columns(columns)
    if equations.minimum_norm:
        independent = list(range(len(equations.unknowns)))
    tree = None if equations.tree is None else equations.tree.substituted(graph, values)
    flat = [entry for row in equations.dense or () for entry in row]
    square = len(flat)
    flat += equations.forcing
    flat += [row[i] for row in equations.reactions for i in independent]
    flat = graph.substitute(flat, values)
    mass = [flat[i * size : (i + 1) * size] for i in range(size)]
    forcing, rest = flat[square : square + size], flat[square + size :]

    def momenta(x: Sequence[Node]) -> list[Node]:
        return matvec(graph, mass, x) if tree is None else tree.product(graph, x)

    reactions = [rest[i * len(independent) : (i + 1) * len(independent)] for i in range(size)]
    proved = accelerations if plain is None else plain
    residual = [a - f for a, f in zip(momenta(proved), forcing, strict=True)]
    if equations.minimum_norm:
        unknowns = equations.unknowns
        return {unknowns[i]: x for i, x in enumerate(minimum_norm(equations, reactions, residual, 2, throughout=True))}
    solution = reaction_solver(equations, reactions)(residual)
    left = [a - r for a, r in zip(matvec(graph, reactions, solution), residual, strict=True)]
    _require_exerted(equations, left)
    unknowns = equations.unknowns
    if plain is not None or loose:
        residual = [a - f for a, f in zip(momenta(accelerations), forcing, strict=True)]
        if equations.compliances and loose:
            solution = least_energy(equations, reactions, [unknowns[i] for i in independent], residual)
        else:
            solution = minimum_norm(equations, reactions, residual, throughout=loose)
    return {unknowns[i]: node for i, node in zip(independent, solution, strict=True)}


def _require_exerted(equations: EquationsOfMotion, left: Sequence[Node]) -> None:
    """Raise unless the joints can exert the reactions of the constraints, where positions satisfy them."""
    if all(vanishes(node) for node in left):
        return
    left = equations.graph.substitute(left, unit_values(equations))
    coordinates = equations.symbols.coordinates
    missing = [name for name, node in zip(coordinates, left, strict=True) if not vanishes(node)]
    positions = [row.position for row in equations.constraints if row.position is not None]
    if missing and positions:
        rows, columns = [row.jacobian for row in equations.constraints], transpose(equations.reactions)
        along = outside_span_on_manifold(equations.q, columns, positions, rows)
        missing = missing if along is None else [coordinates[i] for i in along]
    if missing:
        raise ConstraintError(
            f"scene {equations.name!r}: its joints cannot exert the reactions of its constraints (missing power on"
            f" {list_names(missing)}). Give a joint the unknown force or torque component that holds the constraint"
        )


# Reactions of contacts that share a load indeterminately, and outputs in terms of them.


def shared_reactions(system: ReducedSystem) -> tuple[Sequence[Node], Sequence[Node]] | None:
    """Return what decides the reactions, and the outputs in terms of them as inputs; None where none is asked for.

    What decides them is those of least norm, the power coefficients and the rows of the cones
    (`EquationsOfMotion.cones`), in terms of t and the state.
    """
    equations = system.equations
    own = {guard.output for guard in equations.guards}
    asked = [name for name in system.outputs if name not in own]
    if not equations.cones or not asked:
        return None
    values = dict(zip((*equations.q, *equations.qdot), (*system.coordinates, *system.rates), strict=True))
    values = {a: b for a, b in values.items() if a is not b}
    unknowns = set(equations.unknowns)
    held = requested_outputs(equations, list(system.outputs), values, system.accelerations, solve=False).outputs
    if not any(node in unknowns for node in equations.graph.topological([held[name] for name in asked])):
        return None
    least = requested_outputs(equations, equations.symbols.unknowns, values, system.accelerations).outputs
    entries = [entry for row in (*equations.reactions, *equations.cones) for entry in row]
    decide = [*least.values(), *equations.graph.substitute(entries, values)]
    return decide, list(held.values())
