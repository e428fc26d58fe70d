"""[Kernel] -> [machine code]: kernels printed as LLVM assembly for any number of lanes, and compiled by llvmlite.

A kernel becomes ``void name(ptr, ..., ptr out)``, one pointer an argument; element i of an array is
a pack of `lanes` doubles at offset i * lanes. Straight-line code needs none of LLVM's optimisation
passes, only its code generator, so compilation is a few tens of milliseconds where numba's front end
needs seconds.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, final

import llvmlite.binding as llvm

from ...ir.kernel import Assignment, Kernel, Operand
from ...once import computed_once, once
from . import vector_functions as functions
from .target import target

__all__ = [
    "Compiled",
    "LanePrinter",
    "assembly",
    "compile_object",
    "fma_name",
    "instructions",
    "load_object",
    "native_lanes",
    "prelude",
]

_ENTERED = threading.RLock()
"""Held by the thread that LLVM works for; nothing is waited for under it."""

_LIBRARY = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sinh", "cosh", "tanh", "pow")
_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}


def native_lanes() -> int:
    """Return how many doubles the vector registers of the target hold: 8, 4 or 2."""
    return target().lanes


def fma_name(lanes: int) -> str:
    """Return LLVM's fused multiply-add where the target has one, else its product and sum."""
    return f"llvm.{'fma' if target().fused else 'fmuladd'}.{'f64' if lanes == 1 else f'v{lanes}f64'}"


@final
class LanePrinter:
    """Prints the body of one kernel for one number of lanes.

    Sines and cosines are polynomials, or, where `exact`, those of the C library, as in Python.
    """

    def __init__(self, lanes: int, *, exact: bool = False) -> None:
        self.lanes, self.exact = lanes, exact
        self.v = functions.vector(lanes)
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.flag = functions.vector(lanes, "i1")
        self.fma = fma_name(lanes)
        self.lines: list[str] = []
        self._pairs: dict[Operand, tuple[str, str, int]] = {}
        self._ahead: list[Assignment] = []

    def operand(self, operand: Operand) -> str:
        """Return a value or an exact literal."""
        return f"%{operand}" if isinstance(operand, str) else functions.constant(operand, self.lanes)

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
            case "add" | "sub" | "mul" | "div":
                self._set(target, f"{_ARITHMETIC[line.op]} {v} {args[0]}, {args[1]}")
            case "neg":
                self._set(target, f"fneg {v} {args[0]}")
            case "fma":
                self._set(target, f"call {v} @{self.fma}({typed})")
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
                one, none = (functions.constant(x, self.lanes) for x in (1.0, 0.0))
                self._choose(target, "olt" if line.op == "less" else "ole", args[0], args[1], one, none)
            case "select":
                self._choose(target, "une", args[0], functions.constant(0.0, self.lanes), args[1], args[2])
            case "sign":
                zero, one, minus = (functions.constant(x, self.lanes) for x in (0.0, 1.0, -1.0))
                self._choose(f"{target}.up", "ogt", args[0], zero, one, zero)
                self._choose(target, "olt", args[0], zero, minus, f"%{target}.up")
            case _ if self.exact and self.lanes > 1 and len(args) == 1:
                self._set(target, f"call {v} @{line.op}_repeating({typed})")
            case _:
                self.lines += functions.lanewise(line.op, self.lanes, target, args)

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
        if line.args[0] not in self._pairs:
            self._angles(line)
        pair, kind, slot = self._pairs[line.args[0]]
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
            self._pairs[line.args[0]] = pair, self.v, 0
            self._set(pair, f"call {{{self.v}, {self.v}}} @sincos{self.lanes}({self.v} {self.operand(line.args[0])})")
            return
        later = {other.target for other in self._ahead} | {line.target}
        wanted = [other.args[0] for other in reversed(self._ahead) if other.op in ("sin", "cos")]
        angles = list(dict.fromkeys(a for a in (line.args[0], *wanted) if a not in later and a not in self._pairs))[:4]
        lanes = 2 if len(angles) <= 2 else 4
        kind, pack = functions.vector(lanes), "undef"
        for slot in range(lanes):
            angle = angles[min(slot, len(angles) - 1)]
            self._pairs.setdefault(angle, (pair, kind, slot))
            self._set(f"{pair}.{slot}", f"insertelement {kind} {pack}, double {self.operand(angle)}, i32 {slot}")
            pack = f"%{pair}.{slot}"
        self._set(pair, f"call {{{kind}, {kind}}} @sincos{lanes}({kind} {pack})")


def prelude(lanes: int) -> str:
    """Return declarations and definitions that every module needs."""
    doubles = {name: ", ".join(["double"] * (2 if name in ("atan2", "pow") else 1)) for name in _LIBRARY}
    parts = [f"declare double @{name}({arguments})" for name, arguments in doubles.items()]
    for n in (1, 2, 4, 8) if lanes == 1 else (lanes,):
        v, suffix, fma = functions.vector(n), "f64" if n == 1 else f"v{n}f64", fma_name(n)
        parts += [f"declare {v} @llvm.{name}.{suffix}({v})" for name in ("fabs", "sqrt", "floor")]
        parts.append(f"declare {v} @{fma}({v}, {v}, {v})")
        if n in (2, 4) or lanes > 1:
            parts.append(functions.sincos(n, fma))
    fma = fma_name(lanes)
    return "\n\n".join([*parts, functions.rough_log2(lanes, fma), functions.rough_exp2(lanes, fma)])


def assembly(kernels: Sequence[tuple[str, Kernel]], lanes: int, *, shared: bool = True, exact: bool = False) -> str:
    """Return a module of LLVM assembly with each kernel under the name given.

    Without `shared`, what every module needs is left out; for `exact`, see `LanePrinter`.
    """
    parts = [prelude(lanes)] if shared else [""]
    if exact and lanes > 1:
        used = {line.op for _, kernel in kernels for line in kernel.body if len(line.args) == 1}
        parts += [functions.repeating(name, lanes) for name in _LIBRARY if name in used]
    for name, kernel in kernels:
        printer = LanePrinter(lanes, exact=exact)
        for load in kernel.loads:
            printer.load(load.target, load.array, load.index or 0)
        printer.body(kernel.body)
        for index, operand in enumerate(kernel.outputs):
            printer.store(operand, index)
        arguments = ", ".join(f"ptr noalias nocapture %{a}" for a in (*kernel.arguments, "out"))
        body = "\n".join(f"  {line}" for line in printer.lines)
        parts.append(f"define void @{name}({arguments}) {_aligned_stack(lanes)}nounwind {{\n{body}\n  ret void\n}}")
    return "\n\n".join(parts)


def _aligned_stack(lanes: int) -> str:
    """Return the attribute that keeps packs on the stack from lying across cache lines, which costs a quarter."""
    return f"alignstack({8 * lanes}) " if lanes > 2 else ""


@once
def _processor() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple()


def _machine(level: int) -> Any:
    cpu, features = target().cpu, target().features
    return _processor().create_target_machine(
        cpu=cpu, features=features, opt=level, jit=True, reloc="default", codemodel="jitdefault"
    )


def compile_object(source: str, *, straight: bool = True) -> bytes:
    """Return the object code of a module of LLVM assembly, for this machine.

    Code that is not `straight`, but loops translated from Python, goes through LLVM's optimisation passes.
    """
    with _ENTERED:
        machine, module = _compiled(source, straight)
        return bytes(machine.emit_object(module))


def instructions(source: str) -> str:
    """Return what `compile_object` makes of straight code, as this machine's assembler has it: for those who look."""
    with _ENTERED:
        machine, module = _compiled(source, True)
        return str(machine.emit_assembly(module))


def _compiled(source: str, straight: bool) -> tuple[Any, Any]:
    machine, module = _machine(2), llvm.parse_assembly(source)
    module.triple = llvm.get_process_triple()
    module.data_layout = str(machine.target_data)
    module.verify()
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=0 if straight else 2))
    passes = llvm.create_new_module_pass_manager() if straight else builder.getModulePassManager()
    if straight:  # the code is in the shape that it should have: nothing but inlining is worth its time
        passes.add_always_inliner_pass()
    passes.run(module, builder)
    return machine, module


@final
class Compiled:
    """Loaded object code; addresses are good as long as it lives."""

    def __init__(self, engine: Any) -> None:
        self._engine = engine
        self._addresses: dict[str, int] = {}

    def address(self, name: str) -> int:
        """Return the address of a function."""
        return computed_once(self._addresses, name, lambda: self._address(name))

    def _address(self, name: str) -> int:
        with _ENTERED:
            return int(self._engine.get_function_address(name))


def load_object(*codes: bytes) -> Compiled:
    """Return object code made by `compile_object`, ready to be called; several objects may call each other."""
    with _ENTERED:
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine(2))
        for code in codes:
            engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        return Compiled(engine)
