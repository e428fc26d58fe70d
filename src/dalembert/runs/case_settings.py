"""Settings that the cases of a sweep have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, ValueInputError
from ..events.event_code import EventCode
from ..lanes.cases import BlockResult, CaseBlock
from ..options import SweepOptions
from ..steps.problem import IntegrationProblem
from ..threads import available_threads

if TYPE_CHECKING:
    from .cases import Cases


@final
@dataclass(frozen=True, eq=False)
class CaseSettings:
    """Options that all cases have in common."""

    t_eval: FloatArray | None
    method: str
    rtol: float
    atol: float
    max_step: float
    max_steps: int
    threads: int
    progress: bool
    watch: EventCode | None = None
    judge: Callable[[str, CaseBlock, BlockResult], None] | None = None
    note: str = ""
    apart: NDArray[np.bool_] | None = None
    carried: FloatArray | None = None


def common_settings(cases: Cases, options: SweepOptions, method: str) -> CaseSettings:
    """Return the settings of a sweep by a method, checked as those of a single run are.

    Raises
    ------
    OptionError, ValueInputError
        For settings that make no sense, or not with these cases.
    """
    for name, ends in cases.span.items():
        if ends.ndim != 1 or not ends.size:
            raise ValueInputError(f"the {name} of t_span has shape {ends.shape}; give one time, or one for each case")
    times = options.t_eval
    if times is not None and any(len(ends) > 1 for ends in cases.span.values()):
        raise OptionError("t_eval is common to all cases; give one t_span for all of them, or no t_eval")
    limits = {name: getattr(options, name) for name in ("rtol", "atol", "max_step", "max_steps")}
    IntegrationProblem(
        t0=_finite(cases.span["start"]),
        t1=_finite(cases.span["end"]),
        y0=np.zeros(0),
        constants=np.zeros(0),
        t_eval=times,
        **limits,
    )
    threads = available_threads() if options.threads is None else options.threads
    return CaseSettings(times, method, **limits, threads=threads, progress=options.progress)


def _finite(times: FloatArray) -> float:
    """Return the first of some times that is finite, or the first where none is: others are those of their cases."""
    finite = np.isfinite(times)
    return float(times[int(np.argmax(finite))]) if times.size else 0.0
