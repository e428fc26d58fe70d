"""Closed loops with redundant conditions that meet contacts, against the same scenes with one condition."""

import functools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.methods.status import Status

m, M, L, g, b, J = sp.symbols("m M L g b J", positive=True)
x, y, theta, p, q = dynamicsymbols("x y theta p q")
N, O = ReferenceFrame("N"), Point("O")
FIXED = {"m": 1.0, "L": 1.0, "g": 9.81}
LOOSE = {"M": 2.0, "m": 0.5, "L": 0.6, "b": 0.4, "J": 0.3, "g": 9.81}
THROWN = {"x": 0, "y": 1.0, "theta": 0.1, "p": 1.2, "q": 1.2, "p_dot": 6.0, "x_dot": 0.3, "y_dot": 0, "theta_dot": 0.2}


def closed(scene, ends, gap, components):
    """Close the loop of two cranks by components of a gap, or by the difference of their angles."""
    scene.add_holonomic_constraints(*(gap.dot(axis) for axis in components) if components else (p - q,))
    X, Y = da.unknowns("X Y")
    scene.add_joints(da.Joint("bar", body="end1", other="end0", at=ends[1], force=X * N.x + Y * N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


@functools.cache
def swing(*, redundant, formulation="projected", friction=0):
    """A parallelogram whose first end strikes a floor below its feet."""
    scene, ends = da.Scene("swing", frame=N, origin=O, coordinates=[p, q]), []
    for i, angle in enumerate((p, q)):
        ends.append(O.locatenew(f"end{i}", (2 * i + L * sp.cos(angle)) * N.x + L * sp.sin(angle) * N.y))
        scene.add_bodies(Particle(f"end{i}", ends[-1], m))
    floor = O.locatenew("floor", -L / 2 * N.y), N.y
    tip = da.PointPlane("tip", body="end0", point=ends[0], plane=floor, restitution=0.5, friction=friction)
    scene.add_contacts(tip)
    gap = ends[1].pos_from(ends[0]) - 2 * N.x
    return da.compile_model(closed(scene, ends, gap, (N.x, N.y) if redundant else ()), formulation=formulation)


@functools.cache
def hopper(*, redundant):
    """A base that falls on its two feet and carries a turning parallelogram."""
    scene, ends = da.Scene("hopper", frame=N, origin=O, coordinates=[x, y, theta, p, q]), []
    B = N.orientnew("B", "Axis", (theta, N.z))
    G = O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("base", G, B, M, (inertia(B, J, J, J), G)))
    for i, (angle, side) in enumerate(((p, -1), (q, 1))):
        ends.append(G.locatenew(f"end{i}", (side * b + L * sp.cos(angle)) * B.x + L * sp.sin(angle) * B.y))
        scene.add_bodies(Particle(f"end{i}", ends[-1], m))
        foot = G.locatenew(f"foot{i}", side * b * B.x - b / 2 * B.y)
        scene.add_contacts(da.PointPlane(f"foot{i}", body="base", point=foot, plane=(O, N.y), restitution=0.4))
    gap = ends[1].pos_from(ends[0]) - 2 * b * B.x
    return da.compile_model(closed(scene, ends, gap, (N.x, N.y) if redundant else ()), formulation="projected")


def agree(found, expected, names, atol):
    assert found.status is expected.status and len(found.phases) == len(expected.phases)
    np.testing.assert_allclose([each.t1 for each in found.phases], [each.t1 for each in expected.phases], atol=atol)
    for name in names:
        assert found[name][-1] == pytest.approx(expected[name][-1], abs=atol)


def test_a_parallelogram_bounces_until_it_rests():
    """One of its conditions vanishes before it strikes the floor."""
    start, options = {"p": 2.0, "q": 2.0, "p_dot": 1.0}, {"rtol": 1e-10, "atol": 1e-12}
    found, expected = (swing(redundant=r).simulate((0, 3), start, FIXED, **options) for r in (True, False))
    assert found.success and len(found.phases) > 20
    agree(found, expected, ["p", "q"], 1e-9)
    speeds = np.linspace(-2, 3, 5)
    cases, wanted = (
        swing(redundant=r).sweep((0, 3), {**start, "p_dot": speeds}, FIXED, **options) for r in (True, False)
    )
    assert np.all(cases.status == 0)
    np.testing.assert_allclose(cases["p"], wanted["p"], atol=1e-8)


def test_a_base_that_bounces_on_two_feet_carries_a_parallelogram():
    options = {"rtol": 1e-10, "atol": 1e-12}
    found, expected = (hopper(redundant=r).simulate((0, 0.9), THROWN, LOOSE, **options) for r in (True, False))
    assert found.success and len(found.phases) > 7 and "enforced together with the others" in found.message
    agree(found, expected, THROWN, 1e-7)


@pytest.mark.parametrize("limited", [{"formulation": "augmented"}, {"friction": 0.3}])
def test_what_is_not_served_ends_with_a_status_and_names_the_limit(limited):
    model = swing(redundant=True, **limited)
    run = model.simulate((0, 3), {"p": 2.0, "q": 2.0, "p_dot": 1.0}, FIXED)
    assert run.status is Status.SINGULAR_CONFIGURATION and 0.4 < run.t_end < 0.48
    assert "these have no friction and the formulation is 'projected'. Elsewhere write the closed loop" in run.message
