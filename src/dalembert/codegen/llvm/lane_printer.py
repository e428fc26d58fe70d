"""Instructions of a kernel as lines of LLVM assembly, for a number of lanes."""

from __future__ import annotations

from collections.abc import Sequence

from ...ir.calls import CALLS, SYMBOL
from ...ir.kernel import Assignment, Operand
from ...ir.tables import table_of
from ..elementary import ELEMENTARY
from .target import constant, fma_name, is_fused, suffix, vector
from .vector_functions import lanewise

# Tables in assembly: the search for a piece, and numbers of pieces in every lane.


def piece_lines(lanes: int, target: str, args: Sequence[str], key: float) -> list[str]:
    """Return lines that set ``%target`` to the number of the piece that an operand lies in."""
    edges = f"ptr @table.{int(key)}.edges, i64 {len(table_of(key).edges)}"
    return [f"%{target} = call {vector(lanes)} @table_piece{lanes}({vector(lanes)} {args[0]}, {edges})"]


def entry_lines(lanes: int, target: str, args: Sequence[str], key: float, row: float) -> list[str]:
    """Return lines that set ``%target`` to a number of a piece."""
    v, integers = vector(lanes), vector(lanes, "i64")
    lines = [
        f"%{target}.place = fptosi {v} {args[0]} to {integers}",
        f"%{target}.at = getelementptr double, ptr @table.{int(key)}.{int(row)}, {integers} %{target}.place",
    ]
    return [*lines, *gathered(lanes, target, f"%{target}.at")]


def gathered(lanes: int, target: str, at: str) -> list[str]:
    """Return lines that load a number in every lane, from addresses."""
    if lanes == 1:
        return [f"%{target} = load double, ptr {at}, align 8"]
    every = f"<{', '.join(['i1 true'] * lanes)}>"
    given = f"{vector(lanes, 'ptr')} {at}, i32 8, {vector(lanes, 'i1')} {every}, {vector(lanes)} undef"
    return [f"%{target} = call {vector(lanes)} @llvm.masked.gather.{suffix(lanes)}.v{lanes}p0({given})"]


_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv", "neg": "fneg"}


def arithmetic(op: str, args: Sequence[str], lanes: int) -> str:
    """Return the instruction of a sum, difference, product, quotient, negation or fused product and sum."""
    v = vector(lanes)
    if op == "fma":
        return f"call {v} @{fma_name(lanes)}({', '.join(f'{v} {arg}' for arg in args)})"
    return f"{_ARITHMETIC[op]} {v} {', '.join(args)}"


class LanePrinter:
    """Prints the body of one kernel for one number of lanes.

    Sines, cosines and other functions are those of lanes, or, where `exact`, those of the C library, as in Python.
    """

    def __init__(self, lanes: int, *, exact: bool = False) -> None:
        self.lanes, self.exact = lanes, exact
        self.v = vector(lanes)
        self.suffix = suffix(lanes)
        self.flag = vector(lanes, "i1")
        self._elementary = () if exact else tuple(name for name in ELEMENTARY if name != "pow" or is_fused())
        self.lines: list[str] = []
        self._sines: dict[Operand, tuple[str, str, int]] = {}
        self._ahead: list[Assignment] = []

    def operand(self, operand: Operand) -> str:
        """Return a value or an exact literal."""
        return f"%{operand}" if isinstance(operand, str) else constant(operand, self.lanes)

    def load(self, target: str, array: str, index: int) -> None:
        """Load element `index` of an argument."""
        offset = index * self.lanes
        self.lines.append(f"%{target}.at = getelementptr double, ptr %{array}, i64 {offset}")
        self.lines.append(f"%{target} = load {self.v}, ptr %{target}.at, align 8")

    def store(self, operand: Operand, index: int) -> None:
        """Store output `index`."""
        self.lines.append(f"%out.{index} = getelementptr double, ptr %out, i64 {index * self.lanes}")
        self.lines.append(f"store {self.v} {self.operand(operand)}, ptr %out.{index}, align 8")

    def line(self, line: Assignment) -> None:
        """Print one operation."""
        v, target, args = self.v, line.target, [self.operand(arg) for arg in line.args]
        typed = ", ".join(f"{v} {arg}" for arg in args)
        match line.op:
            case "add" | "sub" | "mul" | "div" | "neg" | "fma":
                self._set(target, arithmetic(line.op, args, self.lanes))
            case "sqrt" | "floor":
                self._set(target, f"call {v} @llvm.{line.op}.{self.suffix}({typed})")
            case "abs":
                self._set(target, f"call {v} @llvm.fabs.{self.suffix}({typed})")
            case "rough_log2" | "rough_exp2":
                self._set(target, f"call {v} @{line.op}({typed})")
            case "sin" | "cos" if not self.exact:
                self._sincos(line)
            case "min" | "max":
                self._choose(target, "olt" if line.op == "min" else "ogt", args[0], args[1], args[0], args[1])
            case "less" | "less_equal":
                one, none = (constant(x, self.lanes) for x in (1.0, 0.0))
                self._choose(target, "olt" if line.op == "less" else "ole", args[0], args[1], one, none)
            case "select":
                self._choose(target, "une", args[0], constant(0.0, self.lanes), args[1], args[2])
            case "sign":
                zero, one, minus = (constant(x, self.lanes) for x in (0.0, 1.0, -1.0))
                self._choose(f"{target}.up", "ogt", args[0], zero, one, zero)
                self._choose(target, "olt", args[0], zero, minus, f"%{target}.up")
            case "piece":
                self.lines += piece_lines(self.lanes, target, args, float(line.args[1]))
            case "entry":
                self.lines += entry_lines(self.lanes, target, args, float(line.args[1]), float(line.args[2]))
            case op if op in self._elementary:
                self._set(target, f"call {v} @{op}.of{self.lanes}({typed})")
            case op if op in CALLS:
                self.lines += lanewise(f"{SYMBOL}{int(float(line.args[-1]))}", self.lanes, target, args[:-1])
            case _ if self.exact and self.lanes > 1 and len(args) == 1:
                self._set(target, f"call {v} @{line.op}_repeating({typed})")
            case _:
                self.lines += lanewise(line.op, self.lanes, target, args)

    def _set(self, target: str, expression: str) -> None:
        self.lines.append(f"%{target} = {expression}")

    def _choose(self, target: str, test: str, a: str, b: str, yes: str, no: str) -> None:
        self._set(f"{target}.test", f"fcmp {test} {self.v} {a}, {b}")
        self._set(target, f"select {self.flag} %{target}.test, {self.v} {yes}, {self.v} {no}")

    def body(self, lines: Sequence[Assignment]) -> None:
        """Print operations in their order."""
        self._ahead = list(reversed(lines))
        while self._ahead:
            self.line(self._ahead.pop())

    def _sincos(self, line: Assignment) -> None:
        """Compute sine and cosine of an argument together; on one lane also of others that are known by now."""
        if line.args[0] not in self._sines:
            self._angles(line)
        pair, kind, slot = self._sines[line.args[0]]
        half = f"extractvalue {{{kind}, {kind}}} %{pair}, {0 if line.op == 'sin' else 1}"
        if self.lanes > 1:
            self._set(line.target, half)
            return
        self._set(f"{line.target}.pack", half)
        self._set(line.target, f"extractelement {kind} %{line.target}.pack, i32 {slot}")

    def _angles(self, line: Assignment) -> None:
        """Call the function of sine and cosine for the argument of a line.

        On one lane it is that of a pack: beside others an argument costs nothing, and a pack chooses between sine and
        cosine without a branch.
        """
        pair = f"{line.target}.pair"
        if self.lanes > 1:
            self._sines[line.args[0]] = pair, self.v, 0
            self._set(pair, f"call {{{self.v}, {self.v}}} @sincos{self.lanes}({self.v} {self.operand(line.args[0])})")
            return
        later = {other.target for other in self._ahead} | {line.target}
        wanted = [other.args[0] for other in reversed(self._ahead) if other.op in ("sin", "cos")]
        angles = list(dict.fromkeys(a for a in (line.args[0], *wanted) if a not in later and a not in self._sines))[:4]
        lanes = 2 if len(angles) <= 2 else 4
        kind, pack = vector(lanes), "undef"
        for slot in range(lanes):
            angle = angles[min(slot, len(angles) - 1)]
            self._sines.setdefault(angle, (pair, kind, slot))
            self._set(f"{pair}.{slot}", f"insertelement {kind} {pack}, double {self.operand(angle)}, i32 {slot}")
            pack = f"%{pair}.{slot}"
        self._set(pair, f"call {{{kind}, {kind}}} @sincos{lanes}({kind} {pack})")
