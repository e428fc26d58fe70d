"""`Sweep`: the results of many cases of a scene without contacts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from .case_results import CaseResults, SweepStatistics
from .motion import ENERGIES, warn_of_energy
from .shared_loads import output_rows

__all__ = ["Sweep"]

_BLOCK = 8192
"""States of which values are computed at a time: their intermediate values stay near the processor."""


@final
class Sweep(CaseResults):
    """The cases of a sweep, in the order in which they were given.

    ``sweep["x"]`` is an array (n_case,) of final values, or (n_case, n_t) where the sweep was given ``t_eval``; so for
    every coordinate, rate, component of the state, output, and the energies.

    Attributes
    ----------
    parameters, initial : dict of str to ndarray (n_case,) or (1,)
        Values given, varied or not.
    t : ndarray (n_case,)
        Time that each case reached [s].
    t_eval : ndarray (n_t,) or None
        Times of the samples.
    status : ndarray (n_case,) of int
        `Status` of each case.
    steps : ndarray (n_case,) of int
        Accepted steps of each case.
    y : ndarray (n_case, n_y)
        Final state of the formulation.
    stats : SweepStatistics
    events : mapping of str to EventCounts
        Count, first and last time of each event in each case; by name or by expression.
    reduced : dict of str to ndarray (n_case,)
        Reductions of every motion; NaN for cases that failed.
    """

    def __init__(
        self,
        program: Program,
        constants: Any,
        varied: tuple[dict[str, FloatArray], dict[str, FloatArray]],
        ends: FloatArray,
        y: FloatArray,
        samples: FloatArray | None,
        t_eval: FloatArray | None,
        axes: Mapping[str, FloatArray],
        stats: SweepStatistics,
    ) -> None:
        super().__init__(program.name, program.formulation, program.layout, varied, ends, t_eval, axes, stats)
        self._program, self._constants = program, constants
        self.y, self.samples = y, samples

    def _take_states(self, some: NDArray[np.bool_], other: Sweep) -> None:
        self.y[some] = other.y[some]

    def _lasting(self) -> tuple[str, ...]:
        layout = self._layout
        return tuple(dict.fromkeys((*layout.variables, *layout.state, *layout.outputs)))

    def _final(self, key: Any) -> FloatArray:
        return self._at_ends([key])[0]

    def _sampled(self, key: Any) -> FloatArray:
        return self._at_samples([key])[0]

    def _by_name(self, names: Iterable[str]) -> dict[str, FloatArray]:
        keys = list(names)
        return dict(zip(keys, self._at_ends(keys) if self.t_eval is None else self._at_samples(keys), strict=True))

    def _at_ends(self, keys: Sequence[Any]) -> list[FloatArray]:
        return [each[:, 0] for each in self._values(keys, self.y[:, np.newaxis, :], self._own_t[:, np.newaxis])]

    def _at_samples(self, keys: Sequence[Any]) -> list[FloatArray]:
        assert self.samples is not None and self._own_t_eval is not None
        return self._values(keys, self.samples, np.broadcast_to(self._own_t_eval, self.samples.shape[:2]))

    def _values(self, keys: Sequence[Any], y: FloatArray, t: FloatArray) -> list[FloatArray]:
        """Return values (n_case, n_t) of some keys at states (n_case, n_t, n_y), a block of cases at a time."""
        layout = self._program.layout
        found: list[FloatArray] = []
        sources: list[tuple[FloatArray, str, int | None]] = []
        for key in keys:
            name = layout.aliases.get(str(key), str(key))
            if name in layout.state:
                found.append(y[:, :, layout.state.index(name)].copy())
                continue
            found.append(np.empty(y.shape[:2]))
            sources.append((found[-1], *self._source(name, str(key))))
        needed = dict.fromkeys(kernel for _, kernel, _ in sources)
        if "energy" in needed:
            needed = {"expand": None, **needed}
        width = max(1, y.shape[1])
        step = max(1, _BLOCK // width)
        for first in range(0, len(y) if sources and y.shape[1] else 0, step):
            block = slice(first, first + step)
            count = len(y[block])
            c = self._constants(block, t[block])
            states, times, outputs = y[block].reshape(count * width, -1), t[block].ravel(), dict[str, FloatArray]()
            for kernel in needed:
                at = outputs["expand"] if kernel == "energy" else states
                rows = partial(interpret_rows, self._program.kernel(kernel))
                if kernel == "outputs":
                    rows = partial(output_rows, self._program)
                outputs[kernel] = rows(times, at, c)
            for values, kernel, column in sources:
                chosen = outputs[kernel].sum(axis=1) if column is None else outputs[kernel][:, column]
                values[block] = chosen.reshape(count, width)
        return found

    def _source(self, name: str, text: str) -> tuple[str, int | None]:
        """Return the kernel that computes `name`, and its output; None for the sum of all."""
        layout = self._program.layout
        expanded = layout.variables
        if name in expanded:
            return "expand", expanded.index(name)
        if name in layout.state_rates:
            return "rhs", len(layout.state) - len(layout.states) + layout.state_rates.index(name)
        for output in (name, text):
            if output in layout.outputs:
                return "outputs", layout.outputs.index(output)
        if name in ENERGIES:
            warn_of_energy(self._program, name)
        if name == "energy":
            return "energy", None
        if name in ENERGIES:  # after the first, which is the sum of the others
            return "energy", ENERGIES.index(name) - 1
        raise self._unknown(text, (*self._names(), *layout.state))
