"""Projection in traced code decides as the compiled loops do."""

import math

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.names import CORRECTIONS
from dalembert.methods.status import Status
from dalembert.methods.step_constants import LINEAR_CHANGE, LINEAR_CORRECTIONS, SMALL_COMPONENT
from dalembert.steps.projection import FAILED, add_correction, correction_test, largest_change

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

from dalembert.jax.runs.step_rules import project  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

ABOVE = 1.0 + 1e-9
TOLERANCES = 1e-6, 1e-8
LARGEST = largest_change(2.0, *TOLERANCES)
POSITIONS = CORRECTIONS["project_position"]


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def decided(y, corrections, before):
    """Return what the rules of the compiled loops make of corrections, all of which are applied."""
    states, held, before = np.array([[y]]), True, np.array([[before]])
    for attempt, correction in enumerate(corrections):
        found = add_correction(states, 0, before, 0, np.array([[correction]]), 0, TOLERANCES[1])
        held &= correction_test(attempt, len(corrections), *found, *TOLERANCES) != FAILED
    return states[0, 0], held


@pytest.mark.parametrize("away", [0.0, 3e-4])
@pytest.mark.parametrize("whole", [False, True], ids=["rows", "one row"])
@pytest.mark.parametrize(
    ("y", "corrections"),
    [
        (1.0, [0.3, 1e-3, 1e-7]),
        (1.0, [5.0, 1e-2, 1e-5]),  # positions may be far away
        (0.0, [1e-2, 1e-3, LINEAR_CHANGE * 0.9 * (1.0 + SMALL_COMPONENT) * 0.011]),
        (0.0, [1e-2, 1e-3, LINEAR_CHANGE * 1.1 * (1.0 + SMALL_COMPONENT) * 0.011]),
        (1.0, [0.3, math.nan, 0.0]),
        (2.0, [LARGEST / ABOVE, 1e-6]),
        (2.0, [LARGEST * ABOVE, 1e-6]),
        (2.0, [1e-3, 3e-4]),
        (2.0, [LARGEST + 1e-4, 1e-6]),  # nearer to the state before where that is 3e-4 away
        (2.0, [1e-3, 1e-4]),
        (0.0, [0.0, 0.0]),
    ],
)
def test_corrections_are_judged_alike(y, corrections, whole, away):
    before = y + away  # the state before the step
    rest = iter(corrections)
    start = (jax.numpy.array([y, y]),) if whole else (jax.numpy.array([y, 1.0]),)
    scalar = 0.0 if whole else jax.numpy.zeros(2)

    def correct(t, y, c):
        step = next(rest)
        return (jax.numpy.array([step, step]) if whole else jax.numpy.array([step, 0.0]),)

    assert len(corrections) in (POSITIONS, LINEAR_CORRECTIONS)
    earlier = (start[0].at[0].set(before),) if not whole else (start[0] + away,)
    (found,), held = project([(correct, len(corrections))], scalar, start, (), earlier, TOLERANCES)
    end, wanted = decided(y, corrections, before)
    assert bool(held if whole else held[0]) == wanted and (whole or bool(held[1]))
    np.testing.assert_array_equal(found[0], end)


@pytest.mark.parametrize("method", ["dopri8", "tsit5"])
def test_steps_whose_ends_cannot_be_projected_are_repeated(method):
    """At loose tolerances, as the compiled loops repeat them."""
    frame, origin = ReferenceFrame("N"), Point("O")
    origin.set_vel(frame, 0)
    (x, y), (m, l, g) = dynamicsymbols("x y"), symbols("m l g", positive=True)
    scene = da.Scene("pendulum", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("bob", origin.locatenew("P", x * frame.x + y * frame.y), m))
    scene.apply_uniform_gravity(-g * frame.y)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    model = da.compile_model(scene, backend="jax", formulation="projected")
    parameters = {"m": 1.0, "l": 1.0, "g": 9.81}
    p = model.parameter_vector(parameters)
    starts = [{"x": 1.0, "y": 0.0, "x_dot": 0.0, "y_dot": float(speed)} for speed in np.linspace(1.0, 40.0, 30)]
    rows = np.stack([model.state(start, parameters) for start in starts])
    solve = model.solve_fn(method=method, rtol=0.03, atol=0.03, portable=True)
    found = jax.jit(jax.vmap(lambda y: solve(np.array([0.0, 1.0]), y, p)))(rows)
    assert np.all(found.status == Status.SUCCESS) and np.sum(found.rejected) > 0
    ends = dict(zip(model.layout.state, np.asarray(found.y[:, -1]).T, strict=True))
    np.testing.assert_allclose(np.hypot(ends["x"], ends["y"]), 1.0, rtol=1e-8)
