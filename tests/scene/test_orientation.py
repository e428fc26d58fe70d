"""Bodies that turn freely: declared quaternions, and quaternions in place of angles."""

import functools
import math
import pickle
from itertools import product

import numpy as np
import pytest
from sympy import Rational, cos, sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ExpressionError, InitialStateError, OptionError, SceneError
from dalembert.methods.status import Status
from hard_cases import hard_case

ANGLES = ("psi", "theta", "phi")
SEQUENCES = ["".join(axes) for axes in product("XYZ", repeat=3) if axes[0] != axes[1] != axes[2]]
psi, theta, phi = dynamicsymbols("psi theta phi")
m, A, B, C, g, l, r, k = symbols("m A B C g l r k", positive=True)
INERTIA = {"A": 1.0, "B": 1.4, "C": 2.1}
BODY = {"m": 1.3, **INERTIA}
START = {"psi": 0.4, "theta": 0.7, "phi": -0.9, "psi_dot": 1.1, "theta_dot": -0.3, "phi_dot": 0.8}


def turning(orient, *, loads=None, potential=0, constraints=None, at=None):
    """Return a body that turns about a fixed point, oriented by what `orient(N)` gives."""
    N, O = ReferenceFrame("N"), Point("O")
    S = orient(N)
    G = O if at is None else O.locatenew("G", at(N, S))
    scene = da.Scene("turning", frame=N, origin=O, coordinates=[psi, theta, phi])
    body = RigidBody("body", G, S, m, (inertia(S, A, B, C), G))
    body.potential_energy = potential
    scene.add_bodies(body)
    if loads is not None:
        scene.add_loads(*loads(N, S, G))
    if constraints is not None:
        scene.add_nonholonomic_constraints(*constraints(N, S))
    return scene


def axes_313(N):
    A_ = N.orientnew("A", "Axis", (psi, N.z))
    return A_.orientnew("B", "Axis", (theta, A_.x)).orientnew("S", "Axis", (phi, N.z))


def chain(N):
    P = N.orientnew("P", "Axis", (psi, N.z))
    Q = P.orientnew("Q", "Axis", (theta, P.x))
    return Q.orientnew("S", "Axis", (phi, Q.z))


def opposite(N):
    P = N.orientnew("P", "Axis", (phi, -N.y))
    Q = P.orientnew("Q", "Axis", (psi, P.z))
    return Q.orientnew("S", "Axis", (theta, -Q.x))


ORIENTATIONS = {
    **{f"Body {s}": (lambda N, s=s: N.orientnew("S", "Body", (psi, theta, phi), s)) for s in SEQUENCES},
    "Space 312": lambda N: N.orientnew("S", "Space", (theta, phi, psi), "312"),
    "chain": chain,
    "opposite axes": opposite,
}


@pytest.mark.parametrize("name", ORIENTATIONS)
def test_angles_come_back(name):
    """Angles and rates -> quaternion and angular velocity -> angles and rates."""
    model = da.compile_model(
        turning(ORIENTATIONS[name]), backend="numpy", formulation="projected", orientation="quaternion"
    )
    run = model.simulate((0, 0), START, BODY)
    for key, value in START.items():
        assert run[key][0] == pytest.approx(value, abs=1e-14), key


def models(scene, **options):
    return [da.compile_model(scene, backend="numpy", orientation=o, **options) for o in ("scene", "quaternion")]


SCENES = {
    "free": ({}, {}),
    "moment on the body": ({"loads": lambda N, S, G: [(S, k * S.x + k * N.y)]}, {"k": 0.3}),
    "weight as a vector": ({"at": lambda N, S: l * S.z, "loads": lambda N, S, G: [(G, -m * g * N.z)]}, {}),
    "load in angles": ({"loads": lambda N, S, G: [(S, k * cos(theta) * N.x - k * sin(theta) * sin(phi) * S.y)]}, {}),
    "rate in a constraint": (
        {"constraints": lambda N, S: [psi.diff() * cos(theta) + phi.diff()]},  # omega . S.z
        {"phi_dot": -1.1 * math.cos(0.7)},
    ),
}
PARAMETERS = {"g": 9.81, "l": 0.4, "k": 0.3, **BODY}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.filterwarnings("ignore::dalembert.errors.EnergyWarning")
def test_motion_is_that_of_the_angles(name):
    options, start = SCENES[name]
    start = START | {key: value for key, value in start.items() if key in START}
    runs = []
    for model in models(turning(chain, **options)):
        p = {key: PARAMETERS[key] for key in model.layout.parameters}
        runs.append(model.simulate((0, 0.6), start, p, rtol=1e-11, atol=1e-12, t_eval=[0, 0.3, 0.6]))
    for key in START:
        np.testing.assert_allclose(runs[1][key], runs[0][key], atol=1e-9, err_msg=key)
    np.testing.assert_allclose(
        runs[1]["energy"] - runs[1]["energy"][0], runs[0]["energy"] - runs[0]["energy"][0], atol=1e-9
    )


def test_points_on_frames_between():
    """B.z is S.z, and so regular; a weight at it is the same as one located on the body."""

    def build(at):
        N, O = ReferenceFrame("N"), Point("O")
        P = N.orientnew("P", "Axis", (psi, N.z))
        Q = P.orientnew("Q", "Axis", (theta, P.x))
        S = Q.orientnew("S", "Axis", (phi, Q.z))
        G = O.locatenew("G", l * (Q.z if at == "Q" else S.z))
        scene = da.Scene("top", frame=N, origin=O, coordinates=[psi, theta, phi])
        scene.add_bodies(RigidBody("top", G, S, m, (inertia(S, A, A, C), G)))
        scene.apply_uniform_gravity(-g * N.z)
        return da.compile_model(scene, backend="numpy", orientation="quaternion")

    programs = [build(at).stages.program for at in ("Q", "S")]
    assert programs[0].kernel("rhs") == programs[1].kernel("rhs")


REFERENCE = hard_case("sphere through theta = 0, in angles")


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_rolling_sphere_through_theta_0(backend):
    """theta = 1 - t against the closed form, at t = 0.5, 1 (theta = 0) and 1.5."""
    model = da.compile_model(REFERENCE.scene, backend=backend, orientation="quaternion", outputs=REFERENCE.outputs)
    assert model.formulation == "minimal"
    times = [0.0, *REFERENCE.times()]
    run = model.simulate((0, times[-1]), REFERENCE.initial, REFERENCE.parameters, t_eval=times, rtol=1e-13, atol=1e-15)
    assert run.success
    assert REFERENCE.error(run) < 2e-14
    np.testing.assert_allclose(run["theta"], np.abs(1 - run.t), atol=2e-14)
    assert np.max(np.abs(run.constraint_violation)) < 1e-15


def unequal_sphere(sequence):
    """The rolling sphere with three moments of inertia, and its contact constraint as vectors."""
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Body", (psi, theta, phi), sequence)
    G = O.locatenew("G", x * N.x + y * N.y + r * N.z)
    scene = da.Scene("unequal", frame=N, origin=O, coordinates=[x, y, psi, theta, phi])
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, A, B, C), G)))
    slip = x.diff() * N.x + y.diff() * N.y + S.ang_vel_in(N).cross(-r * N.z)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
    return scene


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_angular_velocity_on_the_body_as_an_output(formulation):
    """The name that a start accepts; the formulation may have other components in its state."""
    names = ("omega_S_x", "omega_S_y", "omega_S_z")
    spin = dict(zip(names, (0.8, -1.1, 0.3), strict=True))
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 0.4, "phi": 0.2, **spin}
    sphere = da.scenes.rolling_sphere()
    model = da.compile_model(sphere, orientation="quaternion", formulation=formulation, outputs=names, backend="numpy")
    assert set(names).isdisjoint(model.layout.state)
    run = model.simulate((0, 1), start, {"m": 1, "r": 0.5, "g": 9.81}, rtol=1e-11)
    assert [run[name][0] for name in names] == pytest.approx(list(spin.values()), abs=1e-13)
    psi, theta, rates = run["psi"], run["theta"], [run[name] for name in ("psi_dot", "theta_dot", "phi_dot")]
    phi = run["phi"]
    found = [  # ZXZ: psi about N.z, theta about the line of nodes, phi about S.z
        rates[0] * np.sin(theta) * np.sin(phi) + rates[1] * np.cos(phi),
        rates[0] * np.sin(theta) * np.cos(phi) - rates[1] * np.sin(phi),
        rates[0] * np.cos(theta) + rates[2],
    ]
    assert len(psi) > 3
    for name, value in zip(names, found, strict=True):
        np.testing.assert_allclose(run[name], value, atol=1e-11)
    named = da.compile_model(sphere, orientation="quaternion", outputs={"spin": "omega_S_z"}, backend="numpy")
    assert named.simulate((0, 1), start, {"m": 1, "r": 0.5, "g": 9.81})["spin"][0] == pytest.approx(0.3)


def test_unequal_sphere_through_theta_0():
    """From before to beyond theta = 0 at t = 0; from there on, angles that are regular there say the same."""
    p = {"m": 1.0, "r": 0.5, **INERTIA}
    tight = {"rtol": 1e-13, "atol": 1e-15}
    model = da.compile_model(unequal_sphere("ZXZ"), orientation="quaternion")
    spin = {"omega_S_x": 0.8, "omega_S_y": -1.1, "omega_S_z": 0.3}
    upright = {"x": 0, "y": 0, "psi": 0.3, "theta": 0, "phi": 0.2, **spin}
    before = model.simulate((0, -1), upright, p, **tight)
    start = {name: before[name][-1] for name in (*model.layout.coordinates, *model.layout.rates)}
    through = model.simulate((-1, 1), start, p, t_eval=np.linspace(-1, 1, 9), **tight)
    assert through["theta"][4] < 1e-12 and np.min(np.delete(through["theta"], 4)) > 0.3
    assert np.ptp(through["energy"]) < 1e-13
    # the other sequence is a rotation by psi + phi about the last axis there, and its rates are about S.y, S.x, S.z
    c = 0.5
    turn = np.array([[math.sin(c), math.cos(c)], [math.cos(c), -math.sin(c)]])
    first, second = np.linalg.solve(turn, [spin["omega_S_x"], spin["omega_S_y"]])
    other = {"x": 0, "y": 0, "psi": 0, "theta": 0, "phi": c, "psi_dot": first, "theta_dot": second}
    other |= {"phi_dot": spin["omega_S_z"]}
    regular = da.compile_model(unequal_sphere("YXZ"))
    expected = regular.simulate((0, 1), other, p, t_eval=np.linspace(0, 1, 5), **tight)
    for name in ("x", "y", "x_dot", "y_dot"):
        np.testing.assert_allclose(through[name][4:], expected[name], atol=1e-13, err_msg=name)


@pytest.mark.parametrize("formulation", ["minimal", "projected", "augmented"])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_angles_end_at_theta_0_and_name_the_remedy(formulation, method):
    """Whether steps fail there or pass it by luck, and whatever is recorded."""
    model = EULER(formulation)
    tight = 1e-8 if method == "radau" else 1e-10
    for options in ({}, {"t_eval": [0, 0.5, 1.5]}, {"t_eval": [0, 0.5, 1.5], "dense": False}):
        start, p = REFERENCE.initial, REFERENCE.parameters
        run = model.simulate((0, 1.5), start, p, method=method, rtol=tight, atol=tight, **options)
        assert run.status is Status.SINGULAR_COORDINATES and not run.success
        assert "gimbal lock" in run.message and "theta = 0" in run.message and "psi, phi" in run.message
        assert 'orientation="quaternion"' in run.message
        assert run.t[-1] < 1.0 + 1e-6


@functools.cache
def EULER(formulation):
    return da.compile_model(da.scenes.rolling_sphere(), formulation=formulation)


@pytest.mark.parametrize("sequence", ["ZXZ", "ZYX"])
@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_cases_of_a_sweep_that_meet_it(sequence, backend):
    lock = 0.0 if sequence == "ZXZ" else math.pi / 2
    model = da.compile_model(unequal_sphere(sequence), backend=backend)
    tilts = lock - np.array([0.5, 1.1, 0.2])
    start = {"x": 0, "y": 0, "psi": 0, "theta": tilts, "phi": 0, "psi_dot": 0, "theta_dot": 1.0, "phi_dot": 0}
    sweep = model.sweep((0, 0.8), start, {"m": 1.0, "r": 0.5, **INERTIA}, method="dop853")
    assert [Status(int(s)) for s in sweep.status] == [
        Status.SINGULAR_COORDINATES,
        Status.SUCCESS,
        Status.SINGULAR_COORDINATES,
    ]


def test_what_is_regular_at_theta_0_goes_on():
    """With psi held at rest, the two angles that are left turn about different lines everywhere."""
    model = da.compile_model(turning(chain, constraints=lambda N, S: [psi.diff()]), backend="numpy")
    start = {"psi": 0.3, "theta": 0.5, "phi": 0.0, "theta_dot": -1.0, "phi_dot": 0.0}
    run = model.simulate((0, 1), start, BODY)
    assert run.success and run["theta"][-1] < 0


# -- declared ---------------------------------------------------------------------------------


def free_body():
    N, O, S = ReferenceFrame("N"), Point("O"), ReferenceFrame("S")
    scene = da.Scene("free_body", frame=N, origin=O, coordinates=[])
    e = da.free_orientation(scene, S)
    scene.add_bodies(RigidBody("body", O, S, m, (inertia(S, A, B, C), O)))
    return scene, e, S


def test_declared_orientation():
    scene, e, _ = free_body()
    model = da.compile_model(scene, backend="numpy")
    assert model.layout.state == ("e0_S", "e1_S", "e2_S", "e3_S", "omega_S_x", "omega_S_y", "omega_S_z")
    start = {e[0]: 1, e[1]: 0, e[2]: 0, e[3]: 0, "omega_S_x": 1, "omega_S_y": 1e-2, "omega_S_z": 2}
    run = model.simulate((0, 20), start, BODY, rtol=1e-11, atol=1e-12)
    momentum = sum((i * run[f"omega_S_{axis}"]) ** 2 for axis, i in zip("xyz", INERTIA.values(), strict=True))
    assert np.ptp(momentum) < 1e-8
    assert np.max(np.abs(run.constraint_violation)) < 1e-14


def test_declared_orientation_in_another_frame_with_other_names():
    N, O, S = ReferenceFrame("N"), Point("O"), ReferenceFrame("S")
    T = N.orientnew("T", "Axis", (psi, N.z))
    scene = da.Scene("on_a_table", frame=N, origin=O, coordinates=[psi])
    e = da.free_orientation(scene, S, T, names=["a", "b", "c", "d"])
    assert [q.func.__name__ for q in scene.coordinates] == ["psi", "a", "b", "c", "d"] and len(e) == 4
    scene.add_bodies(
        RigidBody("table", O, T, m, (inertia(T, A, A, A), O)), RigidBody("body", O, S, m, (inertia(S, A, B, C), O))
    )
    assert da.compile_model(scene, backend="numpy").formulation == "minimal"


def test_faults_of_a_declaration():
    scene, _, S = free_body()
    with pytest.raises(SceneError, match="oriented already, relative to N"):
        da.free_orientation(scene, S)
    with pytest.raises(SceneError, match="four names"):
        da.free_orientation(scene, ReferenceFrame("T"), names=["a", "b"])
    with pytest.raises(SceneError, match="ReferenceFrame"):
        da.free_orientation(scene, "S")


# -- initial values ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sphere():
    return da.compile_model(da.scenes.rolling_sphere(), backend="numpy", orientation="quaternion")


SPHERE = {"m": 1, "r": 0.5, "g": 9.81}


def test_quaternions_and_angles_start_alike(sphere):
    start = {"x": 0, "y": 0, **START}
    first = sphere.simulate((0, 1), start, SPHERE, t_eval=[0, 1])
    values = {name: first[name][0] for name in (*sphere.layout.coordinates, *sphere.layout.rates)}
    assert sphere.simulate((0, 1), values, SPHERE, t_eval=[0, 1])["y"][1] == pytest.approx(first["y"][1], abs=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"theta": None}, "missing for theta"),
        ({"phi_dot": None}, "missing for the rates x_dot, y_dot, phi_dot: the constraints do not fix them"),
        ({"e0_S": 1.0}, "e0_S.*given too"),
        ({"omega_S_x": 1.0}, "given too"),
    ],
)
def test_faults_of_a_start(sphere, change, words):
    start = {"x": 0, "y": 0, **START} | change
    with pytest.raises(InitialStateError, match=words):
        sphere.simulate((0, 1), {key: value for key, value in start.items() if value is not None}, SPHERE)


def test_missing_rates_are_named_with_what_may_be_given_instead(sphere):
    start = {"x": 0, "y": 0, **{name: START[name] for name in ANGLES}}
    with pytest.raises(InitialStateError, match="psi_dot, theta_dot, phi_dot or omega_S_x, omega_S_y, omega_S_z"):
        sphere.simulate((0, 1), start, SPHERE)


def test_guesses_in_angles(sphere):
    """`assemble` and `trim` take what `simulate` takes."""
    start = {"x": 0, "y": 0, **START}
    first = sphere.simulate((0, 1), start, SPHERE, t_eval=[0])
    found = sphere.assemble(start, SPHERE)
    assert set(found) == {*sphere.layout.coordinates, *sphere.layout.rates}
    for name, value in found.items():
        assert value == pytest.approx(first[name][0], abs=1e-12), name
    with pytest.raises(InitialStateError, match=r"omega_S_x, omega_S_y, omega_S_z.*e0_S_dot.*given too"):
        sphere.assemble(found | {"omega_S_x": 1, "omega_S_y": 0, "omega_S_z": 0}, SPHERE)
    with pytest.raises(InitialStateError, match=r"with psi, theta, phi, all of|missing for phi"):
        sphere.assemble({name: value for name, value in start.items() if name != "phi"}, SPHERE)


def test_steady_spin_from_an_angular_velocity():
    scene, e, _ = free_body()
    model = da.compile_model(scene, backend="numpy")
    guess = {e[0]: 1, e[1]: 0, e[2]: 0, e[3]: 0}
    point = model.trim(guess | {"omega_S_x": 0, "omega_S_y": 0, "omega_S_z": 0}, BODY)
    assert point.converged and point.initial["e3_S_dot"] == 0
    with pytest.raises(InitialStateError, match="missing for omega_S_x"):
        model.trim(guess | {"omega_S_y": 0, "omega_S_z": 0}, BODY)


def rolling_ball():
    x, y = dynamicsymbols("x y")
    N, O, S = ReferenceFrame("N"), Point("O"), ReferenceFrame("S")
    scene = da.Scene("rolling_ball", frame=N, origin=O, coordinates=[x, y])
    e = da.free_orientation(scene, S)
    G = O.locatenew("G", x * N.x + y * N.y + r * N.z)
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, A, A, A), G)))
    slip = G.pos_from(O).dt(N) + S.ang_vel_in(N).cross(-r * N.z)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
    return scene, {x: 0, y: 0, e[0]: 0.6, e[1]: 0, e[2]: 0, e[3]: 0.8}


@pytest.mark.parametrize("formulation", ["minimal", "projected", "baumgarte"])
@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_angular_velocity_that_constraints_give_may_be_left_out(formulation, backend):
    scene, at = rolling_ball()
    model = da.compile_model(scene, backend=backend, formulation=formulation, outputs=["omega_S_x", "omega_S_y"])
    p = {m: 1, r: 0.5, A: 0.1}
    moving = {"omega_S_x": 0.2, "omega_S_y": -0.6, "omega_S_z": 2.0}
    whole = model.simulate((0, 1), at | moving, p, t_eval=[0, 1])
    rates = {name: whole[name][0] for name in ("x_dot", "y_dot")}
    assert min(map(abs, rates.values())) > 0.05
    for left in (["omega_S_x"], ["omega_S_y"], ["omega_S_x", "omega_S_y"]):
        start = at | {name: value for name, value in moving.items() if name not in left} | rates
        for run in (model.simulate((0, 1), start, p, t_eval=[0, 1]), model.sweep((0, 1), start, p, t_eval=[0, 1])):
            for name in ("x", "y", "e1_S", "omega_S_x", "omega_S_y"):
                np.testing.assert_allclose(np.ravel(run[name]), whole[name], atol=1e-9)
    with pytest.raises(InitialStateError, match="omega_S_z: the constraints do not fix them"):
        model.simulate((0, 1), at | {"omega_S_x": 0.2, "omega_S_y": -0.6}, p)
    with pytest.raises(InitialStateError, match="y_dot: the constraints do not fix them at this configuration"):
        upright = {key: {0.6: 1, 0.8: 0}.get(value, value) for key, value in at.items()}
        model.simulate((0, 1), upright | {"x_dot": -0.3, "omega_S_y": -0.6, "omega_S_z": 2.0}, p)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_events_watch_and_set_angular_velocities(backend):
    """A free body about an axis of its own: its spin is tripled, then reversed, with closed forms for the angle."""
    scene, e, _ = free_body()
    model = da.compile_model(scene, backend=backend, outputs=["omega_S_z"])
    start = {e[0]: 1, e[1]: 0, e[2]: 0, e[3]: 0, "omega_S_x": 0, "omega_S_y": 0, "omega_S_z": 0.5}
    w = symbols("omega_S_z")
    faster = da.Event(e[3] - math.sin(0.2), apply={"omega_S_z": 3 * w}, name="faster", direction=1)
    back = da.Event(e[3] - math.sin(0.5), apply={w: -w}, name="back", direction=1)
    run = model.simulate((0, 2), start, BODY, events=[faster, back], t_eval=[2.0], rtol=1e-11)
    at = 0.8, 0.8 + 0.6 / 1.5  # the half-angle reaches 0.2, then 0.5
    assert run.events["faster"].t == pytest.approx([at[0]], abs=1e-9)
    assert run.events["back"].t == pytest.approx([at[1]], abs=1e-9)
    angle = 1.0 - 1.5 * (2.0 - at[1])
    assert run["e3_S"][-1] == pytest.approx(math.sin(angle / 2), abs=1e-9)
    assert run["omega_S_z"][-1] == pytest.approx(-1.5)
    with pytest.raises(ExpressionError, match=r"omega_S_z, which determine e0_S_dot.*twice"):
        model.simulate((0, 1), start, BODY, events=[da.Event(e[3] - 0.1, apply={w: 1, e[0].diff(): 0})])


@pytest.mark.parametrize("change", [{"psi": psi + 1}, {"phi_dot": 2.0}])
def test_events_set_angles_as_in_the_scene_in_angles(change):
    """With a quaternion, an event that sets an angle or its rate leads to the motion that the angles have."""
    scene = da.Scene("top", frame=(N := ReferenceFrame("N")), origin=(O := Point("O")), coordinates=[psi, theta, phi])
    S = ReferenceFrame("S")
    S.orient(N, "Body", (psi, theta, phi), "ZXZ")
    scene.add_bodies(RigidBody("top", O, S, m, (inertia(S, A, B, C), O)))
    event = da.Event(theta - Rational(3, 5), apply=change, direction=-1)
    ends = []
    for orientation in (None, "quaternion"):
        options = {} if orientation is None else {"orientation": orientation}
        model = da.compile_model(scene, backend="numpy", outputs={"c": sin(theta) * sin(phi) * cos(psi)}, **options)
        run = model.simulate((0, 1), START, BODY, events=[event], t_eval=[1.0], rtol=1e-10, atol=1e-12)
        assert len(run.events[event.expression].t)
        ends.append(run["c"][-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)


def test_linearised_motion_has_no_direction_that_changes_the_length():
    """A body that spins about an axis of its own: the frequencies of its wobble, in one component less."""
    scene, e, _ = free_body()
    found = da.compile_model(scene, backend="numpy").linearize(
        0.0, {e[0]: 1, e[1]: 0, e[2]: 0, e[3]: 0, "omega_S_x": 0, "omega_S_y": 0, "omega_S_z": 2.0}, BODY
    )
    assert len(found.states) == 6 and len(set(found.states) & {q.func.__name__ for q in e}) == 3
    wobble = 2.0 * math.sqrt((2.1 - 1.0) * (2.1 - 1.4) / (1.0 * 1.4))
    speeds = found.block("omega_S_x", "omega_S_y", "omega_S_z")
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(speeds).imag), [-wobble, 0, wobble], atol=1e-12)


def test_sweeps_start_from_angles(sphere):
    tilts = np.array([0.0, 0.3, 1.2])
    sweep = sphere.sweep((0, 1), {"x": 0, "y": 0, **START, "theta": tilts}, SPHERE)
    for i, tilt in enumerate(tilts):
        run = sphere.simulate((0, 1), {"x": 0, "y": 0, **START, "theta": tilt}, SPHERE)
        assert sweep["x"][i] == pytest.approx(run["x"][-1], abs=1e-8)


def test_sensitivity_to_an_angle(sphere):
    start = {"x": 0, "y": 0, **START}
    slopes = sphere.sensitivity((0, 1), start, SPHERE, wrt=["theta", "psi_dot"], of=["x", "theta"], rtol=1e-10)
    step = 1e-6
    for name in ("theta", "psi_dot"):
        ends = [
            sphere.simulate((0, 1), start | {name: start[name] + s}, SPHERE, rtol=1e-11, atol=1e-12)
            for s in (step, -step)
        ]
        for output in ("x", "theta"):
            by_hand = (ends[0][output][-1] - ends[1][output][-1]) / (2 * step)
            assert slopes.jacobian(output, name)[-1] == pytest.approx(by_hand, abs=2e-7)


def test_model_is_pickled_and_watches_angles(sphere):
    again = pickle.loads(pickle.dumps(sphere))
    run = again.simulate((0, 2), {"x": 0, "y": 0, **START}, SPHERE, events=[theta - Rational(3, 5)])
    assert run.success and len(run.events[theta - Rational(3, 5)].t) >= 1


# -- friction and contacts --------------------------------------------------------------------


def sliding_ball(*, gap=None, declared=False):
    """Return a ball that slides on a table until it rolls, or bounces on it."""
    x, y, z = dynamicsymbols("x y z")
    mu = symbols("mu", positive=True)
    N, O, S = ReferenceFrame("N"), Point("O"), ReferenceFrame("S")
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[x, y, z] + ([] if declared else [psi, theta, phi]))
    if declared:
        da.free_orientation(scene, S)
    else:
        S.orient(N, "Body", (psi, theta, phi), "ZXZ")
    G = O.locatenew("G", x * N.x + y * N.y + z * N.z)
    J = Rational(2, 5) * m * r**2
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, J, J, J), G)))
    scene.apply_uniform_gravity(-g * N.z)
    normal, F_x, F_y = da.unknowns("N F_x F_y")
    at = G.locatenew("I", -r * N.z)
    scene.add_joints(da.Joint("table", body="ball", at=at, force=F_x * N.x + F_y * N.y + normal * N.z))
    if gap is None:
        scene.add_holonomic_constraints(z - r)
    else:
        scene.add_contacts(da.UnilateralContact(normal=normal, gap=gap(z), name="table"))
    slip = G.pos_from(O).dt(N) + S.ang_vel_in(N).cross(-r * N.z)
    along = slip.dot(N.x), slip.dot(N.y)
    scene.add_friction(da.CoulombFriction(normal, (F_x, F_y), slip=along, mu=mu, name="table"))
    return scene


BALL = {"m": 1.2, "r": 0.3, "g": 9.81, "mu": 0.2}
PLACE = {"x": 0.0, "y": 0.0, "z": 0.3, "x_dot": 1.0, "y_dot": 0.2, "z_dot": 0.0}


def test_a_ball_slides_and_rolls_as_in_its_angles():
    angles = {"psi": 0.3, "theta": 0.7, "phi": -0.2, "psi_dot": 2.0, "theta_dot": -1.5, "phi_dot": 0.7}
    runs = [
        model.simulate((0, 0.3), {**PLACE, **angles}, BALL, rtol=1e-11, atol=1e-12, t_eval=[0.1, 0.3])
        for model in models(sliding_ball())
    ]
    for run in runs:
        assert [phase.modes["table"] for phase in run.phases] == ["slip", "stick"]
    for name in (*PLACE, *angles):
        np.testing.assert_allclose(runs[1][name], runs[0][name], atol=1e-9, err_msg=name)


def test_a_ball_bounces_through_theta_0():
    """From theta = 0, where its angles have no rates: what is said of the slip velocity is regular there too."""
    model = da.compile_model(sliding_ball(gap=lambda z: z - r), backend="numpy", orientation="quaternion")
    spin = {"psi": 0.3, "theta": 0.0, "phi": 0.2, "omega_S_x": 1.0, "omega_S_y": 2.0, "omega_S_z": -0.5}
    run = model.simulate((0, 0.3), {**PLACE, "z": 0.4, **spin}, BALL, rtol=1e-9)
    assert run.success and run["theta"][0] == 0.0 and run["theta"][-1] > 0.3
    assert run.phases[0].modes["table"] == "open" and len(run.phases) > 1
    known = sliding_ball(gap=lambda z: z - r, declared=True)
    half = 0.25  # psi + phi, about N.z
    turned = {"e0_S": math.cos(half), "e1_S": 0.0, "e2_S": 0.0, "e3_S": math.sin(half)}
    start = {**PLACE, "z": 0.4, **turned, **{name: x for name, x in spin.items() if name.startswith("omega")}}
    same = da.compile_model(known, backend="numpy").simulate((0, 0.3), start, BALL, rtol=1e-9)
    for name in ("x", "y", "z"):
        assert run[name][-1] == pytest.approx(same[name][-1], abs=1e-12)
    columns = {**start, "x_dot": np.array([1.0, 0.5])}
    sweep = da.compile_model(known, backend="numpy").sweep((0, 0.3), columns, BALL, rtol=1e-9)
    assert sweep["x"][0] == pytest.approx(same["x"][-1], abs=1e-9)


def test_gap_that_depends_on_the_angles_otherwise():
    with pytest.raises(
        SceneError, match=r"gap of contact 'table': .* depends on the angles psi, theta, phi other than"
    ):
        da.compile_model(sliding_ball(gap=lambda z: z - r * sin(theta)), backend="numpy", orientation="quaternion")


# -- what cannot be done ----------------------------------------------------------------------


def test_scene_without_such_a_body():
    with pytest.raises(OptionError, match=r"'sleigh': 1 coordinates turn it \(theta\), not three"):
        da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", orientation="quaternion")


def test_unknown_orientation():
    with pytest.raises(OptionError, match="unknown orientation 'euler'"):
        da.compile_model(da.scenes.rolling_sphere(), orientation="euler")


def test_body_between():
    N, O = ReferenceFrame("N"), Point("O")
    P = N.orientnew("P", "Axis", (psi, N.z))
    Q = P.orientnew("Q", "Axis", (theta, P.x))
    S = Q.orientnew("S", "Axis", (phi, Q.z))
    scene = da.Scene("gimbals", frame=N, origin=O, coordinates=[psi, theta, phi])
    scene.add_bodies(
        RigidBody("ring", O, Q, m, (inertia(Q, A, A, A), O)), RigidBody("wheel", O, S, m, (inertia(S, A, B, C), O))
    )
    with pytest.raises(OptionError, match="also turn 'ring', which lies between"):
        da.compile_model(scene, backend="numpy", orientation="quaternion")


@pytest.mark.parametrize(
    "options",
    [
        {"loads": lambda N, S, G: [(S, -k * psi * N.z)]},
        {"loads": lambda N, S, G: [(S, -k * theta.diff() * N.z)]},
        {"potential": k * theta**2},
        {"constraints": lambda N, S: [psi.diff()]},
    ],
    ids=["angle", "rate", "potential", "constraint"],
)
def test_angles_that_do_more_than_orient(options):
    scene = turning(chain, **options)
    with pytest.raises(SceneError, match="depends on the angles psi, theta, phi other than"):
        da.compile_model(scene, backend="numpy", orientation="quaternion")


def test_frames_that_are_not_in_the_scene_do_not_matter():
    """Frames on N, and on one between N and the body, turned by the angles of the body."""
    frames = {}

    def orient(N):
        P = N.orientnew("P", "Axis", (psi, N.z))
        Q = P.orientnew("Q", "Axis", (theta, P.x))
        frames["left"] = P.orientnew("left over", "Axis", (phi, P.x))
        old = N.orientnew("old", "Axis", (psi, N.z))
        old.orientnew("older", "Axis", (phi, old.x))
        return Q.orientnew("S", "Axis", (phi, Q.z))

    models = [da.compile_model(turning(axes), backend="numpy", orientation="quaternion") for axes in (orient, chain)]
    ends = [model.simulate((0, 1), START, BODY, rtol=1e-10)["e2_S"][-1] for model in models]
    assert ends[0] == ends[1]
    used = turning(orient, loads=lambda N, S, G: [(S, frames["left"].x)])
    with pytest.raises(OptionError, match="'left over' is turned by some"):
        da.compile_model(used, backend="numpy", orientation="quaternion")
    at = turning(orient, at=lambda N, S: l * frames["left"].x + l * S.x)
    with pytest.raises(OptionError, match="'left over' is turned by some"):
        da.compile_model(at, backend="numpy", orientation="quaternion")
