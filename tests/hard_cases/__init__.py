"""Motions that are hard to simulate, in the user's language, with reference values and bounds: `CASES`, by name."""

from functools import cache

from hard_cases import balls, bodies, loops, machines, particles, sleigh
from hard_cases.case import HardCase

__all__ = ["CASES", "hard_case"]

CASES = {
    name: builder
    for family in (sleigh, balls, bodies, particles, loops, machines)
    for name, builder in family.CASES.items()
}


@cache
def hard_case(name: str) -> HardCase:
    """Return a case by name, built once."""
    return CASES[name]()
