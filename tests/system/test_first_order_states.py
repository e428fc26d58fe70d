"""First-order states beside coordinates, against closed forms and right-hand sides written by hand."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import (
    FormulationError,
    InitialStateError,
    SceneError,
    UnknownNameError,
    ValueInputError,
)
from dalembert.reduction import FORMULATIONS
from system.first_order_scenes import CASES, F, T, c, e, k, m, r, t, tau, w, x

TIMES = np.linspace(0.0, 2.0, 9)
COARSE = {"bdf": 1e-6, "lsoda": 1e-6, "kvaerno5": 1e-7}
"""Bounds of methods whose errors are far above their tolerances."""
_MADE = {}


def case_of(name):
    if name not in _MADE:
        case = CASES[name]()
        _MADE[name] = case, case.reference(TIMES)
    return _MADE[name]


def model_of(name, formulation="auto", backend="llvm"):
    key = name, formulation, backend
    if key not in _MADE:
        case, _ = case_of(name)
        _MADE[key] = da.compile_model(case.scene, formulation=formulation, backend=backend, outputs=case.outputs)
    return _MADE[key]


def check(name, model, method, bound=1e-9, **options):
    case, reference = case_of(name)
    tolerance = 1e-9 if model.formulation == "ggl" else 1e-11
    options = {"rtol": tolerance, "atol": 1e-2 * tolerance, "t_eval": TIMES, "method": method, **options}
    run = model.simulate(case.span, case.initial, case.parameters, **options)
    assert run.success, run.message
    for i, value in enumerate(case.names):
        np.testing.assert_allclose(run[value], reference[:, i], rtol=0, atol=bound, err_msg=value)
    return run


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_every_formulation_and_method(name, formulation):
    if formulation == "minimal" and name in ("crane", "tricycle"):
        with pytest.raises(FormulationError, match="cannot be put in the formulation 'minimal'"):
            model_of(name, formulation)
        return
    model = model_of(name, formulation)
    for method in model.methods:
        check(name, model, method)


@pytest.mark.parametrize("backend, name", [(b, "crane" if b == "jax" else "spinner") for b in BACKENDS if b != "llvm"])
def test_every_backend(name, backend):
    model = model_of(name, backend=backend)
    methods = list(model.methods) if backend == "numpy" else ["auto"]
    for method in methods:
        coarse = method in COARSE
        check(name, model, method, COARSE.get(method, 1e-9), **({"rtol": 1e-9, "atol": 1e-11} if coarse else {}))


def test_a_lag_and_an_integrator_alone():
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("lag", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_states({F: (r - F) / tau, e: sp.cos(w * t) + F.diff() * 0})
    model = da.compile_model(scene)
    start, values = {x: 0, x.diff(): 1, F: 0.25, e: 0}, {m: 1, r: 2.0, tau: 0.7, w: 3.0}
    for begin in (0.0, 1.7e9):
        run = model.simulate((begin, begin + 3), start, values, rtol=1e-12, t_eval=begin + np.linspace(0, 3, 7))
        s = run.elapsed
        np.testing.assert_allclose(run["F"], 2.0 + (0.25 - 2.0) * np.exp(-s / 0.7), atol=1e-11)
        np.testing.assert_allclose(run["F_dot"], (2.0 - run["F"]) / 0.7, atol=1e-13)
        phase = float(sp.Mod(sp.Integer(int(begin)) * 3, 2 * sp.pi).evalf(40))
        np.testing.assert_allclose(run["e"], (np.sin(3 * s + phase) - np.sin(phase)) / 3, atol=1e-11)
        assert set(run.invariants) == {"energy", "p_x"}


def test_a_rate_that_jumps_in_time_ends_a_step_there():
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("valve", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", O.locatenew("P", x * N.x), m))
    scene.add_states({F: sp.Piecewise((1, sp.Mod(t, 1) < sp.Rational(3, 10)), (-F, True))})
    model = da.compile_model(scene)
    run = model.simulate((0, 2), {x: 0, x.diff(): 0, F: 1.0}, {m: 1}, rtol=1e-11, atol=1e-13)
    once = lambda value: (value + 0.3) * np.exp(-0.7)  # noqa: E731
    assert abs(run["F"][-1] - once(once(1.0))) < 1e-11


def test_names_results_and_outputs():
    case, reference = case_of("servo")
    model = da.compile_model(case.scene, outputs=["F", "F_dot", F * x, F.diff() + 1, "e"])
    assert model.layout.states == ("F", "e")
    program = model.stages.program
    assert type(program).parse(str(program)) == program
    assert model.layout.state == ("x", "x_dot", "F", "e")
    run = model.simulate(case.span, case.initial, case.parameters, rtol=1e-11, t_eval=TIMES)
    rate = (2.0 * (0.7 - run["x"]) - run["F"]) / 0.4
    for key in ("F_dot", F.diff(), "Derivative(F(t), t)"):
        np.testing.assert_allclose(run[key], rate, atol=1e-12)
    np.testing.assert_allclose(run[F], reference[:, 2], atol=1e-9)
    np.testing.assert_allclose(run[str(F * x)], run["F"] * run["x"], atol=1e-13)
    np.testing.assert_allclose(run[str(F.diff() + 1)], rate + 1, atol=1e-12)
    assert {"F", "e", "F_dot", "e_dot"} <= set(run.names)
    np.testing.assert_array_equal(run.to_xarray()["F"], run["F"])
    np.testing.assert_allclose(run(0.55)["e"], case.reference([0.55])[:, 3], atol=1e-9)
    assert "first order   F, e" in model.explain()
    assert "force at 'P' (depends on states)" in model.explain()
    assert run.invariants == {}


def test_sweeps_are_single_runs():
    case, _ = case_of("tricycle")
    model = model_of("tricycle")
    given = {**case.parameters, "tau": np.array([0.5, 0.6, 0.8])}
    start = {**case.initial, "D": np.array([0.1, 0.2, 0.3])}
    for key in ("x_dot", "y_dot"):  # the blade fixes them
        start.pop(key)
    start["x_dot"] = np.array([0.9])
    sweep = model.sweep(case.span, start, given, rtol=1e-11, atol=1e-13, t_eval=TIMES)
    for i in range(3):
        one = {name: np.broadcast_to(value, 3)[i] for name, value in start.items()}
        p = {name: np.broadcast_to(value, 3)[i] for name, value in given.items()}
        run = model.simulate(case.span, one, p, rtol=1e-11, atol=1e-13, t_eval=TIMES)
        for name in ("delta", "D", "T", "D_dot", "x", "X", "energy"):
            np.testing.assert_allclose(sweep[name][i], run[name], rtol=1e-11, atol=1e-12, err_msg=name)
    np.testing.assert_array_equal(sweep.final["T"], sweep["T"][:, -1])
    assert "T" in sweep.to_xarray()
    final = model.sweep(case.span, start, given, rtol=1e-11, atol=1e-13, reduce={"most": da.maximum("D")})
    np.testing.assert_allclose(final["D_dot"], sweep["D_dot"][:, -1], atol=1e-10)
    assert np.all(final.reduced["most"] >= sweep["D"].max(axis=1) - 1e-12)


def test_prepared_runs_and_error_estimates():
    case, reference = case_of("spinner")
    model = model_of("spinner")
    run = model.prepare(case.span, rtol=1e-11, atol=1e-13)
    final = run(model.state(case.initial, case.parameters), model.parameter_vector(case.parameters))
    names = model.layout.state
    np.testing.assert_allclose(final[names.index("T")], reference[-1, 6], atol=1e-9)
    found = model.simulate(case.span, case.initial, case.parameters, rtol=1e-8, error_estimate=True)
    assert np.max(found.error_estimate["T"]) < 1e-6
    back = model.simulate((2.0, 0.0), dict(zip(case.names, reference[-1], strict=True)), case.parameters, rtol=1e-11)
    np.testing.assert_allclose(back["e"][-1], 0.0, atol=1e-8)


@pytest.mark.parametrize("name", ["servo", "tricycle"])
def test_sensitivities_are_differences_of_runs(name):
    case, _ = case_of(name)
    model = model_of(name)
    by = {"servo": ("k", "F"), "tricycle": ("tau", "D")}[name]
    found = model.sensitivity(case.span, case.initial, case.parameters, wrt=by, t_eval=TIMES, rtol=1e-10)
    state = model.layout.states[0]
    assert {*model.layout.coordinates, *model.layout.states} <= set(found.of)
    for place, which in enumerate(by):
        sides = []
        for sign in (1, -1):
            p, start = dict(case.parameters), dict(case.initial)
            table = p if which in p else start
            key = next(key for key in table if str(key) in (which, f"{which}(t)"))
            table[key] = table[key] + sign * 1e-5
            sides.append(model.simulate(case.span, start, p, t_eval=TIMES, rtol=1e-12, atol=1e-13)[state])
        slope = found.jacobians[:, found.of.index(state), place]
        np.testing.assert_allclose(slope, (sides[0] - sides[1]) / 2e-5, atol=1e-7)
    rates = model.sensitivity(case.span, case.initial, case.parameters, of=[f"{state}_dot"], wrt=by, t_eval=TIMES)
    assert rates.jacobians.shape == (len(TIMES), 1, 2)


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_linearisation_of_a_linear_scene_is_its_matrix(formulation):
    case, _ = case_of("servo")
    model = model_of("servo", formulation)
    found = model.linearize(0.0, case.initial, case.parameters)
    assert found.states == ("x", "x_dot", "F", "e")
    expected = [[0, 1, 0, 0], [0, -3 / 1.3, 1 / 1.3, 1 / 1.3], [-5, 0, -2.5, 0], [-1, 0, 0, 0]]
    np.testing.assert_allclose(found.A, expected, atol=1e-12)
    np.testing.assert_allclose(found.B_parameters[3, found.parameters.index("r")], 1.0, atol=1e-13)


def test_linearisation_keeps_states_beside_constraints():
    case, _ = case_of("crane")
    found = model_of("crane", "projected").linearize(0.0, case.initial, case.parameters)
    assert len(found.states) == 3 and found.states[-1] == "F"


def test_events_watch_states_and_jump_them():
    case, _ = case_of("servo")
    model = model_of("servo")
    events = [
        da.Event(F - 0.5, name="strong", terminal=False),
        da.Event("F_dot", name="peak", terminal=False),
        da.Event(t - 1, name="reset", apply={e: e / 2, "F": F - 1}),
    ]
    run = model.simulate(case.span, case.initial, case.parameters, rtol=1e-11, atol=1e-13, events=events)
    for at in run.events["peak"].t:
        assert abs(run(at)["F_dot"][0]) < 1e-9
    for at in run.events["strong"].t:
        assert abs(run(at)["F"][0] - 0.5) < 1e-9
    before = case.reference([1.0])[0]
    half = {"x": before[0], "x_dot": before[1], "F": before[2] - 1, "e": before[3] / 2}
    rest = model.simulate((1, 2), half, case.parameters, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(run["F"][-1], rest["F"][-1], atol=1e-9)


def test_evaluation_takes_states_and_asks_for_them():
    case, _ = case_of("servo")
    model = model_of("servo")
    p = case.parameters
    a = model.accelerations(0, [0.0], [0.5], p, states={F: 2.0, "e": 1.0})
    np.testing.assert_allclose(a, (2.0 + 1.0 - 1.5) / 1.3)
    many = model.accelerations(0, [0.0], [0.5], p, states=[[2.0, 1.0], [0.0, 0.0]])
    np.testing.assert_allclose(many[:, 0], [1.5 / 1.3, -1.5 / 1.3])
    np.testing.assert_allclose(model.forcing(0, [0.0], [0.5], p, states=[2.0, 1.0]), 1.5)
    np.testing.assert_allclose(model.mass_matrix([0.0], p), [[1.3]])
    with pytest.raises(ValueInputError, match="accelerations depends on the first-order states"):
        model.accelerations(0, [0.0], [0.5], p)
    with pytest.raises(UnknownNameError, match="missing states: e"):
        model.accelerations(0, [0.0], [0.5], p, states={F: 2.0})


def test_initial_values_are_asked_for():
    case, _ = case_of("servo")
    model = model_of("servo")
    start = {key: value for key, value in case.initial.items() if key != "e"}
    with pytest.raises(InitialStateError, match="missing for the states e"):
        model.simulate(case.span, start, case.parameters)
    with pytest.raises(InitialStateError, match="missing for the states e"):
        model.sweep(case.span, start, case.parameters)
    closed = model_of("tricycle")
    case, _ = case_of("tricycle")
    guess = {**case.initial, "x_dot": 0.7}
    found = closed.assemble(guess, case.parameters)
    assert found["delta"] == case.initial["delta"]
    closed.simulate((0, 0.1), found, case.parameters)
    del guess["delta"]
    with pytest.raises(InitialStateError, match="guess is missing for the states delta"):
        closed.assemble(guess, case.parameters)


def scene_with(states, load=0, constraints=(), position=x):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", position * N.x)
    scene = da.Scene("wrong", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_states(states)
    scene.add_loads((P, load * N.x))
    scene.add_holonomic_constraints(*constraints)
    return scene


FAULTS = {
    "a coordinate": (lambda: scene_with({x: r}), "state 'x' is a coordinate of the scene too"),
    "a parameter": (lambda: scene_with({r: x}), "state r is not a function of time"),
    "its name is a parameter": (lambda: scene_with({F: sp.Symbol("F")}), "the parameter 'F' has the name of a state"),
    "its name is a rate": (
        lambda: scene_with({dynamicsymbols("x_dot"): r}),
        "the state 'x_dot' has the name of a rate",
    ),
    "twice": (lambda: _twice(), "state 'F' is given twice"),
    "a rate of a rate": (lambda: scene_with({F: e, e: F.diff()}), "it contains F_dot; write the expression"),
    "a strange function": (lambda: scene_with({F: T}), r"T\(t\) is a function of time that is no coordinate"),
    "a position": (lambda: scene_with({F: r}, position=x + F), "depends on the first-order states F"),
    "a constraint": (lambda: scene_with({F: r}, constraints=[x - F]), "holonomic constraint 1 .*states F"),
    "an output's name": (lambda: scene_with({dynamicsymbols("energy"): r}), "name of an output of every model"),
}


def _twice():
    scene = scene_with({F: r})
    scene.add_states({F: x})
    return scene


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(fault):
    make, text = FAULTS[fault]
    with pytest.raises(SceneError, match=text):
        da.compile_model(make())


def test_what_is_no_mapping_is_refused():
    with pytest.raises(SceneError, match="add_states takes a mapping"):
        scene_with([F])


def test_unused_states_go_on_by_themselves():
    model = da.compile_model(scene_with({F: -F, e: 1}))
    run = model.simulate((0, 1), {x: 0, "x_dot": 1, F: 1, e: 0}, {m: 1}, rtol=1e-11)
    np.testing.assert_allclose([run["F"][-1], run["e"][-1], run["x"][-1]], [np.exp(-1), 1, 1], atol=1e-10)


@pytest.mark.parametrize("name", ["servo", "crane", "tricycle"])
def test_the_textbook_view_agrees(name):
    case, _ = case_of(name)
    view, model = da.lagrange(case.scene), model_of(name)
    equations = {**view.equations_of_motion, **view.state_equations}
    run = model.simulate((0, 0.5), case.initial, case.parameters, rtol=1e-11, t_eval=[0.0, 0.5])
    layout = model.layout
    for row in (0, 1):
        symbols = {q: run[q][row] for q in case.scene.coordinates} | {z: run[z][row] for z, _ in case.scene.states}
        rates = {q.diff(t): run[q.diff(t)][row] for q in case.scene.coordinates}
        numbers = {
            s: case.parameters[s.name]
            for s in (m, k, tau, w, c, r, *sp.symbols("g l I V", positive=True))
            if s.name in case.parameters
        }
        q, qdot = ([run[key][row] for key in names] for names in (layout.coordinates, layout.rates))
        states = [run[key][row] for key in layout.states]
        found = [*model.accelerations(run.t[row], q, qdot, case.parameters, states=states)]
        found += [run[f"{name}_dot"][row] for name in layout.states]
        for value, expression in zip(found, equations.values(), strict=True):
            exact = expression.xreplace(rates).xreplace(symbols).xreplace(numbers).subs(t, run.t[row])
            np.testing.assert_allclose(value, float(exact), rtol=1e-9, atol=1e-10)
    assert "First-order states" in str(view)


def test_a_free_body_in_quaternions():
    """The filter of an angular velocity, with angles in the scene that a quaternion replaces."""
    N, O = ReferenceFrame("N"), Point("O")
    a, b, s = dynamicsymbols("a b s")
    A = N.orientnew("A", "Axis", (a, N.z))
    B = A.orientnew("B", "Axis", (b, A.x))
    S = B.orientnew("S", "Axis", (s, B.z))
    from sympy.physics.mechanics import RigidBody, inertia

    scene = da.Scene("top", frame=N, origin=O, coordinates=[a, b, s])
    scene.add_bodies(RigidBody("body", O, S, 1, (inertia(S, 1, 2, 3), O)))
    scene.add_states({F: (S.ang_vel_in(N).dot(S.x) - F) / tau})
    scene.add_loads((S, -F * S.x))
    start = {a: 0.1, b: 0.7, s: 0.3, "a_dot": 0.5, "b_dot": -0.2, "s_dot": 1.0, F: 0.1}
    ends = []
    for orientation in (None, "quaternion"):
        options = {} if orientation is None else {"orientation": orientation}
        run = da.compile_model(scene, **options).simulate((0, 1), start, {tau: 0.5}, rtol=1e-11, atol=1e-13)
        ends.append(run["F"][-1])
    np.testing.assert_allclose(*ends, atol=1e-10)


@pytest.mark.usefixtures("quick_xla")
def test_jax_solves_and_differentiates():
    jax = pytest.importorskip("jax")
    case, reference = case_of("servo")
    model = model_of("servo", backend="jax")
    with jax.enable_x64(True):
        solve = model.solve_fn([*model.layout.variables], method="tsit5", rtol=1e-9, atol=1e-11)
        start = {name: float(value) for name, value in zip(case.names, reference[0], strict=True)}

        def final(force):
            found = solve(TIMES[[0, -1]], {**start, "F": force}, case.parameters)
            return found.y[-1], found.q

        (y, q), (slope, _) = jax.jvp(final, (start["F"],), (1.0,))
    np.testing.assert_allclose(y, reference[-1], atol=1e-8)
    assert q.shape == (2, 1)
    found = model_of("servo").sensitivity(case.span, case.initial, case.parameters, of=["F"], wrt=["F"], t_eval=[2.0])
    np.testing.assert_allclose(slope[2], found.jacobians[-1, 0, 0], atol=1e-7)
