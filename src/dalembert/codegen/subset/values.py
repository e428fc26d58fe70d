"""Values of a function that is being translated, whatever the target."""

from __future__ import annotations

from typing import final

from ...frozen import frozen
from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Group, Kind, Scalar

_ORDER = (FLAG, INTEGER, NUMBER)


@final
@frozen
class Value:
    """A value: its kind, and the operands that hold its words.

    A NamedTuple of arguments is the address of its words instead, and the number of the first of them: `base` is set.
    """

    kind: Kind
    words: tuple[str, ...]
    base: str = ""
    first: int = 0


def by_reference(kind: Kind) -> bool:
    """Return whether functions take a value as the address of its words: NamedTuples of arguments."""
    return isinstance(kind, Group) and bool(kind.names)


def parts(value: Value) -> list[Value]:
    """Return the values in a tuple."""
    assert isinstance(value.kind, Group) and not value.base
    found, first = [], 0
    for kind in value.kind.parts:
        last = first + len(kind.words)
        found.append(Value(kind, value.words[first:last]))
        first = last
    return found


def unified(a: Kind, b: Kind) -> Kind:
    """Return the kind that holds values of both: doubles hold whole numbers, and these hold flags."""
    if a == b:
        return a
    if isinstance(a, Group) and isinstance(b, Group) and len(a.parts) == len(b.parts):
        return Group(tuple(unified(x, y) for x, y in zip(a.parts, b.parts, strict=True)))
    if isinstance(a, Scalar) and isinstance(b, Scalar):
        return max(a, b, key=_ORDER.index)
    raise TypeError(f"{a} and {b} are not the same kind")
