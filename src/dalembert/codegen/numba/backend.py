"""The numba backend: a generated module of Python, compiled by numba and called by compiled integrator loops.

What numba compiles of a function is taken as object code, which is kept in the checked cache and loaded without numba,
now as in later processes: those that find all of it in the cache do not import numba. A second object has an entry of
the C signature ``void(double *, double *, double *, double *, double *)`` for each function.
"""

from __future__ import annotations

import hashlib
import json
import linecache
import re
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any, final

from ...errors import OptionError
from ...ir.calls import SYMBOL
from ...ir.kernel import Kernel
from ...ir.program import Program
from ...methods.tableau import Tableau
from ...once import once, once_property
from ...transforms.taylor.recurrences import Recurrences
from ..base import Capability
from ..cache import digest_of, load_in_memory, read_kept, write_kept
from ..compiled_backend import CompiledBackend
from ..library import Code, KernelLibrary
from ..llvm.assembly import LoadedCode, compile_object, load_object
from ..llvm.target import target
from . import texts
from .texts import table_definitions

_LIBRARY = frozenset(
    (
        "sin cos tan asin acos atan atan2 exp exp2 ldexp log log2 sinh cosh tanh pow sqrt cbrt floor fma fabs"
        " malloc free calloc memset memcpy"
    ).split()
)
"""Functions of the C library that kernels call, and that LLVM makes of such calls; every process has them."""


@once
def numba_version() -> str:
    """Return the version of numba, without importing it."""
    return version("numba")


def load_functions(folder: Path | None, name: str, text: Callable[[], str], functions: Sequence[str]) -> LoadedCode:
    """Return functions of a module of Python as machine code: from `folder` where it is there, else compiled and kept.

    Parameters
    ----------
    folder : Path or None
        Where code is kept; None keeps nothing.
    name : str
        Of the file, with the target.
    text : function without arguments
        Prints the functions, without the prelude of their module.
    functions : sequence of str
        Which of them are called through addresses: those of the signature of the prelude.
    """
    if folder is None:
        return load_object(*_compiled(text(), functions)[0])
    key = hashlib.sha256(f"{numba_version()} {target().key}".encode()).hexdigest()[:16]
    path = folder / f"{name}_{key}.nbo"
    kept = read_kept(path)
    if kept is not None:
        return load_object(*_unpacked(kept))
    objects, trusted = _compiled(text(), functions)
    if trusted:
        write_kept(path, _packed(objects))
    return load_object(*objects)


def _packed(objects: Sequence[bytes]) -> bytes:
    return b"\n".join([json.dumps([len(code) for code in objects]).encode(), b"".join(objects)])


def _unpacked(data: bytes) -> list[bytes]:
    sizes, rest = data.split(b"\n", 1)
    objects, place = [], 0
    for size in json.loads(sizes):
        objects.append(rest[place : place + size])
        place += size
    return objects


@once
def _prelude() -> dict[str, Any]:
    """Return the definitions of the prelude, made once a process, so that numba compiles its functions once."""
    configure_numba()
    return _executed(texts.prelude(None), {})


def _executed(text: str, names: dict[str, Any]) -> dict[str, Any]:
    """Return the definitions of a text, added to given ones; errors of numba show its lines."""
    filename = f"<dalembert numba {hashlib.sha256(text.encode()).hexdigest()[:16]}>"
    linecache.cache[filename] = (len(text), None, text.splitlines(keepends=True), filename)
    names = dict(names)
    exec(compile(text, filename, "exec"), names)
    return names


def _compiled(text: str, functions: Sequence[str]) -> tuple[list[bytes], bool]:
    """Return the objects of functions and of their entries, and whether they are made for the target."""
    tables = table_definitions(text)
    names = _executed(texts.joined(tables, text) if tables else text, _prelude())

    objects, entries = [], []
    for function in functions:
        found = f"{function}_entry" if f"{function}_entry" in names else function
        kernel = names[found]
        kernel.compile(names["SIGNATURE"])
        (compiled,) = kernel.overloads.values()
        _refuse_other_symbols(function, compiled.library.get_llvm_str())
        objects.append(compiled.library.serialize_using_object_code()[2][0])
        entries.append((function, compiled.fndesc.llvm_func_name))
    objects.append(compile_object(texts.entries(entries)))
    return objects, serves_target()


def _refuse_other_symbols(function: str, assembly: str) -> None:
    """Reject code with symbols that another process may lack: LLVM would end that process."""
    called = set(re.findall(r'^declare[^@]*@"?([^"(]+)', assembly, re.MULTILINE))
    unknown = sorted(name for name in called if name not in _LIBRARY and not name.startswith(("llvm.", SYMBOL)))
    if unknown:
        raise RuntimeError(f"numba's code of {function} calls {', '.join(unknown)}, which it should not")


# The instruction set that numba compiles for.


@once
def configure_numba() -> None:
    """Set the processor of ``DALEMBERT_TARGET`` for numba, unless numba has another setting or has compiled already.

    Raises
    ------
    OptionError
        Where numba's compilation is disabled.
    """
    import numba

    chosen = target()
    if numba.config.DISABLE_JIT:
        raise OptionError(
            'NUMBA_DISABLE_JIT is set, so that numba compiles nothing: unset it, or take backend="numpy", which is'
            " plain Python"
        )
    if numba.config.CPU_NAME is None and chosen.name != "native":
        numba.config.CPU_NAME, numba.config.CPU_FEATURES = chosen.cpu, chosen.features


def serves_target() -> bool:
    """Return whether numba compiles for the processor of `target`, which is in the names of cached files."""
    import numba

    _, processor, _ = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
    return bool(processor == target().cpu)


# Kernels and steps of one program as modules of Python that numba compiles.


@final
class NumbaLibrary(KernelLibrary):
    """Kernels and steps of one program, printed as Python and compiled by numba, one case at a time."""

    @property
    def lanes(self) -> int:
        """See `KernelLibrary.lanes`."""
        return 1

    def source(self, method: str, order: int) -> str:
        """See `KernelLibrary.source`: the module of all kernels of the program, and what the method needs besides."""
        return texts.module(self._program, self._method_texts(method, order))

    def _method_texts(self, method: str, order: int) -> list[str]:
        if method == "taylor":
            return [self._taylor_text(order, 1, True, False)]
        if method == "radau":
            return [self._derivative_text("stages" if "stages" in self._program else "rhs", 1)]
        return []

    @once_property
    def _module(self) -> str:
        return texts.module(self._program)

    @once_property
    def functions(self) -> SimpleNamespace:
        """See `KernelLibrary.functions`."""
        from .kept_kernels import keep_compiled

        configure_numba()
        module = load_in_memory(digest_of("numba", self._module), self._module, named=True)
        kernels = {kernel.name: getattr(module, kernel.name) for kernel in self._program}
        if self.folder is not None:
            for kernel in kernels.values():
                keep_compiled(kernel, self.folder)
        return SimpleNamespace(**kernels)

    def kernel_text(self, name: str, kernel: Kernel, lanes: int, *, exact: bool = False) -> str:
        """See `KernelLibrary.kernel_text`; sines and cosines are always those of the C library."""
        return texts.kernel(name, kernel, lanes)

    def step_text(self, name: str, known: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
        """See `KernelLibrary.step_text`."""
        assert lanes == 1
        return texts.taylor_step(name, known, order, dense=dense)

    def attempt_text(self, tableau: Tableau, lanes: int, *, dense: bool, weighted: bool) -> str:
        """See `KernelLibrary.attempt_text`."""
        assert lanes == 1
        rhs, about = self._program.kernel("rhs"), {"dense": dense, "carried": self.carried, "weighted": weighted}
        return texts.attempt(rhs, tableau, knots=self.knots, **about)

    def _program_text(self, name: str, lanes: int) -> str:
        """See `KernelLibrary._program_text`."""
        assert lanes == 1
        return texts.program_kernel(self._program, name)

    def _load(self, name: str, lanes: int, text: Callable[[], str], functions: tuple[str, ...]) -> Code:
        """See `KernelLibrary._load`."""
        return load_functions(self.folder, f"{name}_{lanes}", text, functions)


@final
class NumbaBackend(CompiledBackend):
    """Kernels that numba compiles, one case at a time, for the same integrator loops as the default backend's."""

    name = "numba"
    largest = 5_000
    capabilities = frozenset({Capability.KERNEL_FUNCTIONS})

    def versions(self) -> str:
        """See `CompiledBackend.versions`."""
        return f"{super().versions()} {numba_version()}"

    def library(self, program: Program, folder: Path | None) -> NumbaLibrary:
        """See `CompiledBackend.library`."""
        return NumbaLibrary(program, folder)
