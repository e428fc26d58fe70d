"""Equilibria and steady motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from ..errors import UnknownNameError, unknown_name

__all__ = ["OperatingPoint"]


@final
@dataclass(frozen=True, eq=False)
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
