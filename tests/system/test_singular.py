"""Constraints that lose rank: passed through, ended with a status that says where, or left out where redundant."""

import functools

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from dalembert.reduction.variational import variational
from dalembert.runs import sweep as sweep_module
from dalembert.runs.case_blocks import run_cases
from dalembert.transforms.taylor.nonsmooth import decisions
from dalembert.transforms.taylor.recurrences import recurrences
from scene.scaled import Units
from system.singular_scenes import bars, carried, folding_crank, parallelogram, platform, windows

BARS = {"m": 1.0, "L": 1.0, "g": 9.81}
TURN = {1: 3.337870803105097731817957161247564911941, 4: 12.68425959351397191786347626886160363293}
"""Angle of the first crank of two windows by time (multibody benchmark A02, 40 digits)."""

CARRIED = {"m": 1.0, "M": 2.0, "L": 0.7, "g": 9.81}
LEANING = {"a0": 2.5, "a1": 2.5, "a2": 2.5, "b": 0.0, "a0_dot": 1.0, "a1_dot": 1.0, "a2_dot": 1.0, "b_dot": 0.0}


def start(count, angle=0.0):
    bars = dict.fromkeys([f"a{i}" for i in range(count + 1)], angle) | dict.fromkeys(
        [f"b{i}" for i in range(count)], 0.0
    )
    return bars | {"a0_dot": 1.0}


@functools.cache
def compiled(build, formulation="projected", backend="llvm"):
    return da.compile_model(build(), backend=backend, formulation=formulation)


@functools.cache
def two_windows():
    return windows(2)


def leaning(t):
    """Angle and rate of the cranks that carry the bar."""
    p = CARRIED
    pull = (1.5 * p["m"] + p["M"]) * p["g"] / ((p["m"] + p["M"]) * p["L"])
    run = solve_ivp(lambda _, y: [y[1], pull * np.sin(y[0])], (0, t), [2.5, 1.0], "DOP853", rtol=1e-12, atol=1e-12)
    return run.y[:, -1]


# -- singular configurations --------------------------------------------------------------


def test_guards_of_pivots_limit_no_step():
    program = compiled(two_windows).stages.program
    assert any(line.op == "less" for line in program.kernel("rhs").body)
    assert "knots" not in program
    assert recurrences(program.kernel("rhs")).switches == ()


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_projected_runs_pass_through_on_their_branch(method):
    run = compiled(two_windows).simulate((0, 4), start(2), BARS, method=method, rtol=1e-8, atol=1e-9)
    assert run.success and run.stats.note == ""
    assert run["a0"][-1] == pytest.approx(TURN[4], abs=1e-6)
    np.testing.assert_allclose(run.q[:, 1:3], run.q[:, :1] @ np.ones((1, 2)), atol=1e-7)
    assert np.ptp(run["energy"]) < 1e-5
    assert np.abs(run.constraint_violation).max() < 1e-12


@pytest.mark.parametrize("formulation", ["baumgarte", "augmented", "ggl"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-9])
def test_other_runs_end_there_and_say_where_and_why(formulation, rtol):
    """The first quarter turn is at 0.714 s."""
    method = "radau" if formulation == "ggl" else "taylor"
    run = compiled(two_windows, formulation).simulate((0, 4), start(2), BARS, method=method, rtol=rtol, atol=rtol)
    assert run.status is Status.SINGULAR_CONFIGURATION
    assert 0.5 < run.t[-1] < 0.72
    assert "at t = 0.714" in run.message and "a0 = 1.5" in run.message and "projected" in run.message
    # Rank is lost twice at once, and rounding says which combination of the two constraints is found.
    assert "holonomic constraint 1" in run.message or "holonomic constraint 3" in run.message
    assert "holonomic constraint 2" not in run.message and "holonomic constraint 4" not in run.message
    assert np.ptp(run["energy"]) < 1e-2
    times = np.linspace(0, run.t[-1], 7)
    np.testing.assert_allclose(run(times)["a1"], run(times)["a0"], atol=1e-3)


@pytest.mark.parametrize("formulation", ["baumgarte", "augmented"])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_runs_without_continuous_output_are_searched_too(formulation, method):
    options = {"method": method, "rtol": 1e-9, "atol": 1e-9, "dense": False}
    model = compiled(two_windows, formulation)
    run = model.simulate((0, 4), start(2), BARS, t_eval=[0, 0.5, 2, 4], **options)
    assert run.status is Status.SINGULAR_CONFIGURATION and run.t.tolist() == [0, 0.5]
    assert "at t = 0.71" in run.message
    again = model.simulate((0, 0.6), start(2), BARS, t_eval=[0, 0.31, 0.6], **options)
    whole = model.simulate((0, 0.6), start(2), BARS, t_eval=[0, 0.31, 0.6], **options | {"dense": True})
    assert again.success
    np.testing.assert_allclose(again.y, whole.y, atol=1e-8)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
@pytest.mark.parametrize("rtol", [1e-12, 1e-10])
def test_projected_runs_pass_on_their_branch_or_say_that_they_cannot(method, rtol):
    """None is projected onto another branch, where a part of its energy would be gone."""
    run = compiled(two_windows).simulate((0, 10), start(2), BARS, method=method, rtol=rtol, atol=rtol / 100)
    if run.success:
        assert np.ptp(run["energy"]) < 1e-4
    else:
        assert run.status is Status.SINGULAR_CONFIGURATION
        assert "depend on each other" in run.message


@pytest.mark.parametrize("method", ["taylor", "tsit5"])
def test_cases_of_a_projected_sweep_do_not_change_their_branch_and_succeed(method):
    initial = start(2) | {"a0_dot": np.full(3, start(2)["a0_dot"])}
    model = compiled(two_windows, "projected")
    for rtol in (1e-8, 1e-12):
        after = model.sweep((0, 4), initial, BARS, method=method, rtol=rtol, atol=rtol, max_steps=20_000)
        good = after.status == 0
        np.testing.assert_allclose(after["a0"][good], TURN[4], atol=1e-5)


FOLDING = {"m": 1.0, "M": 2.0, "L": 0.3, "g": 9.81}


def folded(angle, speed, t):
    """Angle of the crank at time t, whose rod has the opposite angle."""
    mass, load, length, g = FOLDING["m"], FOLDING["M"], FOLDING["L"], FOLDING["g"]

    def rates(_, y):
        c, s = np.cos(y[0]), np.sin(y[0])
        inertia = mass * length**2 * (5 / 12 + 2.25 * s * s + 0.25 * c * c) + 4 * load * length**2 * s * s
        bend = (4 * mass + 8 * load) * length**2 * s * c
        return [y[1], (-mass * g * length * c - 0.5 * bend * y[1] ** 2) / inertia]

    return solve_ivp(rates, (0, t), [angle, speed], "DOP853", rtol=1e-12, atol=1e-12).y[0, -1]


@pytest.mark.parametrize(("method", "rtol", "served"), [("taylor", 1e-10, 400), ("dop853", 1e-8, 395)])
def test_rows_that_vanish_do_not_lead_to_another_branch(method, rtol, served):
    """Beside the fold, what rounding leaves of the constraint is a curve that leads from one branch to the other."""
    angles = np.random.default_rng(0).uniform(0.5, 0.9, 400)
    length = FOLDING["L"]
    initial = {"a": angles, "b": -angles, "x": 2 * length * np.cos(angles), "a_dot": np.full(400, 5.0)}
    options = {"method": method, "rtol": rtol, "atol": rtol / 100, "max_steps": 20_000}
    after = compiled(folding_crank).sweep((0, 1), initial, FOLDING, **options)
    good = after.success
    assert np.sum(good) >= served
    np.testing.assert_allclose(np.sin((after["a"] + after["b"])[good] / 2), 0.0, atol=1e-6)
    np.testing.assert_allclose(after["x"][good], 2 * length * np.cos(after["a"][good]), atol=1e-6)
    for i in np.flatnonzero(good)[:5]:
        assert after["a"][i] == pytest.approx(folded(angles[i], 5.0, 1.0), abs=1e-6)


DIMENSIONS = {"m": (0, 1, 0), "M": (0, 1, 0), "L": (1, 0, 0), "g": (1, 0, -2), "x": (1, 0, 0)}


@pytest.mark.parametrize("time", [1.0, 1e6, 1e-6])
@pytest.mark.parametrize("length", [1.0, 1e3])
def test_runs_past_lost_ranks_that_succeed_keep_their_energy_in_all_units(time, length):
    """A projection onto another branch takes energy. With a floor that is a rate, up to 3,000 tolerances were lost."""
    units, draw = Units(length, 1.0, time), np.random.default_rng(0)
    angles = draw.uniform(0.5, 0.9, 400)
    fold = {"a": angles, "b": -angles, "x": 2 * FOLDING["L"] * np.cos(angles), "a_dot": np.full(400, 5.0)}
    turning = start(2, draw.uniform(-1.2, 1.2, 100)) | {"a0_dot": draw.uniform(0.5, 6.0, 100)}
    turning |= {"b0": 0.0, "b1": 0.0}
    for build, given, p, end, scale in ((folding_crank, fold, FOLDING, 1, 20.0), (two_windows, turning, BARS, 4, 75.0)):
        scene = build()
        model, energy = da.compile_model(scene, formulation="projected", outputs=("energy",)), units.length**2
        for method, rtol in (("taylor", 1e-10), ("dop853", 1e-9)):
            atol = 0.01 * rtol * min(1.0, length) / max(1.0, time)
            options = {"method": method, "rtol": rtol, "atol": atol, "max_steps": 20_000, "t_eval": [0, end * time]}
            cases = model.sweep((0, end * time), units.of(given, DIMENSIONS), units.of(p, DIMENSIONS), **options)
            change = np.ptp(cases["energy"], axis=1) / (scale * energy / time**2)
            assert np.all(change[cases.success] < 400 * rtol), (scene.name, method)
            assert build is two_windows or np.sum(cases.success) >= 370
            ended = {Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED, Status.SINGULAR_CONFIGURATION}
            assert set(cases.status[~cases.success]) <= ended | {Status.MAX_STEPS}


SPEEDS = np.array([0.2, 0.3, 0.6, 1.0, 1.2, 1.5])
"""The first two do not reach the quarter turn within a second."""


@pytest.mark.parametrize("formulation", ["baumgarte", "augmented", "ggl"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-9])
def test_sweeps_end_where_single_runs_do(formulation, rtol):
    """Steps that are long beside the dip of the determinant do not leap over it unseen."""
    model = compiled(two_windows, formulation)
    bars = BARS | ({"baumgarte_alpha": 5.0, "baumgarte_beta": 5.0} if formulation == "baumgarte" else {})
    for method in model.methods if formulation != "ggl" else ["radau"]:
        if method == "radau" and formulation != "ggl":
            continue
        options = {"method": method, "rtol": rtol, "atol": rtol / 10, "max_steps": 20_000}
        sweep = model.sweep((0, 1), start(2) | {"a0_dot": SPEEDS}, bars, t_eval=[0, 0.4, 1], **options)
        assert list(sweep.status) == [0, 0, *[Status.SINGULAR_CONFIGURATION] * 4], method
        for i in (0, 3, 5):
            run = model.simulate((0, 1), start(2) | {"a0_dot": SPEEDS[i]}, bars, **options)
            assert run.status == sweep.status[i]
            np.testing.assert_allclose(sweep.final["a0"][i], run["a0"][-1], atol=30 * rtol)
        assert np.all(np.isnan(sweep["a0"][2:, -1])) and np.all(np.isfinite(sweep["a0"][:, :2]))


def test_neighbours_of_cases_that_end_there_keep_their_bits():
    model = compiled(two_windows, "augmented")
    whole = model.sweep((0, 1), start(2) | {"a0_dot": SPEEDS}, BARS)
    part = model.sweep((0, 1), start(2) | {"a0_dot": SPEEDS[:2]}, BARS)
    np.testing.assert_array_equal(whole.final["a0"][:2], part.final["a0"])


def test_events_and_reductions_of_a_searched_sweep():
    model = compiled(two_windows, "augmented")
    sweep = model.sweep(
        (0, 1), start(2) | {"a0_dot": SPEEDS}, BARS, events=[da.Event("a1", name="up")], reduce={"a": da.final("a0")}
    )
    assert set(sweep.events) == {"up"}
    assert np.all(np.isfinite(sweep.reduced["a"][:2])) and np.all(np.isnan(sweep.reduced["a"][2:]))


@pytest.mark.parametrize("formulation", ["augmented", "ggl"])
def test_what_lies_behind_the_end_of_a_case_is_not_looked_at(formulation):
    """Stopped by an event short of the quarter turn, or turned back by a jump."""
    model, initial = compiled(two_windows, formulation), start(2) | {"a0_dot": SPEEDS}
    stop = da.Event("a0", terminal=True, name="stop")
    before = initial | dict.fromkeys(("a0", "a1", "a2"), -0.1)
    ended = model.sweep((0, 1), before, BARS, events=[stop])
    assert set(ended.status[2:]) == {Status.EVENT}
    cranks = dynamicsymbols("a0:3")
    back = {crank.diff(): -crank.diff() for crank in cranks}
    jump = da.Event(cranks[0] - sp.Rational(1, 2), apply=back, direction=1, name="back")
    turned = model.sweep((0, 0.6), initial, BARS, events=[jump])
    assert list(turned.status) == [0] * 6 and turned.events["back"].count[-1] == 1


def test_sweeps_whose_determinants_are_nearly_constant_are_fast():
    """The least of a nearly constant function is what such a search must not ask for."""
    from reduction.test_formulations import HORIZONTAL, PENDULUM
    from reduction.test_formulations import compiled as pendulum

    sweep = pendulum("pendulum", "augmented").sweep((0, 5), HORIZONTAL, {**PENDULUM, "g": np.linspace(9, 10, 50)})
    assert np.all(sweep.status == 0)


def test_start_at_a_singular_configuration_is_a_status():
    run = compiled(two_windows).simulate(
        (0, 1), start(2, np.pi / 2) | {"b0_dot": 0.0, "b1_dot": 0.0, "a1_dot": 1.0, "a2_dot": 1.0}, BARS
    )
    assert run.status is Status.SINGULAR_CONFIGURATION and run.t.tolist() == [0.0]
    assert "at t = 0 (a0 = 1.5708" in run.message and "start elsewhere" in run.message


def test_regular_runs_are_left_alone():
    """Short of the first quarter turn nothing is found."""
    for formulation in ("baumgarte", "augmented", "ggl"):
        run = compiled(two_windows, formulation).simulate((0, 0.6), start(2), BARS)
        assert run.success and run.stats.note == ""


# -- redundant constraints ----------------------------------------------------------------


@pytest.mark.parametrize("formulation", ["projected", "baumgarte", "ggl", "augmented"])
@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_redundant_constraints_are_found_at_the_start_and_watched(formulation, backend):
    model = compiled(platform, formulation, backend)
    end = 1.0 if backend == "llvm" else 0.3
    options = {} if formulation == "ggl" else {"method": "dop853"}
    run = model.simulate((0, end), LEANING, CARRIED, rtol=1e-8, atol=1e-9, **options)
    assert run.success, run.message
    np.testing.assert_allclose([run["a0"][-1], run["a0_dot"][-1]], leaning(end), atol=1e-6)
    assert run.constraint_violation.shape[1] == 4
    assert np.abs(run.constraint_violation).max() < 1e-6
    assert "it follows from the others around the start: holonomic constraint" in run.message


def test_redundant_constraints_in_sweeps():
    model, speeds = compiled(platform), np.array([0.5, 1.0, 2.0])
    initial = {**LEANING, **dict.fromkeys(("a0_dot", "a1_dot", "a2_dot"), speeds)}
    sweep = model.sweep((0, 1), initial, CARRIED, rtol=1e-9, atol=1e-10)
    assert np.all(sweep.status == 0)
    assert sweep.final["a0"][1] == pytest.approx(leaning(1.0)[0], abs=1e-7)


def unlike_cranks():
    """Three cranks that carry a bar, the third with a length and a height of its own."""
    m, g = sp.symbols("m g", positive=True)
    length, height = sp.symbols("length height")
    cranks, b = dynamicsymbols("a0:3"), dynamicsymbols("b")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("unlike_cranks", frame=N, origin=O, coordinates=[*cranks, b])
    B = N.orientnew("B", "Axis", (b, N.z))
    tips = []
    for i, (angle, L, h) in enumerate(zip(cranks, (1, 1, length), (0, 0, height), strict=True)):
        base = O.locatenew(f"A{i}", i * N.x + h * N.y)
        tips.append(base.locatenew(f"T{i}", L * sp.sin(angle) * N.x + L * sp.cos(angle) * N.y))
        scene.add_bodies(Particle(f"tip{i}", tips[i], m))
        if i:
            gap = tips[i].pos_from(tips[0].locatenew(f"E{i}", i * B.x))
            scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


@pytest.mark.parametrize("formulation", ["projected", "augmented"])
def test_cases_of_a_sweep_that_are_redundant_otherwise_than_the_first_are_not_run(formulation, monkeypatch):
    """Where the third crank differs the bar is locked; the constraint that follows where it does not would be lost."""
    model, angle, other = compiled(unlike_cranks, formulation), 0.7, 0.5
    length = np.sin(angle) / np.sin(other)
    columns = {
        "a2": np.array([angle, other, angle]),
        "length": np.array([1.0, length, 1.0]),
        "height": np.array([0.0, np.cos(angle) - length * np.cos(other), 0.0]),
    }
    still = {"a0": angle, "a1": angle, "b": 0.0} | dict.fromkeys(("a0_dot", "a1_dot", "a2_dot", "b_dot"), 0.0)
    begun = []

    def recorded(engine, cases, settings):
        begun.append(cases.block(slice(0, cases.count), settings)[1] < 0)
        return run_cases(engine, cases, settings)

    monkeypatch.setattr(sweep_module, "run_cases", recorded)
    for order in (slice(None), slice(1, None)):
        part = {name: column[order] for name, column in columns.items()}
        initial = still | {"a2": part.pop("a2")}
        sweep = model.sweep((0, 0.3), initial, {"m": 1.0, "g": 9.81, **part}, reduce=["a1"], t_eval=[0.1, 0.3])
        odd = 1 - (order.start or 0)
        expected = [Status.SINGULAR_CONFIGURATION if (i == odd) == (odd == 1) else 0 for i in range(len(initial["a2"]))]
        assert list(sweep.status) == expected
        refused = np.array(expected) != 0
        assert list(begun.pop()) == list(~refused)
        assert np.all(np.isnan(sweep.final["a0"][refused])) and np.all(np.isnan(sweep.reduced["a1"][refused]))
        assert (
            np.all(np.isfinite(sweep["a0"][~refused]))
            and "other constraints follow from each other" in sweep.stats.note
        )


def test_start_that_contradicts_a_redundant_constraint_is_refused_by_name():
    with pytest.raises(da.errors.InitialStateError, match=r"holonomic constraint \d"):
        compiled(platform).simulate((0, 1), {**LEANING, "a2": 2.6}, CARRIED)


SWINGING = {"m": 1.0, "L": 1.0, "g": 9.81}


def swinging(angle, speed=1.0):
    return {"a": angle, "b": angle, "a_dot": speed}


@functools.cache
def swing(by_angles=False, backend="llvm"):
    return da.compile_model(parallelogram(by_angles=by_angles), backend=backend)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"t_eval": [0, 0.3, 1], "dense": False},
        {"events": ["a_dot"]},
        {"method": "dop853", "rtol": 1e-12, "atol": 1e-14},
    ],
    ids=["steps", "samples", "events", "tight"],
)
def test_runs_pass_where_some_of_the_constraints_lose_rank_that_all_have(backend, options):
    """The crank is level after 0.376 s, and one of the rows vanishes there."""
    if backend == "numpy" and "events" in options:
        pytest.skip("as the others")
    run = swing(backend=backend).simulate((0, 1), swinging(0.3), SWINGING, **options)
    expected = swing(True).simulate((0, 1), swinging(0.3), SWINGING, **options)
    assert run.success and run.status is expected.status
    assert "it follows from the others around the start: holonomic constraint" in run.message
    assert run["a"][-1] == pytest.approx(expected["a"][-1], abs=1e-8)
    assert np.abs(run["a"] - run["b"]).max() < 1e-9


@pytest.mark.parametrize("method", ["auto", "taylor", "radau"])
def test_cases_of_sweeps_pass_there_too(method):
    angles, options = np.array([0.2, 0.5, 1.4]), {"method": method, "reduce": {"last": da.final("a")}}
    times = np.array([0, 0.05, 0.5])
    sweep = swing().sweep((0, 0.5), swinging(angles, -1.0), SWINGING, t_eval=times, **options)
    expected = swing(True).sweep((0, 0.5), swinging(angles, -1.0), SWINGING, t_eval=times)
    assert (expected["a"][:, -1] < 0.0).tolist() == [True, True, False]
    assert sweep.status.tolist() == [Status.SUCCESS] * 3
    np.testing.assert_allclose(sweep["a"], expected["a"], atol=1e-7)
    np.testing.assert_allclose(sweep.reduced["last"], expected["a"][:, -1], atol=1e-7)


def test_the_rows_that_are_enforced_are_those_that_do_not_vanish_at_the_start():
    for angle in (0.0, 1e-9, 1e-3, 1.5707):
        run = swing().simulate((0, 0.1), swinging(angle), SWINGING)
        assert run.success
        other = swing(True).simulate((0, 0.1), swinging(angle), SWINGING)
        assert run["b"][-1] == pytest.approx(other["b"][-1], abs=1e-9)
        found, expected = (model.linearize(0, swinging(angle), SWINGING) for model in (swing(), swing(True)))
        np.testing.assert_allclose(found.A, expected.A, atol=1e-9)


@pytest.mark.parametrize("end", [0.3, 3])
def test_derivatives_pass_there_too(end):
    options = {"of": ["a"], "wrt": ["g"], "rtol": 1e-10, "atol": 1e-12}
    found, expected = (s.sensitivity((0, end), swinging(0.3), SWINGING, **options) for s in (swing(), swing(True)))
    assert found.status is Status.SUCCESS
    assert found.jacobians[-1, 0, 0] == pytest.approx(expected.jacobians[-1, 0, 0], rel=1e-6)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_prepared_runs_that_start_with_dependent_constraints(backend):
    """After a few calls, starts are looked at by compiled code."""
    model = swing(backend=backend)
    p, y = model.parameter_vector(SWINGING), model.state(swinging(0.3), SWINGING)
    run = model.prepare((0, 0.5))
    expected = swing(True).simulate((0, 0.5), swinging(0.3), SWINGING)
    for _ in range(20 if backend == "llvm" else 1):
        final = run(y, p)
        assert run.status is Status.SUCCESS
        np.testing.assert_allclose(final[:2], expected["a"][-1], atol=1e-8)


def test_prepared_runs_of_regular_loops_are_those_of_the_engine():
    bars, model = start(2, 0.2), compiled(two_windows)
    p, y = model.parameter_vector(BARS), model.state(bars, BARS)
    run = model.prepare((0, 0.3))
    for _ in range(18):
        final = run(y, p)
    np.testing.assert_allclose(final, model.simulate((0, 0.3), bars, BARS, t_eval=[0.3]).y[-1], atol=1e-12)


def test_modes_of_contacts_pass_rows_that_vanish_beside_contacts_without_friction():
    model, begin = da.compile_model(parallelogram(with_ball=True)), {**swinging(0.3), "z": 2.0, "z_dot": 0.0}
    run = model.simulate((0, 0.5), {**begin, "b_dot": 1.0}, SWINGING, rtol=1e-10, atol=1e-12)
    assert run.success and "enforced together with the others" in run.message
    angle = solve_ivp(lambda _, y: [y[1], -9.81 * np.cos(y[0])], (0, 0.5), [0.3, 1.0], "DOP853", rtol=1e-12, atol=1e-13)
    assert run["a"][-1] == pytest.approx(angle.y[0, -1], abs=1e-9) and run["a"][-1] < 0.0
    prepared = model.prepare((0, 0.5))
    end = prepared(model.state({**begin, "b_dot": 1.0}, SWINGING), model.parameter_vector(SWINGING))
    assert prepared.status is Status.SUCCESS and end[0] == pytest.approx(angle.y[0, -1], abs=1e-6)


def test_modes_of_contacts_end_where_enforced_constraints_lose_rank():
    model = da.compile_model(parallelogram(with_ball=True), formulation="augmented")
    begin = {**swinging(0.3), "b_dot": 1.0, "z": 2.0, "z_dot": 0.0}
    assert model.simulate((0, 0.2), begin, SWINGING).success
    run = model.simulate((0, 0.5), begin, SWINGING)
    assert run.status is Status.SINGULAR_CONFIGURATION and 0.2 < run.t[-1] < 0.39
    prepared = model.prepare((0, 0.5))
    prepared(model.state(begin, SWINGING), model.parameter_vector(SWINGING))
    assert prepared.status is Status.SINGULAR_CONFIGURATION


def test_decimals_and_symbols_decide_alike_on_more_constraints_than_coordinates():
    tilted, final = {f"a{i}": 0.5 for i in range(3)} | {"a0_dot": 1.0}, {}
    for length in (1, 0.774):
        model = da.compile_model(carried(length))
        run = model.simulate((0, 0.3), tilted, {"m": 1.0, "g": 9.81 * float(length)})
        assert run.success and "enforced together with the others" in run.message
        final[length] = run["a2"][-1]
    assert final[1] == pytest.approx(final[0.774], abs=1e-8)


def test_nonholonomic_constraints_that_follow_by_weights_that_vary_are_enforced_together():
    """One of them vanishes at z = pi / 2, the other does not."""
    x, y, z = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("varying", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("bead", O.locatenew("P", x * N.x + y * N.y + z * N.z), sp.Symbol("m")))
    slip = x.diff() - y.diff()
    scene.add_nonholonomic_constraints(z.diff() - 1, sp.cos(z) * slip, (2 + sp.sin(z)) * sp.cos(z / 3) * slip)
    model = da.compile_model(scene, formulation="projected")
    begin, mass = {"x": 0, "y": 0, "z": 0.2, "y_dot": 1}, {"m": 1}
    assert model.simulate((0, 1), begin, mass).success
    run = model.simulate((0, 3), begin, mass)
    assert run.success and "enforced together with the others" in run.message
    np.testing.assert_allclose([run["x"][-1], run["y"][-1], run["z"][-1]], [3.0, 3.0, 3.2], atol=1e-9)


# -- reactions ----------------------------------------------------------------------------


def bar_acceleration(t):
    """Horizontal and vertical acceleration of the bar, and angle and angular acceleration of the cranks."""
    p, (a, rate) = CARRIED, leaning(t)
    second = (1.5 * p["m"] + p["M"]) * p["g"] / ((p["m"] + p["M"]) * p["L"]) * np.sin(a)
    across = p["L"] * (second * np.cos(a) - rate**2 * np.sin(a))
    return across, -p["L"] * (second * np.sin(a) + rate**2 * np.cos(a)), a, second


@pytest.mark.parametrize("formulation", ["projected", "ggl"])
def test_reactions_that_redundant_constraints_share_are_named_and_least(formulation):
    """The cranks may pull against each other along the direction `loose`; what balances moments is determined."""
    names = ("X1", "Y1", "X2", "Y2")
    model = da.compile_model(platform(joints=True), formulation=formulation, outputs=names)
    run = model.simulate((0, 0.5), LEANING, CARRIED, rtol=1e-9, atol=1e-10)
    assert run.success
    assert "the reactions X1, Y1, X2, Y2 are not determined here, and the least ones are given" in run.message
    x1, y1, x2, y2 = given = np.array([run[name][-1] for name in names])
    p, (_, up, a, second) = CARRIED, bar_acceleration(0.5)
    assert y1 + 2 * y2 == pytest.approx(p["M"] * (up + p["g"]), rel=1e-5)
    inertia = p["m"] * p["L"] ** 2 / 3 * second - p["m"] * p["g"] * p["L"] / 2 * np.sin(a)
    for x, y in ((x1, y1), (x2, y2)):
        assert (y * np.sin(a) - x * np.cos(a)) * p["L"] == pytest.approx(inertia, abs=1e-5)
    loose = np.array([-2 * np.sin(a), -2 * np.cos(a), np.sin(a), np.cos(a)])
    assert abs(given @ loose) < 1e-5 * np.linalg.norm(given)


def test_reactions_of_a_regular_loop_are_determined():
    """The same bar on two cranks, in a formulation that knows of no regular basis."""
    model = da.compile_model(platform(2, joints=True), outputs=["X1", "Y1"])
    assert model.formulation == "projected"
    two = {name: value for name, value in LEANING.items() if not name.startswith("a2")}
    run = model.simulate((0, 0.4), two, CARRIED, rtol=1e-9, atol=1e-10)
    assert run.success and run.stats.note == ""
    p = CARRIED
    _, up = (np.gradient(np.gradient(v(np.linspace(0, 0.4, 401)), 1e-3), 1e-3)[200] for v in tip_of(run))
    at = run(np.array([0.2]))
    assert at["Y1"][0] == pytest.approx(p["M"] * (up + p["g"]), rel=1e-4)


def tip_of(run):
    """Return the coordinates of the first crank's tip as functions of times."""
    return (
        lambda t: CARRIED["L"] * np.sin(run(t)["a0"]),
        lambda t: CARRIED["L"] * np.cos(run(t)["a0"]),
    )


def test_what_sets_pivots_aside_is_no_jump_of_the_rates():
    """Derivatives pass a configuration at which all constraints vanish, whether or not a sampled time lies in it."""
    model, single = da.compile_model(bars()), da.compile_model(bars(parallel=True))
    assert decisions(variational(model.stages.reduced, ("a",), ("F",))) is None
    options = {"wrt": ["F"], "of": ["a"], "rtol": 1e-10, "atol": 1e-12}
    start = {"a": 0.3, "a_dot": -0.6}
    expected = single.sensitivity((0, 0.6), start, {"F": 0.1}, **options)
    assert expected.values[-1, 0] < 0.0
    found = model.sensitivity((0, 0.6), start | {"b": -0.3, "b_dot": 0.6}, {"F": 0.1}, **options)
    assert found.success and found.jacobians[-1] == pytest.approx(expected.jacobians[-1], rel=1e-9)
