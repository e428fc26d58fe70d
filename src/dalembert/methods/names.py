"""Methods by the names that users write: explicit pairs of compiled loops, methods of traced runs, steps of fixed size.

A new pair takes a file with its tableau, and a line in `PAIRS`: every backend with compiled loops then has it.
"""

from __future__ import annotations

import pkgutil
from typing import TYPE_CHECKING, NamedTuple, final

from ..frozen import frozen
from ..once import once_property
from .step_constants import LINEAR_CORRECTIONS

if TYPE_CHECKING:
    from .tableau import Tableau


@final
@frozen
class ExplicitPair:
    """An explicit pair.

    Attributes
    ----------
    description : str
        One line for `explain()`.
    place : str
        Module and name of its tableau. It is imported on first use, because checking its conditions takes time.
    """

    description: str
    place: str

    @once_property
    def tableau(self) -> Tableau:
        """The tableau."""
        found: Tableau = pkgutil.resolve_name(self.place)
        return found


PAIRS: dict[str, ExplicitPair] = {
    "dop853": ExplicitPair(
        "explicit Runge-Kutta of order 8 (Hairer, Norsett and Wanner)", "dalembert.methods.tableaus:DOP853"
    ),
    "tsit5": ExplicitPair("explicit Runge-Kutta of order 5 (Tsitouras)", "dalembert.methods.tableaus:TSIT5"),
}
"""All pairs by name."""


@final
@frozen
class TracedMethod:
    """A method of traced runs.

    Attributes
    ----------
    description : str
        One line for `explain()`.
    compiled : str
        Its counterpart in compiled loops: an explicit pair of `dalembert.methods.names`, "taylor" or "radau".
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


class FixedTableau(NamedTuple):
    """A method without error estimate.

    Attributes
    ----------
    rows : tuple of tuple of float
        Weights of earlier slopes in each stage.
    weights : tuple of float
        Weights of the slopes in the step.
    nodes : tuple of float
        Times of the stages, in steps.
    """

    rows: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    nodes: tuple[float, ...]


CLASSICAL = FixedTableau(
    ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
    (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
    (0.0, 0.5, 0.5, 1.0),
)
"""The classic method of order 4 (W. Kutta, Zeitschrift fuer Mathematik und Physik 46 (1901) 435-453)."""

EULER = FixedTableau(((),), (1.0,), (0.0,))
"""Order 1."""

CORRECTIONS = {"project_position": 3, "project_velocity": LINEAR_CORRECTIONS}
"""Number of times that each correction is applied, always, where a step does not count them: from the end of a step the
first one leaves the square of the step's error, and the last removes rounding."""
