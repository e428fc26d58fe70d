"""Checks of the values that runs are given for inputs."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import ValueInputError, unknown_name
from ..ir.program import Layout
from ..scene.symbol_table import InputSymbol
from .samples import Samples

__all__ = ["refuse_kind", "refuse_samples", "unknown_input"]


def refuse_samples(symbol: InputSymbol, record: Samples, low: float, high: float) -> None:
    """Refuse samples that are too short for a run between two times, or not smooth enough for where the input stands.

    Raises
    ------
    ValueInputError
    """
    name, knots = symbol.name, f"t = {record.t[0]:g} to {record.t[-1]:g}"
    if not record.reaches(low, high):
        raise ValueInputError(
            f"the samples of input {name!r} are too short: their knots go from {knots}, and the run from t = {low:g} to"
            f" {high:g}. Give samples of the whole span, or extrapolate='hold' or 'linear'"
        )
    if record.smoothness(low, high) >= symbol.smoothness:
        return
    refuse_kind(symbol, record)
    raise ValueInputError(
        f"the samples of input {name!r} continue beyond their knots ({knots}) by extrapolate={record.extrapolate!r},"
        f" where their rate jumps, and {symbol.where} depends on them: velocities would jump. Give samples of the"
        " whole span, or extrapolate='linear'"
    )


def refuse_kind(symbol: InputSymbol, record: Samples) -> None:
    """Refuse samples of a kind that is not smooth enough for where the input stands.

    Raises
    ------
    ValueInputError
    """
    if record.smoothness_inside >= symbol.smoothness:
        return
    enough = "'cubic'" if symbol.smoothness > 0 else "'linear' or 'cubic'"
    what = "jump" if record.kind == "hold" else "have kinks"
    raise ValueInputError(
        f"the samples of input {symbol.name!r} are of kind {record.kind!r}, which {what}, and {symbol.where} depends on"
        f" them: velocities would jump at every knot. Give them with kind={enough}"
    )


def unknown_input(layout: Layout, name: str, key: str, names: Sequence[str]) -> str:
    """Return the message for a key among the inputs that is not an input."""
    if name in layout.held:
        return f"{key!r} is set by a controller of the scene: leave it out of inputs=, or take the controller out"
    if name in layout.parameters:
        return f"{key!r} is a parameter, which is constant: give its value among the parameters, not the inputs"
    if name in layout.initial:
        return (
            f"{key!r} is determined by the motion, and no input: give its value at the start among the initial values"
        )
    if not names:
        return f"unknown input {key!r}: the scene has no inputs; declare given functions of time with scene.add_inputs"
    return unknown_name("input", key, names)
