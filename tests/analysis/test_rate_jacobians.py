"""Derivatives of the rates: against the recursion of Newton and Euler and the program, by complex steps; refusals."""

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import CapabilityError, ValueInputError
from dalembert.ir.program import hidden_parameters
from interop.robot_texts import ARM, WALKER
from mechanics.bodies import links, scene_of, torques
from oracles.complex_step import STEP, run_complex

TREES = {
    "arm of 7": ([i - 1 for i in range(7)], ["turn z", "turn y", "turn z", "turn y", "turn z", "turn y", "turn z"]),
    "plane of 15": ([i - 1 for i in range(15)], ["turn z"] * 15),
    "slides": ([i - 1 for i in range(5)], ["slide x", "turn y", "slide z", "turn x", "slide y"]),
    "star": ([-1, 0, 1, 0, 3, 0], ["turn y", "turn z", "slide x", "turn x", "turn z", "slide y"]),
}


def by_complex_steps(function, x):
    """Return the derivatives of a function of an array by its entries, (n_out, n)."""
    return np.array([function(x + 1j * STEP * unit).imag / STEP for unit in np.eye(len(x))]).T


def jacobians_of_program(model, t, y, values):
    """Return the derivatives of the right-hand side by the state and by all parameters; inputs stand in `values`."""
    program, parameters = model.stages.program, model.layout.parameters
    n, given = len(y), np.array([values.get(name, 0.0) for name in parameters])

    def rates(z):
        c = run_complex(program.kernel("prepare"), p=z[n:])
        return np.array(run_complex(program.kernel("rhs"), t=t, y=z[:n], c=c))

    found = by_complex_steps(rates, np.concatenate([y, given]))
    return found[:, :n], dict(zip(parameters, found[:, n:].T, strict=True))


@pytest.mark.parametrize("name", TREES)
def test_gradients_of_accelerations_solve_those_of_inverse_dynamics(name):
    """M dq_ddot + d tau(q, q_dot, q_ddot) = 0, in the terms of the recursion."""
    parents, kinds = TREES[name]
    tree = links(parents, kinds, 4, planar="plane" in name)
    scene, values = scene_of("tree", tree)
    model = da.compile_model(scene, backend="numpy", formulation="minimal")
    n = len(tree)
    y = np.random.default_rng(1).uniform(-1.2, 1.2, 2 * n)
    found, by_inputs = model.rate_jacobians(0.0, y, values)
    assert model.layout.state == (*model.layout.coordinates, *model.layout.rates)
    assert model.jacobian_kernel.along_tree and by_inputs.shape == (2 * n, 0)
    np.testing.assert_array_equal(found[:n], np.eye(2 * n)[n:])
    qddot = model.accelerations(0.0, y[:n], y[n:], values)
    expected = by_complex_steps(lambda z: torques(tree, z[:n], z[n:], qddot)[0], y)
    mass = by_complex_steps(lambda a: torques(tree, y[:n], 0 * y[n:], a)[0], 0 * qddot)
    sizes = np.abs(mass) @ np.abs(found[n:]) + np.abs(expected) + torques(tree, y[:n], y[n:], qddot)[1][:, np.newaxis]
    assert np.max(np.abs(mass @ found[n:] + expected) / sizes) < 1e-13


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("text", "floating"), [(ARM, False), (WALKER, True)])
def test_robots_with_a_finger_that_mimics_and_with_a_floating_base(backend, text, floating, tmp_path):
    """Several states at once, along the sphere of the quaternion, against complex steps through the program."""
    (tmp_path / "arm.urdf").write_text(text)
    scene = da.Scene.from_urdf(tmp_path / "arm.urdf", floating_base=floating, actuated=True, joint_loads="damping")
    model = da.compile_model(scene, backend=backend, formulation="minimal")
    layout, rng = model.layout, np.random.default_rng(3)
    y = rng.uniform(-1, 1, (2, len(layout.state)))
    four = [layout.state.index(f"base_e{i}") for i in range(4) if floating]
    if floating:
        y[:, four] /= np.linalg.norm(y[:, four], axis=1, keepdims=True)
    torque = dict(zip(layout.inputs, rng.uniform(-5, 5, len(layout.inputs)), strict=True))
    by_state, by_inputs = model.rate_jacobians(0.0, y, {}, inputs=torque)
    assert model.jacobian_kernel.along_tree == (not floating)  # speeds of the trunk on axes that turn with it
    for found, forces, at in zip(by_state, by_inputs, y, strict=True):
        values = {hidden_parameters(name)[1]: value for name, value in torque.items()}
        expected, by_parameters = jacobians_of_program(model, 0.0, at, values)
        e = at[four]
        expected[:, four] -= np.outer(expected[:, four] @ e, e)
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
        columns = [by_parameters[hidden_parameters(name)[1]] for name in layout.inputs]
        np.testing.assert_allclose(forces, np.transpose(columns), atol=1e-12 * np.abs(forces).max())


def cart(*, swinging=False, coordinates="relative", stop=False):
    """A cart with a pendulum: its pivot may be shaken, and the bob given in x and y with a rod as a constraint."""
    s, a, x, z, u = dynamicsymbols("s a x z u")
    m, l, k = symbols("m l k", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    shake = u if swinging else 0
    C = O.locatenew("C", s * N.x + shake * N.y)
    bob = (l * sin(a), -l * cos(a)) if coordinates == "relative" else (x, z)
    B = C.locatenew("B", bob[0] * N.x + bob[1] * N.y)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[s, a] if coordinates == "relative" else [s, x, z])
    scene.add_bodies(Particle("cart", C, 2 * m), Particle("bob", B, m))
    scene.apply_uniform_gravity(-9.81 * N.y)
    scene.add_inputs(u)
    scene.add_loads((C, (-k * s**3 - s.diff() * k + (0 if swinging else u)) * N.x))
    if stop:
        scene.add_joints(da.Stop("end", s, upper=1, body="cart", at=C, direction=N.x))
    if coordinates != "relative":
        scene.add_holonomic_constraints(x**2 + z**2 - l**2)
    return scene


@pytest.mark.parametrize(
    ("options", "formulation", "along_tree"),
    [
        ({}, "minimal", False),
        ({}, "projected", False),
        ({"swinging": True}, "minimal", False),
        ({"coordinates": "cartesian"}, "projected", False),
    ],
)
def test_other_scenes_have_those_of_their_right_hand_side(options, formulation, along_tree):
    """Screws that turn in their frame, inputs that move bodies, constraints."""
    model = da.compile_model(cart(**options), formulation=formulation)
    y = np.random.default_rng(2).uniform(0.2, 1, len(model.layout.state))
    values = {"m": 1.3, "l": 0.7, "k": 2.0}
    by_state, by_inputs = model.rate_jacobians(0.0, y, values, inputs={"u": 0.4})
    assert model.jacobian_kernel.along_tree == along_tree
    expected, by_parameters = jacobians_of_program(model, 0.0, y, values | {hidden_parameters("u")[1]: 0.4})
    np.testing.assert_allclose(by_state, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    expected = by_parameters[hidden_parameters("u")[1]][:, np.newaxis]
    np.testing.assert_allclose(by_inputs, expected, rtol=1e-12, atol=1e-12)


def test_what_has_no_jacobians_is_an_error_that_says_why():
    model = da.compile_model(cart())
    with pytest.raises(ValueInputError, match=r"y must have shape \(4,\) or \(k, 4\), not \(3,\)"):
        model.rate_jacobians(0.0, [0, 0, 0], {"m": 1, "l": 1, "k": 1}, inputs={"u": 0})
    with pytest.raises(CapabilityError, match=r"take mode\(...\).rate_jacobians of one of them"):
        da.compile_model(cart(stop=True)).rate_jacobians(0.0, np.zeros(4), {"m": 1, "l": 1, "k": 1}, inputs={"u": 0})


def test_an_input_that_a_controller_holds_is_a_component_of_the_state():
    scene = cart()
    (u,) = scene.inputs
    scene.add_controllers(da.Controller("law", period=0.1, inputs={u: -scene.coordinates[0]}))
    y, values = np.array([0.1, 0.2, 0.3, 0.4, 0.5]), {"m": 1.0, "l": 0.7, "k": 2.0}
    found, by_inputs = da.compile_model(scene).rate_jacobians(0.0, y, values)
    plain = da.compile_model(cart()).rate_jacobians(0.0, y[:4], values, inputs={"u": y[4]})
    np.testing.assert_allclose(found[:4, :4], plain.by_state, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found[:4, 4:], plain.by_inputs, rtol=1e-12, atol=1e-12)
    assert by_inputs.shape == (5, 0) and not np.any(found[4])
