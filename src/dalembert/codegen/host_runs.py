"""Runs of traced functions on the host."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, final

from ..arrays import FloatArray
from ..ir.kernel import Kernel
from ..ir.program import Layout
from ..stops.samples import Samples

if TYPE_CHECKING:
    from ..scene.symbol_table import InputSymbol


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
@dataclass(frozen=True, eq=False)
class HostedRuns:
    """The host's runs behind a traced function, with names, events and refusals.

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
        Values of the expressions of events, and those with their rates (see `EventFunctions`); None where there are
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
