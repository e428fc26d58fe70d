"""Runs far from time zero: what is rounded is t - t0, and nothing else."""

import pickle

import mpmath
import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError
from dalembert.scenes import bouncing_ball
from hard_cases.contacts import corner_plate

LATE = 1.7e9
T = dynamicsymbols._t
X = dynamicsymbols("x")
START = {"x": 1.0, "x_dot": 0.0}
VALUES = {"k": 4.0, "w": 3.1, "a": 0.7}
k, w, a = sp.symbols("k w a", positive=True)


def mass(force, constraint=None):
    """A mass of 1 kg on a line under a force."""
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", X * frame.x)
    scene = da.Scene("mass", frame=frame, origin=origin, coordinates=[X])
    scene.add_bodies(Particle("p", point, 1))
    scene.add_loads((point, force * frame.x))
    return scene


def driven(t, t0, number=float, k=VALUES["k"], w=VALUES["w"], a=VALUES["a"]):
    """The exact motion of x'' = -k x + a sin(w t) from START, in many digits."""
    with mpmath.workdps(200):
        t, t0, k, w, a = map(mpmath.mpf, (t, t0, k, w, a))
        root, share, phase = mpmath.sqrt(k), a / (k - w * w), w * t0
        b, c = 1 - share * mpmath.sin(phase), -share * w * mpmath.cos(phase) / root
        tau = root * (t - t0)
        return number(share * mpmath.sin(w * t) + b * mpmath.cos(tau) + c * mpmath.sin(tau))


@pytest.fixture(scope="module", params=["numpy", "llvm"])
def spring(request):
    return da.compile_model(mass(-k * X), backend=request.param)


@pytest.fixture(scope="module", params=["numpy", "llvm"])
def shaken(request):
    return da.compile_model(mass(-k * X + a * sp.sin(w * T)), backend=request.param)


@pytest.mark.parametrize("t0", [LATE, -LATE, 3.0])
def test_without_time_in_it_a_motion_has_the_bits_of_one_from_zero(spring, t0):
    p = {"k": 4.0}
    for method in spring.methods:
        here, there = (spring.simulate((s, s + 4), START, p, method=method, rtol=1e-6) for s in (0.0, t0))
        assert np.array_equal(here.y, there.y)
        assert np.array_equal(there.t, t0 + here.t)
        assert np.array_equal(here(np.array([1.0, 4.0])).y, there(t0 + np.array([1.0, 4.0])).y)
        assert there(there.t)["x"] == pytest.approx(there["x"], abs=1e-14)
    wanted = np.array([0.0, 1.25, 4.0])
    sweeps = [spring.sweep((s, s + 4), START, {"k": [4.0, 5.0]}, t_eval=s + wanted) for s in (0.0, t0)]
    assert np.array_equal(sweeps[0]["x"], sweeps[1]["x"])
    assert np.array_equal(sweeps[1].t_eval, t0 + wanted)
    assert np.array_equal(sweeps[1].t, [t0 + 4] * 2)
    state, vector = spring.state(START, p), spring.parameter_vector(p)
    assert np.array_equal(*(spring.prepare((s, s + 4))(state, vector) for s in (0.0, t0)))
    changes = [spring.sensitivity((s, s + 4), START, p, wrt=["k"]) for s in (0.0, t0)]
    assert np.array_equal(changes[0].jacobians, changes[1].jacobians)
    assert np.array_equal(changes[1].t, t0 + changes[0].t)


def test_backwards_and_the_times_as_they_were_given(spring):
    wanted = LATE - np.array([0.0, 0.3, 2.0])
    run = spring.simulate((LATE, LATE - 2), START, {"k": 4.0}, t_eval=wanted, rtol=1e-10, atol=1e-12)
    assert np.array_equal(run.t, wanted)
    assert run["x"] == pytest.approx(np.cos(2.0 * (wanted - LATE)), abs=1e-8)
    assert np.array_equal(run.to_xarray().time, wanted)
    with pytest.raises(OptionError, match=r"t_eval must lie between t0 = 1700000000"):
        spring.simulate((LATE, LATE + 2), START, {"k": 4.0}, t_eval=[1.0])
    with pytest.raises(OptionError, match="which the run covers"):
        run(LATE + 1.0)


def test_events_are_counted_from_the_start(spring):
    run = spring.simulate((LATE, LATE + 5), START, {"k": 4.0}, events=[X], rtol=1e-10, atol=1e-12)
    record = run.events[X]
    assert record.t - LATE == pytest.approx(np.pi / 4 + np.arange(3) * np.pi / 2, abs=2.4e-7)
    assert np.max(np.abs(record["x"])) < 1e-9
    sweep = spring.sweep((LATE, LATE + 5), START, {"k": [4.0]}, events=[X], reduce={"first": da.first_crossing(X)})
    assert sweep.reduced["first"] == next(iter(sweep.events.values())).first == pytest.approx(record.t[0], abs=2.4e-7)


@pytest.mark.parametrize("t0", [LATE, -LATE])
def test_with_time_in_it_a_motion_is_as_good_as_one_from_zero(shaken, t0):
    for method in [m for m in shaken.methods if m not in ("radau", "bdf")]:
        run = shaken.simulate((t0, t0 + 5), START, VALUES, method=method, rtol=1e-11, atol=1e-12, dense=True)
        assert run["x"][-1] == pytest.approx(driven(t0 + 5, t0), abs=1e-9)
        assert run(t0 + 2.5)["x"][0] == pytest.approx(driven(t0 + 2.5, t0), abs=1e-9)


def test_sweeps_and_prepared_runs_with_time_in_them(shaken):
    many = {**VALUES, "w": np.array([3.1, 2.5, 2.7])}
    sweep = shaken.sweep((LATE, LATE + 5), START, many, rtol=1e-11, atol=1e-12, t_eval=[LATE + 2, LATE + 5])
    assert sweep["x"][:, 1] == pytest.approx([driven(LATE + 5, LATE, w=float(w)) for w in many["w"]], abs=1e-9)
    assert set(sweep.parameters) == {"k", "w", "a"}
    starts = np.array([LATE, 0.0, -40.0])
    apart = shaken.sweep((starts, starts + 5), START, VALUES, rtol=1e-11, atol=1e-12)
    assert apart["x"] == pytest.approx([driven(s + 5, s) for s in starts], abs=1e-9)
    assert np.array_equal(apart.t, starts + 5)
    for i, t0 in enumerate(starts):  # a case has the bits that it has among others
        alone = shaken.sweep((t0, t0 + 5), START, VALUES, rtol=1e-11, atol=1e-12)
        assert np.array_equal(alone.y[0], apart.y[i])
    run = shaken.prepare((LATE, LATE + 5), rtol=1e-11, atol=1e-12)
    state, p = shaken.state(START, VALUES, t=LATE), shaken.parameter_vector(VALUES)
    assert run(state, p)[0] == pytest.approx(driven(LATE + 5, LATE), abs=1e-9)
    assert pickle.loads(pickle.dumps(run))(state, p)[0] == run(state, p)[0]


def test_derivatives_with_time_in_them(shaken):
    found = shaken.sensitivity((LATE, LATE + 5), START, VALUES, wrt=["w", "k"], t_eval=[LATE + 5], rtol=1e-11)
    with mpmath.workdps(60):
        by_w = mpmath.diff(lambda v: driven(LATE + 5, LATE, mpmath.mpf, w=v), VALUES["w"])
        by_k = mpmath.diff(lambda v: driven(LATE + 5, LATE, mpmath.mpf, k=v), VALUES["k"])
    assert found.wrt == ("w", "k")
    assert found.jacobian("x", "w")[0] == pytest.approx(float(by_w), rel=1e-8)
    assert found.jacobian("x", "k")[0] == pytest.approx(float(by_k), rel=1e-8)


def test_events_and_reductions_of_time(spring, shaken):
    for model, p in ((spring, {"k": 4.0}), (shaken, VALUES)):
        events = [da.Event(T - LATE - 1.25, name="then"), da.Event("t")]
        run = model.simulate((LATE, LATE + 3), START, p, events=events, rtol=1e-10, atol=1e-12)
        assert run.events["then"].t == pytest.approx([LATE + 1.25], abs=2.4e-7)
        plain = model.simulate((LATE, LATE + 3), START, p, rtol=1e-10, atol=1e-12)
        assert run.events["then"]["x"] == pytest.approx(plain(LATE + 1.25)["x"], abs=1e-8)
        sweep = model.sweep((LATE, LATE + 3), START, p, reduce={"last": da.final(T - LATE), "most": da.maximum("t")})
        assert (sweep.reduced["last"][0], sweep.reduced["most"][0]) == (3.0, LATE + 3)


@pytest.mark.parametrize(
    ("force", "same"),
    [
        (
            sp.Piecewise((1, (T > LATE + 1) & (T < LATE + 2)), (0, True)),
            sp.Piecewise((1, (T > 1) & (T < 2)), (0, True)),
        ),
        (
            sp.Piecewise((sp.sin(T - LATE), T < LATE + 1), (1, T >= LATE + 1)),
            sp.Piecewise((sp.sin(T), T < 1), (1, True)),
        ),
        (sp.Mod(T, sp.Rational(1, 2)), sp.Mod(T, sp.Rational(1, 2))),
        ((T - LATE) ** 2 + sp.exp(int(LATE) - T), T**2 + sp.exp(-T)),
        (sp.sin(X + (T - LATE) ** 2 / 3) / (1 + (T - LATE)), sp.sin(X + T**2 / 3) / (1 + T)),
        (X * sp.Max(0, T - LATE - 1), X * sp.Max(0, T - 1)),
    ],
)
def test_what_is_the_same_force_from_zero(force, same):
    late = da.compile_model(mass(force)).simulate((LATE, LATE + 3), START, {}, max_step=0.05, rtol=1e-9)
    early = da.compile_model(mass(same)).simulate((0, 3), START, {}, max_step=0.05, rtol=1e-9)
    assert late["x"][-1] == pytest.approx(early["x"][-1], abs=1e-7)


@pytest.mark.parametrize("formulation", ["minimal", "projected", "ggl"])
def test_constraints_that_move(formulation):
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", X * frame.x + y * frame.y)
    scene = da.Scene("guide", frame=frame, origin=origin, coordinates=[X, y])
    scene.add_bodies(Particle("p", point, 1))
    scene.apply_uniform_gravity(-9.81 * frame.y)
    scene.add_holonomic_constraints(X - a * sp.sin(w * T))
    model = da.compile_model(scene, formulation=formulation)
    given = {"x": 0.7 * np.sin(3.1 * LATE), "y": 0.0, "y_dot": 0.0}  # rounded as a user rounds it
    run = model.simulate((LATE, LATE + 1), given, {"a": 0.7, "w": 3.1}, rtol=1e-9)
    with mpmath.workdps(60):
        right = float(mpmath.mpf(0.7) * mpmath.sin(mpmath.mpf(3.1) * (mpmath.mpf(LATE) + 1)))
    assert run["x"][-1] == pytest.approx(right, abs=1e-12)
    assert np.max(np.abs(run.constraint_violation)) < 1e-12


def test_contacts():
    model = da.compile_model(bouncing_ball())
    start, p = {"x": 0.0, "y": 1.0, "x_dot": 0.0, "y_dot": 0.0}, {"m": 1.0, "e": 0.6, "g": 9.81}
    known = (*model.layout.coordinates, *model.layout.rates)
    start = {name: value for name, value in start.items() if name in known}
    p = {name: p[name] for name in model.layout.parameters}
    here, there = (model.simulate((s, s + 1), start, p) for s in (0.0, LATE))
    assert np.array_equal(here.y, there.y)
    assert [phase.t0 for phase in there.phases] == [LATE + phase.t0 for phase in here.phases]
    assert np.array_equal(here(0.75).y, there(LATE + 0.75).y)
    wanted = np.array([0.25, 0.75])
    assert np.array_equal(
        model.simulate((0, 1), start, p, t_eval=wanted).y,
        model.simulate((LATE, LATE + 1), start, p, t_eval=LATE + wanted).y,
    )
    sweeps = [model.sweep((s, s + 1), start, {**p, "e": [0.6, 0.8]}, t_eval=s + wanted) for s in (0.0, LATE)]
    assert np.array_equal(sweeps[0]["y"], sweeps[1]["y"])


def test_cases_with_contacts_that_begin_near_and_far_from_zero():
    """Each has the bits, the modes and the events that it has alone."""
    model = da.compile_model(corner_plate(4 + 7 * sp.sin(3 * T)), outputs=["N_Q"])
    start = {"x": -0.5 / np.tan(0.5), "theta": 0.5, "theta_dot": 0.0}
    p = {"m": 1, "l": 1, "h": 0.5, "g": 9.81, "mu": 0.8}
    starts = np.array([LATE, 2.0, -LATE, 0.0])
    wanted = {
        "method": "taylor",
        "events": ["theta_dot"],
        "reduce": {"first": da.first_crossing("theta_dot"), "most": da.maximum("theta")},
    }
    together = model.sweep((starts, starts + 1), start, p, **wanted)
    plain = model.sweep((starts, starts + 1), start, p, method="taylor")
    assert together.success.all() and {*together.parameters} == {*p}
    for i, t0 in enumerate(starts):
        alone = model.sweep((t0, t0 + 1), start, p, **wanted)
        run = model.simulate((t0, t0 + 1), start, p, method="taylor")
        for name in ("x", "theta_dot"):
            assert together[name][i] == alone[name][0]
            assert plain[name][i] == run[name][-1]
        assert together["N_Q"][i] == pytest.approx(alone["N_Q"][0], rel=1e-12)
        for name in ("t", "status", "steps", "phases"):
            assert getattr(together, name)[i] == getattr(alone, name)[0]
        assert together.mode("corner")[i] == alone.mode("corner")[0] == run.mode("corner")[-1]
        assert all(np.array_equal(together.reduced[n][i], alone.reduced[n][0], equal_nan=True) for n in alone.reduced)
        mine, own = together.events["theta_dot"], alone.events["theta_dot"]
        assert (mine.count[i], mine.last[i]) == (own.count[0], own.last[0])


def test_notes_say_when(spring):
    """Where a run ended is said in the time that it was asked for."""
    y = dynamicsymbols("y")
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", X * frame.x + y * frame.y)
    scene = da.Scene("lines", frame=frame, origin=origin, coordinates=[X, y])
    scene.add_bodies(Particle("p", point, 1))
    scene.add_holonomic_constraints(X**2 - y**2)
    model = da.compile_model(scene, formulation="augmented")
    run = model.simulate(
        (LATE, LATE + 9), {"x": 1, "y": 1, "x_dot": -1, "y_dot": -1}, {}, t_eval=[LATE + 0.5, LATE + 9]
    )
    assert np.array_equal(run.t, [LATE + 0.5])
    assert run.t_end == pytest.approx(LATE + 1, abs=1e-4)
    assert "at t = 1700000001" in run.message or "at t = 1700000000.99" in run.message
