"""Traced functions whose runs are left to compiled loops on the host: with events, reductions or contacts."""

from __future__ import annotations

from functools import partial
from typing import Any, final

import jax
import jax.numpy as jnp

from ...errors import OptionError
from ...integrators.jax.kernels import stacked
from ...methods.status import Status
from ...once import once_property
from ...options import SolveOptions
from ..host_runs import HostedRuns, HostRun
from ..printers import JAX
from .arguments import parameters_of, times, vector
from .host_calls import on_host
from .kernels import compile_kernel
from .pointwise import StateFunctions
from .pure import Solve, refusing
from .solved import EventTimes, Solved, States, raise_failure

__all__ = ["HostedSolve"]

_NO_SECOND = (
    "runs with events have first derivatives only: take those of second order without events=, over a span that ends"
    " before them"
)


@final
class HostedSolve:
    """``solve(t, initial, p)`` as `Solve`, with events, reductions or contacts.

    The runs are those of the compiled backend, which the traced program calls on the host: one call for a whole batch,
    whatever device holds its arrays. Derivatives, where there are any, are those of traced runs to the times at which
    events occurred, and by the implicit function theorem those of these times. They are first derivatives.

    Parameters
    ----------
    hosted : HostedRuns
        What runs, and what is watched.
    options : SolveOptions
        As for `CompiledModel.solve_fn`.
    native : Solve or None
        The traced runs by which derivatives are taken; None where there are contacts.

    Attributes
    ----------
    given : tuple of str
        Names of what `initial` holds, in order.
    """

    def __init__(self, hosted: HostedRuns, options: SolveOptions, native: Solve | None) -> None:
        self._hosted, self._options, self._native = hosted, options, native
        self._key = hosted.runner, hosted.layout, hosted.refusal, options, native
        self._hash = hash(self._key)
        self.given = hosted.runner.given if native is None else native.given

    def __call__(self, t: Any, initial: Any, p: Any) -> Solved:
        """Return the motion; see `Solve`."""
        if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
            raise OptionError(
                "runs with events, reductions or contacts are in double precision, which is off in this process: set"
                ' jax.config.update("jax_enable_x64", True), or call inside "with jax.enable_x64(True):"'
            )
        p = parameters_of(self._hosted.layout, p, {})
        solved = _solved(self, times(t), vector("initial value", initial, self.given), p)
        if self._options.throw:
            raise_failure(solved.status, "", self._options.method)
        return solved

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, HostedSolve) and self._key == other._key)

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[Any, ...]:
        return HostedSolve, (self._hosted, self._options, self._native)

    def solved(self, t: Any, initial: Any, p: Any) -> Solved:
        """Return the result of a run from arrays."""
        run = self._run(t, initial, p)
        runner = self._hosted.runner
        end, status, steps = run.numbers
        events = {
            label: EventTimes(run.happened[i, 0].astype(int), *run.happened[i, 1:])
            for i, label in enumerate(runner.labels)
        }
        reduced = {name: run.reduced[i] for i, name in enumerate(runner.reductions)}
        y, q, qdot, outputs = self._split(run.rows)
        last = States(end, *self._split(run.end))
        return Solved(t, y, q, qdot, outputs, status.astype(int), steps.astype(int), None, None, last, events, reduced)

    def _split(self, rows: Any) -> tuple[Any, Any, Any, Any]:
        """Return state, coordinates, rates and outputs from rows (..., n) of them all."""
        n, count = len(self._hosted.state), len(self._hosted.layout.coordinates)
        y, q, qdot, outputs = jnp.split(rows, [n, n + count, n + 2 * count], axis=-1)
        return y, q, qdot, outputs

    # -- the run --------------------------------------------------------------------------

    @once_property
    def _run(self) -> Any:
        """The function (t, initial, p) -> `HostRun`, in floating point numbers, with its derivatives."""
        run = jax.custom_jvp(self._called)

        def push(values: Any, tangents: Any) -> Any:
            if self._hosted.refusal:
                raise OptionError(self._hosted.refusal)
            return jax.jvp(self._differentiable, values, tangents)

        run.defjvp(push)
        return run

    def _called(self, t: Any, initial: Any, p: Any) -> HostRun:
        """Return how a run on the host went."""
        runner = self._hosted.runner
        if self._native is not None and self.given != runner.given:
            initial = jnp.concatenate(self._expanded(t[0], initial, p))
        width = len(runner.columns)
        shapes = (len(t), width), (width,), (3,), (len(runner.labels), 3), (len(runner.reductions),)
        return HostRun(*on_host(runner, shapes, t, initial, p))

    def _expanded(self, t: Any, y: Any, p: Any) -> tuple[Any, ...]:
        """Return coordinates and rates of a state, and first-order states."""
        assert self._native is not None
        layout = self._hosted.layout
        q, qdot = StateFunctions(self._native.program).expand(t, y, p)
        return q, qdot, y[len(y) - len(layout.states) :]

    # -- its derivatives ------------------------------------------------------------------

    def _differentiable(self, t: Any, initial: Any, p: Any) -> HostRun:
        """Return what `_called` does, from a traced run to the times of events, which are differentiated."""
        native = self._native
        assert native is not None
        held = self._called(*(jax.lax.stop_gradient(value) for value in (t, initial, p)))
        forward, count = jnp.where(t[-1] >= t[0], 1.0, -1.0), len(self._hosted.runner.labels)
        marks = jnp.concatenate([held.happened[:, 1], held.happened[:, 2]])
        occurred = jnp.isfinite(marks)
        # First to the times as they are, from which those follow at which events occur nearby.
        begin = jax.lax.stop_gradient(t[0])
        y = _at(native, forward, t, jnp.where(occurred, marks, begin), initial, p)[0]
        found = [self._occurs(number % count, marks[number], y[len(t) + number], p) for number in range(2 * count)]
        moved = jnp.where(occurred, jnp.stack(found) if found else jnp.zeros(0), marks)
        end = t[-1]
        for i, terminal in enumerate(self._hosted.terminal):
            here = (held.numbers[1] == float(Status.EVENT)) & (marks[count + i] == held.numbers[0])
            end = jnp.where(here & terminal, moved[count + i], end)
        reached = forward * (jax.lax.stop_gradient(t) - held.numbers[0]) <= 0.0
        wanted = jnp.append(jnp.where(reached, t, end), end)
        rows = jnp.concatenate(_at(native, forward, wanted, jnp.zeros(0), initial, p), axis=1)
        known = jnp.isfinite(held.rows)
        return held._replace(
            rows=jnp.where(known, rows[:-1], jnp.nan),
            end=rows[-1],
            numbers=held.numbers.at[0].set(end),
            happened=jnp.stack([held.happened[:, 0], moved[:count], moved[count:]], axis=1),
        )

    def _occurs(self, event: int, t: Any, y: Any, p: Any) -> Any:
        """Return the time () of an event in the state y (n_y,) there; it changes as the zero of its expression does."""
        assert self._hosted.watched is not None
        values, begins = (stacked(compile_kernel(kernel, JAX)) for kernel in self._hosted.watched)

        @jax.custom_jvp
        def zero(t: Any, y: Any, p: Any) -> Any:
            return t

        @zero.defjvp
        def _(at: Any, changes: Any) -> Any:
            t, y, p = (refusing(_NO_SECOND, value) for value in at)
            change = jax.jvp(lambda y, p: values(t, y, p)[event], (y, p), changes[1:])[1]
            rate = begins(t, y, p)[3 * event + 1]
            return at[0], jnp.where(rate != 0.0, -change / rate, jnp.nan)

        return zero(jax.lax.stop_gradient(t), y, p)


def _at(native: Solve, forward: Any, t: Any, marks: Any, initial: Any, p: Any) -> tuple[Any, Any, Any, Any]:
    """Return states, coordinates, rates and outputs of a traced run at times and at `marks`, in any order."""
    every = jnp.concatenate([t, marks])
    order = jnp.argsort(forward * jax.lax.stop_gradient(every), stable=True)
    solved = native.motion(every[order], initial, p)
    back = jnp.argsort(order)
    return solved.y[back], solved.q[back], solved.qdot[back], solved.outputs[back]


@partial(jax.jit, static_argnums=0)
def _solved(solve: HostedSolve, t: Any, initial: Any, p: Any) -> Solved:
    """Return the result: compiled once for equal functions, and a part of the program where one is traced."""
    return solve.solved(t, initial, p)
