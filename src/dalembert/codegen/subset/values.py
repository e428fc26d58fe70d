"""Values of a function that is being translated, and the lines of its assembly."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import final

from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Array, Fields, Group, Kind, Scalar

_ORDER = (FLAG, INTEGER, NUMBER)


@final
@dataclass(frozen=True)
class Value:
    """A value: its kind, and the operands that hold its words.

    A NamedTuple of arguments is the address of its words instead, and the number of the first of them: `base` is set.
    """

    kind: Kind
    words: tuple[str, ...]
    base: str = ""
    first: int = 0


def rounded(number: float) -> str:
    """Return an exact literal of a double."""
    return f"0x{struct.unpack('>Q', struct.pack('>d', number))[0]:016X}"


def literal(number: bool | int | float) -> Value:
    """Return a constant."""
    if isinstance(number, bool):
        return Value(FLAG, ("true" if number else "false",))
    return Value(INTEGER, (str(int(number)),)) if isinstance(number, int) else Value(NUMBER, (rounded(number),))


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


class Lines:
    """Lines of one function, and where its variables are kept."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.room: list[str] = []
        self.open = True
        self._count = 0

    def fresh(self) -> str:
        """Return an unused name."""
        self._count += 1
        return f"v{self._count}"

    def set(self, expression: str) -> str:
        """Give an expression a name."""
        name = f"%{self.fresh()}"
        self.lines.append(f"{name} = {expression}")
        return name

    def slot(self, word: str) -> str:
        """Return the address of memory for one word."""
        name = f"%{self.fresh()}"
        self.room.append(f"{name} = alloca {word}")
        return name

    def begin(self, block: str) -> None:
        """Continue in a block; the lines before fall through into it."""
        self.jump(block)
        self.lines.append(f"{block}:")
        self.open = True

    def jump(self, block: str) -> None:
        """End a block, if it is not ended yet."""
        self.end(f"br label %{block}")

    def branch(self, flag: str, yes: str, no: str) -> None:
        """End a block where a flag decides what follows."""
        self.end(f"br i1 {flag}, label %{yes}, label %{no}")

    def end(self, line: str) -> None:
        """End a block, if it is not ended yet."""
        if self.open:
            self.lines.append(line)
        self.open = False

    @contextmanager
    def aside(self) -> Iterator[list[str]]:
        """Collect lines for later."""
        held, self.lines = self.lines, []
        try:
            yield self.lines
        finally:
            self.lines = held

    def converted(self, value: Value, kind: Kind) -> Value:
        """Return a value as one of a kind that holds it; `TypeError` where it does not."""
        if value.kind == kind:
            return value
        if isinstance(kind, Group) and isinstance(value.kind, Group) and len(kind.parts) == len(value.kind.parts):
            pairs = zip(parts(value), kind.parts, strict=True)
            return Value(kind, tuple(word for part, wanted in pairs for word in self.converted(part, wanted).words))
        if unified(value.kind, kind) != kind:
            raise TypeError(f"{value.kind} does not fit into {kind}")
        (word,) = value.words
        if kind == INTEGER:
            return Value(kind, (self.set(f"zext i1 {word} to i64"),))
        if value.kind == INTEGER and word.lstrip("-").isdigit():
            return literal(float(word))
        how = "uitofp i1" if value.kind == FLAG else "sitofp i64"
        return Value(kind, (self.set(f"{how} {word} to double"),))

    def truth(self, value: Value) -> str:
        """Return the flag that says whether a number is not zero."""
        (word,) = value.words
        if value.kind == FLAG:
            return word
        return self.set(
            f"icmp ne i64 {word}, 0" if value.kind == INTEGER else f"fcmp une double {word}, {rounded(0.0)}"
        )

    def place(self, array: Value, index: list[Value]) -> Value:
        """Return the row of an array at an index, or the address of an element where the index is whole.

        The address is a value of the kind of the array without dimensions.
        """
        kind = array.kind
        assert isinstance(kind, Array)
        data, *shape = array.words
        if len(index) > len(shape):
            raise TypeError(f"{len(index)} numbers are too many for {kind}")
        offset = "0"
        for number, length in zip([*index, *[literal(0)] * (len(shape) - len(index))], shape, strict=True):
            if number.kind != INTEGER or number.words[0].startswith("-"):
                raise TypeError("an index is a whole number, and never a negative one")
            before = offset if offset == "0" else self.set(f"mul i64 {offset}, {length}")
            (word,) = number.words
            offset = word if before == "0" else before if word == "0" else self.set(f"add i64 {before}, {word}")
        data = self.set(f"getelementptr {kind.item.stored}, ptr {data}, i64 {offset}")
        return Value(Array(kind.item, len(shape) - len(index)), (data, *shape[len(index) :]))

    def part(self, group: Value, number: int) -> Value:
        """Return a part of a tuple. Those of arguments are read from their words, which never change."""
        assert isinstance(group.kind, Group)
        if not group.base:
            return parts(group)[number]
        kind, first = group.kind.parts[number], group.first + sum(len(kind.words) for kind in group.kind.parts[:number])
        if isinstance(kind, Group):
            return Value(kind, (), group.base, first)
        words = []
        for place, word in enumerate(kind.words, first):
            address = self.set(f"getelementptr i64, ptr {group.base}, i64 {place}")
            stored = "i64" if word == "i1" else word
            read = self.set(f"load {stored}, ptr {address}, !invariant.load !0")
            words.append(self.set(f"trunc i64 {read} to i1") if word == "i1" else read)
        return Value(kind, tuple(words))

    def address(self, group: Value) -> str:
        """Return the address of the words of a NamedTuple of arguments."""
        return self.set(f"getelementptr i64, ptr {group.base}, i64 {group.first}") if group.first else group.base

    def field(self, record: Value, name: str) -> Value:
        """Return the address of a field of a record, as `place` does that of an element."""
        if not isinstance(record.kind, Fields) or name not in record.kind.names:
            raise TypeError(f"there is no {name} that could be read or changed")
        number = record.kind.names.index(name)
        address = self.set(f"getelementptr i64, ptr {record.words[0]}, i64 {number}")
        return Value(Array(record.kind.items[number], 0), (address,))

    def load(self, place: Value) -> Value:
        """Load the value at an address that `place` returned."""
        assert isinstance(place.kind, Array)
        item = place.kind.item
        word = self.set(f"load {item.stored}, ptr {place.words[0]}")
        return Value(item, (self.set(f"icmp ne i8 {word}, 0") if item == FLAG else word,))

    def store(self, value: Value, place: Value) -> None:
        """Store a value at an address that `place` returned."""
        assert isinstance(place.kind, Array)
        item = place.kind.item
        (word,) = self.converted(value, item).words
        word = self.set(f"zext i1 {word} to i8") if item == FLAG else word
        self.lines.append(f"store {item.stored} {word}, ptr {place.words[0]}")
