import pickle
from functools import cache

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import OptionError, UnknownNameError, ValueInputError
from dalembert.methods.status import Status
from jax_backend.jax_options import QUICK
from system.singular_scenes import parallelogram

jax = pytest.importorskip("jax")
diffrax = pytest.importorskip("diffrax")

from dalembert.jax import blocks, pieces, solved  # noqa: E402
from dalembert.jax.foreign import ForeignRuns  # noqa: E402
from dalembert.jax.runs import adjoint  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

T = np.linspace(0.0, 0.5, 3)
SLEIGH = MOTIONS["chaplygin_sleigh"]


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@cache
def compiled(scene, formulation="minimal", backend="jax"):
    outputs = list(MOTIONS[scene][2])
    return da.compile_model(da.scenes.ALL[scene](), backend=backend, formulation=formulation, outputs=outputs)


def forget():
    """Make methods and traced runs anew."""
    pieces.pieces_of.cache_clear()
    solved.solved_of.clear_cache()


@pytest.mark.parametrize("method", ("dopri8", "tsit5", "taylor", "kvaerno5"))
def test_solve_gives_what_simulate_gives(method):
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh")
    options = {"method": method, "rtol": 1e-11, "atol": 1e-12}
    motion = model.solve_fn(initial, **options)(T, initial, parameters)
    run = model.simulate((0.0, 0.5), initial, parameters, t_eval=T, **options)
    assert int(motion.status) == Status.SUCCESS
    np.testing.assert_allclose(motion.y, run.y, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(motion.outputs[:, 0], run["X"], rtol=1e-7, atol=1e-9)


def test_layouts_of_arguments():
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh")
    by_name = model.solve_fn(initial)
    assert by_name.given == ("x", "y", "theta", "x_dot", "theta_dot")
    p = model.parameter_vector(parameters)
    motion = by_name(T, initial, parameters)
    same = by_name(T, np.array([initial[name] for name in by_name.given]), p)
    from_state = model.solve_fn()(T, model.state(initial, parameters), p)
    np.testing.assert_array_equal(motion.y, same.y)
    np.testing.assert_allclose(motion.y, from_state.y, rtol=1e-12, atol=1e-12)
    backward = by_name(T[::-1], dict(zip(by_name.given, (*motion.q[-1], *motion.qdot[-1][::2]), strict=True)), p)
    np.testing.assert_allclose(backward.q[-1], motion.q[0], atol=1e-7)


def test_violations_decay_in_traced_runs_backward_in_time():
    parameters, initial, _ = SLEIGH
    model, exact = compiled("chaplygin_sleigh", "baumgarte"), compiled("chaplygin_sleigh", backend="llvm")
    values = {**parameters, "baumgarte_alpha": 50.0, "baumgarte_beta": 50.0}
    motion = model.solve_fn(initial, method="tsit5")(T[::-1], initial, values)
    run = exact.simulate((0.5, 0.0), initial, parameters, t_eval=T[::-1])
    np.testing.assert_allclose(motion.qdot, run.qdot, atol=1e-6)


def test_vector_field_is_ready_for_diffrax():
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh")
    y0, p = model.state(initial, parameters), model.parameter_vector(parameters)
    plain = diffrax.diffeqsolve(
        diffrax.ODETerm(model.vector_field),
        diffrax.Dopri8(),
        0.0,
        0.5,
        1e-2,
        y0,
        p,
        stepsize_controller=diffrax.PIDController(rtol=1e-10, atol=1e-12),
    )
    reference = compiled("chaplygin_sleigh", backend="llvm")
    run = reference.simulate((0.0, 0.5), initial, parameters, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(plain.ys[-1], run.y[-1], rtol=1e-9, atol=1e-9)


def test_models_and_functions_pass_through_jit_vmap_and_pickle():
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh")
    y, p = model.state(initial, parameters), model.parameter_vector(parameters)
    copy = pickle.loads(pickle.dumps(model))
    assert copy.source == model.source
    rate = jax.jit(lambda model, y, p: model.vector_field(0.0, y, p))
    np.testing.assert_array_equal(rate(model, y, p), rate(copy, y, p))
    solve = model.solve_fn(initial)
    again = pickle.loads(pickle.dumps(solve))
    spread = np.linspace(0.2, 0.4, 3)
    ends = [
        jax.jit(lambda solve, b: jax.vmap(lambda b: solve(T, initial, {**parameters, "b": b}).q[-1])(b))(
            function, spread
        )
        for function in (solve, again)
    ]
    np.testing.assert_array_equal(*ends)
    alone = solve(T, initial, {**parameters, "b": spread[1]}).q[-1]
    np.testing.assert_allclose(ends[0][1], alone, rtol=1e-10, atol=1e-10)


def test_long_right_hand_sides_go_in_blocks(monkeypatch):
    """Blocks are the same operations, taken in turn; here those of a short right-hand side and its projections."""
    parameters, initial, _ = SLEIGH
    found = []
    monkeypatch.setattr(ForeignRuns, "serves", False)
    for limit in (pieces._LARGEST_AT_ONCE, 0):
        monkeypatch.setattr(pieces, "_LARGEST_AT_ONCE", limit)
        forget()
        solve = compiled("chaplygin_sleigh", "projected").solve_fn(initial, method="tsit5")
        run = jax.jit(lambda p, solve=solve: solve(T, initial, p).y, compiler_options=QUICK)
        found.append((run(parameters), str(run.trace(parameters).jaxpr).count("branches=")))
    forget()
    assert found[0][1] < found[1][1]
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("largest", (0, 10**6))
def test_cotangents_of_evaluations_are_summed_in_one_piece_and_in_blocks(largest, monkeypatch):
    monkeypatch.setattr(blocks, "LARGEST_WHOLE", largest)
    parameters, initial, _ = MOTIONS["edge_plate"]
    model = compiled("edge_plate")
    kernel = model.stages.program.kernel("rhs")
    y, p = (jax.numpy.asarray(v) for v in (model.state(initial, parameters), model.parameter_vector(parameters)))
    kernels = model.solve_fn()._kernels
    c = kernels.constants(p)
    pull = blocks.cotangents_of(kernel, len(y), len(c))
    assert type(pull).__name__ == ("_Whole" if largest else "_InBlocks")
    memory, sums = pull.begin(c), jax.numpy.zeros_like(c)
    step = jax.jit(pull)
    for at in (y, 1.1 * y):
        rates = jax.numpy.cos(at)
        memory, found = step(memory, 0.0, at, rates)
        by_y, by_c = jax.vjp(lambda y, c: kernels["rhs"](0.0, y, c), at, c)[1](rates)
        np.testing.assert_allclose(found, by_y, rtol=1e-12, atol=1e-13)
        sums += by_c
    np.testing.assert_allclose(pull.sums(memory), sums, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    ("formulation", "limit", "alone"), [("minimal", 0, True), ("minimal", 50, False), ("projected", 0, False)]
)
def test_which_gradients_go_back_one_stage_after_the_other(formulation, limit, alone, monkeypatch):
    """What makes the gradient of a run cost a few runs: no derivative of a step is ever a whole matrix."""
    monkeypatch.setattr(pieces, "_SHORT", limit)
    forget()
    solve = compiled("chaplygin_sleigh", formulation).solve_fn(method="tsit5")
    in_turn = pieces.pieces_of(solve._program, solve._kernels, "tsit5", 0).steps.in_turn
    assert (in_turn is not None) == alone
    forget()


SEVERAL = [0.0, 0.1, 0.1001, 0.1002, 4.0, 4.0, 9.0, 9.0]


@pytest.mark.parametrize(
    ("times", "limit"),
    [
        ([0.0, 9.0], 0),
        pytest.param([0.0, 4.0, 9.0], 0, marks=pytest.mark.matrix),
        (SEVERAL, 0),
        (SEVERAL, 50),
        pytest.param([0.0, -1.0, -2.0], 50, marks=pytest.mark.matrix),
        ([0.0, -1.0], 0),
        pytest.param([0.0, 0.0], 0, marks=pytest.mark.matrix),
    ],
)
def test_gradients_one_stage_after_the_other(times, limit, monkeypatch):
    monkeypatch.setattr(pieces, "_SHORT", limit)
    monkeypatch.setattr(adjoint, "_CHUNK", 8)
    forget()
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh")
    at = model.state(initial, parameters), model.parameter_vector(parameters)
    weights = np.cos(np.arange(len(times) * len(at[0]))).reshape(len(times), -1)

    solve = model.solve_fn(method="tsit5", rtol=1e-6, atol=1e-8)
    directions = tuple(np.sin(1.0 + np.arange(len(part))) for part in at)

    def value(y, p):
        return (weights * solve(np.array(times), y, p).y).sum()

    def both(*at):
        return jax.grad(value, argnums=(0, 1))(*at), jax.jvp(value, at, directions)[1]

    found, pushed = jax.jit(both, compiler_options=QUICK)(*at)
    assert sum(a @ b for a, b in zip(found, directions, strict=True)) == pytest.approx(float(pushed), rel=1e-9)
    forget()


@pytest.mark.matrix
@pytest.mark.parametrize("limit", (0, 50))
def test_times_that_are_all_the_first_have_derivatives(limit, monkeypatch):
    monkeypatch.setattr(pieces, "_SHORT", limit)
    forget()
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh")
    y, p = model.state(initial, parameters), model.parameter_vector(parameters)

    def states(y):
        return model.solve_fn(method="tsit5")(np.zeros(3), y, p).y

    each = np.broadcast_to(np.eye(len(y)), (3, len(y), len(y)))
    for derivative, expected in (
        (jax.jacfwd(states), each),
        (jax.jacrev(states), each),
        (jax.grad(lambda y: (states(y) ** 2).sum()), 6.0 * y),  # not vectorised
    ):
        np.testing.assert_array_equal(jax.jit(derivative, compiler_options=QUICK)(y), expected)
    forget()


def test_pickled_models_of_other_backends():
    model = compiled("chaplygin_sleigh", "projected", "numpy")
    assert pickle.loads(pickle.dumps(model)).source == model.source


@pytest.mark.matrix
@pytest.mark.parametrize(
    ("method", "formulation"),
    [pytest.param("tsit5", "minimal", marks=pytest.mark.matrix), ("tsit5", "projected"), ("taylor", "minimal")],
)
def test_both_modes_alone_and_in_batches_there_and_back(method, formulation):
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh", formulation)
    y, p = model.state(initial, parameters), model.parameter_vector(parameters)
    options = {"method": method, "rtol": 1e-6, "atol": 1e-8}
    forward = reverse = model.solve_fn(**options)
    spans = np.array([[0.0, 0.5], [0.0, -0.5], [0.0, 0.0], [0.0, 2.0]])

    def ends(solve):
        return lambda y, p, span: solve(span, y, p).y[-1]

    def over_spans(derivative, solve):
        every = jax.vmap(derivative(ends(solve), argnums=(0, 1)), (None, None, 0))
        return jax.jit(every, compiler_options=QUICK)(y, p, spans)

    pushed, pulled = over_spans(jax.jacfwd, forward), over_spans(jax.jacrev, reverse)
    over_two = jax.jacrev(lambda y, p: reverse(np.array([0.0, 1.0, 2.0]), y, p).y[-1], argnums=(0, 1))
    alone = jax.jit(over_two, compiler_options=QUICK)(y, p)
    for a, b, c in zip(pushed, pulled, alone, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(b[3], c, rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(pulled[0][2], np.eye(len(y)))
    np.testing.assert_array_equal(pulled[1][2], np.zeros((len(y), len(p))))


def test_running_out_of_steps_is_a_status():
    parameters, initial, _ = SLEIGH
    motion = compiled("chaplygin_sleigh").solve_fn(initial, max_steps=2)(np.array([0.0, 50.0]), initial, parameters)
    assert int(motion.status) == Status.MAX_STEPS and np.isnan(motion.q[-1]).all()


def test_vector_fields_have_the_precision_of_their_arguments():
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh")
    y, p = model.state(initial, parameters), model.parameter_vector(parameters)
    with jax.enable_x64(False):
        assert model.vector_field(0.0, jax.numpy.asarray(y), jax.numpy.asarray(p)).dtype == np.float32
    assert model.vector_field(0.0, y, p).dtype == np.float64


@pytest.mark.parametrize("method", ("tsit5", "kvaerno5"))
def test_what_is_not_finite_is_a_status_in_traced_code(method):
    parameters, initial, _ = SLEIGH
    slowness = 1 / dynamicsymbols("x").diff()
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", outputs=[slowness])
    y, p = model.state(initial, parameters), model.parameter_vector(parameters)
    run = jax.jit(model.solve_fn(method=method))
    given = {
        Status.SUCCESS: (T, y, p),
        Status.NON_FINITE: (T, np.where(np.arange(5) == 1, np.nan, y), p),
        Status.TIMES_IN_NO_ORDER: (np.array([0.0, np.nan, 1.0]), y, p),
    }
    for status, arguments in given.items():
        assert int(run(*arguments).status) == status
    assert int(run(T, y, np.array([1.0, np.inf, 1.0])).status) == Status.NON_FINITE
    at_rest = run(T, 0.0 * y, p)
    assert int(at_rest.status) == Status.NON_FINITE and not np.isfinite(at_rest.outputs).any()
    np.testing.assert_array_equal(at_rest.y, 0.0)


def test_what_jax_traces_is_referred_to_solve_fn():
    parameters, initial, _ = SLEIGH
    model = compiled("chaplygin_sleigh", backend="numpy")
    calls = (
        lambda x: model.simulate((0.0, 1.0), initial, {**parameters, "b": x}),
        lambda x: model.simulate((0.0, 1.0), {**initial, "x": x}, parameters),
        lambda x: model.simulate((0.0, x), initial, parameters),
        lambda x: model.simulate((0.0, 1.0), initial, parameters, t_eval=[0.0, x]),
        lambda x: model.simulate((0.0, 1.0), initial, parameters, rtol=x),
        lambda x: model.sweep((0.0, x), initial, parameters),
        lambda x: model.accelerations(0.0, [x, x, x], [x, x, x], parameters),
    )
    for call in calls:
        with pytest.raises((ValueInputError, OptionError), match=r"traced by JAX(.|\n)*model\.solve_fn"):
            jax.jit(call)(0.5)


@pytest.mark.parametrize("sizes", [(4, 3), (5, 2), (6, 3), (5, 4)])
def test_vector_fields_refuse_other_lengths(sizes):
    model = compiled("chaplygin_sleigh")
    with pytest.raises(OptionError, match=r"must have shape \([53],\), for "):
        jax.jit(model.vector_field)(0.0, np.ones(sizes[0]), np.ones(sizes[1]))


def test_faults():
    initial = SLEIGH[1]
    model = compiled("chaplygin_sleigh")
    with pytest.raises(OptionError, match="max_step must be a positive"):
        model.solve_fn(initial, max_step=0.0)
    with pytest.raises(OptionError, match="'euler'"):
        model.solve_fn(initial, method="euler")
    with pytest.raises(UnknownNameError, match="'z'"):
        model.solve_fn(["z"])
    with pytest.raises(UnknownNameError, match=r"'bb'(.|\n)*missing parameters: b"):
        model.solve_fn(initial)(T, initial, {"m": 1.0, "bb": 0.1, "I_C": 1.0})
    with pytest.raises(OptionError, match=r"shape \(3,\)"):
        model.solve_fn(initial)(T, initial, np.ones(2))
    for name in ("vector_field", "solve_fn"):
        numba = compiled("chaplygin_sleigh", "minimal", "numpy")
        with pytest.raises(OptionError, match=f'{name}.*backend="jax"'):
            numba.vector_field(0.0, None, None) if name == "vector_field" else numba.solve_fn()


def test_runs_that_start_with_dependent_constraints_have_a_status():
    """Pivots set one of two constraints aside there, and which may change along the motion."""
    model = da.compile_model(parallelogram(), backend="jax")
    solve = model.solve_fn(["a", "b", "a_dot"], method="tsit5")

    def end(angle, g):
        start, p = {"a": angle, "b": angle, "a_dot": 1.0}, {"m": 1.0, "L": 1.0, "g": g}
        run = solve(jax.numpy.array([0.0, 0.1]), start, p)
        return run.y[-1, 0], run.status

    last, status = jax.jit(jax.vmap(end, (0, None)))(jax.numpy.array([0.3, 0.4]), 9.81)
    assert np.all(status == Status.SINGULAR_CONFIGURATION) and np.all(np.isnan(last))
    last, by_g, status = jax.jit(lambda g: jax.jvp(lambda g: end(0.3, g), (g,), (1.0,), has_aux=True))(9.81)
    assert status == Status.SINGULAR_CONFIGURATION and np.isnan(last) and np.isnan(by_g)
