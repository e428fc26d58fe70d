"""Contacts by geometry make their joints, contacts and friction, and say what is wrong with them."""

import numpy as np
import pytest
from sympy import cos, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import InitialStateError, SceneError
from dalembert.methods.status import Status
from dalembert.scene.contacts.laws import UnilateralContact
from dalembert.scene.contacts.made import with_made_contacts

N, O = ReferenceFrame("N"), Point("O")
x, y, z, theta, X = dynamicsymbols("x y z theta X")
m, r, R, g, mu, w, v = symbols("m r R g mu w v", positive=True)
TIME = dynamicsymbols._t


def planar(*contacts, others=()):
    """Return a scene of a body in the plane of N.x and N.y."""
    scene = da.Scene("planar", frame=N, origin=O, coordinates=[x, y, theta, *others])
    scene.add_bodies(RigidBody("body", G, B, m, (inertia(B, 1, 2, 3), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_contacts(*contacts)
    return scene


def spatial(*contacts):
    """Return a scene of a ball in space."""
    scene = da.Scene("spatial", frame=N, origin=O, coordinates=[x, y, z])
    frame = ReferenceFrame("S")
    da.free_orientation(scene, frame)
    centre = O.locatenew("S_o", x * N.x + y * N.y + z * N.z)
    scene.add_bodies(RigidBody("ball", centre, frame, m, (inertia(frame, 1, 1, 1), centre)))
    scene.add_contacts(*(make(centre, frame) for make in contacts))
    return with_made_contacts(scene)


B = N.orientnew("B", "Axis", (theta, N.z))
G = O.locatenew("G", x * N.x + y * N.y)
P = G.locatenew("P", r * B.x)
FLOOR = (O, N.y)


def point(**changes):
    return da.PointPlane("heel", **({"body": "body", "point": P, "plane": FLOOR, "friction": mu} | changes))


def names(scene):
    return [str(x) for law in scene.frictions for x in np.atleast_1d(law.tangential)]


def test_one_tangent_in_the_plane_two_in_space():
    made = with_made_contacts(planar(point()))
    assert names(made) == ["heel.friction_1"]
    (joint,) = made.joints
    assert joint.at is P and str(joint.force) == "heel.friction_1*N.x + heel.normal*N.y"
    (contact,) = made.contacts
    assert (contact.gap - (y + r * sin(theta))).simplify() == 0
    ball = spatial(
        lambda G, S: da.SpherePlane("ball", body="ball", centre=G, radius=r, plane=(O, N.z), friction=mu),
        lambda G, S: da.SphereInBowl("bowl", body="ball", centre=G, radius=r, bowl=(O, R), friction=mu),
        lambda G, S: da.SphereInCylinder("pipe", body="ball", centre=G, radius=r, cylinder=(O, N.x, R), friction=mu),
    )
    assert names(ball) == [f"{name}.friction_{i}" for name in ("ball", "bowl", "pipe") for i in (1, 2)]
    assert str(ball.joints[0].force) == "ball.friction_1*N.x + ball.friction_2*N.y + ball.normal*N.z"


def test_the_scene_stays_as_it_was_declared():
    scene = planar(point())
    first, second = with_made_contacts(scene), with_made_contacts(scene)
    assert not scene.joints and not scene.frictions and len(scene.contacts) == 1
    assert first.contacts == second.contacts and with_made_contacts(first) is first


def test_tangents_of_a_sphere_are_perpendicular_unit_vectors():
    made = spatial(lambda G, S: da.SphereInBowl("bowl", body="ball", centre=G, radius=r, bowl=(O, R), friction=mu))
    ((force, _),) = made.joints[0].force.args
    symbols_of = {str(u): u for u in made.joints[0].force.free_symbols(N)}
    unknowns = [symbols_of[f"bowl.{name}"] for name in ("normal", "friction_1", "friction_2")]
    place = {x: 0.6 * 0.9, y: -0.8 * 0.9 * 0.6, z: -0.8 * 0.9 * 0.8, r: 0.1, R: 1.0}
    columns = np.array([[float(c.diff(u).subs(place)) for c in force] for u in unknowns])
    assert abs(columns @ columns.T - np.eye(3)).max() < 1e-14


def test_a_box_has_four_corners_in_the_plane_eight_in_space():
    def box(body, frame, centre, normal, *sizes):
        return da.BoxPlane("box", body=body, frame=frame, centre=centre, half_sizes=sizes, plane=(O, normal))

    flat = [with_made_contacts(planar(box("body", B, G, N.y, *sizes))) for sizes in ((r, R), (r, R, m))]
    for made in flat:
        assert [contact.name for contact in made.contacts] == [f"box.corner_{i}" for i in range(1, 5)]
    signs = [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    for contact, (i, j) in zip(flat[0].contacts, signs, strict=True):
        assert (contact.gap - (y + i * r * sin(theta) + j * R * cos(theta))).simplify() == 0
    assert len(spatial(lambda G, S: box("ball", S, G, N.z, r, r, r)).contacts) == 8
    assert len(spatial(lambda G, S: box("ball", S, G, N.z, r, r)).contacts) == 4


def test_friction_as_a_number_a_pair_or_a_law():
    def law(friction):
        (found,) = with_made_contacts(planar(point(friction=friction))).frictions
        return found.mu, found.mu_static, found.regularization

    assert law(0.3) == (0.3, None, None) and law((0.4, 0.3)) == (0.3, 0.4, None)
    assert law(da.CoulombFriction(mu=mu, regularization=1e-3)) == (mu, None, 1e-3)
    for none in (0, 0.0, None):
        assert not with_made_contacts(planar(point(friction=none))).frictions


@pytest.mark.parametrize(
    "contact, texts",
    [
        (point(body="foot"), ["'foot' is no body", "known: body"]),
        (point(point="P"), ["point= must be a Point", "'P'"]),
        (point(point=Point("Q")), ["'Q', is not located from 'O'"]),
        (point(plane=N.y), ["plane=", "2 values in a tuple"]),
        (point(plane=(O, 2 * N.y)), ["normal of plane= must be a unit vector", "2*N.y"]),
        (point(plane=(O, y)), ["must be a unit vector such as N.z"]),
        (point(plane=(O, ReferenceFrame("A").x)), ["No connecting orientation path", "A and N"]),
        (point(plane=(G, N.y)), ["moves with x, y", "other=..."]),
        (point(plane=(O, B.y)), ["moves with theta", "other=..."]),
        (point(friction="rough"), ["friction= must be a coefficient", "'rough'"]),
        (point(friction=(1, 2, 3)), ["(mu_static, mu)"]),
        (point(friction=da.CoulombFriction(da.unknowns("Z"), mu=1)), ["normal= of its own", "leave them out"]),
        (point(friction=(0.2, 0.3)), ["mu_static is 0.2, less than mu = 0.3"]),
        (point(restitution=2), ["restitution of contact 'heel' is 2", "between 0 and 1"]),
        (point(tangents=N.y), ["not perpendicular to the normal"]),
        (point(tangents=(N.x, N.x)), ["not perpendicular to the other"]),
        (point(tangents=(N.x, N.y, N.z)), ["1 or 2 values"]),
        (da.SpherePlane("s", body="body", centre=G, radius=-1, plane=FLOOR), ["radius= is -1", "must be positive"]),
        (da.SpherePlane("s", body="body", centre=G, radius=x, plane=FLOOR), ["expression of parameters", "x(t)"]),
        (da.DiscPlane("d", body="body", centre=G, radius=r, axis=N.y, plane=FLOOR), ["lies flat"]),
        (da.SphereInBowl("b", body="body", centre=G, radius=2, bowl=(O, 1)), ["2 must be smaller than", "1"]),
        (
            da.BoxPlane("b", body="body", frame="B", centre=G, half_sizes=(1, 1), plane=FLOOR),
            ["frame= must be a ReferenceFrame"],
        ),
        (da.BoxPlane("b", body="body", frame=B, centre=G, half_sizes=1, plane=FLOOR), ["half_sizes= must be 2 or 3"]),
        (
            da.BoxPlane("b", body="body", frame=B, centre=G, half_sizes=(1, 1), plane=FLOOR, rolling_resistance=1),
            ["a box has no resistance"],
        ),
        (point(rolling_resistance="far"), ["rolling_resistance= must be a length", "'far'"]),
        (point(rolling_resistance=(1, 2, 3)), ["rolling_resistance= as a pair is (static, moving)"]),
        (point(rolling_resistance=da.CoulombFriction(slip=x, mu=1)), ["rolling_resistance has slip= of its own"]),
        (point(drilling_resistance=0.1), ["does not turn about its normal", "leave drilling_resistance= out"]),
    ],
    ids=lambda value: value[0][:40] if isinstance(value, list) else "",
)
def test_faults(contact, texts):
    with pytest.raises(SceneError) as error:
        da.compile_model(planar(contact), backend="numpy")
    assert all(text in str(error.value) for text in texts), str(error.value)
    assert f"'{contact.name}'" in str(error.value)


def test_slip_in_one_direction_that_is_no_tangent_is_refused():
    along = O.locatenew("along", x * (N.x + N.z) / sqrt(2) + y * N.y)
    scene = da.Scene("slot", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("body", along, m))
    for tangents in (None, (N.x + N.z) / sqrt(2)):
        twin = scene.copy()
        twin.add_contacts(point(point=along, tangents=tangents))
        if tangents is None:
            with pytest.raises(SceneError, match="one direction"):
                with_made_contacts(twin)
        else:
            assert names(with_made_contacts(twin)) == ["heel.friction_1"]


def test_friction_where_nothing_can_slip_is_refused():
    scene = da.Scene("drop", frame=N, origin=O, coordinates=[y])
    drop = O.locatenew("drop", y * N.y)
    scene.add_bodies(Particle("body", drop, m))
    scene.add_contacts(point(point=drop))
    with pytest.raises(SceneError, match=r"cannot slip: friction=0"):
        with_made_contacts(scene)


def test_an_oblique_normal_needs_tangents_only_where_it_has_symbols():
    a, b = symbols("a b", positive=True)
    normal = sin(a) * N.x + cos(a) * sin(b) * N.y + cos(a) * cos(b) * N.z
    centre = lambda n: lambda G, S: da.SpherePlane("s", body="ball", centre=G, radius=r, plane=(O, n), friction=mu)  # noqa: E731
    with pytest.raises(SceneError, match=r"give tangents=\(t_1, t_2\)"):
        spatial(centre(normal))
    third = (N.x + 2 * N.y + 2 * N.z) / 3
    assert names(spatial(centre(third))) == ["s.friction_1", "s.friction_2"]


def test_explain_the_textbook_and_outputs_have_what_was_made():
    scene = planar(point())
    model = da.compile_model(scene, backend="numpy", outputs=["heel.gap", "heel.normal", "heel.friction_1"])
    assert "heel: point P of 'body' on the plane at O with the normal N.y" in model.explain()
    assert "friction heel.friction_1 along N.x" in model.explain()
    assert {str(u) for u in da.lagrange(scene).unknowns} == {"heel.normal", "heel.friction_1"}
    run = model.simulate(
        (0, 0.1), {x: 0, y: 1, theta: 0.2, x.diff(): 0, y.diff(): 0, theta.diff(): 0}, {m: 1, g: 9.81, r: 0.5, mu: 1}
    )
    assert abs(run["heel.gap"] - (run["y"] + 0.5 * np.sin(run["theta"]))).max() < 1e-15
    assert run.success and not run["heel.normal"].any()


def test_a_plane_that_moves_with_time_and_one_that_a_body_carries():
    """A box is taken along by a belt at mu g (t = v / mu g), and shares its momentum with a cart."""
    box, start = O.locatenew("box", x * N.x + y * N.y), {x: 0, y: 0, y.diff(): 0}

    def run(plane, other, extra, initial, parameters):
        scene = da.Scene("carried", frame=N, origin=O, coordinates=[x, y, *extra])
        scene.add_bodies(Particle("body", box, m), *([Particle("cart", cart, 2 * m)] if extra else []))
        scene.apply_uniform_gravity(-g * N.y)
        scene.add_contacts(point(point=box, plane=plane, other=other))
        return da.compile_model(scene).simulate((0, 3), {**start, **initial}, {m: 1, g: 10, mu: 0.2, **parameters})

    belt = run((O.locatenew("Q", v * TIME * N.x), N.y), None, [], {x.diff(): 0}, {v: 2})
    assert belt.success and abs(belt.phases[1].t0 - 1) < 1e-12 and abs(belt["x"][-1] - 5) < 1e-12
    cart = O.locatenew("cart", X * N.x)
    deck = run((cart, N.y), "cart", [X], {x.diff(): 3, X: 0, X.diff(): 0}, {})
    assert deck.success and abs(deck.phases[1].t0 - 1) < 1e-12 and abs(deck["X_dot"][-1] - 1) < 1e-12


def test_a_turning_table_moves_the_centre_of_a_ball_on_a_circle():
    """The centre of a rolling ball turns at 2/7 of the angular velocity of the table (S. Earnshaw, 1844)."""
    scene = da.Scene("turntable", frame=N, origin=O, coordinates=[x, y, z])
    S, T = ReferenceFrame("S"), N.orientnew("T", "Axis", (w * TIME, N.z))
    e = da.free_orientation(scene, S)
    centre = O.locatenew("C", x * N.x + y * N.y + z * N.z)
    J = 2 * m * r**2 / 5
    scene.add_bodies(RigidBody("ball", centre, S, m, (inertia(S, J, J, J), centre)))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_contacts(da.SpherePlane("table", body="ball", centre=centre, radius=r, plane=(O, T.z), friction=5))
    attitude = {**dict(zip(e, (1, 0, 0, 0), strict=True)), "omega_S_y": 0, "omega_S_z": 0}
    spin = {"omega_S_x": (2 * 0.3 - 0.5) / 0.1}
    start = {x: 0.3, y: 0, z: 0.1, x.diff(): 0, y.diff(): 0.5, z.diff(): 0, **attitude, **spin}
    run = da.compile_model(scene).simulate((0, 3), start, {m: 1, g: 9.81, r: 0.1, w: 2}, rtol=1e-10)
    turn = 4 / 7
    assert run.success and run.phases[0].modes == {"table": "stick"}
    assert abs(run["x"] - 0.3 + 0.5 / turn * (1 - np.cos(turn * run.t))).max() < 1e-10
    assert abs(run["y"] - 0.5 / turn * np.sin(turn * run.t)).max() < 1e-10


def test_a_ball_may_start_in_the_middle_of_its_bowl():
    """It falls freely until its distance from there is R - r; the gap is that distance from the surface."""
    ball = O.locatenew("ball", x * N.x + y * N.y)
    scene = da.Scene("dropped", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("body", ball, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_contacts(da.SphereInBowl("bowl", body="body", centre=ball, radius=r, bowl=(O, R)))
    model = da.compile_model(scene, outputs=["bowl.gap"])
    run = model.simulate((0, 0.5), {x: 0, y: 0, x.diff(): 0.1, y.diff(): 0}, {m: 1, g: 9.81, r: 0.1, R: 1})
    t = run.phases[1].t0
    assert run.success and [phase.modes["bowl"] for phase in run.phases] == ["open", "closed"]
    assert abs((0.1 * t) ** 2 + (9.81 * t**2 / 2) ** 2 - 0.81) < 1e-13
    falls = run.t < t
    distance = 0.9 - np.hypot(0.1 * run.t, 9.81 * run.t**2 / 2)
    assert abs(run["bowl.gap"] - distance)[falls].max() < 1e-14


def test_a_disc_that_lies_flat_is_no_success():
    """At the start it is an error; a run that comes there ends before."""
    tilt = dynamicsymbols("tilt")
    L = N.orientnew("L", "Axis", (tilt, N.x))
    centre = O.locatenew("C", y * N.y + z * N.z)
    scene = da.Scene("flat", frame=N, origin=O, coordinates=[y, z, tilt])
    scene.add_bodies(RigidBody("disc", centre, L, m, (inertia(L, m * r**2 / 4, 1, 1), centre)))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_contacts(da.DiscPlane("edge", body="disc", centre=centre, radius=r, axis=L.z, plane=(O, N.z)))
    model, p = da.compile_model(scene), {m: 1, g: 9.81, r: 0.1}
    still = {y: 0, y.diff(): 0, z.diff(): 0, tilt.diff(): 0}
    for height in (0, 0.2):
        with pytest.raises(InitialStateError, match="edge"):
            model.simulate((0, 1), {**still, z: height, tilt: 0}, p)
    leaning = {**still, z: 0.1 * np.sin(0.5), tilt: 0.5}
    for method in ("auto", "taylor", "dop853", "radau"):
        run = model.simulate((0, 1), leaning, p, method=method)
        assert run.status is Status.CONTACT_UNSUPPORTED and run.t[-1] < 0.2 and abs(run["tilt"][-1]) < 1e-9
        assert "a gap of 'edge' has a kink at t = 0.112166" in run.message
        tilts = np.array([0.5, 1.0])
        sweep = model.sweep((0, 0.15), {**still, z: 0.1 * np.sin(tilts), tilt: tilts}, p, method=method)
        assert sweep.status.tolist() == [Status.CONTACT_UNSUPPORTED, Status.SUCCESS]
        assert sweep.t[0] == pytest.approx(run.t[-1], abs=1e-12)
    prepared = model.prepare((0, 1))
    prepared(model.state(leaning, p), model.parameter_vector(p))
    assert prepared.status is Status.CONTACT_UNSUPPORTED


def test_written_contacts_stand_beside_those_by_geometry():
    hand = UnilateralContact(da.unknowns("Z"), x, name="wall")
    scene = planar(point(), hand)
    scene.add_joints(da.Joint("wall", body="body", at=G, force=da.unknowns("Z") * N.x))
    made = with_made_contacts(scene)
    assert [contact.label for contact in made.contacts] == ["wall", "heel"]
    with pytest.raises(SceneError, match="two contacts"):
        da.compile_model(planar(point(), point()), backend="numpy")


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_a_coin_in_quaternions(backend):
    """A coin falls, strikes the floor at its edge, rolls and slips: in angles, and in quaternions in their place."""
    x, y, z, psi, theta, phi = dynamicsymbols("x y z psi theta phi")
    r, g = symbols("r g", positive=True)
    frame, origin = ReferenceFrame("N"), Point("O")
    turned = frame.orientnew("A", "Axis", (psi, frame.z))
    tilted = turned.orientnew("L", "Axis", (theta, turned.x))
    own = tilted.orientnew("B", "Axis", (phi, tilted.z))
    centre = origin.locatenew("G", x * frame.x + y * frame.y + z * frame.z)
    scene = da.Scene("coin", frame, origin, [x, y, z, psi, theta, phi])
    scene.add_bodies(RigidBody("coin", centre, own, 1, (inertia(own, r**2 / 4, r**2 / 4, r**2 / 2), centre)))
    scene.apply_uniform_gravity(-g * frame.z)
    plane = (origin, frame.z)
    scene.add_contacts(
        da.DiscPlane("edge", body="coin", centre=centre, radius=r, axis=tilted.z, plane=plane, friction=0.2)
    )
    start = {x: 0, y: 0, z: 0.1, psi: 0.3, theta: 1.2, phi: 0}
    start |= {x.diff(): 0.2, y.diff(): 0.1, z.diff(): 0, psi.diff(): 0.4, theta.diff(): 0.1, phi.diff(): 9}
    runs = [
        da.compile_model(scene, backend=backend, orientation=orientation, outputs=["edge.gap"]).simulate(
            (0, 0.25), start, {r: 0.1, g: 9.81}, rtol=1e-9, t_eval=np.linspace(0, 0.25, 11), method="dop853"
        )
        for orientation in ("scene", "quaternion")
    ]
    assert [run.success for run in runs] == [True, True]
    assert len(runs[1].phases) > 1
    assert [phase.modes for phase in runs[0].phases] == [phase.modes for phase in runs[1].phases]
    for name in ("x", "y", "z", "x_dot", "y_dot", "z_dot", "edge.gap"):
        np.testing.assert_allclose(runs[1][name], runs[0][name], rtol=0, atol=1e-7)
    np.testing.assert_allclose(runs[1]["energy"], runs[0]["energy"], rtol=0, atol=1e-7)
