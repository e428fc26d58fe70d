"""What prepared runs are given: states that contradict the constraints, and numbers that declarations exclude."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sympy import Piecewise, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.loops.prepared_loop import admission_status
from dalembert.methods.status import RUNNING, Status
from dalembert.reduction.admission import _broken
from dalembert.starts.symbol_assumptions import contradicts
from dalembert.transforms.lower_kernels import lower_kernel
from scene.builders import quaternion_body

pytestmark = pytest.mark.usefixtures("quick_xla")

x, y, z, u = dynamicsymbols("x y z u")
t = dynamicsymbols._t
m, g, k, ell, e = symbols("m g k ell e", positive=True)
P = {m: 1.0, g: 9.81}


def ring(*, given: bool = False, late: bool = False) -> da.Scene:
    """Return a bead on a ring of radius 1, or of a radius that is given, with a force that changes at a time."""
    N, O = ReferenceFrame("N"), Point("O")
    bead = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("ring", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", bead, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - (u**2 if given else 1))
    if given:
        scene.add_inputs(u)
    if late:
        scene.add_loads((bead, Piecewise((0, t < sqrt(2) / 4), (1, True)) * N.x))
    return scene


def pipe() -> da.Scene:
    """Return a ball in an upright pipe of radius 1, with a floor."""
    N, O = ReferenceFrame("N"), Point("O")
    R, normal = da.unknowns("R normal")
    ball = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("ball in a pipe", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("p", ball, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Joint("floor", body="p", at=ball, force=normal * N.y))
    scene.add_joints(da.Joint("pipe", body="p", at=ball, force=R * (x * N.x + z * N.z)))
    scene.add_holonomic_constraints(x**2 + z**2 - 1)
    scene.add_contacts(da.UnilateralContact(gap=y, normal=normal, restitution=e, name="floor"))
    return scene


@pytest.mark.parametrize(
    ("backend", "formulation", "late"),
    [
        ("llvm", "projected", False),
        ("llvm", "projected", True),
        ("llvm", "baumgarte", False),
        ("llvm", "ggl", False),
        ("numpy", "projected", False),
    ],
)
@pytest.mark.parametrize("span", [(0.0, 0.5), (3.0, 2.5)], ids=["forward", "backward"])
def test_starts_off_the_constraints_are_refused(backend: str, formulation: str, late: bool, span: Any) -> None:
    model = da.compile_model(ring(late=late), backend=backend, formulation=formulation)
    run, p, start = model.prepare(span), model.parameter_vector(P), np.array([0.6, -0.8, 0.8, 0.6])
    end = run(start, p)
    assert run.status is Status.SUCCESS
    np.testing.assert_allclose(np.hypot(end[0], end[1]), 1.0, atol=1e-9)
    run(end, p)  # what a run leaves is a start
    assert run.status is Status.SUCCESS
    off = 1e-6 if formulation == "projected" else 1e-3
    for wrong in (start * [10, 10, 1, 1], start * [1 + off, 1, 1, 1], start * [1, 1, 1, -1]):
        assert np.all(np.isnan(run(wrong, p)))
        assert run.status is Status.INITIAL_STATE
    assert np.all(np.isnan(run(start, np.where(np.array(model.layout.parameters) == "m", -p, p))))
    assert run.status is Status.ASSUMPTION
    run(start * np.nan, p)
    assert run.status is Status.NON_FINITE
    np.testing.assert_array_equal(run(start, p), end)


def test_starts_follow_the_inputs_of_the_call() -> None:
    model = da.compile_model(ring(given=True))
    run, p, start = model.prepare((0.0, 0.1)), model.parameter_vector(P), np.array([0.6, -0.8, 0.0, 0.0])
    for radius, status in ((1.0, Status.SUCCESS), (1.1, Status.INITIAL_STATE)):
        run(radius * start, p, np.array([1.0]))
        assert run.status is status
    run(1.1 * start, p, np.array([1.1]))
    assert run.status is Status.SUCCESS
    times = np.linspace(1.0, 2.0, 5)
    kept = model.prepare((1.0, 2.0), inputs={u: da.samples(times, np.cos(times), "cubic")})
    speed = -np.sin(1.0) * np.array([0.6, -0.8])
    kept(np.array([0.6 * np.cos(1.0), -0.8 * np.cos(1.0), *speed]), p)
    assert kept.status is Status.INITIAL_STATE  # the rate of a spline through five knots is not that of the cosine
    first = model.state({x: 0.6 * np.cos(1.0), y: -0.8 * np.cos(1.0), x.diff(): 0.0}, P, t=1.0, inputs={u: np.cos(1.0)})
    assert first.shape == (4,)


def test_a_run_that_drifts_may_start_where_another_ended() -> None:
    """Weak gains let the length of a quaternion drift by more than initial values may miss it."""
    model = da.compile_model(quaternion_body(), formulation="baumgarte", gains=(1.6, 1.7))
    parameters = {"A": 1.0, "B": 1.1, "C": 1.2, "g": 1.3, "k": 1.4, "m": 1.5}
    run, p = model.prepare((0.0, 1.0)), model.parameter_vector(parameters)
    still = dict.fromkeys((*model.layout.coordinates, *model.layout.rates), 0.0)
    moving = {"e0": 1.0, "e1_dot": 0.1, "e2_dot": 0.2, "e3_dot": 0.3, "x_dot": 0.1, "z_dot": 0.2}
    state = model.state(still | moving, parameters)
    for _ in range(12):
        state = run(state, p)
        assert run.status is Status.SUCCESS
    assert abs(np.linalg.norm(state[3:7]) - 1.0) > 1e-8


def test_a_loose_run_may_start_where_another_ended() -> None:
    model = da.compile_model(ring(), formulation="baumgarte")
    run, p, state = (
        model.prepare((0.0, 1.0), rtol=1e-4, atol=1e-6, method="taylor"),
        model.parameter_vector(P),
        np.array([1.0, 0, 0, 0]),
    )
    for _ in range(5):
        state = run(state, p)
        assert run.status is Status.SUCCESS
    assert abs(np.hypot(*state[:2]) - 1.0) > 1e-9


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_numbers_that_declarations_exclude(backend: str) -> None:
    N, O, s = ReferenceFrame("N"), Point("O"), dynamicsymbols("s", positive=True)
    n = symbols("n", integer=True)
    where = O.locatenew("P", s * N.x)
    scene = da.Scene("spring", frame=N, origin=O, coordinates=[s])
    scene.add_bodies(Particle("p", where, m))
    scene.add_loads((where, -sqrt(k**2) * s * N.x), (where, n * N.x))
    model = da.compile_model(scene, backend=backend)
    run, start = model.prepare((0.0, 0.1)), np.array([1.0, 0.0])
    cases = {
        Status.SUCCESS: [(1, 1, 2), (1, 1e-12, 2), (1, 0, 2)],
        Status.ASSUMPTION: [(1, -1, 2), (1, 1, 0.5), (-1, 1, 2)],
    }
    for status, several in cases.items():
        for first, stiffness, whole in several:
            p = model.parameter_vector({m: 1, k: 1, n: 1})
            p[[model.layout.parameters.index("k"), model.layout.parameters.index("n")]] = stiffness, whole
            end = run(start * first, p)
            assert run.status is status
            assert np.all(np.isfinite(end)) == (status is Status.SUCCESS)


def test_declarations_are_tested_as_those_of_given_values() -> None:
    values = np.array([-2.0, -1.5, -1.0, -1e-12, 0.0, 1e-12, 0.5, 1.0, 2.0, 3.0, np.nan])
    kinds = ("positive", "nonnegative", "negative", "nonpositive", "zero", "integer", "even", "odd")
    for kind, rounding in [(kind, rounding) for kind in kinds for rounding in (0.0, 1e-9)]:
        graph = Graph()
        value = graph.input("value")
        tests = _broken(graph, value, (kind,), rounding)
        kernel = lower_kernel(graph, "admission", tests, {value: ("y", 0)}, arguments=("t", "y", "c"))
        found = [interpret(kernel, {"t": 0.0, "y": [v], "c": []})[0] for v in values.tolist()]
        np.testing.assert_array_equal(np.array(found) > 0, contradicts((kind,), values, rounding), err_msg=kind)


def test_residuals_are_compared_with_their_limits() -> None:
    tests = np.array([[0.0], [2e-8], [1e-8], [np.nan], [1.0]])
    assert admission_status(tests, 1.0) == Status.INITIAL_STATE
    assert admission_status(tests, 3.0) == RUNNING
    tests[0, 0] = 1.0
    assert admission_status(tests, 3.0) == Status.ASSUMPTION


def test_variables_of_scenes_with_contacts() -> None:
    model = da.compile_model(pipe())
    run, p = model.prepare((0.0, 1.0)), model.parameter_vector({**P, e: 0.5})
    start = np.array([1.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(run(start, p)[[0, 2]], [np.cos(1.0), np.sin(1.0)], atol=1e-7)
    for state, parameters, status in (
        (start * [3, 1, 1, 1, 1, 1], p, Status.INITIAL_STATE),
        (np.array([1.0, 0.3, 0.0, 0.1, 0.0, 1.0]), p, Status.INITIAL_STATE),
        (start, p * [1, 1, -1], Status.ASSUMPTION),
    ):
        assert np.all(np.isnan(run(state, parameters)))
        assert run.status is status


BEAD = np.array([0.6, -0.8, 0.8, 0.6])


def ring_before() -> Any:
    """Return the state of the bead of `ring` at -1, when it is at `BEAD` at 0.5."""
    exact = da.compile_model(ring(), formulation="projected", backend="llvm")
    return exact.prepare((0.5, -1.0), rtol=1e-12, atol=1e-13)(BEAD, exact.parameter_vector(P))


def test_violations_decay_in_runs_backward_in_time() -> None:
    """A ring whose violations grow by exp(10 t) where the gain does not follow the direction of time."""
    initial, end = dict(zip(("x", "y", "x_dot", "y_dot"), BEAD, strict=True)), ring_before()
    model = da.compile_model(ring(), formulation="baumgarte", backend="llvm")
    p = model.parameter_vector(P)
    np.testing.assert_allclose(model.prepare((0.5, -1.0))(BEAD, p), end, atol=1e-9)
    for gains in ({}, {"baumgarte_alpha": 10.0, "baumgarte_beta": 10.0}):
        run = model.simulate((0.5, -1.0), initial, {**P, **gains})
        np.testing.assert_allclose(run.y[-1], end, atol=1e-9)
        sweep = model.sweep((0.5, -1.0), initial, {**P, **gains})
        np.testing.assert_allclose(np.ravel(sweep.y)[-4:], end, atol=1e-9)


@pytest.mark.parametrize("backend", ["numpy", "llvm", pytest.param("numba", marks=pytest.mark.matrix), "jax"])
def test_violations_decay_backward_with_gains_of_the_compiler(backend: str) -> None:
    initial, end = dict(zip(("x", "y", "x_dot", "y_dot"), BEAD, strict=True)), ring_before()
    model = da.compile_model(ring(), formulation="baumgarte", gains=(10.0, 10.0), backend=backend)
    assert model.layout.given == ("g", "m")
    span, wrt = (0.5, -1.0), ["g"]
    found = [
        model.simulate(span, initial, P).y[-1],
        np.ravel(model.sweep(span, initial, P).y)[-4:],
        model.prepare(span)(BEAD, model.parameter_vector(P)),
        model.sensitivity(span, initial, P, wrt=wrt).values[-1],
    ]
    if backend == "jax":
        jax = pytest.importorskip("jax")
        with jax.enable_x64(True):
            found.append(np.asarray(model.solve_fn(list(initial))(np.array(span), BEAD, P).y[-1]))
    for state in found:
        np.testing.assert_allclose(state, end, atol=2e-9)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_violations_decay_backward_beside_contacts(backend: str) -> None:
    """A ball in a pipe goes round it by the angle of its speed times the time, whatever its height."""
    model = da.compile_model(pipe(), formulation="baumgarte", gains=(10.0, 10.0), backend=backend)
    names, p = model.layout.variables, {**P, e: 0.5}
    assert model.layout.given == ("e", "g", "m")
    start = np.array([1.0, 30.0, 0.0, 0.0, 0.0, 1.0])
    for span in ((0.0, 2.0), (0.0, -2.0)):
        initial, end = dict(zip(names, start, strict=True)), span[1]
        sweep = model.sweep(span, initial, p)
        found = [
            model.simulate(span, initial, p).q[-1, [0, 2]],
            [sweep.final["x"][0], sweep.final["z"][0]],
            model.prepare(span)(start, model.parameter_vector(p))[[0, 2]],
        ]
        for place in found:
            np.testing.assert_allclose(place, [np.cos(end), np.sin(end)], atol=1e-8)
