"""`HybridSweep`: the results of many motions with contacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, unknown_name
from ..hybrid.modes import STATES
from ..ir.program import Layout
from .case_results import CaseResults, SweepStatistics
from .estimate import NamedArrays
from .labels import distinct, flags

if TYPE_CHECKING:
    import xarray

__all__ = ["HybridSweep", "States"]


@final
@dataclass(frozen=True, eq=False)
class States:
    """States of cases: times (k,), variables (k, 2 n_q + n_z), the numbers of their cases and modes (-1: none).

    Modes are numbered as `dalembert.hybrid.HybridAutomaton` does. `history` (k,) is a number that tells apart the modes
    of the phases before. `added` (k, 4 n_contacts) are the parameters that the contacts add to those of the scene.
    """

    t: FloatArray
    x: FloatArray
    case: NDArray[np.intp]
    mode: NDArray[np.intp]
    history: NDArray[np.int64]
    added: FloatArray

    @classmethod
    def empty(cls, count: int, size: int, added: int) -> States:
        """Return memory for states, of so many variables and parameters that contacts add."""
        case, mode, history = np.arange(count), np.full(count, -1), np.zeros(count, np.int64)
        t, x = np.full(count, np.nan), np.full((count, size), np.nan)
        return cls(t, x, case, mode, history, np.zeros((count, added)))

    def part(self, some: NDArray[np.intp]) -> States:
        """Return some of them."""
        return States(*(values[some] for values in self.arrays()))

    def arrays(self) -> list[NDArray[Any]]:
        """Return all arrays."""
        return [getattr(self, name) for name in self.__dataclass_fields__]


@final
class HybridSweep(CaseResults):
    """The cases of a sweep of a scene with contacts; used like `dalembert.results.sweep.Sweep`.

    Attributes
    ----------
    phases : ndarray (n_case,) of int
        Number of phases of each motion.
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
        contacts: Sequence[str],
        modes: Mapping[int, Mapping[str, str]],
        value: Callable[[str, States], FloatArray],
    ) -> None:
        super().__init__(name, "by mode", layout, varied, ends, t_eval, axes, stats)
        self._last, self._samples = states
        self.phases, self._modes, self._value = phases, dict(modes), value
        self._contacts = tuple(contacts)

    def mode(self, contact: str) -> NDArray[np.str_]:
        """Return the state of a contact at the end of each case (n_case,), or (n_case, n_t) at the samples."""
        if contact not in self._contacts:
            raise OptionError(unknown_name("contact", contact, self._contacts))
        states = self._states
        numbers, places = np.unique(states.mode, return_inverse=True)
        words = np.array([self._modes[int(number)][contact] if number >= 0 else "none" for number in numbers])
        found = words[places]
        return found if self.t_eval is None else found.reshape(len(self), -1)

    def to_xarray(self, units: Mapping[Any, str] | None = None) -> xarray.Dataset:
        """Return the sweep as `Sweep.to_xarray` does, with ``phases``, and ``name_mode`` of each contact as a number.

        The attributes ``flag_values`` and ``flag_meanings`` of ``name_mode`` have the meaning of the numbers.
        """
        found = super().to_xarray(units)
        status, values = found["status"], next(iter(found.data_vars.values()))
        names = ("none", *STATES)
        columns: dict[str, Any] = {"phases": (status.dims, self.phases.reshape(status.shape))}
        for contact in self._contacts:
            words, places = np.unique(self.mode(contact), return_inverse=True)
            codes = np.array([names.index(word) for word in words], np.int8)[places]
            columns[f"{contact}_mode"] = (values.dims, codes.reshape(values.shape), flags(names))
        for name, column in columns.items():
            found[distinct(name, [*found.variables, *found.dims], "_of_contacts")] = column
        return found

    def _take_states(self, some: NDArray[np.bool_], other: HybridSweep) -> None:
        self.phases[some] = other.phases[some]
        for mine, theirs in zip(self._last.arrays(), other._last.arrays(), strict=True):
            mine[some] = theirs[some]
        self._last.t[some] = self._own_t[some]
        self._modes |= other._modes

    def _compared(self, twin: HybridSweep) -> NamedArrays:
        return _SamePhases(self, twin)

    @property
    def _states(self) -> States:
        """The states that `self[...]` is computed from: the samples, or the ends of the cases."""
        return self._last if self._samples is None else self._samples

    def _known(self, key: Any) -> str:
        """Return a name as text; raise where the sweep does not have it."""
        layout, text, names = self._layout, str(key), self._names()
        name = layout.aliases.get(text, text)
        if name not in names and text not in names:
            raise self._unknown(text, names)
        return text

    def _final(self, key: Any) -> FloatArray:
        return self._value(self._known(key), self._last)

    def _sampled(self, key: Any) -> FloatArray:
        assert self._samples is not None
        return self._value(self._known(key), self._samples).reshape(len(self), -1)


@final
@dataclass(frozen=True, eq=False)
class _SamePhases:
    """The values of a twin by name, NaN where it is not in the same phase as the run."""

    run: HybridSweep
    twin: HybridSweep

    def __getitem__(self, key: Any) -> FloatArray:
        mine, theirs = self.run._states, self.twin._states
        same = (mine.mode >= 0) & (mine.mode == theirs.mode) & (mine.history == theirs.history)
        values = self.twin[key]
        return np.where(same.reshape(values.shape), values, np.nan)
