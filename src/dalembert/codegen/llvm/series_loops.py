"""A Taylor step with its recurrences as loops, for kernels too large to unroll.

The series of every value lies in memory, and one loop over the order runs the recurrences of
`dalembert.transforms.taylor.recurrences` once each; convolutions are calls of one small function. The code grows with
the number of operations alone, not with the order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, final

from ...ir.kernel import Assignment, Operand
from ...transforms.taylor.recurrences import Integrated, Recurrences
from ...transforms.taylor.step import closing_loads, ending
from ..rendering import render
from .lane_printer import LanePrinter
from .target import constant, fma_name, memory_of_call, vector
from .vector_functions import prelude_variables

_PIECE = 100


def series_loop_assembly(name: str, recurrences: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
    """Return a module with one Taylor step, called like `dalembert.transforms.taylor.step.step_kernel`."""
    step = _Step(recurrences, order, lanes, dense)
    return render("llvm/series_loop.ll.j2", {"name": name, **step.variables()})


@final
class _Step:
    """One step function under construction."""

    def __init__(self, recurrences: Recurrences, order: int, lanes: int, dense: bool) -> None:
        self.recurrences, self.order, self.lanes, self.dense = recurrences, order, lanes, dense
        self.v = vector(lanes)
        self.printer = LanePrinter(lanes)
        self.rate = dict(zip(recurrences.states, recurrences.rates, strict=True))
        self.slots: dict[str, int] = {}
        self.slopes: dict[str, int] = {}
        self.fixed: dict[str, int] = {}
        self.near: dict[str, str] = {}
        self.count = self.fresh = 0

    def variables(self) -> dict[str, Any]:
        """Return names, numbers and lines of the step, and of the pieces of the recurrences that it calls."""
        self._assign_slots()
        items = self.recurrences.items
        pieces = [items[first : first + _PIECE] for first in range(0, len(items), _PIECE)]
        return {
            "prelude": prelude_variables(self.lanes),
            "lanes": self.lanes,
            "vector": self.v,
            "fma": fma_name(self.lanes),
            "zero": constant(0.0, self.lanes),
            "order": self.order,
            "memory": memory_of_call((self.count * (self.order + 1) + len(self.fixed)) * 8 * self.lanes),
            "pieces": [
                {
                    "number": number,
                    "beginning": self._function(partial(self._start, piece)),
                    "continuation": self._function(partial(self._extend, piece)),
                }
                for number, piece in enumerate(pieces)
            ],
            "start": self._function(self._open),
            "first_rates": self._lines(self._first_rates),
            "states": self._lines(self._next_states),
            "closing": self._lines(self._close),
        }

    def _function(self, write: Callable[[], None]) -> list[str]:
        """Return the lines of a function that `write` writes, or of its first block."""
        self.printer = LanePrinter(self.lanes)
        return self._lines(write)

    def _lines(self, write: Callable[[], None]) -> list[str]:
        """Return the lines of a block."""
        self.printer.lines, self.near = [], {}
        write()
        return self.printer.lines

    # -- memory ---------------------------------------------------------------------------

    def _assign_slots(self) -> None:
        varying = self.recurrences.varying
        clocks = [load.target for load in self.recurrences.kernel.loads if load.array == "t"]
        names = [*self.recurrences.states, *clocks]
        fixed = [load.target for load in self.recurrences.kernel.loads if load.array not in ("t", "y")]
        for item in self.recurrences.items:
            line = item.value if isinstance(item, Integrated) else item
            (names if line.target in varying else fixed).append(line.target)
            if isinstance(item, Integrated):
                inner = [a for _, a, _ in item.terms if isinstance(a, str) and a not in self.rate]
                self.slopes |= {a: 0 for a in inner}
        self.slots = {name: place for place, name in enumerate(names)}
        self.slopes = {name: len(names) + place for place, name in enumerate(self.slopes)}
        self.count = len(names) + len(self.slopes)
        self.fixed = {name: self.count * (self.order + 1) + place for place, name in enumerate(fixed)}

    def _set(self, target: str, expression: str) -> str:
        self.printer.lines.append(f"%{target} = {expression}")
        return f"%{target}"

    def _fresh(self) -> str:
        self.fresh += 1
        return f"x.{self.fresh}"

    def _at(self, slot: int, index: str, shift: int = 0) -> str:
        """Return the address of coefficient ``index + shift`` of a slot."""
        base = slot * (self.order + 1) + shift
        place = self._set(self._fresh(), f"add i64 {index}, {base}")
        return self._set(self._fresh(), f"getelementptr {self.v}, ptr %n.work, i64 {place}")

    def _load(self, slot: int, index: str, shift: int = 0) -> str:
        return self._set(self._fresh(), f"load {self.v}, ptr {self._at(slot, index, shift)}, align 8")

    def _store(self, value: str, slot: int, index: str, shift: int = 0) -> None:
        self.printer.lines.append(f"store {self.v} {value}, ptr {self._at(slot, index, shift)}, align 8")

    def _value(self, operand: Operand, index: str) -> str:
        """Return coefficient `index` of an operand, above order 0: zero for what does not vary."""
        if isinstance(operand, str) and operand in self.slots:
            return self._load(self.slots[operand], index)
        return constant(0.0, self.lanes)

    def _first(self, operand: Operand) -> str:
        """Return coefficient 0 of an operand, from memory once a block: long-lived values are hard on the compiler."""
        if not isinstance(operand, str):
            return self.printer.operand(operand)
        if operand not in self.near:
            if operand in self.slots:
                self.near[operand] = self._load(self.slots[operand], "0")
            else:
                pointer = self._set(self._fresh(), f"getelementptr {self.v}, ptr %n.work, i64 {self.fixed[operand]}")
                self.near[operand] = self._set(self._fresh(), f"load {self.v}, ptr {pointer}, align 8")
        return self.near[operand]

    def _keep(self, name: str, value: str) -> None:
        """Store coefficient 0 of a value."""
        self.near[name] = value
        if name in self.slots:
            self._store(value, self.slots[name], "0")
        else:
            pointer = self._set(self._fresh(), f"getelementptr {self.v}, ptr %n.work, i64 {self.fixed[name]}")
            self.printer.lines.append(f"store {self.v} {value}, ptr {pointer}, align 8")

    # -- code -----------------------------------------------------------------------------

    def _open(self) -> None:
        """Write coefficients 0 of what is given."""
        for i, state in enumerate(self.recurrences.states):
            self.printer.load(state, "y", i)
            self._keep(state, f"%{state}")
        for load in self.recurrences.kernel.loads:
            if load.array != "y":
                self.printer.load(load.target, load.array, load.index or 0)
                self._keep(load.target, f"%{load.target}")
            if load.array == "t":
                self._clock(load.target)
        for slot in self.slopes.values():
            self._store(constant(0.0, self.lanes), slot, "0")

    def _first_rates(self) -> None:
        """Write coefficients 1 of the state."""
        for state, rate in self.rate.items():
            self._store(self._first(rate), self.slots[state], "1")

    def _next_states(self) -> None:
        """Write coefficients k + 1 of the state."""
        for state, rate in self.rate.items():
            moved = self._set(self._fresh(), f"fdiv {self.v} {self._value(rate, '%n.k')}, %n.up")
            self._store(moved, self.slots[state], "%n.k", 1)

    def _clock(self, name: str) -> None:
        """Store the series of time itself, and of its slope where a function of time is integrated."""
        one, none = (constant(x, self.lanes) for x in (1.0, 0.0))
        for slot in (self.slots[name], *([self.slopes[name]] if name in self.slopes else [])):
            for k in range(1, self.order + 1):
                self._store(one if k == 1 else none, slot, str(k))

    def _start(self, items: Sequence[Assignment | Integrated]) -> None:
        """Write coefficients 0 of some values."""
        for item in items:
            line = item.value if isinstance(item, Integrated) else item
            args = tuple(self._first(a).removeprefix("%") if isinstance(a, str) else a for a in line.args)
            self.printer.line(Assignment(line.target, line.op, args))
            self._keep(line.target, f"%{line.target}")

    def _extend(self, items: Sequence[Assignment | Integrated]) -> None:
        """Write coefficient k of some values."""
        for item in items:
            line = item.value if isinstance(item, Integrated) else item
            if line.target not in self.recurrences.varying:
                continue
            value = self._integral(item) if isinstance(item, Integrated) else self._coefficient(line)
            self._store(value, self.slots[line.target], "%n.k")
            if line.target in self.slopes:
                scaled = self._set(self._fresh(), f"fmul {self.v} {value}, %n.order")
                self._store(scaled, self.slopes[line.target], "%n.k")

    def _dot(self, a: int, b: int, a_shift: int, b_shift: int, count: str) -> str:
        """Return the sum of a[a_shift + j] b[k + b_shift - j] for j below `count`."""
        left, right = self._at(a, "0", a_shift), self._at(b, "%n.k", b_shift)
        return self._set(self._fresh(), f"call {self.v} @convolve(ptr {left}, ptr {right}, i64 {count})")

    def _integral(self, item: Integrated) -> str:
        total = constant(0.0, self.lanes)
        for sign, inner, factor in item.terms:
            if not (isinstance(inner, str) and inner in self.slots) or factor not in self.slots:
                continue
            rate = self.rate.get(inner)
            if rate is None:
                term = self._dot(self.slopes[inner], self.slots[factor], 1, -1, "%n.k")
            elif isinstance(rate, str) and rate in self.slots:
                term = self._dot(self.slots[rate], self.slots[factor], 0, -1, "%n.k")
            else:  # a constant rate: only its first coefficient counts
                last = self._load(self.slots[factor], "%n.k", -1)
                term = self._set(self._fresh(), f"fmul {self.v} {self._first(rate)}, {last}")
            total = self._set(self._fresh(), f"{'fadd' if sign > 0 else 'fsub'} {self.v} {total}, {term}")
        return self._set(self._fresh(), f"fdiv {self.v} {total}, %n.order")

    def _coefficient(self, line: Assignment) -> str:
        v, own = self.v, self.slots[line.target]
        a = line.args[0]
        b: Operand = line.args[1] if len(line.args) > 1 else 0.0

        def varies(x: Operand) -> bool:
            return isinstance(x, str) and x in self.slots

        match line.op:
            case "add" | "sub":
                op = "fadd" if line.op == "add" else "fsub"
                return self._set(self._fresh(), f"{op} {v} {self._value(a, '%n.k')}, {self._value(b, '%n.k')}")
            case "neg":
                return self._set(self._fresh(), f"fneg {v} {self._value(a, '%n.k')}")
            case "mul" if varies(a) and varies(b):
                return self._dot(self.slots[str(a)], self.slots[str(b)], 0, 0, "%n.next")
            case "mul":
                fixed, moving = (a, b) if varies(b) else (b, a)
                return self._set(self._fresh(), f"fmul {v} {self._first(fixed)}, {self._value(moving, '%n.k')}")
            case "div" if varies(b):
                known = self._dot(self.slots[str(b)], own, 1, -1, "%n.k")
                rest = self._set(self._fresh(), f"fsub {v} {self._value(a, '%n.k')}, {known}")
                return self._set(self._fresh(), f"fdiv {v} {rest}, {self._first(b)}")
            case "div":
                return self._set(self._fresh(), f"fdiv {v} {self._value(a, '%n.k')}, {self._first(b)}")
            case "sqrt":
                less = self._set(self._fresh(), "sub i64 %n.k, 1")
                known = self._dot(own, own, 1, -1, less)
                rest = self._set(self._fresh(), f"fsub {v} {self._value(a, '%n.k')}, {known}")
                twice = self._set(self._fresh(), f"fadd {v} {self._first(line.target)}, {self._first(line.target)}")
                return self._set(self._fresh(), f"fdiv {v} {rest}, {twice}")
            case "abs":
                return self._branch("olt", a, 0.0, self._negated(a), self._value(a, "%n.k"))
            case "min" | "max":
                test = "ole" if line.op == "min" else "oge"
                return self._branch(test, a, b, self._value(a, "%n.k"), self._value(b, "%n.k"))
            case "select":
                return self._branch("une", a, 0.0, self._value(b, "%n.k"), self._value(line.args[2], "%n.k"))
            case _:  # sign, floor and comparisons are constant between their jumps
                return constant(0.0, self.lanes)

    def _negated(self, a: Operand) -> str:
        return self._set(self._fresh(), f"fneg {self.v} {self._value(a, '%n.k')}")

    def _branch(self, test: str, a: Operand, b: Operand, yes: str, no: str) -> str:
        """Return one of two coefficients, chosen by the values at order 0."""
        flag = self._set(self._fresh(), f"fcmp {test} {self.v} {self._first(a)}, {self._first(b)}")
        kind = vector(self.lanes, "i1")
        return self._set(self._fresh(), f"select {kind} {flag}, {self.v} {yes}, {self.v} {no}")

    def _close(self) -> None:
        """Choose the step, sum the series and write the outputs."""
        states = self.recurrences.states
        for i, state in enumerate(states):
            self.printer.load(f"{state}.old", "y", i)
        for load in closing_loads(self.recurrences):
            self.printer.load(load.target, load.array, load.index or 0)
        for i, rate in enumerate(self.recurrences.rates):
            for k in range(self.order):
                target = f"rate.{i}.{k}"
                if isinstance(rate, str) and rate in self.slots:
                    pointer = self._at(self.slots[rate], str(k))
                    self._set(target, f"load {self.v}, ptr {pointer}, align 8")
                else:
                    value = self._first(rate) if k == 0 else constant(0.0, self.lanes)
                    self._set(target, f"fadd {self.v} {value}, {constant(0.0, self.lanes)}")
        series = [[f"rate.{i}.{k}" for k in range(self.order)] for i in range(len(states))]
        poles = [[f"pole.{i}.{k}" for k in range(self.order)] for i in range(len(self.recurrences.poles))]
        for names, pole in zip(poles, self.recurrences.poles, strict=True):
            for k, name in enumerate(names):
                self._set(name, f"load {self.v}, ptr {self._at(self.slots[pole], str(k))}, align 8")
        watched = [[f"watched.{i}.{k}" for k in range(self.order)] for i in range(len(self.recurrences.watched))]
        for names, value in zip(watched, self.recurrences.watched, strict=True):
            for k, name in enumerate(names):
                self._set(name, f"load {self.v}, ptr {self._at(self.slots[value], str(k))}, align 8")
        body, outputs = ending(self.recurrences, series, poles, self.order, watched)
        old = {state: f"{state}.old" for state in states}
        body = [
            Assignment(x.target, x.op, tuple(old.get(a, a) if isinstance(a, str) else a for a in x.args)) for x in body
        ]
        outputs = [old.get(x, x) if isinstance(x, str) else x for x in outputs]
        for line in body:
            self.printer.line(line)
        for index, operand in enumerate(outputs):
            self.printer.store(operand, index)
        if self.dense:
            for i, state in enumerate(states):
                for k in range(self.order + 1):
                    value = self._load(self.slots[state], str(k))
                    place = len(outputs) + i * (self.order + 1) + k
                    pointer = self._set(self._fresh(), f"getelementptr double, ptr %out, i64 {place * self.lanes}")
                    self.printer.lines.append(f"store {self.v} {value}, ptr {pointer}, align 8")
