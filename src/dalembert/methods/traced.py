"""Methods of traced runs of JAX, and what compiled loops call them."""

from __future__ import annotations

from typing import final

from ..frozen import frozen


@final
@frozen
class TracedMethod:
    """A method of traced runs.

    Attributes
    ----------
    description : str
        One line for `explain()`.
    compiled : str
        Its counterpart in compiled loops: an explicit pair of `dalembert.methods.pairs`, "taylor" or "radau".
    """

    description: str
    compiled: str


TRACED: dict[str, TracedMethod] = {
    "dopri8": TracedMethod(
        "explicit Runge-Kutta of order 8 (Prince and Dormand; diffrax, in sweeps DOP853)", compiled="dop853"
    ),
    "tsit5": TracedMethod(
        "explicit Runge-Kutta of order 5 (Tsitouras; diffrax, in sweeps a loop of our own)", compiled="tsit5"
    ),
    "taylor": TracedMethod(
        "Taylor series, generated recurrences, order and step from the tolerance; what sweeps take", compiled="taylor"
    ),
    "kvaerno5": TracedMethod(
        "implicit Runge-Kutta of order 5, for stiff scenes (Kvaerno; diffrax, in sweeps a loop of our own)",
        compiled="radau",
    ),
}
"""All of them by name. The single runs of diffrax need its solver, too (`dalembert.jax.runs.solvers.METHODS`)."""
