"""Derivatives of runs on the host.

They are those of traced runs to the times of events, and those of these times by the implicit function theorem.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from ..codegen.printers import JAX
from ..codegen.runs import HostedRuns, HostRun
from ..methods.status import Status
from .modules import compile_kernel
from .pure import Solve, refusing
from .run_inputs import Given
from .runs.linear_maps import apply
from .runs.run_constants import stacked
from .runs.unknown import Sloped, without_derivative

if TYPE_CHECKING:
    from .hosted import HostedSolve


_NO_SECOND = (
    "runs with events have first derivatives only: take those of second order without events=, over a span that ends"
    " before them"
)


def changes_of(solve: HostedSolve, held: HostRun, values: Any, tangents: Any) -> HostRun:
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
        return _followed(solve, held, *jax.tree.unflatten(tree, whole))

    found: HostRun = jax.jvp(run, ([flat[i] for i in moving],), ([changes[i] for i in moving],))[1]
    return found


def _followed(solve: HostedSolve, held: HostRun, t: Any, initial: Any, p: Any, given: Given) -> HostRun:
    """Return a run as it went, with the changes of traced runs to the times of events."""
    native, hosted = solve.native, solve.hosted
    assert native is not None
    forward, count = jnp.where(t[-1] >= t[0], 1.0, -1.0), len(hosted.runner.labels)
    marks = jnp.concatenate([held.happened[:, 1], held.happened[:, 2]])
    occurred = jnp.isfinite(marks)
    # First to the times as they are, from which those follow at which events occur nearby.
    begin = jax.lax.stop_gradient(t[0])
    y = _at(native, forward, t, jnp.where(occurred, marks, begin), initial, p, given)[0]
    rows, at_knots = solve.parameters_at(t, marks, p, given)
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
