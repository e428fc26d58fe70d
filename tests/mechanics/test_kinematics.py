"""Poses of the kinematic tree, by the pose before and by all steps from the root."""

import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.mechanics.kinematics import Kinematics
from dalembert.scene.reading import read
from mechanics.bodies import links, scene_of


def _branches():
    tree = links([-1, 0, 1, 1, 0, 4], ["turn z", "ball", "slide x", "turn y", "free", "turn x"], 3)
    return scene_of("branches", tree)[0]


def _written_across():
    """Return bodies whose points are written on frames above, behind and beside their own, the deepest first."""
    q = dynamicsymbols("q0:5")
    l, m = symbols("l m", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (q[0], N.z))
    B, C = A.orientnew("B", "Axis", (q[1], A.x)), A.orientnew("C", "Axis", (q[2], A.y))
    D = B.orientnew("D", "Axis", (q[3], B.z))
    first = O.locatenew("first", l * A.x + l * N.y)
    second = first.locatenew("second", l * B.x)
    third = second.locatenew("third", l * A.z + q[4] * C.x)
    fourth = third.locatenew("fourth", 0 * D.x)
    fifth = fourth.locatenew("fifth", l * D.y)
    scene = da.Scene("across", frame=N, origin=O, coordinates=q)
    for point, frame in ((fifth, D), (fourth, D), (third, C), (second, A), (first, C), (third, N)):
        tensor = inertia(frame, l**2 * m, l**2 * m, 2 * l**2 * m)
        scene.add_bodies(RigidBody(f"{point.name}_{frame.name}", point, frame, m, (tensor, point)))
    scene.add_bodies(*(Particle(f"p_{point.name}", point, m) for point in (fifth, second)))
    return scene


@pytest.mark.parametrize("make", [_branches, _written_across])
@pytest.mark.parametrize("backwards", [False, True])
def test_poses_are_those_of_all_steps_from_the_root(make, backwards):
    """Steps are shared, so that equal ways end at one and the same pose."""
    model = read(make())
    tree = Kinematics(model)
    bodies = model.bodies[:: -1 if backwards else 1]
    assert len(bodies) >= 6
    for body in bodies:
        pose = tree.body_pose(body)
        frame = body.frame if body.inertia is not None else tree.carrier(body.centre)
        assert pose is tree._from_root(frame, body.centre)
        assert pose is tree.body_pose(body)


def test_a_chain_is_walked_once():
    """Each of 40 links adds its own steps, where all steps from the root would be looked up for each."""
    model = read(scene_of("chain", links(range(-1, 39), ["turn z"] * 40, 5))[0])
    tree, steps = Kinematics(model), []
    child = tree._child
    tree._child = lambda *args: steps.append(args) or child(*args)
    for body in model.bodies:
        tree.body_pose(body)
    assert len(steps) == len(tree.poses) - 1
