"""Some random scenes with contacts against Moreau-Jean time stepping; ``make fuzz`` runs as many as wanted."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fuzz.contacts import compare
from fuzz.contacts.compare import examine
from fuzz.contacts.families import FAMILIES, drawn
from fuzz.contacts.invariants import violations
from fuzz.contacts.moreau_jean import integrated
from fuzz.contacts.scenes import SCENES, compiled, setting
from fuzz.contacts.systems import SYSTEMS
from fuzz.contacts.uniqueness import motions
from fuzz.driven.equations import PREFIX

FIXED = {
    "particle": (3, 44, 56, 73),
    "stack": (21, 17, 37, 1004),
    "rod on floor": (1, 21, 36),
    "rod in corner": (2, 21, 49, 61, 167),
    "plate": (41, 1, 46, 58, 136),
    "wheel": (0, 9, 25, 64),
    "slot": (26, 37, 49),
    "chain": (3, 8, 27, 38, 42, 56, 87, 172, 4005, 9749),
    "disc": (5, 8, 32, 39, 5135, 5280),
    "puck": (9917, 9908, 9953, 9943, 35, 52, 99, 4, 152, 176, 182),
    "pendulum": (1, 32, 41, 48, 53, 127, 4047),
}
KEPT = 1
"""Seeds of each family that run in `make test`; the others are matrix."""

PARTICLE = ("m", "g_x", "g_y", "k", "c", "x_0", "A", "omega", "phi", "B", "C", "nu", "belt", "mu", "mu_s", "e")


ROWS = [
    pytest.param(family, seed, marks=[pytest.mark.matrix] if place >= KEPT else [])
    for family, seeds in FIXED.items()
    for place, seed in enumerate(seeds)
]


@pytest.mark.parametrize("family, seed", ROWS)
def test_a_random_scene_agrees_with_the_reference(family, seed):
    report = examine(drawn(family, seed), steps=1000)
    assert (report.outcome, report.found) == ("agree", [])


def test_every_family_is_drawn_and_every_scene_has_its_equations():
    assert set(FIXED) == set(FAMILIES)
    scenes = {drawn(family, seed).scene for family in FAMILIES for seed in range(30)}
    assert scenes == set(SCENES)
    own = {name for name in SYSTEMS if not name.startswith(PREFIX)}  # tests of driven scenes add others
    assert {setting(name).system for name in SCENES} == own


# -- the checks fail where they must -----------------------------------------------------------------


def test_a_scene_that_differs_a_little_is_wrong(monkeypatch):
    case = drawn("particle", 44)
    heavier = compiled(case.scene)
    monkeypatch.setattr(compare, "_run", lambda model, given, p, rtol: _heavier(heavier, given, p, rtol))
    report = examine(case, steps=100)
    assert report.outcome == "WRONG"
    assert any(text.startswith(("positions", "velocities")) for text in report.found)


@pytest.mark.parametrize("factor, outcome", [(1.0, "set aside"), (1.01, "WRONG")])
def test_two_references_that_miss_the_same_impacts_make_nothing_wrong(factor, outcome, monkeypatch):
    """Three masses strike a wall, at the end within 1e-14 s: no reference resolves that, and two of four agree."""
    own = compare._run

    def run(model, case, parameters, rtol):
        return own(model, case, parameters | {"m1": factor * parameters["m1"]}, rtol)

    monkeypatch.setattr(compare, "_run", run)
    report = examine(drawn("chain", 4136))
    assert report.outcome == outcome
    compared = [text for text in report.found if text.startswith(("positions", "velocities"))]
    assert len(compared) == (outcome == "WRONG")


def _heavier(model, case, parameters, rtol):
    other = parameters | {"m": 1.01 * parameters["m"]}
    return model.simulate((0.0, case.span), case.initial, other, rtol=rtol, atol=rtol * 1e-2)


class _Altered:
    """A run one of whose outputs is altered."""

    def __init__(self, run, name, change):
        self._run, self._name, self._change = run, name, change

    def __getattr__(self, name):
        return getattr(self._run, name)

    def __call__(self, t):
        return _Altered(self._run(t), self._name, self._change)

    def __getitem__(self, name):
        return self._change(self._run[name]) if name == self._name else self._run[name]


@pytest.mark.parametrize(
    "name, change, kind",
    [
        ("F", lambda F: -F, "friction against slip"),
        ("F", lambda F: 1.001 * F, "|F| - mu N"),
        ("R", lambda R: -R, "N"),
        ("R", lambda R: R + 0.01, "velocity gained that forces do not explain"),
    ],
)
def test_wrong_reactions_are_violations(name, change, kind):
    case = replace(drawn("particle", 3), parameters=dict.fromkeys(PARTICLE, 0.0) | {"m": 1.0, "g_y": 9.81, "mu": 0.3})
    model, which = compiled("particle"), setting("particle")
    p = np.array([case.parameters[name] for name in which.parameters])
    start = {"x": 0.0, "y": 0.0, "x_dot": 3.0, "y_dot": 0.0}
    run = model.simulate((0.0, 0.5), start, {name: case.parameters[name] for name in model.layout.parameters})
    assert violations(which, p, run) == []
    found = violations(which, p, _Altered(run, name, change))
    assert any(text.removeprefix("floor: ").startswith(kind) for text in found), found


# -- the reference, where the motion is known ----------------------------------------------------------


def test_the_reference_slides_and_stops():
    """x = v^2 / (2 mu g) when it has stopped; the step is 1e-4 s."""
    p = np.array([1.0, 0.0, 9.81, *[0.0] * 4, 1.0, *[0.0] * 5, 0.3, 0.3, 0.0])
    q, v, rough = integrated("particle", p, np.zeros(2), np.array([2.0, 0.0]), 1.0, 10, 1000)
    assert rough == 0
    assert q[-1, 0] == pytest.approx(2.0**2 / (2 * 0.3 * 9.81), abs=2e-4) and v[-1, 0] == 0.0


def test_the_reference_bounces():
    """The third flight after being dropped from 0.5 m with e = 0.6, before the ball comes to rest."""
    p = np.array([1.0, 0.0, 9.81, *[0.0] * 4, 1.0, *[0.0] * 5, 0.3, 0.3, 0.6])
    falls = math.sqrt(2 * 0.5 / 9.81)
    lands = falls * (1 + 2 * 0.6 + 2 * 0.36)
    q, v, _ = integrated("particle", p, np.array([0.0, 0.5]), np.zeros(2), lands + 0.05, 1, 40_000)
    speed = 0.6**3 * 9.81 * falls
    assert v[-1, 1] == pytest.approx(speed - 9.81 * 0.05, abs=1e-3)
    assert q[-1, 1] == pytest.approx(speed * 0.05 - 9.81 * 0.05**2 / 2, abs=1e-4)


def test_trial_of_modes_knows_the_paradoxes_of_a_rod():
    """A rod that slides with its end on the floor: m p = 1 + 3 cos (cos - mu sin), b = l omega^2 sin - g."""
    l, g, mu = 1.0, 9.81, 2.0
    for theta in (0.3, 0.8, 1.1, 1.4):
        for omega in (0.0, 5.0):
            s, c = math.sin(theta), math.cos(theta)
            # the end b at the origin slides with -1; the centre lies at the distance l along the axis
            q, v = np.array([l * c, l * s, theta]), np.array([-1.0 - l * s * omega, l * c * omega, omega])
            p = np.array([1.0, l, g, 0.0, 1.0, mu, 0.0])
            found = motions("rod on floor", p, 0.0, q, v)
            sinks, away = 1 + 3 * c * (c - mu * s) < 0, l * omega**2 * s > g
            assert len(found) == (1 if not sinks else 2 if away else 0)


@pytest.mark.parametrize("t, expected", [(1.44, [("stick",)]), (1.46, [("slip",), ("stick",)]), (1.48, [("slip",)])])
def test_a_jammed_rod_may_rest_or_slip_for_a_while_before_it_must_slip(t, expected):
    """In both slots; it may from 1.4527 s on, where it slips with an acceleration that jumps, and must from 1.47527."""
    theta, l = 1.5538416456, 0.304
    p = np.array([1.778, l, 10.0, 9.238, 2.639, 0.18, 0.214])
    q = np.array([l * math.cos(theta), -l * math.sin(theta), theta])
    found = motions("trammel", p, t, q, np.zeros(3))
    resting = [("stick",) if np.max(np.abs(x)) < 1e-6 else ("slip",) for _, x in found]
    assert sorted(resting) == expected
