"""Functions of SymPy that can be compiled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef

__all__ = ["DECIDED", "FUNCTIONS", "PULSE_OPERATIONS", "RECIPROCALS", "SUPPORTED", "is_exhaustive"]

FUNCTIONS: dict[Any, str] = {
    sp.sin: "sin",
    sp.cos: "cos",
    sp.tan: "tan",
    sp.asin: "asin",
    sp.acos: "acos",
    sp.atan: "atan",
    sp.atan2: "atan2",
    sp.exp: "exp",
    sp.log: "log",
    sp.sinh: "sinh",
    sp.cosh: "cosh",
    sp.tanh: "tanh",
    sp.Abs: "abs",
    sp.sign: "sign",
    sp.floor: "floor",
}
PULSE_OPERATIONS = ("exp", "tanh", "atan", "sinh", "cosh")
"""Smooth operations that may change within a short time."""
DECIDED = ("abs", "sign", "floor", "min", "max", "less", "less_equal")
"""Operations with kinks or jumps."""
_FURTHER = ["Heaviside", "Max", "Min", "Mod", "Piecewise", "ceiling", "cot", "csc", "sec", "sqrt"]
SUPPORTED = tuple(sorted([f.__name__ for f in FUNCTIONS] + _FURTHER))
"""Names of the functions that can be compiled."""
RECIPROCALS: dict[Any, tuple[str, str]] = {sp.cot: ("cos", "sin"), sp.sec: ("", "cos"), sp.csc: ("", "sin")}
"""Functions that are a quotient of two others: numerator, where it is not one, and denominator."""


def is_exhaustive(conditions: Sequence[Any]) -> bool:
    """Return whether one of some conditions holds for all real values of what occurs in them."""
    whole = sp.Or(*conditions)
    moving = sorted(whole.atoms(AppliedUndef, sp.Derivative), key=sp.default_sort_key, reverse=True)
    for e in (*moving, *sorted(whole.free_symbols, key=sp.default_sort_key)):
        whole = whole.xreplace({e: sp.Dummy(real=True)})
    if len(whole.free_symbols) != 1:
        return sp.simplify(whole) == sp.true
    try:
        return whole.as_set() == sp.S.Reals
    except NotImplementedError:
        return False
