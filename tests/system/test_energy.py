"""Ideal joints do no work: the energy of the ready scenes is constant."""

import numpy as np
import pytest

import dalembert as da
from oracles.cases import CASES, SLEIGH_CASES

FORMULATIONS = ("minimal", "projected")


def simulate(case, backend, formulation):
    model = da.compile_model(da.scenes.ALL[case.scene](), backend=backend, formulation=formulation)
    traj = model.simulate((0, 10), case.initial, case.parameters, rtol=1e-12, atol=1e-14)
    assert traj.success, traj.message
    return traj


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("backend", ["numpy", "llvm"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_energy_is_constant(case, backend, formulation):
    energy = simulate(case, backend, formulation)["energy"]
    assert np.abs(energy - energy[0]).max() < 1e-10 * energy[0]


@pytest.mark.parametrize("case", SLEIGH_CASES, ids=lambda case: case.name)
def test_energy_of_the_sleigh_is_its_kinetic_energy(case):
    """With the velocity of C along the blade, 2 T = m v^2 + I_C omega^2."""
    start, p = case.exact(0), case.parameters
    expected = (p["m"] * float(start.v) ** 2 + p["I_C"] * float(start.omega) ** 2) / 2
    np.testing.assert_allclose(simulate(case, "llvm", "minimal")["energy"], expected, rtol=1e-10)
