"""The instruction set and the number of lanes of compiled code, and LLVM types for so many."""

from __future__ import annotations

import os
import platform
import struct
from collections.abc import Mapping
from typing import Any, final

import llvmlite.binding as llvm

from ...errors import OptionError, list_names, unknown_name
from ...frozen import frozen
from ...once import once

ENVIRONMENT_VARIABLE = "DALEMBERT_TARGET"

_NATIVE = "native"
_LEVELS: Mapping[str, tuple[str, ...]] = {
    "x86-64-v2": ("cx16", "popcnt", "sahf", "sse4.1", "sse4.2", "ssse3"),
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"),
    "x86-64-v4": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
}
"""Features that each level of the x86-64 ABI adds to the one before."""

_TUNING = {"x86-64-v4": "-prefer-256-bit"}
"""Features turned off by level: LLVM would prefer registers of four lanes where there are some of eight."""


@final
@frozen
class Target:
    """Processor that code is compiled for.

    Attributes
    ----------
    name : str
        As it is chosen.
    cpu, features : str
        As LLVM has them.
    lanes : int
        Number of doubles in a vector register.
    fused : bool
        Whether there are instructions that round a product and a sum once.
    """

    name: str
    cpu: str
    features: str
    lanes: int
    fused: bool

    @property
    def key(self) -> str:
        """Key of compiled code: the version of LLVM, the instruction set, and how it is used."""
        return f"{llvm.llvm_version_info} {self.name} {self.cpu} {self.features} {self.lanes}"


@once
def available_targets() -> dict[str, Target]:
    """Return the targets of this processor by name, its own last."""
    has = llvm.get_host_cpu_features()
    found: dict[str, Target] = {}
    if platform.machine().lower() in ("x86_64", "amd64"):
        for name, needed in _LEVELS.items():
            if not all(has.get(feature) for feature in needed):
                break
            found[name] = Target(
                name, name, _TUNING.get(name, ""), 2 ** (1 + len(found)), "fma" in needed or bool(found)
            )
    lanes = 8 if has.get("avx512f") else 4 if has.get("avx2") else 2
    fused = bool(has.get("fma", False) or has.get("neon", False))
    found[_NATIVE] = Target(_NATIVE, llvm.get_host_cpu_name(), str(has.flatten()), lanes, fused)
    return found


def target() -> Target:
    """Return the target of this process: ``$DALEMBERT_TARGET``, or the processor's own.

    Raises
    ------
    OptionError
        For a target that does not exist, that this processor lacks, or that is not the one of code compiled before.
    """
    chosen, first = _chosen(), _first_target()
    if chosen != first.name:
        raise OptionError(
            f"{ENVIRONMENT_VARIABLE} is {chosen!r}, but this process has compiled code for {first.name!r} already:"
            " set it before dalembert compiles anything, and start a new process to change it"
        )
    return first


def _chosen() -> str:
    return os.environ.get(ENVIRONMENT_VARIABLE) or _NATIVE


@once
def _first_target() -> Target:
    name, known = _chosen(), available_targets()
    if name not in known:
        if name in _LEVELS:
            raise OptionError(
                f"{ENVIRONMENT_VARIABLE} is {name!r}, which this processor ({llvm.get_host_cpu_name()}) lacks:"
                f" take one of {list_names(known)}, or leave it out for {_NATIVE!r}"
            )
        raise OptionError(f"{ENVIRONMENT_VARIABLE}: {unknown_name('target', name, known)} {_NATIVE!r} is the default.")
    return known[name]


# LLVM types, literals and intrinsics for a number of lanes.

_LARGEST_FRAME = 1 << 16
"""Bytes that a call takes from the stack at most; beyond, the time of malloc is not measurable beside a step."""

_LINE = 64


def native_lanes() -> int:
    """Return how many doubles the vector registers of the target hold: 8, 4 or 2."""
    return target().lanes


def vector(lanes: int, element: str = "double") -> str:
    """Return the type of one element in every lane."""
    return element if lanes == 1 else f"<{lanes} x {element}>"


def bits(lanes: int) -> str:
    """Return the type of a whole number with one bit a lane."""
    return f"i{lanes}"


def suffix(lanes: int) -> str:
    """Return the suffix of the names of intrinsics on doubles in every lane."""
    return "f64" if lanes == 1 else f"v{lanes}f64"


def is_fused() -> bool:
    """Return whether the target rounds a product and a sum once."""
    return target().fused


def fma_name(lanes: int) -> str:
    """Return LLVM's fused multiply-add where the target has one, else its product and sum."""
    return f"llvm.{'fma' if is_fused() else 'fmuladd'}.{suffix(lanes)}"


def constant(value: float, lanes: int) -> str:
    """Return an exact literal in every lane."""
    digits = f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"
    return digits if lanes == 1 else f"<{', '.join(f'double {digits}' for _ in range(lanes))}>"


def integer(value: int, lanes: int) -> str:
    """Return a whole number in every lane."""
    return str(value) if lanes == 1 else f"<{', '.join(f'i64 {value}' for _ in range(lanes))}>"


def memory_of_call(size: int) -> dict[str, Any]:
    """Return the variables of the memory that a call needs, of so many bytes, for ``memory.ll.j2``."""
    on_heap = size > _LARGEST_FRAME
    return {"on_heap": on_heap, "bytes": size + (_LINE if on_heap else 0)}
