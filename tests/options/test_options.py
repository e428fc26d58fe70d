"""Options of runs: declared once, checked once, the same as the signatures of the public methods."""

import dataclasses
import inspect
import math

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import OptionError, ValueInputError
from dalembert.model.model import CompiledModel
from dalembert.options import (
    DEFAULT_TOLERANCES,
    PrepareOptions,
    SensitivityOptions,
    SimulateOptions,
    StoreOptions,
    SweepOptions,
)

KINDS = {
    "simulate": SimulateOptions,
    "sweep": SweepOptions,
    "prepare": PrepareOptions,
    "sensitivity": SensitivityOptions,
}


@pytest.mark.parametrize("method", KINDS)
def test_methods_take_the_options_and_their_defaults(method):
    keywords = {
        name: parameter.default
        for name, parameter in inspect.signature(getattr(CompiledModel, method)).parameters.items()
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY
    }
    declared = {
        field.name: inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default
        for field in dataclasses.fields(KINDS[method])
    }
    declared.pop("origin", None)  # no keyword: runs that begin elsewhere than at zero set it
    del declared["fits_atol"]  # no keyword: atol="auto" sets it
    if method == "sweep":
        stored = {field.name: field.default for field in dataclasses.fields(StoreOptions)}
        declared |= {**stored, "to": None}
        del declared["chosen"]  # no keyword: stored sweeps find it
    assert keywords == declared


@pytest.mark.parametrize("kind", KINDS.values())
def test_options_document_what_they_declare(kind):
    documented = "".join(inspect.getdoc(base) or "" for base in kind.__mro__ if dataclasses.is_dataclass(base))
    for field in dataclasses.fields(kind):
        assert field.name in documented, field.name


def test_options_are_frozen_and_hold_numbers():
    options = SimulateOptions(rtol=np.float32(0.5), max_steps=10.0, t_eval=[0, 1], dense=1)
    assert type(options.rtol) is float and type(options.max_steps) is int and options.dense is True
    assert options.t_eval.dtype == float and (options.atol, options.max_step) == (DEFAULT_TOLERANCES[1], math.inf)
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.rtol = 1e-3


def test_times_are_copied():
    times = np.array([0.0, 1.0])
    options = SimulateOptions(t_eval=times)
    times[:] = 7.0
    assert options.t_eval.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    ("kind", "given", "error", "message"),
    [
        (SimulateOptions, {"rtol": "small"}, OptionError, "rtol must be a number"),
        (SimulateOptions, {"atol": -1.0}, OptionError, "atol must be finite and not negative"),
        (SimulateOptions, {"max_steps": 1.5}, OptionError, "max_steps must be a whole number"),
        (SimulateOptions, {"first_step": "long"}, OptionError, "first_step must be a number"),
        (SimulateOptions, {"dense": "yes"}, OptionError, "dense must be True or False"),
        (SimulateOptions, {"t_eval": "now"}, ValueInputError, "t_eval = 'now' is not"),
        (SweepOptions, {"threads": 0}, OptionError, "threads must be at least 1"),
        (SweepOptions, {"threads": 1.5}, OptionError, "threads must be a whole number"),
        (SweepOptions, {"progress": "bar"}, OptionError, "progress must be True or False"),
        (PrepareOptions, {"max_step": None}, OptionError, "max_step must be a number"),
        (SensitivityOptions, {"wrt": ["m"], "rtol": math.nan}, OptionError, "rtol must be finite"),
    ],
)
def test_wrong_options_are_refused_where_they_are_made(kind, given, error, message):
    with pytest.raises(error, match=message):
        kind(**given)


def test_models_do_not_change():
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")
    with pytest.raises(dataclasses.FrozenInstanceError):
        model.engine = None
    with pytest.raises(dataclasses.FrozenInstanceError):
        del model.stages
