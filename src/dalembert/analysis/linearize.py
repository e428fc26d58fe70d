"""Linearisation of the motion on the constraints, from generated derivatives.

A state x with rates f(x, u) and constraints g(x, u) = 0 that the motion keeps is parametrised by some of its components
z, the rest following from g. With G = dx/dz, which solves g_x G = 0 and P G = 1 where P picks z, the reduced motion
z' = P f(x(z)) has the derivative A = P f_x G, at every state, in equilibrium or not. Inputs and parameters u move x by
H = -(g_x stacked on P)^-1 g_u while z is held: B = P (f_u + f_x H). Outputs h have C = h_x G and D = h_u + h_x H.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError, OptionError, list_names, unknown_name
from ..frozen import frozen
from ..ir.program import Layout
from ..results.linearization import InputDerivatives, Linearization
from ..starts import inputs as run_input
from ..starts.constraint_choice import divisible_model
from ..starts.constraint_rank import StartRows
from ..starts.initial_states import initial_state
from ..starts.input_values import expanded_at, input_places
from ..starts.segment_constants import at_time
from ..starts.state_sizes import distance_sizes
from ..values import listed, option
from .linear_equations import LinearEquations, LinearPoint, own_equations, scene_equations

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_DEPENDENT = 1e-9
"""Share of a constraint, and of the size of a component of the state, below which nothing new is left."""


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
    requested = None if outputs is None else output_names(model.layout, outputs)
    _, point = regular_point(model, time, initial, parameters)
    return _linearized(point, states, requested)


def regular_point(
    model: CompiledModel, t: float, initial: Mapping[Any, Any], parameters: Mapping[Any, Any]
) -> tuple[CompiledModel, LinearPoint]:
    """Return a model whose constraints are independent at given values, and this point.

    Its inputs have their knots at t.

    Raises
    ------
    InitialStateError
        Where the constraints lose rank at this state alone.
    """
    able = divisible_model(model, t, initial, parameters)
    p = expanded_at(model.layout, model.parameter_vector(parameters), t)
    values = model.initial_values(initial)
    point = _point(able, t, values, p)
    enforced = able.derived.enforced
    if enforced:
        dropped = StartRows(point.program, t, point.y, point.c, enforced).redundant()
        if dropped is None:
            raise InitialStateError(
                f"the constraints lose rank at this state alone (t = {t:g}), where the motion has no linearisation:"
                " linearise about another state"
            )
        if dropped:
            able = able.variants.without_constraints(dropped)
            point = _point(able, t, values, p)
    return able, point


def _point(model: CompiledModel, t: float, values: Mapping[str, float], p: FloatArray) -> LinearPoint:
    """Return a model at initial values by name and parameters (n_p,)."""
    program = model.stages.program
    c = at_time(program, run_input.constants(program, p), t)
    y = initial_state(model.derived.start(values), t, values, c, program)
    return LinearPoint(program, model.derived.partials, t, y, c, left_out=model.stages.reduced.left_out)


def output_names(layout: Layout, given: Iterable[Any]) -> list[str]:
    """Return the names of outputs.

    Raises
    ------
    UnknownNameError
        For those that are none.
    """
    known = dict.fromkeys((*layout.variables, *layout.state, *layout.outputs))
    return run_input.resolve_names("output", given, known, layout.aliases)


def _equations(point: LinearPoint, chosen: Sequence[str] | None) -> LinearEquations:
    """Return the equations in coordinates and rates, or in the formulation's state where its speeds are chosen.

    Angular velocities that a start may be given in, with unit quaternions, are taken where the formulation has them.
    """
    layout = point.program.layout
    scene = set(layout.variables)
    speeds = [name for name in layout.state if name not in scene]
    requested = layout.entries if chosen is None else chosen
    return own_equations(point) if any(name in requested for name in speeds) else scene_equations(point)


@final
@frozen(eq=False)
class IndependentStates:
    """Independent components z of a state x with constraints g(x, u) = 0.

    Attributes
    ----------
    equations : LinearEquations
        Of x.
    places : list of int
        Which components of x they are.
    tangent : ndarray (n_x, n_z)
        Derivatives of x by z, on the constraints.
    shift : ndarray (n_x, n_p)
        Derivatives of x by the parameters, with z held.
    """

    equations: LinearEquations
    places: list[int]
    tangent: FloatArray
    shift: FloatArray


def independent_states(point: LinearPoint, chosen: Sequence[str] | None) -> IndependentStates:
    """Return independent components of the state at a point.

    Parameters
    ----------
    point : Point
        Its inputs have their knots at its time.
    chosen : sequence of str or None
        The independent components of the state; None picks them.

    Raises
    ------
    OptionError
        For names that are no components of the state, or are not independent or too few.
    """
    layout = point.program.layout
    if chosen is not None:
        chosen = [layout.aliases.get(str(key), str(key)) for key in listed("states", chosen, "names of states")]
    equations = _equations(point, chosen)
    rates, constraints = equations.rates, equations.constraints
    g_x, g_p = constraints.by_state, constraints.by_parameters
    if not all(np.all(np.isfinite(table)) for table in (rates.by_state, rates.by_parameters, g_x, g_p)):
        raise InitialStateError(
            "the rates have no finite derivatives at this state: the coordinates or a load are singular there."
            " Linearise about another state"
        )
    scales = _Scales.of(equations)
    free = _free(equations, scales, chosen)
    pick = np.eye(len(equations.state))[free]
    whole = scales.columns[:, np.newaxis] * np.linalg.pinv(np.vstack([scales.matrix, pick]))
    tangent, across = whole[:, len(g_x) :] / scales.columns[free], whole[:, : len(g_x)] / scales.rows
    return IndependentStates(equations, free, tangent, -across @ g_p)


def _linearized(point: LinearPoint, chosen: Sequence[str] | None, outputs: Sequence[str] | None) -> Linearization:
    """Return the linearisation at a point; errors and arguments as for `independent_states`.

    `outputs` are names of the rows of C; None takes the independent components.
    """
    layout = point.program.layout
    found = independent_states(point, chosen)
    equations, free, tangent, shift = found.equations, found.places, found.tangent, found.shift
    rates, pick = equations.rates, np.eye(len(equations.state))[free]
    states = tuple(equations.names[i] for i in free)
    names = states if outputs is None else tuple(outputs)
    seen = equations.outputs(names)
    given = [i for i, name in enumerate(layout.parameters) if name in layout.given]
    by_p = pick @ (rates.by_parameters + rates.by_state @ shift)
    return Linearization(
        t=point.t,
        A=pick @ rates.by_state @ tangent,
        C=seen.by_state @ tangent,
        B_parameters=by_p[:, given],
        by_input=_by_input(layout, by_p),
        outputs_by_input=_by_input(layout, seen.by_parameters + seen.by_state @ shift),
        drift=rates.value[free],
        states=states,
        inputs=layout.inputs,
        outputs=names,
        parameters=tuple(layout.parameters[i] for i in given),
        values=equations.state[free].copy(),
        output_values=seen.value,
    )


def _by_input(layout: Layout, by_p: FloatArray) -> InputDerivatives:
    """Return derivatives by inputs and their rates from those by all parameters (k, n_p)."""
    places = np.array(input_places(layout), dtype=np.intp)
    return InputDerivatives(by_p[:, places], by_p[:, places + 1], 0.5 * by_p[:, places + 2])


@final
@frozen(eq=False)
class _Scales:
    """Derivatives of constraints by a state, both as shares of their sizes, so that they have no unit.

    Attributes
    ----------
    matrix : ndarray (m, n)
    rows : ndarray (m,)
        Sizes of constraints.
    columns : ndarray (n,)
        Sizes of components of the state.
    """

    matrix: FloatArray
    rows: FloatArray
    columns: FloatArray

    @classmethod
    def of(cls, equations: LinearEquations) -> _Scales:
        """Return the scaled derivatives; the unit of time follows from rates, and how those of constraints change."""
        g_x, h, n = equations.constraints.by_state, equations.holonomic, equations.coordinates
        columns, point = np.ones(len(equations.state)), equations.point
        if not n:
            return cls(g_x, np.ones(len(g_x)), columns)
        sizes = distance_sizes(point.program, point.t, equations.state, point.c)
        lengths = np.linalg.norm(np.vstack([g_x[:h, :n], g_x[h:, n : 2 * n]]) * sizes, axis=1)
        rows = np.where(lengths > 0.0, lengths, 1.0)
        speed = float(np.max(np.abs(equations.state[n : 2 * n]) / sizes))
        time = float(np.max(np.linalg.norm(g_x[h:, :n] * sizes, axis=1) / rows[h:], initial=speed)) or 1.0
        rows[h:] *= time
        columns[: 2 * n] = np.concatenate([sizes, sizes * time])
        others = np.max(np.abs(g_x[:, 2 * n :]) / rows[:, np.newaxis], axis=0, initial=0.0)
        columns[2 * n :] = 1.0 / np.where(others > 0.0, others, 1.0)
        return cls(g_x * columns / rows[:, np.newaxis], rows, columns)


def _free(equations: LinearEquations, scales: _Scales, chosen: Sequence[str] | None) -> list[int]:
    """Return the numbers of independent components: those chosen, or those that the constraints fix least."""
    state, holonomic, n, g_x = equations.names, equations.holonomic, equations.coordinates, scales.matrix
    if chosen is None:
        positions, rates = _picked(g_x[:holonomic, :n]), _picked(g_x[holonomic:, n : 2 * n])
        free = [*positions, *(n + i for i in rates), *range(2 * n, len(state))] if n else _picked(g_x)
        if np.linalg.matrix_rank(np.vstack([g_x, np.eye(len(state))[free]]), tol=_DEPENDENT) < len(state):
            raise InitialStateError(
                "the constraints lose rank at this state, where the motion has no linearisation: linearise about"
                " another state"
            )
        return free
    rank = int(np.linalg.matrix_rank(g_x, tol=_DEPENDENT * max(1.0, float(np.max(np.abs(g_x), initial=0.0)))))
    for name in chosen:
        if name not in state:
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
