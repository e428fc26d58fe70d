"""Options of motions: single, many, prepared and traced."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, TypeVar, final

from ..errors import OptionError
from ..frozen import frozen
from ..values import flag, option, times_of, whole
from .tolerances import DEFAULT_TOLERANCES, scaled, tolerances

_Shared = TypeVar("_Shared")
_Estimating = TypeVar("_Estimating", "SimulateOptions", "SweepOptions")

TIGHTER = 1e-2
"""Factor between the tolerances of a run and of the one beside it from which its error is estimated."""

MAX_STEPS = 1_000_000
"""Attempted steps after which a run ends by default: far more than a run takes that goes well, at most some minutes."""

TRACED_MAX_STEPS = 4096
"""The same for traced runs of JAX, whose derivatives need memory for so many steps, whatever the run takes."""


@frozen(eq=False, kw_only=True)
class RunOptions:
    """Options of every kind of run.

    Attributes
    ----------
    method : str
        A name in `methods` of the model, or "auto".
    rtol, atol : float
        Tolerances of the local error of every component of the state.
    fits_atol : bool
        Whether `atol` was given as "auto"; it is the default then, until the size of the motion is known.
    max_steps : int
        Attempted steps after which a run ends with a status.
    inputs : GivenInputs or None
        Values of the inputs of the scene; None where it has none.

    Raises
    ------
    OptionError
        For values that are not numbers, or not of the kind that is needed.
    """

    method: str = "auto"
    rtol: float = DEFAULT_TOLERANCES[0]
    atol: float = DEFAULT_TOLERANCES[1]
    max_steps: int = MAX_STEPS
    inputs: Any = None
    fits_atol: bool = False

    def __post_init__(self) -> None:
        given: object = self.atol
        if isinstance(given, str) and given == "auto":
            set_checked(self, atol=DEFAULT_TOLERANCES[1], fits_atol=True)
        rtol, atol = tolerances(self.rtol, self.atol)
        if self.fits_atol and rtol == 0.0:
            raise OptionError('atol="auto" is a share of rtol times the size of the motion: set rtol above 0')
        set_checked(self, rtol=rtol, atol=atol, max_steps=whole("max_steps", self.max_steps))

    @property
    def automatic(self) -> bool:
        """Whether the model chooses the method."""
        given: object = self.method
        return isinstance(given, str) and given == "auto"


@frozen(eq=False, kw_only=True)
class StepOptions(RunOptions):
    """Options of runs whose steps may be limited.

    Attributes
    ----------
    max_step : float
        Largest step [s].

    Raises
    ------
    OptionError
        For values that are not of the kind that is needed.
    """

    max_step: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        set_checked(self, max_step=option("max_step", self.max_step))


@final
@frozen(eq=False, kw_only=True)
class SimulateOptions(StepOptions):
    """Options of one trajectory; the keyword arguments of `CompiledModel.simulate`.

    Attributes
    ----------
    t_eval : ndarray (n_t,) or None
        Times to record [s]; None records the accepted steps.
    origin : float
        Time from which those of the run are counted [s].
    first_step : float or None
        First step [s]; None lets the method choose it.
    dense : bool
        Whether the trajectory can be evaluated between the recorded times.
    error_estimate : bool
        Whether a second run at a hundredth of the tolerances estimates the global error.
    events : sequence of Event, SymPy expressions or names
        Events of the run.
    project_invariants : bool, str or sequence of str
        First integrals to keep at their initial values.
    progress : bool
        Whether to show a bar with the time that the run has reached.

    Raises
    ------
    OptionError, ValueInputError
        For values that are not of the kind that is needed.
    """

    t_eval: Any = None
    origin: float = 0.0
    first_step: float | None = None
    dense: bool = True
    error_estimate: bool = False
    events: Any = ()
    project_invariants: Any = False
    progress: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        set_checked(self, progress=flag("progress", self.progress))
        if self.t_eval is not None:
            set_checked(self, t_eval=times_of("t_eval", self.t_eval))
        if self.first_step is not None:
            set_checked(self, first_step=option("first_step", self.first_step))
        set_checked(self, dense=flag("dense", self.dense), error_estimate=flag("error_estimate", self.error_estimate))

    def at_times(self, t_eval: Any) -> SimulateOptions:
        """Return these options, which were checked, with other times to record.

        Raises
        ------
        ValueInputError
            For what are no times.
        """
        made: SimulateOptions = object.__new__(SimulateOptions)
        made.__dict__.update(self.__dict__)
        set_checked(made, t_eval=times_of("t_eval", t_eval))
        return made


@final
@frozen(eq=False, kw_only=True)
class SweepOptions(StepOptions):
    """Options of many cases; the keyword arguments of `CompiledModel.sweep`.

    Attributes
    ----------
    grid : Grid or None
        Combinations of some parameters and initial values.
    t_eval : ndarray (n_t,) or None
        Times to record for all cases [s]; None records final states only.
    origin : float
        Time from which those of the run are counted [s].
    threads : int or None
        Threads to use; None takes as many as there are processors.
    progress : bool
        Whether to show a bar with cases per second.
    error_estimate : bool
        Whether every case runs once more at a hundredth of the tolerances.
    events : sequence of Event, SymPy expressions or names
        Events of every case.
    reduce : mapping of str to reductions, sequence of expressions or names, or None
        Reductions of every motion.
    project_invariants : bool, str or sequence of str
        First integrals to keep at their initial values.
    chosen : mapping of (int, float) to str, or None
        Methods by number of the mode of contacts (-1: a scene without) and `rtol`, found before from other cases; with
        it "auto" looks at no motions.

    Raises
    ------
    OptionError, ValueInputError
        For values that are not of the kind that is needed.
    """

    grid: Any = None
    t_eval: Any = None
    origin: float = 0.0
    threads: int | None = None
    progress: bool = False
    error_estimate: bool = False
    events: Any = ()
    reduce: Any = None
    project_invariants: Any = False
    chosen: Mapping[tuple[int, float], str] | None = None

    repeats: ClassVar[bool] = False
    """Whether further calls share these options (`repeated`)."""

    @property
    def fits(self) -> bool:
        """Whether the method is one that fits some of the motions."""
        return self.chosen is None and self.automatic

    def method_chosen(self, mode: int, default: str) -> str:
        """Return the method that was found for a mode, or else a default."""
        if self.chosen is None or not self.automatic:
            return default
        return self.chosen.get((mode, self.rtol), default)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.t_eval is not None:
            set_checked(self, t_eval=times_of("t_eval", self.t_eval))
        if self.threads is not None:
            set_checked(self, threads=whole("threads", self.threads))
            if self.threads < 1:
                raise OptionError(f"threads must be at least 1, not {self.threads!r}")
        set_checked(self, progress=flag("progress", self.progress))
        set_checked(self, error_estimate=flag("error_estimate", self.error_estimate))


@final
@frozen(eq=False, kw_only=True)
class PrepareOptions(StepOptions):
    """Options of prepared runs; the keyword arguments of `CompiledModel.prepare`.

    Attributes
    ----------
    project_invariants : bool, str or sequence of str
        First integrals to keep at their initial values.
    """

    project_invariants: Any = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fits_atol:
            raise OptionError(
                'prepared runs do not look at the size of their motions: give atol as a number, not "auto", such as'
                ' the one of a run, model.simulate(..., atol="auto").stats.atol'
            )


@final
@frozen(kw_only=True)
class SolveOptions:
    """Options of traced functions; the keyword arguments of `CompiledModel.solve_fn`, all hashable.

    Attributes
    ----------
    method : str
        Of the run.
    rtol, atol : float or None
        Tolerances; None for those that suit the precision of the process.
    max_step : float
        The largest step [s].
    max_steps : int
        Attempted steps after which a run ends with a status.
    dense : bool
        Whether the result can be evaluated at any time.
    throw : bool
        Whether a run that fails raises an error.
    portable : bool
        Whether traced programs call no machine code of this process.

    Raises
    ------
    OptionError
        For values that are not of the kind that is needed.
    """

    method: str
    rtol: float | None = None
    atol: float | None = None
    max_step: float = math.inf
    max_steps: int = TRACED_MAX_STEPS
    dense: bool = False
    throw: bool = False
    portable: bool = False

    def __post_init__(self) -> None:
        if not self.max_step > 0.0:
            raise OptionError(f"max_step must be a positive number of seconds, not {self.max_step!r}")
        rtol, atol = self.tolerances
        kept: dict[str, Any] = {} if self.rtol is None else {"rtol": rtol}
        kept |= {} if self.atol is None else {"atol": atol}
        flags = {name: flag(name, getattr(self, name)) for name in ("dense", "throw", "portable")}
        kept |= {"max_step": float(self.max_step), "max_steps": int(self.max_steps)}
        set_checked(self, **kept, **flags)

    @property
    def tolerances(self) -> tuple[float, float]:
        """Tolerances; by default those for double precision."""
        asked = zip((self.rtol, self.atol), DEFAULT_TOLERANCES, strict=True)
        return tolerances(*(default if value is None else value for value, default in asked))


def tighter(options: _Estimating) -> _Estimating:
    """Return the options of the run beside another from which its error is estimated."""
    return replace(options, rtol=options.rtol * TIGHTER, atol=scaled(options.atol, TIGHTER), error_estimate=False)


def is_no_events(events: Any) -> bool:
    """Whether events are left out."""
    return isinstance(events, tuple) and not events


def repeated(options: _Shared) -> _Shared:
    """Return options, marked as those that further calls share; what is made of them by `replace` is not marked."""
    set_checked(options, repeats=True)
    return options


def set_checked(options: object, **values: Any) -> None:
    """Write checked values into options that are being made."""
    options.__dict__.update(values)
