"""`SymbolTable`: the names of a scene, which are inputs of the graph, and others that starts may be given in."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import final

from ..errors import InitialStateError, OptionError, list_names
from ..frozen import frozen
from ..ir.node import Node
from ..naming import acceleration_name
from .expressions.elapsed import Offset


@final
@frozen
class Entry:
    """Other values that a start may be given in, such as angles in place of a quaternion.

    Attributes
    ----------
    names : tuple of str
        Names of these values; all of them are needed.
    needs : tuple of str
        Names of other entries that must be given beside them.
    targets : tuple of str
        Coordinates or rates that they determine.
    values : tuple of Node
        Those, in terms of inputs called like the names and coordinates.
    """

    names: tuple[str, ...]
    needs: tuple[str, ...]
    targets: tuple[str, ...]
    values: tuple[Node, ...]


@final
@frozen
class InputSymbol:
    """An input: a given function of time.

    Attributes
    ----------
    name : str
    used : bool
        Whether anything that was read depends on it.
    smoothness : int
        How often its values must have a continuous derivative: -1 where they may jump.
    where : str
        The use that requires it, for messages.
    """

    name: str
    used: bool
    smoothness: int
    where: str


@final
@frozen
class SymbolTable:
    """The names of a scene, in the order of every array.

    Attributes
    ----------
    time : str
        Name of time.
    coordinates, rates, parameters, unknowns : tuple of str
        Their names.
    aliases : mapping of str to str
        Text of a SymPy symbol -> its name, so that symbols serve as keys wherever names do.
    entries : tuple of Entry
        Other values that a start may be given in.
    assumptions : mapping of str to tuple of str
        Name -> what its symbol was declared to be, such as "positive", where that excludes numbers.
    timed : bool
        Whether time itself occurs in the scene or its outputs.
    offsets : tuple of Offset
        Parameters with the values of expressions of time at the start of a run, where time is counted from there.
    inputs : tuple of InputSymbol
        Given functions of time; their parameters (`dalembert.ir.program`) are among the `parameters`.
    states : tuple of str
        Names of the first-order states.
    held : tuple of str
        Names of the inputs that controllers set, which are among the states.
    """

    time: str
    coordinates: tuple[str, ...]
    rates: tuple[str, ...]
    parameters: tuple[str, ...]
    unknowns: tuple[str, ...]
    aliases: Mapping[str, str]
    entries: tuple[Entry, ...] = ()
    assumptions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    timed: bool = False
    offsets: tuple[Offset, ...] = ()
    inputs: tuple[InputSymbol, ...] = ()
    states: tuple[str, ...] = ()
    held: tuple[str, ...] = ()

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(each.name for each in self.inputs)

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of coordinates, rates and first-order states."""
        return (*self.coordinates, *self.rates, *self.states)

    def refuse_ambiguous(self, names: Iterable[str]) -> None:
        """Raise for names of outputs that an acceleration has and something else, too.

        Raises
        ------
        OptionError
        """
        twice = {*self.unknowns, *self.variables, *self.parameters} & set(map(acceleration_name, self.coordinates))
        for name in names:
            if name in twice:
                kind = "a parameter" if name in self.parameters else "a coordinate, a rate, a state or a reaction"
                raise OptionError(
                    f"the output {name!r} has the name of {kind}, and an acceleration is called so, too: give the"
                    " expression that is meant another name, as in outputs={'acceleration': x.diff(t, 2)}"
                )


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
