"""Initial states: values by name -> the state of the formulation, with checks and errors, also by compiled code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..codegen.engine import Engine
from ..codegen.runs import StartCode
from ..errors import InitialStateError, SingularMassMatrixError, list_names
from ..ir.interpret import interpret
from ..ir.program import DIRECTION, Program
from ..once import once_property
from ..reduction.starting import Start
from .assembly import nearest
from .inputs import parameter_text, vanished_text


def directed(values: Mapping[str, float], t0: float, t1: float) -> Mapping[str, float]:
    """Return initial values by name with the direction of time, where a run from t0 to t1 goes backwards."""
    return values if t1 >= t0 else {**values, DIRECTION: -1.0}


def _started(start: Start, t: float, values: Mapping[str, float], c: FloatArray) -> FloatArray:
    """Return the state at a start, and behind it the pairs of its checks, with constants or parameters c."""
    given = [float(values[name]) for name in start.given]
    return np.array(interpret(start.kernel, {"t": float(t), "y": given, "c": c.tolist()}), dtype=float)


def vanishing_pivots(start: Start, t: float, values: Mapping[str, float], p: FloatArray) -> list[str]:
    """Return the labels of constraints that a formulation divides by something that vanishes at parameters p (n_p,)."""
    out = _started(start, t, values, p)
    return _lost_pivots(start, out[len(out) - 2 * len(start.labels) :].reshape(-1, 2))


def pivots_vanish(program: Program, p: FloatArray, labels: Iterable[str]) -> InitialStateError:
    """Return the error of a formulation that divides constraints by something that vanishes at parameters p."""
    return InitialStateError(
        f"at these parameters ({parameter_text(program, p)}) the constraint {list_names(labels)} follows from the"
        " others, or constrains nothing, or constrains other coordinates than elsewhere, and the formulation"
        f" {program.formulation!r} divides by a coefficient that vanishes there. Use"
        ' formulation="projected", which leaves out dependent constraints, or remove the constraint'
    )


def _lost_pivots(start: Start, checks: FloatArray, of: str = "pivots") -> list[str]:
    rows = zip(start.labels, checks.tolist(), strict=True)
    return [name for (kind, name), (least, pivot) in rows if kind == of and not least <= pivot]


def initial_state(start: Start, t: float, values: Mapping[str, float], c: FloatArray, program: Program) -> FloatArray:
    """Return the state y (n_y,) of the formulation at time t from values by name, which `start` expects.

    Raises
    ------
    InitialStateError
        When a constraint is contradicted, with the nearest consistent state, the state does not reproduce a given
        value, or is not finite there.
    SingularMassMatrixError
        When the parameters make the mass matrix singular.
    """
    size = len(program.layout.state)
    out = _started(start, t, values, c)
    y, checks = out[:size], out[size:].reshape(-1, 2)
    _refuse_missing(start, checks)
    lost = _lost_pivots(start, checks)
    if lost:
        raise pivots_vanish(program, c, lost)
    for name in _lost_pivots(start, checks, "inertia"):
        raise SingularMassMatrixError(
            f"at these parameters ({parameter_text(program, c)}) the mass matrix is singular, up to rounding: {name!r}"
            " moves no inertia of its own in a direction that is left free. Give the bodies it moves mass or inertia,"
            " drop the coordinate, or add the constraint that fixes it"
        )
    faults = _contradictions(start, checks)
    if faults:
        own = {name: value for name, value in values.items() if name != DIRECTION}
        raise InitialStateError(faults + nearest(program, c, t, own))
    if not np.all(np.isfinite(out)):
        raise _not_finite(program, start, y, checks, vanished_text(program, c))
    _refuse_changes(start, checks, values, program, c)
    _refuse_sliding(start, checks, t)
    return y


def _refuse_missing(start: Start, checks: FloatArray) -> None:
    """Raise for coordinates or rates that were left out and that the constraints do not fix."""
    for what in ("coordinates", "rates"):
        rows = zip(start.labels, checks, strict=True)
        loose = [name for (kind, name), (least, pivot) in rows if kind == f"{what} left out" and least > pivot]
        if loose:
            raise InitialStateError(
                f"initial values are missing for the {what} {list_names(loose)}: the constraints do not fix them at"
                " this configuration, and nothing defaults to zero"
            )


def _contradictions(start: Start, checks: FloatArray) -> str:
    """Return the message for positions, or else rates, that contradict the constraints; empty where none do."""
    for what in ("positions", "rates"):
        faults = [
            f"{label}: residual {value:.3g}, tolerance {limit:.1e}"
            for (kind, label), (value, limit) in zip(start.labels, checks, strict=True)
            if kind == what and abs(value) > limit
        ]
        if faults:
            return (
                f"the initial {what} contradict the constraints:\n  "
                + "\n  ".join(faults)
                + f"\nCorrect them, or leave out {what} that the constraints fix: they are solved for"
            )
    return ""


def _not_finite(program: Program, start: Start, y: FloatArray, checks: FloatArray, vanished: str) -> InitialStateError:
    """Return the error for a state, or checks of it, that are not finite; `vanished` are constraints that say why."""
    lost = [name for name, value in zip(program.layout.state, y, strict=True) if not np.isfinite(value)]
    rows = zip(start.labels, checks, strict=True)
    lost = lost or list(dict.fromkeys(label for (_, label), pair in rows if not np.all(np.isfinite(pair))))
    return InitialStateError(
        f"the state cannot be formed at the initial values: {list_names(lost)} is not finite there"
        + (
            f". {vanished}"
            if vanished
            else ", because the coordinates are singular at this configuration, or because the constraints do not fix"
            " there what was left out. Start elsewhere, give every rate, or choose other coordinates"
        )
    )


def _refuse_changes(
    start: Start, checks: FloatArray, values: Mapping[str, float], program: Program, c: FloatArray
) -> None:
    """Raise for given values that the state does not reproduce, although they pass for consistent."""
    rows = list(zip(start.labels, checks.tolist(), strict=True))
    for what in ("coordinates", "rates"):
        changed = [
            f"{name}: {values[name]:.6g} was given, and the constraints make it {values[name] + change:.6g}"
            f" (tolerance {limit:.1e})"
            for (kind, name), (change, limit) in rows
            if kind == f"{what} changed" and abs(change) > limit
        ]
        if changed:
            held = "positions" if what == "coordinates" else "rates"
            left = {label: abs(v) / limit for (kind, label), (v, limit) in rows if kind == held and limit > 0.0}
            worst = max(left, key=lambda label: left[label], default="")
            why = next((pair for (kind, label), pair in rows if kind == held and label == worst), (0.0, 0.0))
            small = f"{worst} fixes them by a small coefficient (residual {why[0]:.3g}, tolerance {why[1]:.1e}).\n"
            remedy = f"Correct the {what}, or leave out those that the constraints fix: they are solved for"
            raise InitialStateError(
                f"the initial {what} are not those of any motion that the constraints allow:\n  "
                + "\n  ".join(changed)
                + f"\n{vanished_text(program, c) or (small if worst else '') + remedy}"
            )


def _refuse_sliding(start: Start, checks: FloatArray, t: float) -> None:
    """Raise for a start at a knot of a table that either side of the knot pushes it back to."""
    rows = zip(start.labels, checks.tolist(), strict=True)
    tables = [name for (kind, name), (slides, _) in rows if kind == "sliding" and slides]
    if tables:
        raise InitialStateError(
            f"at the start, t = {t:.9g}, the argument of the table {list_names(map(repr, tables))} is at a knot where"
            " the table jumps, and on either side of it the motion goes back to the knot: it would slide along it,"
            ' which no step can follow. Use kind="linear" with two knots close together instead of the jump, model'
            " dry friction with da.CoulombFriction, or start elsewhere"
        )


_INTERPRETED = 16
"""Runs that are interpreted first: a few do not wait until code is compiled, which takes some 20 ms."""


@final
class QuickStart:
    """Starts from values of the same names, which take the checks of the ordinary start.

    Parameters
    ----------
    engine : Engine
        Compiles the kernels.
    start : Start
        The kernel from given values to the state.
    states : int
        Number of components of the state.
    """

    def __init__(self, engine: Engine, start: Start, states: int) -> None:
        self.start, self._engine, self._states, self._uses = start, engine, states, 0

    @once_property
    def _code(self) -> StartCode | None:
        return self._engine.start_code(self.start)

    def __call__(self, t: float, values: Mapping[str, float], p: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the state (n_y,) and constants (n_c,) at time t from given values and parameters p (n_p,).

        None where code is not compiled yet, and where the ordinary start may reject something and says what.
        """
        if self._uses < _INTERPRETED:
            self._uses += 1
            return None
        code = self._code
        if code is None:
            return None
        c, out = code(t, p, [values[name] for name in self.start.given])
        if not math.isfinite(sum(c.tolist())):
            return None
        found = out.tolist()
        if not math.isfinite(sum(found)):
            return None
        checks = iter(found[self._states :])
        if not all(abs(left) <= limit for left, limit in zip(checks, checks, strict=True)):
            return None
        return out[: self._states].copy(), c.copy()
