"""Contacts whose gap has a kink, which ends a run while they are closed, and is nothing while they are open."""

import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import SceneError
from dalembert.methods.status import Status
from dalembert.scene.reading import read

N, O = ReferenceFrame("N"), Point("O")
x, z = dynamicsymbols("x z")
m, g = sp.symbols("m g", positive=True)

WALLS = {
    "absolute value": sp.Abs(x),
    "root": sp.sqrt(x**2),
    "hidden square": sp.sqrt(1 - sp.cos(x) ** 2) + x**2 / 1000,
    "largest": sp.Max(x, -x),
    "branches": sp.Piecewise((x, x > 0), (-x, True)),
}


def groove(gap, slope):
    """Return a scene of a bead above a groove along N.y, whose right side has a slope."""
    Z, place = da.unknowns("Z"), O.locatenew("P", x * N.x + z * N.z)
    scene = da.Scene("groove", frame=N, origin=O, coordinates=[x, z])
    scene.add_bodies(Particle("bead", place, m))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_joints(da.Joint("wall", body="bead", at=place, force=Z * (N.z - slope * N.x)))
    scene.add_contacts(da.UnilateralContact(Z, gap, name="wall"))
    return scene


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
@pytest.mark.parametrize("wall", WALLS)
def test_a_bead_that_slides_to_the_corner_is_no_success(wall, method):
    """It came out on the other side, as fast as it came in."""
    height = WALLS[wall]
    slope = sp.sign(x) if wall in ("absolute value", "largest", "branches") else sp.diff(height, x)
    model, p = da.compile_model(groove(z - height, slope)), {m: 1, g: 9.81}
    start = float(height.subs(x, 0.5))
    run = model.simulate((0, 2), {x: 0.5, z: start, x.diff(): 0, z.diff(): 0}, p, method=method)
    assert run.status is Status.CONTACT_UNSUPPORTED and "a gap of 'wall' has a kink" in run.message
    assert abs(run["x"][-1]) < 1e-7 and 0.3 < run.t[-1] < 0.6
    flight = model.simulate((0, 0.2), {x: 0.3, z: 1.0, x.diff(): -3, z.diff(): 0}, p, method=method)
    assert flight.success and len(flight.phases) == 1 and flight["x"][-1] == pytest.approx(-0.3)


def test_a_hidden_square_that_loses_its_digits_is_no_success_either():
    """Of 2 - 2 cos(x)**2 rounding is all that is left next to x = 0, so that the run may end before."""
    height = sp.sqrt(2 - 2 * sp.cos(x) ** 2) + x**2 / 1000
    model = da.compile_model(groove(z - height, sp.diff(height, x)))
    start = {x: 0.5, z: float(height.subs(x, 0.5)), x.diff(): 0, z.diff(): 0}
    for method in ("taylor", "dop853", "radau"):
        run = model.simulate((0, 2), start, {m: 1, g: 9.81}, method=method)
        assert not run.success and abs(run["x"][-1]) < 1e-3


@pytest.mark.parametrize("gap", [z - sp.floor(x), z - sp.sqrt(2 - 2 * sp.cos(x))])
def test_kinks_that_are_not_known_are_refused(gap):
    with pytest.raises(SceneError, match="contact 'wall': the gradient of its gap jumps at a kink or a jump of"):
        da.compile_model(groove(gap, sp.Integer(0)), backend="numpy")


@pytest.mark.parametrize("gap", [z - x * sp.Abs(x), sp.sqrt(x**2 + z**2) - 1, z - sp.sqrt(sp.sin(x) ** 2 + 1)])
def test_smooth_gaps_have_no_kinks(gap):
    assert [contact.kinks for contact in read(groove(gap, sp.Integer(0))).contacts] == [()]
