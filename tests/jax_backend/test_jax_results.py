"""What traced runs return beside states: statuses, numbers of steps, dense output, errors."""

from functools import partial

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import OptionError, RunFailedError, ValueInputError
from dalembert.methods.status import Status

jax = pytest.importorskip("jax")

pytestmark = pytest.mark.usefixtures("quick_xla")

PARAMETERS, INITIAL, _ = MOTIONS["chaplygin_sleigh"]
QUICK = {"xla_backend_optimization_level": 0}
SPAN = np.array([0.0, 0.5])
OPTIONS = {"method": "tsit5", "rtol": 1e-9, "atol": 1e-11}


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def pendulum(formulation):
    """A particle on a circle of radius 1, by its angle, or by its place in the plane."""
    frame, origin = ReferenceFrame("N"), Point("O")
    (x, y, angle), (m, g) = dynamicsymbols("x y angle"), sp.symbols("m g", positive=True)
    place, names = ((sp.sin(angle), -sp.cos(angle)), [angle]) if formulation == "minimal" else ((x, y), [x, y])
    scene = da.Scene("pendulum", frame=frame, origin=origin, coordinates=names)
    scene.add_bodies(Particle("bob", origin.locatenew("B", place[0] * frame.x + place[1] * frame.y), m))
    scene.apply_uniform_gravity(-g * frame.y)
    if formulation == "projected":
        scene.add_holonomic_constraints(x**2 + y**2 - 1)
    return da.compile_model(scene, backend="jax", formulation=formulation)


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", outputs=["X"])


@pytest.fixture(scope="module")
def dense(model):
    return model.solve_fn(INITIAL, dense=True, **OPTIONS)


def test_steps_are_those_of_a_sweep(model):
    """The same loop counts them there."""
    solve = model.solve_fn(INITIAL, **OPTIONS)
    spread = np.linspace(0.2, 0.6, 3)
    runs = jax.jit(jax.vmap(lambda b: solve([0.0, 5.0], INITIAL, {**PARAMETERS, "b": b})))(spread)
    sweep = model.sweep((0.0, 5.0), INITIAL, {**PARAMETERS, "b": spread}, **OPTIONS)
    np.testing.assert_array_equal(runs.steps, sweep.steps)
    assert len(set(sweep.steps)) > 1
    alone = solve([0.0, 5.0], INITIAL, {**PARAMETERS, "b": spread[0]})
    assert (int(alone.steps), int(alone.rejected)) == (runs.steps[0], runs.rejected[0])
    assert alone.dense is None


def test_dense_output_is_the_motion_at_any_time(model, dense):
    times = np.array([0.31, 0.0, 0.5, 0.17, 0.6, -0.1])
    solved = dense(SPAN, INITIAL, PARAMETERS)
    states = solved.dense(times)
    inside = times[:4]
    wanted = model.solve_fn(INITIAL, **OPTIONS)(np.sort(inside), INITIAL, PARAMETERS)
    order = np.argsort(inside)
    for name in ("y", "q", "qdot", "outputs"):
        found = np.asarray(getattr(states, name))
        np.testing.assert_allclose(found[:4][order], getattr(wanted, name), rtol=1e-13, atol=1e-13)
        assert np.all(np.isnan(found[4:]))
    one = solved.dense(0.31)
    assert one.q.shape == (3,)
    np.testing.assert_allclose(one.outputs, states.outputs[0], rtol=1e-13)
    with pytest.raises(ValueInputError, match="time or times"):
        solved.dense(np.zeros((2, 2)))


def differences(function, at, step=1e-5):
    """Central differences of a function of arrays by all their numbers."""
    found = []
    for i, value in enumerate(at):
        columns = []
        for j in range(np.size(value)):
            moves = np.zeros(np.size(value))
            moves[j] = step
            moves = moves.reshape(np.shape(value))
            ends = (function(*at[:i], value + sign * moves, *at[i + 1 :]) for sign in (1.0, -1.0))
            columns.append(np.subtract(*map(np.asarray, ends)) / (2.0 * step))
        found.append(np.stack(columns, axis=-1).reshape(*columns[0].shape, *np.shape(value)))
    return found


@pytest.mark.matrix
@pytest.mark.parametrize(
    ("formulation", "derivative", "by"), [("minimal", jax.jacrev, (0, 1, 2)), ("projected", jax.jacfwd, (0,))]
)
def test_dense_output_is_vectorised_and_differentiated_backward_in_time(formulation, derivative, by):
    model = pendulum(formulation)
    start = {"minimal": [0.9, 0.4], "projected": [0.6, -0.8, 0.8, 0.6]}[formulation]
    solve, p = model.solve_fn(dense=True, **OPTIONS), model.parameter_vector({"g": 9.81, "m": 1.3})
    given = np.array(start)

    def inside(t, start, p):
        motion = solve(jax.numpy.array([0.0, -0.5]) + start, given, p).dense
        return jax.vmap(motion)(jax.numpy.stack([t, start - 0.2])).q

    at = -0.31, 0.1, p
    every = jax.jit(lambda *a: (inside(*a), derivative(inside, argnums=by)(*a)), compiler_options=QUICK)
    values, found = every(*at)
    assert np.all(np.isfinite(values))
    for one, other in zip(found, differences(lambda *a: every(*a)[0], at)[: len(by)], strict=True):
        np.testing.assert_allclose(one, other, rtol=2e-6, atol=2e-7)
    lost, derivatives = every(-0.7, *at[1:])
    assert np.all(np.isnan(lost[0])) and np.all(np.isnan(derivatives[-1][0]))
    np.testing.assert_allclose(lost[1], values[1], rtol=1e-14)


def test_failures_raise_outside_of_traces_where_that_is_asked_for(model):
    options = {"max_steps": 2, "throw": True, "method": "tsit5"}
    solve = model.solve_fn(INITIAL, **options)
    with pytest.raises(RunFailedError, match=r"MAX_STEPS.*max_steps.*throw=True"):
        solve([0.0, 50.0], INITIAL, PARAMETERS)
    assert int(solve([0.0, 1e-9], INITIAL, PARAMETERS).status) == Status.SUCCESS
    with pytest.raises(OptionError, match="throw must be True or False"):
        model.solve_fn(throw="yes")


def test_failures_in_traces_are_statuses(model):
    solve = model.solve_fn(INITIAL, max_steps=2, method="tsit5")
    traced = jax.jit(lambda p: solve([0.0, 50.0], INITIAL, p).status, compiler_options=QUICK)
    assert int(traced(PARAMETERS)) == Status.MAX_STEPS
    assert int(traced({**PARAMETERS, "m": np.nan})) == Status.NON_FINITE


def test_failures_raise_in_traces_where_that_is_asked_for(model):
    """Whatever is computed of a failed run: a row, a gradient alone, one run of a batch, runs on the host."""
    options = {"max_steps": 20, "throw": True, "method": "tsit5"}
    solve, plain = model.solve_fn(INITIAL, **options), model.solve_fn(INITIAL, max_steps=20, method="tsit5")
    p, good, bad = model.parameter_vector(PARAMETERS), np.array([0.0, 0.1]), np.array([0.0, 50.0])

    def end(t, p, solve=solve):
        return solve(t, INITIAL, p).q[-1, 0]

    raised = jax.errors.JaxRuntimeError, ValueError

    @partial(jax.jit, compiler_options=QUICK)
    def gradients(t, p):
        return jax.grad(end, 1)(t, p), jax.grad(lambda t, p: end(t, p, plain), 1)(t, p)

    np.testing.assert_allclose(*gradients(good, p), rtol=1e-14)
    with pytest.raises(raised, match=r"RunFailedError: the run failed with the status MAX_STEPS.*raise max_steps"):
        jax.block_until_ready(gradients(bad, p))
    batch = jax.jit(jax.vmap(lambda t: end(t, p)), compiler_options=QUICK)
    assert np.all(np.isfinite(batch(np.stack([good, 0.5 * good]))))
    with pytest.raises(raised, match=r"2 of 3 runs failed: number 1 failed.*MAX_STEPS"):
        jax.block_until_ready(batch(np.stack([good, bad, bad])))
    hosted = model.solve_fn(INITIAL, events=["x"], **options)
    with pytest.raises(raised, match=r"RunFailedError: the run failed.*MAX_STEPS"):
        jax.block_until_ready(jax.jit(lambda t: hosted(t, INITIAL, p).end)(bad))


@pytest.mark.matrix
def test_dense_output_across_conditions_on_time():
    """A pulse begins and ends within the span; derivatives, which would miss a term, are refused."""
    x, t, T = dynamicsymbols("x"), dynamicsymbols._t, sp.symbols("T", positive=True)
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("P", x * frame.x)
    scene = da.Scene("pushed", frame=frame, origin=origin, coordinates=[x])
    scene.add_bodies(Particle("P", place, 1))
    scene.add_loads((place, sp.Piecewise((2, t < T), (0, True)) * frame.x))
    model = da.compile_model(scene, backend="jax", outputs=["x_ddot"])
    solve = model.solve_fn(dense=True, method="tsit5")
    motion = solve([1.0, 3.0], [0.0, 0.0], {"T": 1.5}).dense(jax.numpy.array([2.0, 1.3, 1.0]))
    np.testing.assert_allclose(motion.q[:, 0], [0.75, 0.09, 0.0], atol=1e-12)
    np.testing.assert_allclose(motion.outputs[:, 0], [0.0, 2.0, 2.0])
    with pytest.raises(OptionError, match="derivatives of its dense output"):
        jax.grad(lambda T: solve([1.0, 3.0], [0.0, 0.0], {"T": T}).q[-1, 0])(1.5)
