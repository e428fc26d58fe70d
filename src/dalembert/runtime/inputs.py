"""What users give while a model runs: mappings from names or symbols to numbers, checked as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..codegen.base import FloatArray
from ..errors import InitialStateError, UnknownNameError, ValueInputError, list_names, unknown_name
from ..ir.interpret import interpret
from ..ir.program import Layout, Program

__all__ = ["consistent_state", "constants", "initial_state", "parameter_vector"]

TOLERANCE = 1e-8
"""Relative residual up to which an initial state counts as consistent; what is left is projected away."""


def resolve(kind: str, given: Mapping[Any, Any], known: Iterable[str], aliases: Mapping[str, str]) -> dict[str, float]:
    """Return a mapping of names to floats from one of names or symbols to numbers.

    Raises
    ------
    UnknownNameError
        For keys that are not known, all of them at once, and for a name that is given twice.
    ValueInputError
        For values that are not finite numbers, all of them at once.
    """
    if not isinstance(given, Mapping):
        raise ValueInputError(f"{kind}s must be a mapping of names or symbols to numbers, not {given!r}")
    known = list(known)
    values: dict[str, float] = {}
    unknown, wrong = [], []
    for key, value in given.items():
        name = aliases.get(str(key), str(key))
        if name not in known:
            unknown.append(unknown_name(kind, str(key), known))
        elif name in values:
            unknown.append(f"{kind} {name!r} is given twice")
        try:
            number = float(value)
        except (TypeError, ValueError):
            wrong.append(f"{name} = {value!r} is not a number")
            continue
        if not np.isfinite(number):
            wrong.append(f"{name} = {number!r} is not finite")
        values[name] = number
    if unknown:
        raise UnknownNameError("\n".join(unknown))
    if wrong:
        raise ValueInputError(f"every {kind} must be a finite number: {'; '.join(wrong)}")
    return values


def parameter_vector(layout: Layout, parameters: Mapping[Any, Any]) -> FloatArray:
    """Return p (n_p,) from a mapping of names or symbols to numbers.

    Raises
    ------
    UnknownNameError
        For missing or unknown names.
    ValueInputError
        For values that are not finite numbers.
    """
    values = resolve("parameter", parameters, layout.parameters, layout.aliases)
    missing = [name for name in layout.parameters if name not in values]
    if missing:
        raise UnknownNameError(
            f"missing parameters: {list_names(missing)}. The scene needs: {list_names(layout.parameters)}."
        )
    return np.array([values[name] for name in layout.parameters], dtype=float)


def constants(program: Program, p: FloatArray) -> FloatArray:
    """Return the constants c (n_c,) of parameters p (n_p,).

    Raises
    ------
    ValueInputError
        When an expression of the parameters is not finite at these values.
    """
    try:
        c = np.array(interpret(program.kernel("prepare"), {"p": p.tolist()}), dtype=float)
    except (ValueError, ZeroDivisionError, OverflowError):
        c = np.array([np.nan])
    if not np.all(np.isfinite(c)):
        given = ", ".join(f"{name} = {value:g}" for name, value in zip(program.layout.parameters, p, strict=True))
        raise ValueInputError(
            f"an expression of the parameters is not finite at {given}: a mass, a length or a moment of inertia"
            " that the scene divides by is zero"
        )
    return c


def _run(program: Program, kernel: str, t: float, y: FloatArray, c: FloatArray) -> FloatArray:
    if kernel not in program:
        return np.empty(0)
    try:
        values = interpret(program.kernel(kernel), {"t": t, "y": y.tolist(), "c": c.tolist()})
    except (ValueError, ZeroDivisionError, OverflowError):
        return np.full(len(program.kernel(kernel).outputs), np.nan)
    return np.array(values, dtype=float)


def _jacobian(program: Program, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
    size = len(program.layout.coordinates)
    return _run(program, "constraint_jacobian", t, x, c).reshape(-1, size)


def initial_state(program: Program, t: float, initial: Mapping[Any, Any], c: FloatArray) -> FloatArray:
    """Return a consistent (q, q_dot) (2 n_q,) from what the user gave.

    Coordinates and rates that the constraints fix may be left out and are solved for.

    Raises
    ------
    UnknownNameError, ValueInputError
        For unknown names and values that are not finite numbers.
    InitialStateError
        When something is neither given nor fixed by a constraint, or a constraint is contradicted.
    """
    layout = program.layout
    values = resolve("initial value", initial, (*layout.coordinates, *layout.rates), layout.aliases)
    size = len(layout.coordinates)
    names = (*layout.coordinates, *layout.rates)
    x = np.array([values.get(name, 0.0) for name in names], dtype=float)
    open_q = [i for i, name in enumerate(layout.coordinates) if name not in values]
    if open_q:
        _solve_positions(program, t, x, c, open_q)
    _check(program, t, x, c, "position")
    open_v = [i for i, name in enumerate(layout.rates) if name not in values]
    if open_v:
        _solve_velocities(program, t, x, c, open_v)
    _check(program, t, x, c, "velocity")
    return consistent_state(program, t, x, c, size)


def _solve_positions(program: Program, t: float, x: FloatArray, c: FloatArray, missing: list[int]) -> None:
    """Solve the holonomic constraints for missing coordinates, which they must fix linearly."""
    layout = program.layout
    rows = _jacobian(program, t, x, c)[: layout.holonomic]
    names = [layout.coordinates[i] for i in missing]
    undetermined = _undetermined(rows[:, missing], names)
    if not undetermined:
        residual = _run(program, "position_residual", t, x, c)
        x[missing] -= np.linalg.lstsq(rows[:, missing], residual, rcond=None)[0]
        if not np.allclose(_jacobian(program, t, x, c)[: layout.holonomic, missing], rows[:, missing], rtol=1e-9):
            undetermined = names
    if undetermined:
        raise InitialStateError(
            f"initial values are missing for the coordinates {list_names(undetermined)}: no holonomic constraint"
            " gives them uniquely, and nothing defaults to zero"
        )


def _solve_velocities(program: Program, t: float, x: FloatArray, c: FloatArray, missing: list[int]) -> None:
    """Solve the velocity constraints for missing rates."""
    layout = program.layout
    size = len(layout.coordinates)
    rows = _jacobian(program, t, x, c)
    undetermined = _undetermined(rows[:, missing], [layout.rates[i] for i in missing])
    if undetermined:
        raise InitialStateError(
            f"initial values are missing for the rates {list_names(undetermined)}: the constraints do not fix them"
            " at this configuration, and nothing defaults to zero"
        )
    residual = _run(program, "velocity_residual", t, x, c)
    x[[size + i for i in missing]] -= np.linalg.lstsq(rows[:, missing], residual, rcond=None)[0]


def _undetermined(columns: FloatArray, names: list[str]) -> list[str]:
    """Return the unknowns that a linear system with these columns does not determine."""
    if not len(columns) or not np.all(np.isfinite(columns)):
        return names
    _, singular, rows = np.linalg.svd(columns)
    scale = max(1e-300, float(singular.max(initial=0.0)))
    rank = int(np.sum(singular > 1e-10 * scale))
    null = rows[rank:]
    return [name for i, name in enumerate(names) if np.any(np.abs(null[:, i]) > 1e-8)]


def _check(program: Program, t: float, x: FloatArray, c: FloatArray, kind: str) -> None:
    """Refuse a state that contradicts a constraint, naming each with residual and tolerance."""
    layout = program.layout
    residual = _run(program, f"{kind}_residual", t, x, c)
    if not len(residual):
        return
    size = len(layout.coordinates)
    rows = _jacobian(program, t, x, c)[: len(residual)]
    values = x[:size] if kind == "position" else x[size:]
    scale = 1.0 if kind == "position" else 0.0
    tolerance = TOLERANCE * np.maximum(scale + np.abs(rows) @ np.abs(values), 1e-4)
    faults = [
        f"{label}: residual {value:.3g}, tolerance {limit:.1e}"
        for label, value, limit in zip(layout.constraints, residual, tolerance, strict=False)
        if not abs(value) <= limit
    ]
    if faults:
        what = "positions" if kind == "position" else "rates"
        raise InitialStateError(
            f"the initial {what} contradict the constraints:\n  "
            + "\n  ".join(faults)
            + f"\nCorrect them, or leave out {what} that the constraints fix: they are solved for"
        )


def consistent_state(program: Program, t: float, x: FloatArray, c: FloatArray, size: int) -> FloatArray:
    """Return x moved by the least amount that takes what rounding left off the constraints."""
    x = x.copy()
    for kind, part in (("position", slice(0, size)), ("velocity", slice(size, None))):
        for _ in range(2):
            residual = _run(program, f"{kind}_residual", t, x, c)
            if not len(residual) or not np.any(residual):
                break
            rows = _jacobian(program, t, x, c)[: len(residual)]
            x[part] -= np.linalg.lstsq(rows, residual, rcond=None)[0]
    return x


def start(program: Program, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return the state y (n_y,) of the formulation at (q, q_dot).

    Raises
    ------
    InitialStateError
        When it is not finite: the coordinates are singular there.
    """
    y = _run(program, "initial", t, x, c)
    if not np.all(np.isfinite(y)):
        lost = [name for name, value in zip(program.layout.state, y, strict=True) if not np.isfinite(value)]
        raise InitialStateError(
            f"the state cannot be formed at the initial values: {list_names(lost)} is not finite there, because the"
            " coordinates are singular at this configuration. Start elsewhere, or choose other coordinates"
        )
    return y
