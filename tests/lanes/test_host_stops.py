"""Runs that the host takes from stop to stop: where they end, and what inputs and conditions follow a stop."""

import numpy as np
import pytest
import sympy as sp
from scipy.interpolate import CubicSpline
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.lanes.cases import BlockResult, CaseBlock
from dalembert.lanes.host_stops import CasesAtStops, in_blocks, in_pieces, side_by_side
from dalembert.methods.status import Status
from dalembert.steps.problem import IntegrationProblem, Solution
from dalembert.stops.input_records import InputRecords
from dalembert.stops.stops import CaseStops, StopAction, StopLists

t = dynamicsymbols._t
x, w = dynamicsymbols("x w")
m = sp.Symbol("m")


def mass(backend, *, force=0, constraint=None):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("mass", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    if constraint is not None:
        scene.add_inputs(w)
        scene.add_holonomic_constraints(constraint)
    scene.add_loads((P, force * N.x))
    return da.compile_model(scene, backend=backend)


@pytest.mark.parametrize(("backend", "method"), [("numpy", "dop853"), ("numba", "dop853"), ("llvm", "radau")])
@pytest.mark.parametrize("events", [[], [x - 100]])
def test_no_run_that_has_used_up_its_steps_succeeds(backend, method, events):
    """Not where it does so at a break, either; cases of sweeps end where single runs do."""
    model = mass(backend, force=sp.Piecewise((0, t < 1), (1, True)) - x)
    ended = []
    for most in range(1, 16):
        options = {"method": method, "max_step": 0.25, "max_steps": most, "events": events}
        run = model.simulate((0, 3), {x: 1, x.diff(): 0}, {m: 1}, **options)
        assert run.success == (run.t[-1] == 3.0) and run.t[-1] == run.t_end
        ended.append(run.t_end)
        if backend == "numpy":
            sweep = model.sweep((0, 3), {x: [1, 1], x.diff(): 0}, {m: 1}, **options)
            assert sweep.status.tolist() == [run.status] * 2 and sweep.t.tolist() == [run.t_end] * 2
    assert 1.0 in ended or method == "radau"


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_events_and_reductions_of_a_motion_that_follows_a_record(backend):
    """The motion has no state, and is another function of time behind each knot."""
    model, knots = mass(backend, constraint=x - w), np.linspace(0, 2, 9)
    given, spline = {w: da.samples(knots, np.sin(3 * knots), "cubic")}, CubicSpline(knots, np.sin(3 * knots))
    run = model.simulate((0, 2), {}, {m: 1}, inputs=given, events=[x - 0.3])
    times = spline.solve(0.3, extrapolate=False)
    np.testing.assert_allclose(run.events[x - 0.3].t, times, rtol=1e-12)
    reduced = {"top": da.maximum(x), "mean": da.mean(x)}
    sweep = model.sweep((0, 2), {}, {m: [1.0, 2.0]}, inputs=given, events=[x - 0.3], reduce=reduced)
    (found,) = sweep.events.values()
    assert found.count.tolist() == [len(times)] * 2
    fine = spline(np.linspace(0, 2, 100_001))
    np.testing.assert_allclose(sweep.reduced["top"], np.max(fine), rtol=1e-8)
    np.testing.assert_allclose(sweep.reduced["mean"], spline.integrate(0, 2) / 2, rtol=1e-9)


# -- cases whose rate is their first constant, at which conditions are decided -------------------------------------


def stops_of(times, acts, middles, first, last, action=None):
    lists = StopLists(*(np.array(a, int) for a in (first, last)), np.array(times), np.array(acts), np.array(middles))
    return CaseStops(lists, 0, () if action is None else (action,))


def problem_of(stops=None, inputs=None, **options):
    c = np.array([0.5] if inputs is None else [0.5, *np.zeros(5)])
    return IntegrationProblem(t0=0.0, t1=3.0, y0=np.ones(1), constants=c, stops=stops, inputs=inputs, **options)


def straight(problem, rate=lambda problem: problem.constants[0]):
    """Return the solution of y' = `rate`, in one step."""
    end = problem.y0 + (problem.t1 - problem.t0) * rate(problem)
    times = np.array([problem.t0, problem.t1])
    y = np.stack([problem.y0, end])
    if problem.t_eval is not None:
        share = (problem.t_eval - problem.t0) / (problem.t1 - problem.t0)
        times, y = problem.t_eval, problem.y0 + share[:, np.newaxis] * (end - problem.y0)
    return Solution(status=Status.SUCCESS, t=times, y=y, steps=1, rejected=0, evaluations=1)


def test_cases_side_by_side_end_as_each_alone():
    calls = []

    def double(time, y, before, after):
        calls.append((time, float(before[0]), float(after[0])))
        return 2 * y

    action = StopAction((0,), function=double)
    about = ([1.0, 1.0, 2.0, 0.5], [1, 0, 1, 1], [1.0, 1.5, 2.5, np.nan])
    spans = np.array([[0.0, 3.0], [0.0, 3.0], [3.0, 0.0], [0.0, 3.0]])
    first, last = [0, 3, 3, 4], [3, 4, 4, 4]
    cases = CasesAtStops(
        stops_of(*about, first, last, action), spans, np.ones((4, 1)), np.full((4, 1), 0.5), np.copy, None
    )
    block = CaseBlock(cases.y, cases.c, spans, np.zeros(0), 1e-6, 1e-6, np.inf, 2)

    def integrate_block(part, done):
        done.y[:] = part.y + (part.spans[:, 1:] - part.spans[:, :1]) * part.c
        done.ends[:] = np.stack([part.spans[:, 1], np.zeros(len(part.y)), np.ones(len(part.y))], axis=1)

    result = BlockResult.empty(4, 1, 0)
    side_by_side(cases, np.array([0, 1, 2]), block, integrate_block, result)
    # (1 + 0.5) doubled, then 1.5 / s for a second: its two steps are used up
    np.testing.assert_allclose(result.y[:, 0], [4.5, 2 * 1.25 + 1.25, 2 * (1 - 1.25) - 0.25, 1.0])
    assert result.ends[:, 0].tolist() == [2.0, 3.0, 0.0, 0.0]
    assert result.ends[:, 1].tolist() == [Status.MAX_STEPS, Status.SUCCESS, Status.SUCCESS, Status.NON_FINITE]
    assert sorted(calls) == [(0.5, 0.5, 0.5), (0.5, 0.5, 0.5), (1.0, 0.5, 1.0)]
    for i in range(2):
        stops = stops_of(*about, first[i : i + 1], last[i : i + 1], action)
        problem = problem_of(stops, max_steps=2)
        alone = in_pieces(CasesAtStops.alone(problem, np.copy), problem, straight, behind=False)
        assert (alone.y[-1], alone.t[-1], alone.status) == (result.y[i], result.ends[i, 0], result.ends[i, 1])


def test_what_steps_and_requested_times_hold_at_a_stop():
    double = StopAction((0,), function=lambda time, y, before, after: 2 * y)
    stops = stops_of([1.0], [1], [2.0], [0], [1], double)
    for behind, here in ((False, 1.5), (True, 3.0)):
        problem = problem_of(stops)
        run = in_pieces(CasesAtStops.alone(problem, np.copy), problem, straight, behind=behind)
        assert run.t.tolist() == [0.0, 1.0, 3.0] and run.y[:, 0].tolist() == [1.0, here, 7.0]
        problem = problem_of(stops, t_eval=np.array([0.5, 1.0, 1.0, 2.0]))
        run = in_pieces(CasesAtStops.alone(problem, np.copy), problem, straight, behind=behind)
        assert run.t.tolist() == [0.5, 1.0, 1.0, 2.0] and run.y[:, 0].tolist() == [1.25, 3.0, 3.0, 5.0]
        assert run.end == 3.0 and run.success


@pytest.mark.parametrize("off", [-2e-16, 0.0, 2e-16])
@pytest.mark.parametrize("at_knots", [True, False])
def test_knots_at_stops_but_for_rounding(off, at_knots):
    """Both are passed at once, where the stop is; the action reads the input that follows."""
    read = []
    act = StopAction((0,), function=lambda time, y, before, after: (read.append((time, before[2], after[2])), y)[1])
    record = da.samples([0.0, 1.0 + off, 2.0, 3.0], [7.0, 8.0, 9.0, 9.0], "hold")
    inputs = InputRecords((record,), (1,), np.zeros(1))
    problem, lasting = problem_of(stops_of([1.0], [1], [2.0], [0], [1], act), inputs, first_step=0.125), []

    def blocks(piece):
        assert (piece.inputs is None) == at_knots and piece.stops is None
        lasting.append((piece.t0, piece.t1, piece.constants[0], piece.constants[2], piece.first_step))
        return [straight(piece)]

    done = list(in_blocks(CasesAtStops.alone(problem, np.copy, at_knots=at_knots), problem, blocks))
    behind = [(1.0, 2.0, 2.0, 8.0, None), (2.0, 3.0, 2.0, 9.0, None)] if at_knots else [(1.0, 3.0, 2.0, 8.0, None)]
    assert lasting == [(0.0, 1.0, 0.5, 7.0, 0.125), *behind] and len(done) == len(lasting)
    assert read == [(1.0, 7.0, 8.0)]


def test_nothing_is_done_where_the_next_piece_is_only_looked_for():
    stops = stops_of([0.0, 1.0], [1, 1], [0.25, 2.0], [0], [2], StopAction((0,), function=lambda *given: 1 / 0))
    case = CasesAtStops.alone(problem_of(stops), np.copy)
    case.look_ahead(np.zeros(1, np.intp))
    piece = case.piece(problem_of(stops), None, None, 7)
    assert (piece.t0, piece.t1, piece.constants[0], piece.y0[0]) == (0.0, 1.0, 0.5, 1.0)
