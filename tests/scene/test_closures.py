"""Joints that close loops: motions of trees with the same joints, reactions by Newton's and Euler's laws, faults."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import (
    Particle,
    PinJoint,
    Point,
    PrismaticJoint,
    ReferenceFrame,
    RigidBody,
    SphericalJoint,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import SceneError
from dalembert.scene.expressions.reader import short
from scene.sympy_trees import T, newton_euler, values_at

m, g, l = sp.symbols("m g l", positive=True)
PARAMETERS = {m: 1.3, g: 9.81}
N, O = ReferenceFrame("N"), Point("O")
GROUND = RigidBody("ground", masscenter=O, frame=N)
OFFSET = (-0.4, 0.2, 0.1)
"""From the mass centre of the body to its point of the joint, on its frame."""
AXIS = (0, sp.Rational(3, 5), sp.Rational(4, 5))
ACROSS = (1, 0, 0)
SPINS = {"pin": (0, 1.2, 1.6), "ball": (0.7, -1.1, 2.0), "weld": (0, 0, 0), "slider": (0, 0, 0)}
SPINS["universal"] = (0.9, 0.72, 0.96)
"""Angular velocities at the start, where the frames of body and ground are aligned."""
RUN = {"rtol": 1e-11, "atol": 1e-12, "t_eval": [0, 0.2, 0.4]}


def on(frame, components):
    return sum((c * axis for c, axis in zip(components, frame, strict=True)), 0 * frame.x)


def central(frame):
    return inertia(frame, 0.11, 0.12, 0.19, 0.01, -0.02, 0.03)


def closed(kind):
    """Return a body in six coordinates that a closure joins to the ground."""
    x, y, z, a, b, c = coordinates = dynamicsymbols("x y z a b c")
    scene = da.Scene(kind, frame=N, origin=O, coordinates=coordinates)
    S = N.orientnew("S", "Body", (a, b, c), "123")
    G = O.locatenew("G", x * N.x + y * N.y + z * N.z)
    scene.add_bodies(RigidBody("body", G, S, m, (central(S), G)))
    scene.apply_uniform_gravity(-g * N.y)
    axes = {"pin": AXIS, "universal": AXIS, "slider": AXIS}.get(kind)
    child = {"pin": AXIS, "universal": ACROSS}.get(kind)
    closure = da.Closure(
        "joint",
        None,
        "body",
        kind=kind,
        parent_point=O,
        child_point=G.locatenew("P", on(S, OFFSET)),
        axis=axes and on(N, axes),
        child_axis=child and on(S, child),
    )
    scene.add_joints(closure)
    return scene, closure


def tree(kind):
    """Return the same body on a joint that its coordinates describe; those start at zero."""
    body, scene = RigidBody("body", mass=m), da.Scene("tree", frame=N, origin=O)
    body.central_inertia = central(body.frame)
    point = on(body.frame, OFFSET)
    if kind == "universal":
        p, q = dynamicsymbols("p q")
        scene = da.Scene("tree", frame=N, origin=O, coordinates=[p, q])
        S = N.orientnew("half", "Axis", (p, on(N, AXIS)))
        S = S.orientnew("S", "Axis", (q, S.x))
        G = O.locatenew("G", -on(S, OFFSET))
        scene.add_bodies(RigidBody("body", G, S, m, (central(S), G)))
    elif kind == "ball":
        scene.add_joints(SphericalJoint("tree", GROUND, body, child_point=point, rot_type="body", rot_order=123))
    else:
        joint = {"pin": PinJoint, "slider": PrismaticJoint}[kind]
        scene.add_joints(joint("tree", GROUND, body, child_point=point, joint_axis=on(N, AXIS)))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


SPEEDS = {"pin": [2.0], "slider": [0.5], "universal": [1.2, 0.9], "ball": list(SPINS["ball"])}


def start_of(kind):
    """Return the state of the closed body: frames aligned, points together."""
    spin, slide = np.array(SPINS[kind]), 0.5 * np.array(AXIS, float) if kind == "slider" else np.zeros(3)
    velocity = np.cross(spin, -np.array(OFFSET)) + slide
    names = ("x", "y", "z", "a", "b", "c")
    state = dict(zip(names, (*(-np.array(OFFSET)), 0, 0, 0), strict=True))
    return state | {f"{name}_dot": v for name, v in zip(names, (*velocity, *spin), strict=True)}


@pytest.fixture(scope="module", params=SPINS)
def moved(request):
    """A closed body with its motion, second rates and reaction."""
    scene, closure = closed(request.param)
    wanted = [q.diff(T, 2) for q in scene.coordinates] + list(scene.reaction("joint"))
    model = da.compile_model(scene, outputs=wanted, backend="numpy", cache=False)
    return request.param, scene, closure, model, model.simulate((0, 0.4), start_of(request.param), PARAMETERS, **RUN)


def test_number_of_constraints(moved):
    kind, scene, _, model, _ = moved
    assert model.layout.holonomic == {"pin": 5, "ball": 3, "weld": 6, "slider": 5, "universal": 4}[kind]
    assert all(name == "joint" for _, name in scene.constraint_names)


def test_motion_is_that_of_a_tree(moved):
    """The tree has no constraints: its joint is in its coordinates."""
    kind, _, _, _, run = moved
    assert run.success and run.constraint_violation.max() < 1e-10
    places = np.stack([run[name] for name in ("x", "y", "z")])
    if kind == "weld":
        assert np.abs(places.T + OFFSET).max() < 1e-12
        return
    scene = tree(kind)
    model = da.compile_model(scene, outputs=[scene.bodies[0].masscenter], backend="numpy", cache=False)
    state = dict.fromkeys(model.layout.coordinates, 0.0) | dict(zip(model.layout.rates, SPEEDS[kind], strict=True))
    other = model.simulate((0, 0.4), state, PARAMETERS, **RUN)
    name = scene.bodies[0].masscenter.name
    assert np.abs(places - np.stack([other[f"{name}_{axis}"] for axis in "xyz"])).max() < 1e-9


def test_reaction_is_that_of_newton_and_euler(moved):
    kind, scene, closure, _, run = moved
    for k in (0, 2):
        values = values_at(run, k, scene, PARAMETERS)
        expected = newton_euler(closure.child_point, N, scene.bodies, N, O, scene.gravity, values)
        found = [run[name][k] for name in scene.reaction("joint")]
        assert found == pytest.approx(expected, abs=1e-9), kind
    assert np.abs(expected).max() > 1


# -- distances ------------------------------------------------------------------------------------------


def test_a_bead_at_a_distance():
    """The tension of a pendulum, m (l phi_dot^2 + g cos(phi)), along SciPy's solution of its equation."""
    x, y = dynamicsymbols("x y")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bead", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Closure("rod", None, "bead", "distance", parent_point=O, child_point=P, distance=l))
    model = da.compile_model(scene, outputs=["rod.force", "rod.force_x"], backend="numpy", cache=False)
    length, state = 0.7, [0.9, 1.5]
    start = {x: length * np.sin(0.9), y: -length * np.cos(0.9), "x_dot": length * 1.5 * np.cos(0.9)}
    run = model.simulate((0, 1), start, {**PARAMETERS, l: length}, rtol=1e-11, atol=1e-12, t_eval=[0, 0.5, 1])
    exact = solve_ivp(
        lambda _, s: [s[1], -9.81 / length * np.sin(s[0])],
        (0, 1),
        state,
        "DOP853",
        t_eval=run.t,
        rtol=1e-12,
        atol=1e-12,
    ).y
    tension = 1.3 * (length * exact[1] ** 2 + 9.81 * np.cos(exact[0]))
    assert run["rod.force"] == pytest.approx(tension, abs=1e-8)
    assert run["rod.force_x"] == pytest.approx(-tension * np.sin(exact[0]), abs=1e-8)


# -- in a plane -----------------------------------------------------------------------------------------


def rods():
    """Return two rods on pins at O and (1, 0), that reach for each other, and their ends."""
    a, b = dynamicsymbols("a b")
    scene = da.Scene("rods", frame=N, origin=O, coordinates=[a, b])
    ends = []
    for name, angle, foot in (("left", a, O), ("right", b, O.locatenew("F", N.x))):
        A = N.orientnew(name, "Axis", (angle, N.z))
        G = foot.locatenew(f"G_{name}", A.x / 2)
        scene.add_bodies(RigidBody(name, G, A, m, (inertia(A, 0, 0, m / 12), G)))
        ends.append(foot.locatenew(f"E_{name}", A.x))
    return scene, *ends


def test_a_pin_in_a_plane_is_two_equations_that_are_called_by_its_name():
    scene, P, Q = rods()
    scene.add_joints(da.Closure("top", "left", "right", "pin", parent_point=P, child_point=Q, axis=N.z))
    a, b = scene.coordinates
    assert scene.holonomic_constraints == (-sp.cos(a) + sp.cos(b) + 1, -sp.sin(a) + sp.sin(b))
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert "holonomic constraint of 'top'" in str(model.stages.equations.constraints[0].label)
    assert not model.layout.unknowns


def test_a_weld_in_a_plane_is_three_equations():
    scene, P, Q = rods()
    scene.add_joints(da.Closure("top", "left", "right", "weld", parent_point=P, child_point=Q))
    assert len(scene.holonomic_constraints) == 3


def test_the_textbook_has_closures():
    scene, P, Q = rods()
    scene.add_joints(da.Closure("top", "left", "right", "pin", parent_point=P, child_point=Q, axis=N.z))
    view = da.lagrange(scene)
    assert view.ideal_conditions("top") == [] and "top.force_x" in map(str, view.unknowns)


# -- faults ---------------------------------------------------------------------------------------------


def fault(**changed):
    scene, P, Q = rods()
    given = {"parent": "left", "child": "right", "kind": "pin", "parent_point": P, "child_point": Q, "axis": N.z}
    with pytest.raises(SceneError) as caught:
        scene.add_joints(da.Closure("top", **given | changed))
    assert "joint 'top'" in str(caught.value)
    return str(caught.value)


def test_faults_of_arguments():
    assert "there is no kind 'hinge'; known: pin, ball, weld, slider, universal, distance" in fault(kind="hinge")
    assert "the axis is missing: give axis=" in fault(axis=None)
    assert "the child_axis is missing" in fault(kind="universal")
    assert "the distance is missing" in fault(kind="distance", axis=None)
    assert "the distance must be a positive length, not -1" in fault(kind="distance", axis=None, distance=-1)
    assert "a closure of kind 'ball' takes no axis" in fault(kind="ball")
    assert "axis must be a Vector" in fault(axis=3)
    assert "parent_point must be a Point" in fault(parent_point="P")


def test_faults_of_bodies_and_points():
    assert "'middle' is no body of the scene; known: left, right" in fault(parent="middle")
    assert "its two bodies are the same" in fault(child="left")
    assert "child_point 'lost' is not located from 'O': locate it from 'right'" in fault(child_point=Point("lost"))
    assert "parent_point 'O' is not fixed on 'left'" in fault(parent_point=O.locatenew("O", N.x))
    assert "the axis N.x is not fixed in 'left'" in fault(axis=N.x)


def test_a_point_beside_a_particle():
    scene, _, Q = rods()
    scene.add_bodies(Particle("bead", Q.locatenew("B", N.x), 1))
    beside = scene.bodies[-1].masscenter.locatenew("beside", N.y)
    ends = {"parent_point": Q, "child_point": beside}
    remedy = r"'beside' is not on 'bead', a particle, which is at 'B' alone: give that point, or make it a RigidBody"
    with pytest.raises(SceneError, match=remedy):
        scene.add_joints(da.Closure("top", "right", "bead", "ball", **ends))


def test_an_axis_in_one_body_alone():
    scene, _ = closed("ball")
    with pytest.raises(SceneError, match=r"axis N.x is not fixed in 'body'; give child_axis=, fixed in the child, too"):
        scene.add_joints(
            da.Closure("pin", None, "body", "pin", parent_point=O, child_point=scene.bodies[0].masscenter, axis=N.x)
        )


def test_particles_have_no_axes():
    scene, P, Q = rods()
    bead = Particle("bead", P.locatenew("B", 0), m)
    scene.add_bodies(bead)
    with pytest.raises(SceneError, match="'bead' is a particle, which has no orientation: take kind='ball'"):
        scene.add_joints(da.Closure("pin", "right", "bead", "pin", parent_point=Q, child_point=bead.point, axis=N.z))


def test_a_closure_that_the_coordinates_fulfil():
    scene, _, _ = rods()
    foot = scene.bodies[0].masscenter.locatenew("foot", -scene.bodies[0].frame.x / 2)
    with pytest.raises(SceneError, match="the coordinates fulfil it for all their values already"):
        scene.add_joints(da.Closure("foot", None, "left", "pin", parent_point=O, child_point=foot, axis=N.z))


def test_points_together_are_written_on_the_frame_that_carries_both_bodies():
    """Two arms on a turning base: the equations of their ball joint do not depend on the turn of the base."""
    h, a, b = dynamicsymbols("h a b")
    H = ReferenceFrame("H")
    H.orient_axis(N, N.x, h)
    scene = da.Scene("arms", frame=N, origin=O, coordinates=[h, a, b])
    ends = []
    for name, angle, side in (("left", a, 1), ("right", b, -1)):
        frame, shoulder = ReferenceFrame(name), O.locatenew(f"{name} shoulder", side * H.y)
        frame.orient_axis(H, H.z, angle)
        centre = shoulder.locatenew(name, l * frame.x)
        scene.add_bodies(RigidBody(name, centre, frame, m, (inertia(frame, 1, 1, 1), centre)))
        ends.append(centre.locatenew(f"{name} hand", l * frame.x))
    scene.add_joints(da.Closure("hands", "left", "right", "ball", *ends))
    assert len(scene.holonomic_constraints) == 2 and not any(row.has(h) for row in scene.holonomic_constraints)


def test_large_constraints_are_not_printed():
    x = sp.Symbol("x")
    large = sp.Add(*[x] * 10_000, evaluate=False)
    assert short(large) == "an expression of more than 10000 parts" and short(x + 1) == "x + 1"
