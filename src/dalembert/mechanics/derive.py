"""Derivation of equations of motion by virtual power: [SceneModel] -> [EquationsOfMotion]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..errors import OptionError, SceneError
from ..ir.graph import Graph
from ..ir.node import Node
from ..naming import acceleration_input, acceleration_name
from ..scene.model import ConstraintModel, ContactModel, SceneModel
from ..scene.symbols import RESERVED_OUTPUTS
from ..transforms.derivatives import cotangents, jacobian, tangents
from ..transforms.linear import Matrix
from ..transforms.taylor.nonsmooth import nonanalytic
from .equations import ConstraintRow, ContactRow, EquationsOfMotion
from .kinematics import Kinematics
from .load_energy import load_energy, warn_of_silent_potential
from .power_checks import require_conjugate_slip, require_reactions_of_constraints
from .quasi_velocities import VelocityChoice, VelocityGroup, quaternion_groups, velocity_groups
from .virtual_power import Powers, kane_powers, load_powers, powers

# Coordinates without a unit: angles, and components of quaternions.
#
# Initial values are compared with sizes of their own kind (`dalembert.reduction.start_limits`): an angle with one,
# whatever the unit of length, and every other coordinate with the lengths of the scene.

_CIRCULAR = ("sin", "cos", "tan")
_LINEAR = ("add", "sub", "neg", "mul")


def angles_of(model: SceneModel, rows: Sequence[ConstraintRow], matrix: Matrix) -> tuple[str, ...]:
    """Return the names of the coordinates without a unit.

    These turn a frame by themselves, without a parameter, or are added to the argument of a sine, a cosine or a
    tangent.
    """
    graph, coordinates = model.graph, model.symbols.coordinates
    turned = [x for frame in model.frames for row in frame.rotation or () for x in row]
    placed = [x for point in model.points for piece in point.position for x in piece.components]
    held = [x for row in rows for x in (row.position, *row.jacobian) if x is not None]
    if model.given is not None or model.lagrangian is not None:
        held += [x for row in matrix for x in row]
    given = graph.mask(model.symbols.parameters)
    bare = 0
    for node in turned:
        bare |= 0 if node.deps & given else node.deps
    for node in Graph.topological([*turned, *placed, *held]):
        if node.op in _CIRCULAR:
            bare |= _added(node.args[0])
    return tuple(name for name in coordinates if graph.input(name).deps & bare)


def _added(node: Node) -> int:
    """Return the dependency bits of the inputs of which multiples by numbers are added to a value."""
    if node.op == "input":
        return node.deps
    if node.op not in _LINEAR or (node.op == "mul" and not any(arg.op == "const" for arg in node.args)):
        return 0
    found = 0
    for arg in node.args:
        found |= _added(arg)
    return found


# Equations of motion from a Lagrangian: d/dt dL/dq_dot - dL/dq = Q.
#
# L is a polynomial of degree two in the rates, L = T_2 + L_1 + L_0. Then M = d^2 L/dq_dot^2, and the forcing is Q +
# dL/dq less the rate of dL/dq_dot at zero second rates. T_2 stands for the kinetic and -L_0 for the potential energy,
# so that the energy is Jacobi's integral q_dot . dL/dq_dot - L, which is conserved where L does not depend on time and
# loads do no work.


def lagrangian_powers(kinematics: Kinematics) -> Powers:
    """Return the mass matrix, forcing and energies of a scene that gives its Lagrangian.

    Raises
    ------
    SceneError
        When the Lagrangian is not of degree two in the rates.
    """
    graph, model = kinematics.graph, kinematics.model
    lagrangian = model.lagrangian
    assert lagrangian is not None and model.given is not None
    q, rates = kinematics.q, kinematics.qdot
    momenta = [tangents(graph, [lagrangian], {rate: graph.one})[0] for rate in rates]
    matrix: Matrix = []
    for name, row in zip(model.symbols.coordinates, jacobian(graph, momenta, rates), strict=True):
        freed = [graph.freed_of(entry, rates) for entry in row]
        if any(entry is None for entry in freed):
            why = f"the Lagrangian is not of degree two in the rates: dL/d{name}_dot is not affine in them"
            raise SceneError(model.name, [f"{why}. Only L = T - V with velocities affine in the rates can be compiled"])
        matrix.append([entry for entry in freed if entry is not None])
    bias = tangents(graph, momenta, kinematics.flow)
    slopes = [tangents(graph, [lagrangian], {x: graph.one})[0] for x in q]
    loads = load_powers(kinematics, model.given.loads)
    forcing = [load + slope - rate for load, slope, rate in zip(loads, slopes, bias, strict=True)]
    pairs = ((matrix[i][j], rates[i], rates[j]) for i in range(len(q)) for j in range(len(q)))
    kinetic = graph.sum(entry * a * b for entry, a, b in pairs) / 2
    still = graph.substitute([lagrangian], dict.fromkeys(rates, graph.zero))[0]
    return Powers(matrix, forcing, kinetic, -still, -still)


def derive(model: SceneModel) -> EquationsOfMotion:
    """Return the equations of motion of a scene, unconstrained (assumption 13.1.2) beside its constraints.

    Raises
    ------
    SceneError
        When a reaction enters an action otherwise than linearly, and for kinks that a motion may pass.
    """
    kinematics = Kinematics(model)
    if model.lagrangian is not None:
        power = lagrangian_powers(kinematics)
    else:
        power = powers(kinematics) if model.given is None else kane_powers(kinematics)
    forcing, reactions = _split(model, power.forcing)
    silent = () if model.lagrangian is not None else warn_of_silent_potential(kinematics, power, forcing)
    gaps = {contact.constraint for contact in model.contacts}
    holonomic = [
        replace(_holonomic(kinematics, constraint), opens=i in gaps) for i, constraint in enumerate(model.holonomic)
    ]
    nonholonomic = [_row(kinematics, each.label, None, each.expression) for each in model.nonholonomic]
    rows = (*holonomic, *nonholonomic)
    inertia = power.mass_matrix if power.tree is None else [power.tree.nodes]
    terms = [*(entry for row in inertia or () for entry in row), *power.forcing]
    terms += [node for row in rows for node in (*row.jacobian, row.drift, row.bias)]
    states = tuple(map(model.graph.input, model.symbols.states))
    terms += model.state_rates
    moving = (model.graph.input(model.symbols.time), *kinematics.q, *kinematics.qdot, *states)
    outputs = {**model.outputs, **_places(kinematics)}
    _require_names_of_their_own(model, outputs)
    groups = _groups(kinematics)
    equations = EquationsOfMotion(
        name=model.name,
        graph=model.graph,
        symbols=model.symbols,
        q=tuple(kinematics.q),
        qdot=tuple(kinematics.qdot),
        dense=power.mass_matrix,
        forcing=tuple(forcing),
        reactions=reactions,
        constraints=rows,
        kinetic_energy=power.kinetic_energy,
        potential_energy=power.potential_energy,
        groups=groups,
        outputs=outputs,
        contacts=tuple(_contact(kinematics, contact, reactions, rows) for contact in model.contacts),
        nonanalytic=nonanalytic(model.graph, terms, moving, kinks=bool(model.contacts)),
        load_energy=load_energy(kinematics, power, silent, rows),
        conditions=model.conditions,
        states=states,
        state_rates=model.state_rates,
        controllers=model.controllers,
        angles=angles_of(model, rows, power.mass_matrix or []),
        compliances=model.compliances,
        scene=model if model.given is None and model.lagrangian is None else None,
        tree=power.tree,
        kinked_locks=_locks_at_kinks(model, groups, kinematics.q),
    )
    require_reactions_of_constraints(model, equations)
    return equations


def _groups(kinematics: Kinematics) -> tuple[VelocityGroup, ...]:
    """Return the quasi-velocities of the frames of a scene, and its own speeds for coordinates that have none."""
    groups = [*quaternion_groups(kinematics), *velocity_groups(kinematics)]
    taken = {i for group in groups for i in group.coordinates}
    own = [group for group in kinematics.model.speeds if not taken & {*group.coordinates}]
    return (*groups, *(VelocityGroup(g.coordinates, (VelocityChoice(g.names, g.rows),)) for g in own))


def _places(kinematics: Kinematics) -> dict[str, Node]:
    """Return requested components of vectors and of positions of points, on the frame of the scene."""
    places, vectors = kinematics.model.places.items(), kinematics.model.vectors.items()
    found = {name: kinematics.between(0, point, 0)[axis] for name, (point, axis) in places}
    return found | {name: kinematics.resolve(pieces, 0)[axis] for name, (pieces, axis) in vectors}


def _require_names_of_their_own(model: SceneModel, outputs: Mapping[str, Node]) -> None:
    """Raise for outputs that have the name of another quantity.

    Raises
    ------
    OptionError
    """
    symbols = model.symbols
    kinds = {"time": (symbols.time,), "a coordinate": symbols.coordinates, "a rate": symbols.rates}
    kinds |= {"a parameter": symbols.parameters, "a reaction": symbols.unknowns}
    kinds["an output of every model"] = RESERVED_OUTPUTS
    kinds["an acceleration"] = tuple(acceleration_name(name) for name in symbols.coordinates)
    kinds["a symbol of the scene"] = tuple(symbols.aliases)
    for name in model.chosen:
        own = acceleration_input(name.removesuffix(acceleration_name("")))
        found = [kind for kind, names in kinds.items() if name in names]
        kind = found[0] if found else None
        twice = kind != "an acceleration" and "an acceleration" in found
        if kind is not None and (twice or outputs[name] not in (model.graph.input(name), model.graph.input(own))):
            raise OptionError(
                f"scene {model.name!r}: the output {name!r} has the name of {kind}, which is something else; give it"
                " another name: outputs={'name': expression, vector or point}"
            )


def _locks_at_kinks(model: SceneModel, groups: Sequence[VelocityGroup], q: Sequence[Node]) -> tuple[Node, ...]:
    """Return what vanishes where three angles of a body lock and something has a kink: a run that comes there ends.

    Raises
    ------
    SceneError
        For other kinks.
    """
    graph, found, faults = model.graph, list[Node](), list[str]()
    locks = [group.lock(graph) for group in groups if group.angles] if model.kinks else []
    for fault, value in model.kinks:
        here = [lock for lock in locks if graph.freed_of(lock / value, list(q)) is not None]
        found += here
        faults += [] if here else [fault]
    if faults:
        raise SceneError(model.name, list(dict.fromkeys(faults)))
    return tuple(dict.fromkeys(found))


def _split(model: SceneModel, power: list[Node]) -> tuple[list[Node], Matrix]:
    """Separate the powers into the part without reactions and the coefficients of the reactions."""
    graph = model.graph
    unknowns = [graph.input(name) for name in model.symbols.unknowns]
    if not unknowns:
        return power, [[] for _ in power]
    given = graph.substitute(power, dict.fromkeys(unknowns, graph.zero))
    columns = [tangents(graph, power, {unknown: graph.one}) for unknown in unknowns]
    faults = []
    for name, column in zip(model.symbols.unknowns, columns, strict=True):
        for place, entry in enumerate(column):
            freed = graph.freed_of(entry, unknowns)
            if freed is None:
                faults.append(f"the unknown {name!r} enters an action nonlinearly; reactions must be linear components")
                break
            column[place] = freed
    if faults:
        raise SceneError(model.name, faults)
    return given, [list(row) for row in zip(*columns, strict=True)]


def _holonomic(kinematics: Kinematics, constraint: ConstraintModel) -> ConstraintRow:
    velocity = tangents(kinematics.graph, [constraint.expression], kinematics.flow)[0]
    return _row(kinematics, constraint.label, constraint.expression, velocity)


_MANY = 24
"""Rates in a constraint from which on its row is derived backwards: a chain would take operations in their square."""


def _row(kinematics: Kinematics, label: str, position: Node | None, velocity: Node) -> ConstraintRow:
    graph, rates = kinematics.graph, kinematics.qdot
    still = dict.fromkeys(rates, graph.zero)
    if sum(1 for rate in rates if velocity.deps & rate.deps) > _MANY:
        slopes = cotangents(graph, [velocity], [graph.one], rates)
    else:
        slopes = [
            tangents(graph, [velocity], {x: graph.one})[0] if velocity.deps & x.deps else graph.zero for x in rates
        ]
    *jacobian, drift = graph.substitute([*slopes, velocity], still)
    bias = -tangents(graph, [velocity], kinematics.flow)[0]
    return ConstraintRow(label, position, tuple(jacobian), drift, bias)


def _contact(
    kinematics: Kinematics, contact: ContactModel, reactions: Matrix, constraints: Sequence[ConstraintRow]
) -> ContactRow:
    """Return a contact, with its slip velocities as velocity constraints."""
    model, graph = kinematics.model, kinematics.graph
    names = model.symbols.unknowns
    slips = []
    known = [other.name for other in model.contacts]
    leader = None if contact.follows is None else known.index(contact.follows)
    held = contact.constraint if leader is None else model.contacts[leader].constraint
    others = {other.constraint for other in model.contacts} - {held}
    holding = [row for number, row in enumerate(constraints) if number not in others]
    for place, name in enumerate(contact.tangential):
        power = [row[names.index(name)] for row in reactions]
        label = f"no slip of {contact.name!r}" + (f" along {name}" if len(contact.tangential) > 1 else "")
        velocity = graph.sum(p * rate for p, rate in zip(power, kinematics.qdot, strict=True))
        if contact.slip is not None:
            velocity = contact.slip[place]
        row = _row(kinematics, label, None, velocity)
        require_conjugate_slip(kinematics, contact.name, name, power, row, holding)
        slips.append(row)
    return ContactRow(
        name=contact.name,
        normal=names.index(contact.normal),
        gap=contact.gap,
        constraint=contact.constraint,
        sense=contact.sense,
        restitution=contact.restitution,
        tangential=tuple(names.index(name) for name in contact.tangential),
        slips=tuple(slips),
        mu=contact.mu,
        mu_static=contact.mu_static,
        regularization=contact.regularization,
        normal_load=contact.normal_load,
        slip_speed=contact.slip_speed,
        leader=leader,
        kinks=contact.kinks,
    )
