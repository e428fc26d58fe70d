"""Check of the initial values of cases, in all lanes at once."""

from __future__ import annotations

from ...integrators.addresses import OwnedAddress
from ...once import once
from ..rendering import render
from .assembly import Compiled
from .lane_types import bits, constant, suffix, vector
from .loops import library_code

__all__ = ["check_inputs", "check_inputs_assembly"]


def check_inputs_assembly(lanes: int) -> str:
    """Return a module that defines ``i64 check_inputs(ptr rows, i64 plain, i64 checks, i64, i64)``.

    The lanes where the first `plain` rows and the `checks` behind them are finite, and in these the magnitude of every
    other number is at most the number in the next row, are the bits of what it returns.
    """
    variables = {
        "lanes": lanes,
        "vector": vector(lanes),
        "flags": vector(lanes, "i1"),
        "bits": bits(lanes),
        "suffix": suffix(lanes),
        "zero": constant(0.0, lanes),
    }
    return render("llvm/check_inputs.ll.j2", variables)


@once
def _code(lanes: int) -> Compiled:
    return library_code(f"check_inputs_{lanes}", lambda: check_inputs_assembly(lanes))


def check_inputs(lanes: int) -> OwnedAddress:
    """Return the code for so many lanes."""
    return _code(lanes).address("check_inputs")
