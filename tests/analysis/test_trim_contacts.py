"""Equilibria of scenes with contacts, against closed forms."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import InitialStateError, OptionError

x, y, F = dynamicsymbols("x y F")
m, g, k, mu, lift, stiffness = sp.symbols("m g k mu lift stiffness", positive=True)
REST = {x: 0.0, y: 0.0, x.diff(): 0.0, y.diff(): 0.0}
WEIGHT = 9.81
SPRUNG = {m: 1.0, g: WEIGHT, k: 2.0, lift: 1.0, stiffness: 4.0}
RUBBING = {m: 1.0, g: WEIGHT, k: 2.0, mu: 0.3}


def block(*, friction):
    """Return a block on a floor, pulled by a spring; without friction it is lifted the more, the further it is."""
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("P", x * frame.x + y * frame.y)
    scene = da.Scene("block", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("block", place, m))
    scene.apply_uniform_gravity(-g * frame.y)
    scene.add_inputs(F)
    up = 0 if friction else lift * x - stiffness * y
    scene.add_loads((place, (F - k * x) * frame.x + up * frame.y))
    R, T = da.unknowns("R T")
    force = R * frame.y + (T * frame.x if friction else 0 * frame.x)
    scene.add_joints(da.Joint("floor", body="block", at=place, force=force))
    scene.add_contacts(da.UnilateralContact(R, gap=y, name="floor"))
    if friction:
        scene.add_friction(da.CoulombFriction(R, T, mu=mu))
    return scene


@cache
def lifted():
    return da.compile_model(block(friction=False))


@cache
def rubbing():
    return da.compile_model(block(friction=True))


@pytest.mark.parametrize("height", [0.0, -0.01, 0.5])
def test_a_contact_that_pushes_at_the_equilibrium_is_closed_there(height):
    """Also from guesses that penetrate, or from which the equilibrium without the contact lies below the floor."""
    point = lifted().trim({**REST, y: height}, SPRUNG, inputs={F: 3.0})
    assert point.converged
    assert "floor: closed" in point.message
    np.testing.assert_allclose([point[x], point[y]], [1.5, 0.0], atol=1e-12)
    run = lifted().simulate((0, 1), point.initial, point.parameters, inputs=point.inputs)
    np.testing.assert_allclose(run["x"], 1.5, atol=1e-9)


def test_a_contact_that_would_pull_is_open_at_the_equilibrium():
    """At the guess the block rests on the floor; where the spring lets it go, it hangs."""
    point = lifted().trim(REST, {**SPRUNG, lift: 10.0}, inputs={F: 3.0})
    assert point.converged
    assert "floor: open" in point.message
    np.testing.assert_allclose([point[x], point[y]], [1.5, (15 - WEIGHT) / 4], rtol=1e-12)


def test_friction_holds_a_block_where_it_can_and_lets_it_slide_to_where_it_does():
    held = rubbing().trim({**REST, x: 1.0}, RUBBING, inputs={F: 0.0})
    assert held.converged
    assert held[x] == 1.0
    assert held.undetermined == ("x",)
    slid = rubbing().trim({**REST, x: 2.0}, RUBBING, inputs={F: 0.0})
    assert slid.converged
    np.testing.assert_allclose(slid[x], 0.3 * WEIGHT / 2, rtol=1e-9)
    force = rubbing().trim({**REST, x: 2.0}, RUBBING, inputs={F: 0.0}, free=(name for name in ["F"]))
    assert force.converged
    np.testing.assert_allclose(force["F"], 4 - 0.3 * WEIGHT, rtol=1e-9)


def test_what_has_no_equilibrium_in_its_mode_or_is_no_guess_is_refused():
    """A block in the air falls: nothing that is free holds it."""
    with pytest.raises(OptionError, match="conditions are to be met"):
        rubbing().trim({**REST, y: 1.0}, RUBBING, inputs={F: 0.0}, free=[x])
    with pytest.raises(InitialStateError, match="missing for"):
        rubbing().trim({y: 1.0, y.diff(): 0.0}, RUBBING, inputs={F: 0.0})


def test_assembled_guesses_lie_on_what_they_penetrate():
    """Positions and rates of a contact that is closed; one with a gap stays open, and only positions change then."""
    model = rubbing()
    found = model.assemble({x: 1.0, y: -0.3, x.diff(): 2.0, y.diff(): -1.0}, RUBBING, inputs={F: 0.0})
    assert found == {"x": 1.0, "y": pytest.approx(0.0, abs=1e-12), "x_dot": 2.0, "y_dot": pytest.approx(0.0, abs=1e-12)}
    above = {"x": 1.0, "y": 0.2, "x_dot": 2.0, "y_dot": -1.0}
    assert model.assemble(above, RUBBING, inputs={F: 0.0}) == above
    with pytest.raises(InitialStateError, match="cannot be assembled from this guess"):
        model.assemble({x: 0, y: -0.3}, RUBBING, inputs={F: 0.0}, fixed=[y])
