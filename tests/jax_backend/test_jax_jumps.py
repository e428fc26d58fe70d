"""Traced runs end steps where conditions on time change; derivatives that do not know of a jump are NaN."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from jax_backend.jax_options import QUICK

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

pytestmark = pytest.mark.usefixtures("quick_xla")

JACOBIANS = {"forward": jax.jacfwd, "reverse": jax.jacrev}
t, x, v = dynamicsymbols._t, dynamicsymbols("x"), dynamicsymbols("x", 1)
F, T, D, w = sp.symbols("F T D w", positive=True)
AT = np.array([0.2, 0.1])


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def pushed(force, formulation="minimal"):
    """A particle of mass 1 on a line, under a force."""
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, force * N.x))
    return da.compile_model(scene, backend="jax", formulation=formulation)


def after_a_pulse(t, y, p):
    """Return the places (n_t,) after a pulse of F from T to T + D."""
    F, T, D, np = p["F"], p["T"], p["D"], jax.numpy
    ramp = np.maximum(t - T, 0.0) ** 2 / 2.0 - np.maximum(t - T - D, 0.0) ** 2 / 2.0
    return y[0] + y[1] * (t - t[0]) + F * ramp


PULSE = {"F": 2.0, "T": 1.3, "D": 0.03}


@pytest.mark.matrix
@pytest.mark.parametrize(
    ("method", "mode"),
    [("tsit5", "forward"), pytest.param("tsit5", "reverse", marks=pytest.mark.matrix), ("taylor", "reverse")],
)
def test_a_short_pulse_alone_and_in_batches(method, mode):
    """Its times vary with parameters, by which derivatives are NaN behind it, and by nothing else."""
    solve = pushed(F * (sp.Heaviside(t - T) - sp.Heaviside(t - T - D))).solve_fn(method=method)
    times, starts = np.array([0.0, 1.0, 1.31, 3.0]), np.array([0.4, 1.3, 2.99, 7.0])

    def places(t, y, p):
        return solve(t, y, p).q[:, 0]

    found = jax.jit(jax.vmap(lambda T: places(times, AT, PULSE | {"T": T})))(starts)
    for one, start in zip(found, starts, strict=True):
        np.testing.assert_allclose(one, after_a_pulse(times, AT, PULSE | {"T": start}), rtol=1e-9)

    def free(function):
        return lambda t, y, F: function(t, y, PULSE | {"F": F})

    matrices = jax.jit(JACOBIANS[mode](free(places), (0, 1, 2)), compiler_options=QUICK)(times, AT, 2.0)
    right = jax.jacfwd(free(after_a_pulse), (0, 1, 2))(times, AT, 2.0)
    for a, b in zip(matrices, right, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)
    by_all = jax.jit(JACOBIANS[mode](lambda p: places(times, AT, p)), compiler_options=QUICK)(PULSE)
    for name in ("T", "D"):
        assert np.isfinite(by_all[name][:2]).all() and np.isnan(by_all[name][2:]).all()
    np.testing.assert_allclose(by_all["F"], right[2], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("mode", JACOBIANS)
def test_a_ramp_is_a_kink_whose_time_may_be_differentiated(mode):
    model = pushed(sp.Piecewise((0, t < T), (F * (t - T), True)))
    solve = model.solve_fn(method="tsit5", rtol=1e-10, atol=1e-12)

    def known(t, p):
        return AT[0] + AT[1] * t + p["F"] * jax.numpy.maximum(t - p["T"], 0.0) ** 3 / 6.0

    p, times = {"F": 1.5, "T": 0.7}, np.array([0.0, 0.5, 2.0])
    found = jax.jit(JACOBIANS[mode](lambda p: solve(times, AT, p).q[:, 0]), compiler_options=QUICK)(p)
    right = jax.jacfwd(lambda p: known(times, p))(p)
    for name in p:
        np.testing.assert_allclose(found[name], right[name], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("times", [[0.0, 1.0, 3.0], [3.0, 1.0, 0.0]])
def test_many_breaks_there_and_back(times):
    """v = F times a triangle wave: a force that turns some twenty times, forward and backward in time."""
    model = pushed(F * sp.sign(sp.sin(w * t)))
    solve = model.solve_fn(method="tsit5", rtol=1e-9)
    w_, times = 20.0, np.array(times)

    def speed(time):
        return np.pi / w_ - np.abs(np.mod(time, 2.0 * np.pi / w_) - np.pi / w_)

    found = solve(times, AT, {"F": 1.0, "w": w_}).qdot[:, 0]
    np.testing.assert_allclose(found, AT[1] + speed(times) - speed(times[0]), rtol=0, atol=1e-12)


def test_other_formulations_methods_and_functions():
    force = F * (sp.Heaviside(t - T) - sp.Heaviside(t - T - D))
    solve = pushed(force, "projected").solve_fn(method="tsit5")
    times = np.array([0.0, 3.0])
    np.testing.assert_allclose(solve(times, AT, PULSE).q[:, 0], after_a_pulse(times, AT, PULSE), rtol=1e-9)
    model = pushed(force)
    implicit = model.solve_fn(method="kvaerno5", rtol=1e-9)
    np.testing.assert_allclose(implicit(times, AT, PULSE).q[:, 0], after_a_pulse(times, AT, PULSE), rtol=1e-8)
    p = jax.numpy.asarray(model.parameter_vector(PULSE))
    rates = [float(model.vector_field(time, jax.numpy.asarray(AT), p)[1]) for time in (1.29, 1.31, 1.34)]
    assert rates == [0.0, 2.0, 0.0]


# -- jumps with the state -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "mode"),
    [("tsit5", "reverse"), ("taylor", "forward"), pytest.param("kvaerno5", "reverse", marks=pytest.mark.matrix)],
)
def test_derivatives_behind_a_jump_in_the_state_are_nan_alone_and_in_batches(method, mode):
    """Dry friction: right while the particle slides one way, and nothing known once it has turned."""
    solve = pushed(-F * sp.sign(v) - w * x).solve_fn(method=method, rtol=1e-9)

    def places(p, speed):
        return solve(np.array([0.0, 0.4, 0.7]), jax.numpy.array([0.2, speed]), p).q[:, 0]

    p, speeds = {"F": 0.3, "w": 4.0}, np.array([5.0, 0.9, 4.0])
    found = jax.jit(jax.vmap(JACOBIANS[mode](places), (None, 0)), compiler_options=QUICK)(p, speeds)

    def known(p, speed):
        shift, root, s = p["F"] / p["w"], jax.numpy.sqrt(p["w"]), np.array([0.0, 0.4, 0.7])
        return -shift + (0.2 + shift) * jax.numpy.cos(root * s) + speed / root * jax.numpy.sin(root * s)

    for name in p:
        for case in range(3):
            right = jax.jacfwd(known)(p, speeds[case])[name]
            reached = 3 if case != 1 else 1
            np.testing.assert_allclose(found[name][case, :reached], right[:reached], rtol=1e-6, atol=1e-8)
        assert np.isnan(found[name][1, 2])


@pytest.mark.parametrize("mode", JACOBIANS)
def test_a_kink_in_the_state_is_no_jump(mode):
    """A stop that begins at x = 0: passed through, and its derivative right."""
    stop = sp.Piecewise((-F * x, x > 0), (0, True))
    solve = pushed(stop).solve_fn(method="tsit5", rtol=1e-11, atol=1e-12)
    times, start = np.array([0.0, 1.0]), np.array([-0.5, 1.0])
    found = jax.jit(JACOBIANS[mode](lambda F: solve(times, start, {"F": F}).q[-1, 0]), compiler_options=QUICK)(4.0)
    right = jax.grad(lambda F: jax.numpy.sin(jax.numpy.sqrt(F) * 0.5) / jax.numpy.sqrt(F))(4.0)
    assert float(found) == pytest.approx(float(right), rel=1e-6)
