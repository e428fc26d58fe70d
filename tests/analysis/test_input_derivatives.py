"""Derivatives of runs by the values of inputs: closed forms, and differences of two runs."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError

x, y, u, w, a = dynamicsymbols("x y u w a")
t = dynamicsymbols._t
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
KNOTS = np.array([-0.5, 0.3, 0.55, 1.2, 1.9, 2.5])
VALUES = np.array([0.4, -1.0, 0.7, 1.5, -0.3, 0.8])
N, O = ReferenceFrame("N"), Point("O")


def pushed(force, **more):
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("p", place, 2))
    scene.add_loads((place, force * N.x))
    scene.add_inputs(u)
    for name, argument in more.items():
        getattr(scene, name)(argument)
    return scene


def differences(model, span, start, p, kind, places, knots=KNOTS, h=1e-3):
    """Return central differences of order four of the coordinates at the end by some of the values."""
    found = []
    for j in places:
        total = 0.0
        for steps, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):
            values = VALUES.copy()
            values[j] += steps * h
            inputs = {u: da.samples(knots, values, kind)}
            total = total + weight * model.simulate(span, start, p, inputs=inputs, **TIGHT).q[-1]
        found.append(total / (12 * h))
    return np.array(found).T


def check(model, start, kind="cubic", span=(0.0, 2.0), p=None, knots=KNOTS, names=("x",)):
    """Compare all derivatives by the values of u with differences."""
    record = {u: da.samples(knots, VALUES, kind)}
    found = model.sensitivity(span, start, p or {}, inputs=record, wrt=[u], of=names, **TIGHT)
    assert found.success and found.wrt == tuple(f"u[{j}]" for j in range(6))
    wanted = differences(model, span, start, p or {}, kind, range(6), knots)
    scale = max(1.0, np.abs(wanted).max())
    np.testing.assert_allclose(found.jacobians[-1], wanted[: len(names)], rtol=0, atol=1e-7 * scale)
    return found


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize("kind", ["hold", "linear"])
def test_mass_that_is_pushed(backend, kind):
    """The push at time s moves a free mass of 2 kg by (T - s) / 2 at T; backwards as well."""
    model = da.compile_model(pushed(u), backend=backend)
    record = {u: da.samples(KNOTS, VALUES, kind)}
    for end in (2.0, -0.4):
        found = model.sensitivity((0, end), {"x": 0, "x_dot": 0}, {}, inputs=record, wrt=[u], of=["x"], **TIGHT)
        s = np.linspace(0, end, 200_001)
        s = (s[1:] + s[:-1]) / 2
        for j in range(6):
            unit = np.eye(6)[j]
            weight = unit[np.searchsorted(KNOTS, s) - 1] if kind == "hold" else np.interp(s, KNOTS, unit)
            exact = np.sum((end - s) * weight) / 2 * end / len(s)
            assert found.jacobian("x", f"u[{j}]")[-1] == pytest.approx(exact, abs=1e-5 if kind == "hold" else 1e-9)
    constant = model.sensitivity((0, 2), {"x": 0, "x_dot": 0}, {}, inputs={u: 0.3}, wrt=["u"], of=["x"], **TIGHT)
    assert constant.jacobian("x", u)[-1] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("kind", ["hold", "linear", "cubic"])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_nonlinear_in_input_and_state(kind, method):
    model = da.compile_model(pushed(u - 3 * sp.sin(x) + u**2 * x - x.diff() * u))
    record, start = {u: da.samples(KNOTS, VALUES, kind)}, {"x": 0.2, "x_dot": 0.1}
    found = model.sensitivity(
        (0, 2), start, {}, inputs=record, wrt=["u[3]", x, "u[1]"], of=["x"], method=method, **TIGHT
    )
    wanted = differences(model, (0, 2), start, {}, kind, [3, 1])[0]
    np.testing.assert_allclose(found.jacobians[-1][0, [0, 2]], wanted, rtol=0, atol=1e-7)


def test_pivot_that_an_input_moves():
    """Velocity and acceleration of the pivot are those of the spline."""
    A = N.orientnew("A", "Axis", (a, N.z))
    pivot = O.locatenew("Q", u * N.x)
    G = pivot.locatenew("G", -A.y / 2)
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[a])
    scene.add_bodies(RigidBody("bar", G, A, 1, (inertia(A, 0, 0, sp.Rational(1, 12)), G)))
    scene.apply_uniform_gravity(-9.81 * N.y)
    scene.add_inputs(u)
    check(da.compile_model(scene), {"a": 0.3, "a_dot": 0.2}, names=("a",))


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_constraint_that_contains_an_input(formulation):
    """The start, where x and its rate are left out, depends on the values too."""
    scene = da.Scene("wire", frame=N, origin=O, coordinates=[x, y])
    place = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bead", place, 1))
    scene.add_holonomic_constraints(x - u - y**2 / 3)
    scene.add_loads((place, -4 * y * N.y))
    scene.add_inputs(u)
    model = da.compile_model(scene, formulation=formulation)
    found = check(model, {"y": 0.5, "y_dot": 0.1}, names=("x", "y"))
    assert np.abs(found.jacobians[0]).max() > 0.1


def test_controller_that_follows_a_record():
    """What it holds depends on the values from instant to instant."""
    law = da.Controller("p", period=0.13, states={w: w + 0.13 * (u - x)}, inputs={a: 5 * (u - x) + 2 * w - x.diff()})
    model = da.compile_model(pushed(a - sp.sin(x), add_controllers=law, add_inputs=a))
    check(model, {"x": 0.1, "x_dot": 0.0, "w": 0.2}, "linear")


def test_far_from_time_zero():
    """In elapsed time, where the phase of a drive is a parameter."""
    model = da.compile_model(pushed(u * sp.cos(3 * t) - x))
    check(model, {"x": 0.1, "x_dot": 0.0}, "cubic", (5e3, 5e3 + 2), knots=5e3 + KNOTS)


def test_faults():
    model = da.compile_model(pushed(u), backend="numpy")
    start = {"x": 0, "x_dot": 0}
    record = {u: da.samples(KNOTS, VALUES)}
    with pytest.raises(UnknownNameError, match=r"'u\[6\]' is no value of the input 'u', .* 'u\[0\]' to 'u\[5\]'"):
        model.sensitivity((0, 1), start, {}, inputs=record, wrt=["u[6]"])
    with pytest.raises(UnknownNameError, match=r"'u\[0\]' is no value of the input 'u', which has one, 'u'"):
        model.sensitivity((0, 1), start, {}, inputs={u: 1.0}, wrt=["u[0]"])
    with pytest.raises(UnknownNameError, match="unknown parameter or given initial value 'v'"):
        model.sensitivity((0, 1), start, {}, inputs=record, wrt=["v"])
    many = {u: da.samples(np.linspace(0, 1, 2001), np.zeros(2001))}
    with pytest.raises(OptionError, match=r"derivatives by 2001 values of inputs.*2000 at most.*'u\[0\]'.*solve_fn"):
        model.sensitivity((0, 1), start, {}, inputs=many, wrt=[u])


@pytest.mark.parametrize("times", [None, [0.0, 2.5, 5.0]])
def test_many_values_are_taken_in_blocks(times):
    """A mass of 2 under a force by lines between 250 knots: the double integral of each hat, in closed form."""
    model, knots = da.compile_model(pushed(u)), np.linspace(0, 5, 250)
    given = {u: da.samples(knots, np.cos(knots))}
    for start in (0.0, 7.0):
        moved = {u: da.samples(knots + start, np.cos(knots))}
        t_eval = None if times is None else start + np.array(times)
        run = model.sensitivity(
            (start, start + 5), {"x": 0, "x_dot": 0}, {}, inputs=moved, of=["x"], wrt=["x_dot", u], t_eval=t_eval
        )
        assert run.success and run.wrt == ("x_dot", *(f"u[{i}]" for i in range(250)))
        assert run.jacobians.shape == (len(run.t), 1, 251)
        np.testing.assert_allclose(run.jacobians[-1, 0, 0], 5.0, rtol=1e-12)
        width = knots[1]
        inner = width * (5.0 - knots[1:-1]) / 2
        np.testing.assert_allclose(run.jacobians[-1, 0, 2:-1], inner, rtol=1e-9)
        np.testing.assert_allclose(run.jacobians[-1, 0, 1], width / 4 * (5.0 - width / 3), rtol=1e-9)
    alone = model.sensitivity((0, 5), {"x": 0, "x_dot": 0}, {}, inputs=given, of=["x"], wrt=["u[130]"], t_eval=[5.0])
    np.testing.assert_allclose(run.jacobian("x", "u[130]")[-1], alone.jacobians[-1, 0, 0], rtol=1e-10)


def test_kinks_of_inputs_are_refused():
    """A sign of an input changes at a time that the values move."""
    model = da.compile_model(pushed(sp.sign(u)), backend="numpy")
    with pytest.raises(OptionError, match="jump at t = "):
        model.sensitivity((0, 2), {"x": 0, "x_dot": 0}, {}, inputs={u: da.samples(KNOTS, VALUES)}, wrt=[u])
