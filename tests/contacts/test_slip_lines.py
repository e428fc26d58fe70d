"""Contacts with friction in a plane whose slip constraints leave one direction: guides on a table, and walls."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import ConstraintError
from dalembert.methods.status import Status
from fuzz.contacts.scenes import compiled

TIME = dynamicsymbols._t
MU, G = sp.Rational(3, 10), 10


def block(load, *, guide=None, planar=True, walls=()):
    """Return a block of mass 1 on a rough table, under a load (x, y), with a guide g(x, y) = 0 and walls.

    Its law of friction is `planar`, or along the guide alone. Walls are places and normals (x, y).
    """
    x, y, z = q = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("block", frame=N, origin=O, coordinates=q)
    scene.add_bodies(Particle("block", P, 1))
    scene.add_loads((P, load[0] * N.x + load[1] * N.y - G * N.z))
    across = sp.Matrix([guide.diff(x), guide.diff(y)]) if guide is not None else sp.Matrix([1, 0])
    across = across / sp.sqrt(across.dot(across))
    if guide is not None:
        H = da.unknowns("H")
        scene.add_joints(da.Joint("guide", body="block", at=P, force=H * (across[0] * N.x + across[1] * N.y)))
        scene.add_holonomic_constraints(guide)
    R, A, B = da.unknowns("R A B")
    along = -across[1] * N.x + across[0] * N.y
    force = A * N.x + B * N.y if planar else A * along
    scene.add_joints(da.Joint("floor", body="block", at=P, force=R * N.z + force))
    scene.add_contacts(da.UnilateralContact(R, z, name="floor", restitution=0))
    scene.add_friction(da.CoulombFriction(R, (A, B) if planar else A, mu=MU, name="floor"))
    for i, (place, normal) in enumerate(walls):
        W = O.locatenew(f"W{i}", place[0] * N.x + place[1] * N.y)
        plane = W, normal[0] * N.x + normal[1] * N.y
        scene.add_contacts(da.PointPlane(f"wall{i}", body="block", point=P, plane=plane))
    return scene, (x, y, z)


START = dict.fromkeys(("x", "y", "z", "x_dot", "y_dot", "z_dot"), 0.0)
LOAD = 2 * TIME, 3 * TIME * sp.cos(TIME)


@pytest.mark.parametrize(
    ("guide", "start"),
    [
        (lambda x, y: x - y, {}),
        (lambda x, y: 3 * x + 4 * y, {}),
        (lambda x, y: y, {}),
        (lambda x, y: x**2 + (y - 1) ** 2 - 1, {}),
        (lambda x, y: x**2 + (y - 1) ** 2 - 1, {"x": 1.0, "y": 1.0}),
        (lambda x, y: y - sp.sin(2 * x), {"x": 0.3, "y": np.sin(0.6)}),
    ],
    ids=["diagonal", "decline", "axis", "circle", "side of a circle", "wave"],
)
def test_friction_in_the_plane_is_that_along_the_guide(guide, start):
    """Stick, slip, rest: the motion, and when it sticks, are those of a law with one direction."""
    x, y, _ = dynamicsymbols("x y z")
    scenes = [block(LOAD, guide=guide(x, y), planar=planar)[0] for planar in (True, False)]
    models = [da.compile_model(scene, outputs=["H"]) for scene in scenes]
    plane, line = (model.simulate((0, 6), START | start, {}, rtol=1e-10, atol=1e-10) for model in models)
    assert plane.status == line.status == Status.SUCCESS
    sticks, others = ([p for p in run.phases if p.modes["floor"] == "stick"] for run in (plane, line))
    assert len(sticks) == len(others) > 0 and len(plane.phases) > len(sticks)
    for one, other in zip(sticks, others, strict=True):
        assert one.t0 == pytest.approx(other.t0, abs=1e-8) and one.t1 == pytest.approx(other.t1, abs=1e-8)
    t = np.linspace(0, 6, 61)
    for name in ("x", "y", "x_dot", "y_dot"):
        np.testing.assert_allclose(plane(t)[name], line(t)[name], rtol=0, atol=1e-8)
    sweep = models[0].sweep((0, 6), START | start | {"z": np.zeros(3)}, {}, rtol=1e-10, atol=1e-10)
    for name in ("x", "y", "x_dot", "y_dot"):
        np.testing.assert_allclose(sweep[name], plane[name][-1], rtol=0, atol=1e-8)


def test_friction_is_along_the_guide_while_the_block_sticks():
    x, y, _ = dynamicsymbols("x y z")
    scene, _ = block((TIME, 0), guide=x - y)
    run = da.compile_model(scene, outputs=["A", "B", "H"]).simulate((0, 3), START, {})
    assert [phase.modes["floor"] for phase in run.phases] == ["stick"]
    np.testing.assert_allclose(run["A"], -run.t / 2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run["B"], run["A"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.abs(run["H"]), run.t / np.sqrt(2), rtol=0, atol=1e-12)


def test_friction_at_the_side_of_a_circle_is_along_its_tangent():
    """There the slip velocity vanishes along x, of which that along y is a share without bound."""
    x, y, _ = dynamicsymbols("x y z")
    scene, _ = block((2 * TIME, -TIME), guide=x**2 + (y - 1) ** 2 - 1)
    run = da.compile_model(scene, outputs=["A", "B"]).simulate((0, 2), START | {"x": -1.0, "y": 1.0}, {})
    assert run.status == Status.SUCCESS and [phase.modes["floor"] for phase in run.phases] == ["stick"]
    np.testing.assert_allclose(run["A"], 0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run["B"], run.t, rtol=0, atol=1e-12)


def test_the_block_breaks_away_where_the_load_along_the_guide_overcomes_friction():
    x, y, _ = dynamicsymbols("x y z")
    scene, _ = block((TIME, 0), guide=x - y)
    run = da.compile_model(scene).simulate((0, 6), START, {}, rtol=1e-10, atol=1e-10)
    begin = 3 * np.sqrt(2)  # t / sqrt(2) = mu m g
    assert run.phases[0].t1 == pytest.approx(begin, abs=1e-8)
    T = 6 - begin
    assert run["x"][-1] == pytest.approx(T**3 / 12, rel=1e-8)  # acceleration along the guide (t - begin) / sqrt(2)


WALL = [((1, 0), (-1, 0))]
AT_WALL = START | {"x": 1.0}


def test_a_puck_comes_to_rest_at_a_wall():
    """It strikes the wall, slides along it and stops after v^2 / (2 mu g); friction has nothing left to hold."""
    scene, _ = block((0, 0), walls=WALL)
    model = da.compile_model(scene, outputs=["A", "B", "wall0.normal"])
    run = model.simulate((0, 6), START | {"x_dot": 3, "y_dot": 2}, {}, rtol=1e-10, atol=1e-10)
    assert run.status == Status.SUCCESS and run.phases[-1].modes == {"floor": "stick", "wall0": "closed"}
    speed = np.sqrt(13 - 2 * 3 * np.sqrt(13) / 3)  # after a way of sqrt(13) / 3 on the table, friction is 3 N
    along = speed * 2 / np.sqrt(13)
    assert run["x"][-1] == pytest.approx(1, abs=1e-12)
    assert run["y"][-1] == pytest.approx(2 / 3 + along**2 / 6, abs=1e-9)
    for name in ("A", "B", "wall0.normal", "x_dot", "y_dot"):
        assert abs(run[name][-1]) < 1e-9


@pytest.mark.parametrize("pull", [-2.0, -0.5, 0.0, 0.5, 4.0])
def test_a_puck_at_a_wall_breaks_away_where_no_share_of_the_load_holds_it(pull):
    """The wall takes what presses on it, whatever that is; what pulls away from it is held by friction."""
    scene, _ = block((pull, TIME), walls=WALL)
    model = da.compile_model(scene, outputs=["A", "B", "wall0.normal"])
    run = model.simulate((0, 4), AT_WALL, {}, rtol=1e-10, atol=1e-10)
    assert run.status == Status.SUCCESS
    stick = [phase for phase in run.phases if phase.modes["floor"] == "stick"]
    assert stick[-1].t1 == pytest.approx(np.sqrt(9 - min(pull, 0) ** 2), abs=1e-8)
    t = np.linspace(0.01, 2.2, 50)
    held = run(t)
    np.testing.assert_allclose(held["A"], -min(pull, 0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(held["B"], -t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.abs(held["wall0.normal"]), max(pull, 0), rtol=0, atol=1e-9)
    if pull >= 0:  # it slides along the wall
        T = 4 - 3
        assert run["y"][-1] == pytest.approx(T**3 / 6, abs=1e-8) and run["x"][-1] == pytest.approx(1, abs=1e-12)


def test_a_push_that_turns_from_the_wall_away():
    """The wall lets go where the push vanishes, friction holds on, and the puck leaves at 3 N."""
    scene, _ = block((2 - TIME, 0), walls=WALL)
    model = da.compile_model(scene, outputs=["A", "wall0.normal"])
    run = model.simulate((0, 6), AT_WALL, {}, rtol=1e-10, atol=1e-10)
    assert [(p.modes["floor"], p.modes["wall0"]) for p in run.phases][:2] == [("stick", "closed"), ("stick", "open")]
    assert run.phases[0].t1 == pytest.approx(2, abs=1e-8) and run.phases[1].t1 == pytest.approx(5, abs=1e-8)
    assert run["x"][-1] == pytest.approx(1 - 1 / 6, abs=1e-8)
    backwards = da.compile_model(block((TIME - 2, 0), walls=WALL)[0], outputs=["A", "wall0.normal"])
    run = backwards.simulate((0, 12), AT_WALL, {}, rtol=1e-10, atol=1e-10)
    assert run.status == Status.SUCCESS and run["x"][-1] == pytest.approx(1, abs=1e-12)
    assert len(run.phases) <= 4 and abs(run["wall0.normal"][-1]) <= 10 + 1e-9


def test_a_puck_in_a_corner_stays():
    """Neither slip is possible: both walls take the load, and friction takes none of it."""
    scene, _ = block((2, 3), walls=[*WALL, ((0, 0.5), (0, -1))])
    model = da.compile_model(scene, outputs=["A", "B", "wall0.normal", "wall1.normal"])
    run = model.simulate((0, 1), AT_WALL | {"y": 0.5}, {})
    assert run.status == Status.SUCCESS and len(run.phases) == 1
    last = {name: abs(run[name][-1]) for name in ("A", "B", "wall0.normal", "wall1.normal")}
    assert last == pytest.approx({"A": 0, "B": 0, "wall0.normal": 2, "wall1.normal": 3}, abs=1e-12)


@pytest.mark.parametrize(("pull", "leaves"), [(-2 - TIME**2, 1.0), (-2 - 0 * TIME, None), (-4 - TIME, 0.0)])
def test_friction_along_a_line_holds_what_pulls_from_a_wall(pull, leaves):
    """A wall does not pull: it is open at once, and friction holds up to 3 N."""
    x, z = dynamicsymbols("x z")
    N, O = ReferenceFrame("N"), Point("O")
    P, W = O.locatenew("P", x * N.x + z * N.z), O.locatenew("W", N.x)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, z])
    scene.add_bodies(Particle("block", P, 1))
    scene.add_loads((P, pull * N.x - G * N.z))
    scene.add_contacts(
        da.PointPlane("floor", body="block", point=P, plane=(O, N.z), friction=MU),
        da.PointPlane("wall", body="block", point=P, plane=(W, -N.x)),
    )
    model = da.compile_model(scene, outputs=["wall.normal"])
    run = model.simulate((0, 2), {"x": 1, "z": 0, "x_dot": 0, "z_dot": 0}, {}, rtol=1e-10, atol=1e-10)
    assert run.status == Status.SUCCESS and np.all(run["wall.normal"] == 0.0)
    slides = [phase.t0 for phase in run.phases if phase.modes["floor"] == "slip"]
    if leaves is None:
        assert not slides and run["x"][-1] == 1.0
    else:
        assert slides[0] == pytest.approx(leaves, abs=1e-8) and run["x"][-1] < 0.9


def test_a_case_whose_mode_is_not_supported_does_not_end_a_sweep():
    """A puck that stops at a rough wall; others stop before it, or slide along it."""
    x, y, z = q = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    P, W = O.locatenew("P", x * N.x + y * N.y + z * N.z), O.locatenew("W", N.x)
    scene = da.Scene("puck", frame=N, origin=O, coordinates=q)
    scene.add_bodies(Particle("puck", P, 1))
    scene.add_loads((P, -G * N.z))
    scene.add_contacts(
        da.PointPlane("floor", body="puck", point=P, plane=(O, N.z), friction=MU),
        da.PointPlane("wall", body="puck", point=P, plane=(W, -N.x), friction=MU),
    )
    model = da.compile_model(scene)
    start = START | {"x_dot": np.array([1.0, 3.0, 3.0]), "y_dot": np.array([0.0, 2.0, 9.0])}
    times = [0.0, 0.25, 2.0]
    sweep = model.sweep((0, 2), start, {}, t_eval=times)
    assert list(sweep.status) == [Status.SUCCESS, Status.CONTACT_UNSUPPORTED, Status.SUCCESS]
    alone = {name: value if np.ndim(value) == 0 else value[1] for name, value in start.items()}
    with pytest.raises(ConstraintError, match="hold each other while they stick"):
        model.simulate((0, 2), alone, {})
    run = model.simulate((0, sweep.t[1] - 1e-9), alone, {})
    assert run.status == Status.SUCCESS and sweep.phases[1] == len(run.phases)
    assert sweep.final["y"][1] == pytest.approx(run["y"][-1], abs=1e-8)
    np.testing.assert_allclose(sweep["y"][1], [0.0, run([0.25])["y"][0], np.nan], rtol=0, atol=1e-8)
    with pytest.raises(ConstraintError, match="hold each other while they stick"):
        model.sweep((0, 2), alone | {"x": np.zeros(2)}, {})


@pytest.mark.parametrize("first", [True, False])
def test_friction_in_a_plane_that_shares_its_load_with_that_along_a_line_is_named(first):
    """A block between a table and a plate that cannot move along x; what the two hold together is not computed."""
    x, y, z, w = q = dynamicsymbols("x y z w")
    N, O = ReferenceFrame("N"), Point("O")
    P, Q = O.locatenew("P", x * N.x + y * N.y + z * N.z), O.locatenew("Q", w * N.z)
    scene = da.Scene("pressed", frame=N, origin=O, coordinates=q)
    scene.add_bodies(Particle("block", P, 1), Particle("plate", Q, 1))
    scene.add_loads((P, TIME * N.x - G * N.z), (Q, -G * N.z))
    R, A, B, S, C = da.unknowns("R A B S C")
    scene.add_joints(da.Joint("floor", body="block", at=P, force=R * N.z + A * N.x + B * N.y))
    scene.add_joints(da.Joint("roof", body="block", at=P, force=C * N.x - S * N.z))
    scene.add_joints(da.Joint("weight", body="plate", at=Q, force=S * N.z))
    floor = da.UnilateralContact(R, z, name="floor", restitution=0), da.CoulombFriction(R, (A, B), mu=MU, name="floor")
    roof = da.UnilateralContact(S, w - z, name="roof", restitution=0), da.CoulombFriction(S, C, mu=MU, name="roof")
    for contact, law in (floor, roof) if first else (roof, floor):
        scene.add_contacts(contact)
        scene.add_friction(law)
    model = da.compile_model(scene)
    start = {name: 0.0 for v in "xyzw" for name in (v, f"{v}_dot")}
    with pytest.raises(ConstraintError, match="hold each other while they stick"):
        model.simulate((0, 9), start, {})


@pytest.mark.parametrize("rtol", [3e-7, 1e-6])
def test_a_puck_that_hops_at_a_wall_comes_to_rest_there(rtol):
    """It slides along another wall; the last hops are smaller than what rounding makes of a longer way."""
    p = {"m": 2.498, "g_x": 3.603, "g_y": 2.624, "g_z": 9.81, "mu": 0.331, "e": 0.15, "a": 0.0, "b": 0.0}
    p |= {"A": 0.0, "omega": 1.53, "B": 0.0, "nu": 1.527}
    start = START | {"y": -0.25, "x_dot": -1.872}
    run = compiled("puck").simulate((0, 1.2), start, p, rtol=rtol, atol=1e-2 * rtol)
    assert run.status == Status.SUCCESS
    assert run.phases[-1].modes == {"table": "stick", "right": "closed", "left": "closed"}
    np.testing.assert_allclose(run.q[-1], 0, rtol=0, atol=1e-15)
