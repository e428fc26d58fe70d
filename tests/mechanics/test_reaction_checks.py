"""Joints that can exert nothing on the constraints are refused when a scene is compiled, whatever is asked for."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

x, y, theta = dynamicsymbols("x y theta")
X, Y = da.unknowns("X Y")
START = {x: 0, y: 0, theta: 0.3, x.diff(): np.cos(0.3), theta.diff(): 1}


def sleigh(force):
    """A blade that keeps its point from moving sideways, and the force that its joint has."""
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    G = C.locatenew("G", 0.3 * S.x)
    scene = da.Scene("sleigh", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("body", G, S, 1, (inertia(S, 0, 0, 1), G)))
    scene.add_joints(da.Joint("blade", body="body", at=C, force=force(N, S)))
    scene.add_nonholonomic_constraints(-x.diff() * sp.sin(theta) + y.diff() * sp.cos(theta))
    return scene


@pytest.mark.parametrize("outputs", [(), ("Y",), ("energy",)])
@pytest.mark.parametrize(
    "force", [lambda N, S: Y * S.x, lambda N, S: Y * N.y, lambda N, S: Y * (S.x + S.y)], ids=["along", "fixed", "skew"]
)
def test_power_on_allowed_motions_alone(force, outputs):
    with pytest.raises(
        da.errors.ConstraintError, match=r"joint 'blade' cannot exert .* because Y would have .*add_loads"
    ):
        da.compile_model(sleigh(force), outputs=outputs)


@pytest.mark.parametrize(
    "force", [lambda N, S: Y * S.y, lambda N, S: X * N.x + Y * N.y, lambda N, S: X * S.x + Y * S.y]
)
def test_components_of_which_some_combination_holds_the_constraint(force):
    """What the others may be is decided by the reactions having no power: they are forces of an ideal joint."""
    model = da.compile_model(sleigh(force), outputs=["Y"])
    run = model.simulate((0, 1), START, {})
    assert run.success and np.isfinite(run["Y"]).all()


def pendulum(force, constraint=True):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("body", P, 1))
    scene.add_loads((P, -N.y))
    scene.add_joints(da.Joint("rod", body="body", at=P, force=force(N)))
    if constraint:
        scene.add_holonomic_constraints(x**2 + y**2 - 1)
    return scene


def test_positions_of_the_constraint_count():
    """A force along the rod holds it, also if it is so only where the rod has its length; one across it does not."""
    for along in (lambda N: X * (x * N.x + y * N.y), lambda N: X * (x * N.x + sp.sign(y) * sp.sqrt(1 - x**2) * N.y)):
        da.compile_model(pendulum(along), backend="numpy")
    with pytest.raises(da.errors.ConstraintError, match="joint 'rod'"):
        da.compile_model(pendulum(lambda N: X * (y * N.x - x * N.y)), backend="numpy")


def test_without_constraints_and_without_power():
    """Nothing is to be held, or the unknown appears in no equation: both are as they were."""
    da.compile_model(pendulum(lambda N: X * N.x, constraint=False), backend="numpy")
    da.compile_model(pendulum(lambda N: X * N.z), backend="numpy")
