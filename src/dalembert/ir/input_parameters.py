"""Hidden parameters of the inputs of a program: each input is a polynomial in time between two knots."""

from __future__ import annotations

__all__ = ["DEGREE", "WIDTH", "coefficient_places", "hidden_parameters"]

DEGREE = 3
"""Degree of the polynomials."""

WIDTH = DEGREE + 2
"""Parameters of one input: the time of its knot, then the coefficients, that of the constant first."""


def hidden_parameters(name: str) -> tuple[str, ...]:
    """Return the names of the parameters of an input.

    With them at k, u_0, u_1, ..., the input is u_0 + u_1 s + u_2 s^2 + ... of s = t - k. Runs set them at every knot,
    so they stand in the constants as they are, and nothing that depends on them is computed once a run.
    """
    return (f"time of the knot of {name}", *(f"coefficient {k} of {name}" for k in range(DEGREE + 1)))


def coefficient_places(parameters: tuple[str, ...], inputs: tuple[str, ...]) -> tuple[int, ...]:
    """Return the place of the first parameter of each input among the parameters, and so among the constants."""
    return tuple(parameters.index(hidden_parameters(name)[0]) for name in inputs)
