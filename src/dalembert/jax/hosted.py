"""Traced functions whose runs are compiled loops on the host (events, reductions, contacts), and their derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from ..codegen.printers import JAX
from ..codegen.runs import HostedRuns, HostRun
from ..errors import OptionError
from ..methods.status import Status
from ..once import once_property
from ..options import SolveOptions
from ..stops.feedback import Feedback
from ..stops.samples import Samples
from .arguments import parameters_of, register_samples, times, vector
from .host_calls import on_host
from .modules import KeyedFunction, compile_kernel
from .pointwise import StateFunctions
from .pure import Solve, refusing
from .run_inputs import Given, inputs_of, parameters_at, refuse_given
from .runs.linear_maps import apply
from .runs.run_constants import stacked
from .runs.unknown import Sloped, without_derivative
from .solved import Dense, EventTimes, Solved, States, raise_failure, solved_of


@final
class HostedSolve(KeyedFunction):
    """``solve(t, initial, p, inputs=None)`` as `Solve`, with events, reductions or contacts.

    The runs are those of the compiled backend, which the traced program calls on the host: one call for a whole batch,
    whatever device holds its arrays. They compute in double precision: in a process of single precision, arguments and
    results have it, and derivatives. Derivatives, where there are any, are those of traced runs to the times at which
    events occurred, and by the implicit function theorem those of these times. They are first derivatives.

    Parameters
    ----------
    hosted : HostedRuns
        The runs on the host, and their events and reductions.
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
        register_samples()
        super().__init__(hosted.runner, hosted.layout, hosted.refusal, options, native)
        self.given = hosted.runner.given if native is None else native.given

    def __call__(self, t: Any, initial: Any, p: Any, inputs: Mapping[Any, Any] | None = None) -> Solved:
        """Return the motion; see `Solve`. Inputs are numbers or samples."""
        t, layout = times(t), self._hosted.layout
        numbers, given = inputs_of(layout, self._hosted.inputs, inputs, t)
        _refuse_functions(given)
        p = parameters_of(layout, p, numbers, given)
        start = vector("initial value", initial, self.given, layout.aliases)
        solved = solved_of(self, t, start, p, given)
        return raise_failure(solved, "", self._options.method) if self._options.throw else solved

    def __reduce__(self) -> tuple[Any, ...]:
        return HostedSolve, (self._hosted, self._options, self._native)

    def motion(self, t: Any, initial: Any, p: Any, given: Given) -> Solved:
        """Return the motion from arrays."""
        run = self._run(t, initial, p, given)
        runner = self._hosted.runner
        end, status, steps = run.numbers
        events = {
            label: EventTimes(run.happened[i, 0].astype(int), *run.happened[i, 1:])
            for i, label in enumerate(runner.labels)
        }
        reduced = {name: run.reduced[i] for i, name in enumerate(runner.reductions)}
        y, q, qdot, outputs = self._split(run.rows)
        last = States(end, *self._split(run.end))
        dense = Dense(self, ((t[0], t[-1], end), (initial, p, given))) if self._options.dense else None
        return Solved(t, y, q, qdot, outputs, status.astype(int), steps.astype(int), None, dense, last, events, reduced)

    def states(self, dense: Dense, t: Any) -> States:
        """Return the motion at times t (n_t,) of a run between its start, last requested time and end; see `Dense`."""
        (start, last, end), given = dense.run
        forward = jnp.where(last >= start, 1.0, -1.0)
        inside = (forward * (t - start) >= 0.0) & (forward * (end - t) >= 0.0)
        requested = jnp.where(inside, t, start)
        order = jnp.argsort(forward * jax.lax.stop_gradient(requested), stable=True)
        every = jnp.concatenate([start[None], requested[order], last[None]])
        found = self.motion(every, *given)
        back = jnp.argsort(order)
        # In single precision, the time of the end is rounded, and the run may end before.
        last_one = (t == end)[:, None]
        rows = []
        for part, ended in zip(found[1:5], found.end[1:], strict=True):
            row = part[1:-1][back]
            lost = last_one & ~jnp.isfinite(row)
            ended = without_derivative(
                jnp.broadcast_to(jax.lax.stop_gradient(ended), row.shape), ~lost, (start, t, given)
            )
            rows.append(jnp.where(lost, ended, jnp.where(inside[:, None], row, jnp.nan)))
        return States(t, *rows)

    def _split(self, rows: Any) -> tuple[Any, Any, Any, Any]:
        """Return state, coordinates, rates and outputs from rows (..., n) of them all."""
        n, count = len(self._hosted.state), len(self._hosted.layout.coordinates)
        y, q, qdot, outputs = jnp.split(rows, [n, n + count, n + 2 * count], axis=-1)
        return y, q, qdot, outputs

    # -- the run --------------------------------------------------------------------------

    @once_property
    def _run(self) -> Any:
        """The function (t, initial, p, given) -> `HostRun`, in floating point numbers, with its derivatives."""
        run = jax.custom_jvp(self._called)

        def push(values: Any, tangents: Any) -> Any:
            self._refuse_derivatives(values[-1])
            held = self._called(*jax.lax.stop_gradient(values))
            return held, self._changes(held, values, tangents)

        run.defjvp(push, symbolic_zeros=True)
        return run

    def _changes(self, held: HostRun, values: Any, tangents: Any) -> HostRun:
        """Return the changes of a `HostRun` with times, initial values, parameters and inputs.

        What does not change is left out: derivatives by knots may not exist.
        """
        flat, tree = jax.tree.flatten(refusing(_NO_SECOND, values))
        changes = jax.tree.leaves(tangents)
        moving = [i for i, change in enumerate(changes) if not isinstance(change, SymbolicZero)]

        def run(some: Any) -> HostRun:
            whole = list(flat)
            for i, value in zip(moving, some, strict=True):
                whole[i] = value
            return self._followed(held, *jax.tree.unflatten(tree, whole))

        found: HostRun = jax.jvp(run, ([flat[i] for i in moving],), ([changes[i] for i in moving],))[1]
        return found

    def _followed(self, held: HostRun, t: Any, initial: Any, p: Any, given: Given) -> HostRun:
        """Return a run as it went, with the changes of traced runs to the times of events."""
        native, hosted = self._native, self._hosted
        assert native is not None
        forward, count = jnp.where(t[-1] >= t[0], 1.0, -1.0), len(hosted.runner.labels)
        marks = jnp.concatenate([held.happened[:, 1], held.happened[:, 2]])
        occurred = jnp.isfinite(marks)
        # First to the times as they are, from which those follow at which events occur nearby.
        begin = jax.lax.stop_gradient(t[0])
        y = _at(native, forward, t, jnp.where(occurred, marks, begin), initial, p, given)[0]
        rows, at_knots = self.parameters_at(t, marks, p, given)
        found = [
            _occurs(hosted, number % count, (marks[number], y[len(t) + number], rows[number]), at_knots[number])
            for number in range(2 * count)
        ]
        moved = jnp.where(occurred, jnp.stack(found) if found else jnp.zeros(0), marks)
        end = t[-1]
        for i, terminal in enumerate(hosted.terminal):
            here = (held.numbers[1] == float(Status.EVENT)) & (marks[count + i] == held.numbers[0])
            end = jnp.where(here & terminal, moved[count + i], end)
        whole = (held.numbers[1] == float(Status.SUCCESS)) | (held.numbers[1] == float(Status.EVENT))
        end = jnp.where(whole, end, held.numbers[0])
        reached = forward * (jax.lax.stop_gradient(t) - held.numbers[0]) <= 0.0
        requested = jnp.append(jnp.where(reached, t, end), end)
        rows = jnp.concatenate(_at(native, forward, requested, jnp.zeros(0), initial, p, given), axis=1)
        known = jnp.isfinite(held.rows)
        return held._replace(
            rows=jnp.where(known, rows[:-1], jnp.nan),
            end=_of_whole(rows[-1], whole, (t, initial, p, given)),
            numbers=held.numbers.at[0].set(_of_whole(end, whole, (t, initial, p, given))),
            happened=jnp.stack([held.happened[:, 0], moved[:count], moved[count:]], axis=1),
        )

    def _refuse_derivatives(self, given: Given) -> None:
        """Reject derivatives that traced runs do not give.

        Raises
        ------
        OptionError
        """
        if self._hosted.refusal:
            raise OptionError(self._hosted.refusal)
        assert self._native is not None
        refuse_given(given, self._native.options)
        self._native.check_precision(given)

    def _called(self, t: Any, initial: Any, p: Any, given: Given) -> HostRun:
        """Return the result of a run on the host."""
        runner = self._hosted.runner
        if self._native is not None and self.given != runner.given:
            at_start = self.parameters_at(t, t[:1], p, given)[0][0]
            initial = jnp.concatenate(self._expanded(t[0], initial, at_start))
        width = len(runner.columns)
        shapes = (len(t), width), (width,), (3,), (len(runner.labels), 3), (len(runner.reductions),)
        records = {name: record for name, record in given.items() if isinstance(record, Samples)}
        kinds = {name: (record.kind, record.extrapolate) for name, record in records.items()}

        def run(t: Any, initial: Any, p: Any, *arrays: Any) -> Any:
            pairs = zip(kinds.items(), arrays[::2], arrays[1::2], strict=True)
            own = {name: Samples(knots, values, *kind, None, False) for (name, kind), knots, values in pairs}
            return runner(t, initial, p, own)

        arrays = [array for record in records.values() for array in (record.t, record.values)]
        return HostRun(*on_host(run, shapes, t, initial, p, *arrays))

    def parameters_at(self, t: Any, marks: Any, p: Any, given: Given) -> tuple[Any, Any]:
        """Return parameters (n, n_p) at `marks` (n,) of a run along times t, and whether these are knots (n,)."""
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        return parameters_at(self._hosted.layout, self._hosted.inputs, given, p, marks, forward)

    def _expanded(self, t: Any, y: Any, p: Any) -> tuple[Any, ...]:
        """Return coordinates and rates of a state, and first-order states."""
        assert self._native is not None
        layout = self._hosted.layout
        q, qdot = StateFunctions(self._native.program).expand(t, y, p)
        return q, qdot, y[len(y) - len(layout.states) :]


def _refuse_functions(given: Given) -> None:
    """Reject inputs that are functions of the state, which compiled loops cannot call.

    Raises
    ------
    OptionError
    """
    functions = [name for name, value in given.items() if isinstance(value, Feedback)]
    if functions:
        raise OptionError(
            f"input {functions[0]!r} is a function, and runs with events, reductions or contacts are left to compiled"
            " loops, which cannot call it: give a number or dalembert.samples(times, values), or leave out events= and"
            " reduce="
        )


_NO_SECOND = (
    "runs with events have first derivatives only: take those of second order without events=, over a span that ends"
    " before them"
)


def _occurs(hosted: HostedRuns, event: int, point: tuple[Any, Any, Any], at_knot: Any) -> Any:
    """Return the time () of an event at a point (t, y, p); it changes as the zero of its expression does.

    At the knot of a record it has no derivative, as the expression may jump or have a kink there.
    """
    assert hosted.watched is not None
    values, rates = (stacked(compile_kernel(kernel, JAX)) for kernel in hosted.watched)

    @jax.custom_jvp
    def zero(t: Any, y: Any, p: Any) -> Any:
        return t

    @zero.defjvp
    def _(at: Any, changes: Any) -> Any:
        t, y, p = at
        change = jax.jvp(lambda y, p: values(t, y, p)[event], (y, p), changes[1:])[1]
        rate = rates(t, y, p)[event]
        slope = jnp.where((rate != 0.0) & ~at_knot, -1.0 / rate, jnp.nan)
        return t, apply(Sloped(), slope, change)

    return zero(jax.lax.stop_gradient(point[0]), *point[1:])


def _at(
    native: Solve, forward: Any, t: Any, marks: Any, initial: Any, p: Any, given: Given
) -> tuple[Any, Any, Any, Any]:
    """Return states, coordinates, rates and outputs of a traced run at times and at `marks`, in any order."""
    every = jnp.concatenate([t, marks])
    order = jnp.argsort(forward * jax.lax.stop_gradient(every), stable=True)
    solved = native.motion(every[order], initial, p, given)
    back = jnp.argsort(order)
    return solved.y[back], solved.q[back], solved.qdot[back], solved.outputs[back]


def _of_whole(values: Any, whole: Any, sources: Any) -> Any:
    """Return where a run ended, with derivatives NaN by `sources` where it failed, that is, where it is not `whole`."""
    return jnp.where(whole, values, without_derivative(jax.lax.stop_gradient(values), whole, sources))
