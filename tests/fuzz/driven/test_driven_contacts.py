"""Some driven contact scenes against Moreau-Jean time stepping; ``make fuzz`` runs as many as wanted."""

from dataclasses import replace

import numpy as np
import pytest

import dalembert as da
from fuzz.contacts.families import Case
from fuzz.contacts.invariants import merged
from fuzz.contacts.scenes import SCENES, TIME, setting
from fuzz.driven import compare, runs
from fuzz.driven.compare import examine
from fuzz.driven.families import FAMILIES, FORCES, Kick, Law, drawn, of_case
from fuzz.driven.records import Record
from fuzz.driven.reference import reference

FIXED = {"inputs": (0,), "functions": (0,), "controllers": (0,), "events": (6,)}
PARTICLE = ("m", "g_x", "g_y", "k", "c", "x_0", "A", "omega", "phi", "B", "C", "nu", "belt", "mu", "mu_s", "e")
BLOCK = Case(
    "particle",
    dict.fromkeys(PARTICLE, 0.0) | {"m": 1.0, "g_y": 10.0, "mu": 0.3},
    {"x": 0.0, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0},
    1.0,
)


@pytest.mark.parametrize("family, seed", [(family, seed) for family, seeds in FIXED.items() for seed in seeds])
def test_a_driven_scene_agrees_with_the_reference(family, seed):
    report = examine(drawn(family, seed), steps=800)
    assert (report.outcome, report.found) == ("agree", [])


def test_every_family_and_every_kind_of_record_is_drawn():
    cases = [drawn(family, seed) for family in FAMILIES for seed in range(200)]
    assert {case.case.scene for case in cases} == set(SCENES) - {"puck"} == set(FORCES)
    kinds = {record.kind for case in cases for _, record in case.records}
    assert kinds == {"hold", "linear", "cubic", "steps", "ramps"}
    assert {case.law.kind for case in cases if case.law} == {"line", "switch", "integral", "count"}


@pytest.mark.parametrize("kind", ["steps", "ramps"])
def test_pieces_and_what_users_write_are_one_function(kind):
    knots, slopes = (0.0, 0.2, 0.5, 0.9), (1.0, -2.0, 0.0, 3.0)
    record = Record(kind, knots, (0.5, 0.7, 0.1, 0.1), slopes)
    times = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.6, 0.9, 1.5])
    place = np.searchsorted(knots, times, side="right") - 1
    own = [np.polyval(record.pieces()[k][::-1], t - knots[k]) for k, t in zip(place, times, strict=True)]
    expression, values = record.expression("a"), record.parameters("a")
    numbers = {symbol: values[symbol.name] for symbol in expression.free_symbols - {TIME}}
    theirs = [float(expression.subs(numbers).subs(TIME, t)) for t in times]
    np.testing.assert_allclose(theirs, own, rtol=0, atol=1e-12)


# -- the reference, where the motion is known ----------------------------------------------------------


def test_the_reference_knows_held_forces_and_belts():
    """Pushed with 5 from t = 0.5 on, with friction 3: v = 2 (t - 0.5)."""
    push = of_case(BLOCK, {"g_x": Record("hold", (0.0, 0.5), (2.0, 5.0))})
    q, v = reference(push, "particle", PARTICLE, 4000).at(np.array([0.5, 1.0]))
    np.testing.assert_allclose(q[:, 0], [0.0, 0.25], atol=1e-3)
    np.testing.assert_allclose(v[:, 0], [0.0, 1.0], atol=1e-3)


def test_the_reference_knows_walls_that_move():
    """A wall without friction moves at 1 - t towards a wheel at rest, and strikes it without restitution."""
    numbers = dict.fromkeys(("g_x", "belt", "T", "A", "mu", "mu_wall", "e"), 0.0)
    numbers |= {"m": 1.0, "I": 0.1, "r": 0.5, "g_y": 10.0, "omega": 1.0, "x_wall": 0.6}
    names = ("m", "I", "r", "g_x", "g_y", "belt", "T", "omega", "A", "mu", "mu_wall", "x_wall", "e")
    start = {"x": 0.0, "y": 0.5, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    times = np.linspace(0.0, 1.0, 5)
    wall = Record("cubic", tuple(times), tuple(0.6 - times + times**2 / 2))
    case = of_case(Case("wheel", numbers, start, 1.0), {"x_wall": wall})
    strikes = 1.0 - np.sqrt(0.8)  # 0.1 = t - t^2 / 2
    q, v = reference(case, "wheel", names, 8000).at(np.array([1.0]))
    speed = -(1.0 - strikes)
    np.testing.assert_allclose(v[0, 0], speed, atol=1e-3)
    np.testing.assert_allclose(q[0, 0], speed * (1.0 - strikes), atol=1e-3)


def test_the_reference_knows_controllers_and_kicks():
    """A force g_x = 4 - n from instant to instant of 0.25 s, without friction; at x = 0.1 the speed is halved."""
    slide = replace(BLOCK, parameters=BLOCK.parameters | {"mu": 0.0})
    law = Law("g_x", "integral", 0, (1.0, 4.0, 0.0), 0.25)
    q, v = reference(replace(of_case(slide, {}), law=law), "particle", PARTICLE, 8000).at(np.array([0.5]))
    # nothing in the first period, then T (b - 0)
    np.testing.assert_allclose([q[0, 0], v[0, 0]], [0.25**2 / 2, 0.25], atol=1e-3)
    pushed = replace(slide, parameters=slide.parameters | {"g_x": 5.0})
    kicked = replace(of_case(pushed, {}), kick=Kick(0, 0.1, 1, 0.5))
    motion = reference(kicked, "particle", PARTICLE, 8000)
    assert motion.kicks == pytest.approx([0.2], abs=1e-4)
    np.testing.assert_allclose(motion.at(np.array([1.0]))[1][0, 0], 0.5 + 5.0 * 0.8, atol=1e-3)


# -- the checks fail where they must -------------------------------------------------------------------


def test_other_forces_are_wrong(monkeypatch):
    case = drawn("inputs", 0)
    name, record = case.records[0]
    other = replace(record, values=tuple(1.05 * value + 0.05 for value in record.values))
    shifted = {key: (other if key == name else each) for key, each in case.records}
    monkeypatch.setattr(runs, "samples_of", lambda given: {k: r.samples() for k, r in shifted.items()})
    report = examine(case, steps=100)
    assert report.outcome == "WRONG"
    assert any(text.startswith(("positions", "velocities")) for text in report.found)


def test_a_law_that_is_not_kept_is_wrong(monkeypatch):
    case = drawn("controllers", 0)
    a, b, c = case.law.numbers
    told = replace(case, law=replace(case.law, numbers=(a + 0.01, b, c)))
    problem = runs.Problem(case)
    run = problem.simulated(1e-8)
    assert compare._laws(case, problem.setting, run, 1e-5) == []
    assert any("its law gives" in text for text in compare._laws(told, problem.setting, run, 1e-5))


# -- found by these scenes -----------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_a_block_that_came_to_rest_slides_when_an_event_sets_it_in_motion(backend):
    """It slides 1.5^2 / 6 twice: what ended the last phase says nothing of the slip after the map."""
    made = da.compile_model(setting("particle").scene, backend=backend)
    x, _ = setting("particle").scene.coordinates
    kick = da.Event(TIME - 1.0, apply={x.diff(TIME): 1.5}, name="kick")
    numbers = {name: BLOCK.parameters[name] for name in made.layout.parameters}
    start = BLOCK.initial | {"x_dot": 1.5}
    run = made.simulate((0.0, 2.0), start, numbers, events=[kick])
    sweep = made.sweep((0.0, 2.0), start | {"x": np.zeros(3)}, numbers, events=[kick])
    assert merged(run) == [("slip",), ("stick",), ("slip",), ("stick",)]
    np.testing.assert_allclose([run["x"][-1], *sweep["x"]], 0.75, rtol=0, atol=1e-9)


def test_a_rod_at_rest_up_to_rounding_stays_at_rest_after_an_event():
    """The event scales rates of 1e-31 to 1e-48, which are neither an impact nor slip."""
    problem = runs.Problem(drawn("events", 13))
    for rtol in (1e-6, 1e-8, 1e-10):
        run = problem.simulated(rtol)
        assert run.success and len(run.events["kick"]) == 1
        assert merged(run) == [("stick", "stick", "open")], rtol
