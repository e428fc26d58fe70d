"""Runs that come to the end of what a root in the positions is defined for: they end, and did so with SUCCESS."""

import numpy as np
import pytest
from sympy import Rational, acos, cos, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from dalembert.runs.coordinate_checks import EndCheck

x, y = dynamicsymbols("x y")
m, g, L, k = symbols("m g L k", positive=True)
P = {m: 1.0, g: 9.81, L: 1.0}
METHODS = ["taylor", "dop853", "tsit5", "radau"]


def bead(position, coordinates=(x,), holonomic=()):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=list(coordinates))
    scene.add_bodies(Particle("bead", O.locatenew("P", position[0] * N.x + position[1] * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(*holonomic)
    return scene


BEYOND = {
    "position": (bead((x, -sqrt(L**2 - x**2))), {x: 0.0, x.diff(): 6.0}, 0.298),
    "constraint": (bead((x, y), (x, y), [y + sqrt(L**2 - x**2)]), {x: 0.0, y: -1.0, x.diff(): 6.0}, 0.298),
    "power": (bead((x ** Rational(1, 3), x)), {x: 0.5, x.diff(): -1.0}, 0.395),
    "inverse": (bead((acos(x), x)), {x: 0.5, x.diff(): 3.0}, 0.312),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scene", BEYOND)
def test_a_motion_beyond_the_end_is_no_success(scene, method):
    """A pendulum, written in its abscissa, that swings above its axis: it stayed there without its energy."""
    source, start, end = BEYOND[scene]
    model, p = (
        da.compile_model(source),
        {name: P[name] for name in P if name != L or scene in ("position", "constraint")},
    )
    for options in ({}, {"t_eval": [0.1, 5.0]}, {"rtol": 1e-6}):
        run = model.simulate((0, 5), start, p, method=method, **options)
        assert run.status is Status.NON_FINITE and (options or run.t[-1] <= end + 0.002), options
    starts = {**start, x.diff(): np.array([1.0, 1.01]) * start[x.diff()]}
    sweep = model.sweep((0, 5), starts, p, method=method)
    assert sweep.status.tolist() == [Status.NON_FINITE] * 2
    assert end - 0.03 < sweep.t[0] <= end + 0.002
    assert model.sweep((0, 0.2), starts, p, method=method).success.all()


def test_the_message_names_the_place_and_the_remedy():
    run = da.compile_model(BEYOND["position"][0]).simulate((0, 5), BEYOND["position"][1], P, method="dop853")
    assert "at t = 0.29" in run.message and "an angle in place of sqrt(L**2 - x**2)" in run.message
    assert np.ptp(run["x"] * 0 + 0.5 * run["x_dot"] ** 2 / (1 - run["x"] ** 2)) > 1.0


@pytest.mark.parametrize("method", METHODS)
def test_motions_next_to_the_end_succeed(method):
    """Within 0.3 degrees of it, at three tolerances; in an angle the motion is the same."""
    N, O, q = ReferenceFrame("N"), Point("O"), dynamicsymbols("q")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[q])
    scene.add_bodies(Particle("bead", O.locatenew("P", L * sin(q) * N.x - L * cos(q) * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    speed = np.sqrt(2 * 9.81) * 0.99999
    exact = da.compile_model(scene).simulate((0, 3), {q: 0.0, q.diff(): speed}, P, rtol=1e-12)
    model = da.compile_model(BEYOND["position"][0])
    for rtol in (1e-8, 1e-10):
        run = model.simulate((0, 3), {x: 0.0, x.diff(): speed}, P, method=method, rtol=rtol, atol=rtol / 100)
        assert run.success and run["x"][-1] == pytest.approx(np.sin(exact["q"][-1]), abs=1e-5)


def test_which_models_are_looked_at():
    """Roots of sums of squares have no end, nor have roots of parameters and of loads."""
    crank = bead((L * cos(x), k * sin(x) + sqrt(L**2 - k**2 * sin(x) ** 2)))
    ladder = bead((x, sqrt((x - L) ** 2 + k**2) * sqrt(L**2 - k**2)))
    power = bead((x, x**k))  # which may be a whole one
    for scene, looked in ((crank, True), (ladder, False), (power, False), (da.scenes.rolling_sphere(), False)):
        assert any(isinstance(check, EndCheck) for check in da.compile_model(scene).checks) is looked
