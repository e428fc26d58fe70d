"""`Sweep`: the results of many cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Self, cast, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import Column, FloatArray, arrays_of
from ..errors import OptionError, UnknownNameError, nesting_named, unknown_name
from ..frozen import frozen
from ..ir.program import Layout
from ..methods.status import Status
from .labels import (
    NamedValues,
    cases_to_xarray,
    ranges,
    request_hint,
    summary,
    to_dataframe,
)
from .parts import ENERGIES
from .plots import plot_cases
from .statistics import CaseFailure, Estimated, EventCounts, NamedArrays, SweepStatistics
from .sweep_states import ContactStates, ProgramStates


@final
class Sweep(Estimated):
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
        Final state of the formulation; with contacts that change, coordinates, rates and first-order states.
    phases : ndarray (n_case,) of int
        Number of phases of each motion; empty where contacts do not change.
    stats : SweepStatistics
    events : mapping of str to EventCounts
        Count, first and last time of each event in each case; by name or by expression.
    reduced : dict of str to ndarray (n_case,)
        Reductions of every motion; NaN for cases that failed.
    """

    def __init__(
        self,
        name: str,
        formulation: str,
        layout: Layout,
        varied: tuple[Mapping[str, Column], Mapping[str, Column]],
        ends: FloatArray,
        t_eval: FloatArray | None,
        axes: Mapping[str, FloatArray],
        stats: Callable[..., SweepStatistics],
        states: ProgramStates | ContactStates,
    ) -> None:
        self._name, self._formulation, self._layout = name, formulation, layout
        self.given = varied
        self.t, self.status, self.steps = ends[:, 0], ends[:, 1].astype(np.int8), ends[:, 2].astype(np.int64)
        self.t_eval = None if t_eval is None else t_eval.copy()
        self._own_t = self.t
        self.axes, self._stats, self._states = dict(axes), stats, states

    @cached_property
    def stats(self) -> SweepStatistics:
        """Cost of the sweep, and its tolerances."""
        return self._stats(steps=int(np.sum(self.steps)))

    @cached_property
    def initial(self) -> dict[str, FloatArray]:
        """Given initial values (n_case,) or (1,)."""
        return arrays_of(self.given[0])

    @cached_property
    def parameters(self) -> dict[str, FloatArray]:
        """Parameters (n_case,) or (1,)."""
        own = self._layout.set_by_runs
        return {name: values for name, values in arrays_of(self.given[1]).items() if name not in own}

    @cached_property
    def events(self) -> NamedValues[EventCounts]:
        """Counts and times of events by name."""
        return NamedValues("event", {})

    @cached_property
    def reduced(self) -> NamedValues[FloatArray]:
        """Reductions by name."""
        return NamedValues("reduction", {})

    def _ends(self) -> FloatArray:
        return self.y

    @property
    def y(self) -> FloatArray:
        """Final states (n_case, n_y)."""
        return self._states.y

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components of the states."""
        return self._layout.state

    @property
    def samples(self) -> FloatArray | None:
        """States at the samples (n_case, n_t, n_y), None without any."""
        return self._states.samples

    @property
    def phases(self) -> NDArray[np.int64]:
        """Number of phases of each motion (n_case,); empty where contacts do not change."""
        return self._states.phases

    @property
    def modes(self) -> dict[str, NDArray[np.str_]]:
        """State of each contact at the end of each case (n_case,), or (n_case, n_t) at the samples."""
        return self._states.modes

    def mode(self, contact: str) -> NDArray[np.str_]:
        """Return the state of a contact at the end of each case (n_case,), or (n_case, n_t) at the samples."""
        modes = self.modes
        if contact not in modes:
            raise OptionError(unknown_name("contact", contact, modes))
        return modes[contact]

    def _by_name(self, names: Iterable[Any]) -> dict[Any, FloatArray]:
        """Return ``self[name]`` of several names, which share computations."""
        keys = list(names)
        known = [self._known(key) for key in keys]
        found = self._states.at_ends(known) if self.t_eval is None else self._states.at_samples(known)
        return dict(zip(keys, found, strict=True))

    def _final(self, key: Any) -> FloatArray:
        """Return final values (n_case,) of something."""
        return self._states.at_ends([self._known(key)])[0]

    def _known(self, key: Any) -> str:
        """Return a name as text; raise where the sweep does not have it."""
        text, names = str(key), self._names()
        if self._layout.aliases.get(text, text) in names or text in names:
            return text
        known = unknown_name("output", text, dict.fromkeys(names))
        hint = f" It is a reduction: sweep.reduced[{text!r}]." if text in self.reduced else ""
        raise UnknownNameError(known + hint + request_hint(self._layout, text))

    def __len__(self) -> int:
        return len(self.t)

    def with_events(self, names: Sequence[str], happened: FloatArray, kept: Sequence[str], reduced: FloatArray) -> Self:
        """Return this sweep with its reductions and events (n_case, 3 n_events): numbers, first and last times."""
        aliases = self._layout.aliases
        self.reduced = NamedValues("reduction", {name: reduced[:, i] for i, name in enumerate(kept)}, aliases)
        counts = {
            name: EventCounts(happened[:, 3 * i].astype(np.int64), happened[:, 3 * i + 1], happened[:, 3 * i + 2])
            for i, name in enumerate(names)
        }
        self.events = NamedValues("event", counts, aliases)
        return self

    def counted_from(
        self, starts: FloatArray, t_eval: FloatArray | None, parameters: Sequence[str], crossings: Sequence[str]
    ) -> Self:
        """Return this sweep, whose times are those since the start of each case, with times counted as that is [s].

        Parameters
        ----------
        starts : ndarray (n_case,) or (1,)
        t_eval : ndarray (n_t,) or None
            Times of the samples, as they were given.
        parameters : sequence of str
            Names of the parameters that were given; others, which the elapsed time adds, are left out.
        crossings : sequence of str
            Names of the reductions that are times.
        """
        self.t, self.t_eval = starts + self._own_t, None if t_eval is None else t_eval.copy()
        self.parameters = {name: values for name, values in self.parameters.items() if name in parameters}
        self.events |= {
            name: EventCounts(each.count, starts + each.first, starts + each.last) for name, each in self.events.items()
        }
        self.reduced |= {name: starts + self.reduced[name] for name in crossings if name in self.reduced}
        return self

    def with_cases(self, some: NDArray[np.bool_], other: Self, starts: FloatArray | None = None) -> Self:
        """Return this sweep with some cases (n_case,) of another, whose times are not those since the `starts`."""
        self._own_t[some] = (other._own_t if starts is None else other.t - starts)[some]
        for name in ("t", "status", "steps"):
            getattr(self, name)[some] = getattr(other, name)[some]
        self._states.take(some, cast(Any, other._states), self._own_t)
        for name, counts in self.events.items():
            for part in ("count", "first", "last"):
                getattr(counts, part)[some] = getattr(other.events[name], part)[some]
        for name, values in self.reduced.items():
            values[some] = other.reduced[name][some]
        seconds = self.stats.run_seconds + other.stats.run_seconds
        self.stats = replace(self.stats, steps=int(self.steps.sum()), run_seconds=seconds)
        if self._twin is not None and other._twin is not None:
            self._twin.with_cases(some, other._twin, starts)
        return self

    def with_twin(self, twin: Any) -> Self:
        """See `Estimated.with_twin`; the statistics get the methods of the twin too."""
        self.stats = replace(self.stats, methods={**self.stats.methods, **twin.stats.methods})
        return super().with_twin(twin)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Whether each case reached its end, or a terminal event, (n_case,)."""
        return np.asarray((self.status == Status.SUCCESS) | (self.status == Status.EVENT))

    def failures(self) -> list[CaseFailure]:
        """Return the cases that did not reach their end, and why."""
        failed = np.flatnonzero(~self.success)
        return [
            CaseFailure(int(i), status, status.message_for((self._formulation,), self.stats.method), float(self.t[i]))
            for i, status in ((i, Status(self.status[i])) for i in failed)
        ]

    @property
    def final(self) -> NamedValues[FloatArray]:
        """Final values (n_case,) of coordinates, rates, states and outputs, by name."""
        layout = self._layout
        names = list(dict.fromkeys((*layout.variables, *layout.state, *layout.outputs)))
        return NamedValues("final value", dict(zip(names, self._states.at_ends(names), strict=True)), layout.aliases)

    @nesting_named
    def __getitem__(self, key: Any) -> FloatArray:
        return self._by_name([key])[key]

    def _names(self) -> tuple[str, ...]:
        layout = self._layout
        return (*layout.variables, *layout.state_rates, *layout.outputs, *ENERGIES, *layout.state)

    def _compared(self, twin: Sweep) -> NamedArrays:
        if isinstance(self._states, ContactStates) and isinstance(twin._states, ContactStates):
            return _InSamePhases(twin, self._states.alike(twin._states))
        return twin

    def __repr__(self) -> str:
        return f"<Sweep {self._name!r}: {len(self)} cases, {int(np.sum(~self.success))} failed>"

    def _repr_html_(self) -> str:
        kinds, counts = np.unique(self.status, return_counts=True)
        facts = [(Status(kind).name, f"{count:,} cases") for kind, count in zip(kinds, counts, strict=True)]
        varied = [(name, v) for name, v in {**self.initial, **self.parameters}.items() if len(v) > 1]
        columns = [*varied, *self.reduced.items()]
        rows = ranges((name for name, _ in columns), (np.asarray(values, dtype=float) for _, values in columns))
        return summary(repr(self)[1:-1], facts, ("name", "least", "largest", "last case"), rows)

    def _ipython_key_completions_(self) -> list[str]:
        return list(dict.fromkeys(self._names()))

    plot = plot_cases
    to_dataframe = to_dataframe
    to_xarray = cases_to_xarray


@final
@frozen(eq=False)
class _InSamePhases:
    """The values of a twin by name, NaN where it is not in the same phase as the run."""

    twin: Sweep
    alike: NDArray[np.bool_]

    def __getitem__(self, key: Any) -> FloatArray:
        values = self.twin[key]
        return np.where(self.alike.reshape(values.shape), values, np.nan)
