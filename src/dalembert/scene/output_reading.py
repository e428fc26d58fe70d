"""Reader of requested outputs onto the graph of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import sympy as sp

from ..errors import UnknownNameError, unknown_name
from ..ir.graph import Node
from ..naming import acceleration_input, acceleration_name, rate_name
from .geometry import GeometryReader
from .joints import Place
from .model import Piece, Pieces
from .outputs import Component, NamedOutput
from .symbol_table import SymbolTable
from .symbols import RESERVED_OUTPUTS

__all__ = ["OutputNodes", "names_as_nodes", "read_outputs"]


@final
@dataclass(frozen=True)
class OutputNodes:
    """Outputs that were read, by name: expressions, points and vectors with the number of an axis.

    `chosen` are names that are not the text of what they are, and must not be those of something else.
    """

    values: Mapping[str, Node]
    places: Mapping[str, tuple[int, int]]
    vectors: Mapping[str, tuple[Pieces, int]]
    chosen: tuple[str, ...]


def read_outputs(reader: GeometryReader, outputs: Sequence[Any]) -> OutputNodes:
    """Return requested outputs on the graph, without plain names.

    Second rates may stand in them, so they are read after all that the motion depends on.
    """
    values: dict[str, Node] = {}
    places: dict[str, tuple[int, int]] = {}
    vectors: dict[str, tuple[Pieces, int]] = {}
    for item in outputs:
        name, where = str(item), f"output {item}"
        value = item.value if isinstance(item, NamedOutput) else item
        if isinstance(value, sp.Basic):
            values[name] = reader.expressions.read(value, where, unknowns=True, accelerations=True)
        elif isinstance(value, Place):
            places[name] = reader._point(value.point, where), value.axis
        elif isinstance(value, Component):
            vectors[name] = _pieces(reader, value.vector, where), value.axis
    chosen = tuple(str(item) for item in outputs if isinstance(item, NamedOutput | Place))
    return OutputNodes(values, places, vectors, chosen)


def _pieces(reader: GeometryReader, vector: Any, where: str) -> Pieces:
    """Return a vector, each piece on the frame that it is written on; angles stay as they are."""
    if not all(getattr(matrix, "shape", None) == (3, 1) for matrix, _ in vector.args):
        reader.faults.append(f"{where}: the vector has components that are not numbers")
        return ()
    found = []
    for matrix, frame in vector.args:
        x, y, z = (reader.expressions.read(e, where, unknowns=True, accelerations=True) for e in matrix)
        found.append(Piece(reader._frame(frame, where), (x, y, z)))
    return tuple(found)


def names_as_nodes(reader: GeometryReader, symbols: SymbolTable, outputs: Sequence[Any]) -> dict[str, Node]:
    """Return outputs that are names of the scene, under the names that the user chose for them.

    Raises
    ------
    UnknownNameError
        For a name that the scene does not have.
    OptionError
        For a name that an acceleration has and something else, too.
    """
    named, graph = reader.named_values(), reader.graph
    values = [item.value for item in outputs if isinstance(item, NamedOutput)]
    symbols.refuse_ambiguous([value for value in values if isinstance(value, str)])
    known = {name: name for name in (*symbols.unknowns, *symbols.variables, *RESERVED_OUTPUTS)}
    known |= {name: name for name in map(rate_name, symbols.states)}
    known |= {acceleration_name(name): acceleration_input(name) for name in symbols.coordinates}
    found: dict[str, Node] = {}
    for item in outputs:
        if isinstance(item, NamedOutput) and isinstance(item.value, str):
            name = symbols.aliases.get(item.value, item.value)
            if name in named:
                found[str(item)] = named[name]
            elif name in known or name in symbols.parameters:
                found[str(item)] = graph.input(known.get(name, name))
            else:
                raise UnknownNameError(f"output {str(item)!r}: {unknown_name('name', item.value, [*known, *named])}")
    return found
