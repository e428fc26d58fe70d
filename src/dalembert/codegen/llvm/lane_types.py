"""LLVM types, literals and intrinsics for a number of lanes."""

from __future__ import annotations

import struct
from typing import Any

from .target import target

__all__ = ["bits", "constant", "fma_name", "integer", "memory_of_call", "native_lanes", "suffix", "vector"]

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


def fma_name(lanes: int) -> str:
    """Return LLVM's fused multiply-add where the target has one, else its product and sum."""
    return f"llvm.{'fma' if target().fused else 'fmuladd'}.{suffix(lanes)}"


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
