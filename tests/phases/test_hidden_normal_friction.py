"""Friction on a normal reaction that the coordinates hide, against closed forms, SciPy, and the released coordinate."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import ConstraintError

x, y, theta, phi = dynamicsymbols("x y theta phi")
m, M, g, mu, l = symbols("m M g mu l", positive=True)
slope, push = symbols("slope push", real=True)
N, O = ReferenceFrame("N"), Point("O")
S = N.orientnew("S", "Axis", (slope, N.z))
R = N.orientnew("R", "Axis", (theta, N.z))
X, Z = da.unknowns("X Z")
VALUES = {m: 2.0, g: 9.81, mu: 0.6, slope: -0.3, push: 0.0}
SLOWING = 9.81 * (0.6 * np.cos(0.3) - np.sin(0.3))


def block():
    """A block on an incline in the coordinate along it, on which a force presses."""
    P = O.locatenew("P", x * S.x)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((P, -push * S.y))
    scene.add_joints(da.Joint("floor", body="block", at=P, force=X * S.x + Z * S.y))
    scene.add_friction(da.CoulombFriction(normal=Z, tangential=X, mu=mu))
    return scene, P


@pytest.mark.parametrize("formulation", ["minimal", "projected", "baumgarte", "ggl", "augmented"])
def test_block_slides_to_rest_on_an_incline(formulation):
    scene, P = block()
    runs = []
    for each in (scene, scene.release(y, P, S.y)):
        model = da.compile_model(each, backend="numpy", formulation=formulation, outputs=["Z", "X"])
        runs.append(model.simulate((0, 1), {"x": 0, "x_dot": 1}, VALUES, rtol=1e-9))
    own, released = runs
    assert own.q.shape[1] == 1
    for run in runs:
        assert run.phases[0].t1 == pytest.approx(1 / SLOWING, rel=1e-7)
        assert run["x"][-1] == pytest.approx(0.5 / SLOWING, rel=1e-7)
        assert run["X"][[0, -1]] == pytest.approx([-0.6 * 19.62 * np.cos(0.3), -19.62 * np.sin(0.3)], rel=1e-7)
    np.testing.assert_allclose(own["Z"], 19.62 * np.cos(0.3), rtol=1e-13)
    assert [phase.modes for phase in own.phases] == [phase.modes for phase in released.phases]


def test_reaction_keeps_its_sign_and_sweeps_agree():
    """A force of 40 N lifts the block against its guide."""
    model = da.compile_model(block()[0], outputs=["Z", "X"])
    start, pull = {"x": 0, "x_dot": 1}, np.array([-40.0, 0.0, 30.0])
    sweep = model.sweep((0, 0.02), start, {**VALUES, push: pull}, rtol=1e-11)
    normal = 19.62 * np.cos(0.3) + pull
    np.testing.assert_allclose(sweep["Z"], normal, rtol=1e-12)
    np.testing.assert_allclose(sweep["X"], -0.6 * np.abs(normal), rtol=1e-12)
    rates = 1 + 0.02 * (9.81 * np.sin(0.3) - 0.3 * np.abs(normal))
    np.testing.assert_allclose(sweep["x_dot"], rates, rtol=1e-10)


def test_bead_on_a_rough_ring():
    """The normal force has the square of the speed, and changes its sign."""
    P = O.locatenew("P", l * R.x)
    scene = da.Scene("ring", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("bead", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Joint("ring", body="bead", at=P, force=X * R.y + Z * R.x))
    scene.add_friction(da.CoulombFriction(normal=Z, tangential=X, mu=mu))
    model = da.compile_model(scene, outputs=["Z"])
    p = {m: 2.0, g: 9.81, mu: 0.2, l: 0.5}
    times = np.linspace(0, 0.3, 7)
    run = model.simulate((0, 0.3), {theta: 1.2, theta.diff(): 4.5}, p, t_eval=times, rtol=1e-11)

    def normal(angle, rate):
        return 2.0 * (9.81 * np.sin(angle) - 0.5 * rate**2)

    def rates(_, state):
        force = -19.62 * np.cos(state[0]) - 0.2 * np.abs(normal(*state)) * np.sign(state[1])
        return [state[1], force / (2.0 * 0.5)]

    turned = solve_ivp(rates, (0, 0.3), [1.2, 4.5], rtol=1e-10, atol=1e-12, t_eval=times, max_step=2e-3)
    assert run["Z"].min() < -1 and run["Z"].max() > 1 and run["theta_dot"].min() > 1
    np.testing.assert_allclose(run["theta"], turned.y[0], rtol=1e-7)
    np.testing.assert_allclose(run["Z"], normal(*run.q.T, *run.qdot.T), rtol=1e-11)


def test_normals_that_depend_on_accelerations_or_take_impacts_need_a_coordinate():
    scene, P = block()
    B = N.orientnew("B", "Axis", (phi, N.z))
    Q = P.locatenew("Q", -l * B.y)
    swinging = scene.copy()
    swinging.coordinates += (phi,)
    swinging.add_bodies(Particle("bob", Q, M))
    stopped = scene.copy()
    C = da.unknowns("C")
    stopped.add_joints(da.Joint("wall", body="block", at=P, force=-C * S.x))
    stopped.add_contacts(da.UnilateralContact(normal=C, gap=1 - x))
    for each in (swinging, stopped):
        with pytest.raises(ConstraintError, match=r"friction 'Z' needs Z, which .* Release the coordinate"):
            model = da.compile_model(each, backend="numpy")
            start = {q: 0.1 for q in each.coordinates} | {q.diff(): 1 for q in each.coordinates}
            model.simulate((0, 0.1), start, {**VALUES, **({} if each is stopped else {M: 1.0, l: 0.5})})
