"""Variational equations: [ReducedSystem] -> [Program] with derivatives of the state.

The state y is followed by its derivatives with respect to parameters and initial values, dy/dw, whose rates are the
directional derivatives of the right-hand side by forward mode on the graph. The result is a program like any other,
so that every integrator of every backend serves it; a correction onto the constraints is differentiated along.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.program import Layout, Program, hidden_parameters
from ..naming import rate_name
from ..scene.symbol_table import SymbolTable
from ..transforms.derivatives import GUARDED, tangents
from ..transforms.lower_kernels import lower_kernel
from ..transforms.pipelines import PROGRAM_PASSES
from ..transforms.step_limits import step_limits
from .base import ReducedSystem, condition_kernels

# Derivatives by values of inputs: the weight of a value as a function of time.
#
# A record of an input is a sum of its values, each times a weight that depends on time alone. The derivative of the
# input by one of the values is that weight: an input of its own, whose coefficients are the derivatives of those of
# the input.


def input_of(name: str, symbols: SymbolTable) -> str | None:
    """Return the input u that a name stands for, as "u" or as "u[3]", one of its values; None for other names."""
    if name in symbols.parameters or name in symbols.variables:
        return None
    stem = name.partition("[")[0]
    return stem if stem in symbols.input_names else None


def weight_of(name: str) -> str:
    """Return the name of the input that is the derivative of an input by one of its values."""
    return f"weight of {name}"


def weights_of(wrt: Sequence[str], symbols: SymbolTable) -> tuple[str, ...]:
    """Return the names of the weights for those of `wrt` that are values of inputs."""
    return tuple(weight_of(name) for name in wrt if input_of(name, symbols) is not None)


def with_weights(wrt: Sequence[str], symbols: SymbolTable) -> tuple[str, ...]:
    """Return the parameters of a scene, followed by those of the weights of values of inputs."""
    return (*symbols.parameters, *(x for weight in weights_of(wrt, symbols) for x in hidden_parameters(weight)))


def seeds_of(graph: Graph, name: str, symbols: SymbolTable) -> dict[Node, Node]:
    """Return the parameters that depend on a parameter or on a value of an input, each with its derivative."""
    if name in symbols.parameters:
        return {graph.input(name): graph.one}
    changed = input_of(name, symbols)
    if changed is None:
        return {}
    _, *own = hidden_parameters(changed)
    _, *weights = hidden_parameters(weight_of(name))
    return {graph.input(a): graph.input(b) for a, b in zip(own, weights, strict=True)}


def variational(system: ReducedSystem, of: Sequence[str], wrt: Sequence[str]) -> Program:
    """Return the program of a system and of its derivatives.

    Parameters
    ----------
    system : ReducedSystem
        The equations of motion.
    of : sequence of str
        Names of coordinates, rates, components of the state and requested outputs.
    wrt : sequence of str
        Names of parameters, and any others for initial values, on which the equations do not depend; "u" or "u[3]" is
        a value of the input u, whose weight is another input of the program (`weight_of`).

    Returns
    -------
    Program
        Its state is y (n_y), then dy/dw (n_y) for each w of `wrt`; its outputs are the values `of`, then for each w
        their derivatives. Its kernels are ``prepare``, ``rhs``, ``outputs``, the projections of the system, and
        the limits of its steps.
    """
    return _Variational(system, of, wrt).program()


@final
class _Variational:
    def __init__(self, system: ReducedSystem, of: Sequence[str], wrt: Sequence[str]) -> None:
        self.system, self.of, self.wrt = system, tuple(of), tuple(wrt)
        self.symbols = system.equations.symbols
        self.graph = Graph()  # a graph of its own, so that the model's own kernels stay as they are
        self.inputs = self.graph.adopt(system.inputs)
        self.places = dict(zip(self.graph.adopt(list(system.places)), system.places.values(), strict=True))
        names = [f"d {name} d {w}" for w in wrt for name in system.state]
        self.names = tuple(names)
        self.varied = [self.graph.input(name) for name in names]

    def _seeds(self, place: int) -> dict[Node, Node]:
        n = len(self.inputs)
        seeds = {node: self.varied[place * n + i] for node, i in self.places.items()}
        return seeds | seeds_of(self.graph, self.wrt[place], self.symbols)

    def _with_derivatives(self, nodes: Sequence[Node]) -> list[Node]:
        """Return nodes of the system in this graph, then their derivatives with respect to each of `wrt`."""
        own = self.graph.adopt(nodes)
        columns = [tangents(self.graph, own, self._seeds(place), GUARDED) for place in range(len(self.wrt))]
        return [*own, *(entry for column in columns for entry in column)]

    def _values(self) -> list[Node]:
        system, symbols = self.system, self.symbols
        known: dict[str, Node] = dict(system.outputs)
        known |= dict(zip(system.state, system.inputs, strict=True))
        known |= dict(zip(symbols.rates, system.rates, strict=True))
        known |= dict(zip(symbols.coordinates, system.coordinates, strict=True))
        known |= dict(zip(map(rate_name, symbols.states), system.state_rates, strict=True))
        return [known[name] for name in self.of]

    def program(self) -> Program:
        """Return the program."""
        system = self.system
        wanted = {"rhs": system.rhs, "outputs": self._values()}
        if system.projection is not None:
            wanted |= system.projection.kernels()
        inputs = self._arrays()
        kernels = [
            lower_kernel(self.graph, name, self._with_derivatives(nodes), inputs) for name, nodes in wanted.items()
        ]
        (time,) = self.graph.adopt([system.equations.time])
        rates, parameters = self.graph.adopt(system.rhs), with_weights(self.wrt, self.symbols)
        limits = step_limits(self.graph, rates, self.inputs, time, parameters)
        if limits is not None:
            kernels.append(lower_kernel(self.graph, "knots", limits, inputs))
        outputs = (*self.of, *(f"d {name} d {w}" for w in self.wrt for name in self.of))
        layout = Layout(
            coordinates=(),
            rates=(),
            parameters=with_weights(self.wrt, self.symbols),
            unknowns=(),
            undetermined=(),
            state=(*system.state, *self.names),
            outputs=outputs,
            constraints=(),
            holonomic=0,
            constants=0,
            aliases={},
            inputs=(*self.symbols.input_names, *weights_of(self.wrt, self.symbols)),
        )
        equations = system.equations
        name = f"{equations.name}, varied"
        conditions, nonanalytic = condition_kernels(equations), equations.nonanalytic
        return PROGRAM_PASSES(
            Program(name, system.formulation, layout, tuple(kernels), (), nonanalytic, conditions=conditions)
        )

    def _arrays(self) -> Mapping[Node, tuple[str, int | None]]:
        graph = self.graph
        arrays: dict[Node, tuple[str, int | None]] = {graph.input(self.symbols.time): ("t", None)}
        arrays |= {graph.input(name): ("p", i) for i, name in enumerate(with_weights(self.wrt, self.symbols))}
        arrays |= {node: ("y", i) for node, i in self.places.items()}
        return arrays | {node: ("y", len(self.inputs) + i) for i, node in enumerate(self.varied)}
