"""States of the cases of sweeps, and values by name computed from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from .parts import ENERGIES, warn_of_energy
from .shared_loads import output_rows

NO_MODE = -1
"""Number of the mode of scenes without contacts."""

_BLOCK = 8192
"""States of which values are computed at a time: their intermediate values stay near the processor."""


@final
@frozen(eq=False)
class SweepStates:
    """States of cases: times (k,), variables (k, 2 n_q + n_z), the numbers of their cases and modes (-1: none).

    Modes are numbered as `HybridAutomaton` does. `history` (k,) is a number that tells apart the modes
    of the phases before. `added` (k, 4 n_contacts) are the parameters that the contacts add to those of the scene.
    """

    t: FloatArray
    x: FloatArray
    case: NDArray[np.intp]
    mode: NDArray[np.intp]
    history: NDArray[np.int64]
    added: FloatArray

    @classmethod
    def empty(cls, count: int, size: int, added: int) -> SweepStates:
        """Return memory for states, of so many variables and parameters that contacts add."""
        case, mode, history = np.arange(count), np.full(count, -1), np.zeros(count, np.int64)
        t, x = np.full(count, np.nan), np.full((count, size), np.nan)
        return cls(t, x, case, mode, history, np.zeros((count, added)))

    def part(self, some: NDArray[np.intp]) -> SweepStates:
        """Return some of them."""
        return SweepStates(*(values[some] for values in self.arrays()))

    def arrays(self) -> list[NDArray[Any]]:
        """Return all arrays."""
        return [getattr(self, name) for name in self.__dataclass_fields__]


@final
@frozen(eq=False)
class ContactStates:
    """States of cases whose contacts change: the last ones and the samples, case by case, if there are any.

    Attributes
    ----------
    last : States
    samples_of_cases : States or None
    value : function of a name and States
        Values by name.
    contacts : sequence of str
        Names of the contacts.
    words : dict of int to mapping of str to str
        The state of each contact in the modes by number.
    phases : ndarray (n_case,)
        Number of phases of each motion.
    """

    last: SweepStates
    samples_of_cases: SweepStates | None
    value: Callable[[str, SweepStates], FloatArray]
    contacts: Sequence[str]
    words: dict[int, Mapping[str, str]]
    phases: NDArray[np.int64]

    @property
    def y(self) -> FloatArray:
        """Final coordinates, rates and first-order states (n_case, 2 n_q + n_z)."""
        return self.last.x

    @property
    def samples(self) -> FloatArray | None:
        """The same at the samples (n_case, n_t, 2 n_q + n_z)."""
        given = self.samples_of_cases
        return None if given is None else given.x.reshape(len(self.last.t), -1, given.x.shape[1])

    def at_ends(self, names: Sequence[str]) -> list[FloatArray]:
        """Return final values (n_case,)."""
        return [self.value(name, self.last) for name in names]

    def at_samples(self, names: Sequence[str]) -> list[FloatArray]:
        """Return values (n_case, n_t) at the samples."""
        assert self.samples_of_cases is not None
        return [self.value(name, self.samples_of_cases).reshape(len(self.last.t), -1) for name in names]

    @property
    def modes(self) -> dict[str, NDArray[np.str_]]:
        """State of each contact at the end of each case (n_case,), or (n_case, n_t) at the samples."""
        states = self.last if self.samples_of_cases is None else self.samples_of_cases
        numbers, places = np.unique(states.mode, return_inverse=True)
        shape = (len(self.last.t),) if self.samples_of_cases is None else (len(self.last.t), -1)
        found = {}
        for contact in self.contacts:
            words = np.array([self.words[int(n)][contact] if n >= 0 else "none" for n in numbers], dtype=np.str_)
            found[contact] = words[places].reshape(shape)
        return found

    def alike(self, other: ContactStates) -> NDArray[np.bool_]:
        """Return which states (k,) are in the same phase as those of another sweep."""
        mine, theirs = ((each.samples_of_cases or each.last) for each in (self, other))
        alike: NDArray[np.bool_] = (mine.mode >= 0) & (mine.mode == theirs.mode) & (mine.history == theirs.history)
        return alike

    def take(self, some: NDArray[np.bool_], other: ContactStates, t: FloatArray) -> None:
        """Copy the states of some cases (n_case,) of another sweep, which end at times t (n_case,)."""
        self.phases[some] = other.phases[some]
        for mine, theirs in zip(self.last.arrays(), other.last.arrays(), strict=True):
            mine[some] = theirs[some]
        if self.samples_of_cases is not None and other.samples_of_cases is not None:
            rows = np.repeat(some, len(self.samples_of_cases.t) // len(some))
            for mine, theirs in zip(self.samples_of_cases.arrays(), other.samples_of_cases.arrays(), strict=True):
                mine[rows] = theirs[rows]
        self.last.t[some] = t[some]
        self.words.update(other.words)


@final
@dataclass(eq=False)
class ProgramStates:
    """States of cases in one program: final ones y (n_case, n_y) at times t (n_case,), and samples (n_case, n_t, n_y).

    `constants` are those of some cases, a slice, at times (k, n_t); `t_eval` (n_t,) are the times of the samples.
    """

    program: Program
    constants: Callable[[slice, FloatArray], FloatArray]
    t: FloatArray
    y: FloatArray
    samples: FloatArray | None
    t_eval: FloatArray | None
    phases: ClassVar[NDArray[np.int64]] = np.zeros(0, np.int64)
    modes: ClassVar[dict[str, NDArray[np.str_]]] = {}

    def at_ends(self, names: Sequence[str]) -> list[FloatArray]:
        """Return final values (n_case,)."""
        return [each[:, 0] for each in self._values(names, self.y[:, np.newaxis, :], self.t[:, np.newaxis])]

    def at_samples(self, names: Sequence[str]) -> list[FloatArray]:
        """Return values (n_case, n_t) at the samples."""
        assert self.samples is not None and self.t_eval is not None
        return self._values(names, self.samples, np.broadcast_to(self.t_eval, self.samples.shape[:2]))

    def take(self, some: NDArray[np.bool_], other: ProgramStates, t: FloatArray) -> None:
        """Copy the states of some cases (n_case,) of another sweep."""
        self.y[some] = other.y[some]
        if self.samples is not None and other.samples is not None:
            self.samples[some] = other.samples[some]

    def _values(self, keys: Sequence[str], y: FloatArray, t: FloatArray) -> list[FloatArray]:
        """Return values (n_case, n_t) of some keys at states (n_case, n_t, n_y), a block of cases at a time."""
        layout = self.program.layout
        found: list[FloatArray] = []
        sources: list[tuple[FloatArray, str, int | None]] = []
        for key in keys:
            name = layout.aliases.get(key, key)
            if name in layout.state:
                found.append(y[:, :, layout.state.index(name)].copy())
                continue
            found.append(np.empty(y.shape[:2]))
            sources.append((found[-1], *self._source(name, key)))
        needed = dict.fromkeys(kernel for _, kernel, _ in sources)
        if "energy" in needed:
            needed = {"expand": None, **needed}
        width = max(1, y.shape[1])
        step = max(1, _BLOCK // width)
        for first in range(0, len(y) if sources and y.shape[1] else 0, step):
            block = slice(first, first + step)
            count = len(y[block])
            c = self.constants(block, t[block])
            states, times, outputs = y[block].reshape(count * width, -1), t[block].ravel(), dict[str, FloatArray]()
            for kernel in needed:
                at = outputs["expand"] if kernel == "energy" else states
                rows = partial(interpret_rows, self.program.kernel(kernel))
                if kernel == "outputs":
                    rows = partial(output_rows, self.program)
                outputs[kernel] = rows(times, at, c)
            for values, kernel, column in sources:
                chosen = outputs[kernel].sum(axis=1) if column is None else outputs[kernel][:, column]
                values[block] = chosen.reshape(count, width)
        return found

    def _source(self, name: str, text: str) -> tuple[str, int | None]:
        """Return the kernel that computes `name`, and its output; None for the sum of all."""
        layout = self.program.layout
        expanded = layout.variables
        if name in expanded:
            return "expand", expanded.index(name)
        if name in layout.state_rates:
            return "rhs", len(layout.state) - len(layout.states) + layout.state_rates.index(name)
        for output in (name, text):
            if output in layout.outputs:
                return "outputs", layout.outputs.index(output)
        warn_of_energy(self.program, name)
        return "energy", None if name == "energy" else ENERGIES.index(name) - 1  # the first is the sum of the others
