"""Choice of the adjoint of traced runs: recorded, recomputed in blocks, continuous."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.jax_options import QUICK
from dalembert.errors import OptionError
from dalembert.methods.status import Status

jax = pytest.importorskip("jax")

pytestmark = pytest.mark.usefixtures("quick_xla")

OTHERS = ("recomputed", "continuous")
ACCURACY = {"recomputed": 1e-8, "continuous": 3e-8}
"""Of derivatives beside differences, which are good to 1e-8, at a tolerance of 1e-10."""


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def pendulum(force=0):
    frame, origin = ReferenceFrame("N"), Point("O")
    angle, (m, g) = dynamicsymbols("angle"), sp.symbols("m g", positive=True)
    bob = origin.locatenew("B", sp.sin(angle) * frame.x - sp.cos(angle) * frame.y)
    scene = da.Scene("pendulum", frame=frame, origin=origin, coordinates=[angle])
    scene.add_bodies(Particle("bob", bob, m))
    scene.apply_uniform_gravity(-g * frame.y)
    if force:
        scene.add_loads((bob, force * frame.x))
    return da.compile_model(scene, backend="jax")


@pytest.fixture(scope="module")
def model():
    return pendulum()


def differences(function, at, step=1e-4):
    """Differences of fourth order of a function of arrays by all their numbers."""
    found = []
    for i, value in enumerate(at):
        columns = []
        for j in range(np.size(value)):
            move = np.zeros(np.size(value))
            move[j] = step
            move = move.reshape(np.shape(value))
            one, two = (
                np.subtract(*(np.asarray(function(*at[:i], value + s * k * move, *at[i + 1 :])) for s in (1.0, -1.0)))
                for k in (1.0, 2.0)
            )
            columns.append((8.0 * one - two) / (12.0 * step))
        found.append(np.stack(columns, axis=-1))
    return found


@pytest.mark.parametrize("adjoint", OTHERS)
@pytest.mark.parametrize(("derivative", "end"), [(jax.jacrev, -3.0), (jax.jacfwd, 3.0)])
def test_derivatives_by_everything_of_a_batch(model, adjoint, derivative, end):
    solve = model.solve_fn(adjoint=adjoint, method="tsit5", rtol=1e-10, atol=1e-12, max_steps=512)
    t, p = np.array([0.2, 0.2 + 0.3 * end, 0.2 + 0.7 * end, 0.2 + end]), np.array([9.81, 1.2])
    starts = np.array([[0.4, 0.9], [1.5, -0.3]])

    def motion(t, y, p):
        return solve(t, y, p).y

    every = jax.jit(
        jax.vmap(lambda t, y, p: (motion(t, y, p), derivative(motion, (0, 1, 2))(t, y, p)), (None, 0, None)),
        compiler_options=QUICK,
    )
    plain = jax.jit(jax.vmap(motion, (None, 0, None)), compiler_options=QUICK)
    values, found = every(t, starts, p)
    np.testing.assert_allclose(values, plain(t, starts, p), rtol=1e-12, atol=1e-12)
    for case, start in enumerate(starts):
        wanted = differences(lambda t, y, p: plain(t, np.stack([y, y]), p)[0], (t, start, p))
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one[case], other, rtol=ACCURACY[adjoint], atol=ACCURACY[adjoint])


@pytest.mark.parametrize("adjoint", OTHERS)
def test_gradients_of_ends_and_of_failed_runs(model, adjoint):
    solve, start = model.solve_fn(adjoint=adjoint, method="dopri8", rtol=1e-10, atol=1e-12, max_steps=64), [0.4, 0.9]

    def last(p, t):
        return solve([0.0, t], start, p).y[-1, 0]

    own, p = jax.jit(jax.value_and_grad(last, (0, 1)), compiler_options=QUICK), np.array([9.81, 1.2])
    wanted = differences(lambda p, t: np.reshape(own(p, t)[0], 1), (p, 2.0))
    for one, other in zip(own(p, 2.0)[1], wanted, strict=True):
        np.testing.assert_allclose(np.ravel(one), other[0], rtol=1e-8, atol=1e-8)
    assert np.all(np.isnan(np.concatenate([np.ravel(part) for part in jax.tree.leaves(own(p, 500.0))])))


def test_a_motion_that_cannot_be_integrated_backward_has_no_continuous_gradient():
    """Strongly damped, it forgets where it began; from one of many times to the next it does not."""
    model, ends = pendulum(-20 * dynamicsymbols("angle", 1)), {}
    for adjoint, times in (("recorded", [0.0, 4.0]), ("continuous", [0.0, 4.0]), ("continuous", np.linspace(0, 4, 17))):
        solve = model.solve_fn(adjoint=adjoint, method="tsit5", rtol=1e-9, atol=1e-11)
        last = jax.jit(jax.grad(lambda p, f=solve, t=times: f(t, [0.4, 0.9], p).y[-1, 0]), compiler_options=QUICK)
        ends[adjoint, len(times)] = last(np.array([9.81, 1.2]))
    assert np.all(np.isnan(ends["continuous", 2]))
    np.testing.assert_allclose(ends["continuous", 17], ends["recorded", 2], rtol=1e-5)


def test_recomputed_gradients_take_the_memory_of_a_square_root(model):
    sizes = {}
    for adjoint in ("recorded", "recomputed", "continuous"):
        solve = model.solve_fn(adjoint=adjoint, method="tsit5", max_steps=16384)
        gradient = jax.jit(jax.grad(lambda p, f=solve: f([0.0, 1.0], [0.4, 0.9], p).y[-1, 0]), compiler_options=QUICK)
        sizes[adjoint] = gradient.lower(np.array([9.81, 1.2])).compile().memory_analysis().temp_size_in_bytes
    assert sizes["recomputed"] < sizes["recorded"] / 8
    assert sizes["continuous"] < sizes["recomputed"] / 4


def test_what_other_adjoints_do_not_serve_is_refused(model):
    def refused(model, why, **options):
        with pytest.raises(OptionError, match=why):
            model.solve_fn(**options)

    v = dynamicsymbols("angle", 1)
    refused(model, r"unknown adjoint 'back'.*recorded, recomputed, continuous", adjoint="back")
    jumping = pendulum(sp.sign(v))
    projected = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", formulation="projected")
    for adjoint in OTHERS:
        refused(
            model, r"'kvaerno5' has derivatives of its own.*adjoint=\"recorded\"", adjoint=adjoint, method="kvaerno5"
        )
        refused(model, r"dense=True keeps a record", adjoint=adjoint, dense=True)
        refused(jumping, "may jump with its state", adjoint=adjoint)
        solve = model.solve_fn(adjoint=adjoint, method="tsit5")
        assert int(solve([0.0, 0.1], [0.4, 0.9], [9.81, 1.2]).status) == Status.SUCCESS
        with pytest.raises(OptionError, match="second derivatives are those of recorded runs"):
            jax.make_jaxpr(jax.hessian(lambda p, f=solve: f([0.0, 0.1], [0.4, 0.9], p).y[-1, 0]))(np.array([9.81, 1.2]))
        for derivative in (jax.grad, jax.jacfwd):
            with pytest.raises(OptionError, match="second derivatives are those of recorded runs"):
                jax.make_jaxpr(
                    derivative(derivative(lambda t, f=solve: f([0.0, t], [0.4, 0.9], [9.81, 1.2]).y[-1, 0]))
                )(0.1)
    refused(projected, "'projected' moves states onto the constraints", adjoint="continuous")
    projected.solve_fn(adjoint="recomputed")
