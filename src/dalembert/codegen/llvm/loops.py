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
from pathlib import Path
from typing import Any, NoReturn, final

import llvmlite
import numpy as np

from ...errors import OptionError
from ...once import once, once_property
from ...subset.arguments import OwnedAddress, arguments_of, kind_of
from ...subset.compiled_subset import PLAIN_LOOPS, CheckedArray, lanes_of, tell_target
from ...subset.packing import address_of, pack, unpack
from ...version import __version__
from ..cache import digest_of, directory
from ..host_code import host_code
from ..rendering import generator_digest
from .assembly import LoadedCode, Shape, load_object, object_code
from .target import target

DEBUG_VARIABLE = "DALEMBERT_DEBUG"

_PERMANENT: list[LoadedCode] = []
"""Code of no scene, which is never unloaded, whatever caches forget."""


SOURCES: dict[str, tuple[str, str, Shape]] = {
    "block_search": ("events.event_resolution", "LOOP", "branches"),
    "contact_decisions": ("contacts.contact_decisions", "LOOP", "branches"),
    "event_lane_loop": ("loops.lane_loop", "EVENT_LOOP", "branches"),
    "explicit_loop": ("steps.explicit_loop", "LOOP", "loops"),
    "foreign_batch_loop": ("loops.foreign_batch_loop", "LOOP", "loops"),
    "foreign_task": ("loops.foreign_batch_loop", "TASK_LOOP", "loops"),
    "implicit_lane_loop": ("loops.lane_loop", "IMPLICIT_LOOP", "loops"),
    "implicit_loop": ("steps.implicit_loop", "LOOP", "long loops"),
    "kernel_rows": ("steps.row_loops", "ROWS_LOOP", "loops"),
    "lane_loop": ("loops.lane_loop", "LOOP", "loops"),
    "map_loop": ("contacts.phase_maps", "LOOP", "loops"),
    "phase_loop": ("contacts.phase_loop", "LOOP", "loops"),
    "prepared_loop": ("loops.prepared_loop", "LOOP", "loops"),
    "projected_lane_loop": ("loops.lane_loop", "PROJECTED_LOOP", "loops"),
    "rank_screen": ("loops.rank_screen", "LOOP", "loops"),
    "recorded_lane_loop": ("loops.lane_loop", "RECORDED_LOOP", "loops"),
    "sample_projection": ("steps.row_loops", "LOOP", "loops"),
    "sign_screen": ("loops.sign_screen", "LOOP", "loops"),
    "stiffness_screen": ("loops.stiffness_screen", "LOOP", "loops"),
    "stop_event_lane_loop": ("loops.lane_loop", "STOP_EVENT_LOOP", "branches"),
    "stop_lane_loop": ("loops.lane_loop", "STOP_LOOP", "loops"),
    "taylor_loop": ("loops.prepared_loop", "RECORDED_LOOP", "loops"),
}
"""Of each loop by its name: its module, its function there, and the shape of its code.

Those of `implicit_loop` factor matrices, and are long where there are many coordinates.
"""

_ENTRY = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)


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


def library_folder() -> Path:
    """Return the folder of code that is independent of scenes, in the cache."""
    return directory() / f"loops_{digest_of('loops', toolchain(), generator_digest(), '')}"


def library_code(name: str, text: Callable[[], str], shape: Shape = "straight") -> LoadedCode:
    """Return code that is independent of scenes, compiled from a module of assembly once per installation.

    It stays loaded for the life of the process.
    """
    code = load_object(object_code(library_folder(), name, text, shape))
    _PERMANENT.append(code)
    return code


@final
class Loop:
    """The loop of a name (`loop_named`): machine code, or plain Python."""

    def __init__(self, name: str, *, plain: bool = False, lanes: int = 1) -> None:
        self._name, self.plain, self._lanes = name, plain, lanes

    @once_property
    def _function(self) -> Callable[[Any], int | None]:
        module, name, _ = SOURCES[self._name]
        found: Callable[[Any], int | None] = getattr(importlib.import_module(f"dalembert.{module}"), name)
        return found

    @once_property
    def _code(self) -> LoadedCode:
        def text() -> str:
            from ..subset import loop_assembly

            return loop_assembly(self._function, fused=target().fused, lanes=self._lanes)

        lanes = "" if self._lanes == 1 else f"_{self._lanes}"
        return library_code(f"{self._name}{lanes}", text, SOURCES[self._name][2])

    @once_property
    def call(self) -> Any:
        """The function of one pointer to packed arguments; as machine code it releases the interpreter."""
        if self.plain:
            tell_target(fused=target().fused)
            return self._plain
        return self._code.address("entry").function(_ENTRY)

    @once_property
    def entry(self) -> OwnedAddress:
        """Address of that function; other loops call it by `dalembert.subset.compiled_subset.call_test`.

        Machine code that calls a loop which runs as plain Python raises an error (`raise_failure`).
        """
        if not self.plain:
            return self._code.address("entry")
        entry = host_code(self.refuse)
        PLAIN_LOOPS[entry] = self._plain
        return entry

    def refuse(self, *_: int) -> NoReturn:
        """Raise the error of compiled code that calls this loop, which runs as plain Python."""
        raise OptionError(
            f"the loop {self._name} runs as plain Python, which compiled code cannot call: set {DEBUG_VARIABLE} before"
            " the first run of a process, and leave it as it is"
        )

    def _plain(self, pointer: Any) -> int:
        """Run the loop as plain Python, with bounds checks."""
        arguments = arguments_of(self._function)
        address = pointer if isinstance(pointer, int) else pointer.value
        packed_args = (ctypes.c_int64 * len(kind_of(arguments).words)).from_address(address)
        # divisions by zero follow IEEE 754
        with np.errstate(all="ignore"), lanes_of(self._lanes):
            return int(self._function(unpack(arguments, np.array(packed_args), CheckedArray)) or 0)

    def __call__(self, arguments: tuple[Any, ...]) -> int:
        """Call the loop with its NamedTuple of arguments; return its result."""
        packed_args = pack(arguments)
        return int(self.call(address_of(packed_args)))


@once
def loop_named(name: str, lanes: int = 1) -> Loop:
    """Return the loop of a name, one for the process: as plain Python where these are debugged.

    One whose functions are those of `dalembert.subset.compiled_subset.lanes` has so many cases side by side.
    """
    return Loop(name, plain=debugging(), lanes=lanes)


def compiled_entry(name: str) -> OwnedAddress:
    """Return the address of a loop for code outside of this library, which can call machine code alone.

    Raises
    ------
    OptionError
        Where loops run as plain Python.
    """
    loop = loop_named(name)
    if loop.plain:
        loop.refuse()
    return loop.entry
