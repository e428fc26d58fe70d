"""Interfaces of runs: one prepared run, its start, many cases, and runs that traced functions leave to the host."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..ir.program import Layout
from ..methods.status import Status
from ..stops.samples import Samples

if TYPE_CHECKING:
    from ..lanes.workspace import LoopProgress
    from ..scene.symbol_table import InputSymbol
    from ..subset.arguments import OwnedAddress
    from .llvm.prepared import Admission


Final = tuple[FloatArray, Status]

StartCode = Callable[[float, FloatArray, Sequence[float]], tuple[FloatArray, FloatArray]]
"""Time, parameters (n_p,) and given values (n_given,) -> constants (n_c,) and the outputs of a start kernel (n_out,).

What is returned is overwritten by the next call of the same thread.
"""


class Prepared(Protocol):
    """A prepared run, which threads may share."""

    def __call__(self, state: FloatArray, p: FloatArray, /) -> FloatArray:
        """Return the final state (n_y,) from a state (n_y,) and parameters (n_p,)."""
        ...

    def status(self) -> Status:
        """Return the status of the last run of this thread."""
        ...


class _Last(threading.local):
    status = Status.SUCCESS


@final
class PreparedStates:
    """A prepared run by a function from a state and parameters to the final state and the status.

    What `admission` rejects is not run so, and ends as it says.
    """

    def __init__(self, run: Callable[[FloatArray, FloatArray], Final], admission: Admission | None = None) -> None:
        self._run, self._admission, self._last = run, admission, _Last()

    def __call__(self, state: FloatArray, p: FloatArray, /) -> FloatArray:
        """See `Prepared`."""
        status = Status.SUCCESS if self._admission is None else self._admission(state, p)
        if self._admission is None or status is Status.SUCCESS:
            y, self._last.status = self._run(state, p)
        else:
            y, self._last.status = self._admission.final_of_refused(status, state, p)
        return y

    def status(self) -> Status:
        """See `Prepared`."""
        return self._last.status


@final
@dataclass(eq=False)
class CaseRun:
    """Cases about to run.

    Attributes
    ----------
    work : function
        Runs cases until none is left; for as many threads as there are to call it. A function without arguments that it
        is given, or None, is called when it returns to Python before that, until the function returns True.
    turn : ndarray (1,) of int
        Number of cases begun, at most; writing the number of all stops the work when those that have been
        begun have ended, and `dalembert.threads.STOPPED` within a fraction of a second.
    finish : function without arguments
        To be called when all is done.
    call : function of an array like `turn`, optional
        What `work` calls, made anew and with another count, for loops that do so themselves.
    stop : function without arguments, optional
        To be called again and again until stopped work ends. Where there is one, `work` does not return to Python
        before its end, so that Ctrl-C does not reach the thread that calls it.
    """

    work: Callable[..., None]
    turn: NDArray[np.int64]
    finish: Callable[[], None]
    call: Callable[[NDArray[np.int64]], LoopCall] | None = None
    stop: Callable[[], None] | None = None


@final
@frozen(eq=False)
class LoopCall:
    """A call of a loop over lanes.

    Attributes
    ----------
    entry : OwnedAddress
        Of a function of the address of packed arguments.
    packed_args : ndarray (n,) of int
        Those of `dalembert.lanes.sweep_arguments.SweepArguments`.
    progress : LoopProgress
        Where the loop is, and whether it returns before its end.
    steps, occurrences : ndarray
        Records of a case that is alone (`dalembert.lanes.step_records`), with no rows where none are made.
    held : object
        Arrays that must stay alive.
    """

    entry: OwnedAddress
    packed_args: NDArray[np.int64]
    progress: LoopProgress
    steps: FloatArray
    occurrences: FloatArray
    held: object


@final
class HostRun(NamedTuple):
    """The results of cases that traced functions left to the host.

    Attributes
    ----------
    rows : ndarray (k, n_t, n)
        State, coordinates, rates and outputs at times, NaN where runs did not reach them.
    end : ndarray (k, n)
        The same where they ended.
    numbers : ndarray (k, 3)
        When they ended, statuses, and accepted steps.
    happened : ndarray (k, n_events, 3)
        Of each event how often it occurred, and when first and last.
    reduced : ndarray (k, n_reductions)
    """

    rows: Any
    end: Any
    numbers: Any
    happened: Any
    reduced: Any


class HostRunner(Protocol):
    """Runs of cases on the host, hashable: from times (k, n_t), initial values and parameters to a `HostRun`.

    Inputs with knots are records by name, whose knots and values have one row a case (k, n).
    """

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the given initial values."""
        ...

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of what is returned of the motion."""
        ...

    @property
    def reductions(self) -> Mapping[str, Any]:
        """Reductions by name."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the events."""
        ...

    def __call__(self, t: FloatArray, initial: FloatArray, p: FloatArray, records: Mapping[str, Samples]) -> HostRun:
        """Return the results of the cases."""
        ...


@final
@frozen(eq=False)
class HostedRuns:
    """The host's runs behind a traced function, with names, events and rejections.

    Attributes
    ----------
    runner : HostRunner
    layout : Layout
        Of the model whose parameters and names these are.
    inputs : tuple of InputSymbol
        Inputs of the scene.
    state : tuple of str
        Names of the state; those of coordinates, rates and outputs follow it in the runner's columns.
    watched : (Kernel, Kernel) or None
        Values and rates of the expressions of events (see `EventFunctions`); None where there are
        contacts.
    terminal : tuple of bool
        Whether each event may end a run.
    refusal : str
        Why such runs have no derivatives; nothing where they have.
    """

    runner: HostRunner
    layout: Layout
    inputs: tuple[InputSymbol, ...]
    state: tuple[str, ...]
    watched: tuple[Kernel, Kernel] | None
    terminal: tuple[bool, ...]
    refusal: str
