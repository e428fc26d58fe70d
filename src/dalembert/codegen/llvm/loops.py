"""Integrator loops as machine code, made once per installation and called without numba.

A loop is Python that `dalembert.codegen.subset` translates; the code is kept as an object file.
"""

from __future__ import annotations

import ctypes
import importlib
import sys
from collections.abc import Callable
from typing import Any, final

import llvmlite

from ...integrators.arguments import address_of, pack
from ...once import once, once_property
from ...version import __version__
from ..cache import directory
from ..generator_digest import generator_digest
from ..rendering import digest_of
from .assembly import Compiled, load_object
from .objects import object_code

__all__ = ["Loop", "library_code", "loop_named", "toolchain"]


@once
def toolchain() -> str:
    """Return the versions that compiled code depends on; numba keeps its own under its version."""
    python = ".".join(map(str, sys.version_info[:3]))
    return f"{__version__} {python} {llvmlite.__version__}"


def library_code(name: str, text: Callable[[], str], *, straight: bool = True) -> Compiled:
    """Return code that belongs to no scene, made of a module of assembly once per installation."""
    folder = directory() / f"loops_{digest_of('loops', toolchain(), generator_digest(), '')}"
    return load_object(object_code(folder, name, text, straight=straight))


@final
class Loop:
    """The function ``LOOP`` of ``dalembert.integrators.NAME``."""

    def __init__(self, name: str) -> None:
        self._name = name

    @once_property
    def _code(self) -> Compiled:
        def text() -> str:
            from ..subset import loop_assembly

            module = importlib.import_module(f"dalembert.integrators.{self._name}")
            return loop_assembly(module.LOOP)

        return library_code(self._name, text, straight=False)

    @once_property
    def call(self) -> Any:
        """The function of one pointer to packed arguments; it releases the interpreter while it runs."""
        return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(self._code.address("entry"))

    @property
    def address(self) -> int:
        """Address of that function."""
        return self._code.address("entry")

    def __call__(self, arguments: tuple[Any, ...]) -> int:
        """Return what the loop returns for its NamedTuple of arguments."""
        packed_args = pack(arguments)
        return int(self.call(address_of(packed_args)))


@once
def loop_named(name: str) -> Loop:
    """Return the loop of a name, one for the process."""
    return Loop(name)
