"""Derivatives by values of inputs: the weight of a value as a function of time.

A record of an input is a sum of its values, each times a weight that depends on time alone. The derivative of the input
by one of the values is that weight: an input of its own, whose coefficients are the derivatives of those of the input.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from ..ir.input_parameters import hidden_parameters
from ..scene.symbol_table import SymbolTable

__all__ = ["input_of", "seeds_of", "weight_of", "weights_of", "with_weights"]


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
