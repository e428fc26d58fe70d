"""Alternative initial values of a free orientation: angles and their rates, and the angular velocity."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from ..errors import InitialStateError, list_names
from ..ir.graph import Graph, Node
from ..naming import rate_name
from ..transforms.derivatives import tangents
from ..transforms.linear import matvec
from ..transforms.quaternions import spin_matrix
from .orientation import FreeOrientation
from .symbol_table import Entry

__all__ = ["angular_velocity", "chosen_entries", "entries_of"]


def angular_velocity(orientation: FreeOrientation) -> tuple[str, str, str]:
    """Return the names of the angular velocity of a free orientation, components on its own frame."""
    name = orientation.frame.name
    return f"omega_{name}_x", f"omega_{name}_y", f"omega_{name}_z"


def entries_of(graph: Graph, orientations: Sequence[FreeOrientation]) -> tuple[Entry, ...]:
    """Return the entries of free orientations, positions before rates."""
    positions: list[Entry] = []
    rates: list[Entry] = []
    for orientation in orientations:
        coordinates = tuple(str(e.func.__name__) for e in orientation.quaternion)
        slopes = tuple(map(rate_name, coordinates))
        if orientation.sequence is not None:
            names = tuple(str(a.func.__name__) for a in orientation.angles)
            angles = [graph.input(name) for name in names]
            half = [graph.node(0.5) * angle for angle in angles]
            values = orientation.sequence.quaternion([(graph.cos(a), graph.sin(a)) for a in half])
            moving = {a: graph.input(rate_name(name)) for a, name in zip(angles, names, strict=True)}
            positions.append(Entry(names, (), coordinates, tuple(values)))
            rates.append(Entry(tuple(map(rate_name, names)), names, slopes, tuple(tangents(graph, values, moving))))
        omega = angular_velocity(orientation)
        turning = spin_matrix([graph.input(name) for name in coordinates], body=True)
        spun: list[Node] = [graph.node(0.5) * x for x in matvec(graph, turning, [graph.input(w) for w in omega])]
        rates.append(Entry(omega, (), slopes, tuple(spun)))
    return (*positions, *rates)


def chosen_entries(
    entries: Sequence[Entry], given: Collection[str], solved: Collection[str] = ()
) -> Iterator[tuple[Entry, list[str]]]:
    """Yield the entries that given values use, with those of their names that are left out.

    Names may be left out where constraints can fix them: of entries that determine some of the rates `solved`.

    Raises
    ------
    InitialStateError
        Where values are missing, or given twice.
    """
    entered: set[str] = set()
    for entry in entries:
        there = [name for name in entry.names if name in given]
        if not there:
            continue
        out = [name for name in entry.names if name not in given]
        lacking = [name for name in entry.needs if name not in given]
        if lacking or (out and not {*entry.targets} & {*solved}):
            raise InitialStateError(
                f"initial values are missing for {list_names([*out, *lacking])}: with {list_names(there)}, all of"
                f" {list_names((*entry.names, *entry.needs))} are needed; or give {list_names(entry.targets)} instead"
            )
        twice = [name for name in entry.targets if name in given or name in entered]
        if twice:
            raise InitialStateError(
                f"{list_names(entry.names)} determine {list_names(twice)}, which are given too; give one of the two"
            )
        entered |= {*entry.targets}
        yield entry, out
