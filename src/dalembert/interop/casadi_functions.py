"""Programs as functions of CasADi, which differentiates them exactly; imported on use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..errors import CapabilityError, MissingExtraError, list_names
from ..ir.interpret import interpret
from ..ir.ops import TABLE_ARGUMENTS
from ..ir.program import Program, coefficient_places, hidden_parameters

try:
    import casadi as ca
except ImportError:
    raise MissingExtraError('casadi is needed; install it with: pip install "dalembert[casadi]"') from None

OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "pow": ca.power,
    "abs": ca.fabs,
    "min": ca.fmin,
    "max": ca.fmax,
    "less": ca.lt,
    "less_equal": ca.le,
    "select": ca.if_else,
    "fma": lambda a, b, c: a * b + c,
    **{
        name: getattr(ca, name)
        for name in (
            *("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
            *("exp", "log", "sinh", "cosh", "tanh", "sign", "floor"),
        )
    },
}

_OF_STATE, _OF_MOTION = (
    ("rhs", "expand", "outputs"),
    (
        *("accelerations", "mass_matrix", "forcing", "energy"),
        *("constraint_jacobian", "position_residual", "velocity_residual"),
    ),
)
"""Kernels of (t, y), and of (t, x), x holding coordinates, rates and first-order states."""

_ROWS = ("mass_matrix", "constraint_jacobian")
"""Kernels that are matrices with a column for each coordinate."""


def casadi_functions(program: Program) -> dict[str, Any]:
    """Return the kernels of a program as functions of CasADi, by name.

    Raises
    ------
    CapabilityError
        For tables, compiled functions, and functions of time with kinks or jumps.
    """
    _refuse(program)
    layout = program.layout
    hidden = [name for u in layout.inputs for name in hidden_parameters(u)]
    given = [name for name in layout.parameters if name not in hidden]
    t, p, u = ca.SX.sym("t"), ca.SX.sym("p", len(given)), ca.SX.sym("u", len(layout.inputs))
    known = {name: p[i] for i, name in enumerate(given)}
    values = [known.get(name, ca.SX(0)) for name in layout.parameters]
    for number, first in enumerate(coefficient_places(layout.parameters, layout.inputs)):
        values[first], values[first + 1] = t, u[number]
    c = interpret(program.kernel("prepare"), {"p": values}, OPERATIONS)
    found = {}
    sizes = dict.fromkeys(_OF_STATE, ("y", len(layout.state)))
    sizes |= dict.fromkeys(_OF_MOTION, ("x", 2 * len(layout.coordinates) + len(layout.states)))
    for name, (argument, size) in sizes.items():
        if name not in program or not program.kernel(name).outputs:
            continue
        y = ca.SX.sym(argument, size)
        outputs = ca.vertcat(*interpret(program.kernel(name), {"t": t, "y": ca.vertsplit(y), "c": c}, OPERATIONS))
        if name in _ROWS:
            outputs = ca.reshape(outputs, len(layout.coordinates), -1).T
        found[name] = ca.Function(name, [t, y, p, u], [outputs], ["t", argument, "p", "u"], [name])
    return found


def _refuse(program: Program) -> None:
    used = {line.op for kernel in program for line in kernel.body} & set(TABLE_ARGUMENTS)
    if used or program.conditions is not None:
        tables = f"tables or compiled functions ({list_names(sorted(used))})"
        what = tables if used else "functions of time with kinks or jumps"
        raise CapabilityError(
            f"{program.name!r} has {what}, which functions of CasADi do not have: make them inputs (add_inputs), or"
            " write them as smooth expressions"
        )
