"""Advance of time for all lanes at once, for steps without samples, events and ends of cases."""

from __future__ import annotations

from ...integrators.addresses import OwnedAddress
from ...methods.step_constants import SMALLEST_OF_REST, SMALLEST_OF_TIME
from ...once import once
from ..rendering import render
from .assembly import Compiled
from .lane_types import bits, constant, suffix, vector
from .loops import library_code

__all__ = ["advance_lanes", "advance_lanes_assembly"]


def advance_lanes_assembly(lanes: int) -> str:
    """Return a module that defines ``i64 advance_lanes(ptr clock, ptr step, ptr tally, ptr settings, ptr limits)``.

    It moves the time of every lane whose step was made and neither ends the case nor passes the next time to record,
    counts an attempt, and sets the largest next step. The lanes where more is to be done are left as they are, and
    are the bits of the number that it returns (see `dalembert.integrators.lane_loop`).
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
def _code(lanes: int) -> Compiled:
    return library_code(f"advance_lanes_{lanes}", lambda: advance_lanes_assembly(lanes))


def advance_lanes(lanes: int) -> OwnedAddress:
    """Return the code for so many lanes."""
    return _code(lanes).address("advance_lanes")
