"""Forces with `acos`, `asin` and `atan2` through the kinks and cuts of these functions."""

import functools

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status

x = dynamicsymbols("x")
FORCES = {
    "acos": (-sp.acos(sp.cos(x)), lambda q: -np.arccos(np.cos(q)), (0.0, np.pi)),
    "asin": (-sp.asin(sp.sin(x)), lambda q: -np.arcsin(np.sin(q)), (0.5 * np.pi, np.pi)),
    "atan2": (-sp.atan2(sp.sin(x), sp.cos(x)), lambda q: -np.arctan2(np.sin(q), np.cos(q)), (np.pi, 2 * np.pi)),
}


@functools.cache
def model(name, backend):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, 1))
    scene.add_loads((P, FORCES[name][0] * N.x))
    return da.compile_model(scene, backend=backend)


@functools.cache
def reference(name, start, speed):
    """Return the state at 5 s by SciPy, stopped where the force has a kink or jumps."""
    _, force, (first, every) = FORCES[name]

    def edge(_, y):
        return np.sin((y[0] - first) * np.pi / every)

    edge.terminal = True
    t, y = 0.0, np.array([start, speed])
    while t < 5.0:
        run = solve_ivp(lambda _, y: [y[1], force(y[0])], (t, 5.0), y, "DOP853", rtol=1e-12, atol=1e-13, events=edge)
        t, y = run.t[-1], run.y[:, -1]
        if t < 5.0:  # past the edge, by a step that leaves it behind
            t, y = t + 1e-9, y + 1e-9 * np.array([y[1], force(y[0] + 1e-9 * y[1])])
    return y


@pytest.mark.parametrize("name", FORCES)
@pytest.mark.parametrize(
    ("backend", "method"),
    [*(("llvm", method) for method in ("auto", "taylor", "dop853", "radau")), ("numpy", "dop853")],
)
def test_motions_through_kinks_and_cuts(name, backend, method):
    for start, speed in ((0.7, 1.0), (0.7, -1.3), (-0.5, 5.0)):
        run = model(name, backend).simulate(
            (0, 5), {x: start, x.diff(): speed}, {}, method=method, rtol=1e-9, atol=1e-11
        )
        assert run.success
        assert run["x"][-1] == pytest.approx(reference(name, start, speed)[0], abs=5e-6), (start, speed)


def test_sweeps_by_taylor_steps():
    starts = {x: np.array([0.7, 0.7, -0.5]), x.diff(): np.array([1.0, -1.3, 5.0])}
    for name in FORCES:
        cases = model(name, "llvm").sweep((0, 5), starts, {}, method="taylor", rtol=1e-9, atol=1e-11)
        expected = [reference(name, *pair)[0] for pair in ((0.7, 1.0), (0.7, -1.3), (-0.5, 5.0))]
        assert cases["x"] == pytest.approx(expected, abs=5e-6)


def test_an_argument_beyond_one_has_a_status():
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("beyond", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, 1))
    scene.add_loads((P, sp.acos(x) * N.x))
    made = da.compile_model(scene)
    for method in ("taylor", "dop853", "radau"):
        run = made.simulate((0, 5), {x: 0.5, x.diff(): 0.0}, {}, method=method)
        assert run.status in (Status.NON_FINITE, Status.STEP_TOO_SMALL) and run["x"][-1] == pytest.approx(1, abs=1e-3)
