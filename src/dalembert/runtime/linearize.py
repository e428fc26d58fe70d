"""Linearisation of the motion on the constraints, from generated derivatives.

A state x with rates f(x, u) and constraints g(x, u) = 0 that the motion keeps is parametrised by some of its components
z, the rest following from g. With G = dx/dz, which solves g_x G = 0 and P G = 1 where P picks z, the reduced motion
z' = P f(x(z)) has the derivative A = P f_x G, at every state, in equilibrium or not. Inputs and parameters u move x by
H = -(g_x stacked on P)^-1 g_u while z is held: B = P (f_u + f_x H). Outputs h have C = h_x G and D = h_u + h_x H.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError, OptionError, list_names, unknown_name
from ..ir.program import Layout, Program
from ..results.linearization import InputDerivatives, Linearization
from ..values import listed, option
from . import inputs as run_input
from .constraint_choice import divisible_model
from .input_expansion import expanded_at, input_places
from .partials import Partials
from .segments import at_time
from .singular import redundant

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["linearize"]

_DEPENDENT = 1e-9


def linearize(
    model: CompiledModel,
    t: float,
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    states: Sequence[str] | None,
    outputs: Iterable[Any] | None,
) -> Linearization:
    """Return the linearisation about given values; see `CompiledModel.linearize`.

    `parameters` have those of the inputs.
    """
    time = option("t", t)
    wanted = None if outputs is None else _output_names(model.layout, outputs)
    able = divisible_model(model, time, initial, parameters)
    p = expanded_at(model.layout, model.parameter_vector(parameters), time)
    values = model.initial_values(initial)
    point = _point(able, time, values, p)
    enforced = able.derived.enforced
    if enforced:
        dropped = redundant(point.program, time, point.y, point.c, enforced)
        if dropped is None:
            raise InitialStateError(
                f"the constraints lose rank at this state alone (t = {time:g}), where the motion has no linearisation:"
                " linearise about another state"
            )
        if dropped:
            point = _point(able.variants.without_constraints(dropped), time, values, p)
    return _linearized(point, states, wanted)


def _point(model: CompiledModel, t: float, values: Mapping[str, float], p: FloatArray) -> _Point:
    """Return a model at initial values by name and parameters (n_p,)."""
    program = model.stages.program
    c = at_time(program, run_input.constants(program, p), t)
    y = run_input.initial_state(model.derived.start(values), t, values, c, program)
    return _Point(program, model.derived.partials, t, y, p, c)


def _output_names(layout: Layout, given: Iterable[Any]) -> list[str]:
    """Return the names of outputs.

    Raises
    ------
    UnknownNameError
        For those that are none.
    """
    known = dict.fromkeys((*layout.coordinates, *layout.rates, *layout.state, *layout.outputs))
    return run_input.resolve_names("output", given, known, layout.aliases)


@final
@dataclass(frozen=True, eq=False)
class _Point:
    """A program at time t, state y (n_y,), parameters p (n_p,) with inputs expanded at t, and constants c (n_c,)."""

    program: Program
    partials: Partials
    t: float
    y: FloatArray
    p: FloatArray
    c: FloatArray

    def value(self, kernel: str) -> FloatArray:
        """Return the outputs of a kernel."""
        return self.partials.value(kernel, self.t, self.y, self.c)

    def derivatives(self, kernel: str) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of a kernel by the state (k, n_y) and by the parameters (k, n_p)."""
        where = self.t, self.y, self.c
        return self.partials.by_state(kernel, *where), self.partials.by_parameters(kernel, *where)


def _linearized(point: _Point, chosen: Sequence[str] | None, outputs: Sequence[str] | None) -> Linearization:
    """Return the linearisation at a point.

    Parameters
    ----------
    point : _Point
    chosen : sequence of str or None
        The independent components of the state; None picks them.
    outputs : sequence of str or None
        Names of the rows of C; None takes the independent components.

    Raises
    ------
    OptionError
        For names that are no components of the state, or are not independent or too few.
    """
    program, y, layout = point.program, point.y, point.program.layout
    f_x, f_p = point.derivatives("rhs")
    pairs = [point.derivatives(kernel) for kernel in _constraint_kernels(program)]
    g_x = np.vstack([np.empty((0, len(y))), *(pair[0] for pair in pairs)])
    g_p = np.vstack([np.empty((0, len(point.p))), *(pair[1] for pair in pairs)])
    if not all(np.all(np.isfinite(table)) for table in (f_x, f_p, g_x, g_p)):
        raise InitialStateError(
            "the rates have no finite derivatives at this state: the coordinates or a load are singular there."
            " Linearise about another state"
        )
    if chosen is None and program.formulation == "minimal":
        free = _picked(g_x)
    else:
        free = _free(layout, g_x, chosen)
    pick = np.eye(len(y))[free]
    whole = np.linalg.pinv(np.vstack([g_x, pick]))
    tangent, shift = whole[:, len(g_x) :], -whole[:, : len(g_x)] @ g_p
    states = tuple(layout.state[i] for i in free)
    names = states if outputs is None else tuple(outputs)
    h, h_x, h_p = _outputs(point, names)
    given = [i for i, name in enumerate(layout.parameters) if name in layout.given]
    by_p, outputs_by_p = pick @ (f_p + f_x @ shift), h_p + h_x @ shift
    return Linearization(
        t=point.t,
        A=pick @ f_x @ tangent,
        C=h_x @ tangent,
        B_parameters=by_p[:, given],
        by_input=_by_input(layout, by_p),
        outputs_by_input=_by_input(layout, outputs_by_p),
        drift=point.value("rhs")[free],
        states=states,
        inputs=layout.inputs,
        outputs=names,
        parameters=tuple(layout.parameters[i] for i in given),
        values=y[free].copy(),
        output_values=h,
    )


def _by_input(layout: Layout, by_p: FloatArray) -> InputDerivatives:
    """Return derivatives by inputs and their rates from those by all parameters (k, n_p)."""
    places = np.array(input_places(layout), dtype=np.intp)
    return InputDerivatives(by_p[:, places], by_p[:, places + 1], 0.5 * by_p[:, places + 2])


def _outputs(point: _Point, names: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return outputs (k,) and their derivatives by the state (k, n_y) and the parameters (k, n_p)."""
    layout, size = point.program.layout, len(point.y)
    tables = {"state": (layout.state, point.y, np.eye(size), np.zeros((size, len(point.p))))}
    for kernel, rows in (("expand", (*layout.coordinates, *layout.rates)), ("outputs", layout.outputs)):
        known = [name for table in tables.values() for name in table[0]]
        if any(name in rows and name not in known for name in names):
            tables[kernel] = (rows, point.value(kernel), *point.derivatives(kernel))
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for name in names:
        rows, value, by_x, by_p = next(table for table in tables.values() if name in table[0])
        place = rows.index(name)
        found.append((float(value[place]), by_x[place], by_p[place]))
    empty = np.zeros(0), np.zeros((0, size)), np.zeros((0, len(point.p)))
    if not found:
        return empty
    values, by_x, by_p = zip(*found, strict=True)
    return np.array(values), np.array(by_x), np.array(by_p)


def _constraint_kernels(program: Program) -> list[str]:
    """Return the kernels of what the state itself has to fulfil; that of `minimal` only has unit quaternions."""
    if program.formulation == "minimal":
        return [name for name in ("project_position",) if name in program]
    return [name for name in ("position_residual", "velocity_residual") if name in program]


def _free(layout: Layout, g_x: FloatArray, chosen: Sequence[str] | None) -> list[int]:
    """Return the numbers of independent components: those chosen, or those that the constraints fix least."""
    state, holonomic, n = layout.state, layout.holonomic, len(layout.coordinates)
    if chosen is None:
        positions, rates = _picked(g_x[:holonomic, :n]), _picked(g_x[holonomic:, n : 2 * n])
        return [*positions, *(n + i for i in rates), *range(2 * n, len(state))]
    rank = int(np.linalg.matrix_rank(g_x, tol=_DEPENDENT * max(1.0, float(np.max(np.abs(g_x), initial=0.0)))))
    chosen = listed("states", chosen, "names of states")
    for name in chosen:
        if not isinstance(name, str) or name not in state:
            raise OptionError(unknown_name("state", str(name), state))
    free = [state.index(name) for name in chosen]
    whole = np.vstack([g_x, np.eye(len(state))[free]])
    if len(set(free)) != len(state) - rank or np.linalg.matrix_rank(whole, tol=_DEPENDENT) < len(state):
        raise OptionError(
            f"{list_names(chosen)} are not independent coordinates and speeds: {len(state) - rank} components are"
            f" needed that the constraints leave free together, of {list_names(state)}"
        )
    return free


def _picked(j: FloatArray) -> list[int]:
    """Return the columns of a constraint Jacobian that are left when its largest pivots have been eliminated."""
    work, fixed = j.copy(), set[int]()
    for _ in range(min(j.shape)):
        size = np.linalg.norm(work, axis=0)
        best = int(np.argmax(np.round(size, 9)))
        if size[best] <= _DEPENDENT * max(1.0, float(np.max(np.abs(j)))):
            break
        fixed.add(best)
        direction = work[:, best] / size[best]
        work = work - np.outer(direction, direction @ work)
    return [i for i in range(j.shape[1]) if i not in fixed]
