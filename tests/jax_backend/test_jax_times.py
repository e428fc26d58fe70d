"""Derivatives of traced motions by their times, and of runs that fail or whose times have no order."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import ValueInputError
from dalembert.methods.status import Status
from jax_backend.jax_options import QUICK

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

pytestmark = pytest.mark.usefixtures("quick_xla")

T = np.array([0.3, 0.9, 0.9, 1.4])
PARAMETERS = {"m": 0.8, "L": 0.7, "A": 0.2, "w": 3.1, "F": 1.7, "g": 9.81}
START = {"th": 0.4, "th_dot": 0.9}
SLEIGH = MOTIONS["chaplygin_sleigh"]
OPTIONS = {"rtol": 1e-10, "atol": 1e-12}
JACOBIANS = {"forward": jax.jacfwd, "reverse": jax.jacrev}


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def driven():
    """A pendulum whose support is driven, under a force that changes with time: time is everywhere."""
    m, L, A, w, F, g = sp.symbols("m L A w F g", positive=True)
    x, y, th, t = *dynamicsymbols("x y th"), dynamicsymbols._t
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("driven", frame=N, origin=O, coordinates=[x, y, th])
    mass = O.locatenew("mass", x * N.x + y * N.y)
    scene.add_bodies(Particle("body", mass, m))
    scene.add_holonomic_constraints(x - A * sp.sin(w * t) - L * sp.sin(th), y + L * sp.cos(th))
    scene.add_loads((mass, F * sp.cos(w * t) * N.x))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


@cache
def compiled(formulation="minimal", backend="jax"):
    (x, _, _), w = (scene := driven()).coordinates, sp.Symbol("w", positive=True)
    wave = x * sp.cos(w * dynamicsymbols._t)
    return da.compile_model(scene, backend=backend, formulation=formulation, outputs=[wave])


def everything(motion):
    return jax.numpy.concatenate([motion.q, motion.qdot, motion.outputs], axis=1)


@cache
def expected():
    """Return the derivatives (n_t, n_of, n_t) by differences of runs of another backend, at the times T."""
    model, size = compiled(backend="llvm"), 1e-5

    def values(times):
        run = model.simulate((times[0], times[-1]), START, PARAMETERS, rtol=1e-13, atol=1e-14, t_eval=times)
        return np.column_stack([run.q, run.qdot, *(run[name] for name in model.layout.outputs)])

    times, shifts = T[[0, 1, 3]], size * np.eye(3)
    first, middle, last = ((values(times + shift) - values(times - shift)) / (2.0 * size) for shift in shifts)
    table = np.zeros((4, first.shape[1], 4))
    table[:, :, 0], table[:, :, 3] = first[[0, 1, 1, 2]], last[[0, 1, 1, 2]]
    table[1, :, 1] = table[2, :, 2] = middle[1]
    return table


@pytest.mark.parametrize(
    ("method", "formulation", "mode"),
    [("tsit5", "minimal", "forward"), ("tsit5", "projected", "reverse")],
)
def test_derivatives_by_times_are_differences(method, formulation, mode):
    solve = compiled(formulation).solve_fn(START, method=method, **OPTIONS)
    matrix = JACOBIANS[mode](lambda t: everything(solve(t, START, PARAMETERS)))
    found = jax.jit(matrix, compiler_options=QUICK)(T)
    np.testing.assert_allclose(found, expected(), rtol=2e-7, atol=2e-8)


# -- a motion that is known -----------------------------------------------------------------------


@cache
def pushed():
    """A particle of mass 1 on a line under F cos(w t): x = x0 + v0 s + F ((cos w t0 - cos w t)/w^2 - s sin(w t0)/w)."""
    x, t = dynamicsymbols("x"), dynamicsymbols._t
    F, w = sp.symbols("F w", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, F * sp.cos(w * t) * N.x))
    return da.compile_model(scene, backend="jax")


AT, FORCE = np.array([0.4, -0.3]), {"F": 1.3, "w": 2.1}


def place(t, y, p):
    """Return the places (n_t,) of the particle, known."""
    F, w, np = p["F"], p["w"], jax.numpy
    return y[0] + y[1] * (t - t[0]) + F * ((np.cos(w * t[0]) - np.cos(w * t)) / w - (t - t[0]) * np.sin(w * t[0])) / w


@pytest.mark.parametrize(
    ("method", "mode"),
    [
        ("tsit5", "forward"),
        ("tsit5", "reverse"),
        ("taylor", "reverse"),
        ("kvaerno5", "forward"),
    ],
)
def test_derivatives_of_a_known_motion_alone_and_in_batches(method, mode):
    solve = pushed().solve_fn(method=method, rtol=1e-11, atol=1e-13)
    spans = np.array([[0.2, 1.1, 1.9], [1.9, 1.1, 0.2]])
    wrt = (0, 1, 2)
    found = jax.jit(
        jax.vmap(JACOBIANS[mode](lambda *at: solve(*at).q[:, 0], wrt), (0, None, None)), compiler_options=QUICK
    )
    right = jax.jit(jax.vmap(jax.jacfwd(place, wrt), (0, None, None)))
    for a, b in zip(*(jax.tree.leaves(f(spans, AT, FORCE)) for f in (found, right)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)


def test_times_far_from_zero():
    """What is lost is what rounding takes of the times that the force is told, and nothing of the steps."""
    t0 = 1.7e9
    model = pushed()
    solve = model.solve_fn(method="dopri8", rtol=1e-9, atol=1e-11)
    times = t0 + np.array([0.0, 0.25, 1.0])  # exact
    found = solve(times, AT, {"F": 0.0, "w": 1.0}).q[:, 0]
    np.testing.assert_allclose(found, AT[0] + AT[1] * (times - t0), rtol=1e-14)
    phase = {"F": 1.3, "w": 2.0**-20}  # w t0 is exact
    exact = AT[0] + AT[1] * (times - t0) + 1.3 * np.cos(phase["w"] * t0) * (times - t0) ** 2 / 2.0
    np.testing.assert_allclose(solve(times, AT, phase).q[:, 0], exact, rtol=1e-6)
    parameters, initial, _ = SLEIGH
    sleigh = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax").solve_fn(initial, method="tsit5")
    near, far = (sleigh(t + np.array([0.0, 0.5, 2.0]), initial, parameters).y for t in (0.0, t0))
    np.testing.assert_array_equal(near, far)


# -- runs that fail -------------------------------------------------------------------------------


SPANS = np.array([[0.0, 0.3], [0.0, 300.0], [0.0, 0.1]])


def steps_of(method):
    """Return how many steps are enough for the short spans alone."""
    return 60 if method == "kvaerno5" else 20


@pytest.mark.parametrize("method", ["dopri8", pytest.param("kvaerno5", marks=pytest.mark.matrix)])
def test_gradients_of_a_run_that_failed_are_nan_and_its_neighbours_are_right(method):
    solve = pushed().solve_fn(method=method, max_steps=steps_of(method), rtol=1e-7)

    def cost(y, p, span):
        motion = solve(span, y, p)
        return motion.q[-1, 0] ** 2, motion.status

    gradients = jax.vmap(jax.grad(cost, (0, 1, 2), has_aux=True), (None, None, 0))
    found, statuses = jax.jit(gradients, compiler_options=QUICK)(AT, FORCE, SPANS)
    assert statuses.tolist() == [Status.SUCCESS, Status.MAX_STEPS, Status.SUCCESS]
    known = jax.vmap(jax.grad(lambda y, p, t: place(t, y, p)[-1] ** 2, (0, 1, 2)), (None, None, 0))
    right = jax.jit(known)(AT, FORCE, SPANS)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(right), strict=True):
        assert np.isnan(a[1]).all()
        np.testing.assert_allclose(a[::2], b[::2], rtol=1e-6, atol=1e-7)


def test_a_failed_case_spoils_what_it_is_part_of_unless_it_is_left_out():
    solve = pushed().solve_fn(method="tsit5", max_steps=20, rtol=1e-7)

    def cost(y, only):
        motions = jax.vmap(lambda span: solve(span, y, FORCE))(SPANS)
        left_out = only & (motions.status != Status.SUCCESS)
        return (jax.numpy.where(left_out, 0.0, motions.y[:, -1, 0]) ** 2).sum()

    gradient = jax.jit(jax.grad(cost), compiler_options=QUICK)
    assert np.isnan(gradient(AT, False)).all()
    right = jax.jit(jax.grad(lambda y: sum(place(SPANS[case], y, FORCE)[-1] ** 2 for case in (0, 2))))(AT)
    np.testing.assert_allclose(gradient(AT, True), right, rtol=1e-6)


@pytest.mark.parametrize(
    ("method", "mode"),
    [("tsit5", "forward"), ("tsit5", "reverse"), pytest.param("kvaerno5", "forward", marks=pytest.mark.matrix)],
)
def test_what_was_reached_keeps_its_derivatives(method, mode):
    solve, t = pushed().solve_fn(method=method, rtol=1e-7, max_steps=steps_of(method)), [0.0, 0.2, 300.0]
    found = jax.jit(JACOBIANS[mode](lambda p: solve(t, AT, p).y[:, 0]), compiler_options=QUICK)(FORCE)
    right = jax.jit(jax.jacfwd(lambda p: place(np.array(t), AT, p)))(FORCE)
    for name in FORCE:
        np.testing.assert_allclose(found[name][:2], right[name][:2], rtol=1e-5, atol=1e-6)
        assert np.isnan(found[name][2])


# -- times ----------------------------------------------------------------------------------------


def test_times_in_no_order_are_an_error_or_where_traced_a_status():
    solve = pushed().solve_fn(method="tsit5")
    function = jax.value_and_grad(lambda p, t: (lambda m: (m.q[0, 0], m))(solve(t, AT, p)), has_aux=True)
    value = jax.jit(function, compiler_options=QUICK)
    for times in ([0.0, 0.5, 0.2], [0.0, np.nan, 1.0], [0.0, 1.0, np.inf], [0.3, 0.2, 0.4]):
        with pytest.raises(ValueInputError, match="finite times in increasing order, or in decreasing order"):
            solve(times, AT, FORCE)
        (_, motion), gradient = value(FORCE, np.array(times))
        assert int(motion.status) == Status.TIMES_IN_NO_ORDER
        assert np.isnan(motion.y).all() and np.isnan(jax.tree.leaves(gradient)).all()


@pytest.mark.parametrize("times", [[], [[0.0, 1.0]], "now"])
def test_times_that_are_no_times(times):
    with pytest.raises(ValueInputError, match=r"t must be times|shape|give times"):
        pushed().solve_fn()(times, AT, FORCE)
