"""Traced runs with events, reductions and contacts under inputs, beside sweeps and differences."""

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError
from dalembert.methods.status import Status
from jax_backend.jax_options import QUICK
from starts.test_input_values import BLOCK, BLOCK_AT_REST, driven, forced, pushed_block

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

pytestmark = pytest.mark.usefixtures("quick_xla")

OPTIONS = {"method": "tsit5", "rtol": 1e-11, "atol": 1e-13}
KNOTS = np.array([0.0, 0.31, 0.5, 0.93, 1.4, 2.6])
VALUES = np.array([0.4, -1.1, 0.7, 1.6, -0.2, 0.3])
T = np.array([0.1, 0.7, 1.4, 2.5])
P = {"m": 0.8, "k": 2.0}
x, u = dynamicsymbols("x u")
STOP = da.Event(x - 0.2 + u / 10, direction=1, terminal=True, name="stop")


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module")
def model():
    return da.compile_model(forced(), backend="jax")


def same(one, other):
    np.testing.assert_array_equal(np.reshape(one, np.shape(other)), other)


def test_a_batch_with_its_own_records_is_a_sweep(model):
    watched = {"events": [da.Event(x + u - 0.3, name="sum"), STOP], "reduce": {"top": da.maximum(x)}}
    solve, start = model.solve_fn(("x", "x_dot"), **watched, **OPTIONS), {"x": 0.2, "x_dot": -0.1}
    tables = np.stack([VALUES, VALUES[::-1], np.full(6, np.nan), VALUES, VALUES])
    knots = np.stack([KNOTS, KNOTS, KNOTS, KNOTS[::-1], KNOTS / 2.0])
    batch = jax.tree.unflatten(jax.tree.structure(da.samples(KNOTS, VALUES)), [knots, tables])
    found = jax.jit(jax.vmap(lambda record: solve(T, start, P, inputs={u: record})))(batch)
    given = {"u": da.samples(KNOTS, tables[:2])}
    sweep = da.compile_model(forced()).sweep((T[0], T[-1]), start, P, inputs=given, t_eval=T, **watched, **OPTIONS)
    for name, i in (("x", 0), ("u", None)):
        rows = found.outputs[:2, :, 0] if i is None else found.q[:2, :, 0]
        reached = np.isfinite(sweep["x"])
        same(rows, np.where(reached, sweep[name], np.nan))
    np.testing.assert_array_equal(found.status[:2], [Status.EVENT, Status.EVENT])
    np.testing.assert_array_equal(found.status[2:], [Status.NON_FINITE, Status.TIMES_IN_NO_ORDER, Status.OUTSIDE_TABLE])
    for name in ("sum", "stop"):
        same(found.events[name].first[:2], sweep.events[name].first)
    same(found.reduced["top"][:2], sweep.reduced["top"])
    assert np.all(np.isnan(found.q[2:]))


def test_numbers_and_records_of_prescribed_motion_from_a_state():
    """The support moves, so that coordinates and rates of the first state depend on the record."""
    model, p = da.compile_model(driven(), backend="jax"), {"m": 1.1, "ell": 0.7, "g": 9.81}
    times, state = np.array([0.31, 0.6, 2.2]), {"theta": 0.3, "theta_dot": -0.2}
    inputs = {"u": da.samples(KNOTS, VALUES / 4.0, "cubic"), "v": 0.7}
    solve = model.solve_fn(events=["theta_dot"], **OPTIONS)
    found = solve(times, model.state(state, p, inputs={"u": 0.0, "v": 0.7}), p, inputs=inputs)
    run = da.compile_model(driven()).simulate(
        (times[0], times[-1]), state, p, inputs=inputs, t_eval=times, rtol=1e-13, atol=1e-14
    )
    np.testing.assert_allclose(found.q, run.q, rtol=1e-9)
    assert found.events["theta_dot"].count > 2
    same(found.q, solve(times, found.y[0], {**p, "v": 0.7}, inputs={"u": inputs["u"]}).q)


@pytest.mark.matrix
def test_derivatives_by_values_knots_and_all_else_are_differences(model):
    solve = model.solve_fn(events=[da.Event(x + u - 0.3, name="sum"), STOP], **OPTIONS)

    def found(at):
        record, y = da.samples(at[:6], at[6:12]), at[12:14]
        run = solve(at[15:], y, {"m": 0.8, "k": at[14]}, inputs={u: record})
        times = run.events["sum"]
        return jax.numpy.stack([run.q[1, 0], run.outputs[1, 0], times.first, times.last, run.end.t, run.end.q[0]])

    at = np.concatenate([KNOTS, VALUES, [0.2, -0.1, 2.0], T])
    both = jax.jit(lambda at: (found(at), jax.jacrev(found)(at)), compiler_options=QUICK)
    values, slopes = both(at)
    assert np.all(np.isfinite(values)) and values[4] < T[-1]
    some = [1, 2, 3, 6, 7, 10, 12, 14, 15]  # knots that are not passed by a moved time, values and so on
    moved = np.stack([at + size * np.eye(len(at))[i] for i in some for size in (1e-5, -1e-5)])
    ends = np.asarray(jax.jit(jax.vmap(found), compiler_options=QUICK)(moved)).reshape(len(some), 2, -1)
    np.testing.assert_allclose(slopes[:, some].T, (ends[:, 0] - ends[:, 1]) / 2e-5, rtol=1e-6, atol=1e-7)


def test_an_event_at_a_jump_has_no_derivative_and_others_keep_theirs(model):
    """The held force passes the level at a knot."""
    solve = model.solve_fn(events=[da.Event(x + u - 0.3, name="sum"), da.Event(x - 0.05, name="turn")], **OPTIONS)

    def times(values):
        run = solve(T, [0.2, -0.1], P, inputs={u: da.samples(KNOTS, values, "hold")})
        return jax.numpy.stack([run.q[1, 0], run.events["sum"].first, run.events["turn"].first])

    values, slopes = jax.jit(lambda v: (times(v), jax.jacrev(times)(v)), compiler_options=QUICK)(VALUES)
    slopes = np.asarray(slopes)
    assert values[1] in KNOTS
    assert np.all(np.isfinite(slopes[[0, 2]])) and np.any(slopes[2] != 0.0)
    assert np.all(np.isnan(slopes[1][slopes[0] != 0.0][:1]))
    with pytest.raises(OptionError, match="by the knots of input 'u', samples of kind 'hold'"):
        jax.make_jaxpr(jax.grad(lambda t: solve(T, [0.2, -0.1], P, inputs={u: da.samples(t, VALUES, "hold")}).y.sum()))(
            KNOTS
        )


def test_contacts_under_samples():
    """A block on a floor with friction, which held forces push: it sticks and slips."""
    scene, start, p = pushed_block(), BLOCK_AT_REST, BLOCK
    solve = da.compile_model(scene, backend="jax").solve_fn(start, reduce={"fast": da.maximum("x_dot")}, **OPTIONS)
    tables = np.outer([0.5, 1.0], 9.0 * VALUES)
    run = jax.jit(jax.vmap(lambda v: solve(T, start, p, inputs={u: da.samples(KNOTS, v, "hold")})))(tables)
    given = {"u": da.samples(KNOTS, tables, "hold")}
    options = {"t_eval": T, "reduce": {"fast": da.maximum("x_dot")}, **OPTIONS}
    sweep = da.compile_model(scene).sweep((T[0], T[-1]), start, p, inputs=given, **options)
    same(run.q[..., 0], sweep["x"])
    same(run.reduced["fast"], sweep.reduced["fast"])
    assert np.max(np.abs(run.q)) > 0.1


def test_faults(model):
    solve = model.solve_fn(events=[STOP])
    with pytest.raises(OptionError, match=r"input 'u' is a function.*leave out events="):
        solve(T, [0.2, 0.0], P, inputs={u: lambda t, q, qdot: q[0]})
    with pytest.raises(UnknownNameError, match="missing inputs: u"):
        solve(T, [0.2, 0.0], P)
    implicit = model.solve_fn(events=[STOP], method="kvaerno5")
    record = da.samples(KNOTS, VALUES)
    assert implicit(T, [0.2, 0.0], P, inputs={u: record}).status == Status.EVENT
