"""The Whipple bicycle: accelerations of the full model, and eigenvalues of its upright motion."""

import numpy as np
import pytest

import dalembert as da
from hard_cases.case import reference
from hard_cases.machines import (
    COORDINATES,
    bicycle_eigenvalues,
    bicycle_linearized,
    bicycle_parameters,
    bicycle_scene,
    upright_bicycle,
)

SPEEDS = (0, 4, 7, 10)
WEAVE, CAPSIZE, DOUBLE = 4.29238253634111, 6.02426201538837, 0.68428307889246
"""Speeds between which the bicycle is stable, and at which two eigenvalues meet (Meijaard et al., 2007)."""


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


def test_critical_speeds(bicycle):
    """Weave, with an oscillation, and capsize begin where an eigenvalue has no real part; elsewhere two are one."""
    weave, capsize, double = (np.sort_complex(bicycle_linearized(bicycle, v)) for v in (WEAVE, CAPSIZE, DOUBLE))
    assert np.max(np.abs(weave[-2:].real)) < 1e-12 and abs(weave[-1].imag) > 3
    assert abs(capsize[-1]) < 1e-12
    assert abs(double[-1] - double[-2]) < 1e-6  # the root of what 15 digits of the speed leave


@pytest.fixture(scope="module")
def motions():
    """Return the motion from upright at 4.6 m/s, falling to one side at 0.5 rad/s, by formulation."""
    start, p = upright_bicycle(4.6) | {"psi_dot": -0.5}, bicycle_parameters()
    found = {}
    for formulation, method, rtol in (
        ("projected", "dop853", 1e-11),
        ("ggl", "radau", 1e-9),
        ("augmented", "dop853", 1e-11),
    ):
        model = da.compile_model(bicycle_scene(), formulation=formulation)
        found[formulation] = model.simulate(
            (0, 1), start, p, method=method, rtol=rtol, atol=rtol / 10, t_eval=[0, 0.5, 1]
        )
    return found


def test_motion_of_the_full_model(motions):
    """Steer catches the fall: the bicycle leans by 6 degrees at 0.5 s, and is past upright at 1 s."""
    lean = np.pi / 2 - motions["projected"]["psi"]
    assert motions["projected"].success
    assert 0.05 < lean[1] < 0.15 and -0.1 < lean[2] < 0.0
    assert np.ptp(motions["projected"]["energy"]) < 1e-12 * motions["projected"]["energy"][0]
    assert np.max(np.abs(motions["projected"].constraint_violation)) < 1e-13


@pytest.mark.parametrize("formulation", ["ggl", "augmented"])
def test_formulations_agree(motions, formulation):
    for name in ("q", "qdot"):
        gap = np.abs(getattr(motions[formulation], name) - getattr(motions["projected"], name))
        assert np.max(gap) < 1e-9
