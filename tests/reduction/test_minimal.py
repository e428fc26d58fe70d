"""Independent speeds: which ones are found, what they cost, and that they give the same motion."""

import functools

import numpy as np
import pytest
from sympy import Rational, cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import FormulationError
from dalembert.ir.kernel import count_operations
from dalembert.mechanics.derive import derive
from dalembert.scene.reading import read
from scene.builders import cartesian_pendulum, four_bar, quaternion_body

m, g, l, r, h = symbols("m g l r h", positive=True)
A = symbols("A", positive=True)
t = dynamicsymbols._t


def start(name, coordinates):
    N, O = ReferenceFrame("N"), Point("O")
    return da.Scene(name, frame=N, origin=O, coordinates=coordinates), N, O


def helix():
    """A bead whose height is given by a sine of its angle."""
    z, theta, s = dynamicsymbols("z theta s")
    scene, N, O = start("helix", [z, theta, s])
    F = N.orientnew("F", "Axis", (theta, N.z))
    P = O.locatenew("P", s * F.x + z * N.z)
    scene.add_bodies(Particle("bead", P, m))
    scene.add_holonomic_constraints(z - h * sin(theta))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def lift():
    """A platform that time moves: a rheonomic holonomic constraint, solved for a dear function of time."""
    x, z = dynamicsymbols("x z")
    scene, N, O = start("lift", [x, z])
    P = O.locatenew("P", x * N.x + (z + x**2 / 2) * N.z)
    scene.add_bodies(Particle("bead", P, m))
    scene.add_holonomic_constraints(2 * z - h * sin(3 * t) * t)
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def chained():
    """Holonomic constraints that use each other's coordinates."""
    x, y, z, a = dynamicsymbols("x y z a")
    scene, N, O = start("chained", [x, y, z, a])
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    F = N.orientnew("F", "Axis", (a, N.y))
    scene.add_bodies(RigidBody("part", P, F, m, (inertia(F, A, A, A), P)))
    scene.add_holonomic_constraints(x - y - sin(a), y + z - l * cos(a))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def driven_skate():
    """A blade whose heading time turns: a rheonomic nonholonomic constraint with a drift."""
    x, y = dynamicsymbols("x y")
    scene, N, O = start("driven_skate", [x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("skate", P, m))
    scene.add_nonholonomic_constraints(y.diff() - x.diff() * sin(t) - h * cos(2 * t))
    scene.add_loads((P, -g * x * N.x))
    return scene


def rolling_disc():
    """A disc rolling upright: two constraints that give the velocities of its centre."""
    x, y, psi, phi = dynamicsymbols("x y psi phi")
    scene, N, O = start("disc", [x, y, psi, phi])
    F = N.orientnew("F", "Axis", (psi, N.z))
    D = F.orientnew("D", "Axis", (phi, F.y))
    G = O.locatenew("G", x * N.x + y * N.y + r * N.z)
    scene.add_bodies(RigidBody("disc", G, D, m, (inertia(D, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4), G)))
    rolling = G.pos_from(O).dt(N) + D.ang_vel_in(N).cross(-r * N.z)
    scene.add_nonholonomic_constraints(*(rolling.dot(axis) for axis in (N.x, N.y)))
    scene.add_loads((F, -A * psi * N.z))
    return scene


def sleigh_on_a_rail():
    """A sleigh with one more holonomic constraint: both kinds at once."""
    x, y, theta = dynamicsymbols("x y theta")
    scene, N, O = start("both_kinds", [x, y, theta])
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    G = C.locatenew("G", l * S.x)
    z = dynamicsymbols("z")
    scene.coordinates += (z,)
    H = G.locatenew("H", z * N.z)
    scene.add_bodies(RigidBody("sleigh", H, S, m, (inertia(S, A, A, A), H)))
    scene.add_nonholonomic_constraints(-x.diff() * sin(theta) + y.diff() * cos(theta))
    scene.add_holonomic_constraints(z - h * sin(x) * cos(y))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


SCENES = {
    "sleigh": da.scenes.chaplygin_sleigh,
    "sphere": da.scenes.rolling_sphere,
    "helix": helix,
    "lift": lift,
    "chained": chained,
    "driven skate": driven_skate,
    "disc": rolling_disc,
    "both kinds": sleigh_on_a_rail,
    "quaternion": quaternion_body,
}


@functools.cache
def compiled(name, formulation):
    return da.compile_model(SCENES[name](), backend="numpy", formulation=formulation)


def consistent_state(model, rng, time):
    """Return q, q_dot and parameters on the constraints, from random ones by Newton's method."""
    layout = model.layout
    p = dict(zip(layout.parameters, rng.uniform(0.5, 1.5, len(layout.parameters)), strict=True))
    if "I_C" in p:
        p["I_C"] += p["m"] * p["b"] ** 2
    initial = dict(
        zip((*layout.coordinates, *layout.rates), rng.uniform(-1.2, 1.2, 2 * model_size(model)), strict=True)
    )
    for name in FIXED.get(model.name, ()):
        del initial[name]
    if model.name not in FIXED:
        initial = model.assemble(initial, p)
    trajectory = model.simulate((time, time), initial, p)
    return trajectory.q[0], trajectory.qdot[0], p


def model_size(model):
    return len(model.layout.coordinates)


FIXED = {
    "chaplygin_sleigh": ("y_dot",),
    "rolling_sphere": ("x_dot", "y_dot"),
    "helix": ("z", "z_dot"),
    "lift": ("z", "z_dot"),
    "chained": ("x", "z", "x_dot", "z_dot"),
    "driven_skate": ("y_dot",),
    "disc": ("x_dot", "y_dot"),
    "both_kinds": ("z", "z_dot", "y_dot"),
}


@pytest.mark.parametrize("name", SCENES)
def test_minimal_and_projected_accelerations_agree(name):
    minimal, projected = compiled(name, "minimal"), compiled(name, "projected")
    rng = np.random.default_rng(5)
    for time in (0.0, 0.7, -1.1):
        q, qdot, p = consistent_state(projected, rng, time)
        expected = projected.accelerations(time, q, qdot, p)
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(minimal.accelerations(time, q, qdot, p), expected, atol=1e-10 * scale)


@pytest.mark.parametrize("name", SCENES)
def test_accelerations_keep_the_constraints_and_do_no_work_on_free_directions(name):
    """J q_ddot follows from differentiating the constraint; M q_ddot - forcing is a combination of its rows."""
    model = compiled(name, "minimal")
    rng = np.random.default_rng(6)
    q, qdot, p = consistent_state(model, rng, 0.4)
    qddot = model.accelerations(0.4, q, qdot, p)
    J = model.constraint_jacobian(0.4, q, p)
    residual = model.mass_matrix(q, p, t=0.4) @ qddot - model.forcing(0.4, q, qdot, p)
    multipliers = np.linalg.lstsq(J.T, residual, rcond=None)[0]
    np.testing.assert_allclose(J.T @ multipliers, residual, atol=1e-9 * max(1, np.abs(residual).max()))


@pytest.mark.parametrize("name", SCENES)
def test_auto_takes_minimal_where_it_can(name):
    model = da.compile_model(SCENES[name](), backend="numpy")
    assert model.formulation == "minimal"
    rows, size = len(model.layout.constraints), model_size(model)
    eliminated = 0 if name == "quaternion" else model.layout.holonomic  # its four components are all kept
    assert len(model.layout.state) == 2 * size - rows - eliminated


@pytest.mark.parametrize("name", SCENES)
def test_minimal_simulation_satisfies_the_constraints_by_construction(name):
    model = compiled(name, "minimal")
    q, qdot, p = consistent_state(model, np.random.default_rng(7), 0.0)
    layout = model.layout
    initial = dict(zip((*layout.coordinates, *layout.rates), (*q, *qdot), strict=True))
    trajectory = model.simulate((0, 1), initial, p, rtol=1e-6)
    assert trajectory.success, trajectory.message
    scale = 1 + np.abs(trajectory.qdot).max()
    assert np.abs(trajectory.constraint_violation).max() < 1e-13 * scale
    assert np.abs(trajectory.velocity_violation).max() < 1e-13 * scale
    assert "project_velocity" not in model.stages.program


# -- what is found ------------------------------------------------------------------------


def test_sleigh_uses_the_speed_along_its_blade():
    model = compiled("sleigh", "minimal")
    assert model.layout.state == ("x", "y", "theta", "v_S_x", "theta_dot")
    counts = count_operations(model.stages.program.kernel("rhs"))
    assert counts["flops"] <= 25
    assert (counts["sin"], counts["cos"], counts["tan"], counts["div"]) == (1, 1, 0, 0)


def test_sleigh_is_regular_at_every_heading():
    model = compiled("sleigh", "minimal")
    p = {"m": 1.0, "b": 0.3, "I_C": 0.5}
    for theta in np.pi / 2 * np.arange(-4, 5):
        v, omega = 0.8, 1.5
        qdot = [v * np.cos(theta), v * np.sin(theta), omega]
        found = model.accelerations(0.0, [0.1, -0.2, theta], qdot, p)
        v_dot, omega_dot = p["b"] * omega**2, -p["m"] * p["b"] * v * omega / p["I_C"]
        expected = [
            v_dot * np.cos(theta) - v * omega * np.sin(theta),
            v_dot * np.sin(theta) + v * omega * np.cos(theta),
            omega_dot,
        ]
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


def test_sphere_uses_its_angular_velocity_on_the_referential_and_knows_it_constant():
    assert compiled("sphere", "minimal").layout.state[5:] == ("omega_N_x", "omega_N_y", "omega_N_z")
    assert compiled("sphere", "minimal").stages.program.kernel("rhs").outputs[5:] == (0.0, 0.0, 0.0)


def test_holonomic_constraint_is_solved_in_closed_form():
    model = compiled("helix", "minimal")
    assert model.layout.state == ("theta", "s", "theta_dot", "s_dot")
    assert "z is given by a holonomic constraint" in model.explain()
    trajectory = model.simulate(
        (0, 1), {"theta": 0.3, "s": 1.0, "theta_dot": 2.0, "s_dot": 0.0}, {"m": 1, "h": 0.7, "g": 9.81}
    )
    np.testing.assert_allclose(trajectory["z"], 0.7 * np.sin(trajectory["theta"]), rtol=1e-14)
    np.testing.assert_allclose(
        trajectory["z_dot"], 0.7 * np.cos(trajectory["theta"]) * trajectory["theta_dot"], rtol=1e-13, atol=1e-14
    )


def test_rheonomic_constraint_moves_with_time():
    model = compiled("lift", "minimal")
    trajectory = model.simulate((0, 2), {"x": 0.3, "x_dot": 0.1}, {"m": 1, "h": 0.7, "g": 9.81}, rtol=1e-10)
    time = trajectory.t
    np.testing.assert_allclose(trajectory["z"], 0.35 * np.sin(3 * time) * time, atol=1e-13)
    np.testing.assert_allclose(trajectory["z_dot"], 0.35 * (3 * time * np.cos(3 * time) + np.sin(3 * time)), atol=1e-13)


@pytest.mark.parametrize("name", SCENES)
def test_speeds_lead_back_to_the_rates(name):
    """The kernels `initial` and `expand` are inverse to each other on consistent states."""
    model = compiled(name, "minimal")
    q, qdot, p = consistent_state(model, np.random.default_rng(8), 0.3)
    initial = dict(zip((*model.layout.coordinates, *model.layout.rates), (*q, *qdot), strict=True))
    start_ = model.simulate((0.3, 0.3), initial, p)
    np.testing.assert_allclose(start_.q[0], q, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(start_.qdot[0], qdot, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_scene_that_its_constraints_hold_still_has_no_speeds(backend):
    x = dynamicsymbols("x")
    scene, N, O = start("held", [x])
    scene.add_bodies(Particle("block", O.locatenew("P", x * N.x), m))
    scene.add_holonomic_constraints(x - h * sin(2 * t))
    model = da.compile_model(scene, backend=backend, cache=False)
    assert model.layout.state == ()
    trajectory = model.simulate((0, 1), {}, {"m": 1, "h": 0.5}, t_eval=[0, 0.4, 1])
    assert trajectory.success
    np.testing.assert_allclose(trajectory["x"], 0.5 * np.sin([0, 0.8, 2]), rtol=1e-14)
    assert model.layout.constraints == ("holonomic constraint 1, -h*sin(2*t) + x = 0",)


def test_labels_of_constraints_leave_out_the_time_of_coordinates_alone():
    x = dynamicsymbols("x")
    scene, N, O = start("held", [x])
    scene.add_bodies(Particle("block", O.locatenew("P", x * N.x), m))
    scene.add_holonomic_constraints(x - h * sin(t))
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert model.layout.constraints == ("holonomic constraint 1, -h*sin(t) + x = 0",)


def test_a_unit_quaternion_has_the_angular_velocity_for_speeds():
    model = compiled("quaternion", "minimal")
    assert model.formulation == "minimal" and len(model.layout.state) == 13
    assert [name.split("_")[0] for name in model.layout.state[10:]] == ["omega"] * 3
    assert "stays a unit quaternion" in model.explain()


def test_a_unit_quaternion_is_kept_at_length_one():
    runs = {}
    for formulation in ("minimal", "projected"):
        model = compiled("quaternion", formulation)
        q, qdot, p = consistent_state(model, np.random.default_rng(3), 0.0)
        initial = dict(zip((*model.layout.coordinates, *model.layout.rates), (*q, *qdot), strict=True))
        runs[formulation] = model.simulate((0, 3), initial, p, rtol=1e-8, atol=1e-10, t_eval=[0, 1, 2, 3])
        assert np.max(np.abs(runs[formulation].constraint_violation)) < 1e-13
    np.testing.assert_allclose(runs["minimal"].q, runs["projected"].q, atol=1e-7)


# -- what minimal does not support -----------------------------------------------------------

CANNOT = {"Cartesian pendulum": cartesian_pendulum, "four-bar": four_bar}


@pytest.mark.parametrize("name", CANNOT)
def test_auto_falls_back_to_projected_and_says_why(name):
    model = da.compile_model(CANNOT[name](), backend="numpy")
    assert model.formulation == "projected"
    text = model.explain()
    assert "'minimal' does not support the scene" in text
    assert "holonomic constraint 1" in text and "closed form" in text


@pytest.mark.parametrize("name", CANNOT)
def test_forced_minimal_is_refused_with_the_reason_and_a_way_out(name):
    scene = CANNOT[name]()
    with pytest.raises(FormulationError) as caught:
        da.compile_model(scene, backend="numpy", formulation="minimal")
    text = str(caught.value)
    assert scene.name in text and "holonomic constraint 1" in text and "projected" in text


def test_nonholonomic_constraint_that_needs_a_division_falls_back():
    x, y = dynamicsymbols("x y")
    scene, N, O = start("swirl", [x, y])
    scene.add_bodies(Particle("p", O.locatenew("P", x * N.x + y * N.y), m))
    scene.add_nonholonomic_constraints(y * x.diff() - (x**2 - Rational(1, 2)) * y.diff())
    model = da.compile_model(scene, backend="numpy")
    assert model.formulation == "projected"
    assert "division by a function of the configuration" in model.explain()


def test_a_velocity_is_resolved_on_frames_near_the_root_alone():
    """A floating base with 30 joints took a minute: the axes of every link were tried."""
    x, y, z, *turns = dynamicsymbols("x y z a0:14")
    m, N, O = symbols("m", positive=True), ReferenceFrame("N"), Point("O")
    scene = da.Scene("floating_chain", frame=N, origin=O, coordinates=[x, y, z, *turns])
    frame, point = N, O.locatenew("P", x * N.x + y * N.y + z * N.z)
    for i, turn in enumerate(turns):
        frame = frame.orientnew(f"E{i}", "Axis", (turn, (frame.z, frame.y, frame.x)[i % 3]))
        if i > 2:
            point = point.locatenew(f"P{i}", frame.x)
        if i > 1:
            scene.add_bodies(RigidBody(f"link{i}", point, frame, m, (inertia(frame, 1, 2, 3), point)))
    groups = derive(read(scene, ())).groups
    velocity = next(group for group in groups if not group.angles)
    assert [choice.names[0] for choice in velocity.choices] == [f"v_E{i}_x" for i in range(8)]
