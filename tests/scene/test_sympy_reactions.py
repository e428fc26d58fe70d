"""Reactions of joints of SymPy by name, against Newton's and Euler's laws for the bodies that they carry."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import PinJoint, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError, UnknownNameError
from scene.sympy_trees import KINDS, PARAMETERS, T, body, g, m, newton_euler, tree, values_at


def compiled(scene, outputs):
    """Return the scene's model on the reference backend, with second rates among its outputs."""
    wanted = [q.diff(T, 2) for q in scene.coordinates]
    named = outputs if isinstance(outputs, dict) else dict(zip(outputs, outputs, strict=True))
    return da.compile_model(
        scene,
        outputs={**{f"{q.func.__name__}_ddot": a for q, a in zip(scene.coordinates, wanted, strict=True)}, **named},
        backend="numpy",
        cache=False,
    )


def needed(joint, carried, scene, run, axes=None):
    """Return force and torque (6,) that bodies need at the end of a run, on the axes of their joint or others."""
    values = values_at(run, -1, scene, PARAMETERS)
    axes = joint.parent_interframe if axes is None else axes
    return newton_euler(joint.child_point, axes, carried, scene.frame, scene.origin, scene.gravity, values)


@pytest.mark.parametrize("kind", KINDS)
def test_every_joint(kind):
    """Points off the mass centres, tilted axes, full inertias; the arm hangs on the base."""
    parts = tree(kind)
    scene = parts.scene()
    model = compiled(scene, [*scene.reaction("first"), *scene.reaction("second")])
    run = model.simulate((0, 0.1), parts.state(), PARAMETERS, rtol=1e-10, t_eval=[0, 0.1])
    for joint, carried in zip(parts.joints, (parts.bodies, parts.bodies[1:]), strict=True):
        expected = needed(joint, carried, scene, run)
        found = [run[name][-1] for name in scene.reaction(joint.name)]
        assert found == pytest.approx(expected, abs=1e-12)
        assert np.abs(expected).max() > 0.1


@pytest.mark.parametrize("kind", ["pin", "slider"])
def test_an_axis_between_those_of_the_frame(kind):
    """Five unknown components, of which three and two make the six on the axes of the joint."""
    parts = tree(kind, skew=True)
    scene = parts.scene()
    model = compiled(scene, scene.reaction("first"))
    run = model.simulate((0, 0.1), parts.state(), PARAMETERS, rtol=1e-10, t_eval=[0, 0.1])
    found = [run[name][-1] for name in scene.reaction("first")]
    assert found == pytest.approx(needed(parts.joints[0], parts.bodies, scene, run), abs=1e-12)
    free = np.array([0.6, 0, 0.8]) @ (found[3:] if kind == "pin" else found[:3])
    assert abs(free) < 1e-14


def test_other_axes():
    parts = tree("ball")
    scene, arm = parts.scene(), parts.bodies[1]
    names = scene.reaction("second", frame=arm.frame)
    assert next(iter(names)) == "second.force_x on arm_frame"
    run = compiled(scene, names).simulate((0, 0.1), parts.state(), PARAMETERS, rtol=1e-10, t_eval=[0, 0.1])
    expected = needed(parts.joints[1], [arm], scene, run, arm.frame)
    assert [run[name][-1] for name in names] == pytest.approx(expected, abs=1e-12)


def test_a_reaction_has_the_name_that_the_user_gives_it():
    """In a mapping, and among other outputs by the names that it has."""
    parts = tree("pin")
    scene = parts.scene()
    N = scene.frame
    named = {"R": scene.reaction("second"), "on N": scene.reaction("second", frame=N), "push": "second.force_x"}
    run = compiled(scene, named).simulate((0, 0.1), parts.state(), PARAMETERS, t_eval=[0, 0.1])
    assert run["R.force_x"][-1] == run["push"][-1] != 0
    turned = parts.joints[1].parent_interframe.dcm(N)
    force = [run[f"R.force_{axis}"][-1] for axis in "xyz"]
    values = values_at(run, -1, scene, PARAMETERS)
    on_frame = [run[f"on N.force_{axis} on N"][-1] for axis in "xyz"]
    assert on_frame == pytest.approx(np.array(turned.T.subs(values).evalf(), dtype=float) @ force, abs=1e-12)
    listed = da.compile_model(scene, outputs=[scene.coordinates[0] ** 2, scene.reaction("first")], backend="numpy")
    assert set(scene.reaction("first")) <= set(listed.layout.outputs)


def test_reactions_leave_the_state_program_as_it_is():
    scene = tree("pin").scene()
    bare, asked = (da.compile_model(scene, outputs=names, backend="numpy") for names in ((), ["second.force_x"]))
    texts = [str(model.stages.program.kernel("rhs")) for model in (bare, asked)]
    assert texts[0] == texts[1]
    assert bare.layout.unknowns == () and "second.force_x" in asked.layout.unknowns
    assert not any(name.startswith("first.") for name in asked.layout.unknowns)


def test_a_component_that_the_joint_leaves_free_is_zero():
    scene = tree("pin").scene()
    model = da.compile_model(scene, outputs=["second.torque_y"], backend="numpy", cache=False)
    assert not model.layout.unknowns
    assert not model.simulate((0, 0.1), tree("pin").state(), PARAMETERS)["second.torque_y"].any()


def test_a_reversed_joint():
    """The ground is the child: its force is that of the rod on the ground."""
    N, O, q = ReferenceFrame("N"), Point("O"), dynamicsymbols("q")
    ground, rod = RigidBody("ground", masscenter=O, frame=N), RigidBody("rod", mass=m)
    rod.central_inertia = inertia(rod.frame, 0, 0, m / 12)
    scene = da.Scene("reversed", frame=N, origin=O)
    scene.add_joints(PinJoint("pivot", rod, ground, q, parent_point=-rod.x / 2, joint_axis=rod.z))
    scene.apply_uniform_gravity(-g * N.y)
    model = compiled(scene, scene.reaction("pivot", frame=N))
    run = model.simulate((0, 0.3), {"q": 0.4, "q_dot": 1.0}, {m: 1.3, g: 9.81}, t_eval=[0, 0.3])
    angle, rate, second = (-run[name][-1] for name in ("q", "q_dot", "q_ddot"))  # of the rod in N
    x = -1.3 * 0.5 * (np.cos(angle) * rate**2 + np.sin(angle) * second)
    y = 1.3 * (0.5 * (np.cos(angle) * second - np.sin(angle) * rate**2) + 9.81)
    found = [run[f"pivot.force_{axis} on N"][-1] for axis in "xyz"]
    assert found == pytest.approx([-x, -y, 0], abs=1e-12)


def test_systems_of_sympy_have_the_same_names():
    parts = tree("slider")
    ours, theirs = parts.scene(), da.Scene.from_sympy(tree("slider").system())
    names = [*ours.reaction("first"), *ours.reaction("second")]
    runs = [
        compiled(scene, names).simulate((0, 0.1), parts.state(), PARAMETERS, t_eval=[0, 0.1])
        for scene in (ours, theirs)
    ]
    for name in names:
        assert runs[0][name] == pytest.approx(runs[1][name], abs=1e-8), name


def four_bar():
    """Return a linkage of three pins and a closure, its bodies and its angles."""
    N, O = ReferenceFrame("N"), Point("O")
    angles = dynamicsymbols("a b c")
    ground, lengths = RigidBody("ground", O, N, 1, (inertia(N, 1, 1, 1), O)), ("0.3", "1", "0.8")
    bodies = [
        body(name, m, 0, 0, m * sp.Rational(length) ** 2 / 12)
        for name, length in zip(("crank", "coupler", "rocker"), lengths, strict=True)
    ]
    crank, coupler, rocker = bodies
    scene = da.Scene("four_bar", frame=N, origin=O)
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(
        PinJoint("A", ground, crank, angles[0], child_point=-0.15 * crank.x, joint_axis=N.z),
        PinJoint("B", crank, coupler, angles[1], None, 0.15 * crank.x, -0.5 * coupler.x, joint_axis=crank.z),
        PinJoint("D", ground, rocker, angles[2], None, 0.9 * N.x, -0.4 * rocker.x, joint_axis=N.z),
    )
    P = coupler.masscenter.locatenew("P", 0.5 * coupler.x)
    Q = rocker.masscenter.locatenew("Q", 0.4 * rocker.x)
    scene.add_joints(da.Closure("C", "coupler", "rocker", kind="pin", parent_point=P, child_point=Q, axis=N.z))
    return scene, bodies, angles


STEEL = {m: 1.3, g: 9.81}
GUESS = {"a": 1, "b": -0.5, "c": 1.5}


def test_a_tree_with_a_closed_loop():
    """The forces on each body are its mass times its acceleration."""
    scene, bodies, angles = four_bar()
    N, O, crank = scene.frame, scene.origin, bodies[0]
    reactions = {name: value for joint in "ABCD" for name, value in scene.reaction(joint, frame=N).items()}
    planar = {name: value for name, value in reactions.items() if "force_x" in name or "force_y" in name}
    model = compiled(scene, planar)
    start = model.assemble(GUESS, STEEL, fixed=["a"])
    run = model.simulate((0, 0.5), {**start, "a_dot": 6}, STEEL, rtol=1e-10, t_eval=[0, 0.5])
    assert run.success and run.constraint_violation.max() < 1e-10
    pins = {name: np.array([run[f"{name}.force_{axis} on N"][-1] for axis in "xy"]) for name in "ABCD"}
    state = values_at(run, -1, scene, PARAMETERS)
    for moved, force in zip(bodies, (pins["A"] - pins["B"], pins["B"] - pins["C"], pins["D"] + pins["C"]), strict=True):
        own = newton_euler(moved.masscenter, N, [moved], N, O, scene.gravity, state)
        assert force == pytest.approx(own[:2], abs=1e-9), moved.name
    arm = newton_euler(scene.connections[0].source.child_point, N, [crank], N, O, scene.gravity, state)[5]
    angle = state[angles[0]]
    tip = 0.3 * np.array([np.cos(angle), np.sin(angle)])
    assert arm == pytest.approx(-(tip[0] * pins["B"][1] - tip[1] * pins["B"][0]), abs=1e-9)


@cache
def forces_of_pins(formulation):
    """Return one component of the forces of two pins at the end of a run."""
    names, gains = ["B.force_x", "C.force_y"], {"gains": (20, 20)} if formulation == "baumgarte" else {}
    scene = four_bar()[0]
    model = da.compile_model(scene, outputs=names, formulation=formulation, backend="numpy", cache=False, **gains)
    start = {**model.assemble(GUESS, STEEL, fixed=["a"]), "a_dot": 6}
    run = model.simulate((0, 0.2), start, STEEL, rtol=1e-9, t_eval=[0, 0.2])
    return [run[name][-1] for name in names]


@pytest.mark.parametrize("formulation", ["baumgarte", "ggl", "augmented"])
def test_a_closed_loop_in_other_formulations(formulation):
    assert forces_of_pins(formulation) == pytest.approx(forces_of_pins("projected"), rel=1e-6)


def test_what_a_plane_leaves_open_is_named():
    """Four pins share a torque across the plane; a joint that leaves it free would settle it."""
    scene, _, _ = four_bar()
    with pytest.raises(ConstraintError, match=r"only a combination of C\.torque_x with A\.force_z, .* appears"):
        da.compile_model(scene, outputs=["C.torque_x"], backend="numpy")


def test_an_event_of_a_reaction():
    """It is requested as an output; the message says so."""
    scene, _, _ = four_bar()
    force = scene.reaction("B")["B.force_x"]
    asked, bare = (
        da.compile_model(scene, outputs=names, backend="numpy", cache=False) for names in (["B.force_x"], ())
    )
    start = {**asked.assemble(GUESS, STEEL, fixed=["a"]), "a_dot": 6}
    event = da.Event(force + 5, terminal=True)
    run = asked.simulate((0, 2), start, STEEL, events=[event], rtol=1e-9)
    assert 0 < run.t[-1] < 2 and run["B.force_x"][-1] == pytest.approx(-5, abs=1e-7)
    with pytest.raises(UnknownNameError, match=r"'B\.force_x' is a reaction; request it with compile_model"):
        bare.simulate((0, 2), start, STEEL, events=[event])
