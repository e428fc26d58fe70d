"""Coulomb friction and contacts: what the set-valued law must give, against closed forms and hand-written equations."""

import contextlib
import math
import pickle
from functools import cache

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from dalembert.phases import given_values as hybrid_sweep
from dalembert.phases import host_runners, phases, runner_choice
from hard_cases.contact_case import contact_reference
from hard_cases.contacts import corner_plate, incline_scene, loose_plate, table_oscillator
from oracles.friction_rod import Rod

pytestmark = pytest.mark.usefixtures("quick_xla")

TIME = dynamicsymbols._t
PLATE = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81}
FORCE = 4 + 7 * sp.sin(3 * TIME)
TIGHT = {"rtol": 1e-14, "atol": 1e-16}
ROD = {"m": 1.0, "l": 1.0, "g": 9.81}


def at_angle(theta, h=0.5, omega=0.0):
    return {"x": -h / math.tan(theta), "theta": theta, "theta_dot": omega}


@cache
def plate_model(force=0, backend="llvm", contact=False):
    if backend == "jax":
        pytest.importorskip("diffrax")
    return da.compile_model(corner_plate(force, contact=contact), backend=backend, outputs=["N_Q", "F_Q"])


@cache
def ready(name, *outputs, backend="llvm"):
    return da.compile_model(getattr(da.scenes, name)(), backend=backend, outputs=list(outputs))


def modes(run):
    return [dict(phase.modes) for phase in run.phases]


def begins(run):
    return [phase.t0 for phase in run.phases]


# -- the plate on a corner ----------------------------------------------------------------------


def test_without_friction_energy_gives_the_time():
    """dt = dtheta / omega(theta) with omega from the energy, T = inertia(theta) omega^2 / 2."""
    l, h, g = 1, mp.mpf("0.8"), mp.mpf("9.81")
    run = plate_model().simulate((0, 0.6), at_angle(0.9, 0.8, -0.5), {**PLATE, "h": 0.8, "mu": 0.0}, **TIGHT)
    assert modes(run) == [{"corner": "slip"}]
    assert np.max(np.abs(run["F_Q"])) == 0.0

    def inertia(th):
        pull = h / mp.sin(th) ** 2
        return pull**2 - 2 * l * pull * mp.sin(th) + mp.mpf(4) / 3 * l**2

    with mp.workdps(25):
        first = mp.mpf(0.9)
        energy = inertia(first) / 8 + g * l * mp.sin(first)
        end = mp.mpf(float(run["theta"][-1]))

        def slowness(th):
            return mp.sqrt(inertia(th) / (2 * (energy - g * l * mp.sin(th))))

        assert abs(mp.quad(slowness, mp.linspace(end, first, 5)) - mp.mpf(0.6)) < 1e-13


def test_energy_lost_is_the_work_of_friction():
    """Over eight slips, by Gauss quadrature within each phase; the push's work counts too."""
    run = plate_model(FORCE).simulate((0, 8), at_angle(0.5), {**PLATE, "mu": 0.8}, **TIGHT)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    lost = pushed = 0.0
    for phase in run.phases:
        edges = np.linspace(phase.t0, phase.t1, 2 + int((phase.t1 - phase.t0) / 0.02))
        half = np.diff(edges)[:, None] / 2
        motion = run((edges[:-1, None] + half + half * nodes).ravel())
        slip = motion["x_dot"] * np.cos(motion["theta"])
        lost += np.sum((motion["F_Q"] * slip).reshape(len(half), -1) @ weights * half[:, 0])
        pushed += np.sum(
            ((4 + 7 * np.sin(3 * motion.t)) * motion["x_dot"]).reshape(len(half), -1) @ weights * half[:, 0]
        )
    assert lost < -8
    assert abs(run["energy"][-1] - run["energy"][0] - pushed - lost) < 1e-10 * abs(lost)


def test_friction_opposes_slip_and_obeys_its_bounds():
    run = plate_model(FORCE).simulate((0, 8), at_angle(0.5), {**PLATE, "mu": 0.8}, **TIGHT)
    slip = run["x_dot"] * np.cos(run["theta"])
    assert np.all(run["F_Q"] * slip <= 1e-13)  # where a phase ends, the slip is rounding
    assert np.all(run["N_Q"] > 0.0)
    assert np.all(np.abs(run["F_Q"]) <= 0.8 * run["N_Q"] * (1 + 1e-12))
    sliding = run.mode("corner") == "slip"
    assert sliding.any() and not sliding.all()
    np.testing.assert_allclose(np.abs(run["F_Q"])[sliding], 0.8 * run["N_Q"][sliding], rtol=1e-12)


@pytest.mark.parametrize("force", [sp.Integer(4), 4 + 2 * sp.sin(TIME)], ids=["constant", "of time"])
def test_stuck_means_still(force):
    run = plate_model(force).simulate((0, 1e4), at_angle(0.5), {**PLATE, "mu": 0.8})
    assert modes(run) == [{"corner": "stick"}]
    assert np.max(np.abs(run.q - run.q[0])) < 1e-13
    assert np.max(np.abs(run.qdot)) < 1e-13


def test_slip_begins_where_statics_say():
    """At rest N_Q = m g l cos sin / h, and F_A - N_Q sin = mu N_Q at the onset."""
    run = plate_model(4 + TIME).simulate((0, 9), at_angle(0.4), {**PLATE, "mu": 0.8}, **TIGHT)
    s, c = math.sin(0.4), math.cos(0.4)
    normal = 9.81 * c * s / 0.5
    assert modes(run)[0] == {"corner": "stick"}
    assert run.phases[0].t1 == pytest.approx(normal * (s + 0.8 * c) - 4, abs=1e-12)


def test_angles_at_which_contacts_open():
    corner = contact_reference("plate_upright")
    model = da.compile_model(corner_plate(4, contact=True), outputs=["N_Q"])
    run = model.simulate((0, 0.25), at_angle(1.3, 0.8, 2.0), {**PLATE, "h": 0.8, "mu": 0.2}, **TIGHT)
    assert run.phases[-1].modes == {"corner": "open"}
    angle = run([run.phases[-1].t0])["theta"][0]
    assert abs(angle - float(corner["rows"][1]["state"][1])) < 1e-11

    ground = contact_reference("plate_lifts")
    model = da.compile_model(loose_plate(20, corner=sp.Symbol("mu", positive=True)), outputs=["N_A"])
    start = {**at_angle(1.0, 0.8), "y": 0.0, "x_dot": 0.0, "y_dot": 0.0}
    run = model.simulate((0, 0.16), start, {**PLATE, "h": 0.8, "mu": 0.2}, **TIGHT)
    assert modes(run) == [{"ground": "closed", "corner": "slip"}, {"ground": "open", "corner": "slip"}]
    motion = run([run.phases[-1].t0, 0.16])
    assert abs(motion["theta"][0] - float(ground["rows"][1]["state"][0])) < 1e-11
    assert abs(motion["y"][0]) < 1e-14 < 1e-6 < motion["y"][1]


# -- the rod: Painleve's paradoxes ----------------------------------------------------------------


def rod_run(mu, theta, omega, end=1e-3):
    start = {"x": 0.0, "y": 0.0, "theta": theta, "x_dot": -1.0, "y_dot": 0.0, "theta_dot": omega}
    return ready("sliding_rod", "N").simulate((0, end), start, {**ROD, "mu": mu}, rtol=1e-10)


@pytest.mark.parametrize("excess, status", [(-1e-9, Status.SUCCESS), (1e-9, Status.CONTACT_IMPOSSIBLE)])
def test_critical_friction_of_the_rod(excess, status):
    """p vanishes first for mu = 4/3, at tan(theta) = 2."""
    assert rod_run(4 / 3 + excess, math.atan(2), 0.0).status is status


def test_paradoxes_of_the_rod_where_theory_has_them():
    """N = -b/p while the rod slides: none satisfies the contact for p < 0, b < 0, and two motions do for p < 0 < b."""
    seen = set()
    for mu in (1.2, 1.5, 2.5):
        rod = Rod(1, 1, mp.mpf(mu), mp.mpf(9.81))
        for theta in np.linspace(0.2, 1.5, 8):
            for omega in (0.0, 2.5, 4.5):
                p, b = (float(x) for x in rod.contact(theta, omega, -1))
                run = rod_run(mu, theta, omega, 1e-6)
                expected = Status.SUCCESS
                if p < 0:
                    expected = Status.CONTACT_IMPOSSIBLE if b < 0 else Status.CONTACT_AMBIGUOUS
                elif b > 0:
                    assert run.phases[-1].modes == {"ground": "open"}
                assert run.status is expected, (mu, theta, omega)
                assert not run.success or mu < 4 / 3 or p > 0
                seen.add(expected)
    assert seen == {Status.SUCCESS, Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS}


def test_a_paradox_is_named_with_its_configuration():
    run = rod_run(2.0, 1.3, 0.0)
    assert "Painleve" in run.message
    assert "theta = 1.3" in run.message and "x_dot = -1" in run.message


# -- balls ----------------------------------------------------------------------------------------


def rough_sphere():
    """Return the sphere of example 13.4.3 that may slip: without its constraints of rolling, and with its height."""
    scene = da.scenes.rolling_sphere()
    scene.nonholonomic_constraints = ()
    scene = scene.release(dynamicsymbols("z"), scene.bodies[0].masscenter, scene.frame.z)
    F_u, F_v, N = da.unknowns("F_u F_v N")
    scene.add_friction(da.CoulombFriction(N, (F_u, F_v), mu=sp.Symbol("mu"), name="ground"))
    return scene


def test_a_sphere_starts_sliding_and_ends_rolling():
    """A sphere that does not turn rolls after 2 v0 / (7 mu g), at 5/7 of its speed; friction then vanishes."""
    model = da.compile_model(rough_sphere(), outputs=["F_u", "F_v"])
    start = {"x": 0, "y": 0, "z": 0.5, "psi": 0.1, "theta": 1.0, "phi": 0.0, "x_dot": 1.2, "y_dot": 0.5, "z_dot": 0.0}
    start |= {"psi_dot": 0.0, "theta_dot": 0.0, "phi_dot": 0.0}
    run = model.simulate((0, 1), start, {"m": 1, "r": 0.5, "g": 9.81, "mu": 0.3}, **TIGHT)
    assert modes(run) == [{"ground": "slip"}, {"ground": "stick"}]
    roll = 2 * 1.3 / (7 * 0.3 * 9.81)
    assert abs(run.phases[1].t0 - roll) < 1e-10
    np.testing.assert_allclose([run["x_dot"][-1], run["y_dot"][-1]], [6 / 7, 2.5 / 7], atol=1e-10)
    rolling = run(np.linspace(roll + 1e-6, 1, 5))
    assert np.max(np.abs([rolling["F_u"], rolling["F_v"]])) < 1e-9


@pytest.mark.parametrize("velocity, omega", [((1.0, 0.0), (0, 0, 0)), ((0.3, -2.0), (-50, 10, 4)), ((0, 0), (9, 9, 0))])
def test_times_at_which_billiard_balls_roll(velocity, omega):
    r, mu = 0.03, 0.2
    start = {"x": 0, "y": 0, "z": r, "x_dot": velocity[0], "y_dot": velocity[1], "z_dot": 0, "e0": 1, "e1": 0, "e2": 0}
    start |= {"e3": 0, "e0_dot": 0, **{f"e{i + 1}_dot": w / 2 for i, w in enumerate(omega)}}
    slip = math.hypot(velocity[0] - r * omega[1], velocity[1] + r * omega[0])
    run = ready("billiard_ball").simulate((0, 1), start, {"m": 1, "r": r, "mu": mu, "g": 9.81}, **TIGHT)
    assert modes(run) == [{"table": "slip"}, {"table": "stick"}]
    assert abs(run.phases[1].t0 - 2 * slip / (7 * mu * 9.81)) < 1e-11
    end = [run["x_dot"][-1], run["y_dot"][-1]]
    np.testing.assert_allclose(
        end, [(5 * velocity[0] + 2 * r * omega[1]) / 7, (5 * velocity[1] - 2 * r * omega[0]) / 7], atol=1e-11
    )


@pytest.mark.parametrize("e", [0.2, 0.5, 0.9])
def test_bounces_accumulate(e):
    """Impacts at t_1 (1 + 2 e (1 - e^n) / (1 - e)), which accumulate at t_1 (1 + e) / (1 - e): then the ball rests."""
    start = {"x": 0.0, "y": 1.0, "x_dot": 1.0, "y_dot": 0.0}
    fall = math.sqrt(2 / 9.81)
    run = ready("bouncing_ball").simulate((0, 20), start, {"m": 1, "e": e, "g": 9.81}, **TIGHT)
    assert run.success and modes(run)[-1] == {"ground": "closed"} and run["y"][-1] == pytest.approx(0.0, abs=1e-12)
    assert abs(run.phases[-1].t0 - fall * (1 + e) / (1 - e)) < 1e-6
    impacts = np.array(begins(run)[1:])
    exact = fall * (1 + 2 * e * (1 - e ** np.arange(len(impacts))) / (1 - e))
    assert len(impacts) >= 8
    np.testing.assert_allclose(impacts, exact, rtol=0, atol=1e-12)


def test_without_restitution_the_ball_stays():
    start = {"x": 0.0, "y": 1.0, "x_dot": 1.0, "y_dot": 0.0}
    model = ready("bouncing_ball", "N")
    run = model.simulate((0, 2), start, {"m": 2, "e": 0.0, "g": 9.81}, t_eval=[0.4, 1.0, 2.0], **TIGHT)
    assert modes(run) == [{"ground": "open"}, {"ground": "closed"}]
    assert abs(run.phases[1].t0 - math.sqrt(2 / 9.81)) < 1e-14
    np.testing.assert_allclose(run["N"], [0.0, 2 * 9.81, 2 * 9.81], atol=1e-12)
    np.testing.assert_array_equal(run["y"][1:], 0.0)


# -- the thresholds of statics --------------------------------------------------------------------


@pytest.mark.parametrize("excess, mode", [(1e-13, "stick"), (-1e-13, "slip")])
def test_block_at_the_critical_slope(excess, mode):
    model = da.compile_model(incline_scene())
    p = {"m": 1, "alpha": 0.5, "g": 9.81, "mu": math.tan(0.5) + excess}
    run = model.simulate((0, 10), {"x": 0, "x_dot": 0}, p)
    assert modes(run) == [{"incline": mode}]


def test_static_friction_holds_more():
    """At rest k x may reach mu_s m g; once it slips mu acts."""
    mu, mu_s = sp.symbols("mu mu_s", positive=True)
    model = da.compile_model(table_oscillator(mu=mu, mu_static=mu_s), outputs=["F"])
    p = {"m": 1, "k": 100, "g": 9.81, "mu": 0.2}
    still = model.simulate((0, 5), {"x": 0.04, "x_dot": 0}, {**p, "mu_s": 0.5})
    assert modes(still) == [{"table": "stick"}]
    np.testing.assert_allclose(still["F"], 4.0, rtol=1e-12)
    moving = model.simulate((0, 5), {"x": 0.04, "x_dot": 0}, {**p, "mu_s": 0.35}, **TIGHT)
    assert modes(moving)[0] == {"table": "slip"}
    # The first half cycle about mu m g / k ends at 2 * 0.01962 - 0.04, where it sticks.
    assert moving["x"][-1] == pytest.approx(2 * 0.01962 - 0.04, abs=1e-13)


# -- backends and methods -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "backend, method, bound",
    [
        ("llvm", "taylor", 1e-10),
        ("llvm", "dop853", 1e-9),
        ("llvm", "tsit5", 1e-9),
        ("numpy", "dop853", 1e-9),
        ("jax", "dopri8", 1e-9),
    ],
)
def test_backends_and_methods_agree(backend, method, bound):
    entry = contact_reference("plate_push_pull")
    count = 5
    exact = [float(phase["t"]) for phase in entry["phases"]][:count]
    model = plate_model(FORCE, backend)
    run = model.simulate((0, 2.2), at_angle(0.5), {**PLATE, "mu": 0.8}, method=method, rtol=1e-11, atol=1e-13)
    assert [mode["corner"] for mode in modes(run)] == ["stick", "slip"] * 2 + ["stick"]
    np.testing.assert_allclose(begins(run), exact, rtol=0, atol=bound)


@pytest.mark.parametrize("formulation", ["projected", "baumgarte"])
def test_formulations_agree(formulation):
    entry = contact_reference("plate_push_pull")
    model = da.compile_model(corner_plate(FORCE), formulation=formulation)
    run = model.simulate((0, 2.2), at_angle(0.5), {**PLATE, "mu": 0.8}, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(begins(run), [float(phase["t"]) for phase in entry["phases"]][:5], rtol=0, atol=1e-9)


def test_the_same_run_twice_is_the_same():
    first, again = (plate_model(FORCE).simulate((0, 4), at_angle(0.5), {**PLATE, "mu": 0.8}) for _ in range(2))
    assert first.phases == again.phases
    np.testing.assert_array_equal(first.q, again.q)


def test_phases_of_compiled_code_are_those_that_python_runs(monkeypatch):
    """With and without events, which occur in phases and where these end."""
    model, p = plate_model(FORCE), {**PLATE, "mu": 0.8}
    angle = da.Event(dynamicsymbols("theta") - sp.Rational(11, 20), name="angle")
    events = [angle, da.Event(da.unknowns("N_Q") - sp.Rational(83, 10), direction=-1, name="light")]

    def simulated(**options):
        return model.simulate((0, 6), at_angle(0.5), p, rtol=1e-11, atol=1e-13, **options)

    with monkeypatch.context() as patched:
        patched.setattr(runner_choice, "runs_unchecked", lambda model: False)
        expected, watched = simulated(max_steps=99_999), simulated(events=events, max_steps=99_999)
    monkeypatch.setattr(host_runners, "simulate_in_own_time", None)
    times = np.linspace(0, 6, 50)
    for run, other in ((simulated(), expected), (simulated(events=events), watched)):
        assert modes(run) == modes(other)
        np.testing.assert_allclose(begins(run), begins(other), rtol=0, atol=1e-10)
        np.testing.assert_allclose(run(times).y, other(times).y, rtol=0, atol=1e-8)
        assert run.stats.steps > 30 and run.stats.method == "taylor"
    for name, record in run.events.items():
        np.testing.assert_allclose(record.t, watched.events[name].t, rtol=0, atol=1e-8)
        np.testing.assert_array_equal(record.direction, watched.events[name].direction)
        np.testing.assert_allclose(record.before.y, watched.events[name].before.y, rtol=0, atol=1e-8)
    assert len(run.events["angle"]) > 3 and len(run.events["light"]) > 3
    np.testing.assert_allclose(run.events["angle"]["theta"], 0.55, rtol=1e-14)
    np.testing.assert_allclose(run.events["light"]["N_Q"], 8.3, rtol=1e-12)
    assert simulated(t_eval=times).t.shape == (50,)


# -- sweeps ---------------------------------------------------------------------------------------


def test_a_sweep_is_its_single_runs():
    model = plate_model(FORCE)
    mu = np.linspace(0.7, 0.95, 6)
    sweep = model.sweep((0, 5), at_angle(0.5), {**PLATE, "mu": mu}, rtol=1e-11, atol=1e-13)
    assert sweep.success.all()
    last = sweep.mode("corner")
    for i, value in enumerate(mu):
        run = model.simulate((0, 5), at_angle(0.5), {**PLATE, "mu": value}, rtol=1e-11, atol=1e-13)
        assert sweep.final["theta"][i] == pytest.approx(run["theta"][-1], abs=1e-10)
        assert sweep.phases[i] == len(run.phases)
        assert last[i] == run.phases[-1].modes["corner"]


def test_sweeps_of_compiled_code_are_those_that_python_runs_to_the_last_bit(monkeypatch):
    """Alone or together, in one thread or two, with samples and with events, one of which ends some of the cases.

    Samples inside steps agree to rounding: Python evaluates polynomials of many steps at once, by other sums.
    """
    model, mu = plate_model(FORCE), np.linspace(0.7, 0.95, 19)
    ends = da.Event("theta_dot", terminal=True, direction=1, name="back")
    many = {"t_eval": np.linspace(0, 5, 23), "events": ["x_dot", ends]}

    def swept(**options):
        return model.sweep((0, 5), at_angle(0.5), {**PLATE, "mu": mu}, rtol=1e-9, atol=1e-11, **options)

    with monkeypatch.context() as patched:
        patched.setattr(runner_choice, "runs_unchecked", lambda model: False)
        expected, sampled = swept(), swept(**many)
    monkeypatch.setattr(host_runners, "sweep_in_own_time", None)
    found = [swept(threads=threads) for threads in (1, 2)]
    monkeypatch.setattr(phases, "_MOST_TOGETHER", 3)
    for run in (*found, swept(threads=2), swept(progress=True)):
        for name in ("theta", "x_dot"):
            np.testing.assert_array_equal(run.final[name], expected.final[name])
        np.testing.assert_array_equal(run.steps, expected.steps)
        np.testing.assert_array_equal(run.phases, expected.phases)
    run = swept(**many)
    for name in ("theta", "x_dot"):
        np.testing.assert_allclose(run[name], sampled[name], rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(run.mode("corner"), sampled.mode("corner"))
    np.testing.assert_array_equal(run.status, sampled.status)
    for name in ("x_dot", "back"):
        np.testing.assert_array_equal(run.events[name].count, sampled.events[name].count)
        np.testing.assert_array_equal(run.events[name].last, sampled.events[name].last)


@pytest.mark.parametrize("times", [None, [1.0, 5.0]])
def test_an_interrupt_ends_a_sweep(monkeypatch, times):
    """Ctrl-C after some looks: what ended by then is kept, other results are NaN, and the next sweep has all."""
    calls = []

    def press(finished):
        calls.append(finished)
        if len(calls) == 8:
            raise KeyboardInterrupt

    model, p = plate_model(FORCE), {**PLATE, "mu": np.linspace(0.7, 0.95, 200)}
    wanted = {"t_eval": times, "events": ["theta_dot"], "reduce": {"far": da.maximum("x")}}
    with monkeypatch.context() as patched:
        patched.setattr(hybrid_sweep, "_BETWEEN_LOOKS", 20)
        patched.setattr(hybrid_sweep, "meter", lambda total, wanted: contextlib.nullcontext(press))
        broken = model.sweep((0, 5), at_angle(0.5), p, progress=True, **wanted)
    stopped, whole = broken.status == Status.INTERRUPTED, model.sweep((0, 5), at_angle(0.5), p, **wanted)
    assert 0 < np.sum(stopped) < 200 and whole.success.all()
    assert np.array_equal(np.isnan(broken.t), stopped) and not np.any(broken.steps[stopped] | broken.phases[stopped])
    assert np.all(broken.mode("corner")[stopped] == "none") and not np.any(broken.events["theta_dot"].count[stopped])
    for mine, full in (
        *((broken[name], whole[name]) for name in ("x", "theta_dot", "N_Q", "energy")),
        *((broken.final[name], whole.final[name]) for name in broken.final),
        (broken.reduced["far"], whole.reduced["far"]),
        (broken.events["theta_dot"].first, whole.events["theta_dot"].first),
    ):
        assert np.all(np.isnan(mine[stopped])) and np.array_equal(mine[~stopped], full[~stopped], equal_nan=True)


@pytest.mark.parametrize("method, bound", [("taylor", 1e-10), ("dop853", 1e-9)])
def test_transitions_of_a_sweep_are_those_of_the_reference(method, bound):
    """Each case ends between two samples, at the phase that it is in there: a sweep has no times of phases."""
    times = [float(phase["t"]) for phase in contact_reference("plate_push_pull")["phases"]][1:5]
    model, near = plate_model(FORCE), np.repeat(times, 2) + np.tile([-bound, bound], 4)
    sweep = model.sweep((0, near), at_angle(0.5), {**PLATE, "mu": 0.8}, rtol=1e-12, atol=1e-14, method=method)
    np.testing.assert_array_equal(sweep.phases, np.array([1, 2, 2, 3, 3, 4, 4, 5]))


def test_one_paradox_does_not_spoil_a_sweep():
    start = {"x": 0.0, "y": 0.0, "theta": math.atan(2), "x_dot": -1.0, "y_dot": 0.0, "theta_dot": [0.0, 0.0, 5.0, 0.0]}
    sweep = ready("sliding_rod", "N").sweep((0, 0.3), start, {**ROD, "mu": [0.5, 2.0, 2.0, 1.0]}, rtol=1e-10)
    expected = [Status.SUCCESS, Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS, Status.SUCCESS]
    assert [Status(value) for value in sweep.status] == expected
    for name in ("theta", "N"):  # no motion begins where there is none, or more than one
        assert list(np.isnan(sweep[name])) == [False, True, True, False]


# -- the smooth law -------------------------------------------------------------------------------


def smooth_plate(force=0, backend="llvm"):
    if backend == "jax":
        pytest.importorskip("diffrax")
    eps = sp.Symbol("eps", positive=True)
    return da.compile_model(corner_plate(force, regularization=eps), backend=backend, outputs=["F_Q", "N_Q"])


def test_the_smooth_law_tends_to_the_law():
    """Its error falls with eps; in stick it creeps, which the law does not."""
    entry = contact_reference("plate_push_pull")
    model = smooth_plate(FORCE)
    errors = []
    for eps in (1e-2, 1e-3, 1e-4):
        p = {**PLATE, "mu": 0.8, "eps": eps}
        run = model.simulate((0, 2.2), at_angle(0.5), {**p}, t_eval=[2.2], rtol=1e-9, atol=1e-11)
        assert run.success
        errors.append(abs(run["theta"][0] - float(entry["rows"][1]["state"][0])))
    assert errors[0] > 4 * errors[1] > 16 * errors[2] > 0
    assert errors[2] < 3e-4


def test_the_smooth_law_is_what_it_says():
    run = smooth_plate().simulate((0, 0.3), at_angle(0.5), {**PLATE, "mu": 0.2, "eps": 0.01}, rtol=1e-10)
    slip = run["x_dot"] * np.cos(run["theta"])
    np.testing.assert_allclose(run["F_Q"], -0.2 * run["N_Q"] * slip / np.hypot(slip, 0.01), rtol=1e-10)


def test_gradient_through_the_smooth_law():
    """The derivative of where the plate comes to by mu: JAX's against differences of compiled runs."""
    model, other = smooth_plate(backend="jax"), smooth_plate()
    p = {**PLATE, "mu": 0.3, "eps": 0.01}
    found = model.sensitivity((0, 0.3), at_angle(0.7), p, wrt=["mu"], of=["theta"], rtol=1e-10, atol=1e-12)
    ends = [
        other.simulate((0, 0.3), at_angle(0.7), {**p, "mu": mu}, rtol=1e-12, atol=1e-14)["theta"][-1]
        for mu in (0.3 - 1e-4, 0.3 + 1e-4)
    ]
    slope = (ends[1] - ends[0]) / 2e-4
    assert abs(slope) > 0.01
    assert found.jacobian("theta", "mu")[-1] == pytest.approx(slope, rel=1e-6)


# -- what users do with such runs -----------------------------------------------------------------


def test_a_reaction_that_ends_with_its_contact_can_be_watched():
    """The corner's reaction falls through 1 N before the corner lets go; then it is zero, where nothing can cross."""
    model = da.compile_model(corner_plate(4, contact=True), outputs=["N_Q"])
    start, values = at_angle(1.3, 0.8, 2.0), {**PLATE, "h": 0.8, "mu": 0.2}
    light = da.Event(da.unknowns("N_Q") - 1, direction=-1, name="light")
    run = model.simulate((0, 0.25), start, values, events=[light, "N_Q"], **TIGHT)
    assert run.phases[-1].modes == {"corner": "open"}
    (t,) = run.events["light"].t
    assert t < run.phases[-1].t0 and abs(run([t])["N_Q"][0] - 1) < 1e-10
    sweep = model.sweep((0, 0.25), start, values | {"mu": np.array([0.2, 0.25])}, events=[light], **TIGHT)
    np.testing.assert_array_equal(sweep.events["light"].count, 1)
    assert abs(sweep.events["light"].first[0] - t) < 1e-10
    with pytest.raises(da.errors.ExpressionError, match="constant along every motion"):
        model.simulate((0, 1), start, values, events=[sp.Symbol("g", positive=True) - 9])


def test_a_motion_in_phases_survives_pickling():
    run = plate_model(FORCE).simulate((0, 2), at_angle(0.6), PLATE | {"mu": 0.8})
    again = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(again.constraint_violation, run.constraint_violation)
    assert again.phases == run.phases and again(1.0)["x"] == run(1.0)["x"]
