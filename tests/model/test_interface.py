"""Public methods of models: signatures, docstrings and options agree, and models have them all."""

import inspect
import re
from dataclasses import fields

import pytest

from dalembert.model import derivatives, evaluation, motions, states, sweeps, traced
from dalembert.model.model import CompiledModel
from dalembert.options import (
    TRACED_MAX_STEPS,
    PrepareOptions,
    SensitivityOptions,
    SimulateOptions,
    StoreOptions,
    SweepOptions,
    TrimOptions,
)

MODULES = (derivatives, evaluation, motions, states, sweeps, traced)
FUNCTIONS = {
    name: value
    for module in MODULES
    for name, value in inspect.getmembers(module, inspect.isfunction)
    if value.__module__ == module.__name__ and name[0] != "_"
}
LONG = [name for name, function in FUNCTIONS.items() if "Parameters\n" in inspect.getdoc(function)]
OPTIONS = {
    "simulate": (SimulateOptions,),
    "sweep": (SweepOptions, StoreOptions),
    "prepare": (PrepareOptions,),
    "sensitivity": (SensitivityOptions,),
    "trim": (TrimOptions,),
}


def _keywords(function):
    return {p.name for p in inspect.signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY}


@pytest.mark.parametrize("name", LONG)
def test_docstrings_name_every_parameter_and_no_other(name):
    text = inspect.getdoc(FUNCTIONS[name])
    section = text.split("Parameters\n----------\n")[1].split("\n\n")[0]
    heads = [line.split(" :")[0] for line in section.splitlines() if not line.startswith(" ")]
    listed = [each for head in heads for each in head.split(", ")]
    assert sorted(listed) == sorted(set(inspect.signature(FUNCTIONS[name]).parameters) - {"self"})


@pytest.mark.parametrize("name", OPTIONS)
def test_keywords_are_options_with_the_same_defaults(name):
    known = {field.name: field for options in OPTIONS[name] for field in fields(options)}
    signature = inspect.signature(FUNCTIONS[name]).parameters
    assert _keywords(FUNCTIONS[name]) - known.keys() <= {"inputs"}
    for key in _keywords(FUNCTIONS[name]) & known.keys() - {"wrt", "to"}:
        assert signature[key].default == known[key].default, key


def test_traced_runs_take_fewer_steps_by_default():
    assert inspect.signature(traced.solve_fn).parameters["max_steps"].default == TRACED_MAX_STEPS


def test_every_function_is_a_method_of_models():
    for name, function in FUNCTIONS.items():
        assert getattr(CompiledModel, name) is function


def test_docstrings_of_shared_motions_say_what_contacts_change():
    for name in ("simulate", "sweep", "prepare", "linearize", "trim"):
        assert re.search(r"\bcontacts\b", inspect.getdoc(FUNCTIONS[name])), name
