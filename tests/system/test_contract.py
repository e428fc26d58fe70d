"""What docs promise of the public interface, sentence by sentence, as far as no other test shows it."""

import ast
import dataclasses
import functools
import inspect
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from sympy import cos, cot, sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, System, dynamicsymbols, inertia

import dalembert as da
from dalembert.methods.status import Status
from dalembert.model.model import CompiledModel
from textbook.helpers import TIME, frame, point, same, symbols_of

SOURCES = Path(da.__file__).parent
x, y, theta = dynamicsymbols("x y theta")
m, b, I_C = symbols("m b I_C", positive=True)
START = {x: 0, y: 0, theta: 0.2, x.diff(): 0.98, theta.diff(): 2.0}
P = {m: 1, b: 0.3, I_C: 0.5}


def sleigh():
    """The scene of the contract, as it is written there, and its mass centre."""
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    G = C.locatenew("G", b * S.x)
    scene = da.Scene("chaplygin_sleigh", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("sleigh", G, S, m, (inertia(S, 0, 0, I_C - m * b**2), G)))
    X, Y, Nz = da.unknowns("X Y N")
    scene.add_joints(da.Joint("blade", body="sleigh", at=C, force=X * N.x + Y * N.y, torque=Nz * N.z))
    scene.add_nonholonomic_constraints(-x.diff() * sin(theta) + y.diff() * cos(theta))
    return scene, G


@functools.cache
def compiled(backend="numpy", *outputs):
    scene, G = sleigh()
    return da.compile_model(scene, backend=backend, outputs=[G if name == "G" else name for name in outputs])


# -- the stages -----------------------------------------------------------------------------------


def test_stages_are_frozen_types_of_their_names():
    stages = compiled().stages
    names = {
        "model": "SceneModel",
        "equations": "EquationsOfMotion",
        "reduced": "ReducedSystem",
        "program": "Program",
        "rendered": "RenderedModule",
    }
    for attribute, name in names.items():
        stage = getattr(stages, attribute)
        assert type(stage).__name__ == name
        with pytest.raises(dataclasses.FrozenInstanceError):
            stage.anything = None
    with pytest.raises(dataclasses.FrozenInstanceError):
        stages.scene = None
    assert isinstance(stages.scene, da.Scene)


@functools.cache
def imported(path):
    """Return the packages that a file imports, without those that only annotations need."""
    found, statements = set(), [ast.parse(path.read_text())]
    while statements:
        n = statements.pop()
        if isinstance(n, ast.If) and getattr(n.test, "id", "") == "TYPE_CHECKING":
            continue
        if isinstance(n, ast.Import):
            found |= {alias.name.split(".")[0] for alias in n.names}
        elif isinstance(n, ast.ImportFrom) and n.level == 0:
            found.add(n.module.split(".")[0])
        kinds = ast.stmt | ast.excepthandler | ast.match_case
        statements += [inner for inner in ast.iter_child_nodes(n) if isinstance(inner, kinds)]
    return found


@pytest.mark.parametrize(
    "package", ["codegen", "ir", "mechanics", "model", "phases", "reduction", "results", "runs", "steps"]
)
def test_sympy_stops_at_read(package):
    assert [p.name for p in sorted((SOURCES / package).rglob("*.py")) if "sympy" in imported(p)] == []


def test_jax_is_imported_by_modules_named_after_it():
    users = [p for p in sorted(SOURCES.rglob("*.py")) if imported(p) & {"jax", "diffrax", "equinox", "lineax"}]
    assert users
    assert [p for p in users if "jax" not in p.relative_to(SOURCES).as_posix()] == []


def test_the_pipeline_is_a_short_list():
    assert len((SOURCES / "compiler.py").read_text().splitlines()) < 150


# -- what the user writes -------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_the_example_as_it_is_written(backend):
    model = compiled(backend)
    traj = model.simulate((0, 10), START, P, rtol=1e-10)
    assert isinstance(model, CompiledModel) and traj.success and traj.t[-1] == 10
    energy = (traj["x_dot"] ** 2 + traj["y_dot"] ** 2 + 0.5 * traj["theta_dot"] ** 2) / 2
    np.testing.assert_allclose(traj["energy"], energy, rtol=1e-9)
    assert np.ptp(traj["energy"]) < 1e-7


def parameters_of(function):
    given = inspect.signature(function).parameters.values()
    keywords = {p.name: p.default for p in given if p.kind is p.KEYWORD_ONLY}
    return [p.name for p in given if p.kind is p.POSITIONAL_OR_KEYWORD and p.name != "self"], keywords


def test_signature_of_compile_model():
    positional, keywords = parameters_of(da.compile_model)
    assert positional == ["source"]
    assert list(keywords)[:4] == ["backend", "formulation", "outputs", "cache"]
    assert keywords.items() >= {"backend": "llvm", "formulation": "auto", "outputs": (), "cache": True}.items()


def test_signatures_of_simulate_and_sweep():
    model = CompiledModel
    tolerances = {"t_eval": None, "method": "auto", "rtol": 1e-8, "atol": 1e-10, "events": ()}
    positional, keywords = parameters_of(model.simulate)
    assert positional == ["t_span", "initial", "parameters"]
    assert keywords.items() >= tolerances.items() and keywords["max_steps"] > 10_000
    positional, keywords = parameters_of(model.sweep)
    assert positional == ["t_span", "initial", "parameters"]
    assert keywords.items() >= {**tolerances, "reduce": None, "progress": False}.items()


@pytest.mark.parametrize(
    "name",
    [
        "add_bodies",
        "add_loads",
        "add_holonomic_constraints",
        "add_nonholonomic_constraints",
        "apply_uniform_gravity",
    ],
)
def test_scene_has_the_methods_of_sympys_system(name):
    assert callable(getattr(System, name)) and callable(getattr(da.Scene, name))


def test_velocities_that_a_user_sets_change_nothing():
    scene, G = sleigh()
    frame(scene, "S").set_ang_vel(scene.frame, theta.diff() * scene.frame.z)
    G.set_vel(scene.frame, G.pos_from(scene.origin).dt(scene.frame))
    q, qdot, p = [0.0, 0.0, 0.3], [0.9, 0.9 * np.tan(0.3), 1.7], {"m": 1.0, "b": 0.3, "I_C": 0.5}
    found = da.compile_model(scene, backend="numpy").accelerations(0.0, q, qdot, p)
    np.testing.assert_array_equal(found, compiled().accelerations(0.0, q, qdot, p))


def test_outputs_may_be_anything_symbolic():
    X, Y = da.unknowns("X Y")
    speed = sp.sqrt(x.diff() ** 2 + y.diff() ** 2)
    scene, G = sleigh()
    outputs = ["N", X, X**2 + Y**2, "energy", "kinetic_energy", speed, G]
    model = da.compile_model(scene, backend="numpy", outputs=outputs)
    run = model.simulate((0, 1), START, P, t_eval=[0.0, 0.5, 1.0], rtol=1e-10)
    assert not run["N"].any()
    np.testing.assert_allclose(run[X**2 + Y**2], (run[X] / np.sin(run[theta])) ** 2, rtol=1e-9)
    np.testing.assert_allclose(run[speed], np.hypot(run["x_dot"], run["y_dot"]), rtol=1e-13)
    np.testing.assert_allclose(run["G_x"], run["x"] + 0.3 * np.cos(run["theta"]), rtol=1e-13)
    np.testing.assert_array_equal(run["energy"], run["kinetic_energy"])
    assert run.to_xarray()["G_y"].shape == (3,)


# -- sweeps ---------------------------------------------------------------------------------------


def test_the_sweep_as_it_is_written():
    lengths = np.linspace(0.1, 0.5, 50)
    model = compiled("llvm")
    sweep = model.sweep((0, 10), START, {"b": lengths, "m": 1.0, "I_C": 0.5}, rtol=1e-9, reduce=None)
    assert len(sweep) == 50 and np.all(sweep.status == Status.SUCCESS)
    assert set(sweep.final) >= {*model.layout.state, *model.layout.coordinates, *model.layout.rates}
    assert all(values.shape == (50,) for values in sweep.final.values())
    np.testing.assert_array_equal(sweep.final["v_S_x"], sweep["v_S_x"])
    data = sweep.to_xarray()
    assert dict(data.sizes) == {"case": 50}
    np.testing.assert_array_equal(data["b"], lengths)


# -- ready scenes ---------------------------------------------------------------------------------

READY = {
    "chaplygin_sleigh": ("x y theta", "m b I_C", "X Y N"),
    "rolling_sphere": ("x y psi theta phi", "m r g", "F_u F_v N"),
    "corner_plate": ("x theta", "m l h g F_A", "N_Q F_Q N_A"),
    "edge_plate": ("x y z psi theta", "m A B C F h g", "X Y Z L M N"),
}


def test_the_scenes_of_the_text_are_ready():
    assert set(READY) == set(da.scenes.ALL)


@pytest.mark.parametrize("name", READY)
def test_ready_scene_has_the_symbols_of_the_text(name):
    coordinates, parameters, unknowns = (names.split() for names in READY[name])
    layout = da.compile_model(getattr(da.scenes, name)(), backend="numpy").layout
    assert list(layout.coordinates) == coordinates
    assert sorted(layout.parameters) == sorted(parameters)
    assert sorted(layout.unknowns) == sorted(unknowns)


# -- the textbook view ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rubbing_plate():
    scene = da.scenes.corner_plate(friction=True)
    return scene, da.lagrange(scene)


def test_equation_4_of_the_plate(rubbing_plate):
    """|F_Q| = mu N_Q, and friction opposes the slip velocity of Q, which is x_dot cos(theta) along the plate."""
    scene, view = rubbing_plate
    plain = da.lagrange(da.scenes.corner_plate())
    q, angle = scene.coordinates
    mu = symbols("mu", positive=True)
    N_Q, F_Q = da.unknowns("N_Q F_Q")
    (law,) = view.friction_laws.items()
    assert law == (F_Q, -mu * N_Q * sp.sign(q.diff(TIME) * cos(angle)))
    along = view.geometry.dot(view.slip_velocity("corner"), frame(scene, "S").x)
    assert same(view.on_constraints(q.diff(TIME) * cos(angle)), along)
    for coordinate in scene.coordinates:
        assert view.equation(coordinate) == plain.equation(coordinate)
        assert F_Q in view.equation(coordinate, ideal=True).free_symbols or coordinate != q
    assert "F_Q = -mu*N_Q*sign(" in str(view.report())


def test_closed_forms_are_refused_with_friction(rubbing_plate):
    """They are derived for ideal joints; the report says so, and goes on."""
    _, view = rubbing_plate
    for name in ("equations_of_motion", "reactions", "first_integrals", "multipliers"):
        with pytest.raises(da.errors.ConstraintError, match=r"has friction \('corner'\).*compile the scene"):
            getattr(view, name)
    assert str(view.report()).count("has friction ('corner')") == 2


def test_friction_in_a_plane_opposes_slip():
    view = da.lagrange(da.scenes.billiard_ball())
    F_x, F_y = view.friction_laws.values()
    N, mu = da.unknowns("N"), symbols("mu", positive=True)
    assert same(F_x**2 + F_y**2, (mu * N) ** 2)


def test_plate_with_friction_obeys_its_equations(rubbing_plate):
    """Equations (1), (2) and (4) hold along the compiled motion."""
    scene, view = rubbing_plate
    model = da.compile_model(scene, backend="numpy", outputs=["N_Q", "F_Q"])
    p = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81, "F_A": 0.7, "mu": 0.3}
    start = {"x": -0.5 / np.tan(0.6), "theta": 0.6, "theta_dot": 1.0}
    assert set(p) == set(model.layout.parameters)
    run = model.simulate((0, 0.1), start, p, t_eval=[0.05], rtol=1e-10)
    np.testing.assert_allclose(abs(run["F_Q"]), 0.3 * run["N_Q"], rtol=1e-12)
    assert run["F_Q"][0] * run["x_dot"][0] * np.cos(run["theta"][0]) < 0
    q, angle = scene.coordinates
    values = dict(zip(symbols_of(scene, "m l h g F_A"), list(p.values()), strict=False))
    values |= {u: run[str(u)][0] for u in da.unknowns("N_Q F_Q")}
    values |= {q: run["x"][0], angle: run["theta"][0]}
    values |= {q.diff(TIME): run["x_dot"][0], angle.diff(TIME): run["theta_dot"][0]}
    second = dict(zip((q.diff(TIME, 2), angle.diff(TIME, 2)), symbols("a0 a1"), strict=True))
    touching = sp.Eq((q + symbols_of(scene, "h")[0] * cot(angle)).diff(TIME, 2), 0)
    equations = [e.subs(second).subs(values) for e in (view.equation(q), view.equation(angle), touching)]
    found = sp.solve(equations[:2], list(second.values()))
    assert abs((equations[2].lhs - equations[2].rhs).subs(found)) < 1e-8


def test_velocity_of_the_blade_is_along_it():
    """With constraint (1), the velocity of C is v_C S.x, v_C = x_dot cos(theta) + y_dot sin(theta)."""
    scene = da.scenes.chaplygin_sleigh()
    view = da.lagrange(scene)
    q, r, angle = scene.coordinates
    along, across, _ = view.geometry.components(view.slip_velocity("blade"), frame(scene, "S"))
    assert same(across, 0)
    assert same(along, view.on_constraints(q.diff(TIME) * cos(angle) + r.diff(TIME) * sin(angle)))
    assert point(scene, "C") is view.action_screw("blade").point
