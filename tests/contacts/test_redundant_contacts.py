"""Loads that contacts with friction share in more ways than one: refused where the motion or a law depends on that."""

import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError

N, O = ReferenceFrame("N"), Point("O")


def box(rough, quaternion, steps):
    """Return the model of a box on four corners, some of them rough, on planes of other heights."""
    x, y, z, *e = dynamicsymbols("x y z e0:4")
    T = ReferenceFrame("T")
    T.orient(N, "Quaternion", e) if quaternion else T.orient_body_fixed(N, e[:3], "zyx")
    C = O.locatenew("C", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("box", frame=N, origin=O, coordinates=[x, y, z, *(e if quaternion else e[:3])])
    if quaternion:
        scene.add_holonomic_constraints(sum(a**2 for a in e) - 1)
    scene.add_bodies(RigidBody("box", C, T, 2.0, (inertia(T, 0.1, 0.2, 0.25), C)))
    scene.apply_uniform_gravity(-10 * N.z)
    for i, (p, q) in enumerate([(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)]):
        corner = C.locatenew(f"corner{i}", p * T.x + q * T.y - (0.1 + i * steps) * T.z)
        plane = O.locatenew(f"plane{i}", -i * steps * N.z), N.z
        friction = 0.5 if i < rough else 0
        scene.add_contacts(da.PointPlane(f"p{i}", body="box", point=corner, plane=plane, friction=friction))
    return da.compile_model(scene)


@pytest.mark.parametrize("steps", [0.0, 0.05])
@pytest.mark.parametrize("quaternion", [True, False])
@pytest.mark.parametrize("rough", [1, 2])
def test_four_contacts_of_a_body_with_friction_are_named(rough, quaternion, steps):
    model = box(rough, quaternion, steps)
    stick = {f"p{i}": "stick" if i < rough else "closed" for i in range(4)}
    with pytest.raises(ConstraintError, match=r"'p0', 'p1', 'p2', 'p3' share a load .* at most three contacts"):
        model.mode(**stick)
    shared = r"friction 'p0' needs p0.normal, which .* 'p0', 'p1', 'p2', 'p3' share a load: let at most three contacts"
    with pytest.raises(ConstraintError, match=shared):
        model.mode(**{name: state.replace("stick", "slip") for name, state in stick.items()})


@pytest.mark.parametrize("rough", [1, 2])
def test_three_of_these_contacts_are_a_mode(rough):
    names = box(rough, True, 0.0).mode(p0="stick", p1="stick" if rough > 1 else "closed", p2="closed", p3="open").layout
    assert {"p0.normal", "p1.normal", "p2.normal"} <= {*names.unknowns}


def pressed(free, mu, *, planar=False):
    """Return the run of a block that a force presses against a plate, which slides along it.

    Friction at the floor is along the force, or planar: then the plate keeps the block from slipping along the force.
    """
    x, y, z, s = dynamicsymbols("x y z s")
    P = sp.Symbol("P", positive=True)
    scene = da.Scene("pressed", frame=N, origin=O, coordinates=[x, y, *([z] if planar else []), *([s] if free else [])])
    B, W = O.locatenew("B", x * N.x + y * N.y + (z * N.z if planar else 0)), O.locatenew("W", s * N.y)
    scene.add_bodies(Particle("block", B, 1))
    if free:
        scene.add_bodies(Particle("plate", W, 1))
    scene.apply_uniform_gravity(-10 * N.y)
    scene.add_loads((B, P * N.x))
    n, f, e, c, d = da.unknowns("n f e c d")
    speed = s.diff() if free else 5
    other = {"other": "plate"} if free else {}
    scene.add_joints(
        da.Joint("floor", body="block", at=B, force=(f * N.x if mu else 0) + (e * N.z if planar else 0) + n * N.y)
    )
    scene.add_joints(da.Joint("wall", body="block", at=B, force=-c * N.x + d * N.y, **other))
    scene.add_contacts(da.UnilateralContact(n, gap=y, name="floor"), da.UnilateralContact(c, gap=-x, name="wall"))
    scene.add_friction(da.CoulombFriction(c, d, mu=0.3, slip=y.diff() - speed, name="wall"))
    if mu:
        scene.add_friction(da.CoulombFriction(n, (f, e) if planar else f, mu=mu, name="floor"))
    start = dict.fromkeys(("x", "y", "x_dot", "y_dot"), 0.0) | ({"s": 0.0, "s_dot": 5.0} if free else {})
    start |= {"z": 0.0, "z_dot": 0.0} if planar else {}
    return da.compile_model(scene, outputs=["n", "c"]).simulate((0.0, 0.3), start, {"P": 10.0})


@pytest.mark.parametrize("planar", [False, True])
def test_a_plate_slides_where_the_floor_may_take_a_part_of_what_presses_it(planar):
    """What friction at the floor takes of P decides how the plate slows down."""
    with pytest.raises(ConstraintError, match=r"keep 'floor' from slipping, .* presses 'wall', which slides"):
        pressed(True, 0.5, planar=planar)


def test_a_plate_slides_where_nothing_shares_what_presses_it():
    run = pressed(True, 0)
    assert run.success and run["s_dot"][-1] == pytest.approx(5 - (10 + 0.3 * 10) * 0.3, abs=1e-9)


@pytest.mark.parametrize("planar", [False, True])
def test_a_block_rests_whatever_the_floor_takes_of_what_presses_it(planar):
    """The wall is a belt: its friction moves nothing."""
    run = pressed(False, 0.5, planar=planar)
    assert run.success and abs(run["x"][-1]) < 1e-12 and abs(run["y"][-1]) < 1e-12
