"""Symbols of a scene on the graph: coordinates, rates, speeds, parameters, unknowns, and their names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.vector import dynamicsymbols

from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.program import DEGREE, hidden_parameters
from ..naming import acceleration_input, acceleration_name, rate_name
from ..transforms.conditions import decide
from ..transforms.derivatives import tangents
from ..transforms.linear import matvec, spin_matrix, transpose
from .controllers import controlled_inputs
from .expressions.elapsed import ElapsedTime
from .expressions.reader import ExpressionReader
from .orientation import angular_velocity, entries_of
from .scene import Scene
from .speeds import read_speeds, state_symbols
from .symbol_table import InputSymbol, SymbolTable


class Requirement(NamedTuple):
    """Requirement on how smooth the values of a place are, so that velocities do not jump.

    Attributes
    ----------
    derivatives : int
        Number of continuous derivatives by time, as inputs and tables leave them; -1 for none.
    place : str
    nodes : sequence of Node
    across : int
        The same at kinks and jumps in the state: 1 for continuous gradients in coordinates, 0 for continuous
        coefficients of rates, and -1 where they may be.
    """

    derivatives: int
    place: str
    nodes: Sequence[Node]
    across: int = -1


TIME = "t"
_SIGNS = ("zero", "positive", "negative", "nonnegative", "nonpositive")
_WHOLE = ("even", "odd", "integer")
_KINKS, _JUMPS = ("abs", "min", "max"), ("sign", "floor", "less", "less_equal")
"""Operations with kinks, and with jumps."""

RESERVED_OUTPUTS = ("energy", "kinetic_energy", "potential_energy")


def reader_of(scene: Scene) -> ExpressionReader:
    """Return a reader of further expressions in the symbols of a scene that was read before, on a graph of its own."""
    return symbol_reader_of(scene).expressions


def symbol_reader_of(scene: Scene) -> SymbolReader:
    """Return a reader of the symbols of a scene that was read before, for `reader_of`."""
    reader = SymbolReader(scene)
    reader.expressions.ignore_conditions()  # steps do not end at breaks of expressions that are read later
    return reader


def _is(symbol: Any, what: str) -> bool:
    """Whether a symbol was declared to be "positive" and so on, where it may be infinite, too."""
    return bool(getattr(symbol, f"is_extended_{what}" if what in _SIGNS[1:] else f"is_{what}"))


class _Names(NamedTuple):
    """Names of the symbols of a scene, by their kinds."""

    coordinates: Sequence[str]
    rates: Sequence[str]
    parameters: Sequence[str]
    unknowns: Sequence[str]
    states: Sequence[str]
    inputs: Sequence[str]


class SymbolReader:
    """Reader of the symbols of one scene; `faults` lists their faults."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.graph = Graph()
        self.faults: list[str] = []
        self._masks: dict[str, int] = {}
        self.coordinates = self._coordinates()
        self.inputs = self._functions_of_time()
        self.states = state_symbols(scene, self.coordinates, self.faults.append)
        clock = None if scene.elapsed is None else ElapsedTime()
        self.expressions = ExpressionReader(self.graph, self._leaves(), clock, time=self.graph.input(TIME))
        self.expressions.flow = self._flow
        self._impose()
        for e in scene.elapsed or ():
            self.expressions.watch(e)
        for symbol in scene.further_parameters:
            self.expressions.read(symbol, f"parameter {symbol}")
        self.speeds, self._starts, self._names = read_speeds(
            self.expressions, self.coordinates, scene.speeds, scene.kinematic_equations, self.faults.append
        )

    def _coordinates(self) -> tuple[Any, ...]:
        good: list[Any] = []
        time = dynamicsymbols._t
        for q in self.scene.coordinates:
            if not (isinstance(q, AppliedUndef) and q.args == (time,)):
                self.faults.append(f"coordinate {q!r} is not a function of time; make it with dynamicsymbols")
            elif q.func.__name__ in {g.func.__name__ for g in good}:
                self.faults.append(f"coordinate {q.func.__name__!r} is given twice")
            else:
                good.append(q)
        if not self.scene.coordinates:
            self.faults.append("the scene has no coordinates; give them as coordinates=[...], or add joints of SymPy")
        return tuple(good)

    def _functions_of_time(self) -> tuple[Any, ...]:
        """Return the inputs of the scene; a fault for those that are also something else."""
        good: list[Any] = []
        sampled = controlled_inputs(self.scene)
        for u in (u for u in self.scene.inputs if u not in sampled):
            if not (isinstance(u, AppliedUndef) and u.args == (dynamicsymbols._t,)):
                self.faults.append(f"input {u!r} is not a function of time; make it with dynamicsymbols")
            elif u in self.coordinates or u in self.scene.speeds:
                self.faults.append(
                    f"{u.func.__name__!r} is a coordinate or a speed and an input too: the motion determines the former"
                    " and the user the latter; make it one of them"
                )
            elif u.func.__name__ in {g.func.__name__ for g in good}:
                self.faults.append(f"input {u.func.__name__!r} is added twice")
            else:
                good.append(u)
        return tuple(good)

    def _input(self, u: Any) -> Node:
        """Return an input: the polynomial in the time since its knot."""
        knot, *coefficients = (self.graph.input(name) for name in hidden_parameters(u.func.__name__))
        elapsed, value = self.graph.input(TIME) - knot, coefficients[DEGREE]
        for coefficient in reversed(coefficients[:DEGREE]):
            value = value * elapsed + coefficient
        return value

    def _flow(self) -> dict[Node, Node]:
        """Return the rates of coordinates, rates, states and time."""
        flow = {self.graph.input(TIME): self.graph.one}
        flow |= {self.graph.input(z.func.__name__): self.graph.input(rate_name(z.func.__name__)) for z in self.states}
        for name in (q.func.__name__ for q in self.coordinates):
            rate = self.graph.input(rate_name(name))
            flow |= {self.graph.input(name): rate, rate: self.graph.input(acceleration_input(name))}
        return flow

    def named_values(self) -> dict[str, Node]:
        """Return speeds, inputs, gaps, angles that quaternions stand for, their rates, angular velocities, by name."""
        time, leaves = dynamicsymbols._t, self.expressions.leaves
        found: dict[str, Node] = {u.func.__name__: leaves[u] for u in (*self.scene.speeds, *self.inputs)}
        for contact in self.scene.made_contacts:
            found[f"{contact.name}.gap"] = self.expressions.read(contact.gap, f"gap of contact {contact.name!r}")
        for angle in (angle for item in self.scene.orientations for angle in item.angles):
            name = angle.func.__name__
            found |= {name: leaves[angle], rate_name(name): leaves[sp.Derivative(angle, time)]}
        for item in self.scene.orientations:
            e = [leaves[q] for q in item.quaternion]
            rates = [leaves[sp.Derivative(q, time)] for q in item.quaternion]
            omega = matvec(self.graph, transpose(spin_matrix(e, body=True)), rates)
            found |= {name: 2 * x for name, x in zip(angular_velocity(item), omega, strict=True)}
        return found

    def _leaves(self) -> dict[Any, Node]:
        time = dynamicsymbols._t
        leaves: dict[Any, Node] = {time: self.graph.input(TIME)}
        for q in self.coordinates:
            leaves[q] = self.graph.input(q.func.__name__)
        for q in self.coordinates:
            leaves[sp.Derivative(q, time)] = self.graph.input(rate_name(q.func.__name__))
        for u in self.inputs:
            leaves[u] = self._input(u)
            leaves[sp.Derivative(u, time)] = tangents(self.graph, [leaves[u]], {leaves[time]: self.graph.one})[0]
        for z in self.states:
            leaves[z] = self.graph.input(z.func.__name__)
            leaves[sp.Derivative(z, time)] = self.graph.input(rate_name(z.func.__name__))
        return leaves

    def _impose(self) -> None:
        """Define imposed coordinates and their rates by their expressions."""
        time, leaves = dynamicsymbols._t, self.expressions.leaves
        flow = {leaves[q]: leaves[sp.Derivative(q, time)] for q in self.coordinates} | {leaves[time]: self.graph.one}
        values = [(q, self.expressions.read(e, f"imposed coordinate {q}")) for q, e in self.scene.imposed]
        for q, node in values:
            leaves[q] = node
            leaves[sp.Derivative(q, time)] = tangents(self.graph, [node], flow)[0]

    def _symbols(self, requirements: Sequence[Requirement]) -> SymbolTable:
        """Return the names of the scene; `requirements` are those on inputs."""
        coordinates = tuple(q.func.__name__ for q in self.coordinates)
        rates = tuple(rate_name(name) for name in coordinates)
        parameters = tuple(sorted(self.expressions.parameters))
        unknowns = tuple(self.expressions.unknowns)
        states = tuple(z.func.__name__ for z in self.states)
        inputs = tuple(u.func.__name__ for u in self.inputs)
        names = _Names(coordinates, rates, parameters, unknowns, states, inputs)
        self._refuse_shared_names(names)
        aliases = self._aliases(names)
        entries = (*entries_of(self.graph, self.scene.orientations), *self._starts)
        assumptions = self._assumptions(parameters)
        parameters = (*parameters, *(hidden for name in inputs for hidden in hidden_parameters(name)))
        if decide(self.expressions.conditions):
            parameters = (*parameters, CONDITION_TIME)
        return SymbolTable(
            TIME,
            coordinates,
            rates,
            parameters,
            unknowns,
            aliases,
            entries,
            assumptions,
            self.expressions.timed,
            () if self.expressions.clock is None else tuple(self.expressions.clock.offsets.values()),
            tuple(self._input_symbol(u, requirements) for u in self.inputs),
            states,
            tuple(str(u.func.__name__) for u in controlled_inputs(self.scene) if u in self.states),
        )

    def _refuse_shared_names(self, names: _Names) -> None:
        """Record a fault for every symbol that has the name of a symbol of another kind."""
        coordinates, rates, parameters, unknowns, states, inputs = names
        taken = {TIME: "time", **dict.fromkeys(coordinates, "a coordinate"), **dict.fromkeys(rates, "a rate")}
        taken = dict.fromkeys(states, "a state") | taken
        taken.update(dict.fromkeys(map(rate_name, states), "the rate of a state"))
        taken.update(dict.fromkeys(RESERVED_OUTPUTS, "an output of every model"))
        speeds = [u.func.__name__ for u in self.scene.speeds]
        taken.update(dict.fromkeys(speeds, "a speed"))
        taken.update(dict.fromkeys((name for name in inputs if name not in taken), "an input"))
        kinds: tuple[tuple[str, Sequence[str]], ...] = (
            ("parameter", parameters),
            ("unknown", unknowns),
            ("coordinate", coordinates),
            ("speed", speeds),
            ("input", inputs),
            ("state", states),
        )
        for kind, called in kinds:
            for name in called:
                if name in taken and taken[name] not in (f"a {kind}", f"an {kind}"):
                    meant = " (where time is meant, use dynamicsymbols._t itself)" if name == TIME else ""
                    self.faults.append(f"the {kind} {name!r} has the name of {taken[name]}; rename it{meant}")

    def _aliases(self, names: _Names) -> dict[str, str]:
        """Return the name of every symbol by its name and by the text that it prints as."""
        coordinates, rates, parameters, unknowns, states, inputs = names
        time = dynamicsymbols._t
        aliases = {name: name for name in (*coordinates, *rates, *parameters, *unknowns, TIME)}
        for name in parameters:
            aliases.setdefault(str(self.expressions.parameters[name]), name)  # a Dummy does not print as its name
        for q, name, rate in zip(self.coordinates, coordinates, rates, strict=True):
            aliases[str(q)] = name
            aliases[str(sp.Derivative(q, time))] = rate
            aliases[str(sp.Derivative(q, (time, 2)))] = acceleration_name(name)
        for z, name in zip(self.states, states, strict=True):
            aliases |= {name: name, str(z): name, str(sp.Derivative(z, time)): rate_name(name)}
        for angle in (angle for item in self.scene.orientations for angle in item.angles):
            name = angle.func.__name__
            aliases |= {str(angle): name, str(sp.Derivative(angle, time)): rate_name(name)}
            aliases |= {name: name, rate_name(name): rate_name(name)}
        for u in self.scene.speeds:
            name = u.func.__name__
            aliases |= {str(u): self._names.get(name, name), name: self._names.get(name, name)}
        return aliases | {name: name for name in inputs} | {str(u): u.func.__name__ for u in self.inputs}

    def _input_symbol(self, u: Any, requirements: Sequence[Requirement]) -> InputSymbol:
        """Return an input with the smoothness that its uses require of its values."""
        rate, met, name = sp.Derivative(u, dynamicsymbols._t), self.expressions.met, u.func.__name__
        smoothness, where = (0, f"the rate of {name!r}") if rate in met else (-1, "")
        mask = self.graph.mask(hidden_parameters(name))
        for required, place, nodes, _ in requirements:
            if required < 0 or not any(node.deps & mask for node in nodes):
                continue
            if required > smoothness:
                smoothness, where = required, place
            self._refuse_breaks(u, mask, nodes, place, _JUMPS if required == 0 else _JUMPS + _KINKS)
        return InputSymbol(name, u in met or rate in met, smoothness, where)

    def _refuse_breaks(self, u: Any, mask: int, nodes: Sequence[Node], place: str, breaks: Sequence[str]) -> None:
        """Record a fault where velocities follow a function of an input that breaks between its knots."""
        state = self._mask("coordinates") | self._mask("rates")
        for node in Graph.topological(nodes):
            if node.op in breaks and node.deps & mask and not node.deps & state:
                self.faults.append(
                    f"{place} contains a condition, a kink or a jump of the input {u.func.__name__!r}, where velocities"
                    " would jump at a time that no step ends at: make what is needed of the input an input of its own"
                )
                return

    def _assumptions(self, parameters: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Return the declared assumptions of parameters, coordinates, angles, speeds and states, by name."""
        angles = [angle for item in self.scene.orientations for angle in item.angles]
        moving = [(q.func.__name__, q) for q in (*self.coordinates, *angles, *self.scene.speeds, *self.states)]
        found: dict[str, tuple[str, ...]] = {}
        for name, symbol in [(name, self.expressions.parameters[name]) for name in parameters] + moving:
            if symbol.is_extended_real is False or symbol.is_finite is False:
                self.faults.append(
                    f"{name!r} is declared to be no finite real number; compiled models need finite real numbers: make"
                    " it with real=True"
                )
            told = [next((what for what in kinds if _is(symbol, what)), "") for kinds in (_SIGNS, _WHOLE)]
            if any(told):
                found[name] = tuple(what for what in told if what)
        return found

    def _rates(self) -> list[Node]:
        return [self.graph.input(rate_name(q.func.__name__)) for q in self.coordinates]

    def _mask(self, kind: str) -> int:
        """Return the dependency bits of all coordinates, rates or states, which are known when it is first called."""
        if kind not in self._masks:
            names = [q.func.__name__ for q in (self.states if kind == "states" else self.coordinates)]
            self._masks[kind] = self.graph.mask(names if kind != "rates" else [rate_name(name) for name in names])
        return self._masks[kind]

    def _moving(self) -> int:
        """Return the dependency bits of the inputs that change along a motion: coordinates, rates, states, time."""
        return self._mask("coordinates") | self._mask("rates") | self._mask("states") | self.graph.mask([TIME])
