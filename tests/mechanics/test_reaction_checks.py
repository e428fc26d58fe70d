"""Joints that can exert nothing on the constraints are refused when a scene is compiled, whatever is asked for."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.mechanics.body_samples import BodySample, reaction_direction

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


def railed(rail, *, held=False):
    """A block that slides on a rough floor, and along a rail in it whose reaction a joint may hold."""
    z, N, O = dynamicsymbols("z"), ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("block", P, 1))
    scene.apply_uniform_gravity(-9.81 * N.z)
    scene.add_loads((P, 5 * N.x))
    scene.add_holonomic_constraints(rail)
    if held:
        n = rail.diff(x) * N.x + rail.diff(y) * N.y
        scene.add_joints(da.Joint("rail", body="block", at=P, force=da.unknowns("R") * n))
    scene.add_contacts(da.PointPlane("foot", body="block", point=P, plane=(O, N.z), friction=0.4))
    return da.compile_model(scene, backend="numpy")


@pytest.mark.parametrize(
    ("rail", "named"),
    [
        (x - y, r"holonomic constraint 1, x - y = 0 \(a force along N\.x - N\.y\)"),
        (x / 2 - y, r"holonomic constraint 1, x/2 - y = 0 \(a force along 0\.5\*N\.x - N\.y\)"),
        (y - sp.sin(x), r"holonomic constraint 1, y - sin\(x\) = 0\. Give"),
    ],
    ids=["diagonal", "steep", "curved"],
)
def test_a_constraint_that_no_joint_holds_is_named_with_its_direction(rail, named):
    with pytest.raises(da.errors.ConstraintError) as error:
        railed(rail).mode(foot="slip")
    assert error.match(rf"'block' is missing.*: what holds {named}.*da\.Joint\(\"rail\", body='block', at=P, force=R")
    assert "'foot'" not in str(error.value)  # its normal reaction holds it
    start = {x: 0, y: 0, "z": 0, x.diff(): 0, y.diff(): 0, "z_dot": 0}
    assert railed(rail, held=True).simulate((0, 0.5), start, {}).success


def sample_of(twists, row, place=(0.0, 0.0, 0.0)):
    empty = np.zeros((6, 0))
    return BodySample(np.zeros(6), empty, empty, np.array(twists).T, np.array([row]), np.array([place]), {})


def test_the_direction_of_a_reaction():
    turn, along = [0.0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0]
    still = sample_of([along, turn], [0.0, -2.0])
    np.testing.assert_array_equal(reaction_direction([still], 0, [True]), turn)
    off_origin = sample_of([along, [0.3, -0.2, 0, 0, 0, 1]], [3.0, 0.0], (0.2, 0.3, 0.0))  # turns about its centre
    np.testing.assert_allclose(reaction_direction([off_origin], 0, [True]), along, atol=1e-15)
    both, other = sample_of([along, turn], [1.0, 1.0]), sample_of([[0.0, 1, 0, 0, 0, 0], turn], [1.0, 0.0])
    assert reaction_direction([both], 0, [True]) is None
    assert reaction_direction([off_origin, other], 0, [True]) is None
