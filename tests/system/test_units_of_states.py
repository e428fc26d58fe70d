"""One scene in other units of length, mass and time: the same assembled states and linearisations."""

import functools

import numpy as np
import pytest

import dalembert as da
from scene.scaled import Units
from system.test_units import CASES, UNITS


@functools.cache
def _model(name):
    return da.compile_model(CASES[name][0](), backend="numpy")


def _written(name, units):
    """Return the initial values and the parameters of a case in some units."""
    _, initial, parameters, dimensions, _ = CASES[name]
    given = {key: parameters[key] for key in _model(name).layout.given}
    return units.of(initial, dimensions), units.of(given, dimensions)


def _assembled(name, units):
    """Return what becomes of a rough guess, in ordinary units."""
    model, dimensions, rng = _model(name), CASES[name][3], np.random.default_rng(3)
    rough = {key: value + 0.1 * rng.normal() for key, value in CASES[name][1].items()}
    found = model.assemble(units.of(rough, dimensions), _written(name, units)[1])
    return units.without(found, dimensions)


@pytest.mark.parametrize("name", CASES)
def test_states_are_assembled_alike(name):
    expected = _assembled(name, Units())
    for units in UNITS:
        found = _assembled(name, units)
        np.testing.assert_allclose([*found.values()], [*expected.values()], rtol=1e-12, atol=1e-12, err_msg=str(units))


def _linearized(name, units):
    """Return the states of a linearisation, and its matrix in ordinary units."""
    lin = _model(name).linearize(0.0, *_written(name, units))
    sizes = np.array([*units.of(dict.fromkeys(lin.states, 1.0), CASES[name][3]).values()])
    return lin.states, lin.A * sizes / sizes[:, np.newaxis] * units.time


@pytest.mark.parametrize("name", CASES)
def test_motions_are_linearised_alike(name):
    expected = _linearized(name, Units())
    for units in UNITS:
        found = _linearized(name, units)
        assert found[0] == expected[0], units
        np.testing.assert_allclose(found[1], expected[1], rtol=1e-10, atol=1e-10, err_msg=str(units))
