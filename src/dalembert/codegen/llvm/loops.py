"""Integrator loops as machine code, made once per installation and called without numba.

A loop is Python that `dalembert.codegen.subset` translates; the code is kept as an object file. With
``DALEMBERT_DEBUG=1`` in the environment loops run as the Python that they are, with bounds checks: slow, and with the
same results to the last bit.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from collections.abc import Callable
from typing import Any, final

import llvmlite
import numpy as np

from ...errors import OptionError
from ...integrators.arguments import address_of, arguments_of, kind_of, pack, unpack
from ...integrators.checked_arrays import CheckedArray
from ...integrators.compiled_subset import PLAIN_LOOPS, tell_target
from ...once import once, once_property
from ...version import __version__
from ..cache import digest_of, directory
from ..generator_digest import generator_digest
from .assembly import Compiled, Shape, load_object
from .objects import object_code
from .target import target

__all__ = ["DEBUG_VARIABLE", "Loop", "debugging", "library_code", "loop_named", "toolchain"]

DEBUG_VARIABLE = "DALEMBERT_DEBUG"


@once
def debugging() -> bool:
    """Return whether loops run as plain Python; the answer is kept for the process.

    Raises
    ------
    OptionError
        For a value of the environment variable that means nothing.
    """
    chosen = os.environ.get(DEBUG_VARIABLE, "")
    if chosen not in ("", "0", "1"):
        raise OptionError(f"{DEBUG_VARIABLE} is {chosen!r}: set it to 1 to run loops as plain Python, or leave it out")
    return chosen == "1"


@once
def toolchain() -> str:
    """Return the versions that compiled code depends on; numba keeps its own under its version."""
    python = ".".join(map(str, sys.version_info[:3]))
    return f"{__version__} {python} {llvmlite.__version__}"


def library_code(name: str, text: Callable[[], str], shape: Shape = "straight") -> Compiled:
    """Return code that is independent of scenes, compiled from a module of assembly once per installation."""
    folder = directory() / f"loops_{digest_of('loops', toolchain(), generator_digest(), '')}"
    return load_object(object_code(folder, name, text, shape))


@final
class Loop:
    """The function ``LOOP`` of the module `name` of `dalembert.integrators`."""

    def __init__(self, name: str) -> None:
        self._name = name

    @once_property
    def _function(self) -> Callable[[Any], int | None]:
        return importlib.import_module(f"dalembert.integrators.{self._name}").LOOP

    @once_property
    def _code(self) -> Compiled:
        def text() -> str:
            from ..subset import loop_assembly

            return loop_assembly(self._function, fused=target().fused)

        module = importlib.import_module(self._function.__module__)
        return library_code(self._name, text, "short loops" if getattr(module, "SHORT_LOOPS", False) else "loops")

    @once_property
    def call(self) -> Any:
        """The function of one pointer to packed arguments; as machine code it releases the interpreter."""
        if debugging():
            tell_target(fused=target().fused)
            return self._plain
        return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(self._code.address("entry"))

    @once_property
    def address(self) -> int:
        """Address of that function; other loops call it by `dalembert.integrators.compiled_subset.call_test`."""
        if debugging():
            PLAIN_LOOPS[id(self)] = self._plain
            return id(self)
        return self._code.address("entry")

    def _plain(self, pointer: Any) -> int:
        """Run the loop as plain Python, with bounds checks."""
        arguments = arguments_of(self._function)
        address = pointer if isinstance(pointer, int) else pointer.value
        packed_args = (ctypes.c_int64 * len(kind_of(arguments).words)).from_address(address)
        with np.errstate(all="ignore"):  # divisions by zero follow IEEE 754
            return int(self._function(unpack(arguments, np.array(packed_args), CheckedArray)) or 0)

    def __call__(self, arguments: tuple[Any, ...]) -> int:
        """Call the loop with its NamedTuple of arguments; return its result."""
        packed_args = pack(arguments)
        return int(self.call(address_of(packed_args)))


@once
def loop_named(name: str) -> Loop:
    """Return the loop of a name, one for the process."""
    return Loop(name)
