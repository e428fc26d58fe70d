"""Sampling instants of controllers, their actions, and loops that diverge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, ValueInputError, list_names
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Layout, Program
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_OF_TIME
from ..reduction.sampling_kernels import SamplingAction, SamplingKernels
from ..scene.expressions.elapsed import START
from ..steps.problem import SamplingClock, Solution
from ..stops.stops import StopAction
from ..values import array_of, number
from .run_check import FAILED, EndedRun, RunCheck

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_MOST = 10_000_000
"""Number of instants of one run from which on it is rejected."""


@final
class NoInstants(ValueInputError):
    """Periods or offsets of controllers make no sense, or instants are too many."""


@final
@frozen(eq=False)
class Sampling:
    """The controllers of one program, or of a scene with contacts.

    Which of them act at an instant is a number, with the bit 2^i for controller i.

    Attributes
    ----------
    layout : Layout
        Of the program, or of the scene.
    kernels : SamplingKernels
        On the state of `layout`.
    expand : Kernel or None
        Coordinates, rates and first-order states of a state, for Python functions; None where it is these.
    """

    layout: Layout
    kernels: SamplingKernels
    expand: Kernel | None

    @classmethod
    def of(cls, program: Program, kernels: SamplingKernels) -> Sampling:
        """Return the controllers of a program."""
        called = any(action.function is not None for action in kernels.actions)
        return cls(program.layout, kernels, program.kernel("expand") if called else None)

    def schedules(self, c: FloatArray) -> FloatArray:
        """Return the periods of all controllers, then their offsets (k, 2 n), for constants (k, n_c)."""
        nothing = np.zeros((len(c), len(self.layout.state)))
        return interpret_rows(self.kernels.times, np.zeros(len(c)), nothing, c)

    def instants(
        self,
        schedule: FloatArray,
        t0: float,
        t1: float,
        clock: SamplingClock | None = None,
        requested: FloatArray | None = None,
    ) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return the instants (m,) from t0 on, before t1, and which controllers act at each (m,).

        `schedule` is a row of `schedules`. With a clock instants count from its origin, and those at which controllers
        have acted are left out. An instant that differs by rounding from one of the times `requested` (k,), which are
        in order, is moved to it.

        Raises
        ------
        NoInstants
            For periods and offsets that make no sense, and too many instants.
        OptionError
            For runs backwards in time.
        """
        if t1 < t0:
            raise OptionError(
                f"a scene with controllers runs forwards in time, not from t = {t0:g} to {t1:g}: the values held before"
                " cannot be determined"
            )
        periods, offsets = np.split(schedule, 2)
        near = SMALLEST_OF_TIME * max(abs(t0), abs(t1))
        origin, last = (t0, -np.inf) if clock is None else (clock.origin, clock.last)
        times, acts = [], []
        for i, (action, period, offset) in enumerate(zip(self.kernels.actions, periods, offsets, strict=True)):
            if not (period > 0.0 and np.isfinite(period) and offset >= 0.0 and np.isfinite(offset)):
                raise NoInstants(
                    f"controller {action.name!r} has the period {period:g} s and the offset {offset:g} s; the former"
                    " must be positive and the latter zero or positive, both finite"
                )
            count = max(0.0, np.ceil((t1 - origin - offset) / period)) + 1.0
            if count > _MOST:
                raise NoInstants(
                    f"controller {action.name!r} acts {count:.3g} times between t = {t0:g} and {t1:g}, {_MOST:,} at"
                    " most are possible: give a longer period, or a shorter span"
                )
            own = origin + (offset + period * np.arange(int(count)))
            own = own[(own > t0 - near) & (own < t1 - near)] if t1 > t0 else own[own == t0]
            own[own < t0 + near] = t0
            times.append(own[own > last + near])
            acts.append(np.full(len(times[-1]), 1 << i, np.int64))
        found, done = _merged(np.concatenate(times), np.concatenate(acts), near)
        if requested is not None and len(requested):
            for side in (-1, 0):
                place = np.clip(np.searchsorted(requested, found) + side, 0, len(requested) - 1)
                found = np.where(np.abs(requested[place] - found) <= near, requested[place], found)
        return found, done

    @property
    def stop_actions(self) -> list[StopAction]:
        """What controllers do at stops, in their order."""
        return [self._stop_action(action) for action in self.kernels.actions]

    @property
    def called_back(self) -> bool:
        """Whether laws are Python functions, which must be called once an instant."""
        return any(action.function is not None for action in self.kernels.actions)

    def _stop_action(self, action: SamplingAction) -> StopAction:
        if action.function is None:
            return StopAction(action.places, action.kernel)
        places = tuple(self.layout.state.index(name) for name in (*action.inputs, *action.states))

        def landing(t: float, y: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
            return self.called(action, t, y, after)[list(places)]

        return StopAction(places, function=landing)

    def called(self, action: SamplingAction, t: float, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return a state (n_y,) with the values that a Python function sets."""
        layout, n, x = self.layout, len(self.layout.coordinates), y
        if self.expand is not None:
            x = interpret_rows(self.expand, np.array([t]), y[np.newaxis], c[np.newaxis])[0]
        states = dict(zip(layout.states, x[2 * n :].tolist(), strict=True))
        places = {name: layout.parameters.index(name) for name in layout.given if not name.startswith(START)}
        parameters = {name: float(c[i]) for name, i in places.items()}
        t += float(c[layout.parameters.index(START)]) if START in layout.parameters else 0.0
        assert action.function is not None
        made: Any = action.function(t, x[:n].copy(), x[n : 2 * n].copy(), states, parameters)
        try:
            inputs, own = made
        except (TypeError, ValueError):
            raise ValueInputError(
                f"the function of controller {action.name!r} returned {made!r}; it must return (inputs, states)"
            ) from None
        y = y.copy()
        for what, names, given in (("inputs", action.inputs, inputs), ("states", action.states, own)):
            for name, value in zip(names, _numbers(action.name, what, names, given), strict=True):
                y[layout.state.index(name)] = value
        return y


def _merged(times: FloatArray, acts: NDArray[np.int64], near: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return instants in order, those that differ by rounding as one."""
    order = np.argsort(times, kind="stable")
    times, acts = times[order], acts[order]
    if not len(times):
        return times, acts
    new = np.diff(times, prepend=-np.inf) > near
    first = np.flatnonzero(new)
    return times[first], np.bitwise_or.reduceat(acts, first)


def _numbers(controller: str, what: str, names: Sequence[str], given: Any) -> list[float]:
    """Return the numbers that a function gave to names."""
    try:
        if isinstance(given, Mapping):
            table = {str(getattr(key, "func", key)): value for key, value in given.items()}
            found = [number(table[name]) for name in names] if set(table) == set(names) else None
        else:
            found = [] if given is None else [number(value) for value in np.atleast_1d(array_of(given))]
    except (TypeError, ValueError):
        found = None
    if found is None or len(found) != len(names) or not np.all(np.isfinite(found)):
        raise ValueInputError(
            f"the function of controller {controller!r} returned {what} {given!r}; it must give finite numbers for"
            f" {list_names(names) or 'none'}, in this order or by name"
        )
    return found


# Runs of loops with sampled controllers that fail because they are unstable.

_GROWN = 1e8
"""Size of a component, as a share of the largest at the start, 1 at least, from which a run that fails has diverged."""


def diverged(status: Any, start: FloatArray, end: FloatArray) -> NDArray[np.bool_]:
    """Return whether motions with these statuses (k,) failed because states (k, n) grew without bound."""
    sizes = np.maximum(np.max(np.abs(start), axis=1, initial=0.0), 1.0)
    grown = np.max(np.abs(end), axis=1, initial=0.0) > _GROWN * sizes
    return np.asarray(np.isin(status, FAILED) & grown)


def free_places(layout: Layout) -> list[int]:
    """Return the places of the components of the state without the inputs that are held."""
    return [i for i, name in enumerate(layout.state) if name not in layout.held]


def growth_note(names: Sequence[str], t: float, start: FloatArray, end: FloatArray) -> str:
    """Return which component of states (n,) has grown most until a time, and from what."""
    place = int(np.argmax(np.abs(end)))
    return f"{names[place]!r} grew to {end[place]:.3g} at t = {float(t):.9g}, from {start[place]:.3g} at the start"


@final
@frozen(eq=False)
class DivergenceCheck(RunCheck):
    """The components of the state of a scene with sampled controllers, without the inputs that are held: (i, name)."""

    components: tuple[tuple[int, str], ...]

    @classmethod
    def of(cls, model: CompiledModel) -> DivergenceCheck | None:
        """Return the check of a model; None without controllers."""
        layout = model.layout
        free = tuple((i, name) for i, name in enumerate(layout.state) if name not in layout.held)
        return cls(free) if model.controllers and free else None

    def after(self, run: EndedRun) -> tuple[Solution, str]:
        """See `RunCheck.after`: a run that failed where its state is huge has that status."""
        solution, problem = run.solution, run.problem
        places = [place for place, _ in self.components]
        t, y = run.stop if solution.status in FAILED else (0.0, problem.y0)
        start, end = problem.y0[places], y[places]
        if not diverged([solution.status], start[np.newaxis], end[np.newaxis])[0]:
            return solution, ""
        return replace(solution, status=Status.DIVERGED), growth_note([n for _, n in self.components], t, start, end)

    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """See `RunCheck.after_cases`."""
        places = [place for place, _ in self.components]
        done.ends[diverged(done.ends[:, 1], block.y[:, places], done.y[:, places]), 1] = float(Status.DIVERGED)
