"""Linearisation by inputs and of outputs: closed forms, differences, SymPy's linearizer, the benchmark bicycle."""

import functools
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from sympy import cos, sin, symbols
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import InitialStateError, MissingExtraError, OptionError, UnknownNameError
from hard_cases import machines

FORMULATIONS = ("minimal", "projected", "baumgarte", "ggl", "augmented")
SADDLES = FORMULATIONS[1:]
FREQUENCIES = np.array([0.3j, 1j, 2.0 + 3.0j, 40j])
u, w = dynamicsymbols("u w")
m, M, l, k, c, g, r = symbols("m M l k c g r", positive=True)


@functools.cache
def compiled(build, formulation="auto", outputs=()):
    return da.compile_model(build(), backend="numpy", formulation=formulation, outputs=list(outputs))


def cart_pole():
    """A cart pushed by u, and a rod at an angle a from the upper vertical with a torque w."""
    x, a = dynamicsymbols("x a")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, a])
    R = N.orientnew("R", "Axis", (a, N.z))
    cart = O.locatenew("cart", x * N.x)
    G = cart.locatenew("G", l * R.y)
    scene.add_bodies(Particle("cart", cart, M), RigidBody("rod", G, R, m, (inertia(R, 0, 0, k), G)))
    scene.add_inputs(u, w)
    scene.add_loads((cart, (u - c * x.diff()) * N.x), (R, w * N.z))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


POLE = {"m": 0.4, "M": 1.5, "l": 0.7, "k": 0.03, "c": 0.2, "g": 9.81}
POLE_STATE = {"x": 0.3, "a": 0.4, "x_dot": -0.2, "a_dot": 0.9}


def sleigh():
    """The Chaplygin sleigh with a thrust u on the blade and a torque w."""
    scene = da.scenes.chaplygin_sleigh()
    scene.add_inputs(u, w)
    frame = scene.bodies[0].frame
    (joint,) = scene.joints
    scene.add_loads((joint.at, u * frame.x), (frame, w * frame.z))
    return scene


SLEIGH = {"m": 1.0, "b": 0.3, "I_C": 0.5}
SLIDING = {"x": 0.1, "y": -0.2, "theta": 0.6, "x_dot": 1.5 * math.cos(0.6), "theta_dot": 0.4}


def loop():
    """A four-bar linkage of point masses with a torque u on its crank."""
    q = dynamicsymbols("q1:4")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("loop", frame=N, origin=O, coordinates=q)
    scene.add_inputs(u)
    frame, joint = N, O
    for i, length in enumerate((1, 2, sp.Rational(3, 2))):
        frame = frame.orientnew(f"F{i}", "Axis", (q[i], N.z))
        if not i:
            scene.add_loads((frame, u * N.z))
        joint = joint.locatenew(f"J{i}", length * frame.x)
        scene.add_bodies(Particle(f"mass{i}", joint.locatenew(f"G{i}", -length * frame.x / 2), m))
    closing = joint.pos_from(O) - r * N.x
    scene.add_holonomic_constraints(closing.dot(N.x), closing.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


LOOP = {"m": 1.0, "r": 2.0, "g": 9.81}


def quarter_car():
    """A body on a wheel on a road of height u, and the road also as the position of a point."""
    z, y = dynamicsymbols("z y")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("quarter_car", frame=N, origin=O, coordinates=[z, y])
    scene.add_inputs(u)
    body, wheel = O.locatenew("body", z * N.z), O.locatenew("wheel", y * N.z)
    strut = (k * (y - z) + c * (y - z).diff()) * N.z
    tyre = (r * (u - y) + l * (u - y).diff()) * N.z
    scene.add_bodies(Particle("body", body, M), Particle("wheel", wheel, m))
    scene.add_loads((body, strut), (wheel, tyre - strut))
    return scene


CAR = {"M": 300.0, "m": 40.0, "k": 2e4, "c": 1.5e3, "r": 1.8e5, "l": 90.0}


def hung_pendulum():
    """A pendulum, for small angles, whose pivot is at u."""
    a = dynamicsymbols("a")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("hung", frame=N, origin=O, coordinates=[a])
    scene.add_inputs(u)
    scene.add_bodies(Particle("bob", O.locatenew("P", (u + l * sin(a)) * N.x - l * cos(a) * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def differences(model, states, t, y, p, inputs, name, step=1e-5):
    """Return the derivatives of accelerations by an input, by differences."""
    n = len(model.layout.coordinates)
    more, less = (
        model.accelerations(t, y[:n], y[n : 2 * n], p, inputs={**inputs, name: inputs[name] + sign * step})
        for sign in (1, -1)
    )
    return (more - less) / (2 * step)


def test_a_cart_pole_against_differences_and_the_closed_form():
    model = compiled(cart_pole, "minimal")
    given = {"u": 0.8, "w": -0.3}
    found = model.linearize(0.0, POLE_STATE, POLE, inputs=given)
    assert found.inputs == ("u", "w")
    assert found.states == found.outputs == ("x", "a", "x_dot", "a_dot")
    y = model.state(POLE_STATE, POLE, inputs=given)
    for i, name in enumerate(found.inputs):
        expected = [0, 0, *differences(model, found.states, 0.0, y, POLE, given, name)]
        np.testing.assert_allclose(found.B[:, i], expected, atol=1e-9)
    np.testing.assert_array_equal(found.C, np.eye(4))
    np.testing.assert_array_equal(found.D, np.zeros((4, 2)))
    upright = model.linearize(0.0, dict.fromkeys(POLE_STATE, 0.0), POLE, inputs={"u": 0, "w": 0}, outputs=["a", "x"])
    mass = np.array([[1.9, -0.28], [-0.28, 0.4 * 0.49 + 0.03]])
    np.testing.assert_allclose(upright.B[2:], np.linalg.inv(mass), rtol=1e-13)
    stiff = np.linalg.solve(mass, [[0, 0, -0.2, 0], [0, 0.4 * 9.81 * 0.7, 0, 0]])
    np.testing.assert_allclose(upright.A[2:], stiff, rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(upright.C, [[0, 1, 0, 0], [1, 0, 0, 0]])
    s = FREQUENCIES[1]
    direct = np.linalg.inv(mass * s**2 + np.diag([0.2 * s, -0.4 * 9.81 * 0.7]))
    np.testing.assert_allclose(upright.transfer(s), direct[::-1], rtol=1e-12)
    np.testing.assert_allclose(upright.transfer(FREQUENCIES)[1], upright.transfer(s), rtol=1e-14)


def test_against_the_linearizer_of_sympy():
    """KanesMethod.linearize of the same cart and pole, at a state that is no equilibrium."""
    scene = cart_pole()
    x, a = scene.coordinates
    speeds = dynamicsymbols("v o")
    N, O = ReferenceFrame("N"), Point("O")
    O.set_vel(N, 0)
    R = N.orientnew("R", "Axis", (a, N.z))
    cart = O.locatenew("cart", x * N.x)
    G = cart.locatenew("G", l * R.y)
    cart.set_vel(N, speeds[0] * N.x)
    R.set_ang_vel(N, speeds[1] * N.z)
    G.v2pt_theory(cart, N, R)
    bodies = [Particle("cart", cart, M), RigidBody("rod", G, R, m, (inertia(R, 0, 0, k), G))]
    loads = [(cart, (u - c * speeds[0]) * N.x), (R, w * N.z), (G, -m * g * N.y)]
    kane = KanesMethod(N, [x, a], speeds, [x.diff() - speeds[0], a.diff() - speeds[1]])
    kane.kanes_equations(bodies, loads)
    at = {x: 0.3, a: 0.4, speeds[0]: -0.2, speeds[1]: 0.9, u: 0.8, w: -0.3}
    at |= {symbols(name, positive=True): value for name, value in POLE.items()}
    y = compiled(cart_pole, "minimal").state(POLE_STATE, POLE, inputs={"u": 0.8, "w": -0.3})
    second = compiled(cart_pole, "minimal").accelerations(0.0, y[:2], y[2:], POLE, inputs={"u": 0.8, "w": -0.3})
    at |= {speeds[0].diff(): second[0], speeds[1].diff(): second[1], x.diff(): -0.2, a.diff(): 0.9}
    A, B, order = kane.linearize(A_and_B=True, op_point=at)
    assert list(order) == [u, w]
    found = compiled(cart_pole, "minimal").linearize(0.0, POLE_STATE, POLE, inputs={"u": 0.8, "w": -0.3})
    np.testing.assert_allclose(found.A, np.array(A.subs(at).evalf(), dtype=float), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.B, np.array(B.subs(at).evalf(), dtype=float), rtol=1e-12, atol=1e-13)


@functools.cache
def closed_loop():
    q = compiled(loop, "projected").assemble({"q1": 0.9, "q2": -0.5, "q3": -2.0}, LOOP, fixed=["q1"], inputs={"u": 0})
    return {**q, "q1_dot": 1.2}


@pytest.mark.parametrize("formulation", SADDLES)
def test_a_loop_in_every_formulation(formulation):
    options = {"inputs": {"u": 0.7}, "states": ["q1", "q1_dot"], "outputs": ["q3", "q3_dot", "q1"]}
    found, other = (
        compiled(loop, name).linearize(0.0, closed_loop(), LOOP, **options) for name in (formulation, "projected")
    )
    np.testing.assert_allclose(found.A, other.A, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(found.D, other.D, rtol=1e-11, atol=1e-11)
    model = compiled(loop, formulation)
    y = model.state(closed_loop(), LOOP, inputs={"u": 0.7})
    expected = differences(model, found.states, 0.0, y, LOOP, {"u": 0.7}, "u")
    np.testing.assert_allclose(found.B, [[0.0], expected[:1]], atol=1e-8)
    h = 1e-5
    moved = [
        model.assemble({**closed_loop(), "q1": 0.9 + s * h}, LOOP, fixed=["q1", "q1_dot"], inputs={"u": 0})
        for s in (1, -1)
    ]
    slopes = [(moved[0][name] - moved[1][name]) / (2 * h) for name in ("q3", "q3_dot", "q1")]
    np.testing.assert_allclose(found.C[:, 0], slopes, atol=1e-7)
    np.testing.assert_allclose(found.C[:, 1], [0.0, found.C[0, 0], 0.0], atol=1e-12)


def test_a_loop_at_rest_whichever_coordinate_is_independent():
    model = compiled(loop, "projected")
    rest = {**closed_loop(), "q1_dot": 0.0, "q2_dot": 0.0, "q3_dot": 0.0}
    point = model.trim(rest, LOOP, inputs={"u": 0.7}, free=["q2", "q3", "u"])
    assert point.converged
    found = [
        model.linearize(
            0.0, point.initial, LOOP, inputs=point.inputs, states=[name, f"{name}_dot"], outputs=["q3", "q1"]
        )
        for name in ("q1", "q2", "q3")
    ]
    for each in found[1:]:
        np.testing.assert_allclose(each.eigenvalues, found[0].eigenvalues, rtol=1e-9)
        np.testing.assert_allclose(each.transfer(FREQUENCIES), found[0].transfer(FREQUENCIES), rtol=1e-9)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_sleigh_in_every_formulation(formulation):
    """Three coordinates stay free though one velocity is fixed; the transfer function is that of `augmented`."""
    given, outputs = {"u": 0.5, "w": -0.2}, ["x", "y", "theta", "x_dot", "y_dot", "theta_dot"]
    found, other = (
        compiled(sleigh, name).linearize(0.0, SLIDING, SLEIGH, inputs=given, outputs=outputs)
        for name in (formulation, "augmented")
    )
    assert len(found.states) == 5
    assert found.states == other.states
    np.testing.assert_allclose(found.A, other.A, atol=1e-12)
    np.testing.assert_allclose(found.eigenvalues, other.eigenvalues, atol=1e-6)
    np.testing.assert_allclose(found.transfer(FREQUENCIES), other.transfer(FREQUENCIES), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.B, other.B, atol=1e-12)
    heading = found.C[outputs.index("y_dot")] * math.cos(0.6) - found.C[outputs.index("x_dot")] * math.sin(0.6)
    turned = found.C[outputs.index("theta")] * 1.5
    np.testing.assert_allclose(heading, turned, atol=1e-12)


def test_a_quarter_car_whose_road_enters_with_its_rate():
    found = compiled(quarter_car).linearize(
        0.0, {"z": 0, "y": 0, "z_dot": 0, "y_dot": 0}, CAR, inputs={"u": 0.0}, outputs=["z", "y", "z_dot"]
    )
    np.testing.assert_allclose(found.B[:, 0], [0, 0, 0, 1.8e5 / 40], rtol=1e-14)
    np.testing.assert_allclose(found.by_input.rates[:, 0], [0, 0, 0, 90.0 / 40], rtol=1e-14)
    for s, response in zip(FREQUENCIES, found.transfer(FREQUENCIES), strict=True):
        strut = 2e4 + 1.5e3 * s
        matrix = np.array([[300 * s**2 + strut, -strut], [-strut, 40 * s**2 + strut + 1.8e5 + 90 * s]])
        direct = np.linalg.solve(matrix, [0, 1.8e5 + 90 * s])
        np.testing.assert_allclose(response[:, 0], [*direct, s * direct[0]], rtol=1e-12)
        A, B, C, D = found.realization()
        np.testing.assert_allclose(C @ np.linalg.solve(s * np.eye(4) - A, B) + D, response, rtol=1e-11)


def test_an_input_that_is_a_position():
    """a'' = -(g a + u'')/l at rest: the angle is a proper function of u, the velocity of the bob is not."""
    model = compiled(hung_pendulum)
    found = model.linearize(0.0, {"a": 0, "a_dot": 0}, {"l": 2.0, "g": 9.81, "m": 1.0}, inputs={"u": 0.3})
    np.testing.assert_allclose(found.by_input.second_rates, [[0], [-0.5]], atol=1e-15)
    np.testing.assert_array_equal(found.B, np.zeros((2, 1)))
    angle = model.linearize(
        0.0, {"a": 0, "a_dot": 0}, {"l": 2.0, "g": 9.81, "m": 1.0}, inputs={"u": 0.3}, outputs=["a"]
    )
    A, B, C, D = angle.realization()
    s = 2j
    np.testing.assert_allclose(C @ np.linalg.solve(s * np.eye(2) - A, B) + D, [[-(s**2) / (2 * s**2 + 9.81)]])
    with pytest.raises(OptionError, match=r"outputs a_dot depend on rates of the inputs u"):
        found.realization()


@pytest.mark.parametrize("formulation", SADDLES)
def test_an_input_in_a_holonomic_constraint(formulation):
    """A pendulum on a rope of length u: its bob follows the rope, and what swings does not depend on it at first."""
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("winch", frame=N, origin=O, coordinates=[x, y])
    scene.add_inputs(u)
    scene.add_bodies(Particle("bob", O.locatenew("P", x * N.x + y * N.y), m))
    scene.add_holonomic_constraints(x**2 + y**2 - u**2)
    scene.apply_uniform_gravity(-g * N.y)
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    start, p = {"x": 0.0, "y": -2.0, "x_dot": 0.0}, {"m": 1.0, "g": 9.81}
    found = model.linearize(0.0, start, p, inputs={"u": 2.0}, outputs=["y", "y_dot", "x"])
    assert found.states == ("x", "x_dot")
    np.testing.assert_allclose(found.A, [[0, 1], [-9.81 / 2, 0]], atol=1e-12)
    np.testing.assert_allclose(found.transfer(2j)[:, 0], [-1, -2j, 0], atol=1e-12)
    with pytest.raises(OptionError, match="outputs y_dot depend on rates of the inputs u"):
        found.realization()
    height = model.linearize(0.0, start, p, inputs={"u": 2.0}, outputs=["y"])
    np.testing.assert_allclose(height.realization()[3], [[-1.0]], atol=1e-12)


def test_records_count_with_their_rates():
    """About a moment of a record, drift has its rates; derivatives are those by values and rates there."""
    model = compiled(quarter_car)
    record = da.samples([0.0, 1.0, 2.0, 3.0], [0.0, 0.02, -0.01, 0.0], kind="cubic")
    start = {"z": 0, "y": 0, "z_dot": 0, "y_dot": 0}
    found = model.linearize(1.4, start, CAR, inputs={"u": record})
    constant = model.linearize(1.4, start, CAR, inputs={"u": 0.0})
    np.testing.assert_allclose(found.B, constant.B, rtol=1e-12)
    np.testing.assert_allclose(found.by_input.rates, constant.by_input.rates, rtol=1e-12)
    from scipy.interpolate import CubicSpline

    road = CubicSpline([0.0, 1.0, 2.0, 3.0], [0.0, 0.02, -0.01, 0.0])
    expected = (1.8e5 * road(1.4) + 90 * road(1.4, 1)) / 40
    np.testing.assert_allclose(found.drift, [0, 0, 0, expected], rtol=1e-12)


def test_compiled_outputs_have_rows():
    x, a = dynamicsymbols("x a")
    tip = x - 2 * l * sin(a)
    model = compiled(cart_pole, "minimal", (tip, u * x))
    found = model.linearize(
        0.0,
        POLE_STATE,
        POLE,
        inputs={u: 0.8, w: 0},
        states=[x, a, x.diff(), a.diff()],
        outputs=[str(tip), str(u * x), x],
    )
    np.testing.assert_allclose(found.C[0], [1, -1.4 * math.cos(0.4), 0, 0], atol=1e-14)
    np.testing.assert_allclose(found.C[1], [0.8, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(found.D, [[0, 0], [0.3, 0], [0, 0]], atol=1e-15)
    np.testing.assert_allclose(found.output_values, [0.3 - 1.4 * math.sin(0.4), 0.24, 0.3], rtol=1e-14)


def steered_bicycle():
    """The benchmark bicycle with a steering torque u between fork and rear frame."""
    scene = machines.bicycle_scene()
    frames = {body.name: body.frame for body in scene.bodies}
    lam, b = symbols("lam", real=True), frames["rider"]
    axis = -sin(lam) * b.x - cos(lam) * b.y  # about which psif turns the fork
    scene.add_inputs(u)
    scene.add_loads((frames["fork"], u * axis), (b, -u * axis))
    return scene


def test_steering_torque_of_the_benchmark_bicycle():
    """M q'' = [0, u]: columns of the inverse of the published mass matrix."""
    model = compiled(steered_bicycle, "projected")
    p, start = machines.bicycle_parameters(), machines.upright_bicycle(4.0)
    free = ["x", "y", "theta", "psi", "psif", "betar", "betaf", "psi_dot", "psif_dot", "betar_dot"]
    found = model.linearize(0.0, start, p, inputs={"u": 0.0}, states=free)
    mass = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
    column = np.linalg.inv(mass)[:, 1]
    rows = [free.index("psi_dot"), free.index("psif_dot")]
    np.testing.assert_allclose(np.abs(found.B[rows, 0]), np.abs(column), rtol=1e-12)
    assert found.B[rows[1], 0] > 0.0
    others = [i for i in range(len(free)) if i not in rows]
    np.testing.assert_allclose(found.B[others, 0], 0.0, atol=1e-12)
    block = found.block("psi", "psif", "psi_dot", "psif_dot")
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(block)),
        np.sort_complex(machines.bicycle_linearized(compiled(machines.bicycle_scene, "projected"), 4.0)),
        rtol=1e-9,
    )


def test_python_control_gets_names_and_matrices(monkeypatch):
    given = {}

    def ss(*matrices, **names):
        given.update(names, matrices=matrices)
        return "system"

    monkeypatch.setitem(sys.modules, "control", SimpleNamespace(ss=ss))
    found = compiled(quarter_car).linearize(
        0.0, {"z": 0, "y": 0, "z_dot": 0, "y_dot": 0}, CAR, inputs={"u": 0.0}, outputs=["z"]
    )
    assert found.to_control() == "system"
    assert given["states"] == ["z", "y", "z_dot", "y_dot shifted"]
    assert (given["inputs"], given["outputs"], given["matrices"][4]) == (["u"], ["z"], 0)
    for mine, passed in zip(found.realization(), given["matrices"], strict=False):
        np.testing.assert_array_equal(mine, passed)


def test_python_control_responds_alike():
    control = pytest.importorskip("control")
    found = compiled(cart_pole, "minimal").linearize(0.0, POLE_STATE, POLE, inputs={"u": 0, "w": 0}, outputs=["a"])
    system = found.to_control()
    assert list(system.input_labels) == ["u", "w"]
    np.testing.assert_allclose(control.evalfr(system, 2j), found.transfer(2j), rtol=1e-10)


def test_what_is_wrong_is_named(monkeypatch):
    model = compiled(cart_pole)
    at_rest = dict.fromkeys(POLE_STATE, 0.0)
    with pytest.raises(UnknownNameError, match="unknown output 'b'"):
        model.linearize(0.0, at_rest, POLE, inputs={"u": 0, "w": 0}, outputs=["b"])
    with pytest.raises(UnknownNameError, match="unknown input 'v'"):
        model.linearize(0.0, at_rest, POLE, inputs={"u": 0, "w": 0, "v": 1})
    with pytest.raises(UnknownNameError, match="missing inputs: w"):
        model.linearize(0.0, at_rest, POLE, inputs={"u": 0})
    with pytest.raises(InitialStateError, match="contradict"):
        compiled(loop, "projected").linearize(0.0, {**closed_loop(), "q2": 0.3}, LOOP, inputs={"u": 0})
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(MissingExtraError, match=r'pip install "dalembert\[control\]"'):
        model.linearize(0.0, at_rest, POLE, inputs={"u": 0, "w": 0}).to_control()
    without = compiled(da.scenes.chaplygin_sleigh).linearize(0.0, SLIDING, SLEIGH)
    assert without.B.shape == (5, 0) and without.D.shape == (5, 0)
    monkeypatch.setitem(sys.modules, "control", SimpleNamespace(ss=None))
    with pytest.raises(OptionError, match="no inputs"):
        without.to_control()


def test_trim_with_inputs():
    model = compiled(cart_pole, "minimal")
    start = {"x": 0.0, "a": 0.1, "x_dot": 0, "a_dot": 0}
    held = model.trim(start, POLE, inputs={"u": 1.0, "w": 0.0}, free=["u", "w"])
    assert held["u"] == pytest.approx(0.0, abs=1e-14)
    assert held["w"] == pytest.approx(-0.4 * 9.81 * 0.7 * math.sin(0.1), rel=1e-13)
    assert held.inputs == {"u": held["u"], "w": held["w"]}
    run = model.simulate((0.0, 1.0), held.initial, held.parameters, inputs=held.inputs)
    np.testing.assert_allclose(run["a"], 0.1, atol=1e-9)
    driven = model.trim({**start, "x_dot": 2.0, "a": 0.0}, POLE, inputs={"u": 0.0, "w": 0.0}, free=["u", "a"])
    assert driven["u"] == pytest.approx(0.4, rel=1e-12)  # against the damper, at constant speed
    with pytest.raises(UnknownNameError, match="unknown free value 'v'"):
        model.trim(start, POLE, inputs={"u": 1.0, "w": 0.0}, free=["v"])
    with pytest.raises(UnknownNameError, match="missing inputs: u, w"):
        model.trim(start, POLE)


def test_constraints_that_follow_from_others_change_nothing():
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("twice", frame=N, origin=O, coordinates=[x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bob", P, m))
    scene.add_holonomic_constraints(x**2 + y**2 - l**2, (x**2 + y**2 - l**2) * (1 + x**2))
    scene.apply_uniform_gravity(-g * N.y)
    model = da.compile_model(scene, backend="numpy", formulation="projected")
    found = model.linearize(0.0, {"x": 0.0, "y": -2.0, "x_dot": 0.0}, {"m": 1.0, "l": 2.0, "g": 9.81})
    np.testing.assert_allclose(found.A, [[0, 1], [-9.81 / 2, 0]], atol=1e-12)


def test_the_mode_at_hand_by_inputs():
    """A block on a table with friction, pulled by u: free where it slides, held where it sticks."""
    scene = da.Scene("block", frame=ReferenceFrame("N"), origin=Point("O"), coordinates=dynamicsymbols("x y"))
    x, y = scene.coordinates
    N = scene.frame
    P = scene.origin.locatenew("P", x * N.x + y * N.y)
    normal, friction = da.unknowns("normal friction")
    scene.add_bodies(Particle("block", P, m))
    scene.add_holonomic_constraints(y)
    scene.add_joints(da.Joint("table", body="block", at=P, force=friction * N.x + normal * N.y))
    scene.add_friction(da.CoulombFriction(normal, friction, mu=c, name="table"))
    scene.add_inputs(u)
    scene.add_loads((P, u * N.x))
    scene.apply_uniform_gravity(-g * N.y)
    model, p = da.compile_model(scene, backend="numpy"), {"m": 2.0, "c": 0.3, "g": 9.81}
    start = {"x": 0.0, "x_dot": 1.0, "y": 0.0}
    sliding = model.linearize(0.0, start, p, inputs={"u": 1.0}, outputs=["x_dot"])
    assert sliding.states == ("x", "x_dot")
    np.testing.assert_allclose(sliding.B, [[0], [0.5]], rtol=1e-14)
    np.testing.assert_allclose(sliding.drift, [1.0, 0.5 - 0.3 * 9.81], rtol=1e-13)
    sticking = model.linearize(0.0, {**start, "x_dot": 0.0}, p, inputs={"u": 1.0})
    assert sticking.states == ("x",)  # it could stick elsewhere
    assert not np.any(sticking.A) and not np.any(sticking.B) and not np.any(sticking.drift)


def test_states_are_trimmed_and_linearised_too():
    """A motor with current i holds a mass on a spring against gravity, driven by a voltage u."""
    x, i = dynamicsymbols("x i")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("motor", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.z)
    scene.add_bodies(Particle("mass", P, m))
    scene.add_inputs(u)
    scene.add_states({i: (u - r * i - k * x.diff()) / l})
    scene.add_loads((P, (k * i - c * x) * N.z))
    scene.apply_uniform_gravity(-g * N.z)
    model = da.compile_model(scene, backend="numpy")
    p = {"m": 2.0, "r": 1.5, "k": 0.8, "l": 0.1, "c": 30.0, "g": 9.81}
    rest = {"x": 0.0, "x_dot": 0.0, "i": 0.0}
    held = model.trim(rest, p, inputs={"u": 0.0}, free=["u", "i"])
    assert held.converged
    assert (held["i"], held["u"]) == pytest.approx((2 * 9.81 / 0.8, 1.5 * 2 * 9.81 / 0.8), rel=1e-13)
    hanging = model.trim(rest, p, inputs={"u": 3.0})
    assert (hanging["i"], hanging["x"]) == pytest.approx((2.0, (1.6 - 2 * 9.81) / 30), rel=1e-13)
    assert hanging.derivatives["i"] == pytest.approx(0.0, abs=1e-12)
    found = model.linearize(0.0, held.initial, p, inputs=held.inputs, outputs=["i", x])
    np.testing.assert_allclose(found.A, [[0, 1, 0], [-15, 0, 0.4], [0, -8, -15]], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(found.B, [[0], [0], [10]], rtol=1e-13)
    np.testing.assert_array_equal(found.C, [[0, 0, 1], [1, 0, 0]])
    with pytest.raises(InitialStateError, match="missing for the first-order states i"):
        model.trim({"x": 0.0, "x_dot": 0.0}, p, inputs={"u": 0.0})
    with pytest.raises(OptionError, match="2 conditions are to be met by 1 free values"):
        model.trim(rest, p, inputs={"u": 3.0}, free=["x"])


def test_a_sampled_loop_designed_with_python_control():
    """A linear scene under gains of dlqr: its run with a Controller is python-control's own simulation of the loop."""
    control = pytest.importorskip("control")
    z, y = dynamicsymbols("z y")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("two_masses", frame=N, origin=O, coordinates=[z, y])
    P, Q = O.locatenew("P", z * N.x), O.locatenew("Q", y * N.x)
    scene.add_bodies(Particle("P", P, m), Particle("Q", Q, M))
    pull = k * (y - z) + c * (y - z).diff()
    scene.add_inputs(u)
    scene.add_loads((P, (pull + u) * N.x), (Q, -pull * N.x))
    plant, p = da.compile_model(scene, backend="numpy"), {"m": 1.0, "M": 0.5, "k": 30.0, "c": 0.1}
    rest = {"z": 0.0, "y": 0.0, "z_dot": 0.0, "y_dot": 0.0}
    system = plant.linearize(0.0, rest, p, inputs={u: 0}).to_control()
    discrete = control.sample_system(system, 0.1)
    gain, _, _ = control.dlqr(discrete, np.diag([10.0, 10.0, 1.0, 1.0]), np.array([[0.5]]))
    loop = control.ss(discrete.A - discrete.B @ gain, discrete.B, np.eye(4), 0, 0.1)
    times = 0.1 * np.arange(41)
    start = np.array([0.3, -0.2, 0.0, 1.0])
    expected = control.initial_response(loop, times, start).outputs

    state = sp.Matrix([z, y, z.diff(), y.diff()])
    scene.add_controllers(da.Controller("lqr", period=sp.Rational(1, 10), inputs={u: -(sp.Matrix(gain) * state)[0]}))
    closed = da.compile_model(scene, backend="numpy")
    run = closed.simulate((0.0, 4.0), dict(zip(rest, start, strict=True)), p, t_eval=times, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose([run[name] for name in rest], expected, atol=1e-9)
    assert np.abs(np.linalg.eigvals(loop.A)).max() < 1.0
