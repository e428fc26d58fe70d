"""Generalized speeds, their kinematic equations on the graph, and first-order states of a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.vector import dynamicsymbols

from ..errors import SceneError, list_names
from ..ir.node import Node, deps_of, sharing
from ..naming import rate_name, unwritable
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix, SingularMatrix, factorize, matmul, matvec, transpose
from .actuators import loads_of
from .controllers import controller_symbols
from .expressions.reader import ExpressionReader
from .model import SpeedGroup
from .symbol_table import Entry

if TYPE_CHECKING:
    from .scene import Scene


def read_speeds(
    reader: ExpressionReader,
    coordinates: Sequence[Any],
    speeds: Sequence[Any],
    equations: Sequence[Any],
    fault: Callable[[str], Any],
) -> tuple[tuple[SpeedGroup, ...], tuple[Entry, ...], dict[str, str]]:
    """Define the generalized speeds by the kinematic equations.

    Parameters
    ----------
    reader : ExpressionReader
        Gets a definition of each speed in coordinates, rates and time.
    coordinates, speeds : sequence of dynamicsymbols
    equations : sequence of Expr
        Expressions that vanish, affine in rates and speeds.
    fault : callable
        Records a fault.

    Returns
    -------
    groups, entries, aliases
        Speeds with the coordinates that they belong to; how to start from them; and, for those that are just a rate,
        name of the speed -> name of the rate.
    """
    time = dynamicsymbols._t
    names = [str(u.func.__name__) for u in speeds]
    reader.define(dict(zip(speeds, map(reader.graph.input, names), strict=True)))
    rows = [reader.read(equation, f"kinematic equation {equation} = 0") for equation in equations]
    rates = [reader.leaves[sp.Derivative(q, time)] for q in coordinates]
    inputs = [reader.leaves[u] for u in speeds]
    groups: list[SpeedGroup] = []
    entries: list[Entry] = []
    aliases: dict[str, str] = {}
    for members in _blocks(reader, rows, [*names, *(rate_name(q.func.__name__) for q in coordinates)]):
        held = [i for i, u in enumerate(inputs) if any(rows[r].deps & u.deps for r in members)]
        moved = [i for i, rate in enumerate(rates) if any(rows[r].deps & rate.deps for r in members)]
        mine = list_names(names[i] for i in held) or "no speed"
        if not len(members) == len(held) == len(moved):
            fault(
                f"{len(members)} kinematic equations tie {len(held)} speeds ({mine}) to the rates of {len(moved)}"
                f" coordinates ({list_names(str(coordinates[i].func.__name__) for i in moved)}); there must be as many"
                " of each. For a body in quaternions, use dalembert.free_orientation"
            )
            continue
        try:
            u_of_rates, rates_of_u = _both_ways(reader, [rows[r] for r in members], (inputs, held), (rates, moved))
        except ArithmeticError as reason:
            fault(f"the kinematic equations of {mine} {reason}")
            continue
        named = tuple(names[i] for i in held)
        targets = tuple(rate_name(coordinates[i].func.__name__) for i in moved)
        reader.define({speeds[i]: node for i, node in zip(held, u_of_rates, strict=True)})
        if len(named) == 1 and u_of_rates[0] is rates[moved[0]]:
            aliases[named[0]] = targets[0]
            continue
        slopes = [tangents(reader.graph, u_of_rates, {rates[i]: reader.graph.one}) for i in moved]
        groups.append(SpeedGroup(named, tuple(moved), tuple(zip(*slopes, strict=True))))
        needs = tuple(
            str(q.func.__name__) for q in coordinates if any(reader.leaves[q].deps & x.deps for x in rates_of_u)
        )
        entries.append(Entry(named, needs, targets, tuple(rates_of_u)))
    return tuple(groups), tuple(entries), aliases


def _both_ways(
    reader: ExpressionReader,
    block: Sequence[Node],
    speeds: tuple[Sequence[Node], Sequence[int]],
    rates: tuple[Sequence[Node], Sequence[int]],
) -> tuple[list[Node], list[Node]]:
    """Return speeds from rates, and rates from speeds; of each, all are given with the numbers of those to solve for.

    Raises
    ------
    ArithmeticError
        For equations that do not give them, with the reason.
    """
    (inputs, held), (moving, moved) = speeds, rates
    try:
        return (
            _solved(reader, block, [inputs[i] for i in held], moving),
            _solved(reader, block, [moving[i] for i in moved], inputs),
        )
    except SingularMatrix:
        raise ArithmeticError("do not give speeds from rates, or rates from speeds") from None
    except ArithmeticError:
        raise ArithmeticError("are not affine in speeds and rates") from None


def _blocks(reader: ExpressionReader, rows: Sequence[Node], names: Sequence[str]) -> list[list[int]]:
    """Return the numbers of the equations, those together that have speeds or rates in common."""
    every = reader.graph.mask(names)
    return sorted(sorted(members) for members in sharing([row.deps & every for row in rows]))


def _solved(
    reader: ExpressionReader, rows: Sequence[Node], wanted: Sequence[Node], others: Sequence[Node]
) -> list[Node]:
    """Return the inputs `wanted` at which the rows vanish; ``ArithmeticError`` where they are not affine."""
    graph = reader.graph
    both = list(dict.fromkeys([*wanted, *others]))
    columns = [tangents(graph, rows, {u: graph.one}) for u in wanted]
    freed = [[graph.freed_of(x, both) for x in column] for column in columns]
    matrix: Matrix = []
    for row in zip(*freed, strict=True):
        if any(x is None for x in row):
            raise ArithmeticError
        matrix.append([x for x in row if x is not None])
    rest = graph.substitute(rows, dict.fromkeys(wanted, graph.zero))
    across = transpose(matrix)  # the pivots of A^T A vanish nowhere where A is regular; those of A may
    return factorize(graph, matmul(graph, across, matrix)).solve(matvec(graph, across, [-x for x in rest]))


# First-order states of a scene: their symbols, names and rates.

_TO_DO = "make it with dynamicsymbols, as in F = dynamicsymbols('F')"


def state_symbols(scene: Scene, coordinates: Sequence[Any], fault: Callable[[str], Any]) -> tuple[Any, ...]:
    """Return the symbols of the first-order states of a scene, without those for which `fault` is called.

    Parameters
    ----------
    scene : Scene
    coordinates : sequence of dynamicsymbols
        Its coordinates.
    fault : callable
        Records a fault.
    """
    others = {str(q.func.__name__): "a coordinate of the scene" for q in coordinates}
    angles = [angle for item in scene.orientations for angle in item.angles]
    others |= {str(q.func.__name__): "a coordinate that the scene eliminates" for q, _ in scene.imposed}
    others |= {str(q.func.__name__): "an angle that a quaternion replaces" for q in angles}
    others |= {str(u.func.__name__): "a speed of the scene" for u in scene.speeds}
    others |= {str(u.func.__name__): "an input of the scene" for u in scene.inputs if hasattr(u, "func")}
    sampled = controller_symbols(scene)
    for u in scene.inputs:
        if u in sampled:
            others.pop(str(u.func.__name__), None)
    good: dict[str, Any] = {}
    for z in (*(z for z, _ in scene.states), *sampled):
        if not (isinstance(z, AppliedUndef) and z.args == (dynamicsymbols._t,)):
            fault(f"state {z!r} is not a function of time; {_TO_DO}")
            continue
        name = str(z.func.__name__)
        if name in others:
            fault(f"state {name!r} is {others[name]} too; a state has a rate of first order alone: rename one of them")
        elif name in good:
            fault(f"state {name!r} is given twice; write one rate for it")
        elif unwritable(name):
            fault(f"the name of state {name!a} has a lone surrogate, half of a character; use another name")
        else:
            good[name] = z
    return tuple(good.values())


def read_rates(
    scene: Scene, symbols: Sequence[Any], reader: ExpressionReader, read: Callable[[Any, str], Node]
) -> tuple[Node, ...]:
    """Return the rates of first-order states; from now on their derivatives are read as these.

    Parameters
    ----------
    scene : Scene
    symbols : sequence of dynamicsymbols
        Its states, of `state_symbols`.
    reader : ExpressionReader
        Gets the rates.
    read : callable
        Returns an expression that the motion depends on, at a place, as a node.
    """
    time = dynamicsymbols._t
    written = dict.fromkeys(symbols, sp.S.Zero) | dict(scene.states)
    names = [rate_name(z.func.__name__) for z in symbols]
    mask, rates = reader.graph.mask(names), []
    for z in symbols:
        place = f"rate of state {z.func.__name__!r}"
        node = read(written[z], place)
        if node.deps & mask:
            used = [name for name in names if node.deps & reader.graph.input(name).deps]
            reader.faults.append(f"{place}: it contains {list_names(used)}; write the expression of that rate instead")
            node = reader.graph.zero
        rates.append(node)
    reader.define({sp.Derivative(z, time): node for z, node in zip(symbols, rates, strict=True)})
    return tuple(rates)


def refuse_states(reader: ExpressionReader, symbols: Sequence[Any], nodes: Sequence[Node], place: str) -> None:
    """Record a fault where a position or an energy depends on first-order states."""
    deps = deps_of(nodes)
    used = [z for z in symbols if deps & reader.graph.input(z.func.__name__).deps]
    if used:
        reader.faults.append(
            f"{place}: it depends on the first-order states {list_names(str(z.func.__name__) for z in used)}, which"
            " have no accelerations. They may stand in loads, joints, nonholonomic constraints, laws of friction, rates"
            " of states, outputs and events; what moves a body must be a coordinate or a function of time"
        )


# Scenes without generalized speeds.


def without_speeds(scene: Scene) -> Scene:
    """Return a scene in coordinates and rates alone, for readers that do not support speeds.

    Raises
    ------
    SceneError
        When the scene has no positions, or a kinematic equation has more than one speed.
    """
    if scene.lagrangian is not None or scene.velocities:
        what = "a Lagrangian" if scene.lagrangian is not None else "velocities that are not the rates of positions"
        raise SceneError(scene.name, [f"the scene came from SymPy with {what}; write it as a Scene, with positions"])
    if not scene.speeds:
        return scene
    values: dict[Any, Any] = {}
    for equation in scene.kinematic_equations:
        held = [u for u in scene.speeds if equation.has(u)]
        if len(held) != 1:
            raise SceneError(
                scene.name,
                [f"the kinematic equation {equation} = 0 has not one speed but {len(held)}; write the scene in rates"],
            )
        slope = equation.diff(held[0])
        values[held[0]] = sp.S(held[0] - equation / slope).expand()
    twin = scene.copy()
    twin.speeds = twin.kinematic_equations = ()
    twin.holonomic_constraints = tuple(c.xreplace(values) for c in scene.holonomic_constraints)
    twin.nonholonomic_constraints = tuple(c.xreplace(values) for c in scene.nonholonomic_constraints)
    twin.loads = tuple((*load[:-1], load[-1].xreplace(values)) for load in loads_of(scene))
    twin.actuators = ()
    return twin
