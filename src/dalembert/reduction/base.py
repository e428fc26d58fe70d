"""What every formulation gives: `ReducedSystem`, and what they share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

from ..errors import SingularMassMatrixError
from ..ir.graph import Graph, Node
from ..ir.linear import Factorization, Matrix, SingularMatrix, factorize
from ..mechanics.equations import EquationsOfMotion

__all__ = ["Formulation", "Projection", "ReducedSystem", "factorize_inertia"]


@final
@dataclass(frozen=True)
class Projection:
    """Newton corrections onto the constraints: add them to the state. One node a component of the state."""

    position: tuple[Node, ...]
    velocity: tuple[Node, ...]


@final
@dataclass(frozen=True)
class ReducedSystem:
    """A system of ordinary differential equations, y' = rhs(t, y), and what leads from y back to the scene.

    Attributes
    ----------
    formulation : str
        Name of the formulation.
    equations : EquationsOfMotion
        Where it came from.
    state : tuple of str
        Names of the components of y.
    inputs, rhs : tuple of Node
        The components of y and their rates.
    coordinates, rates, accelerations : tuple of Node, length n_q
        q, q_dot and q_ddot in terms of t and y.
    initial : tuple of Node
        y in terms of t, q and q_dot.
    projection : Projection or None
        Corrections after each step, where the formulation needs them.
    outputs : mapping of str to Node
        Requested outputs in terms of t and y.
    undetermined : tuple of str
        Reaction components that the equations do not determine.
    notes : tuple of str
        What was chosen and why, for `explain()`.
    """

    formulation: str
    equations: EquationsOfMotion
    state: tuple[str, ...]
    inputs: tuple[Node, ...]
    rhs: tuple[Node, ...]
    coordinates: tuple[Node, ...]
    rates: tuple[Node, ...]
    accelerations: tuple[Node, ...]
    initial: tuple[Node, ...]
    projection: Projection | None
    outputs: Mapping[str, Node]
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]


class Formulation(ABC):
    """A way to hold the constraints. Adding one is one file and one line in `dalembert.reduction`."""

    name: str

    @abstractmethod
    def reduce(self, equations: EquationsOfMotion, requested: Sequence[str]) -> ReducedSystem:
        """Return the reduced system with the `requested` outputs.

        Raises
        ------
        FormulationError
            When the formulation cannot serve the scene, with the reason.
        """


def factorize_inertia(graph: Graph, matrix: Matrix, names: Sequence[str], scene: str) -> Factorization:
    """Return the factors of a mass matrix; a pivot that is identically zero is an error naming its coordinate."""
    try:
        return factorize(graph, matrix)
    except SingularMatrix as singular:
        raise SingularMassMatrixError(
            f"scene {scene!r}: the mass matrix is singular, whatever the state: {names[singular.index]!r} moves no"
            " inertia of its own in a direction that the constraints leave free. Give the bodies it moves mass or"
            " inertia, drop the coordinate, or add the constraint that fixes it"
        ) from None
