"""Modes of many contacts that one program serves: which, and with which switches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..contacts.equations.contact_laws import NUMBERS, OPEN, STICK, Mode
from ..contacts.equations.dependent_slips import DEPENDENT, coupled_slips, dependences, jacobians, slip_rows
from ..contacts.equations.switched_modes import unit_lengths, why_unswitched
from ..contacts.selection.mode_candidates import FEW_CONTACTS
from ..frozen import frozen
from ..once import derived_property

if TYPE_CHECKING:
    from ..mechanics.equations import EquationsOfMotion

_FORMULATIONS = "auto", "minimal", "projected"
"""Formulations whose steps end on the constraints, as those of the common program do."""

_PROBES, _SHIFT, _SEED = 2, 0.05, 3
"""States near a case, by shares of its coordinates, at which dependences are looked at too."""

_ROUNDS, _CLOSED = 20, 1e-13
"""Newton steps that close gaps at such states, and share of the coordinates up to which these are closed."""

_ALIKE = 1e-6
"""Share to which slips that are the same, or opposite, are of equal size."""


def why_separate(equations: EquationsOfMotion, formulation: str) -> str:
    """Return why each mode of a scene has a program of its own; empty where one program serves them."""
    if len(equations.contacts) <= FEW_CONTACTS:
        return f"there are no more than {FEW_CONTACTS} contacts"
    if any(contact.kinks for contact in equations.contacts):
        return "gaps of contacts have kinks"
    if formulation not in _FORMULATIONS:
        return f"the formulation is {formulation!r}"
    return why_unswitched(equations)


@final
@frozen(eq=False)
class CommonProgram:
    """The program of all modes, and the modes that it serves.

    Its matrix is regular where the rows that hold in a mode are independent. Rows of contacts that slip together do
    not hold (`dalembert.contacts.equations.dependent_slips`); modes with other dependences have programs of their own.

    Attributes
    ----------
    equations : EquationsOfMotion
        Of the scene.
    values : function of (t, x, p)
        Numbers of the contacts (k, n_values) at times (k,), states (k, n_y) and parameters (k, n_p).
    sharing : dict of Mode to dict of int to int, or None
        For each mode that has been asked for: contacts that share the friction force of others, with these; None where
        it has a program of its own.
    """

    equations: EquationsOfMotion
    values: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    sharing: dict[Mode, dict[int, int] | None] = field(default_factory=dict, init=False)

    @derived_property
    def _coupled(self) -> dict[tuple[int, int], int]:
        return coupled_slips(self.equations)

    def settle(self, mode: Mode, t: FloatArray, x: FloatArray, p: FloatArray) -> None:
        """Find out once whether the program serves a mode, at a state x (1, n_y) in it with t (1,) and p (1, n_p)."""
        if mode not in self.sharing:
            self.sharing[mode] = self._shared(mode, t, x, p)

    def _shared(self, mode: Mode, t: FloatArray, x: FloatArray, p: FloatArray) -> dict[int, int] | None:
        """Return the contacts that share friction forces in a mode; None for other dependences."""
        lengths = {row.label for row in unit_lengths(self.equations)}
        always = [i for i, row in enumerate(self.equations.constraints) if row.label in lengths]
        normals, slips = list[int](), list[int]()
        for contact, state, own in zip(self.equations.contacts, mode, slip_rows(self.equations), strict=True):
            normals += [contact.constraint] if state != OPEN and contact.constraint is not None else []
            slips += own if state == STICK else []
        found: dict[int, int] | None = None
        for place, each in enumerate([x, *self._apart(x), *self._closed(normals, t, x, p)]):
            rows = jacobians(self.equations, self.values(t, each, p))[0]
            if not np.isfinite(rows).all():
                return None
            dependent = dependences(rows, [*always, *normals, *slips])
            alike = self._alike(dependent, weigh=place == 0 or place > _PROBES)
            if alike is None or (place > 0 and alike != found):
                return None
            found = alike
        return found

    def _alike(self, dependent: dict[int, FloatArray], *, weigh: bool) -> dict[int, int] | None:
        """Return which contacts slip as others do, where that is all that rows depend on each other by.

        If they are to `weigh`, the slips are equal or opposite, and normal reactions have no part in sharing.
        """
        owners = {row: i for i, own in enumerate(slip_rows(self.equations)) for row in own}
        found: dict[int, int] = {}
        for row, weights in dependent.items():
            others = [i for i in np.flatnonzero(np.abs(weights) > DEPENDENT).tolist() if weigh or i in owners]
            if row not in owners or len(others) != 1 or others[0] not in owners:
                return None
            b, d, weight = owners[others[0]], owners[row], float(weights[others[0]])
            sign = self._coupled.get((b, d))
            if sign is None or (weigh and abs(weight - sign) > _ALIKE):
                return None
            found[d] = b
        return found

    def _apart(self, x: FloatArray) -> list[FloatArray]:
        """Return states at which no gap is closed: what depends there does so everywhere."""
        rng, n = np.random.default_rng(_SEED), len(self.equations.q)
        found = []
        for _ in range(_PROBES):
            moved = x.copy()
            moved[:, :n] += _SHIFT * (1.0 + np.abs(x[:, :n])) * rng.normal(size=(1, n))
            found.append(moved)
        return found

    def _closed(self, normals: list[int], t: FloatArray, x: FloatArray, p: FloatArray) -> list[FloatArray]:
        """Return states at which some gaps, by the numbers of their constraints, are closed."""
        n, k = len(self.equations.q), len(self.equations.contacts)
        gaps = {c.constraint: (i, c.sense) for i, c in enumerate(self.equations.contacts)}
        found = []
        for moved in self._apart(x):
            for _ in range(_ROUNDS):
                values = self.values(t, moved, p)
                left = np.array([gaps[row][1] * values[0, gaps[row][0] - len(NUMBERS) * k] for row in normals])
                change = np.linalg.lstsq(jacobians(self.equations, values)[0][normals], -left, rcond=None)[0]
                moved[0, :n] += change
                if not np.isfinite(change).all() or np.max(np.abs(change), initial=0.0) <= _CLOSED:
                    break
            found.append(moved)
        return found
