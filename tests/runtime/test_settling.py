"""Contacts are settled by kernels as they are by linear systems."""

import numpy as np
import pytest
import sympy as sp

import dalembert as da
from dalembert.mechanics.equations import Watchpoint
from dalembert.methods.status import Status
from dalembert.runtime.hybrid.instants import Instants
from hard_cases.contacts import corner_plate, loose_plate

MU = sp.Symbol("mu", positive=True)
CASES = 200
SCENES = {
    "stops": (lambda: corner_plate(7), ("slip",), [Watchpoint("", 0, "stop")]),
    "breaks": (lambda: corner_plate(7), ("stick",), [Watchpoint("", 0, "break", 1)]),
    "turns": (lambda: corner_plate(7), ("slip",), [Watchpoint("", 0, "turn")]),
    "lifts": (lambda: corner_plate(7, contact=True), ("slip",), [Watchpoint("", 0, "lift")]),
    "one of two lifts": (lambda: loose_plate(3, corner=MU), ("closed", "slip"), [Watchpoint("", 0, "lift")]),
    "one of two stops": (lambda: loose_plate(3, corner=MU), ("closed", "slip"), [Watchpoint("", 1, "stop")]),
}


def settled_both_ways(laws, now, mode, fired):
    """Return what kernels and linear systems say, and the cases of which the first are sure and that go on."""
    quick, sure = laws._begun(now) if mode is None else laws._quickly(now, mode, fired)
    slow = laws._slowly(now, mode, fired)
    np.testing.assert_array_equal(quick.status[sure], slow.status[sure])
    good = np.flatnonzero(sure & (slow.status == Status.SUCCESS))
    assert [quick.table[i] for i in quick.mode[good]] == [slow.table[i] for i in slow.mode[good]]
    for field in ("x", "directions", "sides", "speeds"):
        np.testing.assert_allclose(getattr(quick, field)[good], getattr(slow, field)[good], rtol=1e-12, atol=1e-12)
    return quick, slow, good


def test_kernels_begin_as_linear_systems_do():
    """From rest, in motion, and with a coefficient that makes no sense."""
    model = da.compile_model(corner_plate(7), backend="numpy")
    laws, rng = model._modes.laws, np.random.default_rng(8)
    theta = rng.uniform(0.3, 1.2, CASES)
    rate = np.where(np.arange(CASES) % 3, rng.normal(size=CASES), 0.0)
    x = np.column_stack([-0.5 / np.tan(theta), theta, 0.5 * rate / np.sin(theta) ** 2, rate])
    mu = rng.uniform(0.1, 1.0, CASES)
    mu[5] = -0.1
    values = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81, "mu": mu}
    p = np.column_stack([np.broadcast_to(values[n], CASES) for n in model.layout.parameters])
    quick, slow, good = settled_both_ways(laws, Instants.starting(np.zeros(CASES), x, p, 1), None, [])
    assert len(good) > CASES / 2 and {quick.table[i] for i in quick.mode[good]} == {("slip",), ("stick",)}
    assert quick.status[5] == slow.status[5] == Status.INITIAL_STATE


@pytest.mark.parametrize("name", SCENES)
def test_kernels_decide_as_linear_systems_do(name):
    scene, mode, fired = SCENES[name]
    model = da.compile_model(scene(), backend="numpy")
    laws, layout, rng = model._modes.laws, model.layout, np.random.default_rng(7)
    theta, rate = rng.uniform(0.3, 1.2, CASES), rng.normal(size=CASES)
    if any(point.kind in ("stop", "break") for point in fired):
        rate = 0.0 * rate
    given = {"x": -0.5 / np.tan(theta), "y": 0 * theta, "theta": theta, "theta_dot": rate, "y_dot": 0 * theta}
    given["x_dot"] = 0.5 * rate / np.sin(theta) ** 2
    x = np.column_stack([given[n] for n in (*layout.coordinates, *layout.rates)])
    values = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81, "mu": rng.uniform(0.1, 1.0, CASES)}
    p = np.column_stack([np.broadcast_to(values[n], CASES) for n in layout.parameters])
    now = Instants.starting(np.zeros(CASES), x, p, len(mode))
    _, _, good = settled_both_ways(laws, now, mode, fired)
    assert len(good) > CASES / 10  # not every state is one in which this can happen
