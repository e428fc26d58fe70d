"""The linearised map of a sampled loop from one period to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import MissingExtraError

__all__ = ["DiscreteLinearization"]


@final
@dataclass(frozen=True, eq=False)
class DiscreteLinearization:
    """The motion of a scene with sampled controllers over one period of theirs, to first order.

    ``deviation[k + 1] = A deviation[k] + B du[k] + drift`` and ``d(outputs)[k] = C deviation[k] + D du[k]``. States are
    taken at the instants ``t + k dt`` before the controllers act; changes du of inputs are held over a period. Outputs
    that are no states are taken behind the instant, where runs record them.

    Attributes
    ----------
    t : float
        Time [s] at which the period begins: an instant of the controllers without offset.
    dt : float
        The period [s], that of all controllers together.
    A : ndarray (n, n)
        Derivatives of the next state by the state.
    B : ndarray (n, n_u)
        Derivatives of the next state by the inputs that no controller sets.
    C : ndarray (n_o, n)
        Derivatives of the outputs by the state.
    D : ndarray (n_o, n_u)
        Derivatives of the outputs by the inputs.
    drift : ndarray (n,)
        Change of the state over a period: zero at an equilibrium, and in periodic motions of that period.
    states, inputs, outputs : tuple of str
        Names of the rows of A, of the columns of B, and of the rows of C. States are the independent coordinates and
        speeds, first-order states, states of controllers, and inputs that a controller sets later than at the time t
        (`offset`), which hold until then.
    values, output_values : ndarray (n,), (n_o,)
        The state, and the outputs there.
    """

    t: float
    dt: float
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    drift: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    values: FloatArray
    output_values: FloatArray

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues (n,) of A, the largest first, those of a pair with the positive imaginary part first.

        The loop is asymptotically stable where all are less than 1 in size.
        """
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        return found[np.lexsort((-found.imag, -np.round(np.abs(found), 12)))]

    def to_control(self) -> Any:
        """Return the map as a ``control.StateSpace`` of python-control with the sampling time `dt`, with its names.

        Raises
        ------
        MissingExtraError
            Where python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise MissingExtraError(
                'python-control is needed; install it with: pip install "dalembert[control]"'
            ) from None
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, self.dt, **names)

    def __repr__(self) -> str:
        return f"<DiscreteLinearization over {self.dt:g} s at t = {self.t:g} in {', '.join(self.states)}>"
