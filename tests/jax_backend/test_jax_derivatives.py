"""Derivatives by JAX: of whole motions on every ready scene, and where operations have none."""

from functools import cache

import numpy as np
import pytest
from sympy import Piecewise, atan2, log, sin, sqrt, symbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS, assert_close
from jax_backend.jax_options import QUICK
from oracles.complex_step import derivatives

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

from dalembert.jax import functions  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

T = np.linspace(0.0, 0.5, 3)
JACOBIANS = {"forward": jax.jacfwd, "reverse": jax.jacrev}
POINTS = ("somewhere", "at rest", "zero angles and spins")
MODES = pytest.mark.parametrize("mode", JACOBIANS)

#: Each scene in both formulations and modes; the other half of the combinations, which compile as long, in `matrix`.
CHOSEN = {
    ("chaplygin_sleigh", "minimal"): "forward",
    ("chaplygin_sleigh", "projected"): "reverse",
    ("corner_plate", "minimal"): "reverse",
    ("corner_plate", "projected"): "forward",
    ("edge_plate", "minimal"): "reverse",
    ("edge_plate", "projected"): "forward",
    ("rolling_sphere", "minimal"): "forward",
    ("rolling_sphere", "projected"): "reverse",
}
RUNS = [
    pytest.param(scene, formulation, mode, marks=[] if CHOSEN[scene, formulation] == mode else [pytest.mark.matrix])
    for scene in da.scenes.ALL
    for formulation in ("minimal", "projected")
    for mode in JACOBIANS
]

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
def linear(scene, formulation, mode):
    """Return the compiled function of a point, and of a direction of everything given or a weight of every result.

    It gives the results, and their derivatives in that direction, or the derivatives of their weighted sum.
    """
    options = {"method": "tsit5", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.02}  # steps of a motion at rest are long
    solve = compiled(scene, formulation).solve_fn(MOTIONS[scene][1], **options)

    def everything(p, initial):
        motion = solve(T, initial, p)
        return jax.numpy.concatenate([motion.q, motion.qdot, motion.outputs], axis=1)

    def pushed(point, direction):
        return jax.jvp(everything, point, direction)

    def pulled(point, weight):
        values, back = jax.vjp(everything, *point)
        return values, back(weight)

    return jax.jit(pushed if mode == "forward" else pulled, compiler_options=QUICK)


@cache
def jacobian(scene, formulation, mode, point):
    """Return values (n_t, n_of) along a motion, and their derivatives (n_t, n_of, n_wrt); row by row, as `vmap` takes
    as long to compile as everything else."""
    function, at = linear(scene, formulation, mode), (MOTIONS[scene][0], start(scene, point))
    names = [*at[0], *at[1]]
    if mode == "forward":
        ones = np.eye(len(names))
        units = [
            [dict.fromkeys(part, 0.0) | {n: v for n, v in zip(names, row, strict=True) if n in part} for part in at]
            for row in ones
        ]
        columns = [function(at, tuple(unit)) for unit in units]
        return columns[0][0], np.stack([column for _, column in columns], axis=2)
    layout = compiled(scene, formulation).layout
    shape = len(T), len(layout.coordinates) + len(layout.rates) + len(layout.outputs)
    rows = [function(at, unit.reshape(shape)) for unit in np.eye(np.prod(shape))]
    found = [[{**p, **initial}[name] for name in names] for _, (p, initial) in rows]
    return rows[0][0], np.array(found, dtype=float).reshape(*shape, len(names))


@cache
def expected(scene, formulation, point):
    parameters, _, outputs = MOTIONS[scene]
    layout, initial = compiled(scene, formulation).layout, start(scene, point)
    of = (*layout.coordinates, *layout.rates, *outputs)
    return derivatives(compiled(scene, formulation, "numpy"), T, initial, parameters, (*parameters, *initial), of)


@pytest.mark.parametrize("point", POINTS)
@pytest.mark.parametrize(("scene", "formulation", "mode"), RUNS)
def test_derivatives_are_those_of_complex_steps(scene, formulation, mode, point):
    values, found = jacobian(scene, formulation, mode, point)
    exact, slopes = expected(scene, formulation, point)
    np.testing.assert_allclose(values, exact, rtol=1e-9, atol=1e-10)
    assert_close(found, slopes)


def test_numba_has_the_same_derivatives():
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = compiled("chaplygin_sleigh", "minimal", "llvm")
    of, wrt = (*model.layout.coordinates, *model.layout.rates, "X", "Y"), (*parameters, *initial)
    run = model.sensitivity((T[0], T[-1]), initial, parameters, wrt=wrt, of=of, t_eval=T, rtol=1e-12, atol=1e-14)
    assert_close(jacobian("chaplygin_sleigh", "minimal", "forward", "somewhere")[1], run.jacobians)


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


def ends(model, mode, **options):
    """Return the derivatives of the end of a straight motion."""
    solve = model.solve_fn(STRAIGHT, method="tsit5", max_step=0.05, **options)
    matrices = JACOBIANS[mode](lambda p, i: solve(T[::2], i, p).q[-1], argnums=(0, 1))
    return np.array(jax.tree.leaves(jax.jit(matrices, compiler_options=QUICK)(SPRING, STRAIGHT)))


def with_a_spring():
    scene = da.scenes.chaplygin_sleigh()
    K = symbols("K", positive=True)
    scene.add_loads((scene.bodies[0].frame, -K * scene.coordinates[2] * scene.frame.z))
    return scene


def test_singular_branches_that_are_not_taken_give_no_nan(branched):
    options = {"rtol": 1e-10, "atol": 1e-12}
    plain = ends(da.compile_model(with_a_spring(), backend="jax", formulation="minimal"), "forward", **options)
    for mode in JACOBIANS:
        found = ends(branched, mode, **options)
        assert np.isfinite(found).all()
        np.testing.assert_allclose(found, plain, rtol=1e-9, atol=1e-9)


def test_vector_fields_with_singular_branches(branched):
    p = branched.parameter_vector(SPRING)
    y = branched.state(STRAIGHT, SPRING)
    every = jax.jit(lambda y: [mode(lambda y: branched.vector_field(0.0, y, p))(y) for mode in JACOBIANS.values()])
    matrices = np.stack(every(y))
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
        (lambda x: functions.product(functions.guarded(lambda a: 1.0 / a, x), x * x), (0.0, 2.0)),
    ],
)
def test_guarded_functions(function, points):
    singular, regular = points
    every = jax.jit(lambda x: (function(x), [jax.grad(function)(x), jax.jacfwd(function)(x)]))
    assert every(singular)[1] == [0.0, 0.0]
    difference = float(every(regular + 1e-6)[0] - every(regular - 1e-6)[0]) / 2e-6
    assert every(regular)[1] == pytest.approx([difference] * 2, rel=1e-7)


def test_runs_one_after_the_other_that_are_made_again_have_the_gradient_of_one_run():
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")
    y, p = (jax.numpy.asarray(f) for f in (model.state(initial, parameters), model.parameter_vector(parameters)))
    solve = model.solve_fn(method="tsit5", rtol=1e-10, atol=1e-12, max_steps=256)

    def in_segments(p):
        segment = jax.checkpoint(lambda y, t: (solve(jax.numpy.stack([t, t + 0.25]), y, p).y[-1], None))
        return (jax.lax.scan(segment, y, 0.25 * np.arange(4.0))[0] ** 2).sum()

    found = jax.jit(jax.grad(in_segments), compiler_options=QUICK)(p)
    whole = jax.jit(jax.grad(lambda p: (solve([0.0, 1.0], y, p).y[-1] ** 2).sum()), compiler_options=QUICK)(p)
    np.testing.assert_allclose(found, whole, rtol=1e-7)
