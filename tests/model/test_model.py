"""The compiled model: what it explains, and how runs that cannot be finished end."""

import functools
import pickle
import re

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import MissingExtraError, OptionError, ValueInputError
from dalembert.ir.kernel import describe_counts
from dalembert.methods.status import Status
from dalembert.reduction import FORMULATIONS
from dalembert.transforms.pipelines import KERNEL_PASSES, PROGRAM_PASSES, operation_counts


@functools.cache
def compiled(scene, backend="numpy", formulation="auto"):
    try:
        return da.compile_model(da.scenes.ALL[scene](), backend=backend, formulation=formulation)
    except MissingExtraError:
        pytest.skip(f"the extra for {backend} is not installed")


# -- explain ------------------------------------------------------------------------------


def test_explanation_of_the_sleigh():
    model = compiled("chaplygin_sleigh")
    text = model.explain()
    lines = {line.split("  ")[0]: line for line in text.splitlines()}
    assert text.splitlines()[0].startswith("chaplygin_sleigh: 3 coordinates, 1 constraint (0 holonomic), 3 unknown")
    assert "minimal: independent speeds: v_S_x, theta_dot" in lines["formulation"]
    assert "v_S_y is given by a nonholonomic constraint" in text
    assert "x, y, theta, v_S_x, theta_dot" in lines["state"]
    assert "numpy" in lines["backend"] and "dop853" in lines["method"]
    assert describe_counts(model.stages.program.kernel("rhs")) in lines["right side"]
    assert "X, Y, N" in lines["left out"] and "nothing depends on x, y" in lines["left out"]


def listed_passes(text):
    """Return name -> what was done, of the passes that an explanation lists."""
    lines = text[text.index("\npasses ") :].splitlines()[1:]
    found = [re.fullmatch(r"(?:passes)? +(\w+(?: \w+)*) +[\d.]+ ms  (.*)", line) for line in lines]
    return {match[1]: match[2] for match in found}


def test_the_passes_of_the_sleigh():
    model = compiled("chaplygin_sleigh")
    assert "passes" not in model.explain()
    passes = listed_passes(model.explain(passes=True))
    steps = [step.name for pipeline in (KERNEL_PASSES, PROGRAM_PASSES) for step in pipeline.passes]
    assert list(passes) == ["rewrite products", *steps]
    assert passes["hoist parameters"] == (
        "9 operations removed: rhs 2, mass_matrix 1, forcing 1, accelerations 2, energy 3;"
        " 5 operations added: prepare 5"
    )
    assert passes["eliminate dead code"] == "no operations removed"


@pytest.mark.parametrize("scene", da.scenes.ALL)
def test_records_of_passes_lead_to_the_program(scene):
    stages = compiled(scene).stages
    counts = {}
    for record in stages.passes:
        assert record.seconds >= 0.0
        assert {name: counts.get(name, count) for name, count in record.before.items()} == dict(record.before)
        counts.update(record.after)
    assert counts == operation_counts(stages.program)
    assert sum(record.seconds for record in stages.passes) <= stages.seconds["lower"]


def test_a_scene_without_contacts_is_its_only_mode():
    model = compiled("chaplygin_sleigh")
    start, p = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}, {"m": 1.0, "b": 0.3, "I_C": 0.5}
    run, sweep = model.simulate((0, 0.1), start, p), model.sweep((0, 0.1), start, p)
    assert model.contacts == () and model.mode() is model and model.modes is None
    assert run.phases == () and run.modes == {} and len(sweep.phases) == 0 and sweep.modes == {}
    with pytest.raises(OptionError, match="no contact is called 'floor'; known: none"):
        model.mode(floor="slip")
    for result in (run, sweep):
        with pytest.raises(OptionError, match="unknown contact 'floor'"):
            result.mode("floor")


def test_a_scene_with_contacts_gives_the_same_classes():
    plain, model = compiled("chaplygin_sleigh"), da.compile_model(da.scenes.bouncing_ball(), backend="numpy")
    start, p = {"y": 0.1, "y_dot": 0.0, "x": 0.0, "x_dot": 0.0}, {"m": 1.0, "g": 9.81, "e": 0.5}
    start = {name: value for name, value in start.items() if name in model.layout.variables}
    run, sweep = model.simulate((0, 0.2), start, p), model.sweep((0, 0.2), start, p)
    assert type(model) is type(plain) and model.contacts == ("ground",) and model.mode().modes is None
    assert model.mode(ground="open") == model.mode(ground="open").mode(ground="open")
    with pytest.raises(OptionError, match="contact 'ground' cannot be 'stick'; it can be: open"):
        model.mode(ground="open").mode(ground="stick")
    assert model.layout.state == model.layout.variables and run.y.shape[1] == sweep.y.shape[1] == len(
        model.layout.state
    )
    assert len(run.phases) == sweep.phases[0] == 2
    assert set(run.modes) == set(sweep.modes) == {"ground"} and run.modes["ground"][-1] == sweep.modes["ground"][0]
    np.testing.assert_array_equal(run.velocity_violation, 0.0)
    assert run.velocity_violation.shape == run.constraint_violation.shape == (len(run.t), 1)
    again = pickle.loads(pickle.dumps(model))
    assert type(again) is type(model) and again != model and again.contacts == model.contacts


def test_the_passes_of_every_mode_of_a_scene_with_contacts():
    model = da.compile_model(da.scenes.bouncing_ball(), backend="numpy")
    modes = model.explain().count("\nmode ")
    assert modes >= 1 and "passes" not in model.explain()
    assert model.explain(passes=True).count("\npasses ") == modes


@pytest.mark.parametrize("scene", ["chaplygin_sleigh", "rolling_sphere"])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_operation_counts_of_every_formulation_are_those_of_compiling_it(scene, formulation):
    text = compiled(scene, formulation=formulation).explain(formulations=True)
    for other in FORMULATIONS:
        count = describe_counts(compiled(scene, formulation=other).stages.program.kernel("rhs"))
        assert f"{other}: {count}" in re.search("^formulations .*$", text, re.MULTILINE)[0]


def test_explaining_derives_and_compiles_nothing_that_was_not_asked_for(monkeypatch):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected", cache=False)
    loaded = dict(model.engine.steps._loaded)

    def refuse(*_, **__):
        raise AssertionError("explain() derives or compiles")

    for name in ("pipeline.read", "pipeline.derive", "pipeline.reduce", "pipeline.lower"):
        monkeypatch.setattr(f"dalembert.{name}", refuse)
    for name in ("reduce", "lower", "copied"):
        monkeypatch.setattr(f"dalembert.model.explain.{name}", refuse)
    text = model.explain(passes=True)
    assert re.search(r"^formulations  projected: \d+ .*formulations=True", text, re.MULTILINE)
    assert model.engine.steps._loaded == loaded and not model.variants._tables and not model.variants._watched
    with pytest.raises(AssertionError, match="derives or compiles"):
        model.explain(formulations=True)


def test_explanations_count_formulations_that_were_compiled():
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")
    model.variants.in_formulation("augmented")
    line = re.search("^formulations .*$", model.explain(), re.MULTILINE)[0]
    assert "minimal: " in line and "augmented: " in line and "baumgarte: " not in line


def test_explaining_changes_nothing():
    model = compiled("rolling_sphere", formulation="projected")
    source = model.source
    assert re.sub(r"\d+ ms", "", model.explain()) == re.sub(r"\d+ ms", "", model.explain())
    again = da.compile_model(da.scenes.rolling_sphere(), backend="numpy", formulation="projected")
    assert again.source == source == model.source


def test_model_shows_what_it_is():
    model = compiled("chaplygin_sleigh")
    assert repr(model) == "<CompiledModel 'chaplygin_sleigh': minimal, numpy>"
    assert (model.name, model.backend, model.formulation) == ("chaplygin_sleigh", "numpy", "minimal")
    assert "def rhs(t, y, c)" in model.source
    stages = model.stages
    assert stages.rendered.program is stages.program
    assert stages.reduced.equations.q == stages.equations.q
    assert stages.scene.name == stages.model.name == stages.program.name == "chaplygin_sleigh"
    assert list(stages.seconds) == ["backend", "read", "derive", "copy", "reduce", "lower", "render", "load"]
    assert all(seconds >= 0 for seconds in stages.seconds.values())


# -- runs that cannot be finished ---------------------------------------------------------

# test_jax_backend has its own runs that fail: each of its methods compiles anew.
FAST = tuple(backend for backend in BACKENDS if backend != "jax")
RUNS = [(backend, "auto") for backend in FAST] + [("llvm", "dop853"), ("llvm", "tsit5"), ("numpy", "lsoda")]
runs = pytest.mark.parametrize(("backend", "method"), RUNS, ids=["-".join(run) for run in RUNS])


@runs
def test_sphere_in_the_pole_of_its_angles_ends_with_a_status(backend, method):
    """At theta = 0 the angles do not determine each other's rates: NaN in the right-hand side."""
    model = compiled("rolling_sphere", backend)
    initial = {"x": 0, "y": 0, "psi": 0, "theta": 0, "phi": 0, "psi_dot": 1.0, "theta_dot": 0.3, "phi_dot": 0.2}
    trajectory = model.simulate((0, 1), initial, {"m": 1, "r": 1, "g": 9.81}, method=method, max_steps=1000)
    assert not trajectory.success
    assert trajectory.status is not Status.SUCCESS
    assert len(trajectory.message) > 20
    assert len(trajectory.t) == len(trajectory.q) == len(trajectory["energy"])


def explosion():
    """Finite-time blow-up: x'' = 2 x**3 is solved by 1/(1 - t)."""
    x = dynamicsymbols("x")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("explosion", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    m = sp.Symbol("m", positive=True)
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, 2 * m * x**3 * N.x))
    return scene


@functools.cache
def exploding(backend):
    try:
        return da.compile_model(explosion(), backend=backend)
    except MissingExtraError:
        pytest.skip(f"the extra for {backend} is not installed")


@runs
def test_blow_up_ends_with_a_status_near_the_singularity(backend, method):
    trajectory = exploding(backend).simulate(
        (0, 2), {"x": 1.0, "x_dot": 1.0}, {"m": 1.0}, method=method, max_steps=5000
    )
    assert not trajectory.success
    assert 0.9 < trajectory.t[-1] < 1.1
    finite = trajectory.t < 0.9
    np.testing.assert_allclose(trajectory["x"][finite], 1 / (1 - trajectory.t[finite]), rtol=1e-4)


@runs
def test_step_budget_ends_with_a_status(backend, method):
    model = compiled("chaplygin_sleigh", backend)
    initial = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    trajectory = model.simulate(
        (0, 1e4), initial, {"m": 1, "b": 0.3, "I_C": 0.5}, method=method, max_steps=20, max_step=0.5
    )
    assert trajectory.status is Status.MAX_STEPS
    assert "max_steps" in trajectory.message
    assert trajectory.stats.steps + trajectory.stats.rejected <= 20
    assert 0 < trajectory.t[-1] < 1e4


@pytest.mark.parametrize("backend", FAST)
def test_span_of_zero_length_and_backward_runs(backend):
    model = compiled("chaplygin_sleigh", backend)
    initial = {"x": 0.1, "y": 0.2, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    p = {"m": 1, "b": 0.3, "I_C": 0.5}
    still = model.simulate((1, 1), initial, p)
    assert still.success
    np.testing.assert_allclose(still.q[-1], [0.1, 0.2, 0.2], rtol=1e-15)
    there = model.simulate((0, 2), initial, p, rtol=1e-11, atol=1e-13)
    end = dict(zip((*model.layout.coordinates, *model.layout.rates), (*there.q[-1], *there.qdot[-1]), strict=True))
    back = model.simulate((2, 0), end, p, rtol=1e-11, atol=1e-13)
    assert back.success and back.t[-1] == 0
    np.testing.assert_allclose(back.q[-1], [0.1, 0.2, 0.2], atol=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_backends_agree_on_a_motion(backend):
    initial = {"x": 0.1, "y": 0.2, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    p = {"m": 1, "b": 0.3, "I_C": 0.5}
    times = np.linspace(0, 3, 7)
    expected = compiled("chaplygin_sleigh").simulate((0, 3), initial, p, t_eval=times, rtol=1e-11, atol=1e-13)
    found = compiled("chaplygin_sleigh", backend).simulate((0, 3), initial, p, t_eval=times, rtol=1e-11, atol=1e-13)
    np.testing.assert_array_equal(found.t, times)
    np.testing.assert_allclose(found.q, expected.q, atol=2e-9)
    np.testing.assert_allclose(found.qdot, expected.qdot, atol=2e-9)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_prepared_runs_take_arrays_of_their_own_shapes_alone(backend):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend)
    run = model.prepare((0, 1))
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    p = model.parameter_vector({"m": 1, "b": 0.3, "I_C": 0.5})
    state = model.state(start, {"m": 1, "b": 0.3, "I_C": 0.5})
    np.testing.assert_array_equal(run(list(state), p.tolist()), run(state, p))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(run))(state, p), run(state, p))
    for wrong, name in (
        ((state[:1], p), "state"),
        ((state, p[:1]), "p"),
        ((state, 1.0), "p"),
        ((state[None], p), "state"),
    ):
        with pytest.raises(ValueInputError, match=f"^{name} must have shape"):
            run(*wrong)


@pytest.mark.parametrize("span", [1e50, -1e50, 1e140])
def test_polynomial_motions_take_steps_of_any_size(span):
    x, (m, g) = dynamicsymbols("x"), sp.symbols("m g")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("fall", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", O.locatenew("P", x * N.x), m))
    scene.apply_uniform_gravity(-g * N.x)
    model, start, p = da.compile_model(scene), {x: 0, x.diff(): 1}, {m: 2, g: 1e-50}
    wanted = span - 0.5e-50 * span**2
    run = model.simulate((0, span), start, p, method="taylor", max_steps=10)
    assert run.success
    assert run["x"][-1] == pytest.approx(wanted, rel=1e-12)
    assert run(0.25 * span)["x"] == pytest.approx(0.25 * span - 0.5e-50 * (0.25 * span) ** 2, rel=1e-12)
    sweep = model.sweep((0, span), start, p, method="taylor", max_steps=10)
    assert sweep.success.all() and sweep.final["x"][0] == pytest.approx(wanted, rel=1e-12)


def test_steps_beside_a_spring_of_no_stiffness_stop_growing():
    """A coefficient of zero may be the rounding of one that matters, as that of a very soft spring is."""
    x, (m, k) = dynamicsymbols("x"), sp.symbols("m k")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("spring", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, -k * x * N.x))
    model, start, options = da.compile_model(scene), {x: 0, x.diff(): 1}, {"method": "taylor", "max_steps": 50}
    run = model.simulate((0, 1e22), start, {m: 1, k: 0}, **options)
    assert run.success and run["x"][-1] == pytest.approx(1e22, rel=1e-12)
    assert model.simulate((0, 1e50), start, {m: 1, k: 0}, **options).status == Status.MAX_STEPS
    soft = model.simulate((0, 2e25), start, {m: 1, k: 1e-50}, **options)
    assert soft.success and soft["x"][-1] == pytest.approx(1e25 * np.sin(2.0), rel=1e-7)
