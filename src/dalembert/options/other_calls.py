"""Options of other calls than runs: compilation, derivatives and equilibria, stores of sweeps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, final

from ..errors import OptionError, unknown_name
from ..frozen import frozen
from ..values import flag, option, times_of, whole
from .runs import RunOptions, set_checked

ORIENTATIONS = ("scene", "quaternion")
"""Coordinates that orient bodies: those of the scene, or unit quaternions in place of three angles."""

IMPACTS = ("newton", "poisson", "sequence")
"""Laws of impacts; their places are their numbers in compiled code (`dalembert.contacts.contact_system`)."""


@final
@frozen
class CompileOptions:
    """Options of a compilation; the arguments of `dalembert.compile_model`.

    Attributes
    ----------
    backend : str
        A name in `dalembert.codegen.BACKENDS`.
    formulation : str
        A name in `dalembert.reduction.FORMULATIONS`, or "auto".
    outputs : tuple
        Names or SymPy expressions to record.
    cache : bool
        Whether generated modules and compiled code may be kept on disk.
    gains : (float, float) or None
        Gains alpha and beta [1/s] of the formulation "baumgarte"; None leaves them to each run.
    orientation : str
        "scene" for the coordinates of the scene, "quaternion" to let unit quaternions take the place of angles.
    impacts : str
        "newton" and "poisson" for all contacts of an impact at once, "sequence" for one after the other.

    Raises
    ------
    OptionError
        For an orientation, or a law of impacts, that does not exist; for gains that are not two positive numbers, or
        that no formulation takes.
    """

    backend: str = "llvm"
    formulation: str = "auto"
    outputs: tuple[Any, ...] = ()
    cache: bool = True
    gains: tuple[float, float] | None = None
    orientation: str = "scene"
    impacts: str = "newton"

    def __post_init__(self) -> None:
        orientation: Any = self.orientation
        if not isinstance(orientation, str) or orientation not in ORIENTATIONS:
            raise OptionError(unknown_name("orientation", str(self.orientation), ORIENTATIONS))
        impacts: Any = self.impacts
        if not isinstance(impacts, str) or impacts not in IMPACTS:
            raise OptionError(unknown_name("law of impacts", str(self.impacts), IMPACTS))
        if self.gains is None:
            return
        try:
            alpha, beta = (float(gain) for gain in self.gains)
        except (TypeError, ValueError):
            raise OptionError(f"gains must be two numbers, alpha and beta [1/s], not {self.gains!r}") from None
        if not (0.0 <= alpha < math.inf and 0.0 <= beta < math.inf):
            raise OptionError(f"gains must be finite and not negative, not {self.gains!r}")
        if self.formulation != "baumgarte":
            raise OptionError(
                f"gains are those of the formulation 'baumgarte', not of {self.formulation!r}: give formulation="
                "'baumgarte' with them, or leave them out"
            )
        object.__setattr__(self, "gains", (alpha, beta))


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


@final
@frozen(eq=False, kw_only=True)
class StoreOptions:
    """Options of stored sweeps; further keyword arguments of `CompiledModel.sweep`.

    Attributes
    ----------
    to : str, Path or zarr store
    chunk : int or None
        Cases of a chunk; None lets the sweep choose it.
    client : distributed.Client or None
        The cluster that computes the chunks; None for this process.
    resume : bool
        Whether an existing store of the same sweep is completed.
    units : mapping of symbols or names to str, or None
        Units of arrays and parameters; None leaves those that a store has.

    Raises
    ------
    OptionError
        For values that are not of the kind that is needed, and a client that is not running.
    """

    to: Any
    chunk: int | None = None
    client: Any = None
    resume: bool = True
    units: Mapping[Any, str] | None = None

    def __post_init__(self) -> None:
        if self.chunk is not None:
            set_checked(self, chunk=whole("chunk", self.chunk))
            if self.chunk < 1:
                raise OptionError(
                    f"chunk must be at least one case, not {self.chunk!r}; leave it out to have it chosen"
                )
        set_checked(self, resume=flag("resume", self.resume))
        status = getattr(self.client, "status", type(self.client).__name__)
        if self.client is not None and status != "running":
            raise OptionError(
                f"client must be a running distributed.Client; this one is {status}. Make a new one, or leave it out"
            )
