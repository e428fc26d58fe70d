"""Functions that numba has compiled as loads, against SciPy by hand, on every backend that can call them."""

import math
import pickle

import numba
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import CapabilityError, ExpressionError, OptionError
from dalembert.ir.calls import function_of
from dalembert.scene.expressions.compiled_functions import CompiledCall

X, K = dynamicsymbols("x"), sp.symbols("k")
START, P, T = {"x": 1.0, "x_dot": 0.5}, {"k": 2.0}, 5.0


@numba.njit
def force(x, v, k):
    """Return a force whose law has a loop and a branch."""
    total = 0.0
    for n in range(1, 4):
        total += math.sin(n * x) / n
    return -k * total - (0.3 if v > -100 else 0.5) * v


@numba.njit
def force_by_x(x, v, k):
    """Return the derivative by x."""
    return -k * (math.cos(x) + math.cos(2 * x) + math.cos(3 * x))


@numba.njit
def force_by_v(x, v, k):
    """Return the derivative by v."""
    return -0.3


@numba.njit
def force_by_k(x, v, k):
    """Return the derivative by k."""
    return -(math.sin(x) + math.sin(2 * x) / 2 + math.sin(3 * x) / 3)


@numba.njit
def broken(x):
    """Return a force that is an error on one side."""
    if x < 0:
        raise ValueError("x is negative")
    return -x


@numba.cfunc("float64(float64)")
def spring(x):
    """Return the force of a spring."""
    return -x


SLOPES = (force_by_x, force_by_v, force_by_k)


def on_a_line(load):
    """Return a particle of mass 1 under a force along a line."""
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", X * frame.x)
    scene = da.Scene("program", frame, origin, [X])
    scene.add_bodies(Particle("body", point, 1))
    scene.add_loads((point, load * frame.x))
    return scene


def exact(k=2.0):
    """Return the state at the end, by SciPy."""
    rates = force.py_func
    return solve_ivp(lambda t, y: [y[1], rates(y[0], y[1], k)], (0, T), [1.0, 0.5], "DOP853", rtol=1e-12, atol=1e-13).y[
        :, -1
    ]


@pytest.fixture(scope="module")
def models():
    load = da.compiled(force, X, X.diff(), K)
    return {name: da.compile_model(on_a_line(load), backend=name) for name in ("llvm", "numba", "numpy")}


@pytest.mark.parametrize("backend", ["llvm", "numba", "numpy"])
@pytest.mark.parametrize("method", ["auto", "dop853", "radau"])
def test_motions(models, backend, method):
    """Single runs, cases, prepared runs and runs with events; taylor is not among the methods."""
    model, found = models[backend], exact()
    options = {"method": method, "rtol": 1e-10}
    run = model.simulate((0, T), START, P, **options)
    assert run.stats.method == ("dop853" if method == "auto" else method)
    assert "taylor" not in model.methods
    watched = model.simulate((0, T), START, P, **options, events=["x"])
    cases = model.sweep((0, T), START, {"k": [1.0, 2.0, 1.5]}, **options)
    end = model.prepare((0, T), **options)(model.state(START, P), model.parameter_vector(P))
    for x in (run["x"][-1], watched["x"][-1], cases["x"][1], end[0]):
        assert x == pytest.approx(found[0], abs=1e-8)
    assert cases["x"][0] == pytest.approx(exact(1.0)[0], abs=1e-8)
    crossings = watched.events["x"].t
    assert np.abs([run(t)["x"] for t in crossings]).max() < 1e-7


def test_arguments_of_any_kind():
    """Expressions of time and parameters, in a load and in an output; a function of parameters is computed once."""
    time = dynamicsymbols._t
    load = da.compiled(spring, X - sp.sin(time), name="follow") + da.compiled(spring, K**2)
    model = da.compile_model(on_a_line(load), outputs={"law": da.compiled(spring, 3 * X)})
    run = model.simulate((0, T), {"x": 0.0, "x_dot": 0.0}, P, rtol=1e-11)
    t = run.t
    # x'' + x = sin t - k^2 from rest
    np.testing.assert_allclose(run["x"], (np.sin(t) - t * np.cos(t)) / 2 - 4 * (1 - np.cos(t)), rtol=0, atol=1e-8)
    np.testing.assert_array_equal(run["law"], -3 * run["x"])


def test_derivatives():
    """Sensitivities and linear models with derivatives that are given; without them the error says what to do."""
    load = da.compiled(force, X, X.diff(), K, derivatives=SLOPES)
    model = da.compile_model(on_a_line(load))
    found = model.sensitivity((0, T), START, P, wrt=["k"], rtol=1e-10).jacobian("x", "k")[-1]
    assert found == pytest.approx((exact(2.001)[0] - exact(1.999)[0]) / 0.002, rel=1e-5)
    np.testing.assert_allclose(model.linearize(0, START, P).A, [[0, 1], [force_by_x(1.0, 0.5, 2.0), -0.3]], rtol=1e-13)
    assert load.diff(X) == CompiledCall(X, X.diff(), K, load.diff(X).args[-1])
    plain = da.compile_model(on_a_line(da.compiled(force, X, X.diff(), K)))
    for call in (plain.sensitivity, plain.linearize):
        given = ((0, 1), START, P) if call == plain.sensitivity else (0, START, P)
        options = {"wrt": ["k"]} if call == plain.sensitivity else {}
        with pytest.raises(ExpressionError, match=r"derivative of the compiled function 'force'.*derivatives=\(df_dx"):
            call(*given, **options)


@pytest.mark.parametrize("backend", ["llvm", "numba", "numpy"])
def test_an_exception_ends_the_run(backend):
    """What the function raises is NaN: one run, and many cases on several threads, of which others go on."""
    model = da.compile_model(on_a_line(da.compiled(broken, X)), backend=backend)
    run = model.simulate((0, T), {"x": 1.0, "x_dot": 0.0}, {})
    assert run.status.name == "NON_FINITE"
    assert run.t_end == pytest.approx(np.pi / 2, abs=1e-3)
    assert run["x"][-1] == pytest.approx(0, abs=1e-3)
    starts = np.where(np.arange(64 if backend == "numpy" else 2048) % 2, 1.0, -1.0)
    cases = model.sweep((0, 1), {"x": starts, "x_dot": 0.0}, {}, threads=2)
    np.testing.assert_array_equal(cases.success, starts > 0)
    np.testing.assert_allclose(cases["x"][1::2], np.cos(1), rtol=0, atol=1e-7)


def test_the_views_and_copies():
    """Text, LaTeX, numbers, the textbook view and pickles; equal functions are one, others are not."""
    load = da.compiled(force, X, X.diff(), K)
    assert str(load) == "force(x(t), Derivative(x(t), t), k)"
    assert "force" in sp.latex(load)
    assert float(load.subs({X.diff(): 0.5}).subs({X: 1, K: 2}).evalf()) == pytest.approx(force(1.0, 0.5, 2.0))
    assert pickle.loads(pickle.dumps(load)) == load == da.compiled(force, X, X.diff(), K)
    assert load != da.compiled(force, X, X.diff(), K, derivatives=SLOPES)
    assert function_of(load.function.key) is load.function
    view = da.lagrange(on_a_line(load))
    assert "force" in str(view)


@numba.njit
def texts(x):
    """Return no number."""
    return "s"


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: da.compiled(force, X), ExpressionError, r"takes 3 arguments \(x, v, k\), and 1 are given"),
        (lambda: da.compiled(lambda x: x, X), ExpressionError, "is not compiled by numba; write @numba.njit"),
        (lambda: da.compiled(texts, X), ExpressionError, "cannot be compiled as a real function of 1 real numbers"),
        (lambda: da.compiled(force), ExpressionError, "give 1 to 6 arguments, not 0"),
        (lambda: da.compiled(force, X, "v", K), ExpressionError, "'v' is not a SymPy expression"),
        (
            lambda: da.compiled(force, X, X.diff(), K, derivatives=(force_by_x,)),
            OptionError,
            "1 derivatives for 3 arguments",
        ),
    ],
)
def test_wrong_calls(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_what_cannot_be_served(models):
    scene = on_a_line(da.compiled(force, X, X.diff(), K))
    with pytest.raises(CapabilityError, match=r"'jax' traces programs, .* compiled functions \('force"):
        da.compile_model(scene, backend="jax")
    with pytest.raises(OptionError, match=r"'taylor' takes power series, and compiled functions \('force'\) have none"):
        models["llvm"].simulate((0, 1), START, P, method="taylor")
    frame, origin = ReferenceFrame("N"), Point("O")
    placed = da.Scene("placed", frame, origin, [X])
    placed.add_bodies(Particle("body", origin.locatenew("P", da.compiled(spring, X) * frame.x), 1))
    with pytest.raises(ExpressionError, match="the derivative of the compiled function 'spring' is needed"):
        da.compile_model(placed)


def test_exports_refuse_them(models, tmp_path):
    with pytest.raises(CapabilityError, match=r"compiled functions \('force'\) are machine code of this process"):
        models["llvm"].export(tmp_path / "program", initial=START, parameters=P)
    plain = da.compile_model(on_a_line(-X))
    with pytest.raises(OptionError, match="exports take one atol for the whole state"):
        plain.export(tmp_path / "plain", initial=START, parameters={}, atol={"x": 1e-9})
