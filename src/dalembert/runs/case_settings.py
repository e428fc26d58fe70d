"""Columns of values of the cases of a sweep, and the settings that they have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, ValueInputError, unknown_name
from ..events.event_code import EventCode
from ..frozen import frozen
from ..ir.program import Layout
from ..lanes.cases import BlockResult, CaseBlock
from ..options import SweepOptions
from ..results.cases import CaseSet, case_set
from ..steps.problem import IntegrationProblem
from ..threads import available_threads
from ..values import array_of, traced_note

if TYPE_CHECKING:
    from .cases import Cases


@final
@frozen(eq=False)
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
    check_settings(cases, options)
    threads = available_threads() if options.threads is None else options.threads
    limits = {name: getattr(options, name) for name in _LIMITS}
    return CaseSettings(options.t_eval, method, **limits, threads=threads, progress=options.progress)


_LIMITS = ("rtol", "atol", "max_step", "max_steps")


def check_settings(cases: Cases, options: SweepOptions) -> None:
    """Reject options that make no sense with the spans of some cases; errors as for `common_settings`."""
    start, end = cases.span["start"], cases.span["end"]
    for name, ends in cases.span.items():
        if ends.ndim != 1 or not ends.size:
            raise ValueInputError(f"the {name} of t_span has shape {ends.shape}; give one time, or one for each case")
    times = options.t_eval
    if times is not None and any(len(ends) > 1 for ends in cases.span.values()):
        raise OptionError("t_eval is common to all cases; give one t_span for all of them, or no t_eval")
    limits = {name: getattr(options, name) for name in _LIMITS}
    nothing = np.zeros(0)
    IntegrationProblem(t0=_finite(start), t1=_finite(end), y0=nothing, constants=nothing, t_eval=times, **limits)


def _finite(times: FloatArray) -> float:
    """Return the first of some times that is finite, or the first where none is: others are those of their cases."""
    finite = np.isfinite(times)
    return float(times[int(np.argmax(finite))]) if times.size else 0.0


@final
class Spans(NamedTuple):
    """Starts and ends, (k,) or (1,), of the cases of a sweep, copied from what was given."""

    first: FloatArray
    last: FloatArray


def spans_of(t_span: Any) -> Spans:
    """Return starts and ends of the cases of a sweep; `Spans` as they are.

    Raises
    ------
    ValueInputError
        For what are no numbers or arrays.
    """
    if type(t_span) is Spans:
        return t_span
    try:
        first, last = [
            np.array((t,)) if type(t) is float else np.array(array_of(t), ndmin=1, order="C") for t in t_span
        ]
    except (TypeError, ValueError) as error:
        message = f"t_span must be start and end, numbers or arrays, not {t_span!r}{traced_note(error)}"
        raise ValueInputError(message) from None
    return Spans(first, last)


def with_grid(
    layout: Layout, grid: CaseSet, initial: Mapping[Any, Any], parameters: Mapping[Any, Any]
) -> tuple[dict[Any, Any], dict[Any, Any]]:
    """Return initial values and parameters with the columns of a grid, each where it belongs."""
    grid = case_set(grid)
    initial, parameters = dict(initial), dict(parameters)
    for name, column in grid.columns().items():
        home = parameters if name in layout.parameters else initial
        if name not in (*layout.parameters, *layout.initial):
            raise UnknownNameError(unknown_name("axis", name, (*layout.given, *layout.initial)))
        if any(layout.aliases.get(str(key), str(key)) == name for key in home):
            raise ValueInputError(f"{name!r} is an axis of the grid and is given beside it; give it once")
        home[name] = column
    return initial, parameters
