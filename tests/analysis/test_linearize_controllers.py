"""Linearised maps of sampled loops: python-control's closed loops, matrix exponentials, differences of runs."""

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import expm
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import CapabilityError, OptionError, UnknownNameError, ValueInputError
from dalembert.reduction import FORMULATIONS

t = dynamicsymbols._t
x, a, u, v, w, e, f, y = dynamicsymbols("x a u v w e f y")
m, M, l, c, g, T, r, k_p, k_i, k_d = sp.symbols("m M l c g T r k_p k_i k_d", positive=True)
TIGHT = {"rtol": 1e-12, "atol": 1e-14}


def cart_pole(*controllers, inputs=(u, w)):
    """A cart pushed by u with a point mass on a rod at an angle a from the upper vertical, pushed by w."""
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, a])
    R = N.orientnew("R", "Axis", (a, N.z))
    cart = O.locatenew("cart", x * N.x)
    tip = cart.locatenew("tip", l * R.y)
    scene.add_bodies(Particle("cart", cart, M), Particle("tip", tip, m))
    scene.add_inputs(*inputs)
    scene.add_loads((cart, (u - c * x.diff()) * N.x), (tip, w * N.x))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_controllers(*controllers)
    return scene


POLE = {m: 0.4, M: 1.5, l: 0.7, c: 0.2, g: 9.81}
UPRIGHT = {x: 0, a: 0, x.diff(): 0, a.diff(): 0}
GAINS = {k_p: 44.0, k_d: 11.0, k_i: 0.1, T: 0.05}


def pid(period=T):
    return da.Controller(
        "pid",
        period=period,
        states={e: e + T * (x + a / 20)},
        inputs={u: x + 3 * x.diff() + k_i * e - k_p * a - k_d * a.diff()},
    )


def test_a_cart_pole_against_the_closed_loop_of_python_control():
    control = pytest.importorskip("control")  # in two seconds
    made = da.compile_model(cart_pole(pid()))
    found = made.linearize(0.0, UPRIGHT | {e: 0}, POLE | GAINS, inputs={w: 0}, outputs=[x, a])
    plant = da.compile_model(cart_pole()).linearize(0.0, UPRIGHT, POLE, inputs={u: 0, w: 0})
    sampled = control.sample_system(plant.to_control(), 0.05, "zoh")
    gains = control.ss(1, [[0.05, 0.05 / 20, 0, 0]], 0.1, [[1.0, -44.0, 3.0, -11.0]], 0.05)
    push = control.ss([], [], [], [[1.0], [0.0]], 0.05)
    disturbance = control.ss([], [], [], [[0.0], [1.0]], 0.05)
    loop = control.feedback(sampled, push * gains, sign=1) * disturbance
    loop = control.ss([], [], [], np.eye(4)[:2], 0.05) * loop
    assert found.states == ("x", "a", "x_dot", "a_dot", "e") and found.dt == 0.05 and found.inputs == ("w",)
    order = [0, 1, 2, 3, 4]
    np.testing.assert_allclose(found.A, loop.A[np.ix_(order, order)], atol=1e-9)
    np.testing.assert_allclose(found.B, loop.B, atol=1e-9)
    np.testing.assert_allclose(found.C, loop.C, atol=1e-12)
    np.testing.assert_allclose(found.D, loop.D, atol=1e-12)
    mine = found.to_control()
    assert mine.dt == 0.05 and mine.state_labels == list(found.states) and mine.output_labels == ["x", "a"]
    np.testing.assert_allclose(np.sort_complex(mine.poles()), np.sort_complex(loop.poles()), atol=1e-8)
    assert np.all(np.abs(found.eigenvalues) < 1) and np.all(np.diff(np.abs(found.eigenvalues)) <= 1e-12)
    steps = np.arange(60) * 0.05
    push = np.where(steps < 0.1, 1e-6, 0.0)
    linear = control.forced_response(mine, steps, push)
    runs = made.simulate(
        (0, steps[-1]),
        UPRIGHT | {e: 0},
        POLE | GAINS,
        inputs={w: da.samples(steps, push, "hold")},
        t_eval=steps,
        rtol=1e-13,
        atol=1e-18,
    )
    np.testing.assert_allclose(linear.outputs, [runs["x"], runs["a"]], atol=1e-15)


def differences(made, states, begin, t0, dt, given, inputs, shift=1e-5, rtol=1e-12):
    """Return the derivatives of the states after a period by the states, from runs."""
    columns = []
    for name in states:
        ends = []
        for sign in (1, -1):
            start = {str(key): value for key, value in begin.items()}
            start[name] += sign * shift
            run = made.simulate((t0, t0 + dt), start, given, inputs=inputs, t_eval=[t0, t0 + dt], rtol=rtol, atol=rtol)
            ends.append(np.array([run[each][-1] for each in states]))
        columns.append((ends[0] - ends[1]) / (2 * shift))
    return np.array(columns).T


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_away_from_equilibrium_against_differences(backend):
    made = da.compile_model(cart_pole(pid()), backend=backend, outputs=[x + e, u * x])
    begin = {"x": 0.3, "a": 0.4, "x_dot": -0.2, "a_dot": 0.9, "e": 0.1}
    given = POLE | GAINS
    for at, wind in ((0.0, 0.5), (3.0, da.samples([2, 3.02, 5], [0.0, 0.5, -1.0]))):
        found = made.linearize(at, begin, given, inputs={w: wind}, outputs=["u", x + e, a])
        np.testing.assert_allclose(
            found.A, differences(made, found.states, begin, at, 0.05, given, {w: wind}), atol=1e-7
        )
        run = made.simulate((at, at + 0.05), begin, given, inputs={w: wind}, t_eval=[at, at + 0.05], **TIGHT)
        end = np.array([run[name][-1] for name in found.states])
        np.testing.assert_allclose(found.values + found.drift, end, atol=1e-11)
        np.testing.assert_allclose(found.output_values, [run["u"][0], run[x + e][0], 0.4], atol=1e-12)
        law = [1, -44, 3, -11, 0.1]
        np.testing.assert_allclose(found.C, [law, [1 + 0.05, 0.05 / 20, 0, 0, 1], [0, 1, 0, 0, 0]], atol=1e-12)
        assert not np.any(found.D) and found.t == at
        ends = []
        for sign in (1, -1):
            moved = wind + sign * 1e-4 if at == 0.0 else da.samples(wind.t, wind.values + sign * 1e-4)
            more = made.simulate((at, at + 0.05), begin, given, inputs={w: moved}, **TIGHT)
            ends.append(np.array([more[name][-1] for name in found.states]))
        np.testing.assert_allclose(found.B[:, 0], (ends[0] - ends[1]) / 2e-4, atol=1e-8)


def test_several_rates_and_offsets_against_matrix_exponentials():
    """A slow loop sets the speed that a fast one follows; a third acts in between and so is a state."""
    slow = da.Controller("slow", period=0.3, inputs={v: 2 * (r - x)})
    fast = da.Controller("fast", period=0.1, inputs={u: 5 * (v - x.diff())})
    late = da.Controller("late", period=0.2, offset=0.25, inputs={y: -x + w}, states={f: f / 2 + x})
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_inputs(u, v, y, w)
    scene.add_loads((P, (u + y - c * x.diff()) * N.x))
    scene.add_controllers(slow, fast, late)
    made = da.compile_model(scene)
    begin = {x: 0.1, x.diff(): 0.4, f: 0.3, y: 0.5}
    found = made.linearize(1.0, begin, {m: 2, c: 0.5, r: 1}, inputs={w: 0.2})
    names = ("x", "x_dot", "y", "f")
    assert set(found.states) == set(names) and found.dt == pytest.approx(0.6, rel=1e-15)
    # x, x_dot, u, v, y, f, w, 1: affine maps between instants, every 0.05 s
    over = np.eye(8)
    over[:2, :2] = expm(np.array([[0, 1], [0, -0.25]]) * 0.05)
    whole = expm(np.array([[0, 1, 0], [0, -0.25, 0.5], [0, 0, 0]]) * 0.05)
    over[:2, 2] = over[:2, 4] = whole[:2, 2]
    total = np.eye(8)
    for k in range(12):
        act = np.eye(8)
        if k % 6 == 0:
            act[3] = [-2, 0, 0, 0, 0, 0, 0, 2]
        if k % 2 == 0:
            act[2] = 5 * act[3] - [0, 5, 0, 0, 0, 0, 0, 0]
        if k % 4 == 1:  # from 0.25 s on every 0.2 s, and so for ever before
            act[4] = [-1, 0, 0, 0, 0, 0, 1, 0]
            act[5] = [1, 0, 0, 0, 0, 0.5, 0, 0]
        total = over @ act @ total
    places = {"x": 0, "x_dot": 1, "y": 4, "f": 5}
    order = [places[name] for name in found.states]
    np.testing.assert_allclose(found.A, total[np.ix_(order, order)], atol=1e-10)
    np.testing.assert_allclose(found.B[:, 0], total[order, 6], atol=1e-10)
    z = np.array([0.1, 0.4, 0, 0, 0.5, 0.3, 0.2, 1.0])
    np.testing.assert_allclose(found.values + found.drift, (total @ z)[order], atol=1e-11)
    np.testing.assert_array_equal(found.C, np.eye(4))


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_on_constraints_in_every_formulation(formulation):
    """The sleigh with a sampled torque, whose constraint is nonholonomic, and a law in time."""
    scene = da.scenes.chaplygin_sleigh()
    S, theta = scene.bodies[0].frame, scene.coordinates[2]
    scene.add_inputs(u, w)
    scene.add_loads((S, (u + w) * S.z))
    scene.add_controllers(da.Controller("turn", period=0.25, inputs={u: sp.sin(t) - 2 * theta.diff() - theta}))
    made = da.compile_model(scene, formulation=formulation)
    begin = {"x": 0.1, "y": -0.2, "theta": 0.6, "x_dot": 1.5 * np.cos(0.6), "theta_dot": 0.4}
    given = {"m": 1.0, "b": 0.3, "I_C": 0.5}
    chosen = ["x", "y", "theta", "x_dot", "theta_dot"]
    found = made.linearize(0.5, begin, given, inputs={w: 0.1}, states=chosen)
    assert found.states == tuple(chosen)
    coarse = formulation == "ggl"  # multipliers in the stages reach no smaller tolerances
    expected = differences(made, chosen, begin, 0.5, 0.25, given, {w: 0.1}, *((1e-3, 1e-10) if coarse else ()))
    np.testing.assert_allclose(found.A, expected, atol=1e-6 if coarse else 1e-8)


def test_a_loop_closed_by_joints_and_no_inputs():
    """A slider-crank: a holonomic constraint with two solutions for what is left out."""
    q = dynamicsymbols("q1:3")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("crank", frame=N, origin=O, coordinates=q)
    A, B = (N.orientnew(name, "Axis", (q[i], N.z)) for i, name in enumerate("AB"))
    P = O.locatenew("P", A.x)
    Q = P.locatenew("Q", 2 * B.x)
    G = O.locatenew("G", A.x / 2)
    scene.add_bodies(RigidBody("crank", G, A, m, (inertia(A, 0, 0, 0.1), G)), Particle("slider", Q, m))
    scene.add_holonomic_constraints(Q.pos_from(O).dot(N.y))
    scene.add_inputs(u)
    scene.add_loads((A, u * N.z))
    scene.add_controllers(da.Controller("drive", period=0.1, inputs={u: 3 - q[0].diff()}))
    made = da.compile_model(scene)
    begin = {"q1": 0.5, "q2": -np.arcsin(0.5 * np.sin(0.5)), "q1_dot": 1.0}
    found = made.linearize(0.0, begin, {m: 1.0}, states=["q1", "q1_dot"])

    def after(angle, speed):
        start = {"q1": angle, "q2": -np.arcsin(0.5 * np.sin(angle)), "q1_dot": speed}
        run = made.simulate((0, 0.1), start, {m: 1.0}, **TIGHT)
        return np.array([run["q1"][-1], run["q1_dot"][-1]])

    h = 1e-5
    by = [(after(0.5 + h, 1.0) - after(0.5 - h, 1.0)), (after(0.5, 1.0 + h) - after(0.5, 1.0 - h))]
    np.testing.assert_allclose(found.A, np.array(by).T / (2 * h), atol=1e-7)
    pytest.importorskip("control")
    loop = found.to_control()
    assert found.B.shape == (2, 0) and loop.ninputs == 0 and loop.dt == 0.1


def test_what_has_no_map_is_refused_by_name():
    several = [
        da.Controller("one", period=0.1, inputs={u: -a}),
        da.Controller("other", period=sp.sqrt(2) / 10, inputs={w: -x}),
    ]
    made = da.compile_model(cart_pole(*several))
    with pytest.raises(OptionError, match=r"one \(0.1 s\), other \(0.141421356 s\) have no common period"):
        made.linearize(0.0, UPRIGHT, POLE)
    made = da.compile_model(cart_pole(da.Controller("own", period=0.1, inputs=[u], function=lambda *_: ([0], []))))
    with pytest.raises(
        CapabilityError, match=r"linearize calls no Python functions, .*own.* write them as expressions"
    ):
        made.linearize(0.0, UPRIGHT, POLE, inputs={w: 0})
    made = da.compile_model(cart_pole(pid()))
    with pytest.raises(UnknownNameError, match="missing inputs: w"):
        made.linearize(0.0, UPRIGHT | {e: 0}, POLE | GAINS)
    with pytest.raises(ValueInputError, match="controller 'pid' has the period -1 s"):
        da.compile_model(cart_pole(pid(r - 2))).linearize(0, UPRIGHT | {e: 0}, POLE | GAINS | {r: 1}, inputs={w: 0})
    short = {w: da.samples([0, 0.01], [0, 0])}
    with pytest.raises(ValueInputError, match="w"):
        made.linearize(0.0, UPRIGHT | {e: 0}, POLE | GAINS, inputs=short)
