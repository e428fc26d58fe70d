"""Modes of many contacts that one program serves: motions are those of modes that have programs of their own."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.contacts.equations.dependent_slips import coupled_slips
from dalembert.contacts.equations.switched_modes import why_unswitched
from dalembert.methods.status import Status
from dalembert.phases import mode_models
from hard_cases.many_contacts import (
    boxes,
    boxes_at_rest,
    feet,
    feet_at_rest,
    standing,
    standing_at_rest,
    turning,
    turning_at_rest,
)

FINE = {"rtol": 1e-10, "atol": 1e-12}


def separately(monkeypatch):
    monkeypatch.setattr(mode_models, "why_separate", lambda *about: "they are compared with those of one program")


def both(monkeypatch, scene, **options):
    """Return the model of a scene with a common program, and that with one program a mode."""
    common = da.compile_model(scene, **options)
    assert not common.modes.why_separate
    separately(monkeypatch)
    apart = da.compile_model(scene, **options)
    assert apart.modes.common is None
    return common, apart


@cache
def feet_by_both():
    """Return both models of a body on four feet, which several tests run."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        return both(monkeypatch, feet(4), outputs=["N_c0", "N_c1", "F0_c0", "F0_c3"])


def agree(run, other, outputs=(), atol=1e-9, of_outputs=1e-7):
    assert run.success and other.success
    assert [phase.modes for phase in run.phases] == [phase.modes for phase in other.phases]
    ends = [[phase.t0 for phase in each.phases] for each in (run, other)]
    np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-9)
    t = np.linspace(0.0, run.t[-1], 203)[:-1]
    one, two = run(t), other(t)
    np.testing.assert_allclose(one.q, two.q, rtol=0.0, atol=atol)
    np.testing.assert_allclose(one.qdot, two.qdot, rtol=0.0, atol=100.0 * atol)
    edges = np.min(np.abs(t[:, np.newaxis] - np.array(ends[0])), axis=1)
    for name in outputs:
        np.testing.assert_allclose(one[name][edges > 1e-6], two[name][edges > 1e-6], rtol=1e-7, atol=of_outputs)


def programs(model):
    """Return how many programs of modes a model has compiled, besides the one of kernels that belong to no mode."""
    return len({*model.modes.compiled} - {model.modes.open_mode})


def test_feet_slip_and_stick_by_one_program_as_by_one_a_mode():
    outputs = ["N_c0", "F0_c0", "F0_c3"]
    common, apart = feet_by_both()
    start, p = feet_at_rest(4)
    run, other = (model.simulate((0.0, 1.0), start, p, **FINE) for model in (common, apart))
    agree(run, other, outputs)
    assert len(run.phases) > 10 and programs(common) == 1 and programs(apart) > 6
    assert run.constraint_violation.max() < 1e-12 and run.velocity_violation.max() < 1e-12
    assert run.constraint_violation.shape[1] == other.constraint_violation.shape[1] == 4


def test_feet_that_land_and_lift_by_one_program_as_by_one_a_mode():
    """The body is dropped: feet open and close with impacts."""
    common, apart = feet_by_both()
    start, p = feet_at_rest(4)
    start |= {"z": 0.9, "z_dot": -1.5, "x_dot": 0.6} | {f"z{i}": 0.1 + 0.02 * i for i in range(4)}
    run, other = (model.simulate((0.0, 0.6), start, p | {"push": 0.0}, **FINE) for model in (common, apart))
    agree(run, other, ["N_c1"], of_outputs=1e-6)
    states = {phase.modes["c1"] for phase in run.phases}
    assert "open" in states and len(states) > 1
    assert programs(common) == 1 < programs(apart)


def test_friction_in_a_plane_by_one_program_as_by_one_a_mode(monkeypatch):
    outputs = ["N_c0", "F0_c0", "F1_c2"]
    common, apart = both(monkeypatch, standing(), outputs=outputs)
    start, p = standing_at_rest()
    run, other = (model.simulate((0.0, 0.6), start, p, **FINE) for model in (common, apart))
    agree(run, other, outputs, of_outputs=1e-5)
    assert len(run.phases) > 3 and programs(common) == 1


@pytest.mark.matrix
def test_the_length_of_a_quaternion_holds_in_one_program_as_in_one_a_mode(monkeypatch):
    """The body turns, and its feet slip, stick and, after a jolt, lift."""
    outputs = ["N_c0", "F0_c0", "F1_c2"]
    common, apart = both(monkeypatch, turning(), outputs=outputs)
    start, p = turning_at_rest()
    start |= {"z_dot": -1.0, "e3_dot": 0.48, "e0_dot": -0.14}
    run, other = (model.simulate((0.0, 0.1), start, p, **FINE) for model in (common, apart))
    agree(run, other, outputs, of_outputs=1e-5)
    assert len(run.phases) > 3 and programs(common) == 1
    assert np.abs(np.sum(run.q[:, 3:7] ** 2, axis=1) - 1.0).max() < 1e-14
    assert np.ptp(run["e3"]) > 0.005


def test_boxes_share_loads_by_one_program_as_by_one_a_mode(monkeypatch):
    """The corners of a box slip together; beyond the least norm, the one with the smaller load takes all it can."""
    outputs = ["N_c0l", "F0_c0l", "F0_c0r", "F0_c1l"]
    common, apart = both(monkeypatch, boxes(2), outputs=outputs)
    start, p = boxes_at_rest(2)
    run, other = (model.simulate((0.0, 1.5), start, p, **FINE) for model in (common, apart))
    agree(run, other, outputs)
    assert len(run.phases) > 3 and programs(common) == 1
    force, press = run(np.array([0.22]))["F0_c0l"], run(np.array([0.22]))["N_c0l"]
    np.testing.assert_allclose(np.abs(force), 0.5 * press, rtol=1e-9)


def test_a_stack_of_twelve_contacts_tilts():
    """The lowest of six boxes is pushed until it slips and begins to tilt."""
    model = da.compile_model(boxes(6))
    start, p = boxes_at_rest(6)
    run = model.simulate((0.0, 1.0), start, p)
    assert run.success and programs(model) == 1
    assert [phase.modes["c0l"] for phase in run.phases] == ["stick", "slip", "open"]
    assert run.phases[1].t0 == pytest.approx(np.arcsin(0.5 * 60.0 / 48.0) / 3.0, abs=1e-9)  # mu m g of all boxes
    assert run.constraint_violation.max() < 1e-12


def test_sweeps_samples_and_prepared_runs_by_one_program():
    common, apart = feet_by_both()
    start, p = feet_at_rest(4)
    times, mu = np.linspace(0.0, 0.5, 11), np.linspace(0.4, 0.6, 5)
    kept = {"load": da.maximum("N_c0"), "share": da.mean("N_c0")}
    found = [
        model.sweep((0.0, 0.5), start, {**p, "mu": mu}, t_eval=times, reduce=kept, **FINE) for model in (common, apart)
    ]
    one, two = found
    assert one.success.all() and programs(common) == 1
    np.testing.assert_array_equal(one.phases, two.phases)
    for name in ("x", "x0", "N_c0"):
        np.testing.assert_allclose(one[name], two[name], rtol=1e-8, atol=1e-8)
    for name in kept:
        np.testing.assert_allclose(one.reduced[name], two.reduced[name], rtol=1e-8)
    run = common.prepare((0.0, 0.5), **FINE)
    end = run(common.state(start, p), common.parameter_vector({**p, "mu": mu[0]}))
    final = [one.final[name][0] for name in common.layout.variables]
    np.testing.assert_allclose(end, final, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "jax"])
def test_python_runs_modes_of_the_common_program(backend):
    start, p = feet_at_rest(4)
    models = feet_by_both()[0], da.compile_model(feet(4), backend=backend)
    runs = [model.simulate((0.0, 0.06), start, p, **FINE) for model in models]
    agree(*runs)
    assert len(runs[0].phases) > 2


def test_events_end_and_map_motions_by_one_program():
    start, p = feet_at_rest(4)
    x = dynamicsymbols("x")
    hop = da.Event(x - 0.01, apply={x.diff(): 0.5 * x.diff()}, name="hop")
    runs = [model.simulate((0.0, 0.4), start, p, events=[hop], **FINE) for model in feet_by_both()]
    agree(*runs)
    assert len(runs[0].events["hop"]) == len(runs[1].events["hop"]) > 0
    np.testing.assert_allclose(runs[0].events["hop"].t, runs[1].events["hop"].t, atol=1e-9)


def test_a_mode_whose_contacts_share_loads_otherwise_has_a_program_of_its_own():
    """Two corners of a box on the floor slip alike."""
    model = da.compile_model(boxes(2))
    start, p = boxes_at_rest(2)
    common, layout = model.modes.common, model.layout
    x = np.array([[start[name] for name in layout.variables]])
    values = np.zeros(1), x, np.array([[p[name] for name in layout.parameters]])
    sticking = ("stick",) * 4
    common.settle(sticking, *values)
    assert common.sharing[sticking] == {1: 0, 3: 2}
    common.settle(("open", *sticking[1:]), *values)
    assert common.sharing["open", *sticking[1:]] == {3: 2}
    common.sharing.clear()
    common._coupled.clear()  # as if no contacts slipped alike whatever the state
    common.settle(sticking, *values)
    assert common.sharing[sticking] is None and model.modes.serving(sticking) is model.modes.model(sticking)


def test_which_scenes_have_a_common_program():
    assert coupled_slips(da.compile_model(boxes(2)).modes.equations) == {(0, 1): 1, (2, 3): 1}
    few = da.compile_model(feet(3))
    assert "no more than 3 contacts" in few.modes.why_separate and not why_unswitched(few.modes.equations)
    assert "'baumgarte'" in da.compile_model(feet(4), formulation="baumgarte").modes.why_separate
    text = feet_by_both()[0].explain()
    assert "one program serves" in text


@cache
def wedge(balanced=False, rough=False, others=2):
    """Return a particle in the wedge 0 <= z <= x y, pushed along x, and more particles on the floor.

    Both surfaces hold it on the line x = z = 0, on which their normals are opposite at y = 0 alone. The push F is
    constant, or `balanced`: -F y.
    """
    (m, g, F, mu), time = sp.symbols("m g F mu", positive=True), dynamicsymbols._t
    x, y, z, *heights = dynamicsymbols(["x", "y", "z", *(f"h{i}" for i in range(others))])
    N, O = ReferenceFrame("N"), Point("O")
    n, roof, f, f2, *presses = da.unknowns(" ".join(["n roof f f2", *(f"k{i}" for i in range(others))]))
    scene = da.Scene("wedge", frame=N, origin=O, coordinates=[x, y, z, *heights])
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, F * (-y if balanced else 1) * N.x - m * g * N.z))
    friction = f * N.x + f2 * N.y if rough else 0 * N.x
    scene.add_joints(da.Joint("floor", body="p", at=P, force=n * N.z + friction))
    scene.add_joints(da.Joint("roof", body="p", at=P, force=roof * (y * N.x + x * N.y - N.z)))
    scene.add_contacts(da.UnilateralContact(n, gap=z, name="floor"))
    scene.add_contacts(da.UnilateralContact(roof, gap=x * y - z, name="roof"))
    if rough:
        scene.add_friction(da.CoulombFriction(n, (f, f2), slip=(x.diff(time), y.diff(time)), mu=mu, name="floor"))
    for i, (h, press) in enumerate(zip(heights, presses, strict=True)):
        Q = O.locatenew(f"Q{i}", (3 + i) * N.x + h * N.z)
        scene.add_bodies(Particle(f"q{i}", Q, m))
        scene.add_loads((Q, -m * g * N.z))
        scene.add_joints(da.Joint(f"j{i}", body=f"q{i}", at=Q, force=press * N.z))
        scene.add_contacts(da.UnilateralContact(press, gap=h, name=f"c{i}"))
    model = da.compile_model(scene, outputs=["roof"])
    assert bool(model.modes.why_separate) == (others == 0)
    return model


IN_WEDGE = {"x": 0.0, "y": -1.0, "z": 0.0, "h0": 0.0, "h1": 0.0, "y_dot": 1.0}
OF_WEDGE = {"m": 1.0, "g": 9.81, "F": 1.0}


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_rows_that_become_dependent_where_a_motion_passes(method):
    """The reaction F/|y| grows without bound, does no work, and lets go behind y = 0: then x = F (t - 1)^2 / 2 m."""
    run = wedge().simulate((0.0, 2.0), IN_WEDGE, OF_WEDGE, method=method)
    assert run.success and [phase.modes["roof"] for phase in run.phases] == ["closed", "open"]
    assert run.phases[1].t0 == pytest.approx(1.0, abs=1e-6)
    assert run["x"][-1] == pytest.approx(0.5, abs=1e-6) and run["y"][-1] == pytest.approx(1.0, abs=1e-9)
    before = run(np.array([0.5, 0.9, 0.99]))
    np.testing.assert_allclose(before["roof"], [2.0, 10.0, 100.0], rtol=1e-7)
    sweep = wedge().sweep((0.0, 2.0), IN_WEDGE, {**OF_WEDGE, "F": [0.5, 1.0, 2.0]}, method=method)
    np.testing.assert_allclose(sweep.final["x"], [0.25, 0.5, 1.0], atol=2e-6)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("span", [(0.0, 2.0), (0.0, 1.0)])
def test_rows_that_become_dependent_where_reactions_stay_finite(method, span):
    """The reaction is F all along, also where a run ends on the place itself."""
    run = wedge(balanced=True).simulate(span, IN_WEDGE, OF_WEDGE, method=method)
    assert run.success and len(run.phases) == 1
    assert abs(run["x"][-1]) < 1e-12 and run["y"][-1] == pytest.approx(span[1] - 1.0, abs=1e-9)
    np.testing.assert_allclose(run(np.array([0.3, 0.9]))["roof"], 1.0, rtol=1e-9)


def test_a_reaction_that_grows_without_bound_jams_a_rough_wedge():
    """m v^2/2 is the work of mu (m g + F/|y|): it is used up where ln(1/|y|) = (1/2 - mu g)/(mu F) nearly."""
    run = wedge(rough=True).simulate((0.0, 2.0), IN_WEDGE, {**OF_WEDGE, "mu": 0.02})
    assert run.status is Status.CONTACT_IMPOSSIBLE and len(run.phases) == 1
    assert np.log(-1.0 / run["y"][-1]) == pytest.approx((0.5 - 0.02 * 9.81) / 0.02, abs=1e-3)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
@pytest.mark.parametrize("push", [1.0, 0.6])
def test_modes_with_programs_of_their_own_end_where_a_rough_wedge_leaves_its_friction_unknown(method, push):
    """The roof let go at |y| = 1e-6, and the particle passed on with SUCCESS, where it jams at 2.5e-7, or at 1e-11."""
    start = {name: value for name, value in IN_WEDGE.items() if name[0] != "h"}
    run = wedge(rough=True, others=0).simulate((0.0, 2.0), start, {**OF_WEDGE, "F": push, "mu": 0.02}, method=method)
    assert run.status is Status.SINGULAR_CONFIGURATION and len(run.phases) == 1
    known = run["y"] < -1e-5
    np.testing.assert_allclose(-run["y"][known] * run["roof"][known], push, rtol=1e-5)


def test_motions_on_stiffer_and_stiffer_floors_approach_that_of_rigid_contacts():
    """Springs, dampers and smooth friction as loads know nothing of phases; the error falls with the slip speed eps."""
    start, p = standing_at_rest()
    options = {"rtol": 1e-8, "atol": 1e-10}
    rigid = da.compile_model(standing()).simulate((0, 0.6), start, p, **options)
    soft, errors = da.compile_model(standing(soft=True)), []
    for k, eps in ((1e5, 3e-3), (1e7, 3e-4)):
        run = soft.simulate((0, 0.6), start, p | {"k_floor": k, "eps": eps}, **options)
        assert rigid.success and run.success
        errors.append(np.max(np.abs(run.q[-1] - rigid.q[-1])))
    assert errors[0] < 1e-3 and errors[1] < errors[0] / 5
