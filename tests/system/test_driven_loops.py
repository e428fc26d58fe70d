"""Reactions of loops that a crank drives whose angle is a function of time, against one whose angle is a coordinate."""

from functools import cache

import numpy as np
import pytest
from sympy import pi, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError

m, l1, l2, l3, d, g, w = symbols("m l1 l2 l3 d g w", positive=True)
a, b, c = dynamicsymbols("a b c")
TIME = dynamicsymbols._t
NUMBERS = {m: 1, l1: 0.3, l2: 1, l3: 0.8, d: 0.9, g: 9.81, w: 6}
WANTED = ["T", "X", "Y_2", "X_3"]


def four_bar(angle, coordinates, without=()):
    """Return a four-bar linkage whose pins, and whose motor at the crank, are declared."""
    N, O = ReferenceFrame("N"), Point("O")
    K, B, C = (N.orientnew(n, "Axis", (q, N.z)) for n, q in (("K", angle), ("B", b), ("C", c)))
    A = O.locatenew("A", l1 * K.x)
    D = O.locatenew("D", d * N.x)
    end, tip = A.locatenew("end", l2 * B.x), D.locatenew("tip", l3 * C.x)
    scene = da.Scene("four_bar", frame=N, origin=O, coordinates=coordinates)
    for name, frame, base, length in (("crank", K, O, l1), ("coupler", B, A, l2), ("rocker", C, D, l3)):
        centre = base.locatenew(f"G_{name}", length / 2 * frame.x)
        scene.add_bodies(RigidBody(name, centre, frame, m, (inertia(frame, 0, 0, m * length**2 / 12), centre)))
    gap = end.pos_from(tip)
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    T, X, Y, X_1, Y_1, X_2, Y_2, X_3, Y_3 = da.unknowns("T X Y X_1 Y_1 X_2 Y_2 X_3 Y_3")
    joints = {
        "motor": da.Joint("motor", body="crank", at=O, force=X_1 * N.x + Y_1 * N.y, torque=T * N.z),
        "elbow": da.Joint("elbow", body="coupler", other="crank", at=A, force=X_2 * N.x + Y_2 * N.y),
        "loop": da.Joint("loop", body="coupler", other="rocker", at=end, force=X * N.x + Y * N.y),
        "pivot": da.Joint("pivot", body="rocker", at=D, force=X_3 * N.x + Y_3 * N.y),
    }
    scene.add_joints(*(joint for name, joint in joints.items() if name not in without))
    return scene


def run(scene, wanted, more=()):
    """Return a sixth of a turn."""
    model = da.compile_model(scene, outputs=wanted)
    start = model.assemble({b: 0.9, c: 1.6, **dict(more)}, NUMBERS)
    given = {"t_eval": np.linspace(0, float(pi / 18), 11), "rtol": 1e-11, "atol": 1e-13}
    found = model.simulate((0, given["t_eval"][-1]), start, NUMBERS, **given)
    assert found.success
    return found


@cache
def expected():
    """Return the motion with the angle of the crank as a coordinate, which a constraint prescribes."""
    scene = four_bar(a, [a, b, c])
    scene.add_holonomic_constraints(a - w * TIME)
    return run(scene, WANTED, {a: 0})


def test_reactions_do_not_depend_on_what_drives_the_crank():
    """The torque of the motor, too, has no power on a motion that no coordinate has left free."""
    found = run(four_bar(w * TIME, [b, c]), WANTED)
    for name in WANTED:
        np.testing.assert_allclose(found[name], expected()[name], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("missing", ["elbow", "pivot"])
def test_a_pin_that_no_joint_declares_changes_no_torque(missing):
    found = run(four_bar(w * TIME, [b, c], without=[missing]), ["T"])
    np.testing.assert_allclose(found["T"], expected()["T"], rtol=1e-9, atol=1e-9)


def test_a_loop_that_no_joint_closes_is_named():
    with pytest.raises(ConstraintError, match="joints cannot exert the reactions of its constraints"):
        da.compile_model(four_bar(w * TIME, [b, c], without=["loop"]), outputs=["T"])
