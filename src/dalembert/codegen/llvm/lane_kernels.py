"""Kernels for all lanes at once: advance of time in steps in which nothing else happens, check of initial values."""

from __future__ import annotations

from ...methods.step_constants import SMALLEST_OF_REST, SMALLEST_OF_TIME
from ...once import once
from ...subset.addresses import OwnedAddress
from ..rendering import render
from .assembly import LoadedCode
from .loops import library_code
from .target import bits, constant, suffix, vector


def advance_lanes_assembly(lanes: int) -> str:
    """Return a module that defines ``i64 advance_lanes(ptr clock, ptr step, ptr tally, ptr settings, ptr limits)``.

    It moves the time of every lane whose step was made and neither ends the case nor passes the next time to record,
    counts an attempt, and sets the largest next step. The lanes where more is to be done are left as they are, and
    are the bits of the number that it returns (see `dalembert.loops.lane_loop`).
    """
    variables = {
        "lanes": lanes,
        "third_row": 2 * lanes,
        "vector": vector(lanes),
        "flags": vector(lanes, "i1"),
        "bits": bits(lanes),
        "suffix": suffix(lanes),
        "zero": constant(0.0, lanes),
        "one": constant(1.0, lanes),
        "smallest_of_time": constant(SMALLEST_OF_TIME, lanes),
        "smallest_of_rest": constant(SMALLEST_OF_REST, lanes),
    }
    return render("llvm/advance_lanes.ll.j2", variables)


@once
def _advance_code(lanes: int) -> LoadedCode:
    return library_code(f"advance_lanes_{lanes}", lambda: advance_lanes_assembly(lanes))


def advance_lanes(lanes: int) -> OwnedAddress:
    """Return the code for so many lanes."""
    return _advance_code(lanes).address("advance_lanes")


# Check of the initial values of cases, in all lanes at once.


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
def _check_code(lanes: int) -> LoadedCode:
    return library_code(f"check_inputs_{lanes}", lambda: check_inputs_assembly(lanes))


def check_inputs(lanes: int) -> OwnedAddress:
    """Return the code for so many lanes."""
    return _check_code(lanes).address("check_inputs")
