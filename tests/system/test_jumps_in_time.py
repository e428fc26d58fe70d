"""What depends on time alone may jump: steps end there, in every kind of run, and no pulse is stepped over."""

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.analysis import variation
from dalembert.errors import BreakTimesError, OptionError
from dalembert.methods.status import Status

pytestmark = pytest.mark.usefixtures("quick_xla")

t = dynamicsymbols._t
x = dynamicsymbols("x")
A, tp, w = sp.symbols("A tp w")
H = sp.Heaviside
WIDTH = 0.03
START = {"x": 0.0, "x_dot": 0.0}
TIMES = np.linspace(0.1, 2.9, 1000)


def oscillator(force, **options):
    m = sp.Symbol("m", positive=True)
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("P", x * frame.x)
    scene = da.Scene("pulse", frame=frame, origin=origin, coordinates=[x])
    scene.add_bodies(Particle("block", place, m))
    scene.add_loads((place, (force - x) * frame.x))
    return da.compile_model(scene, **options)


def pendulum(force, **options):
    """Return a mass on a circle, with a constraint."""
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("P", x * frame.x + y * frame.y)
    scene = da.Scene("pendulum", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("bob", place, 1))
    scene.add_loads((place, force * frame.x - 10 * frame.y))
    scene.add_holonomic_constraints(x**2 + y**2 - 1)
    return da.compile_model(scene, **options)


PULSE = sp.Piecewise((A, sp.And(t > tp, t < tp + sp.Float(WIDTH))), (0, True))
WRITTEN = {
    "Piecewise": PULSE,
    "Heaviside": A * (H(t - tp) - H(t - tp - sp.Float(WIDTH))),
    "sign": A * (1 + sp.sign(sp.Float(WIDTH) / 2 - sp.Abs(t - tp - sp.Float(WIDTH) / 2))) / 2,
    "floor": A * sp.Piecewise((1, sp.Eq(sp.floor((t - tp) / sp.Float(WIDTH)), 0)), (0, True)),
}


def exact(time, pulse=1.2, size=100.0):
    def since(s):
        return np.where(s > 0.0, 1.0 - np.cos(s), 0.0)

    return size * (since(time - pulse) - since(time - pulse - WIDTH))


@pytest.fixture(scope="module")
def numba_model():
    return oscillator(PULSE)


@pytest.mark.parametrize("backend", ["llvm", "numpy", "jax"])
def test_every_method_sees_a_pulse(backend):
    if backend == "jax":
        pytest.importorskip("diffrax")
    model = oscillator(PULSE, backend=backend)
    values = {"m": 1.0, "A": 100.0, "tp": 1.2}
    for method in ("taylor",) if backend == "jax" else ("auto", *model.methods):
        run = model.simulate((0, 3), START, values, method=method, rtol=1e-8, atol=1e-10)
        assert run.status is Status.SUCCESS
        assert abs(run["x"][-1] - exact(3.0)) < 2e-6, method
        within = np.array([0.5, 1.2, 1.21, 1.23, 2.0])
        np.testing.assert_allclose(run(within)["x"], exact(within), atol=3e-6)


@pytest.mark.parametrize("name", WRITTEN)
def test_every_way_of_writing_it_is_the_same_motion(name):
    run = oscillator(WRITTEN[name], backend="numpy").simulate(
        (0, 3), START, {"m": 1, "A": 100, "tp": 1.2}, rtol=1e-10, atol=1e-12
    )
    assert abs(run["x"][-1] - exact(3.0)) < 1e-9


def test_a_sweep_over_the_time_of_a_pulse_sees_it_in_every_case(numba_model):
    values = {"m": 1.0, "A": 100.0, "tp": TIMES}
    for method in ("taylor", "dop853", "tsit5"):
        cases = numba_model.sweep((0, 3), START, values, method=method, rtol=1e-9, atol=1e-11)
        assert np.all(cases.success)
        np.testing.assert_allclose(cases["x"], exact(3.0, TIMES), atol=1e-8)
    samples = np.linspace(0, 3, 31)
    cases = numba_model.sweep((0, 3), START, values, t_eval=samples, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(cases["x"], exact(samples, TIMES[:, np.newaxis]), atol=1e-8)
    alone = numba_model.simulate((0, 3), START, values | {"tp": TIMES[7]}, t_eval=samples, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(cases["x"][7], alone["x"], atol=1e-9)


@pytest.mark.parametrize(("backend", "method"), [("llvm", "radau"), ("numpy", "auto"), ("jax", "auto")])
def test_sweeps_of_other_loops_see_it_too(backend, method):
    if backend == "jax":
        pytest.importorskip("diffrax")
    model, some = oscillator(PULSE, backend=backend), TIMES[::250]
    values = {"m": 1.0, "A": 100.0, "tp": some}
    cases = model.sweep((0, 3), START, values, method=method, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(cases["x"], exact(3.0, some), atol=1e-6)
    samples = np.array([0.0, 1.0, 3.0])
    cases = model.sweep((0, 3), START, values, method=method, t_eval=samples, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(cases["x"], exact(samples, some[:, np.newaxis]), atol=1e-6)


def test_prepared_runs_estimates_events_and_reductions_see_it(numba_model):
    values = {"m": 1.0, "A": 100.0, "tp": 1.2}
    run = numba_model.prepare((0, 3), rtol=1e-9, atol=1e-11)
    for pulse in (1.2, 2.5, 4.0):
        p = numba_model.parameter_vector(values | {"tp": pulse})
        assert abs(run(numba_model.state(START, values), p)[0] - exact(3.0, pulse)) < 1e-8
        assert run.status is Status.SUCCESS
    motion = numba_model.simulate((0, 3), START, values, rtol=1e-6, atol=1e-8, error_estimate=True)
    error = abs(motion["x"][-1] - exact(3.0))
    assert error < 1.5 * motion.error_estimate["x"][-1] + 1e-10
    motion = numba_model.simulate((0, 3), START, values, rtol=1e-10, atol=1e-12, events=[x - sp.Rational(1, 100)])
    (crossed,) = motion.events[0].t
    assert abs(crossed - 1.2 - np.arccos(1 - 1e-4)) < 1e-9
    pulses = TIMES[::200]
    cases = numba_model.sweep(
        (0, 3), START, values | {"tp": pulses}, events=["x_dot"], reduce={"most": da.maximum(x)}, rtol=1e-9, atol=1e-11
    )
    top = 200 * np.sin(WIDTH / 2)
    np.testing.assert_allclose(cases.reduced["most"][pulses < 1.4], np.full(np.sum(pulses < 1.4), top), atol=1e-7)


def test_runs_begin_and_end_at_breaks_and_go_backwards(numba_model):
    values = {"m": 1.0, "A": 100.0, "tp": 1.2}
    run = numba_model.simulate((1.2, 1.2 + WIDTH), START, values, rtol=1e-10, atol=1e-12)
    assert abs(run["x"][-1] - exact(1.2 + WIDTH)) < 1e-12
    whole = numba_model.simulate((0, 3), START, values, rtol=1e-11, atol=1e-13)
    end = {"x": whole["x"][-1], "x_dot": whole["x_dot"][-1]}
    back = numba_model.simulate((3, 0), end, values, rtol=1e-11, atol=1e-13)
    assert abs(back["x"][-1]) < 1e-10
    assert abs(back["x_dot"][-1]) < 1e-10
    times = [0, 1.2, 1.2, 1.21, 1.2 + WIDTH, 3]
    run = numba_model.simulate((0, 3), START, values, t_eval=times, rtol=1e-10, atol=1e-12)
    assert run.t.tolist() == times
    np.testing.assert_allclose(run["x"], exact(np.array(times)), atol=1e-10)


def test_a_square_wave_is_exact_to_the_tolerance():
    model = oscillator(1 + sp.sign(sp.sin(w * t)) + x, backend="llvm")
    run = model.simulate((0, 10), START, {"m": 1, "w": 20.0}, rtol=1e-9, atol=1e-12)
    v = s = 0.0
    edges = np.append(np.arange(64) * np.pi / 20, 10.0)
    for k, h in enumerate(np.diff(edges)):
        force = 2.0 if k % 2 == 0 else 0.0
        s, v = s + v * h + force * h * h / 2, v + force * h
    assert abs(run["x"][-1] - s) < 1e-12 * s
    assert run.stats.steps < 200


@pytest.mark.parametrize("formulation", ["minimal", "projected", "ggl", "augmented", "baumgarte"])
def test_formulations_with_constraints_agree_with_a_reference_stopped_at_breaks(formulation):
    force = 40 * (H(t - tp) - H(t - tp - sp.Float(WIDTH))) + sp.Max(sp.sin(3 * t), 0)
    model = pendulum(force, formulation=formulation) if formulation != "minimal" else pendulum(force)
    start = {"x": 0.0, "y": -1.0, "x_dot": 0.0, "y_dot": 0.0}
    if model.formulation == "minimal":
        start = {"x": 0.0, "y": -1.0, "x_dot": 0.0}
    loose = formulation in ("ggl", "augmented", "baumgarte")
    run = model.simulate((0, 2), start, {"tp": 1.3}, rtol=1e-8 if loose else 1e-10, atol=1e-10)
    edges = sorted({0.0, np.pi / 3, 1.3, 1.3 + WIDTH, 2.0})
    state = np.zeros(2)
    for a, b in pairwise(edges):
        inside = 0.5 * (a + b)
        pushed = 40.0 if 1.3 < inside < 1.3 + WIDTH else 0.0
        on = np.sin(3 * inside) > 0

        def rates(time, y, pushed=pushed, on=on):
            load = pushed + (np.sin(3 * time) if on else 0.0)
            return [y[1], load * np.cos(y[0]) - 10 * np.sin(y[0])]

        state = solve_ivp(rates, (a, b), state, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert abs(run["x"][-1] - np.sin(state[0])) < 1e-6


@pytest.mark.parametrize("formulation", ["minimal", "projected", "ggl", "augmented", "baumgarte"])
@pytest.mark.parametrize("kind", ["kink of a position", "jump of a velocity"])
def test_constraints_that_make_rates_jump_act_by_an_impulse(formulation, kind):
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    cart, bob = (
        origin.locatenew("C", x * frame.x),
        origin.locatenew("B", (x + sp.sin(y)) * frame.x - sp.cos(y) * frame.y),
    )
    scene = da.Scene("jerked", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("cart", cart, 2), Particle("bob", bob, 1))
    if kind == "jump of a velocity":
        scene.add_nonholonomic_constraints(x.diff() - sp.Heaviside(t - 1))
    else:
        scene.add_holonomic_constraints(x - sp.Max(t - 1, 0))
    model = da.compile_model(scene, formulation=formulation)
    start = {"x": 0, "x_dot": 0, "y": sp.Rational(1, 2), "y_dot": 0}
    times = np.array([0.5, 1.5])
    run = model.simulate((0, 1.5), start, {}, t_eval=times, rtol=1e-8, atol=1e-9)
    # along y, cos(y) x_dot + y_dot of the bob stays; afterwards nothing turns it
    np.testing.assert_allclose(run["y"], [0.5, 0.5 - 0.5 * np.cos(0.5)], atol=1e-6)
    np.testing.assert_allclose(run["x"], [0.0, 0.5], atol=1e-6)
    if formulation in ("minimal", "projected"):
        cases = model.sweep((0, 1.5), start, {}, rtol=1e-8, atol=1e-9)
        assert abs(cases["y"][0] - run["y"][-1]) < 1e-7


def test_contacts_stick_and_slip_when_a_load_or_friction_jumps():
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("B", x * frame.x + y * frame.y)
    scene = da.Scene("block", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("block", place, 1))
    scene.add_loads((place, 20 * (H(t - tp) - H(t - tp - sp.Float(WIDTH))) * frame.x - 10 * frame.y))
    normal, friction = da.unknowns("N F")
    scene.add_joints(da.Joint("floor", body="block", at=place, force=friction * frame.x + normal * frame.y))
    scene.add_holonomic_constraints(y)
    mu = sp.Piecewise((sp.Rational(1, 2), t < 100), (sp.Rational(1, 4), True))
    scene.add_friction(da.CoulombFriction(normal, friction, slip=x.diff(), mu=mu, mu_static=mu, name="floor"))
    model = da.compile_model(scene)
    start = {"x": 0, "x_dot": 0, "y": 0, "y_dot": 0}
    speed = 15 * WIDTH
    distance = 15 * WIDTH**2 / 2 + speed**2 / 10
    run = model.simulate((0, 3), start, {"tp": 1.2})
    assert [phase.modes["floor"] for phase in run.phases] == ["stick", "slip", "stick"]
    assert abs(run["x"][-1] - distance) < 1e-12
    assert abs(run.phases[1].t0 - 1.2) < 1e-12
    cases = model.sweep((0, 3), start, {"tp": TIMES[:-100:100]}, t_eval=[0.05, 3.0])
    np.testing.assert_allclose(cases["x"][:, 1], distance, atol=1e-12)
    np.testing.assert_allclose(cases["x"][:, 0], 0.0, atol=1e-15)
    found = model.accelerations([1.0, 1.21], [0, 0], [0, 0], {"tp": 1.2})
    np.testing.assert_allclose(found[:, 0], [0.0, 15.0], atol=1e-12)


@pytest.mark.parametrize("mu", [0.05, 0.1, 0.2])
def test_a_prescribed_velocity_jumps_beside_a_contact_that_changes(mu):
    """The block comes to rest after the jump, at its very time, or before; the pendulum does not feel it."""
    y, w, z = dynamicsymbols("y w z")
    frame, origin = ReferenceFrame("N"), Point("O")
    cart = origin.locatenew("C", x * frame.x)
    bob = origin.locatenew("B", (x + sp.sin(y)) * frame.x - sp.cos(y) * frame.y)
    block = origin.locatenew("W", w * frame.x + z * frame.y)
    scene = da.Scene("jerked", frame=frame, origin=origin, coordinates=[x, y, w, z])
    scene.add_bodies(Particle("cart", cart, 2), Particle("bob", bob, 1), Particle("block", block, 1))
    scene.add_loads((block, -10 * frame.y))
    normal, friction, drive = da.unknowns("N F D")
    scene.add_joints(da.Joint("drive", body="cart", at=cart, force=drive * frame.x))
    scene.add_joints(da.Joint("floor", body="block", at=block, force=friction * frame.x + normal * frame.y))
    scene.add_holonomic_constraints(z)
    scene.add_nonholonomic_constraints(x.diff() - sp.Heaviside(t - 1))
    scene.add_friction(da.CoulombFriction(normal, friction, slip=w.diff(), mu=mu, name="floor"))
    model = da.compile_model(scene)
    start = {"x": 0, "x_dot": 0, "y": 0.5, "y_dot": 0, "w": 0, "w_dot": 1.0, "z": 0, "z_dot": 0}
    rest = min(1.5, 0.1 / mu)
    expected = [0.5, 0.5 - 0.5 * np.cos(0.5), rest - 5 * mu * rest**2, 0]
    run, sweep = model.simulate((0, 1.5), start, {}), model.sweep((0, 1.5), start, {})
    np.testing.assert_allclose(run.q[-1], expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose([sweep[name][0] for name in "xywz"], expected, rtol=0, atol=1e-9)
    final = model.prepare((0, 1.5))(model.state(start, {}), model.parameter_vector({}))
    np.testing.assert_allclose(final[:4], expected, rtol=0, atol=1e-9)


def test_sensitivities_are_right_at_fixed_times_and_refused_at_times_that_move(monkeypatch):
    values = {"m": 1.0, "A": 10.0, "tp": 1.2}
    model = oscillator(A * (H(t - 1) - H(t - sp.Float(1.05))) + A * sp.Max(t - tp, 0), backend="numpy")
    found = model.sensitivity((0, 3), START, values, wrt=["A", "tp"], t_eval=[1, 3], rtol=1e-10, atol=1e-12)
    for name in ("A", "tp"):
        runs = [
            model.simulate((0, 3), START, values | {name: values[name] + e}, rtol=1e-12, atol=1e-13)["x"][-1]
            for e in (1e-5, -1e-5)
        ]
        assert abs(found.jacobian("x", name)[-1] - (runs[0] - runs[1]) / 2e-5) < 1e-6
    model = oscillator(PULSE, backend="numpy")
    model.sensitivity((0, 3), START, values, wrt=["A", "m"])
    model.sensitivity((0, 1), START, values, wrt=["tp"])
    with pytest.raises(OptionError, match=r"jump at t = 1\.2.*tp"):
        model.sensitivity((0, 3), START, values, wrt=["tp"], t_eval=[3])
    model = oscillator(-A * sp.sign(x - tp), backend="numpy")
    model.sensitivity((0, 0.1), {"x": 1, "x_dot": 0}, values | {"tp": 0.0}, wrt=["A"])
    for steps in (4096, 1):  # long runs are looked at in parts
        monkeypatch.setattr(variation, "_STEPS_AT_ONCE", steps)
        with pytest.raises(OptionError, match="in a state that depends on it"):
            model.sensitivity((0, 1), {"x": 1, "x_dot": 0}, values | {"tp": 0.0}, wrt=["A"])


def test_energies_that_jump_in_time_are_not_conserved_and_what_is_told_of_a_model():
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("P", x * frame.x)
    scene = da.Scene("spring", frame=frame, origin=origin, coordinates=[x])
    body = Particle("block", place, 1)
    stiffness = sp.Piecewise((1, t < 1), (4, True))
    body.potential_energy = stiffness * x**2 / 2
    scene.add_bodies(body)
    scene.add_loads((place, -stiffness * x * frame.x))
    model = da.compile_model(scene, backend="numpy")
    run = model.simulate((0, 3), {"x": 1, "x_dot": 0}, {}, rtol=1e-10, atol=1e-12)
    assert "energy" not in run.invariants
    x1, v1 = np.cos(1.0), -np.sin(1.0)
    assert abs(run["x"][-1] - (x1 * np.cos(4.0) + v1 / 2 * np.sin(4.0))) < 1e-9
    assert "conditions    1 on time" in model.explain()
    linear = model.linearize(2.0, {"x": 0, "x_dot": 0}, {})
    np.testing.assert_allclose(linear.A, [[0, 1], [-4, 0]])
    assert linear.parameters == ()


def test_a_late_pulse_is_seen_and_its_derivatives_are_judged_in_the_time_of_the_user():
    start = 1.7e9
    model = oscillator(PULSE, backend="numpy")
    values = {"m": 1.0, "A": 100.0, "tp": start + 1.25}
    run = model.simulate((start, start + 3), START, values, rtol=1e-10, atol=1e-12)
    assert abs(run["x"][-1] - exact(3.0, 1.25)) < 1e-7  # WIDTH is added to the late time
    cases = model.sweep(
        (start, start + 3), START, values | {"tp": start + np.array([0.5, 1.25])}, rtol=1e-9, atol=1e-11
    )
    np.testing.assert_allclose(cases["x"], exact(3.0, np.array([0.5, 1.25])), atol=1e-7)
    model.sensitivity((start, start + 3), START, values, wrt=["A"])
    with pytest.raises(OptionError, match=r"jump at t = 1700000001\.25"):
        model.sensitivity((start, start + 3), START, values, wrt=["tp"])


def test_conditions_that_change_without_end_are_refused(numba_model):
    model = oscillator(sp.sign(sp.sin(1 / t)), backend="numpy")
    with pytest.raises(BreakTimesError, match="changes too often"):
        model.simulate((0, 1), START, {"m": 1})


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_positions_with_kinks_in_time_act_by_an_impulse(formulation):
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    support = origin.locatenew("S", sp.Max(t - 1, 0) * frame.x)
    bob = support.locatenew("B", sp.sin(y) * frame.x - sp.cos(y) * frame.y)
    scene = da.Scene("jerked", frame=frame, origin=origin, coordinates=[y])
    scene.add_bodies(Particle("bob", bob, 1))
    model = da.compile_model(scene, formulation=formulation)
    run = model.simulate((0, 1.5), {"y": 0.5, "y_dot": 0}, {}, t_eval=[0.5, 1.5], rtol=1e-10, atol=1e-12)
    # the momentum cos(y) x_dot + y_dot along y stays, and nothing turns the bob afterwards
    np.testing.assert_allclose(run["y"], [0.5, 0.5 - 0.5 * np.cos(0.5)], atol=1e-9)
    cases = model.sweep((0, 1.5), {"y": np.array([0.5, 0.6]), "y_dot": 0}, {}, rtol=1e-10)
    np.testing.assert_allclose(cases["y"], [0.5 - 0.5 * np.cos(0.5), 0.6 - 0.5 * np.cos(0.6)], atol=1e-9)


def test_turned_frames_with_kinks_in_time_act_by_an_impulse():
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    table = frame.orientnew("T", "Axis", (sp.Abs(t - 1), frame.z))
    bead = origin.locatenew("B", y * table.x + 2 * table.y)
    scene = da.Scene("turned", frame=frame, origin=origin, coordinates=[y])
    scene.add_bodies(Particle("bead", bead, 3))
    model = da.compile_model(scene)
    before, after = model.simulate((0, 2), {"y": 0.5, "y_dot": 0}, {}, t_eval=[1 - 1e-9, 1 + 1e-9], rtol=1e-10)["y_dot"]
    assert abs(after - before - 4.0) < 1e-6  # y_dot - 2 omega stays, and omega goes from -1 to 1


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_positions_that_jump_are_refused(formulation):
    frame, origin = ReferenceFrame("N"), Point("O")
    y = dynamicsymbols("y")
    scene = da.Scene("torn", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("bob", origin.locatenew("B", x * frame.x + y * frame.y), 1))
    scene.add_holonomic_constraints(x - sp.Heaviside(t - 1))
    model = da.compile_model(scene, formulation=formulation)
    with pytest.raises(da.errors.ConstraintError, match=r"jumps at t = 1: .* continuous in time"):
        model.simulate((0, 2), {"x": 0, "x_dot": 0, "y": 0, "y_dot": 1}, {})


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_coordinates_without_mass_take_part_in_impulses(formulation):
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pulled", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("bob", origin.locatenew("B", y * frame.x), 2))
    scene.add_holonomic_constraints(x - sp.Max(t - 1, 0), y - x)
    model = da.compile_model(scene, formulation=formulation)
    run = model.simulate((0, 2), {"x": 0, "x_dot": 0, "y": 0, "y_dot": 0}, {}, t_eval=[1.5, 2.0])
    np.testing.assert_allclose(run["y"], [0.5, 1.0], atol=1e-9)
    np.testing.assert_allclose(run["x_dot"], [1.0, 1.0], atol=1e-9)
