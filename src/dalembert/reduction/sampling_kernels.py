"""Kernels of sampled controllers on the state of a formulation: [ReducedSystem] -> [SamplingKernels]."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion
from ..transforms.derivatives import GUARDED, tangents
from ..transforms.lower_kernels import lower_kernel
from .base import ReducedSystem
from .variational import seeds_of, with_weights

_ARGUMENTS = ("t", "y", "c")


@final
@frozen
class SamplingAction:
    """Actions of one controller at an instant.

    Attributes
    ----------
    name : str
        Of the controller.
    places : tuple of int
        Which components of y it sets.
    kernel : Kernel or None
        Their new values; None for a Python function.
    function : callable or None
    states, inputs : tuple of str
        States and inputs that a function sets.
    """

    name: str
    places: tuple[int, ...]
    kernel: Kernel | None
    function: Callable[..., Any] | None
    states: tuple[str, ...]
    inputs: tuple[str, ...]


@final
@frozen
class SamplingKernels:
    """The controllers of a system, with kernels of (t, y, c), c beginning with the parameters.

    Attributes
    ----------
    actions : tuple of Action
        In the order in which they act at one instant.
    times : Kernel
        Periods, then offsets.
    moved : tuple of str
        Names of parameters that periods or offsets depend on.
    """

    actions: tuple[SamplingAction, ...]
    times: Kernel
    moved: tuple[str, ...]


@final
@frozen(eq=False)
class SampledVariables:
    """Coordinates, rates and first-order states of a scene, in place of the state of a formulation."""

    equations: EquationsOfMotion

    @property
    def coordinates(self) -> Sequence[Node]:
        """The coordinates."""
        return self.equations.q

    @property
    def rates(self) -> Sequence[Node]:
        """Their rates."""
        return self.equations.qdot

    @property
    def inputs(self) -> Sequence[Node]:
        """All variables."""
        return [self.equations.graph.input(name) for name in self.state]

    @property
    def state(self) -> tuple[str, ...]:
        """Their names."""
        return self.equations.symbols.variables

    @property
    def places(self) -> Mapping[Node, int]:
        """Their places in the array of all variables."""
        return {node: i for i, node in enumerate(self.inputs)}


def sampling_kernels(system: ReducedSystem | SampledVariables, wrt: Sequence[str] = ()) -> SamplingKernels | None:
    """Return the kernels of the controllers of a system, None where there are none.

    With `wrt` the state is followed by its derivatives by these names, as in `dalembert.reduction.variational`, which
    change at instants too.
    """
    equations = system.equations
    if not equations.controllers:
        return None
    symbols, graph = equations.symbols, Graph()  # a separate graph, so that the kernels depend on the system alone
    scene = (*equations.q, *equations.qdot)
    found = (*system.coordinates, *system.rates)
    values = {a: b for a, b in zip(graph.adopt(scene), graph.adopt(found), strict=True) if a is not b}
    size = len(system.inputs)
    varied = [[graph.input(f"d {name} d {w}") for name in system.state] for w in wrt]
    places = {node: i for node, i in zip(graph.adopt(list(system.places)), system.places.values(), strict=True)}
    constants: dict[Node, tuple[str, int | None]] = {
        graph.input(name): ("c", i) for i, name in enumerate(with_weights(wrt, symbols))
    }
    inputs = {graph.input(symbols.time): ("t", None), **constants, **{node: ("y", i) for node, i in places.items()}}
    inputs |= {node: ("y", size * (1 + k) + i) for k, row in enumerate(varied) for i, node in enumerate(row)}
    actions = []
    for item in equations.controllers:
        names = tuple(item.changes)
        own = tuple(system.state.index(name) for name in names)
        nodes = graph.adopt(list(item.changes.values()))
        nodes = graph.substitute(nodes, values) if values else nodes
        columns = list(nodes)
        for k, w in enumerate(wrt):
            seeds = {node: varied[k][i] for node, i in places.items()}
            columns += tangents(graph, nodes, seeds | seeds_of(graph, w, symbols), GUARDED)
        whole = (*own, *(size * (1 + k) + i for k in range(len(wrt)) for i in own))
        kernel = lower_kernel(graph, "sampling", columns, inputs, arguments=_ARGUMENTS) if names else None
        actions.append(SamplingAction(item.name, whole, kernel, item.function, item.states, item.inputs))
    periods = graph.adopt([item.period for item in equations.controllers])
    offsets = graph.adopt([item.offset for item in equations.controllers])
    times = lower_kernel(graph, "sampling_times", [*periods, *offsets], inputs, arguments=_ARGUMENTS)
    moved = tuple(
        name for name in symbols.parameters if any(x.deps & graph.input(name).deps for x in (*periods, *offsets))
    )
    return SamplingKernels(tuple(actions), times, moved)
