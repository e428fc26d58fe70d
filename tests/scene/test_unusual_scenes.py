"""Valid scenes that are out of the ordinary, against computations that share nothing with the compiler."""

import numpy as np
import pytest

import dalembert as da
from scene.builders import (
    cartesian_pendulum,
    double_pendulum,
    euler,
    flywheel_without_mass,
    four_bar,
    quaternion_body,
    shaken_pendulum,
    stop,
)

FORMULATIONS = ("projected", "augmented")


def rotation(e):
    """Return the matrix that takes body components to those on N, for Euler parameters e (4,)."""
    w, x, y, z = e
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def quaternion_product(a, b):
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("seed", range(4))
def test_quaternion_accelerations_are_those_of_newton_and_euler(formulation, seed):
    """M alone is singular along e; on e.e = 1 the motion is determined all the same."""
    model = da.compile_model(quaternion_body(), backend="numpy", formulation=formulation)
    rng = np.random.default_rng(seed)
    p = {"m": 1.3, "A": 0.4, "B": 0.9, "C": 0.7, "g": 9.81, "k": 0.6}
    e = rng.normal(size=4)
    e /= np.linalg.norm(e)
    omega = rng.uniform(-3, 3, 3)  # on the body
    e_dot = quaternion_product(e, np.array([0, *omega])) / 2
    inertias, torque = np.array([p["A"], p["B"], p["C"]]), np.array([p["k"], 0, 0])
    alpha = (torque - np.cross(omega, inertias * omega)) / inertias
    e_ddot = quaternion_product(e, np.array([0, *alpha])) / 2 - omega @ omega / 4 * e
    q, qdot = np.array([0.3, -1.0, 2.0, *e]), np.array([1.0, 0.2, -0.4, *e_dot])
    expected = [0, 0, -p["g"], *e_ddot]
    np.testing.assert_allclose(model.accelerations(0.0, q, qdot, p), expected, rtol=1e-11, atol=1e-12)


@pytest.mark.filterwarnings("ignore::dalembert.errors.EnergyWarning")  # a torque that follows the body
def test_quaternion_body_keeps_energy_and_angular_momentum():
    model = da.compile_model(quaternion_body(), backend="numpy", formulation="projected")
    p = {"m": 1.3, "A": 0.4, "B": 0.9, "C": 0.7, "g": 0.0, "k": 0.0}
    e0 = np.array([0.8, 0.0, 0.6, 0.0])
    omega0 = np.array([0.3, 2.0, -0.5])
    e_dot = quaternion_product(e0, np.array([0, *omega0])) / 2
    names = ("e0", "e1", "e2", "e3")
    initial = dict.fromkeys(("x", "y", "z", "x_dot", "y_dot", "z_dot"), 0.0)
    initial |= dict(zip(names, e0, strict=True)) | {f"{n}_dot": v for n, v in zip(names, e_dot, strict=True)}
    trajectory = model.simulate((0, 5), initial, p, rtol=1e-10, atol=1e-12)
    assert trajectory.success
    momenta = []
    for q, qdot in zip(trajectory.q[:, 3:], trajectory.qdot[:, 3:], strict=True):
        omega = 2 * quaternion_product(q * [1, -1, -1, -1], qdot)[1:]
        momenta.append(rotation(q) @ (np.array([p["A"], p["B"], p["C"]]) * omega))
    assert np.ptp(momenta, axis=0).max() < 1e-8
    assert np.ptp(trajectory["energy"]) < 1e-8
    assert np.abs(trajectory.constraint_violation).max() < 1e-12


def test_absolute_and_relative_angles_are_one_motion():
    """a, b absolute = a, a + b relative: accelerations map linearly."""
    absolute = da.compile_model(double_pendulum(True), backend="numpy")
    relative = da.compile_model(double_pendulum(False), backend="numpy")
    rng = np.random.default_rng(3)
    p = {"m": 0.7, "M": 1.9, "l": 0.8, "r": 0.5, "A": 0.2, "g": 9.81}
    change = np.array([[1.0, 0.0], [1.0, 1.0]])
    for _ in range(5):
        q, qdot = rng.uniform(-3, 3, 2), rng.uniform(-3, 3, 2)
        expected = change @ relative.accelerations(0.0, q, qdot, p)
        np.testing.assert_allclose(absolute.accelerations(0.0, change @ q, change @ qdot, p), expected, rtol=1e-11)
        mapped = change.T @ absolute.mass_matrix(change @ q, p) @ change
        np.testing.assert_allclose(relative.mass_matrix(q, p), mapped, rtol=1e-12)


def test_shaken_pendulum_feels_the_acceleration_of_its_support():
    """On a support that accelerates, gravity is g less that acceleration."""
    model = da.compile_model(shaken_pendulum(), backend="numpy")
    p = {"m": 1.3, "A": 0.4, "l": 0.7, "h": 0.3, "w": 5.0, "g": 9.81}
    a, t = 0.4, 1.7
    support = np.array([2 * p["h"] / 5, -p["h"] * p["w"] ** 2 * np.sin(p["w"] * t)])
    pull = np.array([0, -p["g"]]) - support
    arm = np.array([-np.sin(a), np.cos(a)])
    expected = p["m"] * p["l"] * pull @ arm / (p["A"] + p["m"] * p["l"] ** 2)
    assert model.accelerations(t, [a], [2.0], p)[0] == pytest.approx(expected, rel=1e-13)


def test_wheel_without_mass_on_an_arm_without_inertia():
    model = da.compile_model(flywheel_without_mass(), backend="numpy")
    p = {"A": 0.3, "B": 0.2, "m": 1.5, "l": 0.6, "g": 9.81}
    q, qdot = [0.5, 1.1], [0.7, -4.0]
    expected = -p["m"] * p["g"] * p["l"] * np.cos(q[0]) / (p["m"] * p["l"] ** 2 + p["B"])
    np.testing.assert_allclose(model.accelerations(0.0, q, qdot, p), [expected, 0.0], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        ((0.5, 1.0, 0.1, 0.2), (0.0, -0.3 * 0.2)),
        ((1.5, 1.0, 0.1, 2.0), (-40.0 * 0.5, -0.3 * 0.5)),
        ((1.5, -1.0, 0.1, -2.0), (-40.0 * 0.5, 0.3 * 0.5 + 40.0)),
    ],
)
@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_piecewise_forces_act_where_they_say(backend, state, expected):
    model = da.compile_model(stop(), backend=backend, cache=False)
    p = {"m": 1.0, "k": 40.0, "l": 1.0, "c": 0.3, "r": 0.5}
    np.testing.assert_allclose(model.accelerations(0.0, state[:2], state[2:], p), expected, rtol=1e-13)


def test_free_body_keeps_its_energy_and_velocity_in_angles_of_any_order():
    p = {"m": 1.0, "A": 2.0, "B": 3.0, "C": 4.0, "l": 0.5, "k": 0.0}
    for kind, order in (("Body", "ZXZ"), ("Space", "123"), ("Body", "321")):
        model = da.compile_model(euler(kind, order), backend="numpy")
        names = model.layout.coordinates
        initial = {name: 0.2 + 0.3 * i for i, name in enumerate(names)} | {f"{n}_dot": 0.5 for n in names}
        trajectory = model.simulate((0, 2), initial, p, rtol=1e-10, atol=1e-12)
        assert trajectory.success
        assert np.ptp(trajectory["kinetic_energy"]) < 1e-8
        np.testing.assert_allclose(trajectory["x_dot"], 0.5, rtol=1e-9)


def four_bar_state():
    """Return a configuration of the four-bar that closes, with the one velocity it leaves free at 1."""
    p = {"m": 1.2, "g": 9.81, "l1": 0.4, "l2": 1.0, "l3": 0.9, "r": 1.1}
    first = 1.1
    end = np.array([p["r"], 0.0])
    elbow = p["l1"] * np.array([np.cos(first), np.sin(first)])
    gap = end - elbow
    distance = np.hypot(*gap)
    bend = np.arccos((p["l2"] ** 2 + distance**2 - p["l3"] ** 2) / (2 * p["l2"] * distance))
    second = np.arctan2(gap[1], gap[0]) + bend
    knee = elbow + p["l2"] * np.array([np.cos(second), np.sin(second)])
    third = np.arctan2(*(end - knee)[::-1])
    return p, {"q1": first, "q2": second - first, "q3": third - second, "q1_dot": 1.0}


@pytest.mark.parametrize("formulation", ["auto", "projected"])
def test_four_bar_closes_and_keeps_its_energy(formulation):
    model = da.compile_model(four_bar(), backend="numpy", formulation=formulation)
    assert model.formulation == "projected"
    p, initial = four_bar_state()
    trajectory = model.simulate((0, 1), initial, p, rtol=1e-10, atol=1e-12)
    assert trajectory.success
    assert np.abs(trajectory.constraint_violation).max() < 1e-12
    assert np.ptp(trajectory["energy"]) < 1e-7


def test_four_bar_accelerations_solve_the_saddle_point_system():
    model = da.compile_model(four_bar(), backend="numpy")
    p, initial = four_bar_state()
    start = model.simulate((0, 0), initial, p)
    q, qdot = start.q[0], start.qdot[0]
    M, F, J = model.mass_matrix(q, p), model.forcing(0, q, qdot, p), model.constraint_jacobian(0, q, p)
    step = 1e-6
    bias = -(model.constraint_jacobian(0, q + step * qdot, p) - model.constraint_jacobian(0, q - step * qdot, p)) @ qdot
    system = np.block([[M, -J.T], [J, np.zeros((2, 2))]])
    expected = np.linalg.solve(system, np.concatenate([F, bias / (2 * step)]))[:3]
    np.testing.assert_allclose(model.accelerations(0, q, qdot, p), expected, rtol=1e-7)


def test_cartesian_pendulum_swings_like_a_pendulum():
    model = da.compile_model(cartesian_pendulum(), backend="numpy")
    p = {"m": 2.0, "l": 0.5, "g": 9.81}
    angle, rate = 0.4, 1.3  # from the downward vertical
    direction, across = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    found = model.accelerations(0, p["l"] * direction, p["l"] * rate * across, p)
    expected = -p["g"] * np.sin(angle) * across - p["l"] * rate**2 * direction
    np.testing.assert_allclose(found, expected, rtol=1e-12)
