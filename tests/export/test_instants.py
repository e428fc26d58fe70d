"""Instants that exports list two at a time are those that runs list as a whole."""

from types import SimpleNamespace

import numpy as np
import pytest

from dalembert.runs.sampling import Sampling
from dalembert.stops.input_records import no_inputs
from dalembert.stops.instants import instants_of, list_instants, stops_at_instants
from dalembert.subset.arguments import NO_CODE


def listed(schedule, t0, ends):
    """Return times and acts of a run that ends and continues at some times."""
    count = len(schedule) // 2
    instants = instants_of(NO_CODE, count)
    stops = stops_at_instants([[0]] * count, [NO_CODE] * count, no_inputs())
    instants.schedule[:, 0], instants.clock.origin = schedule, t0
    found = []
    for t1 in ends:
        list_instants(instants, stops, t1, False)
        while stops.next[0] < stops.until[0]:
            found.append((stops.times[stops.next[0]], stops.acts[stops.next[0]]))
            stops.next[0] += 1
            list_instants(instants, stops, t1, False)
    return np.transpose(found) if found else np.zeros((2, 0))


SCHEDULES = [
    [0.1, 0.0],
    [0.1, 0.3, 0.0, 0.0],
    [0.1, 0.07, 0.3, 0.35, 0.0, 0.1],
    [1e-3, 1 / 3, 0.0, 2 / 3],
    [5.0, 7.0, 0.0, 3.0],
    [0.1, 0.1, 1e-18, 0.0],
]


@pytest.mark.parametrize("schedule", SCHEDULES)
@pytest.mark.parametrize(("t0", "t1"), [(0.0, 3.0), (0.0, 2.1), (-1.0, 1.0), (2.0, 2.0), (10.0, 10.7)])
def test_instants_are_those_of_runs(schedule, t0, t1):
    count = len(schedule) // 2
    actions = [SimpleNamespace(name=str(number)) for number in range(count)]
    sampling = Sampling(None, SimpleNamespace(actions=actions), None)
    times, acts = sampling.instants(np.array(schedule), t0, t1)
    found = listed(schedule, t0, [t1])
    np.testing.assert_array_equal(found, [times, acts])
    assert len(times) > 0
    middle = t0 + 0.5 * (t1 - t0)
    np.testing.assert_allclose(listed(schedule, t0, [middle, t1]), found, rtol=1e-15, atol=1e-16)
