"""SciPy's solvers by the names that users write; a further one is a line in `METHODS`."""

from __future__ import annotations

from typing import final

from ...frozen import frozen


@final
@frozen
class SciPyMethod:
    """One of SciPy's solvers.

    Attributes
    ----------
    description : str
        One line for `explain()`.
    place : str
        Module and name of its class, which is imported on first use.
    attempt : int
        Evaluations in an attempted step; 0 where it is implicit.
    chains : bool
        Whether it continues from past steps, so that states cannot be projected.
    """

    description: str
    place: str
    attempt: int = 0
    chains: bool = False


METHODS: dict[str, SciPyMethod] = {
    "dop853": SciPyMethod(
        "explicit Runge-Kutta of order 8 (SciPy)", "dalembert.codegen.numpy.kernel_calls:GuardedDOP853", attempt=12
    ),
    "rk45": SciPyMethod("explicit Runge-Kutta of order 5 (SciPy)", "scipy.integrate:RK45", attempt=6),
    "radau": SciPyMethod("implicit Runge-Kutta of order 5, for stiff scenes (SciPy)", "scipy.integrate:Radau"),
    "bdf": SciPyMethod("backward differentiation, for stiff scenes (SciPy)", "scipy.integrate:BDF", chains=True),
    "lsoda": SciPyMethod(
        "Adams or backward differentiation, chosen on the way (SciPy)", "scipy.integrate:LSODA", chains=True
    ),
}
"""All methods by name; the first is what "auto" takes."""

IMPLICIT = tuple(name for name, method in METHODS.items() if not method.attempt)
PROJECTABLE = tuple(name for name, method in METHODS.items() if not method.chains)
