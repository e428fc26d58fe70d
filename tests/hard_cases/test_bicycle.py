"""The Whipple bicycle: accelerations of the full model, and eigenvalues of its upright motion."""

import numpy as np
import pytest

import dalembert as da
from hard_cases.case import reference
from hard_cases.machines import COORDINATES, bicycle_eigenvalues, bicycle_parameters, bicycle_scene

SPEEDS = range(11)


@pytest.fixture(scope="module")
def bicycle():
    return da.compile_model(bicycle_scene(), backend="numpy", formulation="projected")


def test_accelerations(bicycle):
    """The state is printed with 13 digits, and taken as it stands."""
    entry = reference("basu_mandal_nonlinear_bicycle")
    given = {key: float(value) for key, value in entry["initial_conditions"].items()}
    q = np.array([given[name] for name in COORDINATES])
    qdot = np.array([given[f"{name}d"] for name in COORDINATES])
    expected = [float(entry["values"]["table1_own_20_digits"][f"{name}dd"]) for name in COORDINATES]
    found = bicycle.accelerations(0.0, q, qdot, bicycle_parameters())
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-13)


@pytest.mark.parametrize("speed", SPEEDS)
def test_eigenvalues(bicycle, speed):
    """Linearised by differences of fourth order, good to some 1e-9."""
    table = reference("whipple_bicycle_eigenvalues")["values"]["table"][str(speed)]["mine"]
    expected = np.sort_complex([complex(float(a), float(b)) for a, b in table])
    found = np.sort_complex(bicycle_eigenvalues(bicycle, float(speed)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)
