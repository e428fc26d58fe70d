"""The linearised motion about a state, and the map of a sampled loop over one period."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import MissingExtraError, OptionError, list_names
from ..frozen import frozen

if TYPE_CHECKING:
    from collections.abc import Sequence


@final
@frozen(eq=False)
class InputDerivatives:
    """Derivatives of rates or outputs by inputs, and by the first and second rates of inputs.

    Attributes
    ----------
    values, rates, second_rates : ndarray (k, n_u)
        An input that only stands in loads has rates that nothing depends on; one that stands in a position or a
        holonomic constraint moves bodies, whose velocities and accelerations depend on its rates.
    """

    values: FloatArray
    rates: FloatArray
    second_rates: FloatArray


@final
@frozen(eq=False)
class Linearization:
    """The motion about a state, to first order, in independent coordinates and speeds.

    ``d(deviation)/dt = A deviation + B du + B_parameters dp + drift`` and ``d(outputs) = C deviation + D du``, where du
    and dp are changes of inputs and parameters. Where rates of inputs enter, `B_rates` and so on belong to it too.

    Attributes
    ----------
    t : float
        Time [s] at which the motion was linearised.
    A : ndarray (n, n)
        Derivatives of the rates by the state.
    B : ndarray (n, n_u)
        Derivatives of the rates by the inputs, with the independent coordinates and speeds held.
    C : ndarray (n_o, n)
        Derivatives of the outputs by the state.
    D : ndarray (n_o, n_u)
        Derivatives of the outputs by the inputs, with the independent coordinates and speeds held.
    B_parameters : ndarray (n, n_p)
        Derivatives of the rates by the parameters, with the independent coordinates and speeds held.
    by_input, outputs_by_input : InputDerivatives
        B and D, and the derivatives by the rates of the inputs.
    drift : ndarray (n,)
        Rates at the state itself: zero at an equilibrium, constant in steady motion.
    states, inputs, outputs, parameters : tuple of str
        Names of the rows of A, of the columns of B, of the rows of C, and of the columns of B_parameters.
    values, output_values : ndarray (n,), (n_o,)
        The state, and the outputs there.
    """

    t: float
    A: FloatArray
    C: FloatArray
    B_parameters: FloatArray
    by_input: InputDerivatives
    outputs_by_input: InputDerivatives
    drift: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    values: FloatArray
    output_values: FloatArray

    @property
    def B(self) -> FloatArray:
        """Derivatives (n, n_u) of the rates by the inputs."""
        return self.by_input.values

    @property
    def D(self) -> FloatArray:
        """Derivatives (n_o, n_u) of the outputs by the inputs."""
        return self.outputs_by_input.values

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues (n,) of A [1/s], by falling real part, those of a pair with the positive imaginary part first.

        Away from equilibria and steady motions they depend on which coordinates and speeds are independent.
        """
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

    def transfer(self, s: Any) -> NDArray[np.complex128]:
        """Return the transfer function from inputs to outputs, (n_o, n_u), or (k, n_o, n_u) at several s (k,).

        Parameters
        ----------
        s : complex or array_like (k,)
            Complex frequency [1/s]; ``1j * omega`` gives the frequency response. Rates of inputs count.
        """
        at = np.asarray(s, dtype=np.complex128)
        points = np.atleast_1d(at)[:, np.newaxis, np.newaxis]
        by, out = self.by_input, self.outputs_by_input
        drive = by.values + points * by.rates + points**2 * by.second_rates
        direct = out.values + points * out.rates + points**2 * out.second_rates
        found = self.C @ np.linalg.solve(points * np.eye(len(self.A)) - self.A, drive) + direct
        return np.asarray(found if at.ndim else found[0], dtype=np.complex128)

    def realization(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return matrices A, B, C, D of a system with the same outputs for the same inputs, without rates of inputs.

        Where rates of inputs enter the equations, its state is the deviation less ``E_0 u + E_1 u'`` with
        ``E_1 = B_second`` and ``E_0 = B_rates + A E_1``; otherwise the matrices are those of the linearisation.

        Raises
        ------
        OptionError
            Where outputs depend on rates of inputs, which no such system has.
        """
        by, out = self.by_input, self.outputs_by_input
        first = out.rates + self.C @ by.second_rates
        size = np.abs(out.rates) + np.abs(self.C) @ np.abs(by.second_rates)
        lost = np.abs(first) > 1e-12 * size
        wrong = np.any(lost | (out.second_rates != 0.0), axis=1)
        if np.any(wrong):
            names = [name for name, bad in zip(self.outputs, wrong, strict=True) if bad]
            raise OptionError(
                f"the outputs {list_names(names)} depend on rates of the inputs {list_names(self._moving())}, and a"
                " state-space system has none: leave these outputs out, or make the rate itself an input."
                " transfer() serves all outputs"
            )
        shift = by.rates + self.A @ by.second_rates
        return self.A, self.B + self.A @ shift, self.C, self.D + self.C @ shift

    def _moving(self) -> Sequence[str]:
        """Return the inputs of which rates enter."""
        parts = (self.by_input, self.outputs_by_input)
        moved = np.array([np.any(table != 0.0, axis=0) for part in parts for table in (part.rates, part.second_rates)])
        return [name for name, moving in zip(self.inputs, np.any(moved, axis=0), strict=True) if moving]

    def to_control(self) -> Any:
        """Return the linearisation as a ``control.StateSpace`` of python-control, with its names.

        Deviations are those of the `realization`: names of states that stand for a deviation less a function of the
        inputs end in " shifted".

        Raises
        ------
        MissingExtraError
            Where python-control is not installed.
        OptionError
            For a scene without inputs, and as for `realization`.
        """
        control = _python_control()
        if not self.inputs:
            raise OptionError(
                "the scene has no inputs, and a system of python-control needs one: declare given functions of time"
                " with scene.add_inputs"
            )
        moved = self.by_input.rates + self.A @ self.by_input.second_rates
        shifted = np.any((moved != 0.0) | (self.by_input.second_rates != 0.0), axis=1)
        names = [f"{name} shifted" if some else name for name, some in zip(self.states, shifted, strict=True)]
        return control.ss(*self.realization(), 0, states=names, inputs=list(self.inputs), outputs=list(self.outputs))

    def __repr__(self) -> str:
        return f"<Linearization at t = {self.t:g} in {', '.join(self.states)}>"


# The linearised map of a sampled loop from one period to the next.


@final
@frozen(eq=False)
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
        control = _python_control()
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, self.dt, **names)

    def __repr__(self) -> str:
        return f"<DiscreteLinearization over {self.dt:g} s at t = {self.t:g} in {', '.join(self.states)}>"


def _python_control() -> Any:
    """Return python-control.

    Raises
    ------
    MissingExtraError
        Where it is not installed.
    """
    try:
        import control
    except ImportError:
        raise MissingExtraError('python-control is needed; install it with: pip install "dalembert[control]"') from None
    return control
