"""`HybridSweep`: the results of many motions with contacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, unknown_name
from ..ir.program import Layout
from .motion import reaction_hint
from .sweep import CaseResults, SweepStatistics

__all__ = ["HybridSweep", "States"]


@final
@dataclass(frozen=True, eq=False)
class States:
    """States of cases: times (k,), (q, q_dot) (k, 2 n_q), the numbers of their cases and modes (-1: none).

    What they slip with: `directions` are (k, n_contacts, 2), `sides` and `rest` speeds (k, n_contacts). Modes are
    numbered as `dalembert.hybrid.HybridAutomaton` does.
    """

    t: FloatArray
    x: FloatArray
    case: NDArray[np.intp]
    mode: NDArray[np.intp]
    directions: FloatArray
    sides: FloatArray
    rest: FloatArray

    @classmethod
    def nothing_yet(cls, count: int, size: int, contacts: int) -> States:
        """Return states to write to."""
        case, mode = np.arange(count), np.full(count, -1)
        directions, sides, rest = np.zeros((count, contacts, 2)), *np.ones((2, count, contacts))
        return cls(np.full(count, np.nan), np.full((count, 2 * size), np.nan), case, mode, directions, sides, rest)

    def part(self, some: NDArray[np.intp]) -> States:
        """Return some of them."""
        fields: Any = (self.t, self.x, self.case, self.mode, self.directions, self.sides, self.rest)
        return States(*(values[some] for values in fields))


@final
class HybridSweep(CaseResults):
    """The cases of a sweep of a scene with contacts; used like `dalembert.results.sweep.Sweep`.

    Attributes
    ----------
    phases : ndarray (n_case,) of int
        How many phases each motion had.
    t, status, steps, t_eval, parameters, initial, events, reduced, stats
        As for a `Sweep`.
    """

    _kind = "HybridSweep"

    def __init__(
        self,
        name: str,
        layout: Layout,
        varied: tuple[dict[str, FloatArray], dict[str, FloatArray]],
        ends: FloatArray,
        t_eval: FloatArray | None,
        axes: Mapping[str, FloatArray],
        stats: SweepStatistics,
        states: tuple[States, States | None],
        phases: NDArray[np.int64],
        modes: Mapping[int, Mapping[str, str]],
        value: Callable[[str, States], FloatArray],
    ) -> None:
        super().__init__(name, "by mode", layout, varied, ends, t_eval, axes, stats)
        self._last, self._samples = states
        self.phases, self._modes, self._value = phases, dict(modes), value

    def mode(self, contact: str) -> NDArray[np.str_]:
        """Return the state of a contact at the end of each case (n_case,), or (n_case, n_t) at the samples."""
        known = next(iter(self._modes.values()), {})
        if self._modes and contact not in known:
            raise OptionError(unknown_name("contact", contact, known))
        states = self._last if self._samples is None else self._samples
        numbers, places = np.unique(states.mode, return_inverse=True)
        words = np.array([self._modes[int(number)][contact] if number >= 0 else "none" for number in numbers])
        found = words[places]
        return found if self.t_eval is None else found.reshape(len(self), -1)

    def _known(self, key: Any) -> str:
        """Return the text of a name that can be asked for."""
        layout, text, names = self._layout, str(key), self._names()
        name = layout.aliases.get(text, text)
        if name not in names and text not in names:
            raise UnknownNameError(unknown_name("output", text, names) + reaction_hint(layout, name))
        return text

    def _final(self, key: Any) -> FloatArray:
        return self._value(self._known(key), self._last)

    def _sampled(self, key: Any) -> FloatArray:
        assert self._samples is not None
        return self._value(self._known(key), self._samples).reshape(len(self), -1)
