"""Input of runs: mappings from names or symbols to numbers, and their checks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import (
    InitialStateError,
    PrecisionWarning,
    UnknownNameError,
    ValueInputError,
    list_names,
    unknown_name,
    warn_caller,
)
from ..ir.graph import Graph
from ..ir.interpret import ARRAY_OPERATIONS, interpret, interpret_rows, rows_of_columns
from ..ir.node import Node
from ..ir.program import Layout, Program, hidden_parameters
from ..once import deriving
from ..scene.symbol_table import Entry, InputSymbol, chosen_entries
from ..transforms.lower_kernels import lower_kernel
from ..values import listed, number, traced_note
from .input_values import read_inputs
from .symbol_assumptions import ROUNDING, refuse_contradictions

if TYPE_CHECKING:
    from ..model.model import CompiledModel


# Constraints whose coefficients all vanish at the parameters of a run: what errors that they cause say of them.

_POINTS = 4
"""Random configurations at which the constraint Jacobian is evaluated."""


def vanished_text(program: Program, c: FloatArray) -> str:
    """Return a sentence on the constraints whose rows are zero in every configuration at constants c; "" without any.

    Constants that are not finite count as unknown.
    """
    layout = program.layout
    count, n = len(layout.constraints), len(layout.coordinates)
    if not count:
        return ""
    x = np.random.default_rng(0).uniform(0.4, 1.3, (_POINTS, 2 * n + len(layout.states)))
    with np.errstate(all="ignore"):
        rows = interpret_rows(program.kernel("constraint_jacobian"), np.zeros(_POINTS), x, c)
    zero = np.all(rows.reshape(_POINTS, count, n) == 0.0, axis=(0, 2))
    labels = [label for label, vanished in zip(layout.constraints, zero, strict=True) if vanished]
    if not labels:
        return ""
    constrains, them = (
        ("it constrains", "the constraint") if len(labels) == 1 else ("they constrain", "the constraints")
    )
    return (
        f"All coefficients of {list_names(labels)} vanish at these parameters, so that {constrains}"
        f" nothing. Give the factor that vanishes another value, or remove {them} from the scene"
    )


FLOOR = 1e-16
"""Relative error below which no tolerance is met: half the spacing of doubles, rounded down."""

IMPLICIT_FLOOR = 1e-13
"""The same for `radau`: what Newton's iteration leaves of its stages (measured on the hard cases)."""

MULTIPLIERS_FLOOR = 1e-10
"""The same with multipliers in the stages, which rounding of the constraints over the step reaches."""


def span_of(t_span: Sequence[float]) -> tuple[float, float]:
    """Return start and end of a run as numbers.

    Raises
    ------
    ValueInputError
        For what is not two numbers.
    """
    try:
        t0, t1 = t_span
        t0, t1 = number(t0), number(t1)
    except (TypeError, ValueError) as error:
        message = f"t_span must be two numbers, start and end, not {t_span!r}{traced_note(error)}"
        raise ValueInputError(message) from None
    return t0, t1


def resolve(
    kind: str,
    given: Mapping[Any, Any],
    known: Iterable[str],
    aliases: Mapping[str, str],
    shown: Iterable[str] | None = None,
) -> dict[str, float]:
    """Return a mapping of names to floats from one of names or symbols to numbers; messages list the names `shown`.

    Raises
    ------
    UnknownNameError
        For keys that are not known, all of them at once, and for a name that is given twice.
    ValueInputError
        For values that are not finite numbers, all of them at once.
    """
    if not isinstance(given, Mapping):
        raise ValueInputError(f"{kind}s must be a mapping of names or symbols to numbers, not {given!r}")
    known = list(known)
    values: dict[str, float] = {}
    unknown, wrong = [], []
    for key, value in given.items():
        name = aliases.get(str(key), str(key))
        if name not in known:
            unknown.append(unknown_name(kind, str(key), known if shown is None else shown))
        elif name in values:
            unknown.append(f"{kind} {name!r} is given twice")
        try:
            found = number(value)
        except ValueError as reason:
            wrong.append(f"{name} = {value!r} {reason}")
            continue
        if not math.isfinite(found):
            wrong.append(f"{name} = {found!r} is not finite")
        values[name] = found
    if unknown:
        raise UnknownNameError("\n".join(unknown))
    if wrong:
        raise ValueInputError(f"every {kind} must be a finite number: {'; '.join(wrong)}")
    return values


def resolve_names(kind: str, given: Iterable[Any], known: Iterable[str], aliases: Mapping[str, str]) -> list[str]:
    """Return names from names or symbols.

    Raises
    ------
    UnknownNameError
        For those that are not known, all of them at once.
    """
    known = list(known)
    names = [aliases.get(str(key), str(key)) for key in listed(f"{kind}s", given, "names or symbols")]
    unknown = [unknown_name(kind, name, known) for name in names if name not in known]
    if unknown:
        raise UnknownNameError("\n".join(unknown))
    return names


def warn_below_floor(rtol: float, atol: float, program: Program | None = None, method: str = "") -> None:
    """Warn of tolerances below what a method reaches in double precision, for components of size 1."""
    if rtol >= MULTIPLIERS_FLOOR or atol >= MULTIPLIERS_FLOOR:  # the highest floor
        return
    floor, what = FLOOR, "double precision"
    if program is not None and "stages" in program:
        floor, what = MULTIPLIERS_FLOOR, f"{method!r} with multipliers in its stages ({program.formulation!r})"
    elif method == "radau":
        floor, what = IMPLICIT_FLOOR, f"{method!r}, which solves for its stages,"
    if 0.0 <= rtol < floor and 0.0 <= atol < floor and (rtol or atol):
        warn_caller(
            f"rtol = {rtol:g} with atol = {atol:g} is less than {what} reaches: its floor is {floor:g} of"
            " the size of the state, and below it steps get shorter while errors do not. Give one of them at least"
            f" {floor:g}",
            PrecisionWarning,
        )


def named_parameters(model: CompiledModel, parameters: Mapping[Any, Any]) -> dict[str, float]:
    """Return the parameters of a model by name, those of the inputs among them, checked."""
    return dict(zip(model.layout.parameters, model.parameter_vector(parameters).tolist(), strict=True))


def parameter_values(layout: Layout, parameters: Mapping[Any, Any]) -> dict[str, float]:
    """Return the parameters that are given by name; those that may be left out may be missing.

    Raises
    ------
    UnknownNameError
        For missing or unknown names.
    ValueInputError
        For values that are not finite numbers, or that their symbols exclude.
    """
    complaint, values = None, dict[str, float]()
    try:
        refuse_inputs(layout, parameters)
        values = resolve("parameter", parameters, layout.parameters, layout.aliases, layout.given)
        refuse_contradictions(layout.assumptions, values)
        given = set(values)
    except UnknownNameError as unknown:
        complaint = str(unknown)
        given = {layout.aliases.get(str(key), str(key)) for key in parameters}
    missing = [name for name in layout.parameters if name not in given and name not in layout.defaults]
    if missing:
        need = f"missing parameters: {list_names(missing)}. The scene needs: {list_names(layout.given)}."
        complaint = need if complaint is None else f"{complaint}\n{need}"
    if complaint is not None:
        raise UnknownNameError(complaint)
    return values


def refuse_inputs(layout: Layout, parameters: Mapping[Any, Any], why: str = "not a parameter") -> None:
    """Reject inputs among parameters or initial values.

    Raises
    ------
    UnknownNameError
    """
    if not layout.inputs or not isinstance(parameters, Mapping):
        return
    wrong = [str(key) for key in parameters if layout.aliases.get(str(key), str(key)) in layout.inputs]
    if wrong:
        raise UnknownNameError(f"{list_names(map(repr, wrong))} is an input, {why}: give its values as inputs={{...}}")


def parameter_vector(layout: Layout, parameters: Mapping[Any, Any]) -> FloatArray:
    """Return p (n_p,) from a mapping of names or symbols to numbers; errors as for `parameter_values`."""
    return in_order(layout, parameter_values(layout, parameters))


def in_order(layout: Layout, values: Mapping[str, float]) -> FloatArray:
    """Return p (n_p,) from parameters by name."""
    if layout.defaults:
        values = {**layout.defaults, **values}
    return np.array([values[name] for name in layout.parameters], dtype=float)


def prepare_rows(program: Program, p: FloatArray) -> FloatArray:
    """Return the constants (k, n_c) of parameters p (k, n_p); values that are not finite are kept."""
    with np.errstate(all="ignore"):
        columns = interpret(program.kernel("prepare"), {"p": p.T}, ARRAY_OPERATIONS)
    return rows_of_columns(columns, len(p))


def constants(program: Program, p: FloatArray) -> FloatArray:
    """Return the constants c (n_c,) of parameters p (n_p,).

    Raises
    ------
    ValueInputError
        When an expression of the parameters is not finite at these values.
    """
    c = np.array(interpret(program.kernel("prepare"), {"p": p.tolist()}), dtype=float)
    if not np.all(np.isfinite(c)):
        vanished = vanished_text(program, c)
        why = "a mass, a length, a moment of inertia or the coefficient in a constraint that the scene divides by"
        raise ValueInputError(
            f"an expression of the parameters is not finite at {parameter_text(program, p)}"
            + (f". {vanished}" if vanished else f": {why} is zero")
        )
    return c


def parameter_text(program: Program, p: FloatArray) -> str:
    """Return the values of parameters at the beginning of p, as text."""
    rows, given = zip(program.layout.parameters, p, strict=False), program.layout.given
    return ", ".join(f"{name} = {value:g}" for name, value in rows if name in given)


def given_values(layout: Layout, initial: Mapping[Any, Any]) -> dict[str, float]:
    """Return initial values by name.

    Raises
    ------
    UnknownNameError, ValueInputError
        For unknown names, and values that are not finite numbers or that their symbols exclude.
    """
    refuse_inputs(layout, initial, "which has no initial value")
    values = resolve("initial value", initial, layout.initial, layout.aliases)
    refuse_contradictions(layout.assumptions, values, ROUNDING)
    return values


@deriving
def guessed_values(layout: Layout, entries: Sequence[Entry], guess: Mapping[Any, Any]) -> dict[str, float]:
    """Return values of coordinates, rates and states by name; what `entries` say gives others is read, too.

    Raises
    ------
    UnknownNameError, ValueInputError
        As for `given_values`.
    InitialStateError
        Where values of an entry, or coordinates that it needs, are missing, or given twice.
    """
    values = given_values(layout, guess)
    for entry, _ in chosen_entries(entries, values):
        graph = Graph()
        nodes = graph.adopt(entry.values)
        read = [str(node.payload) for node in graph.topological(nodes) if node.op == "input"]
        lacking = [name for name in read if name not in values]
        if lacking:
            raise InitialStateError(f"with {list_names(entry.names)}, {list_names(lacking)} are needed, too")
        inputs: dict[Node, tuple[str, int | None]] = {graph.input(name): ("y", i) for i, name in enumerate(read)}
        kernel = lower_kernel(graph, "entry", nodes, inputs, arguments=("y",))
        found = interpret(kernel, {"y": [values[name] for name in read]})
        values |= dict(zip(entry.targets, found, strict=True))
    return {name: value for name, value in values.items() if name in layout.variables}


def with_inputs(
    layout: Layout,
    symbols: Sequence[InputSymbol],
    given: Mapping[Any, Any] | None,
    parameters: Mapping[Any, Any],
    t: float,
) -> Mapping[Any, Any]:
    """Return parameters with those of inputs that have the values given, at one instant; errors as `read_inputs`.

    Parameters that have those of inputs already are returned as they are, where no values are given.
    """
    if given is None and any(hidden_parameters(each.name)[0] in parameters for each in symbols):
        return parameters
    found = read_inputs(layout, symbols, given, np.array([t]))
    return parameters if found is None else found.parameters(parameters, t)
