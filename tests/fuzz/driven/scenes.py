"""Driven scenes as users write them: `model`, with inputs, functions of time and controllers in place of numbers."""

from __future__ import annotations

from typing import Any

from sympy import Piecewise, cos, symbols
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from fuzz.contacts.scenes import SCENES, TIME, Numbers, Setting
from fuzz.driven.families import Driven, Kick, Law

__all__ = ["event", "model", "parameters_of", "samples_of", "start_of"]

STATES = {"integral": "ctl_sum", "count": "ctl_count"}
"""States of laws, by kind."""


def _setting(driven: Driven, function: Any = None) -> Setting:
    """Return the scene of a case; its controller is a Python function where one is given."""
    given: dict[str, Any] = {}
    for name, record in driven.records:
        given[name] = dynamicsymbols(name) if record.sampled else record.expression(name)
    if driven.law is not None:
        given[driven.law.sets] = dynamicsymbols(driven.law.sets)
    made = SCENES[driven.case.scene](Numbers(given))
    inputs = [given[name] for name, record in driven.records if record.sampled]
    if driven.law is not None:
        inputs.append(given[driven.law.sets])
    if inputs:
        made.scene.add_inputs(*inputs)
    if driven.law is not None:
        made.scene.add_controllers(_controller(driven.law, made.scene.coordinates, function))
    return made


def _controller(law: Law, coordinates: Any, function: Any) -> Any:
    u, q = dynamicsymbols(law.sets), coordinates[law.place]
    a, b, c, period = symbols("ctl_a ctl_b ctl_c ctl_T", real=True)
    name = STATES.get(law.kind)
    states = [dynamicsymbols(name)] if name else []
    if function is not None:
        return da.Controller("law", period=law.period, inputs=[u], states=states, function=function)
    z = next(iter(states), None)
    if law.kind == "line":
        value, after = a - b * q - c * q.diff(TIME), {}
    elif law.kind == "switch":
        value, after = Piecewise((a, q > b), (-a, True)), {}
    elif law.kind == "integral":
        value, after = a * z, {z: z + period * (b - q)}
    else:
        value, after = a * cos(b * z), {z: z + 1}
    return da.Controller("law", period=period, inputs={u: value}, states=after)


def _key(driven: Driven) -> tuple[Any, ...]:
    law = driven.law
    kinds = tuple((name, record.kind if not record.sampled else "samples") for name, record in driven.records)
    return driven.case.scene, kinds, law and (law.sets, law.kind, law.place)


_MODELS: dict[tuple[Any, ...], tuple[Setting, Any]] = {}


def model(driven: Driven, function: Any = None) -> tuple[Setting, Any]:
    """Return the scene and the model of a case; those with the same scene, kinds and law share them."""
    if function is not None:
        made = _setting(driven, function)
        return made, da.compile_model(made.scene, outputs=list(made.outputs))
    key = _key(driven)
    if key not in _MODELS:
        made = _setting(driven)
        _MODELS[key] = made, da.compile_model(made.scene, outputs=list(made.outputs))
    return _MODELS[key]


def parameters_of(driven: Driven, model: Any) -> dict[str, float]:
    """Return the parameters of a run."""
    known = dict(driven.case.parameters)
    for name, record in driven.records:
        known |= {} if record.sampled else record.parameters(name)
    if driven.law is not None:
        known |= dict(zip(("ctl_a", "ctl_b", "ctl_c"), driven.law.numbers, strict=True), ctl_T=driven.law.period)
    return {name: known[name] for name in model.layout.parameters if name in known}


def start_of(driven: Driven) -> dict[str, float]:
    """Return the initial values of a run."""
    name = driven.law and STATES.get(driven.law.kind)
    return driven.case.initial | ({name: 0.0} if name else {})


def samples_of(driven: Driven) -> dict[str, Any]:
    """Return the samples of the inputs of a run."""
    return {name: record.samples() for name, record in driven.records if record.sampled}


def event(kick: Kick, scene: Any) -> Any:
    """Return the event of a kick."""
    value = TIME if kick.place < 0 else scene.coordinates[kick.place]
    maps = {q.diff(TIME): kick.scale * q.diff(TIME) for q in scene.coordinates}
    return da.Event(value - kick.level, direction=kick.direction, apply=maps, name="kick")
