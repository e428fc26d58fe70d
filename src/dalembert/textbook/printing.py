"""Printers of the textbook view: dots for rates, no arguments of time."""

from __future__ import annotations

from typing import Any

import sympy as sp
from sympy.physics.vector import Vector
from sympy.physics.vector.printing import VectorLatexPrinter, VectorStrPrinter


def latex(expression: Any) -> str:
    """Return LaTeX of an expression, vector or screw."""
    if hasattr(expression, "geometry"):
        return str(expression._latex())
    return str(VectorLatexPrinter().doprint(_sympy(expression)))


def text(expression: Any) -> str:
    """Return one line of text of an expression or vector; x'' stands for the second rate of x."""
    if hasattr(expression, "geometry"):
        return str(expression)
    if isinstance(expression, sp.Equality):
        return f"{text(expression.lhs)} = {text(expression.rhs)}"
    return str(VectorStrPrinter().doprint(_sympy(expression)))


def _sympy(expression: Any) -> Any:
    return expression if isinstance(expression, Vector) else sp.sympify(expression)
