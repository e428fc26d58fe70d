"""Pairs of operations of a Taylor step, for one instruction on two numbers: [Expansion] -> [pairs of lines].

A step of one case has one number in each register where two have room. Recurrences that have the same form are
therefore taken two at a time, order by order: those of a sine and its cosine, products with equally many terms, sums
without index 0, and the ends of components of the state. What such a pair reads is in one register if it was computed
as a pair; otherwise it is brought together once and read by all sums of later orders. Both members of a pair are
rounded as they are alone, so that the bits of a step do not change.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any, TypeVar, final

from ...ir.kernel import Assignment, Kernel, Operand
from .expansion import Expansion, Series, Sum
from .recurrences import Integrated

Pairs = Mapping[str, tuple[str, str]]
"""The pair that each line belongs to, by its target."""

_PAIRED = ("add", "sub", "mul", "fma", "neg")
"""Operations that go in pairs."""

_SAME, _TOGETHER, _OWN = 1.5, 3.0, 2.0
"""Weights of reasons for a pair: both read the same value, both read the values of one pair, each reads the other."""
_LEAST = 0.5
"""Least sum of weights for a pair of recurrences without sums; with sums, any pair saves more than it costs."""

Key = TypeVar("Key", bound=Hashable)


def pairs_of(expansion: Expansion, kernel: Kernel) -> Pairs:
    """Return pairs of lines of a kernel that was written with an expansion; neither of a pair needs the other."""
    return _Pairing(expansion, kernel).found


@final
class _Pairing:
    """Pairs of one step under construction: first of recurrences, then of the sums that are left, then of the state."""

    def __init__(self, expansion: Expansion, kernel: Kernel) -> None:
        self.expansion = expansion
        self.found: dict[str, tuple[str, str]] = {}
        self._written = {line.target for line in kernel.body}
        self._names = {id(series): name for name, series in (*expansion.slopes.items(), *expansion.series.items())}
        self._mates: dict[Operand, tuple[str, str]] = {}
        orders = range(1, expansion.orders + 1)
        for first, second in self._recurrences():
            for k in orders:
                for one, other in zip(expansion.sums[first], expansion.sums[second], strict=True):
                    self._pair((one, k), (other, k))
                self._pair((first, k), (second, k))
        for s, t in self._sums():
            for k in orders:
                self._pair((s, k), (t, k))
        for first, second in self._states():
            for k in orders:
                self._pair((first, k), (second, k))
            self._pair(first, second)

    def _pair(self, one: Hashable, other: Hashable) -> None:
        """Pair the lines of two parts, where these have the same operations."""
        parts = self.expansion.lines.parts
        first, second = ([line for line in parts.get(key, ()) if self._is_free(line)] for key in (one, other))
        if [line.op for line in first] == [line.op for line in second]:
            for a, b in zip(first, second, strict=True):
                self.found[a.target] = self.found[b.target] = (a.target, b.target)

    def _is_free(self, line: Assignment) -> bool:
        return line.op in _PAIRED and line.target in self._written and line.target not in self.found

    # -- what goes together ---------------------------------------------------------------

    def _recurrences(self) -> list[tuple[str, str]]:
        """Return pairs of values with recurrences of the same form, none of which needs the other in the same order."""
        depth = self._depths()
        forms: dict[tuple[Any, ...], list[tuple[str, Assignment]]] = {}
        for item, line in self.expansion.moving:
            halves = tuple(s.half for s in self.expansion.sums[line.target])
            op = "integral" if isinstance(item, Integrated) else line.op
            forms.setdefault((depth[line.target], op, halves), []).append((line.target, line))
        chosen = []
        for _, some in sorted(forms.items()):
            for (first, _), (second, _) in _matched(some, self._affinity_of_values, _LEAST):
                self._mates[first] = self._mates[second] = (first, second)
                chosen.append((first, second))
        return chosen

    def _depths(self) -> dict[str, int]:
        """Return how many values must be known before each, in the same order."""
        depth: dict[str, int] = {}
        for item, line in self.expansion.moving:
            needed = [inner for _, inner, _ in item.terms] if isinstance(item, Integrated) else line.args
            rates = self.expansion.rate
            before = [0 if a in rates else depth.get(a, 0) for a in needed if isinstance(a, str)]
            depth[line.target] = 1 + max(before, default=0)
        return depth

    def _sums(self) -> list[tuple[Sum, Sum]]:
        """Return pairs of the sums of values that stand alone: what they add up is known before the present order."""
        kinds: dict[tuple[bool, bool], list[Sum]] = {}
        for item, line in self.expansion.moving:
            if line.target not in self._mates:
                for s in self.expansion.sums[line.target]:
                    kinds.setdefault((isinstance(item, Integrated), s.half), []).append(s)
        return [pair for some in kinds.values() for pair in _matched(some, self._affinity_of_sums, 0.0)]

    def _states(self) -> list[tuple[str, str]]:
        """Return pairs of components of the state: first those whose rates are pairs."""
        moving = [(state, rate) for state, rate in self.expansion.rate.items() if isinstance(rate, str)]
        pairs = _matched(moving, lambda a, b: float(self._mates.get(a[1]) == (a[1], b[1])), 0.0)
        return [(first, second) for (first, _), (second, _) in pairs]

    def _affinity_of_values(self, one: tuple[str, Assignment], other: tuple[str, Assignment]) -> float:
        sums = [self.expansion.sums[name] for name, _ in (one, other)]
        if not sums[0]:
            return sum(map(self._affinity, one[1].args, other[1].args)) - 1.0
        own = {one[0], other[0]}
        together = sum(map(self._affinity_of_sums, *sums))
        return _LEAST + together + sum(_OWN for s, t in zip(*sums, strict=True) if own == self._factors(s.b, t.b))

    def _factors(self, *series: Series) -> set[Operand | None]:
        return {self._names.get(id(each)) for each in series}

    def _affinity_of_sums(self, s: Sum, t: Sum) -> float:
        return self._affinity(self._names.get(id(s.a)), self._names.get(id(t.a))) + self._affinity(
            self._names.get(id(s.b)), self._names.get(id(t.b))
        )

    def _affinity(self, a: Operand | None, b: Operand | None) -> float:
        if a == b:
            return _SAME
        mates = self._mates.get(a) if a is not None else None
        return 0.0 if mates is None or mates != self._mates.get(b or 0.0) else _TOGETHER if mates == (a, b) else 1.0


def _matched(some: Sequence[Key], affinity: Callable[[Key, Key], float], least: float) -> Iterable[tuple[Key, Key]]:
    """Return pairs of what has the largest affinity, at least `least`; each goes into one pair at most."""
    places = range(len(some))
    found = [(-affinity(some[i], some[j]), i, j) for i in places for j in places if i != j]
    taken: set[int] = set()
    for counted, i, j in sorted(found):
        if not taken & {i, j} and -counted >= least:
            taken |= {i, j}
            yield some[i], some[j]
