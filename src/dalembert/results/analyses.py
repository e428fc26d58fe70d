"""Results of analyses: equilibria and steady motions, sensitivities, comparisons of formulations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, final

from ..arrays import FloatArray
from ..errors import UnknownNameError, nesting_named, unknown_name
from ..frozen import frozen
from ..methods.status import Status
from ..options import atol_text


@final
@frozen(eq=False)
class OperatingPoint:
    """An equilibrium or a steady motion, with the arguments of a run or a linearisation there.

    ``model.simulate(span, point.initial, point.parameters, inputs=point.inputs)`` starts from it.

    Attributes
    ----------
    t : float
        Time [s] at which the conditions hold.
    converged : bool
        Whether all conditions hold.
    message : str
        Result of the search, and the conditions that could not be met.
    iterations : int
        Newton steps.
    free : tuple of str
        Names of the values that were changed.
    initial : dict of str to float
        Coordinates, rates and first-order states.
    parameters, inputs : dict of str to float
        Parameters and inputs.
    residual : dict of str to float
        Residual of each condition, by its name.
    derivatives : dict of str to float
        Time derivatives of coordinates (their rates), of rates (accelerations) and of first-order states, by the name
        of what changes.
    undetermined : tuple of str
        Free values that the conditions do not determine, alone or together; each Newton step changed them as
        little as possible.
    aliases : mapping of str to str
        Text of a SymPy symbol -> name.
    """

    t: float
    converged: bool
    message: str
    iterations: int
    free: tuple[str, ...]
    initial: dict[str, float]
    parameters: dict[str, float]
    inputs: dict[str, float]
    residual: dict[str, float]
    derivatives: dict[str, float]
    undetermined: tuple[str, ...]
    aliases: Mapping[str, str]

    def __getitem__(self, key: Any) -> float:
        """Return a coordinate, rate, state, parameter or input, by name or symbol.

        Raises
        ------
        UnknownNameError
            For other names.
        """
        values = self.parameters | self.inputs | self.initial
        for name in (self.aliases.get(str(key), str(key)), str(key)):
            if name in values:
                return values[name]
        raise UnknownNameError(unknown_name("name", str(key), values))

    def __repr__(self) -> str:
        found = ", ".join(f"{name} = {self[name]:.6g}" for name in self.free)
        return f"<OperatingPoint {'' if self.converged else 'NOT CONVERGED '}at t = {self.t:g}: {found}>"


# `Sensitivity`: values along a motion and their derivatives, by name.


@final
@frozen(eq=False)
class Sensitivity:
    """Values and their derivatives with respect to parameters and initial values.

    Attributes
    ----------
    t : ndarray (n_t,)
        Recorded times [s]; after a failure they end where the run did.
    of, wrt : tuple of str
        Names of what is differentiated, and with respect to what.
    values : ndarray (n_t, n_of)
    jacobians : ndarray (n_t, n_of, n_wrt)
    status : Status
        How the run ended.
    method : str
        Integration method.
    steps : int
        Accepted steps.
    """

    t: FloatArray
    of: tuple[str, ...]
    wrt: tuple[str, ...]
    values: FloatArray
    jacobians: FloatArray
    status: Status
    method: str
    steps: int
    aliases: Mapping[str, str]

    @property
    def success(self) -> bool:
        """Whether the end of the span was reached."""
        return self.status is Status.SUCCESS

    @property
    def message(self) -> str:
        """The status of the run, as a sentence."""
        return self.status.message

    def value(self, name: Any) -> FloatArray:
        """Return the values (n_t,) of one of `of`, by name or symbol."""
        return self.values[:, self._place(name, self.of)]

    def __getitem__(self, name: Any) -> FloatArray:
        """Return the values (n_t,) of one of `of`, as `value` does."""
        return self.value(name)

    def jacobian(self, of: Any, wrt: Any) -> FloatArray:
        """Return the derivatives (n_t,) of one of `of` with respect to one of `wrt`, by name or symbol."""
        return self.jacobians[:, self._place(of, self.of), self._place(wrt, self.wrt)]

    def _place(self, key: Any, names: tuple[str, ...]) -> int:
        for name in (self.aliases.get(str(key), str(key)), str(key)):
            if name in names:
                return names.index(name)
        raise UnknownNameError(unknown_name("name", str(key), names))

    def __repr__(self) -> str:
        of, wrt = ", ".join(self.of), ", ".join(self.wrt)
        return f"<Sensitivity of {of} with respect to {wrt}: {len(self.t)} times, {self.status.name}>"


# Comparison of formulations on the same motion.


@final
@frozen
class ComparisonRow:
    """One formulation's run.

    Attributes
    ----------
    formulation, method : str
        Formulation, and the method that was used in the end.
    status : str
        How the run ended, or "not supported".
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
        Why the formulation is not supported, or another method was taken.
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
@frozen
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
        lines = [f"{self.scene}, rtol = {self.rtol:g}, atol = {atol_text(self.atol)}"]
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
