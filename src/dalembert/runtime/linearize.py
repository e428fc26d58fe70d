"""Linearisation of the motion on the constraints, from generated derivatives.

A state x with rates f(x) and constraints g(x) = 0 that the motion keeps is parametrised by some of its components z,
the rest following from g. With G = dx/dz, which solves g_x G = 0 and P G = 1 where P picks z, the reduced motion
z' = P f(x(z)) has the derivative A = P f_x G, at every state, in equilibrium or not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, list_names, unknown_name
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..results.linearization import Linearization
from ..transforms.partials import jacobian_kernel
from ..values import listed, option
from . import inputs
from .segments import at_time

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
) -> Linearization:
    """Return the linearisation about given values; see `CompiledModel.linearize`."""
    program, time = model.stages.program, option("t", t)
    p = model.parameter_vector(parameters)
    c = at_time(program, inputs.constants(program, p), time)
    values = model.initial_values(initial)
    y = inputs.initial_state(model.derived.start(values), time, values, c, program)
    return _linearized(program, time, y, p, c, states)


def _linearized(
    program: Program, t: float, y: FloatArray, p: FloatArray, c: FloatArray, chosen: Sequence[str] | None
) -> Linearization:
    """Return the linearisation at a state y (n_y,).

    Parameters
    ----------
    program : Program
        Whose motion.
    t, y, p, c
        Time, state, parameters (n_p,) and constants (n_c,) of them.
    chosen : sequence of str or None
        The independent components of the state; None picks them.

    Raises
    ------
    OptionError
        For names that are no components of the state, or are not independent or too few.
    """
    layout = program.layout
    f_x, f_p = _derivatives(program, program.kernel("rhs"), t, y, p, c)
    kernels = [program.kernel(name) for name in _constraint_kernels(program)]
    pairs = [_derivatives(program, kernel, t, y, p, c) for kernel in kernels]
    g_x = np.vstack([np.empty((0, len(y))), *(pair[0] for pair in pairs)])
    g_p = np.vstack([np.empty((0, len(p))), *(pair[1] for pair in pairs)])
    if chosen is None and program.formulation == "minimal":
        free = _picked(g_x)
    else:
        free = _free(layout.state, layout.holonomic, g_x, chosen)
    pick = np.eye(len(y))[free]
    whole = np.linalg.pinv(np.vstack([g_x, pick]))
    tangent, shift = whole[:, len(g_x) :], -whole[:, : len(g_x)] @ g_p
    rates = interpret_rows(program.kernel("rhs"), np.array([t]), y[np.newaxis], c)[0]
    given = [i for i, name in enumerate(layout.parameters) if name in layout.given]
    return Linearization(
        t=t,
        A=pick @ f_x @ tangent,
        B=(pick @ (f_p + f_x @ shift))[:, given],
        drift=rates[free],
        states=tuple(layout.state[i] for i in free),
        parameters=tuple(layout.parameters[i] for i in given),
        values=y[free].copy(),
    )


def _constraint_kernels(program: Program) -> list[str]:
    """Return the kernels of what the state itself has to fulfil; that of `minimal` only has unit quaternions."""
    if program.formulation == "minimal":
        return [name for name in ("project_position",) if name in program]
    return [name for name in ("position_residual", "velocity_residual") if name in program]


def _derivatives(
    program: Program, kernel: Kernel, t: float, y: FloatArray, p: FloatArray, c: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return derivatives of a kernel by the state (k, n_y) and, through its constants, by the parameters (k, n_p)."""
    times, rows, size = np.array([t]), y[np.newaxis], len(kernel.outputs)
    by_y = interpret_rows(jacobian_kernel(kernel, len(y)), times, rows, c).reshape(size, len(y))
    by_c = interpret_rows(jacobian_kernel(kernel, len(c), "c"), times, rows, c).reshape(size, len(c))
    prepare = replace(program.kernel("prepare"), arguments=("t", "p", "c"))
    c_by_p = jacobian_kernel(prepare, len(p), "p")
    as_state = replace(
        c_by_p,
        arguments=("t", "y", "c"),
        loads=tuple(replace(load, array="y") for load in c_by_p.loads),
    )
    by_p = interpret_rows(as_state, times, p[np.newaxis], c).reshape(len(c), len(p))
    return by_y, by_c @ by_p


def _free(state: Sequence[str], holonomic: int, g_x: FloatArray, chosen: Sequence[str] | None) -> list[int]:
    """Return the numbers of independent components: those chosen, or those that the constraints fix least."""
    if chosen is None:
        n = len(state) // 2
        return [*_picked(g_x[:holonomic, :n]), *(n + i for i in _picked(g_x[holonomic:, n:]))]
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
