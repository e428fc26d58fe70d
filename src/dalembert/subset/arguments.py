"""The boundary between Python and compiled loops: typed arguments, addresses, and what keeps these valid.

A loop takes one NamedTuple, whose fields are annotated with the types below, with ``int``, ``float`` and ``bool``, with
further NamedTuples, and with classes derived from `Record`. Everything else follows from the annotations: the types
that the translator works with (`kind_of`), the words that the machine code reads (`dalembert.subset.packing`), and
where among these a field is (`place_of`).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from functools import cache
from typing import Annotated, Any, ClassVar, NoReturn, final, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from .compiled_subset import (
    ADDRESS,
    ADDRESS_VECTOR,
    FLAG,
    FLAG_MATRIX,
    INT_MATRIX,
    INT_VECTOR,
    INTEGER,
    MATRIX,
    NUMBER,
    VECTOR,
    Fields,
    Group,
    Kind,
    Scalar,
)


@final
class OwnedAddress(int):
    """An address, 0 where there is none, and the object that keeps valid what lies there.

    Machine code is unloaded with its owner, and the address may then belong to other code. Arguments of loops therefore
    take no bare integers for addresses (`dalembert.subset.packing.pack`).

    Attributes
    ----------
    owner : object
        The engine that has loaded the code, the callback of a Python function, or an array.
    """

    owner: object

    def __new__(cls, address: int, owner: object) -> OwnedAddress:
        """Return the address with its owner."""
        found = super().__new__(cls, address)
        found.owner = owner
        return found

    def function(self, prototype: Any) -> Any:
        """Return the code as a function of ctypes, which owns it."""
        found = prototype(self)
        found.owner = self.owner
        return found

    def __reduce__(self) -> NoReturn:
        raise TypeError("an address is that of one process: it is neither pickled nor copied")


NO_CODE = OwnedAddress(0, None)
"""In place of code that there is not."""


@final
class AddressTable:
    """Addresses that loops read by number, and what keeps them valid.

    Attributes
    ----------
    words : ndarray (n,) of int
        The addresses as loops see them.
    """

    def __init__(self, addresses: Iterable[OwnedAddress] = ()) -> None:
        self._addresses = list(addresses)
        self.words = np.array(self._addresses, np.int64)

    @classmethod
    def zeros(cls, count: int) -> AddressTable:
        """Return a table without code, to be filled in."""
        return cls([NO_CODE] * count)

    @property
    def size(self) -> int:
        """Number of addresses."""
        return len(self._addresses)

    def __getitem__(self, number: int) -> int:
        return self._addresses[number]

    def __setitem__(self, number: int, address: OwnedAddress) -> None:
        self._addresses[number], self.words[number] = address, address


Address = Annotated[OwnedAddress, ADDRESS]
AddressVector = Annotated[AddressTable, ADDRESS_VECTOR]

Vector = Annotated[NDArray[np.float64], VECTOR]
Matrix = Annotated[NDArray[np.float64], MATRIX]
IntVector = Annotated[NDArray[np.int64], INT_VECTOR]
IntMatrix = Annotated[NDArray[np.int64], INT_MATRIX]
FlagMatrix = Annotated[NDArray[np.bool_], FLAG_MATRIX]

_SCALARS: dict[Any, Scalar] = {int: INTEGER, float: NUMBER, bool: FLAG}
_RECORD_FIELDS: dict[Any, Scalar] = {"int": INTEGER, "float": NUMBER, int: INTEGER, float: NUMBER}
DTYPES = {INTEGER: np.dtype(np.int64), NUMBER: np.dtype(np.float64), FLAG: np.dtype(np.bool_)}


class Record:
    """Numbers that a loop reads and changes by name, as ``progress.steps += 1``; a subclass annotates them.

    Python and compiled code work on the same memory: `words` (n,), of which doubles are the bits.
    """

    kind: ClassVar[Fields]

    def __init_subclass__(cls) -> None:
        names = tuple(cls.__annotations__)
        for name in names:
            if cls.__annotations__[name] not in _RECORD_FIELDS:
                raise TypeError(f"{cls.__name__}.{name} must be int or float, as all fields of records are")
        cls.kind = Fields(names, tuple(_RECORD_FIELDS[cls.__annotations__[name]] for name in names))
        for place, (name, item) in enumerate(zip(names, cls.kind.items, strict=True)):
            setattr(cls, name, _integer(place) if item == INTEGER else _double(place))

    def __init__(self, words: NDArray[np.int64] | None = None) -> None:
        self.words = np.zeros(len(self.kind.names), np.int64) if words is None else words
        self.doubles = self.words.view(np.float64)


def _integer(place: int) -> property:
    def get(self: Record) -> int:
        return int(self.words[place])

    def change(self: Record, value: int) -> None:
        self.words[place] = value

    return property(get, change)


def _double(place: int) -> property:
    def get(self: Record) -> np.float64:
        return self.doubles[place]

    def change(self: Record, value: float) -> None:
        self.doubles[place] = value

    return property(get, change)


@cache
def kind_of(annotation: Any) -> Kind:
    """Return the type of an annotation.

    Raises
    ------
    TypeError
        For an annotation that no argument of a compiled loop has.
    """
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    if get_origin(annotation) is Annotated and isinstance(get_args(annotation)[1], Kind):
        return get_args(annotation)[1]
    if inspect.isclass(annotation) and issubclass(annotation, Record):
        return annotation.kind
    if inspect.isclass(annotation) and issubclass(annotation, tuple) and hasattr(annotation, "_fields"):
        hints = get_type_hints(annotation, include_extras=True)
        return Group(tuple(kind_of(hints[name]) for name in annotation._fields), annotation._fields)
    raise TypeError(
        f"{annotation} is not a type of arguments of compiled loops: these are int, float, bool, Address,"
        " AddressVector, Vector, Matrix, IntVector, IntMatrix, FlagMatrix, NamedTuples of these, and records"
    )


@cache
def arguments_of(loop: Callable[[Any], Any]) -> type[tuple[Any, ...]]:
    """Return the NamedTuple that a loop takes.

    Raises
    ------
    TypeError
        Where it does not take one argument annotated so.
    """
    hints, parameters = get_type_hints(loop, include_extras=True), tuple(inspect.signature(loop).parameters)
    if len(parameters) != 1 or not isinstance(kind_of(hints.get(parameters[0])), Group):
        raise TypeError(f"a loop takes one NamedTuple of typed fields, and {loop.__name__}{parameters} does not")
    return hints[parameters[0]]


def place_of(arguments: Any, field: str) -> int:
    """Return the place of a field, as ``"shape.count"``, among the packed words of arguments of a type.

    That of an array is the place of its address, behind which its lengths are; that of a NamedTuple is where it begins.
    """
    kind, place = kind_of(arguments), 0
    for name in field.split("."):
        if not isinstance(kind, Group) or name not in kind.names:
            raise KeyError(f"{arguments.__name__} has no field {field}")
        number = kind.names.index(name)
        place += kind.places[number]
        kind = kind.parts[number]
    return place
