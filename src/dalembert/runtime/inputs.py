"""What users give while a model runs: mappings from names or symbols to numbers, checked as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..codegen.base import FloatArray
from ..errors import InitialStateError, UnknownNameError, ValueInputError, list_names, unknown_name
from ..ir.interpret import ARRAY_OPERATIONS, interpret, interpret_rows
from ..ir.program import Layout, Program

__all__ = ["constants", "initial_rows", "initial_state", "parameter_vector", "prepare_rows", "resolve", "start"]

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


def prepare_rows(program: Program, p: FloatArray) -> FloatArray:
    """Return the constants (k, n_c) of parameters p (k, n_p); what is not finite is left so."""
    with np.errstate(all="ignore"):
        columns = interpret(program.kernel("prepare"), {"p": p.T}, ARRAY_OPERATIONS)
    c = np.empty((len(p), len(columns)))
    for i, column in enumerate(columns):
        c[:, i] = column
    return c


def constants(program: Program, p: FloatArray) -> FloatArray:
    """Return the constants c (n_c,) of parameters p (n_p,).

    Raises
    ------
    ValueInputError
        When an expression of the parameters is not finite at these values.
    """
    c = prepare_rows(program, p.reshape(1, -1))[0]
    if not np.all(np.isfinite(c)):
        given = ", ".join(f"{name} = {value:g}" for name, value in zip(program.layout.parameters, p, strict=True))
        raise ValueInputError(
            f"an expression of the parameters is not finite at {given}: a mass, a length or a moment of inertia"
            " that the scene divides by is zero"
        )
    return c


@final
@dataclass(frozen=True)
class Initial:
    """(q, q_dot) (k, 2 n_q) of k cases; `fault` tells for each whether it contradicts the constraints."""

    x: FloatArray
    fault: NDArray[np.bool_]


@final
class _Constraints:
    """The constraints of a program at one time, for many cases."""

    def __init__(self, program: Program, t: FloatArray, c: FloatArray) -> None:
        self.program, self.t, self.c = program, t, c
        self.size = len(program.layout.coordinates)

    def residual(self, kind: str, x: FloatArray) -> FloatArray:
        name = f"{kind}_residual"
        if name not in self.program:
            return np.empty((len(x), 0))
        return interpret_rows(self.program.kernel(name), self.t, x, self.c)

    def jacobian(self, x: FloatArray) -> FloatArray:
        if "constraint_jacobian" not in self.program:
            return np.empty((len(x), 0, self.size))
        flat = interpret_rows(self.program.kernel("constraint_jacobian"), self.t, x, self.c)
        return flat.reshape(len(x), -1, self.size)

    def excess(self, kind: str, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what each constraint leaves and what it may leave."""
        residual = self.residual(kind, x)
        rows = np.abs(self.jacobian(x)[:, : residual.shape[1]])
        values = x[:, : self.size] if kind == "position" else x[:, self.size :]
        scale = np.einsum("kij,kj->ki", rows, np.abs(values)) + (1.0 if kind == "position" else 0.0)
        return residual, TOLERANCE * np.maximum(scale, 1e-4)


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
    given = {name: np.array([value]) for name, value in values.items()}
    found = initial_rows(program, np.array([t]), given, c.reshape(1, -1))
    if found.fault[0]:
        _refuse(_Constraints(program, np.array([t]), c.reshape(1, -1)), found.x)
    return found.x[0]


def initial_rows(program: Program, t: FloatArray, given: Mapping[str, FloatArray], c: FloatArray) -> Initial:
    """Return consistent states of k cases at times t (k,) with constants c (k, n_c) from values (k,) by name.

    Raises
    ------
    InitialStateError
        When something is neither given nor fixed by a constraint.
    """
    layout = program.layout
    names = (*layout.coordinates, *layout.rates)
    x = np.zeros((len(c), len(names)))
    for i, name in enumerate(names):
        if name in given:
            x[:, i] = given[name]
    constraints = _Constraints(program, t, c)
    open_q = [i for i, name in enumerate(layout.coordinates) if name not in given]
    if open_q:
        _solve_positions(constraints, x, open_q)
    fault = _contradicted(constraints, "position", x)
    open_v = [i for i, name in enumerate(layout.rates) if name not in given]
    if open_v:
        _solve_velocities(constraints, x, open_v)
    fault |= _contradicted(constraints, "velocity", x)
    _settle(constraints, x, fault)
    return Initial(x, fault)


def _solve_positions(constraints: _Constraints, x: FloatArray, missing: list[int]) -> None:
    """Solve the holonomic constraints for missing coordinates, which they must fix linearly."""
    layout = constraints.program.layout
    rows = constraints.jacobian(x)[:, : layout.holonomic, missing]
    names = [layout.coordinates[i] for i in missing]
    undetermined = _undetermined(rows, names)
    if not undetermined:
        x[:, missing] -= _least(rows, constraints.residual("position", x))
        again = constraints.jacobian(x)[:, : layout.holonomic, missing]
        if not np.allclose(again, rows, rtol=1e-9, equal_nan=True):
            undetermined = names
    if undetermined:
        raise InitialStateError(
            f"initial values are missing for the coordinates {list_names(undetermined)}: no holonomic constraint"
            " gives them uniquely, and nothing defaults to zero"
        )


def _solve_velocities(constraints: _Constraints, x: FloatArray, missing: list[int]) -> None:
    """Solve the velocity constraints for missing rates."""
    layout = constraints.program.layout
    rows = constraints.jacobian(x)[:, :, missing]
    undetermined = _undetermined(rows, [layout.rates[i] for i in missing])
    if undetermined:
        raise InitialStateError(
            f"initial values are missing for the rates {list_names(undetermined)}: the constraints do not fix them"
            " at this configuration, and nothing defaults to zero"
        )
    x[:, [constraints.size + i for i in missing]] -= _least(rows, constraints.residual("velocity", x))


def _least(rows: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the solutions (k, n) of rows (k, m, n) . x = residual (k, m) by least squares; NaN where there are none."""
    if rows.shape[2] == 1:
        column = rows[:, :, 0]
        with np.errstate(all="ignore"):
            return (np.sum(column * residual, axis=1) / np.sum(column * column, axis=1))[:, np.newaxis]
    solution = np.full((rows.shape[0], rows.shape[2]), np.nan)
    good = np.all(np.isfinite(rows), axis=(1, 2)) & np.all(np.isfinite(residual), axis=1)
    solution[good] = np.einsum("kij,kj->ki", np.linalg.pinv(rows[good], rcond=1e-10), residual[good])
    return solution


def _undetermined(columns: FloatArray, names: list[str]) -> list[str]:
    """Return the unknowns that some of the linear systems with these columns (k, m, n) do not determine."""
    if columns.shape[1] == 0 or not np.all(np.isfinite(columns)):
        return names
    if columns.shape[2] == 1:
        return [] if np.all(np.abs(columns[:, :, 0]).max(axis=1) > 1e-10) else names
    _, singular, rows = np.linalg.svd(columns)
    count = rows.shape[-1]
    padded = np.zeros((len(rows), count))
    padded[:, : singular.shape[1]] = singular
    scale = np.maximum(singular.max(axis=1, initial=0.0), 1e-300)
    null = np.where((padded <= 1e-10 * scale[:, np.newaxis])[:, :, np.newaxis], np.abs(rows), 0.0)
    lost = null.max(axis=(0, 1)) > 1e-8
    return [name for name, gone in zip(names, lost, strict=True) if gone]


def _contradicted(constraints: _Constraints, kind: str, x: FloatArray) -> NDArray[np.bool_]:
    residual, tolerance = constraints.excess(kind, x)
    return ~np.all(np.abs(residual) <= tolerance, axis=1)


def _settle(constraints: _Constraints, x: FloatArray, fault: NDArray[np.bool_]) -> None:
    """Move x by the least amount that takes what the tolerance let pass off the constraints."""
    size = constraints.size
    for kind, part in (("position", slice(0, size)), ("velocity", slice(size, None))):
        for _ in range(2):
            residual, tolerance = constraints.excess(kind, x)
            off = ~fault & np.any(np.abs(residual) > 1e-7 * tolerance, axis=1)
            if not np.any(off):
                break
            rows = constraints.jacobian(x)[:, : residual.shape[1]]
            x[off, part] -= _least(rows[off], residual[off])


def _refuse(constraints: _Constraints, x: FloatArray) -> None:
    """Raise for a state that contradicts constraints, naming each with residual and tolerance."""
    labels = constraints.program.layout.constraints
    for kind, what in (("position", "positions"), ("velocity", "rates")):
        residual, tolerance = constraints.excess(kind, x)
        faults = [
            f"{label}: residual {value:.3g}, tolerance {limit:.1e}"
            for label, value, limit in zip(labels, residual[0], tolerance[0], strict=False)
            if not abs(value) <= limit
        ]
        if faults:
            raise InitialStateError(
                f"the initial {what} contradict the constraints:\n  "
                + "\n  ".join(faults)
                + f"\nCorrect them, or leave out {what} that the constraints fix: they are solved for"
            )


def start(program: Program, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return the state y (n_y,) of the formulation at (q, q_dot).

    Raises
    ------
    InitialStateError
        When it is not finite: the coordinates are singular there.
    """
    y = interpret_rows(program.kernel("initial"), np.array([t]), x.reshape(1, -1), c)[0]
    if not np.all(np.isfinite(y)):
        lost = [name for name, value in zip(program.layout.state, y, strict=True) if not np.isfinite(value)]
        raise InitialStateError(
            f"the state cannot be formed at the initial values: {list_names(lost)} is not finite there, because the"
            " coordinates are singular at this configuration. Start elsewhere, or choose other coordinates"
        )
    return y
