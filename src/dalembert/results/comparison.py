"""Comparison of formulations on the same motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, final

from ..errors import nesting_named

__all__ = ["Comparison", "ComparisonRow"]


@final
@dataclass(frozen=True)
class ComparisonRow:
    """One formulation's run.

    Attributes
    ----------
    formulation, method : str
        Formulation, and the method that was used in the end.
    status : str
        How the run ended, or "cannot serve".
    error : float
        Largest estimated error of a coordinate along the run, from a twin at a hundredth of the tolerances.
    position_violation, velocity_violation : float
        Largest residual of a holonomic constraint, and of any constraint on the rates.
    energy_drift : float
        Largest change of the energy since the start; an error only where nothing dissipates or drives.
    steps, rejected : int
        Accepted steps and rejected attempts.
    seconds : float
        Of a second run, when everything is compiled.
    note : str
        Why the formulation cannot serve, or another method was taken.
    """

    formulation: str
    method: str
    status: str
    error: float
    position_violation: float
    velocity_violation: float
    energy_drift: float
    steps: int
    rejected: int
    seconds: float
    note: str = ""


_HEADS = {
    "formulation": "formulation",
    "method": "method",
    "status": "status",
    "error": "error est.",
    "position_violation": "positions",
    "velocity_violation": "velocities",
    "energy_drift": "energy drift",
    "steps": "steps",
    "rejected": "rejected",
    "seconds": "seconds",
}


@final
@dataclass(frozen=True)
class Comparison:
    """The rows of a comparison; prints as a table, indexed by the formulation's name."""

    scene: str
    rtol: float
    atol: float
    rows: tuple[ComparisonRow, ...]

    def __iter__(self) -> Iterator[ComparisonRow]:
        return iter(self.rows)

    @nesting_named
    def __getitem__(self, formulation: str) -> ComparisonRow:
        for row in self.rows:
            if row.formulation == formulation:
                return row
        raise KeyError(f"{formulation!r} was not compared; known: {', '.join(row.formulation for row in self.rows)}")

    def to_dict(self) -> dict[str, list[Any]]:
        """Return the columns by name, as tables are made of."""
        return {item.name: [getattr(row, item.name) for row in self.rows] for item in fields(ComparisonRow)}

    def __str__(self) -> str:
        table = [list(_HEADS.values())]
        table += [[_cell(getattr(row, name)) for name in _HEADS] for row in self.rows]
        widths = [max(len(line[i]) for line in table) for i in range(len(_HEADS))]
        lines = [f"{self.scene}, rtol = {self.rtol:g}, atol = {self.atol:g}"]
        for line in table:
            cells = (
                cell.ljust(w) if i < 3 else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
            )
            lines.append("  ".join(cells).rstrip())
        lines += [f"{row.formulation}: {row.note}" for row in self.rows if row.note]
        return "\n".join(lines)

    __repr__ = __str__


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if value != value else f"{value:.1e}"
    return str(value)
