"""The stops of many cases, and their table for loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.kernel import Kernel
from .addresses import NO_CODE, AddressTable, OwnedAddress
from .input_steps import InputTable
from .stops import StopTable

if TYPE_CHECKING:
    from .segments import Segments

__all__ = ["CaseStops", "Landing", "StopAction", "StopLists"]

Landing = Callable[[float, FloatArray, FloatArray, FloatArray], FloatArray]
"""From a time, a state (n_y,) and the constants (n_c,) before and after it to the state after it."""


@final
@dataclass(frozen=True, eq=False)
class StopAction:
    """An action at stops: a kernel of (t, y, c), or a Python function, that sets the components `places` of a state."""

    places: tuple[int, ...]
    kernel: Kernel | None = None
    function: Landing | None = None


@final
@dataclass(frozen=True, eq=False)
class StopLists:
    """Lists of stops; see `StopTable` for the arrays."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    times: FloatArray
    acts: NDArray[np.int64]
    middles: FloatArray


@final
@dataclass(frozen=True, eq=False)
class CaseStops:
    """The stops of many cases.

    Attributes
    ----------
    lists : StopLists
    place : int or None
        Parameter at whose value conditions are decided.
    actions : tuple of StopAction
        In the order in which they happen at one time; the bits of `lists` are their numbers.
    codes : tuple of OwnedAddress
        Actions as code for the lanes of a loop.
    along : Segments or None
        Constants along the run of a case that is alone.
    behind : bool
        Whether accepted steps of that run hold the states behind stops, not those before.
    prepare : OwnedAddress
        Code of the constants, for that run.
    failure : function without arguments
        Raises what Python functions among the actions have raised.
    """

    lists: StopLists
    place: int | None
    actions: tuple[StopAction, ...]
    codes: tuple[OwnedAddress, ...] = ()
    along: Segments | None = None
    behind: bool = False
    prepare: OwnedAddress = NO_CODE
    failure: Callable[[], None] | None = None

    def compiled(
        self,
        code: Callable[[StopAction], OwnedAddress],
        prepare: OwnedAddress = NO_CODE,
        failure: Callable[[], None] | None = None,
    ) -> CaseStops:
        """Return the stops with actions as code; for `prepare` and `failure` see above."""
        return replace(self, codes=tuple(map(code, self.actions)), prepare=prepare, failure=failure)

    def raise_failure(self) -> None:
        """Raise what Python functions among the actions have raised since the last call, if anything."""
        if self.failure is not None and self.calls:
            self.failure()

    @property
    def calls(self) -> bool:
        """Whether actions are Python functions, whose errors wait for `dalembert.codegen.host_code.raise_failure`."""
        return any(action.function is not None for action in self.actions)

    def table(self, inputs: InputTable, lanes: int, constants: int) -> StopTable:
        """Return the table of the stops, and of inputs, for a loop over lanes with so many constants."""
        sizes = [len(action.places) for action in self.actions]
        next_, until, acting = np.zeros((3, lanes), np.int64)
        return StopTable(
            first=self.lists.first,
            last=self.lists.last,
            times=self.lists.times,
            acts=self.lists.acts,
            middles=self.lists.middles,
            place=-1 if self.place is None else self.place,
            actions=AddressTable(self.codes),
            columns=np.cumsum([0, *sizes]).astype(np.int64),
            places=np.array([place for action in self.actions for place in action.places], np.int64),
            next=next_,
            until=until,
            acting=acting,
            before=np.zeros((1 + (constants if self.calls else 0), lanes)),
            acted=np.zeros((max(sizes, default=0), lanes)),
            prepared=np.zeros((constants, lanes)),
            inputs=inputs,
        )
