"""Options of runs with derivatives, and of equilibria."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, final

from ..errors import OptionError
from ..frozen import frozen
from ..values import option, times_of, whole
from .runs import RunOptions, set_checked


@final
@frozen(eq=False, kw_only=True)
class SensitivityOptions(RunOptions):
    """Options of a run with derivatives; the keyword arguments of `CompiledModel.sensitivity`.

    Attributes
    ----------
    wrt : iterable of symbols or names
        Parameters and given initial values with respect to which is differentiated.
    of : iterable of symbols or names, or None
        Names of the differentiated values; None takes all coordinates and rates.
    t_eval : ndarray (n_t,) or None
        Times to record [s]; None records the accepted steps.

    Raises
    ------
    OptionError, ValueInputError
        For values that are not of the kind that is needed.
    """

    wrt: Any
    of: Any = None
    t_eval: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.t_eval is not None:
            set_checked(self, t_eval=times_of("t_eval", self.t_eval))


@final
@frozen(eq=False, kw_only=True)
class TrimOptions:
    """Options of equilibria and steady motions; the keyword arguments of `CompiledModel.trim`.

    Attributes
    ----------
    free : iterable of names or None
        Values that may change; None takes all coordinates and first-order states.
    steady : iterable of names or None
        Coordinates, rates and states that must not change in time; None takes rates and states.
    t : float
        Time [s].
    tolerance : float
        Largest residual of a condition, as a share of the size of its terms.
    max_iterations : int
        Most Newton steps.

    Raises
    ------
    OptionError
        For values that are not of the kind that is needed.
    """

    free: Any = None
    steady: Any = None
    t: float = 0.0
    tolerance: float = 1e-12
    max_iterations: int = 100

    def __post_init__(self) -> None:
        tolerance, most = option("tolerance", self.tolerance), whole("max_iterations", self.max_iterations)
        if not 0.0 < tolerance < 1.0:
            raise OptionError(f"tolerance must be a number between 0 and 1, not {self.tolerance!r}")
        if most < 1:
            raise OptionError(f"max_iterations must be at least 1, not {self.max_iterations!r}")
        free, steady = (tuple(v) if isinstance(v, Iterator) else v for v in (self.free, self.steady))
        self.__dict__.update(free=free, steady=steady, t=option("t", self.t), tolerance=tolerance, max_iterations=most)
