"""Modules of LLVM assembly: kernels printed for any number of lanes, compiled by llvmlite, and kept on disk.

A kernel becomes ``void name(ptr, ..., ptr out)``, one pointer an argument; element i of an array is
`lanes` doubles at offset i * lanes. Straight-line code needs none of LLVM's optimisation
passes, only its code generator, so compilation is a few tens of milliseconds where numba's front end
needs seconds.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, final

import llvmlite.binding as llvm

from ...frozen import frozen
from ...ir.kernel import Kernel
from ...once import computed_once, once
from ...subset.arguments import OwnedAddress
from ...subset.compiled_subset import NESTED
from ...transforms.kernel_pieces import pieces_of
from ...transforms.taylor.pairs import Pairs
from ..cache import read_kept, write_kept
from ..rendering import render
from .lane_printer import LanePrinter
from .pair_printer import PairPrinter
from .target import Target, memory_of_call, target, vector
from .vector_functions import LIBRARY, prelude_variables

_ENTERED = threading.RLock()
"""Held by the thread that LLVM works for; nothing is waited for under it."""


def assembly(
    kernels: Sequence[tuple[str, Kernel]], lanes: int, *, exact: bool = False, pairs: Pairs | None = None
) -> str:
    """Return a module of LLVM assembly with each kernel under the name given.

    For `exact`, see `LanePrinter`; for `pairs`, which are those of kernels on one lane, `PairPrinter`.
    """
    printed = [kernel_functions(name, kernel, lanes, exact=exact, pairs=pairs) for name, kernel in kernels]
    variables = {
        "prelude": prelude_variables(lanes),
        "kernels": [function for functions in printed for function in functions.straight],
        "stack_alignment": stack_alignment(lanes),
    }
    if not exact or lanes == 1:
        return render("llvm/kernels.ll.j2", variables) + piece_calls(printed)
    used = {line.op for _, kernel in kernels for line in kernel.body if len(line.args) == 1}
    functions = [name for name in LIBRARY if name in used]
    further = {"functions": functions, "vector": vector(lanes), "lane_numbers": list(range(lanes))}
    return render("llvm/kernels_of_library_functions.ll.j2", variables | further) + piece_calls(printed)


@final
@frozen
class KernelFunctions:
    """A kernel as functions: itself or, of a long one, its pieces in `straight` and, in `calls`, what calls them.

    They are the variables of the templates ``llvm/kernel.ll.j2`` and ``llvm/piece_calls.ll.j2``.
    """

    straight: tuple[dict[str, Any], ...]
    calls: dict[str, Any] | None = None


def kernel_functions(
    name: str, kernel: Kernel, lanes: int, *, exact: bool = False, pairs: Pairs | None = None
) -> KernelFunctions:
    """Return the functions of a kernel; one in pieces has no pairs."""

    def function(name: str, kernel: Kernel, places: Sequence[int]) -> dict[str, Any]:
        printer = PairPrinter(pairs) if pairs and not pieces else LanePrinter(lanes, exact=exact)
        for load in kernel.loads:
            printer.load(load.target, load.array, load.index or 0)
        printer.body(kernel.body)
        for place, operand in zip(places, kernel.outputs, strict=True):
            printer.store(operand, place)
        return {"name": name, "arguments": kernel.arguments, "lines": printer.lines}

    pieces, count = pieces_of(kernel)
    own = range(len(kernel.outputs))
    if not pieces:
        return KernelFunctions((function(name, kernel, own),))
    names = [f"{name}.piece{number}" for number in range(len(pieces))]
    straight = [
        function(each, piece.kernel, own if piece is pieces[-1] else piece.places)
        for each, piece in zip(names, pieces, strict=True)
    ]
    targets = [*([_WORK] * (len(pieces) - 1)), "out"]
    called = [{"name": each, "target": target} for each, target in zip(names, targets, strict=True)]
    memory = memory_of_call(8 * lanes * count)
    calls = {"name": name, "arguments": kernel.arguments, "pieces": called, "memory": memory}
    return KernelFunctions(tuple(straight), calls)


_WORK = "n.work"
"""Memory of a call in which pieces pass on values."""


def piece_calls(kernels: Sequence[KernelFunctions]) -> str:
    """Return the functions that call the pieces of long kernels; nothing where there are none."""
    long = [functions.calls for functions in kernels if functions.calls is not None]
    on_heap = any(kernel["memory"]["on_heap"] for kernel in long)
    return render("llvm/piece_calls.ll.j2", {"kernels": long, "on_heap": on_heap}) if long else ""


def stack_alignment(lanes: int) -> int:
    """Return the bytes that keep vectors on the stack from lying across cache lines, which costs a quarter; or 0."""
    return 8 * lanes if lanes > 2 else 0


@once
def _processor() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple()


def _machine(level: int, of: Target) -> Any:
    return _processor().create_target_machine(
        cpu=of.cpu, features=of.features, opt=level, jit=True, reloc="default", codemodel="jitdefault"
    )


_compiler = once(_machine)
"""The machine that modules are compiled on, one for each level: to make it takes as long as a small module."""


Shape = Literal["straight", "once", "long loops", "loops", "branches"]
"""Shape of code: straight-line code; such code that runs once in a while; loops translated from Python, of many rounds;
such loops of a few rounds, or over cases side by side; such code that mostly branches."""

_LONG = 10_000
"""Lines of straight-line code from which on LLVM's code generator has its second lowest level: as fast, and compiled in
a tenth less time. Code that runs once in a while has the lowest: half as fast, and compiled in a tenth of the time."""


def compile_object(source: str, shape: Shape = "straight") -> bytes:
    """Return the object code of a module of LLVM assembly, for this machine.

    Long loops go through all of LLVM's optimisation passes. Others are not unrolled, which would take half of the time
    to compile and gain nothing. Code that mostly branches goes through few passes, except for its functions with
    nested loops: it compiles in half of the time, and is as fast.
    """
    with _ENTERED:
        machine, module = _compiled(source, shape)
        return bytes(machine.emit_object(module))


def instructions(source: str) -> str:
    """Return the assembly of this machine that `compile_object` makes of straight-line code, for inspection."""
    with _ENTERED:
        machine, module = _compiled(source, "straight")
        return str(machine.emit_assembly(module))


def _compiled(source: str, shape: Shape) -> tuple[Any, Any]:
    straight = shape in ("straight", "once")
    level = 2 if not straight or source.count("\n") <= _LONG else 0 if shape == "once" else 1
    machine, module = _compiler(level, target()), llvm.parse_assembly(source)
    module.triple = llvm.get_process_triple()
    module.data_layout = str(machine.target_data)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2 if shape == "long loops" else 1)
    if shape != "long loops":
        options.loop_unrolling = options.loop_interleaving = options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    optimised = shape in ("long loops", "loops")
    passes = builder.getModulePassManager() if optimised else llvm.create_new_module_pass_manager()
    if not optimised:
        passes.add_always_inliner_pass()  # straight-line code needs no more
    if shape == "branches":
        passes.add_sroa_pass()
        passes.add_instruction_combine_pass()
        passes.add_simplify_cfg_pass()
    passes.run(module, builder)
    if shape == "branches":
        _optimise_nested_loops(module, builder)
    return machine, module


def _optimise_nested_loops(module: Any, builder: Any) -> None:
    """Let functions in which a loop is in a loop, such as those that factor matrices, go through more passes."""
    passes = builder.getFunctionPassManager()
    for function in module.functions:
        if any(NESTED.encode() in attribute for attribute in function.attributes):
            passes.run(function, builder)


@final
class LoadedCode:
    """Loaded object code, which lives as long as an address of it."""

    def __init__(self, engine: Any) -> None:
        self._engine = engine
        self._addresses: dict[str, OwnedAddress] = {}

    def address(self, name: str) -> OwnedAddress:
        """Return the address of a function."""
        return computed_once(self._addresses, name, lambda: self._address(name))

    def _address(self, name: str) -> OwnedAddress:
        with _ENTERED:
            return OwnedAddress(self._engine.get_function_address(name), self._engine)


def load_object(*codes: bytes) -> LoadedCode:
    """Return object code made by `compile_object`, ready to be called; several objects may call each other."""
    with _ENTERED:
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine(2, target()))
        for code in codes:
            engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        return LoadedCode(engine)


# Cache of object code on disk.


def object_code(folder: Path | None, name: str, text: Callable[[], str], shape: Shape = "straight") -> bytes:
    """Return object code of a module of assembly: from `folder` where it is there and whole, else compiled and kept.

    The file is named after `name` and the target; with no folder, nothing is kept. See `compile_object` for
    `shape`.
    """
    if folder is None:
        return compile_object(text(), shape)
    key = hashlib.sha256(target().key.encode()).hexdigest()[:16]
    path = folder / f"{name}_{key}.o"
    held = read_kept(path)
    if held is not None:
        return held
    code = compile_object(text(), shape)
    write_kept(path, code)
    return code
