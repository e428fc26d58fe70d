"""Inverse dynamics: round trips, closed forms, closed loops, rolling, redundant inputs, control, and refusals."""

import numpy as np
import pytest
from scipy.linalg import null_space
from sympy import Rational, cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import CapabilityError, UnknownNameError, ValueInputError

m, l, g = symbols("m l g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P = {"m": 2.0, "l": 0.7, "g": 9.81}


def arm(*, actuated=True, damping=True):
    """Two rods in a plane with torques at both joints, relative angles."""
    a, b, u, v = dynamicsymbols("a b u v")
    A, B = N.orientnew("A", "Axis", (a, N.z)), ReferenceFrame("B")
    B.orient_axis(A, A.z, b)
    G = O.locatenew("G", l / 2 * A.x)
    elbow = O.locatenew("elbow", l * A.x)
    H = elbow.locatenew("H", l / 2 * B.x)
    J = m * l**2 / 12
    scene = da.Scene("arm", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(
        RigidBody("upper", G, A, m, (inertia(A, 0, 0, J), G)), RigidBody("lower", H, B, m, (inertia(B, 0, 0, J), H))
    )
    scene.apply_uniform_gravity(-g * N.y)
    if damping:
        scene.add_loads((A, -0.3 * a.diff() * N.z))
    if actuated:
        scene.add_inputs(u, v)
        scene.add_loads((A, u * N.z), (B, v * N.z), (A, -v * N.z))
    return scene


def textbook_torques(q, qd, qdd):
    """Lagrange's equations of the same arm, as they stand in textbooks."""
    (a, b), (da_, db), (dda, ddb) = q, qd, qdd
    M, L, G = P["m"], P["l"], P["g"]
    J = M * L**2 / 12
    h = M * L**2 / 2 * np.sin(b)
    m11 = 2 * J + M * L**2 * (1.5 + np.cos(b))
    m12 = J + M * L**2 * (0.25 + np.cos(b) / 2)
    m22 = J + M * L**2 / 4
    first = m11 * dda + m12 * ddb - h * (2 * da_ * db + db**2)
    second = m12 * dda + m22 * ddb + h * da_**2
    first += M * G * L * (1.5 * np.cos(a) + 0.5 * np.cos(a + b)) + 0.3 * da_
    return np.array([first, second + M * G * L / 2 * np.cos(a + b)])


@pytest.mark.parametrize("backend", BACKENDS)
def test_torques_of_an_arm_on_every_backend(backend):
    """Against the equations of textbooks, at several states at once, and back through `accelerations`."""
    model = da.compile_model(arm(), backend=backend, cache=False)
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.uniform(-2, 2, (3, 4, 2))
    found = model.inverse_dynamics(0.0, q, qd, qdd, P)
    assert found == pytest.approx(np.array(list(map(textbook_torques, q, qd, qdd))), rel=1e-12)
    one = model.inverse_dynamics(0.0, q[0], qd[0], qdd[0], P)
    assert one.shape == (2,) and one == pytest.approx(found[0], rel=1e-14)
    inputs = dict(zip(model.layout.inputs, one, strict=True))
    assert model.accelerations(0.0, q[0], qd[0], P, inputs=inputs) == pytest.approx(qdd[0], rel=1e-12)


def test_generalised_forces_where_there_are_no_inputs():
    """The same torques, with angles of their own each; and where all inputs are given, what they lack."""
    bare = da.compile_model(arm(actuated=False), backend="numpy", cache=False)
    q, qd, qdd = np.array([[0.3, -1.0], [0.5, 0.7], [2.0, -1.0]])
    found = bare.inverse_dynamics(0, q, qd, qdd, P)
    assert found == pytest.approx(textbook_torques(q, qd, qdd), rel=1e-12)
    driven = da.compile_model(arm(), backend="numpy", cache=False)
    rest = driven.inverse_dynamics(0, q, qd, qdd, P, inputs={"u": 1.0, "v": -2.0})
    assert rest == pytest.approx(found - [1.0, -2.0], rel=1e-12)


def test_an_input_that_is_given_counts_as_it_is():
    """A wanted motion that the other torque can give."""
    model = da.compile_model(arm(), backend="numpy", cache=False)
    q, qd = [0.4, 0.9], [1.0, -0.5]
    qdd = model.accelerations(0, q, qd, P, inputs={"u": 1.5, "v": 0.25})
    assert model.inverse_dynamics(0, q, qd, qdd, P, inputs={"u": 1.5}) == pytest.approx([0.25], rel=1e-12)
    with pytest.raises(ValueInputError, match=r"at t = 0 the inputs v cannot produce .* along a \(-1\) are lacking"):
        model.inverse_dynamics(0, q, qd, qdd, P, inputs={"u": 2.5})
    with pytest.raises(UnknownNameError, match="w"):
        model.inverse_dynamics(0, q, qd, qdd, P, inputs={"w": 2.5})


def slider(*, both=False):
    """A slider-crank in angles of crank and rod and the slider's place; torque on the crank, force on the slider."""
    a, b, x, u, f = dynamicsymbols("a b x u f")
    A, B = N.orientnew("A", "Axis", (a, N.z)), N.orientnew("B", "Axis", (-b, N.z))
    pin = O.locatenew("pin", l * A.x)
    G = pin.locatenew("G", l * B.x)
    S = O.locatenew("S", x * N.x)
    scene = da.Scene("slider_crank", frame=N, origin=O, coordinates=[a, b, x])
    scene.add_bodies(
        RigidBody("crank", O, A, m, (inertia(A, 0, 0, m * l**2), O)),
        RigidBody("rod", G, B, m, (inertia(B, 0, 0, m * l**2 / 3), G)),
        Particle("slider", S, 3 * m),
    )
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(l * cos(a) + 2 * l * cos(b) - x, l * sin(a) - 2 * l * sin(b))
    scene.add_inputs(u, *([f] if both else []))
    scene.add_loads((A, u * N.z), *([(S, f * N.x)] if both else []))
    return scene


def on_loop(a, rate):
    """Return positions and rates of the slider-crank, and x' by a'."""
    b = np.arcsin(np.sin(a) / 2)
    b_dot = np.cos(a) * rate / (2 * np.cos(b))
    x = P["l"] * (np.cos(a) + 2 * np.cos(b))
    x_dot = -P["l"] * (np.sin(a) * rate + 2 * np.sin(b) * b_dot)
    return [a, b, x], [rate, b_dot, x_dot]


@pytest.mark.parametrize("formulation", ["projected", "ggl"])
def test_a_closed_loop(formulation):
    """One torque moves a loop of three coordinates; constraint forces take the rest."""
    model = da.compile_model(slider(), backend="numpy", formulation=formulation, cache=False)
    q, qd = on_loop(0.8, 3.0)
    qdd = model.accelerations(0, q, qd, P, inputs={"u": 11.0})
    assert model.inverse_dynamics(0, q, qd, qdd, P) == pytest.approx([11.0], rel=1e-11)
    with pytest.raises(ValueInputError, match=r"the accelerations contradict .*cos\(a\)"):
        model.inverse_dynamics(0, q, qd, qdd + np.array([0, 0, 0.01]), P)


def test_redundant_inputs_are_those_of_least_norm():
    """Torque and force do the same on the loop: their vector is along that of their powers."""
    one, two = (da.compile_model(slider(both=both), backend="numpy", cache=False) for both in (False, True))
    q, qd = on_loop(0.8, 3.0)
    qdd = one.accelerations(0, q, qd, P, inputs={"u": 11.0})
    ratio = np.array([1.0, qd[2] / qd[0]])
    found = two.inverse_dynamics(0, q, qd, qdd, P)
    assert found == pytest.approx(11.0 * ratio / (ratio @ ratio), rel=1e-11)
    again = two.accelerations(0, q, qd, P, inputs=dict(zip("uf", found, strict=True)))
    assert again == pytest.approx(qdd, rel=1e-11)


def test_generalised_forces_on_a_loop_are_of_least_norm():
    """Without inputs they have no part that the constraints would take."""
    scene = slider()
    scene.inputs, scene.loads = (), ()
    model = da.compile_model(scene, backend="numpy", cache=False)
    q, qd = on_loop(0.8, 3.0)
    free = null_space(model.constraint_jacobian(0, q, P))
    qdd = model.accelerations(0, q, qd, P) + 5 * free[:, 0]
    tau = model.inverse_dynamics(0, q, qd, qdd, P)
    assert model.constraint_jacobian(0, q, P) @ tau == pytest.approx([0, 0], abs=1e-12)
    left = model.mass_matrix(q, P) @ qdd - model.forcing(0, q, qd, P)
    assert free.T @ tau == pytest.approx(free.T @ left, rel=1e-12)


def test_torque_of_a_rolling_sphere():
    """Closed form: a homogeneous sphere rolls with a = tau r / (J + m r^2); a push on it takes m a + J a / r^2."""
    scene, (u, f) = da.scenes.rolling_sphere(), dynamicsymbols("u f")
    (sphere,), plane = scene.bodies, scene.frame
    scene.add_inputs(u)
    scene.add_loads((sphere.frame, u * plane.y))
    model = da.compile_model(scene, backend="numpy", cache=False)
    p = {"m": 3.0, "r": 0.5, "g": 9.81}
    q, qd = [0, 0, 0.3, 1.0, 0.2], [0, 0, 0, 0, 0]
    qdd = model.accelerations(0, q, qd, p, inputs={"u": 0.6})
    assert qdd[0] == pytest.approx(0.6 * 0.5 / (1.4 * 3.0 * 0.25), rel=1e-12) and abs(qdd[1]) < 1e-12
    assert model.inverse_dynamics(0, q, qd, qdd, p) == pytest.approx([0.6], rel=1e-12)
    pushed = da.scenes.rolling_sphere()
    pushed.add_inputs(f)
    pushed.add_loads((pushed.bodies[0].masscenter, f * pushed.frame.x))
    found = da.compile_model(pushed, backend="numpy", cache=False).inverse_dynamics(0, q, qd, qdd, p)
    assert found == pytest.approx([Rational(7, 5) * 3.0 * qdd[0]], rel=1e-12)
    with pytest.raises(ValueInputError, match="the accelerations contradict"):
        model.inverse_dynamics(0, q, qd, qdd + np.array([0.1, 0, 0, 0, 0]), p)


def rubbed():
    """A block on a guide with dry friction of 4 N, pulled by an input, and a stop at x = 1."""
    x, u, T = dynamicsymbols("x"), dynamicsymbols("u"), da.unknowns("T")
    B = O.locatenew("B", x * N.x)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", B, 2))
    scene.add_inputs(u)
    scene.add_loads((B, u * N.x))
    scene.add_joints(da.Joint("guide", body="block", at=B, force=T * N.x))
    scene.add_friction(da.CoulombFriction(normal=4, tangential=T, slip=x.diff(), mu=1, name="guide.friction"))
    scene.add_contacts(da.Stop("end", x, upper=1, body="block", at=B, direction=N.x))
    return scene


def test_dry_friction_opposes_the_slip_and_stops_are_open():
    model = da.compile_model(rubbed(), backend="numpy", cache=False)
    cases = {(0.5, 3.0): 2 * 3 + 4, (-0.5, 3.0): 2 * 3 - 4, (0.0, 3.0): 6 + 4, (0.0, -3.0): -6 - 4, (0.0, 0.0): 0}
    for (speed, second), force in cases.items():
        found = model.inverse_dynamics(0, [0.2], [speed], [second], {})
        assert found == pytest.approx([force], abs=1e-12)
        again = model.accelerations(0, [0.2], [speed], {}, inputs={"u": found[0]})
        assert again == pytest.approx([second], abs=1e-12)
    with pytest.raises(ValueInputError, match=r"gap of 'end\.upper'"):
        model.inverse_dynamics(0, [1.0], [0.0], [0.0], {})


def test_other_contacts_and_uses_of_inputs_are_refused():
    rod = da.compile_model(da.scenes.sliding_rod(), backend="numpy", cache=False)
    zero = np.zeros(len(rod.layout.coordinates))
    with pytest.raises(CapabilityError, match=r"dry friction with a given normal load .* those of the scene are"):
        rod.inverse_dynamics(0, zero, zero, zero, {})
    road, x, u = *dynamicsymbols("road x"), dynamicsymbols("u")
    B = O.locatenew("B", (x + road) * N.y)
    scene = da.Scene("car", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("car", B, 2))
    scene.add_inputs(u, road)
    scene.add_loads((B, (u - 5 * x) * N.y))
    model = da.compile_model(scene, backend="numpy", cache=False)
    with pytest.raises(CapabilityError, match=r"the input 'road' .*give its value, inputs="):
        model.inverse_dynamics(0, [0.1], [0], [1], {})
    lift = da.samples([0, 1, 2, 3], [0, 1, 4, 9], kind="cubic")  # t^2: second rate 2
    assert model.inverse_dynamics(1.5, [0.1], [0], [1], {}, inputs={"road": lift}) == pytest.approx([2 * 3 + 0.5])
    squared = da.Scene("squared", frame=N, origin=O, coordinates=[x])
    squared.add_bodies(Particle("car", O.locatenew("C", x * N.y), 2))
    squared.add_inputs(u)
    squared.add_loads((squared.bodies[0].masscenter, u**2 * N.y))
    with pytest.raises(CapabilityError, match="the input 'u' is no factor of the loads"):
        da.compile_model(squared, backend="numpy", cache=False).inverse_dynamics(0, [0], [0], [1], {})


def test_first_order_states_are_needed_where_loads_have_them():
    """A motor with a lag beside an input: its force is a state."""
    x, u, F = dynamicsymbols("x u F")
    B = O.locatenew("B", x * N.x)
    scene = da.Scene("servo", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", B, 2))
    scene.add_inputs(u)
    scene.add_states({F: -F})
    scene.add_loads((B, (F + u) * N.x))
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert model.inverse_dynamics(0, [0], [0], [1], {}, states={"F": 0.5}) == pytest.approx([1.5])
    with pytest.raises(ValueInputError, match="inverse_dynamics depends on the first-order states"):
        model.inverse_dynamics(0, [0], [0], [1], {})


def test_computed_torque_follows_a_motion():
    """A sampled controller with the model's own inverse dynamics: errors die out as those of linear equations."""
    scene = arm()
    model = da.compile_model(scene, backend="numpy", cache=False)

    def law(t, q, qd, states, p):
        target = np.array([np.sin(t), 0.5 * np.cos(t)])
        speed = np.array([np.cos(t), -0.5 * np.sin(t)])
        wanted = -target + 20 * (speed - qd) + 100 * (target - q)
        return model.inverse_dynamics(t, q, qd, wanted, p), []

    scene.add_controllers(da.Controller("computed torque", period=0.01, inputs=list(scene.inputs), function=law))
    driven = da.compile_model(scene, cache=False)
    start = {"a": 0.3, "b": 0.0, "a_dot": 0.0, "b_dot": 0.0}
    run = driven.simulate((0, 2), start, P, t_eval=[0.0, 1.0, 2.0])
    errors = np.abs(run.q - np.column_stack([np.sin(run.t), 0.5 * np.cos(run.t)]))
    assert run.success and errors[0].max() > 0.3 and errors[1:].max() < 0.01
    held = driven.inverse_dynamics(0, [0.1, 0.2], [0, 0], [1, 2], P)
    assert held == pytest.approx(model.inverse_dynamics(0, [0.1, 0.2], [0, 0], [1, 2], P), rel=1e-12)


def test_values_that_jax_traces_are_refused():
    jax = pytest.importorskip("jax")
    model = da.compile_model(arm(), backend="jax", cache=False)
    with pytest.raises(CapabilityError, match="inverse_dynamics takes numbers"):
        jax.jit(lambda q: model.inverse_dynamics(0.0, q, np.zeros(2), np.zeros(2), P))(np.zeros(2))
