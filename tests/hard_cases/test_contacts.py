"""Every motion with contacts goes through the right phases, at the right times, to its reference values."""

from functools import cache

import numpy as np
import pytest

from hard_cases.contacts import CONTACT_CASES, contact_motion


@cache
def run(name):
    motion = contact_motion(name).motion
    return motion.simulate(motion.compile("auto"))


@pytest.mark.parametrize("name", CONTACT_CASES)
def test_phases(name):
    case, result = contact_motion(name), run(name)
    assert result.success, result.message
    assert [dict(phase.modes) for phase in result.phases] == case.modes()
    assert case.transition_error(result) <= case.bound
    assert [phase.t1 for phase in result.phases[:-1]] == [phase.t0 for phase in result.phases[1:]]
    assert result.phases[-1].t1 == case.motion.times()[-1]


@pytest.mark.parametrize("name", CONTACT_CASES)
def test_reference_values(name):
    motion, result = contact_motion(name).motion, run(name)
    assert motion.error(result) <= motion.bound


@pytest.mark.parametrize("name", CONTACT_CASES)
def test_constraints(name):
    assert np.max(np.abs(run(name).constraint_violation), initial=0.0) <= 1e-12
