"""`Sweep`: the results of many cases."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, nesting_named, unknown_name
from ..ir.interpret import interpret_rows
from ..ir.program import Layout, Program
from ..methods.status import Status
from .estimate import ErrorEstimate
from .labels import attributes, with_units
from .motion import ENERGIES, reaction_hint, warn_of_energy, xarray_package
from .named_values import NamedValues
from .notebook import ranges, summary

if TYPE_CHECKING:
    import xarray

__all__ = ["NO_MODE", "CaseFailure", "CaseResults", "EventCounts", "Sweep", "SweepStatistics"]

NO_MODE = -1
"""Number of the mode of scenes without contacts."""
_BLOCK = 8192
"""States of which values are computed at a time: their intermediate values stay near the processor."""


@final
@dataclass(frozen=True)
class SweepStatistics:
    """Cost of a sweep, and its tolerances, NaN where they are not known.

    `note` says why "auto" took another method than it usually does, where it did. `methods` are those of each mode of
    contacts by number, `NO_MODE` without contacts, and by `rtol`.
    """

    method: str
    threads: int
    steps: int
    compile_seconds: float
    run_seconds: float
    note: str = ""
    rtol: float = math.nan
    atol: float = math.nan
    methods: Mapping[tuple[int, float], str] = field(default_factory=dict, repr=False)


@final
@dataclass(frozen=True)
class CaseFailure:
    """A case that did not reach its end: its number, why, and the time it reached."""

    case: int
    status: Status
    message: str
    t: float


@final
@dataclass(frozen=True, eq=False)
class EventCounts:
    """Number of times an event occurred in each case (n_case,), and first and last time [s], NaN where it did not."""

    count: NDArray[np.int64]
    first: FloatArray
    last: FloatArray


class CaseResults(ABC):
    """Base class of results of many cases.

    Subclasses give values by name, from what they keep of each case.
    """

    _kind = "Sweep"

    def __init__(
        self,
        name: str,
        formulation: str,
        layout: Layout,
        varied: tuple[dict[str, FloatArray], dict[str, FloatArray]],
        ends: FloatArray,
        t_eval: FloatArray | None,
        axes: Mapping[str, FloatArray],
        stats: SweepStatistics,
    ) -> None:
        self._name, self._formulation, self._layout = name, formulation, layout
        self.initial, parameters = varied
        own = {*layout.parameters} - {*layout.given}  # what runs set themselves
        self.parameters = {name: values for name, values in parameters.items() if name not in own}
        self.events: NamedValues[EventCounts] = NamedValues("event", {})
        self.reduced: NamedValues[FloatArray] = NamedValues("reduction", {})
        self.t, self.status, self.steps = ends[:, 0], ends[:, 1].astype(np.int8), ends[:, 2].astype(np.int64)
        self.t_eval = t_eval
        self._own_t, self._own_t_eval = self.t, t_eval
        self.axes, self.stats = dict(axes), stats

    @abstractmethod
    def _final(self, key: Any) -> FloatArray:
        """Return final values (n_case,) of something."""

    @abstractmethod
    def _sampled(self, key: Any) -> FloatArray:
        """Return values (n_case, n_t) of something at the samples."""

    def _by_name(self, names: Iterable[str]) -> dict[str, FloatArray]:
        """Return ``self[name]`` of several names; subclasses compute what these have in common once."""
        return {name: self[name] for name in names}

    def __len__(self) -> int:
        return len(self.t)

    def with_events(self, names: Sequence[str], happened: FloatArray, kept: Sequence[str], reduced: FloatArray) -> Self:
        """Return this sweep with what happened (n_case, 3 n_events): numbers, first and last times, and reductions."""
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
            Times of the samples, as they were asked for.
        parameters : sequence of str
            Names of the parameters that were given; others, which the elapsed time adds, are left out.
        crossings : sequence of str
            Names of the reductions that are times.
        """
        self.t, self.t_eval = starts + self._own_t, t_eval
        self.parameters = {name: values for name, values in self.parameters.items() if name in parameters}
        self.events |= {
            name: EventCounts(each.count, starts + each.first, starts + each.last) for name, each in self.events.items()
        }
        self.reduced |= {name: starts + self.reduced[name] for name in crossings if name in self.reduced}
        return self

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
        return NamedValues("final value", {name: self._final(name) for name in self._lasting()}, self._layout.aliases)

    def _lasting(self) -> tuple[str, ...]:
        """Return the names of what `final` holds."""
        layout = self._layout
        return (*layout.variables, *layout.outputs)

    @nesting_named
    def __getitem__(self, key: Any) -> FloatArray:
        return self._final(key) if self.t_eval is None else self._sampled(key)

    def _names(self) -> tuple[str, ...]:
        layout = self._layout
        return (*layout.variables, *layout.state_rates, *layout.outputs, *ENERGIES)

    def _unknown(self, text: str, names: Iterable[str]) -> UnknownNameError:
        """Return the error for a name that has no values."""
        known = unknown_name("output", text, dict.fromkeys(names))
        hint = f" It is a reduction: sweep.reduced[{text!r}]." if text in self.reduced else ""
        return UnknownNameError(known + hint + reaction_hint(self._layout, text))

    def __repr__(self) -> str:
        return f"<{self._kind} {self._name!r}: {len(self)} cases, {int(np.sum(~self.success))} failed>"

    def _repr_html_(self) -> str:
        kinds, counts = np.unique(self.status, return_counts=True)
        facts = [(Status(kind).name, f"{count:,} cases") for kind, count in zip(kinds, counts, strict=True)]
        varied = [(name, v) for name, v in {**self.initial, **self.parameters}.items() if len(v) > 1]
        columns = [*varied, *self.reduced.items()]
        rows = ranges((name for name, _ in columns), (np.asarray(values, dtype=float) for _, values in columns))
        return summary(repr(self)[1:-1], facts, ("name", "least", "largest", "last case"), rows)

    def _ipython_key_completions_(self) -> list[str]:
        return list(dict.fromkeys(self._names()))

    def to_xarray(self, units: Mapping[Any, str] | None = None) -> xarray.Dataset:
        """Return the sweep as an ``xarray.Dataset`` over ``case`` or the axes of its grid, and ``time`` if sampled.

        Of an event there are ``name_count``, ``name_first`` and ``name_last``. Attributes are as for a trajectory.

        Parameters
        ----------
        units : mapping of symbols or names to str, optional
            Units of what the data set holds, and of parameters.

        Raises
        ------
        MissingExtraError
            Without the package.
        UnknownNameError, OptionError
            For units of what is not there, or that are no texts.
        """
        layout = self._layout
        shape = tuple(len(values) for values in self.axes.values()) or (len(self),)
        dims: tuple[str, ...] = tuple(self.axes) or ("case",)
        coords: dict[str, Any] = {name: (name, values) for name, values in self.axes.items()}
        times: tuple[str, ...] = ()
        if self.t_eval is not None:
            times, coords["time"] = ("time",), ("time", self.t_eval, {"units": "s"})
        if not self.axes:
            varied = {name: v for name, v in {**self.initial, **self.parameters}.items() if len(v) > 1}
            coords |= {f"{name}_given" if name in self._names() else name: ("case", v) for name, v in varied.items()}
        data: dict[str, Any] = {}
        for name, values in self._by_name(dict.fromkeys((*layout.variables, *layout.outputs, "energy"))).items():
            key = f"{name}_value" if name in self.axes else name
            data[key] = ((*dims, *times), values.reshape(*shape, *values.shape[1:]))
        for name, counts in (("status", self.status), ("steps", self.steps), ("t_end", self.t)):
            data[name] = (dims, counts.reshape(shape))
        taken = {*data, *coords, *dims}
        for name, values in self.reduced.items():
            data[f"{name}_reduced" if name in taken else name] = (dims, values.reshape(shape))
        for name, happened in self.events.items():
            for part in ("count", "first", "last"):
                key = f"{name}_{part}"
                data[f"{key}_of_event" if key in taken else key] = (dims, getattr(happened, part).reshape(shape))
        fixed = {name: float(v[0]) for name, v in self.parameters.items() if len(v) == 1 and np.ndim(v) == 1}
        attrs = attributes(self._name, self._formulation, self.stats, fixed)
        dataset: xarray.Dataset = xarray_package().Dataset(data, coords=coords, attrs=attrs)
        return with_units(dataset, units, layout.aliases, fixed)


@final
class Sweep(CaseResults):
    """The cases of a sweep, in the order in which they were given.

    ``sweep["x"]`` is an array (n_case,) of final values, or (n_case, n_t) where the sweep was given ``t_eval``; so for
    every coordinate, rate, component of the state, output, and the energies.

    Attributes
    ----------
    parameters, initial : dict of str to ndarray (n_case,) or (1,)
        What was varied, and what was not.
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
        How often each event occurred in each case, and when first and last; by name or by expression.
    reduced : dict of str to ndarray (n_case,)
        What was to be kept of every motion; NaN for cases that failed.
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
        self._estimate: ErrorEstimate | None = None
        self._twin: Sweep | None = None
        self.y, self.samples = y, samples

    def with_cases(self, some: NDArray[np.bool_], other: Sweep, starts: FloatArray) -> Sweep:
        """Return this sweep with some cases (n_case,) of another, whose times are not those since the starts."""
        self._own_t[some] = (other.t - starts)[some]
        for name in ("t", "status", "steps", "y"):
            getattr(self, name)[some] = getattr(other, name)[some]
        for name, counts in self.events.items():
            for part in ("count", "first", "last"):
                getattr(counts, part)[some] = getattr(other.events[name], part)[some]
        for name, values in self.reduced.items():
            values[some] = other.reduced[name][some]
        seconds = self.stats.run_seconds + other.stats.run_seconds
        self.stats = replace(self.stats, steps=int(self.steps.sum()), run_seconds=seconds)
        for mine, theirs in [] if self._twin is None or other._twin is None else [(self._twin, other._twin)]:
            mine.with_cases(some, theirs, starts)
        return self

    def with_twin(self, twin: Sweep) -> Sweep:
        """Return this sweep with the estimate of its errors that a twin at a tighter tolerance gives."""
        self._estimate, self._twin = ErrorEstimate(self, twin), twin
        self.stats = replace(self.stats, methods={**self.stats.methods, **twin.stats.methods})
        return self

    @property
    def error_estimate(self) -> ErrorEstimate:
        """Estimated global error by name, ``sweep.error_estimate["x"]``, shaped like ``sweep["x"]``.

        Raises
        ------
        OptionError
            Where the sweep was not told to estimate its errors.
        """
        if self._estimate is None:
            raise OptionError("this sweep has no error estimate; run it with error_estimate=True")
        return self._estimate

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
                outputs[kernel] = interpret_rows(self._program.kernel(kernel), times, at, c)
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
