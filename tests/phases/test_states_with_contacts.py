"""First-order states in scenes with contacts: they go on through impacts, and drive belts."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import SceneError

t = dynamicsymbols._t
x, y, F, e, v = dynamicsymbols("x y F e v")
m, g, k, tau, mu, r, V = sp.symbols("m g k tau mu r V", positive=True)
SPAN = (0.0, 1.0)
START = {x: 0, y: 1, "x_dot": 0, "y_dot": 0, F: 0.3, e: 0.2}
VALUES = {m: 1, g: 9.81, k: 8.0, tau: 0.3, mu: 0.4, r: 0.5}
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
_MADE = {}


def particle(name):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("P", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    n, f = da.unknowns("n f")
    scene.add_joints(da.Joint("ground", body="P", at=P, force=n * N.y + f * N.x))
    return scene, N, P, n, f


def hopper(backend="llvm"):
    if backend not in _MADE:
        scene, N, P, n, f = particle("hopper")
        scene.add_contacts(da.UnilateralContact(normal=n, gap=y, restitution=r))
        scene.add_friction(da.CoulombFriction(normal=n, tangential=f, mu=mu))
        scene.add_states({F: (k * sp.sin(3 * t) - F) / tau, e: y - e + y.diff() / 5})
        scene.add_loads((P, F * N.x))
        _MADE[backend] = da.compile_model(scene, backend=backend, outputs=["n", F * y])
    return _MADE[backend]


def flight(restitution, times):
    """Return y, F and e at times of a ball that is stopped by SciPy at each impact."""

    def right(s, z):
        return [z[1], -9.81, (8 * np.sin(3 * s) - z[2]) / 0.3, z[0] - z[3] + z[1] / 5]

    def hit(s, z):
        return z[0]

    hit.terminal, hit.direction = True, -1
    state, now, found = np.array([1.0, 0.0, 0.3, 0.2]), 0.0, []
    while now < times[-1]:
        run = solve_ivp(right, (now, times[-1]), state, "DOP853", rtol=1e-13, atol=1e-15, events=hit, dense_output=True)
        found += [run.sol(s) for s in times if now <= s < run.t[-1] or s == run.t[-1] == times[-1]]
        now, state = run.t[-1], run.y[:, -1].copy()
        state[0], state[1] = 0.0, -restitution * state[1]
    return np.array(found)[:, [0, 2, 3]]


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_states_go_on_through_impacts(backend):
    times = np.linspace(*SPAN, 13)
    run = hopper(backend).simulate(SPAN, START, VALUES, t_eval=times, **TIGHT)
    expected = flight(0.5, times)
    for i, name in enumerate("yFe"):
        np.testing.assert_allclose(run[name], expected[:, i], atol=1e-9, err_msg=name)
    assert len(run.phases) > 2 and run.y.shape == (13, 6)
    np.testing.assert_allclose(run["F_dot"], (8 * np.sin(3 * times) - run["F"]) / 0.3, atol=1e-11)
    np.testing.assert_allclose(run[F * y], run["F"] * run["y"], atol=1e-13)
    np.testing.assert_array_equal(run.to_xarray()["e"], run["e"])


def test_sweeps_and_prepared_runs_have_them():
    model, times = hopper(), np.linspace(*SPAN, 4)
    values = {**VALUES, r: np.array([0.6, 0.5])}
    sweep = model.sweep(SPAN, START, values, t_eval=times, **TIGHT)
    for i, restitution in enumerate((0.6, 0.5)):
        expected = flight(restitution, times)
        for j, name in enumerate("yFe"):
            np.testing.assert_allclose(sweep[name][i], expected[:, j], atol=1e-9)
    np.testing.assert_allclose(sweep["F_dot"], (8 * np.sin(3 * times) - sweep["F"]) / 0.3, atol=1e-10)
    run = model.prepare(SPAN, **TIGHT)
    final = run(model.state(START, VALUES), model.parameter_vector(VALUES))
    np.testing.assert_allclose(final[4:], expected[-1, 1:], atol=1e-9)
    assert set(model.layout.states) <= set(sweep.final)


def test_events_watch_and_jump_them():
    jump = da.Event(t - sp.Rational(1, 2), name="kick", apply={F: F + 1})
    watch = da.Event("e_dot", name="turn", terminal=False)
    for run in (
        hopper().simulate(SPAN, START, VALUES, events=[jump, watch], **TIGHT),
        hopper().sweep(SPAN, START, VALUES, events=[jump, watch], **TIGHT),
    ):
        plain = flight(0.5, np.array([0.0, 1.0]))[-1, 1]
        np.testing.assert_allclose(run["F"][-1], plain + np.exp(-0.5 / 0.3), atol=1e-9)


def test_evaluation_and_linearisation():
    model = hopper()
    a = model.accelerations(0, [0.0, 1.0], [0.0, 0.0], VALUES, states={F: 2.0, e: 0.0})
    np.testing.assert_allclose(a, [2.0, -9.81])
    assert model.linearize(0.0, START, VALUES).states[-2:] == ("F", "e")


def test_a_block_sticks_to_a_belt_whose_speed_is_a_state():
    scene, _, _, n, f = particle("belt")
    scene.add_holonomic_constraints(y)
    scene.add_friction(da.CoulombFriction(normal=n, tangential=f, slip=x.diff() - v, mu=mu))
    scene.add_states({v: (V - v) / tau})
    model = da.compile_model(scene, outputs=["f"])
    start = {x: 0, y: 0, "x_dot": 0, "y_dot": 0, v: 0}
    sticking = {m: 2, g: 9.81, mu: 0.5, V: 1.0, tau: 0.4}
    times = np.linspace(0, 1, 5)
    run = model.simulate((0, 1), start, sticking, t_eval=times, **TIGHT)
    speed = 1 - np.exp(-times / 0.4)
    np.testing.assert_allclose(run["x_dot"], speed, atol=1e-10)
    np.testing.assert_allclose(run["f"], 2 * (1 - speed) / 0.4, atol=1e-9)
    np.testing.assert_allclose(run["x"], times - 0.4 * speed, atol=1e-10)
    slow = model.simulate((0, 3), start, {**sticking, mu: 0.05}, **TIGHT)
    assert [phase.modes["n"] for phase in slow.phases] == ["slip", "stick"]
    caught = slow.phases[0].t1
    np.testing.assert_allclose(0.05 * 9.81 * caught, 1 - np.exp(-caught / 0.4), rtol=1e-9)


def test_a_gap_that_depends_on_a_state_is_refused():
    scene, _, _, n, _ = particle("wrong")
    scene.add_contacts(da.UnilateralContact(normal=n, gap=y - F))
    scene.add_states({F: -F})
    with pytest.raises(SceneError, match="gap of contact 'n': it depends on the first-order states F"):
        da.compile_model(scene)
