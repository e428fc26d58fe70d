"""The linearised motion about a state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray

__all__ = ["Linearization"]


@final
@dataclass(frozen=True, eq=False)
class Linearization:
    """d(deviation)/dt = A deviation + B parameter change + drift, in independent coordinates and speeds.

    Attributes
    ----------
    t : float
        Time [s] at which the motion was linearised.
    A : ndarray (n, n)
        Derivatives of the rates by the state.
    B : ndarray (n, n_p)
        Derivatives of the rates by the parameters, with the independent coordinates and speeds held.
    drift : ndarray (n,)
        Rates at the state itself: zero at an equilibrium, constant in steady motion.
    states : tuple of str
        Names of the rows and columns of A.
    parameters : tuple of str
        Names of the columns of B.
    values : ndarray (n,)
        The state.
    """

    t: float
    A: FloatArray
    B: FloatArray
    drift: FloatArray
    states: tuple[str, ...]
    parameters: tuple[str, ...]
    values: FloatArray

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues (n,) of A [1/s], by falling real part, those of a pair with the positive imaginary part first."""
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        return found[np.lexsort((-found.imag, -np.round(found.real, 12)))]

    def block(self, *names: str) -> FloatArray:
        """Return the rows and columns of A that belong to some states.

        Raises
        ------
        KeyError
            For a name that is none of the states.
        """
        for name in names:
            if name not in self.states:
                raise KeyError(f"{name!r} is none of the states {', '.join(self.states)}")
        places = [self.states.index(name) for name in names]
        return self.A[np.ix_(places, places)]

    def __repr__(self) -> str:
        return f"<Linearization at t = {self.t:g} in {', '.join(self.states)}>"
