"""Inputs of scenes: given functions of time, as numbers."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from sympy import Abs, cos, sign, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import OptionError, SceneError, UnknownNameError, ValueInputError
from dalembert.ir.program import Program, coefficient_places, hidden_parameters

pytestmark = pytest.mark.usefixtures("quick_xla")

x, u, v, theta = dynamicsymbols("x u v theta")
m, k, ell, g = symbols("m k ell g", positive=True)
SPRING = {m: 1.0, k: 2.0}
REST = {x: 0.0, x.diff(): 0.0}
BLOCK_AT_REST = {"x": 0.0, "x_dot": 0.0, "y": 0.0, "y_dot": 0.0}
BLOCK = {"m": 2.0, "mu": 0.5, "weight": 10.0}


def forced(*inputs: Any, name: str = "forced") -> da.Scene:
    """Return a mass on a spring that the input u pushes."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, (u - k * x) * N.x))
    scene.add_inputs(*(inputs or (u,)))
    return scene


def driven() -> da.Scene:
    """Return a pendulum whose support moves along the input u, pushed by the input v."""
    N, O = ReferenceFrame("N"), Point("O")
    A = O.locatenew("A", u * N.x)
    P = A.locatenew("P", ell * sin(theta) * N.x - ell * cos(theta) * N.y)
    scene = da.Scene("driven", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("p", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((P, v * N.x))
    scene.add_inputs(u, v)
    return scene


def pushed_block() -> da.Scene:
    """Return a block on a floor with friction, pushed by the input u."""
    N, O = ReferenceFrame("N"), Point("O")
    F, normal = da.unknowns("F normal")
    y, mu, weight = dynamicsymbols("y"), symbols("mu", positive=True), symbols("weight", positive=True)
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", P, m))
    scene.add_joints(da.Joint("floor", body="block", at=P, force=F * N.x + normal * N.y))
    scene.add_holonomic_constraints(y)
    scene.add_loads((P, u * N.x - weight * N.y))
    scene.add_friction(da.CoulombFriction(normal, F, mu=mu, name="floor"))
    scene.add_inputs(u)
    return scene


def exact(value: float, t: float) -> float:
    """Return x under a constant input."""
    return float(value / 2.0 * (1.0 - np.cos(np.sqrt(2.0) * t)))


@pytest.fixture(scope="module")
def model() -> Any:
    """Return the compiled mass on a spring."""
    return da.compile_model(forced())


@pytest.mark.parametrize("backend", list(BACKENDS))
def test_numbers_are_constant_in_time_on_every_backend(backend: str) -> None:
    model = da.compile_model(forced(), backend=backend)
    run = model.simulate((0, 3), REST, SPRING, inputs={u: 1.5}, rtol=1e-10, atol=1e-12)
    assert run["x"][-1] == pytest.approx(exact(1.5, 3.0), rel=1e-9)
    np.testing.assert_array_equal(run["u"], 1.5)
    sweep = model.sweep((0, 3), REST, SPRING, inputs={"u": np.array([1.5, 3.0])}, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(sweep.final["x"], [exact(1.5, 3.0), exact(3.0, 3.0)], rtol=1e-9)
    varied = model.sensitivity((0, 3), REST, SPRING, inputs={u: 1.5}, wrt=[k], rtol=1e-10, atol=1e-12)
    h = 1e-6
    ahead, behind = (1.5 / s * (1.0 - np.cos(np.sqrt(s) * 3.0)) for s in (2.0 + h, 2.0 - h))
    assert varied.jacobian("x", "k")[-1] == pytest.approx((ahead - behind) / (2.0 * h), rel=1e-7)
    assert model.accelerations(0.0, [0.5], [0.0], SPRING, inputs={u: 1.5}) == pytest.approx([0.5])
    assert model.forcing(0.0, [0.5], [0.0], SPRING, inputs={u: 1.5}) == pytest.approx([0.5])
    assert model.mass_matrix([0.5], SPRING, inputs={u: 1.5}) == pytest.approx(np.eye(1))


def test_prepared_runs_are_given_inputs_once_or_with_each_call(model: Any) -> None:
    state, p = model.state(REST, SPRING, inputs={u: 0.0}), model.parameter_vector(SPRING)
    run = model.prepare((0, 3))
    for value in (1.5, -0.3):
        assert run(state, p, np.array([value]))[0] == pytest.approx(exact(value, 3.0), abs=1e-8)
    assert model.prepare((0, 3), inputs={u: 1.5})(state, p)[0] == pytest.approx(exact(1.5, 3.0), abs=1e-8)
    assert run(state, model.parameter_vector(SPRING, inputs={u: 1.5}))[0] == pytest.approx(exact(1.5, 3.0), abs=1e-8)
    with pytest.raises(ValueInputError, match="missing inputs: u"):
        run(state, p)
    with pytest.raises(ValueInputError, match="inputs must have shape"):
        run(state, p, np.array([1.0, 2.0]))
    with pytest.raises(ValueInputError, match="were given to prepare"):
        model.prepare((0, 3), inputs={u: 1.5})(state, p, np.array([1.0]))


def test_inputs_are_outputs_and_may_be_watched(model: Any) -> None:
    assert model.layout.inputs == ("u",)
    assert model.layout.given == ("k", "m")
    run = model.simulate((0, 3), REST, SPRING, inputs={u: 1.5}, events=[da.Event(k * x - u, name="balance")])
    assert run.events["balance"].t[0] == pytest.approx(np.pi / 2 / np.sqrt(2.0), abs=1e-6)
    assert model.simulate((1e6, 1e6 + 3), REST, SPRING, inputs={u: 1.5})["x"][-1] == pytest.approx(
        exact(1.5, 3.0), abs=1e-8
    )


def test_program_text_and_pickle_hold_the_inputs(model: Any) -> None:
    program = model.stages.program
    assert Program.parse(str(program)) == program
    again = pickle.loads(pickle.dumps(model))
    run = again.simulate((0, 3), REST, SPRING, inputs={u: 1.5})
    assert run["x"][-1] == model.simulate((0, 3), REST, SPRING, inputs={u: 1.5})["x"][-1]


def test_nothing_that_depends_on_inputs_is_computed_once_a_run(model: Any) -> None:
    program = model.stages.program
    (place,) = coefficient_places(program.layout.parameters, program.layout.inputs)
    c = np.array([1.0] * program.layout.constants)
    prepare = program.kernel("prepare")
    hidden = {load.target for load in prepare.loads if load.index in range(place, place + 5)}
    assert hidden and not any(hidden & set(line.args) for line in prepare.body)
    assert len(c) >= len(program.layout.parameters)


def test_an_input_in_a_position_agrees_with_the_textbook() -> None:
    model, view = da.compile_model(driven()), da.lagrange(driven())
    (expression,) = view.equations_of_motion.values()
    p = dict(zip(model.layout.parameters, model.parameter_vector({m: 1.3, ell: 0.7, g: 9.8}), strict=True))
    knot, *coefficients = hidden_parameters("u")
    p |= {knot: 0.1} | dict(zip(coefficients, (0.3, 0.2, 0.5, -0.4), strict=True))
    knot, *coefficients = hidden_parameters("v")
    p |= {knot: 0.0} | dict(zip(coefficients, (0.4, 0.9, 0.0, 0.0), strict=True))
    found = model.accelerations(0.6, [0.8], [0.2], np.array([p[name] for name in model.layout.parameters]))
    t = dynamicsymbols._t
    since = t - 0.1
    inputs = {u: 0.3 + 0.2 * since + 0.5 * since**2 - 0.4 * since**3, v: 0.4 + 0.9 * t}
    value = expression.subs(inputs).doit().subs({theta.diff(): 0.2}).subs({theta: 0.8})
    assert found[0] == pytest.approx(float(value.subs({t: 0.6, m: 1.3, ell: 0.7, g: 9.8})), rel=1e-12)
    assert "u''" in str(view)


def test_smoothness_that_inputs_need() -> None:
    needs = {each.name: each for each in da.compile_model(driven()).stages.equations.symbols.inputs}
    assert needs["u"].smoothness == 1 and "point 'A'" in needs["u"].where
    assert needs["v"].smoothness == -1
    scene = forced(u, v)
    scene.add_nonholonomic_constraints(x.diff() - v)
    needs = {each.name: each.smoothness for each in da.compile_model(scene).stages.equations.symbols.inputs}
    assert needs == {"u": -1, "v": 0}


@pytest.mark.parametrize(
    ("inputs", "error", "text"),
    [
        (None, UnknownNameError, "missing inputs: u"),
        ({}, UnknownNameError, "missing inputs: u"),
        ({"w": 1.0, u: 1.0}, UnknownNameError, "unknown input 'w'.*Known: u"),
        ({u: 1.0, "k": 2.0}, UnknownNameError, "'k' is a parameter"),
        ({u: 1.0, x: 2.0}, UnknownNameError, "determined by the motion"),
        ({u: 1.0, "u": 1.0}, UnknownNameError, "given twice"),
        ({u: [1.0, 2.0]}, ValueInputError, "has shape"),
        ({u: np.nan}, ValueInputError, "not finite"),
        ({u: "1"}, ValueInputError, "is not a number"),
        (1.0, ValueInputError, "must be a mapping"),
    ],
)
def test_wrong_inputs_are_named(model: Any, inputs: Any, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        model.simulate((0, 1), REST, SPRING, inputs=inputs)


def test_inputs_in_the_wrong_place_are_named(model: Any) -> None:
    with pytest.raises(UnknownNameError, match="is an input, not a parameter"):
        model.simulate((0, 1), REST, {**SPRING, u: 1.0}, inputs={u: 1.0})
    with pytest.raises(UnknownNameError, match="no initial value"):
        model.simulate((0, 1), {**REST, u: 1.0}, SPRING, inputs={u: 1.0})
    with pytest.raises(UnknownNameError, match=r"missing parameters: k. The scene needs: k, m\."):
        model.simulate((0, 1), REST, {m: 1.0}, inputs={u: 1.0})
    with pytest.raises(UnknownNameError, match="missing inputs: u"):
        model.accelerations(0.0, [0.0], [0.0], SPRING)


def test_faults_of_scenes_with_inputs() -> None:
    with pytest.raises(SceneError, match="depends on the input 'v'"):
        da.compile_model(forced(u, v))
    with pytest.raises(SceneError, match="a coordinate or a speed and an input too"):
        da.compile_model(forced(u, x))
    with pytest.raises(SceneError, match="added twice"):
        da.compile_model(forced(u, u))
    with pytest.raises(SceneError, match="is not a function of time"):
        da.compile_model(forced(u, m))
    scene = forced()
    scene.inputs = ()
    with pytest.raises(SceneError, match="add_inputs"):
        da.compile_model(scene)
    with pytest.raises(UnknownNameError, match="the scene has no inputs"):
        da.compile_model(da.scenes.bouncing_ball()).simulate((0, 1), {}, {}, inputs={u: 1.0})


def test_kinks_of_inputs_in_positions_are_refused() -> None:
    N, O = ReferenceFrame("N"), Point("O")
    support = O.locatenew("A", Abs(u) * N.x)
    bob = support.locatenew("P", ell * sin(theta) * N.x - ell * cos(theta) * N.y)
    scene = da.Scene("kinked", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("p", bob, m))
    scene.add_inputs(u)
    with pytest.raises(
        SceneError, match=r"position of point 'A' contains a condition, a kink or a jump of the input 'u'"
    ):
        da.compile_model(scene)
    scene = forced(u, v)
    scene.add_nonholonomic_constraints(x.diff() - Abs(v))
    da.compile_model(scene)
    scene.add_nonholonomic_constraints(x.diff() - sign(v))
    with pytest.raises(SceneError, match=r"nonholonomic constraint 2.* contains a condition"):
        da.compile_model(scene)


def test_contacts_with_a_constant_input() -> None:
    model, start, p = da.compile_model(pushed_block()), BLOCK_AT_REST, BLOCK
    assert model.simulate((0, 1), start, p, inputs={u: 4.0})["x"][-1] == 0.0
    assert model.simulate((0, 1), start, p, inputs={u: 9.0})["x"][-1] == pytest.approx(1.0, rel=1e-9)
    sweep = model.sweep((0, 1), start, p, inputs={u: np.array([4.0, 9.0])})
    np.testing.assert_allclose(sweep.final["x"], [0.0, 1.0], atol=1e-9)
    assert model.forcing(0.0, [0.0, 0.0], [0.0, 0.0], p, inputs={u: 4.0})[0] == pytest.approx(4.0)


def test_traced_runs_take_constant_inputs_among_the_parameters() -> None:
    jax = pytest.importorskip("jax")
    model = da.compile_model(forced(), backend="jax")
    solve = model.solve_fn(["x", "x_dot"])
    with jax.enable_x64(True):
        times, start = np.array([0.0, 3.0]), np.array([0.0, 0.0])

        def end(value: Any) -> Any:
            return solve(times, start, {"m": 1.0, "k": 2.0, "u": value}).y[-1, 0]

        value, slope = jax.value_and_grad(end)(1.5)
        assert float(value) == pytest.approx(exact(1.5, 3.0), rel=1e-7)
        assert float(slope) == pytest.approx(exact(1.0, 3.0), rel=1e-6)
        with pytest.raises(UnknownNameError, match="missing inputs: u"):
            solve(times, start, {"m": 1.0, "k": 2.0})
        with pytest.raises(UnknownNameError, match=r"unknown parameter 'w'.*Known: k, m, u\."):
            solve(times, start, {"m": 1.0, "k": 2.0, "u": 1.0, "w": 1.0})
        with pytest.raises(OptionError, match="'u' has samples"):
            end(da.samples([0.0, 3.0], [1.0, 2.0]))
