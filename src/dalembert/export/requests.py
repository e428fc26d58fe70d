"""Requests for exports: the example, the method and the options of a kind, read and checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

from ..errors import OptionError, list_names, unknown_name
from ..events.event_code import Event, event_list
from ..frozen import frozen
from ..ir.program import hidden_parameters
from ..options import DEFAULT_TOLERANCES, NamedTolerances, tolerances
from ..runs.events import moving_events, with_event_parameters
from ..starts.inputs import resolve_names, span_of
from .kinds import FIXED, refuse_dependent, refuse_kind

if TYPE_CHECKING:
    from ..model.model import CompiledModel

PRECISIONS = ("double", "single")
"""Precisions of the numbers of exported code, the one by default first."""

INSTEAD = {("jax", "auto"): "dop853", ("jax", "taylor"): "dop853"}
"""Methods of kinds in place of those that "auto" finds."""

FMI_VERSIONS = ("2.0", "3.0")
"""Versions of the standard of units, the one by default first."""


@final
@frozen(eq=False, kw_only=True)
class ExportOptions:
    """The arguments of `dalembert.model.exports.export`, which describes them."""

    kind: str
    initial: Mapping[Any, Any] | None
    parameters: Mapping[Any, Any] | None
    inputs: Mapping[Any, Any] | None
    t_span: tuple[float, float]
    method: str
    rtol: float
    atol: float
    step: float | None
    precision: str
    fmi: str
    platforms: Sequence[str] | None
    sliders: Mapping[Any, tuple[float, float]] | None
    events: Any


def export_request(model: CompiledModel, asked: ExportOptions) -> tuple[CompiledModel, dict[str, Any]]:
    """Return the model with the parameters of events, and what is asked for as the functions of kinds take it.

    Raises
    ------
    CapabilityError, OptionError, InitialStateError, UnknownNameError, ValueInputError
        As `dalembert.model.exports.export`.
    """
    kind, method, events = asked.kind, asked.method, asked.events
    if asked.fmi not in FMI_VERSIONS:
        raise OptionError(f"fmi is {asked.fmi!r}: exports are units of FMI {list_names(map(repr, FMI_VERSIONS))}")
    steps = _steps(asked)
    if not isinstance(events, tuple) or events:
        events = event_list(events, model.layout.aliases)
        model = with_event_parameters(model, asked.parameters or {}, events)
        events = moving_events(model.layout, events)
    refuse_kind(model, kind, method, events)
    given = None if asked.initial is None else dict(model.read_initial(asked.initial))
    numbers = dict(given or {})
    if asked.parameters is not None:
        numbers |= model.read_parameters({**dict.fromkeys(_hidden(model), 0.0), **asked.parameters})
    numbers |= _input_values(model, asked.inputs)
    span, complete = span_of(asked.t_span), _complete(model, numbers, given)
    if complete and not model.layout.inputs:
        parameters = asked.parameters or {}
        state = model.state(asked.initial or {}, parameters, t=span[0])
        refuse_dependent(model, state, model.parameter_vector(parameters), span)
    if method == "auto":
        if complete:
            rtol, atol = steps["tolerances"]
            method = _method_of_example(model, asked, rtol, atol, events)
        method = INSTEAD.get((kind, method), method)
    request: dict[str, Any] = {"initial": given, "numbers": numbers, "method": method, "span": span, **steps}
    if events:
        request["events"] = events
    return model, request | _of_kind(model, given, asked)


def _steps(asked: ExportOptions) -> dict[str, Any]:
    """Return the tolerances, and for steps of a fixed size that and the precision."""
    step, precision = asked.step, asked.precision
    rtol, atol = tolerances(asked.rtol, asked.atol)
    if isinstance(atol, NamedTolerances):
        raise OptionError("exports take one atol for the whole state, and not tolerances by name: give a number")
    if asked.method == FIXED or step is not None:
        step = _step(asked.kind, asked.method, (rtol, atol), step)
    if precision not in PRECISIONS:
        raise OptionError(
            f"precision is {precision!r}: exports have the precisions {list_names(map(repr, PRECISIONS))}"
        )
    if precision != PRECISIONS[0] and asked.method != FIXED:
        raise OptionError(
            f"precision={precision!r} is one of method={FIXED!r}, not of {asked.method!r}: other methods compare errors"
            " with tolerances, which the rounding of float (6e-8 of a value) hides. Give method='rk4' and step=, or"
            " leave precision out"
        )
    if rtol == atol == 0.0:
        raise OptionError("rtol and atol must not both be 0: set one of them above 0")
    return {"tolerances": (rtol, atol)} | ({} if step is None else {"step": step, "precision": precision})


def _of_kind(model: CompiledModel, given: Mapping[str, float] | None, asked: ExportOptions) -> dict[str, Any]:
    """Return what kinds have of their own; others reject it."""
    kind = asked.kind
    if kind != "page" and asked.sliders is not None:
        raise OptionError(f"sliders are those of the kind 'page', not of {kind!r}: leave them out")
    if kind != "fmu" and asked.platforms is not None:
        raise OptionError(f"platforms are those of the kind 'fmu', not of {kind!r}: leave them out")
    if kind != "fmu" and asked.fmi != FMI_VERSIONS[0]:
        raise OptionError(f"fmi is the version of the kind 'fmu', not of {kind!r}: leave it out")
    if kind == "page":
        return {"sliders": _sliders(model, given, asked.sliders)}
    return {"platforms": asked.platforms, "fmi": asked.fmi} if kind == "fmu" else {}


def _step(kind: str, method: str, tolerances: tuple[float, float], step: Any) -> float:
    """Return the size of the steps of an export whose steps have a fixed one.

    Raises
    ------
    OptionError
        For another kind or method, tolerances that nothing uses, and a size that is none.
    """
    if method != FIXED:
        raise OptionError(f"step is the size of steps of method={FIXED!r}, and not of {method!r}: leave it out")
    if kind != "c":
        raise OptionError(f"method={FIXED!r} is one of the kind 'c', not of {kind!r}: give kind='c', or another method")
    if tolerances != DEFAULT_TOLERANCES:
        raise OptionError(f"steps of method={FIXED!r} have no tolerances: leave rtol and atol out, and give step=")
    if step is None:
        raise OptionError(f"method={FIXED!r} needs the size of its steps in seconds: give step=, such as step=0.001")
    if isinstance(step, bool) or not isinstance(step, int | float) or not 0.0 < step < math.inf:
        raise OptionError(f"step must be a finite number of seconds above 0, not {step!r}")
    return float(step)


def _sliders(
    model: CompiledModel, given: Mapping[str, float] | None, sliders: Any
) -> dict[str, tuple[float, float]] | None:
    """Return the ends of sliders by name, None where all values get one."""
    if sliders is None:
        return None
    layout = model.layout
    if not isinstance(sliders, Mapping):
        raise OptionError(f"sliders must be a mapping of names or symbols to (low, high), not {sliders!r}")
    known = [name for name in (*(given or ()), *layout.parameters, *layout.inputs) if name not in _hidden(model)]
    names = resolve_names("slider", sliders, known, layout.aliases)
    found = {}
    for name, ends in zip(names, sliders.values(), strict=True):
        numbers = isinstance(ends, list | tuple) and all(
            isinstance(end, int | float) and math.isfinite(end) for end in ends
        )
        if not numbers or len(ends) != 2 or not ends[0] < ends[1]:
            raise OptionError(f"the slider {name!r} needs two finite numbers (low, high), not {ends!r}")
        found[name] = (float(ends[0]), float(ends[1]))
    return found


def _hidden(model: CompiledModel) -> set[str]:
    """Return the parameters that stand for inputs."""
    return {name for u in model.layout.inputs for name in hidden_parameters(u)}


def _complete(model: CompiledModel, numbers: Mapping[str, float], given: Mapping[str, float] | None) -> bool:
    """Return whether an example has all of its numbers."""
    wanted = {*model.layout.parameters, *model.layout.inputs} - _hidden(model)
    return given is not None and model.modes is None and wanted <= set(numbers)


def _method_of_example(
    model: CompiledModel, asked: ExportOptions, rtol: float, atol: float, events: Sequence[Event]
) -> str:
    """Return the method that a run of the example takes, "auto" where it takes several."""
    run = model.simulate(
        asked.t_span,
        asked.initial or {},
        asked.parameters or {},
        inputs=asked.inputs,
        events=events,
        rtol=rtol,
        atol=atol,
        t_eval=asked.t_span,
        dense=False,
    )
    return run.stats.method if run.stats.method in model.methods else "auto"


def _input_values(model: CompiledModel, inputs: Mapping[Any, Any] | None) -> dict[str, float]:
    """Return the values of constant inputs by name."""
    found: dict[str, float] = {}
    for symbol, value in (inputs or {}).items():
        name = symbol if isinstance(symbol, str) else getattr(getattr(symbol, "func", None), "__name__", str(symbol))
        if name not in model.layout.inputs:
            raise OptionError(unknown_name("input", name, model.layout.inputs))
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise OptionError(f"the input {name!r} of the example must be a finite number, not {value!r}")
        found[name] = float(value)
    return found
