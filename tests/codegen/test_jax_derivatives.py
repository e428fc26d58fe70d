"""Derivatives by JAX: of whole motions on every ready scene, and where operations have none."""

from functools import cache

import numpy as np
import pytest
from sympy import Piecewise, atan2, log, sin, sqrt, symbols

import dalembert as da
from oracles.complex_step import derivatives
from runtime.test_sensitivity import MOTIONS, assert_close

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

from dalembert.codegen.jax import functions  # noqa: E402

T = np.linspace(0.0, 0.5, 3)
QUICK = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}
"""Compiles several times faster, to code that is slower to run."""
JACOBIANS = {"forward": jax.jacfwd, "reverse": jax.jacrev}
POINTS = ("somewhere", "at rest", "zero angles and spins")
MODES = pytest.mark.parametrize("mode", JACOBIANS)

#: At which angles the coordinates themselves are singular, or the constraints cannot hold.
NEEDED = {"rolling_sphere": ("theta",), "corner_plate": ("theta",), "edge_plate": ("theta",)}


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@cache
def compiled(scene, formulation, backend="jax"):
    outputs = list(MOTIONS[scene][2])
    return da.compile_model(da.scenes.ALL[scene](), backend=backend, formulation=formulation, outputs=outputs)


def start(scene, point):
    """Return initial values: the scene's own, or with rates, or angles and their rates, that are zero."""
    initial = dict(MOTIONS[scene][1])
    zero = {
        "somewhere": (),
        "at rest": [name for name in initial if name.endswith("_dot")],
        "zero angles and spins": [
            name
            for name in initial
            if name.split("_")[0] in ("psi", "theta", "phi") and name not in NEEDED.get(scene, ())
        ],
    }[point]
    return initial | dict.fromkeys(zero, 0.0)


@cache
def jacobian(scene, formulation, mode):
    """Return the compiled values and derivatives of everything along a motion."""
    options = {"method": "tsit5", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.02}  # steps of a motion at rest are long
    solve = compiled(scene, formulation).solve_fn(MOTIONS[scene][1], mode=mode, **options)

    def everything(p, initial):
        motion = solve(T, initial, p)
        found = jax.numpy.concatenate([motion.q, motion.qdot, motion.outputs], axis=1)
        return found, found

    return jax.jit(JACOBIANS[mode](everything, argnums=(0, 1), has_aux=True), compiler_options=QUICK)


@cache
def expected(scene, formulation, point):
    parameters, _, outputs = MOTIONS[scene]
    layout, initial = compiled(scene, formulation).layout, start(scene, point)
    of = (*layout.coordinates, *layout.rates, *outputs)
    return derivatives(compiled(scene, formulation, "numpy"), T, initial, parameters, (*parameters, *initial), of)


@pytest.mark.parametrize("point", POINTS)
@MODES
@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("scene", da.scenes.ALL)
def test_derivatives_are_those_of_complex_steps(scene, formulation, mode, point):
    parameters, initial = MOTIONS[scene][0], start(scene, point)
    along, values = jacobian(scene, formulation, mode)(parameters, initial)
    columns = {**along[0], **along[1]}
    found = np.stack([columns[name] for name in (*parameters, *initial)], axis=2)
    exact, slopes = expected(scene, formulation, point)
    np.testing.assert_allclose(values, exact, rtol=1e-9, atol=1e-10)
    assert_close(found, slopes)


@pytest.mark.parametrize("mode", JACOBIANS)
def test_numba_has_the_same_derivatives(mode):
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = compiled("chaplygin_sleigh", "minimal", "numba")
    of, wrt = (*model.layout.coordinates, *model.layout.rates, "X", "Y"), (*parameters, *initial)
    run = model.sensitivity((T[0], T[-1]), initial, parameters, wrt=wrt, of=of, t_eval=T, rtol=1e-12, atol=1e-14)
    along = jacobian("chaplygin_sleigh", "minimal", mode)(parameters, initial)[0]
    assert_close(np.stack([{**along[0], **along[1]}[name] for name in wrt], axis=2), run.jacobians)


# -- where there is no derivative ---------------------------------------------------------------


def with_a_singular_branch():
    """A sleigh that a torque turns; away from zero angles it is written with what is singular there."""
    scene = da.scenes.chaplygin_sleigh()
    x, y, theta = scene.coordinates
    K = symbols("K", positive=True)
    away = K * sin(theta) / theta * sqrt(theta) * log(theta) * theta ** (K / 3) * atan2(y, x) / (x * y)
    scene.add_loads((scene.bodies[0].frame, Piecewise((away, theta > 0.5), (-K * theta, True)) * scene.frame.z))
    return scene


@pytest.fixture(scope="module")
def branched():
    return da.compile_model(with_a_singular_branch(), backend="jax", formulation="minimal")


STRAIGHT = {"x": 0.0, "y": 0.0, "theta": 0.0, "x_dot": 0.9, "theta_dot": 0.0}
SPRING = {"m": 1.3, "b": 0.3, "I_C": 0.7, "K": 0.4}


def test_only_operations_of_branches_are_guarded(branched):
    guarded = [line for line in branched.source.splitlines() if "fn.guarded" in line]
    assert any(" / " in line for line in guarded) and any("jnp.log" in line for line in guarded)
    assert "fn.guarded" not in compiled("chaplygin_sleigh", "minimal").source


@MODES
def test_singular_branches_that_are_not_taken_give_no_nan(branched, mode):
    plain = da.scenes.chaplygin_sleigh()
    K = symbols("K", positive=True)
    plain.add_loads((plain.bodies[0].frame, -K * plain.coordinates[2] * plain.frame.z))
    found = []
    for model in (branched, da.compile_model(plain, backend="jax", formulation="minimal")):
        solve = model.solve_fn(STRAIGHT, method="tsit5", mode=mode, rtol=1e-10, atol=1e-12, max_step=0.05)
        ends = JACOBIANS[mode](lambda p, i, solve=solve: solve(T[::2], i, p).q[-1], argnums=(0, 1))
        found.append(jax.tree.leaves(jax.jit(ends, compiler_options=QUICK)(SPRING, STRAIGHT)))
    assert all(np.isfinite(value).all() for value in found[0])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9, atol=1e-9)


def test_vector_fields_with_singular_branches(branched):
    p = branched.parameter_vector(SPRING)
    y = branched.state(STRAIGHT, SPRING)
    matrices = [derivative(lambda y: branched.vector_field(0.0, y, p))(y) for derivative in JACOBIANS.values()]
    assert np.isfinite(matrices).all()
    np.testing.assert_allclose(*matrices, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("function", "points"),
    [
        (lambda x: functions.sqrt(x * x), (0.0, 2.0)),
        (lambda x: functions.power(x * x, 0.25), (0.0, 2.0)),
        (lambda x: functions.atan2(x * x, x), (0.0, 2.0)),
        (lambda x: functions.asin(1.0 - x * x), (0.0, 0.5)),
        (lambda x: functions.acos(1.0 - x * x), (0.0, 0.5)),
        (lambda x: functions.guarded(lambda a, b: a / b, x, x * x), (0.0, 2.0)),
        (lambda x: functions.guarded(jax.numpy.log, x), (0.0, 2.0)),
    ],
)
def test_guarded_functions(function, points):
    singular, regular = points
    for derivative in (jax.grad(function), jax.jacfwd(function)):
        assert derivative(singular) == 0.0
        difference = float(function(regular + 1e-6) - function(regular - 1e-6)) / 2e-6
        assert float(derivative(regular)) == pytest.approx(difference, rel=1e-7)
