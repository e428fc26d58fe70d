"""Cases with contacts at an instant: times, parameters, and what their contacts do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...hybrid.modes import STATES
from ...integrators.contact_cases import ContactCases, contact_cases
from ...results.hybrid_sweep import States

__all__ = ["HybridState"]


@final
@dataclass(frozen=True, eq=False)
class HybridState:
    """Cases at an instant; the arrays change.

    Attributes
    ----------
    t : ndarray (k,)
        Times [s].
    c : ndarray (k, n_p)
        Parameters of the scene.
    cases : ContactCases
        States, modes, and what is remembered of the contacts.
    """

    t: FloatArray
    c: FloatArray
    cases: ContactCases

    @classmethod
    def starting(
        cls, t: FloatArray, x: FloatArray, c: FloatArray, span: FloatArray, contacts: int, states: int = 0
    ) -> HybridState:
        """Return cases before their first decision, with x (k, 2 n_q + n_z) and signed spans (k,).

        `states` is n_z, the number of first-order states.
        """
        own = [np.array(values, dtype=float, order="C") for values in (t, x, c, span)]
        return cls(own[0], own[2], contact_cases(own[0], own[1], own[3], contacts, states))

    @property
    def x(self) -> FloatArray:
        """Coordinates, rates and first-order states (k, 2 n_q + n_z)."""
        return self.cases.x

    def directions(self, some: NDArray[np.intp] | slice = slice(None)) -> FloatArray:
        """Return directions of slip (k, n_contacts, 2) of some cases."""
        found = self.cases.directions[some]
        return found.reshape(len(found), found.shape[1] // 2, 2)

    def states(self, some: NDArray[np.intp], history: NDArray[np.int64]) -> States:
        """Return the states of some cases, as results hold them, with their histories (k,)."""
        cases = self.cases
        about = history, self.directions(some), cases.sides[some], cases.rest[some]
        return States(self.t[some], self.x[some], some, self.mode_numbers(some), *about)

    def mode_numbers(self, some: NDArray[np.intp] | slice = slice(None)) -> NDArray[np.int64]:
        """Return the numbers of the modes of some cases (k,), see `HybridAutomaton.number`; -1 where there is none."""
        modes = self.cases.modes[some]
        numbers = modes @ (len(STATES) ** np.arange(modes.shape[1]))
        return np.where(np.any(modes < 0, axis=1), -1, numbers)
