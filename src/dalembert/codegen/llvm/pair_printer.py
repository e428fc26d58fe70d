"""Instructions of a kernel on one lane, where pairs of operations are instructions on two numbers."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from typing import final

from ...ir.kernel import Assignment, Operand
from .lane_printer import LanePrinter, arithmetic
from .target import constant, vector

_V = vector(2)


@final
class PairPrinter(LanePrinter):
    """Prints the body of a kernel, whose `pairs` give the pair that a line belongs to, by its target."""

    def __init__(self, pairs: Mapping[str, tuple[str, str]]) -> None:
        super().__init__(1)
        self._pair_of = pairs
        self._packs: dict[tuple[Operand, Operand], str] = {}
        self._singles: set[str] = set()

    def body(self, lines: Sequence[Assignment]) -> None:
        """Print operations, each after those that it needs; where there is a choice, in their order."""
        self._ahead = list(reversed(in_order(lines, self._pair_of)))
        while self._ahead:
            line = self._ahead.pop()
            if line.target in self._pair_of:
                self._print_pair(line, self._ahead.pop())
            else:
                self.line(line)

    def operand(self, operand: Operand) -> str:
        """See `LanePrinter.operand`: a member of a pair is taken out of it when it is first read alone."""
        if isinstance(operand, str) and operand in self._pair_of and operand not in self._singles:
            self._singles.add(operand)
            pack, lane = self._home(operand)
            self._set(operand, f"extractelement {_V} {pack}, i32 {lane}")
        return super().operand(operand)

    def _print_pair(self, first: Assignment, second: Assignment) -> None:
        packs = [self._pack(a, b) for a, b in zip(first.args, second.args, strict=True)]
        name = f"{first.target}.and.{second.target}"
        self._set(name, arithmetic(first.op, packs, 2))
        self._packs[first.target, second.target] = f"%{name}"

    def _home(self, operand: str) -> tuple[str, int]:
        """Return a register that holds a value, and its place there."""
        if operand in self._pair_of:
            pair = self._pair_of[operand]
            return self._packs[pair], pair.index(operand)
        return self._kept((operand, ""), f"insertelement {_V} undef, double {self.operand(operand)}, i32 0"), 0

    def _pack(self, a: Operand, b: Operand) -> str:
        """Return a register with two values, which later pairs read too."""
        if (a, b) in self._packs:
            return self._packs[a, b]
        if isinstance(a, str) and isinstance(b, str):
            (one, lane), (other, place) = self._home(a), self._home(b)
            order = f"<2 x i32> <i32 {lane}, i32 {2 + place}>"
            return self._kept((a, b), f"shufflevector {_V} {one}, {_V} {other}, {order}")
        both = [constant(x, 1) if not isinstance(x, str) else "undef" for x in (a, b)]
        pack = f"<double {both[0]}, double {both[1]}>"
        if not isinstance(a, str) and not isinstance(b, str):
            return pack
        single, lane = (a, 0) if isinstance(a, str) else (b, 1)
        return self._kept((a, b), f"insertelement {_V} {pack}, double {self.operand(single)}, i32 {lane}")

    def _kept(self, key: tuple[Operand, Operand], expression: str) -> str:
        if key not in self._packs:
            name = f"pack.{len(self._packs)}"
            self._set(name, expression)
            self._packs[key] = f"%{name}"
        return self._packs[key]


def in_order(lines: Sequence[Assignment], pair_of: Mapping[str, tuple[str, str]]) -> list[Assignment]:
    """Return lines such that those of a pair follow each other, and all of them those that they need.

    Raises
    ------
    AssertionError
        Where pairs need each other.
    """
    line_of = {line.target: line for line in lines}
    place = {line.target: i for i, line in enumerate(lines)}
    units: dict[Operand, tuple[str, ...]] = {name: pair_of.get(name, (name,)) for name in line_of}
    missing: dict[tuple[str, ...], int] = {}
    readers: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    for unit in dict.fromkeys(units.values()):
        needed = {units[a] for member in unit for a in line_of[member].args if a in units}
        missing[unit] = len(needed)
        for each in needed:
            readers.setdefault(each, []).append(unit)
    ready = [(place[unit[0]], unit) for unit, count in missing.items() if count == 0]
    heapq.heapify(ready)
    ordered: list[Assignment] = []
    while ready:
        _, unit = heapq.heappop(ready)
        ordered += [line_of[member] for member in unit]
        for reader in readers.get(unit, ()):
            missing[reader] -= 1
            if missing[reader] == 0:
                heapq.heappush(ready, (place[reader[0]], reader))
    assert len(ordered) == len(lines), "pairs of operations need each other"
    return ordered
