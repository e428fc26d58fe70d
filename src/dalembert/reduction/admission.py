"""Kernels that test what runs are given as arrays.

They compare it with the constraints and with the declarations of symbols, and count the constraints that depend on
others there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion
from ..once import deriving
from ..transforms.linear import matvec
from ..transforms.lower_kernels import lower_kernel
from .base import ReducedSystem
from .saddle import SaddlePoint
from .start_limits import StartLimits, left_by_rounding_of_start
from .starting import Start

_PERIODS = {"integer": (1, 0), "even": (2, 0), "odd": (2, 1)}
"""Declaration -> number, and the rest that is left of a division by it."""


@deriving
def admission_of_state(system: ReducedSystem, rounding: float) -> Kernel | None:
    """Return the kernel that tests the state of a formulation, None where any state and parameters are admitted.

    Parameters
    ----------
    system : ReducedSystem
    rounding : float
        Magnitude of values of a state whose sign says nothing.

    Returns
    -------
    Kernel or None
        Arguments (t, y, c), c beginning with the parameters. Outputs: the number of values that contradict the
        declarations of their symbols, then for each constraint that a state could violate its residual and the
        largest that is allowed, as for given initial values; and the number of constraints that depend on others, of
        which none may, where some can.
    """
    graph = Graph()
    y = [graph.input(name) for name in system.state]
    at_state = dict(zip(graph.adopt(system.inputs), y, strict=True))
    free = system.projection or system.start_projection or system.stages
    q, qdot = (graph.substitute(graph.adopt(nodes), at_state) for nodes in (system.coordinates, system.rates))
    parameters = system.equations.symbols.parameters
    count = _dependent_count(system)
    further = [] if count is None else [*graph.substitute(graph.adopt([count]), at_state), graph.zero]
    constrained = free is not None
    return _admission(graph, system.equations, (y, q, qdot), parameters, rounding, further, constrained=constrained)


@deriving
def admission_of_variables(equations: EquationsOfMotion, parameters: Sequence[str], rounding: float) -> Kernel | None:
    """Return the same kernel for coordinates, rates and first-order states (2 n_q + n_z,), and these parameters."""
    graph, n = Graph(), len(equations.q)
    y = [graph.input(name) for name in equations.symbols.variables]
    return _admission(graph, equations, (y, y[:n], y[n : 2 * n]), parameters, rounding, constrained=True)


@deriving
def dependence(system: ReducedSystem) -> Start | None:
    """Return the number of enforced constraints that depend on others, as a kernel of a state with the names `given`.

    None where constraints cannot depend on each other.
    """
    equations, count, graph = system.equations, _dependent_count(system), Graph()
    if count is None:
        return None
    inputs: dict[Node, tuple[str, int | None]] = {graph.input(equations.symbols.time): ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(equations.symbols.parameters)}
    inputs |= {graph.input(name): ("y", i) for i, name in enumerate(system.state)}
    counted = graph.adopt([count])
    return Start(lower_kernel(graph, "dependence", counted, inputs, arguments=("t", "y", "c")), system.state, ())


def _dependent_count(system: ReducedSystem) -> Node | None:
    """Return the number of enforced constraints that depend on others; None where they cannot."""
    equations = system.equations
    rows = tuple(row for i, row in enumerate(equations.constraints) if i not in system.left_out)
    if system.regular or system.redundancy is not None or len(rows) < 2:
        return None
    return SaddlePoint.of(replace(equations, constraints=rows), guarded=True).set_aside()


def _admission(
    graph: Graph,
    equations: EquationsOfMotion,
    motion: tuple[Sequence[Node], Sequence[Node], Sequence[Node]],
    parameters: Sequence[str],
    rounding: float,
    further: Sequence[Node] = (),
    *,
    constrained: bool,
) -> Kernel | None:
    """Return the kernel for components of the state, coordinates and rates, on a graph, with `further` checks."""
    y, q, qdot = motion
    symbols, assumptions = equations.symbols, equations.symbols.assumptions
    named = {str(node.payload): node for node in y} | dict(zip(symbols.coordinates, q, strict=True))
    tests = [test for name in parameters for test in _broken(graph, graph.input(name), assumptions.get(name, ()), 0.0)]
    tests += [
        test for name, node in named.items() for test in _broken(graph, node, assumptions.get(name, ()), rounding)
    ]
    checks = _residuals(graph, equations, q, qdot) if constrained and equations.constraints else []
    checks += further
    if not tests and not checks:
        return None
    inputs: dict[Node, tuple[str, int | None]] = {graph.input(symbols.time): ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(parameters)}
    inputs |= {node: ("y", i) for i, node in enumerate(y)}
    return lower_kernel(graph, "admission", [graph.sum(tests), *checks], inputs, arguments=("t", "y", "c"))


def _residuals(graph: Graph, equations: EquationsOfMotion, q: Sequence[Node], qdot: Sequence[Node]) -> list[Node]:
    """Return the residual of each constraint and the largest that is allowed, in turn."""
    rows = equations.constraints
    own = dict(zip(graph.adopt(equations.q), q, strict=True)) | dict(
        zip(graph.adopt(equations.qdot), qdot, strict=True)
    )
    positions = graph.adopt([row.position for row in rows if row.position is not None])
    drift = graph.adopt([row.drift for row in rows])
    jacobian = [graph.adopt(row.jacobian) for row in rows]
    velocities = [v + d for v, d in zip(matvec(graph, jacobian, graph.adopt(equations.qdot)), drift, strict=True)]
    late: list[Node] = []
    if equations.symbols.offsets:
        late = graph.substitute(left_by_rounding_of_start(graph, equations.symbols, [*positions, *velocities]), own)
    left = graph.substitute([*positions, *velocities], own)
    jacobian, drift = [graph.substitute(row, own) for row in jacobian], graph.substitute(drift, own)
    may = StartLimits(graph, equations, q, qdot)
    limits = may.of_constraints(positions, left, jacobian, drift)
    if late:
        limits = [a + b for a, b in zip(limits, late, strict=True)]
    return [node for pair in zip(left, limits, strict=True) for node in pair]


def _broken(graph: Graph, node: Node, declared: Sequence[str], rounding: float) -> list[Node]:
    """Return a node for each declaration of a value, 1 where the value contradicts it and else 0."""
    found, least = [], graph.node(rounding)
    for what in declared:
        if what in _PERIODS:
            number, rest = map(graph.node, _PERIODS[what])
            odds = node - number * graph.call("floor", node / number) - rest
            found.append(graph.call("less", graph.zero, graph.call("abs", odds)))
        elif what == "zero":
            found.append(graph.call("less", graph.zero, graph.call("abs", node)))
        else:
            found.append(graph.call("less", least, -node if what in ("positive", "nonnegative") else node))
    return found
