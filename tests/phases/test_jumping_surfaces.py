"""Surfaces in contact whose velocity jumps: refused by name while the contact is closed."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import CapabilityError, SceneError

t = dynamicsymbols._t
x, y, u = dynamicsymbols("x y u")
g = sp.Symbol("g", positive=True)

BELT = {"x": 0, "x_dot": 0, "y": 0, "y_dot": 0}


def belt(speed, floor=0, **options):
    """A block of mass 1 on a belt of a given speed, at a given height; the coefficient of friction is 3/10."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("belt", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("P", P, 1))
    scene.apply_uniform_gravity(-g * N.y)
    n, f = da.unknowns("n f")
    scene.add_joints(da.Joint("belt", body="P", at=P, force=n * N.y + f * N.x))
    scene.add_contacts(da.UnilateralContact(normal=n, gap=y - floor, name="belt"))
    scene.add_friction(da.CoulombFriction(n, f, mu=sp.Rational(3, 10), slip=x.diff() - speed, name="belt", **options))
    return scene


@pytest.mark.parametrize("smooth", [False, True])
def test_controllers_of_belt_speeds_are_refused_for_belts_that_hold(smooth):
    """A belt whose speed jumps would take a block that sticks along; the smooth law never holds it."""
    scene = belt(u, regularization=sp.Rational(1, 1000) if smooth else None)
    scene.add_inputs(u)
    scene.add_controllers(da.Controller("drive", period=1, inputs={u: 1}))
    if smooth:
        run = da.compile_model(scene).simulate((0, 1), BELT, {g: 10.0}, rtol=1e-6)
        assert run.success
    else:
        with pytest.raises(SceneError, match=r"slip velocity of 'belt': it depends on u, which jump at sampling"):
            da.compile_model(scene)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize(
    ("speed", "floor", "what"),
    [
        (sp.Piecewise((1, t < 1), (-2, True)), 0, r"the slip velocity of 'belt'"),
        (0, sp.Max(0, t - 1), r"the rate of the gap of 'belt'"),
        (0, -sp.Max(0, t - 1), r"the rate of the gap of 'belt'"),
    ],
    ids=["belt turns", "floor strikes", "floor drops"],
)
def test_surfaces_that_are_set_in_motion_at_once_are_refused(speed, floor, what, backend):
    """Rates of the block jumped with the belt, beyond all friction, and the run ended with SUCCESS."""
    model = da.compile_model(belt(speed, floor), backend=backend)
    with pytest.raises(CapabilityError, match=rf"at t = 1 a prescribed velocity jumps, and with it {what}"):
        model.simulate((0, 3), BELT, {g: 10.0})
    with pytest.raises(CapabilityError, match=what):
        model.sweep((0, 3), BELT, {g: np.array([9.0, 10.0])})
    assert model.simulate((0, 0.9), BELT, {g: 10.0}).success


def test_a_belt_that_turns_round_in_a_short_time():
    """The block sticks at speed 1 from 1/3 s on, and slips from 1 s until it has come to -2, deceleration 3."""
    steep = sp.Max(-2, sp.Min(1, 1 - 1000 * (t - 1)))
    for method in ("auto", "radau"):
        run = da.compile_model(belt(steep)).simulate((0, 3), BELT, {g: 10.0}, t_eval=[1, 1.5, 3], method=method)
        assert run["x"] == pytest.approx([5 / 6, 5 / 6 + 0.5 - 0.375, 5 / 6 - 2.5], abs=1e-5)
        assert [phase.modes["belt"] for phase in run.phases] == ["slip", "stick", "slip", "stick"]


@pytest.mark.parametrize(
    ("last", "modes", "ends", "speed"),
    [
        (-1.0, ["slip", "slip", "stick"], [0.2, 11 / 15], -1.0),
        (0.5, ["slip", "slip", "stick"], [0.2, 0.7 / 3], 0.5),
        (0.59, ["slip", "slip", "stick"], [0.2, 0.2 + 0.01 / 3], 0.59),
        (0.9, ["slip", "stick"], [0.3], 0.9),
        (4.0, ["slip"], [], 3.0),
    ],
)
def test_a_block_that_slips_when_the_belt_turns_slips_on(last, modes, ends, speed):
    """Slip velocity 3 t - 1 until 0.2 s: after the jump it has the other sign, or the same, and is not zero.

    The block stuck at once, and its rate jumped with the belt.
    """
    model = da.compile_model(belt(sp.Piecewise((1, t < 0.2), (last, True))))
    friction = 3.0 if last > 0.6 else -3.0
    end = ends[-1] if ends else 1.0
    x_end = 0.06 + 0.6 * (end - 0.2) + friction / 2 * (end - 0.2) ** 2 + (last * (1 - end) if ends else 0)
    for method in ("taylor", "dop853", "tsit5", "radau"):
        run = model.simulate((0, 1), BELT, {g: 10.0}, method=method, rtol=1e-10)
        assert [phase.modes["belt"] for phase in run.phases] == modes
        assert [phase.t1 for phase in run.phases][:-1] == pytest.approx(ends, abs=1e-7)
        assert [run["x"][-1], run["x_dot"][-1]] == pytest.approx([x_end, speed], abs=1e-7)
    swept = model.sweep((0, 1), BELT, {g: np.array([10.0, 10.0])}, rtol=1e-10)
    assert swept["x"] == pytest.approx([x_end, x_end], abs=1e-7)
