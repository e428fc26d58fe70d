"""Reactions that rigid bodies leave undetermined, shared by compliances, against elastic supports by hand."""

import functools

import numpy as np
import pytest
from scipy.optimize import nnls
from sympy import sin, symbols
from sympy.physics.mechanics import PinJoint, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError, SceneError, ValueInputError
from system.singular_scenes import platform
from system.test_joints_between_bodies import VALUES, four_bar, mechanism, point
from system.test_singular import CARRIED, LEANING, bar_acceleration

m, a, b, h, g, F, J = symbols("m a b h g F J", positive=True)
c = symbols("c_1:5", positive=True)
x, y, theta = dynamicsymbols("x y theta")
N, O = ReferenceFrame("N"), Point("O")
FORMULATIONS = ["minimal", "projected", "baumgarte", "ggl", "augmented"]
SIZES = {m: 20.0, a: 0.6, b: 0.4, h: 0.7, g: 9.81, F: 30.0, J: 1.0}
LEGS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])


def shared(rows, demand, compliances):
    """Reactions of springs under a rigid body: its small displacements balance it, the springs follow from them."""
    stiff = 1 / np.asarray(compliances, float)
    return stiff * (rows.T @ np.linalg.solve(rows * stiff @ rows.T, demand))


# -- hinges -----------------------------------------------------------------------------------------


def hung(*compliances):
    """A door that swings on two hinges, each with a force in space."""
    leaf_frame = N.orientnew("leaf", "Axis", (theta, N.z))
    G = O.locatenew("G", b * leaf_frame.x)
    scene = da.Scene("door", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(RigidBody("leaf", G, leaf_frame, m, (inertia(leaf_frame, J, J, J), G)))
    for name, height in (("1", h), ("2", -h)):
        X, Y, Z = da.unknowns(f"X_{name} Y_{name} Z_{name}")
        at = O.locatenew(f"hinge_{name}", height * N.z)
        scene.add_joints(da.Joint(f"hinge {name}", body="leaf", at=at, force=X * N.x + Y * N.y + Z * N.z))
    scene.apply_uniform_gravity(-g * N.z)
    for given in compliances:
        scene.add_compliances(given)
    return scene


def pinned(compliances):
    """The same door on a pin, whose reaction has all components, and a lower bearing."""
    ground, leaf = RigidBody("ground", masscenter=O, frame=N), RigidBody("leaf", mass=m)
    leaf.central_inertia = inertia(leaf.frame, J, J, J)
    scene = da.Scene("pinned", frame=N, origin=O)
    scene.add_joints(
        PinJoint("upper", ground, leaf, theta, None, h * N.z, -b * leaf.x + h * leaf.z, joint_axis=N.z),
        da.Joint("lower", body="leaf", at=O.locatenew("P", -h * N.z), force=da.unknowns("Z") * N.z),
    )
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_compliances(compliances)
    return scene


SWING = {"theta": 0.0, "theta_dot": 2.0}
DOOR = {key: SIZES[key] for key in (m, b, h, g, J)}
WEIGHT = SIZES[m] * SIZES[g]


@pytest.mark.parametrize("backend", ["llvm", "numba", "jax", "numpy"])
def test_two_hinges_share_the_weight_as_their_stiffnesses(backend):
    """Radial forces are determined, and the same as without compliances."""
    outputs = ["Z_1", "Z_2", "X_1"]
    model = da.compile_model(hung({"Z_1": c[0], "Z_2": c[1]}), backend=backend, outputs=outputs)
    run = model.simulate((0, 0.5), SWING, {**DOOR, c[0]: 1e-6, c[1]: 3e-6})
    assert run.success and "determined" not in run.message
    np.testing.assert_allclose(run["Z_1"], 0.75 * WEIGHT, rtol=1e-13)
    np.testing.assert_allclose(run["Z_2"], 0.25 * WEIGHT, rtol=1e-13)
    alone = da.compile_model(hung(), backend="numpy", outputs=["X_1"])
    np.testing.assert_allclose(run["X_1"], alone.simulate((0, 0.5), SWING, DOOR, t_eval=run.t)["X_1"], rtol=1e-6)
    cases = model.sweep((0, 0.5), SWING, {**DOOR, c[0]: 1e-6, c[1]: np.array([1e-6, 3e-6, 1e-3])}, t_eval=[0.5])
    np.testing.assert_allclose(cases["Z_2"][:, -1], WEIGHT / (1 + np.array([1, 3, 1e3])), rtol=1e-12)


def test_explain_names_those_that_share():
    text = da.compile_model(hung({"Z_1": 1, "Z_2": 2}), backend="numpy", outputs=["Z_2"]).explain()
    assert "Z_2, Z_1 by moving 'leaf' in the program of reactions alone; Z_1, Z_2 share loads by their comp" in text


def test_joints_of_sympy_have_compliances_by_the_names_of_their_components():
    model = da.compile_model(pinned({"upper.force_z": c[0], "Z": 4 * c[0]}), outputs=["upper.force_z", "Z"])
    run = model.simulate((0, 0.1), SWING, {**DOOR, c[0]: 2e-9})
    assert run["upper.force_z"] == pytest.approx(0.8 * WEIGHT) and run["Z"] == pytest.approx(0.2 * WEIGHT)


@pytest.mark.parametrize("unit", [1e-12, 1e9])
def test_only_ratios_of_compliances_matter(unit):
    model = da.compile_model(hung({"Z_1": unit, "Z_2": 3 * unit}), backend="numpy", outputs=["Z_1"])
    assert model.simulate((0, 0.1), SWING, DOOR)["Z_1"] == pytest.approx(0.75 * WEIGHT, rel=1e-13)


# -- a table on four legs, a beam on three supports ---------------------------------------------------


def table():
    """A rigid table on four legs, which a force pushes along a frictionless floor."""
    T = O.locatenew("T", x * N.x)
    G = T.locatenew("G", a / 5 * N.x + b / 7 * N.y + h * N.z)
    scene = da.Scene("table", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(RigidBody("table", G, N, m, (inertia(N, J, J, J), G)))
    forces, (S, Q) = da.unknowns("N_1:5"), da.unknowns("S Q")
    for number, (force, (u, v)) in enumerate(zip(forces, LEGS.tolist(), strict=True)):
        at = T.locatenew(f"L_{number}", u * a * N.x + v * b * N.y)
        scene.add_joints(da.Joint(f"leg {number}", body="table", at=at, force=force * N.z))
    scene.add_joints(da.Joint("guide", body="table", at=T, force=S * N.y, torque=Q * N.z))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((T, F * N.x))
    scene.add_compliances(dict(zip(forces, c, strict=True)))
    return scene, [str(force) for force in forces]


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_four_legs_of_a_rigid_table(formulation):
    """With equal springs the load of a leg is 1/4 of the weight, more or less by the moments over 4 a and 4 b."""
    scene, outputs = table()
    model = da.compile_model(scene, formulation=formulation, outputs=outputs)
    p, lengths = SIZES, np.array([SIZES[a], SIZES[b]])
    moments = WEIGHT * lengths / [5, 7] - np.array([p[F] * p[h], 0.0])
    rows = np.vstack([np.ones(4), LEGS.T * lengths[:, np.newaxis]])
    for compliances in ((1, 1, 1, 1), (1e-6, 2e-6, 3e-6, 4e-6)):
        values = {**SIZES, **dict(zip(c, compliances, strict=True))}
        run = model.simulate((0, 0.1), {"x": 0, "x_dot": 0}, values)
        found = np.array([run[name][-1] for name in outputs])
        np.testing.assert_allclose(found, shared(rows, np.append(WEIGHT, moments), compliances), rtol=1e-12)
        if compliances[0] == 1:
            np.testing.assert_allclose(found, WEIGHT / 4 + LEGS @ (moments / lengths) / 4, rtol=1e-12)


def beam(*compliances):
    """A rigid beam on three supports: three constraints of rank two."""
    frame = N.orientnew("frame", "Axis", (theta, N.z))
    G = O.locatenew("G", x * N.x + y * N.y)
    scene = da.Scene("beam", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("beam", G, frame, m, (inertia(frame, 0, 0, J), G)))
    for number, place in enumerate((-1, 0, 2)):
        at = G.locatenew(f"P_{number}", place * a * frame.x)
        scene.add_joints(da.Joint(f"support {number}", body="beam", at=at, force=da.unknowns(f"R_{number}") * N.y))
        scene.add_holonomic_constraints(at.pos_from(O).dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_compliances({f"R_{number}": value for number, value in enumerate(compliances)})
    return scene


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS[1:]])
def test_three_supports_of_a_rigid_beam(formulation):
    model = da.compile_model(beam(1, 2, 5), formulation=formulation, outputs=["R_0", "R_1", "R_2"])
    start = {"x": 0, "y": 0, "theta": 0, "x_dot": 1}
    run = model.simulate((0, 0.1), start, {key: SIZES[key] for key in (m, a, g, J)})
    assert run.success and "determined" not in run.message
    rows = np.vstack([np.ones(3), [-1, 0, 2]])
    wanted = shared(rows, np.array([WEIGHT, 0.0]), (1, 2, 5))
    np.testing.assert_allclose([run[name][-1] for name in model.layout.outputs], wanted, rtol=1e-9)


# -- closed loops -----------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", ["projected", "baumgarte", "ggl", "augmented"])
def test_bars_of_a_loop_share_by_compliances(formulation):
    """Forces of least energy have none of the self-stress `loose`; the balances are those of `test_singular`."""
    names, compliances = ["X1", "Y1", "X2", "Y2"], np.array([1.0, 2.0, 3.0, 4.0])
    scene = platform(joints=True)
    scene.add_compliances(dict(zip(names, compliances, strict=True)))
    model = da.compile_model(scene, formulation=formulation, outputs=names)
    assert "share loads by their compliances" in model.explain()
    run = model.simulate((0, 0.5), LEANING, CARRIED, rtol=1e-9, atol=1e-10)
    assert run.success and "are not determined" not in run.message
    given = np.array([run[name][-1] for name in names])
    _, up, angle, _ = bar_acceleration(0.5)
    loose = np.array([-2 * np.sin(angle), -2 * np.cos(angle), np.sin(angle), np.cos(angle)])
    assert abs(compliances * given @ loose) < 1e-7 * np.linalg.norm(given)
    assert given[1] + 2 * given[3] == pytest.approx(CARRIED["M"] * (up + CARRIED["g"]), rel=1e-7)


def twice():
    """The pin that closes a four-bar, and a second one in x beside it."""
    scene = four_bar()
    end = point(scene, "D").locatenew("E", symbols("l3", positive=True) * scene.bodies[2].frame.x)
    force = da.unknowns("S_x") * scene.frame.x
    scene.add_joints(da.Joint("twice", body="rocker", other="coupler", at=end, force=force))
    return scene


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_two_pins_at_one_place_of_a_loop(backend):
    """Their forces are as their stiffnesses; the one without a rival is as it was."""
    scene = twice()
    scene.add_compliances({"R_x": 2e-6, "S_x": 5e-6})
    model = da.compile_model(scene, backend=backend, outputs=["R_x", "R_y", "S_x"])
    _, forces, start, p = mechanism("four_bar")
    run = model.simulate((0, 0.1), start, p)
    assert "are not determined" not in run.message
    wanted = forces(run.q[-1], run.qdot[-1], VALUES)
    found = [run[name][-1] for name in ("R_x", "R_y", "S_x")]
    np.testing.assert_allclose(found, [wanted[0] * 5 / 7, wanted[1], wanted[0] * 2 / 7], rtol=1e-9)


# -- what is wrong ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"Z_3": 1}, "compliance of 'Z_3': unknown reaction component 'Z_3'. Did you mean .* Known: .*Z_1"),
        ({"Z_1": 0}, "compliance of 'Z_1' is 0, which is not known to be positive and finite: give"),
        ({"Z_1": -2.0}, "is -2.0, which is not known to be positive"),
        ({"Z_1": float("inf")}, "is inf, which is not known to be positive"),
        ({"Z_1": symbols("k")}, "is k, which is not known to be positive"),
        ({"Z_1": "soft"}, "is soft, which is not known to be positive"),
        ({"Z_1": 2 + theta**2}, "changes along the motion; write it in numbers and parameters"),
    ],
)
def test_faults_of_compliances(given, text):
    with pytest.raises(SceneError, match=text):
        da.compile_model(hung(given), backend="numpy")


def test_compliances_are_given_once_in_a_mapping():
    with pytest.raises(SceneError, match="'Z_1' is given twice; a reaction component has one"):
        da.compile_model(hung({"Z_1": 1}, {"Z_1": 2}), backend="numpy")
    with pytest.raises(SceneError, match=r"add_compliances takes a mapping of reaction components .*, not \[1, 2\]"):
        hung([1, 2])


def test_a_component_that_a_joint_leaves_free():
    with pytest.raises(SceneError, match=r"'upper\.torque_z': the joint 'upper' leaves that direction free"):
        da.compile_model(pinned({"upper.torque_z": 1}), backend="numpy")


def test_every_reaction_that_shares_needs_a_compliance():
    text = "only a combination of Z_1 with Z_2 .* follows from compliances of Z_2, such as"
    with pytest.raises(ConstraintError, match=text):
        da.compile_model(hung({"Z_1": 1}), backend="numpy", outputs=["Z_1"])
    with pytest.raises(ConstraintError, match=r"R_x share loads where .*, with S_x, which have no compliance: give"):
        scene = twice()
        scene.add_compliances({"R_x": 1})
        da.compile_model(scene, backend="numpy", outputs=["R_x"])


def test_every_reaction_that_shares_in_a_loop_needs_a_compliance():
    scene = platform(joints=True)
    scene.add_compliances({"X1": 1.0, "Y2": 2.0})
    with pytest.raises(ConstraintError, match="with Y1, X2, which have no compliance: give them one"):
        da.compile_model(scene, formulation="projected", outputs=["X1"])


def test_a_compliance_of_zero_is_an_error_of_the_run():
    model = da.compile_model(hung({"Z_1": c[0], "Z_2": c[1]}), outputs=["Z_1"])
    for value in (0.0, -1.0):
        with pytest.raises(ValueInputError, match="c_1"):
            model.simulate((0, 0.1), SWING, {**DOOR, c[0]: value, c[1]: 1.0})


def test_friction_shares_loads_by_laws_of_its_own():
    scene = hung({"Z_1": 1, "Z_2": 1})
    plane, leaf = (O.locatenew("floor", -10 * N.z), N.z), scene.bodies[0]
    about = {"body": "leaf", "point": leaf.masscenter, "plane": plane, "tangents": (leaf.frame.y,)}
    scene.add_contacts(da.PointPlane("edge", restitution=0, friction=0.3, **about))
    with pytest.raises(SceneError, match="compliances are given in a scene with friction"):
        da.compile_model(scene, backend="numpy", outputs=["Z_1"])


# -- contacts ---------------------------------------------------------------------------------------


@functools.cache
def standing(swing=0):
    """The table on four contacts without friction, free to rise and tilt; the push varies by ``swing`` [N]."""
    z, roll, pitch = dynamicsymbols("z roll pitch")
    T = O.locatenew("T", x * N.x + z * N.z)
    A = N.orientnew("A", "Axis", (roll, N.x))
    B = A.orientnew("B", "Axis", (pitch, A.y))
    G = T.locatenew("G", a / 5 * B.x + b / 7 * B.y + h * B.z)
    scene = da.Scene("standing", frame=N, origin=O, coordinates=[x, z, roll, pitch])
    scene.add_bodies(RigidBody("table", G, B, m, (inertia(B, J, J, J), G)))
    for number, (u, v) in enumerate(LEGS.tolist()):
        foot = T.locatenew(f"foot_{number}", u * a * B.x + v * b * B.y)
        scene.add_contacts(da.PointPlane(f"leg{number}", body="table", point=foot, plane=(O, N.z), restitution=0))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((T, (F + swing * sin(6 * dynamicsymbols._t)) * N.x))
    scene.add_compliances({f"leg{number}.normal": compliance for number, compliance in enumerate(c)})
    return da.compile_model(scene, outputs=[f"leg{number}.normal" for number in range(4)])


@pytest.mark.parametrize(
    ("start", "compliances", "push"),
    [
        ({}, (1, 1, 1, 1), 30.0),
        ({}, (1e-6, 2e-6, 3e-6, 4e-6), 30.0),
        ({"z": 0.05, "roll": 0.02, "pitch": -0.03}, (1, 2, 3, 4), 30.0),
        ({}, (1, 20, 3, 0.04), 60.0),
    ],
)
def test_a_table_that_stands_on_four_contacts_or_falls_onto_them(start, compliances, push):
    """Springs that push alone have the least energy without pull, here by non-negative least squares."""
    still = dict.fromkeys(("x", "z", "roll", "pitch"), 0.0)
    values = {**SIZES, F: push, **dict(zip(c, compliances, strict=True))}
    rates = {f"{name}_dot": 0.0 for name in still}
    run = standing().simulate((0, 0.6 if start else 0.1), {**still, **start, **rates}, values)
    assert run.success
    lengths = np.array([SIZES[a], SIZES[b]])
    rows = np.vstack([np.ones(4), LEGS.T * lengths[:, np.newaxis]])
    demand = np.append(WEIGHT, WEIGHT * lengths / [5, 7] - np.array([push * SIZES[h], 0.0]))
    wanted = shared(rows, demand, compliances)
    if min(wanted) < 0.0:
        wanted = nnls(np.vstack([1e6 * rows, np.diag(np.sqrt(compliances))]), np.append(1e6 * demand, np.zeros(4)))[0]
    found = [run[f"leg{number}.normal"][-1] for number in range(4)]
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-8)


@functools.cache
def three_legs(swing):
    """A beam on three contacts in a plane, whose push at the height h varies by ``swing`` [N]."""
    z, pitch = dynamicsymbols("z pitch")
    T = O.locatenew("T", z * N.z)
    B = N.orientnew("B", "Axis", (pitch, N.y))
    G = T.locatenew("G", a / 5 * B.x)
    scene = da.Scene("beam", frame=N, origin=O, coordinates=[z, pitch])
    scene.add_bodies(RigidBody("beam", G, B, m, (inertia(B, J, J, J), G)))
    for number, u in enumerate((-1, 0, 1)):
        foot = T.locatenew(f"foot_{number}", u * a * B.x)
        scene.add_contacts(da.PointPlane(f"leg{number}", body="beam", point=foot, plane=(O, N.z), restitution=0))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((T.locatenew("top", h * B.z), (F + swing * sin(6 * dynamicsymbols._t)) * N.x))
    scene.add_compliances({f"leg{number}.normal": compliance for number, compliance in enumerate(c[:3])})
    return da.compile_model(scene, outputs=[f"leg{number}.normal" for number in range(3)])


@pytest.mark.parametrize("legs", [3, 4])
@pytest.mark.parametrize("scale", [1.0, 1e-7])
def test_a_leg_that_has_borne_nothing_bears_as_soon_as_it_has_to(legs, scale):
    """The unloaded leg stands where the others hold the body: its gap is zero all the time."""
    model, names = (standing(40), "x z roll pitch") if legs == 4 else (three_legs(40), "z pitch")
    (compliances, push), times = {3: ((3, 1, 1), 70.0), 4: ((1, 20, 3, 0.04), 40.0)}[legs], np.linspace(0.0, 2.0, 81)
    values = {**SIZES, F: push, **{c[i]: scale * compliance for i, compliance in enumerate(compliances)}}
    values = {key: value for key, value in values.items() if legs == 4 or key != b}
    still = {name: 0.0 for each in names.split() for name in (each, f"{each}_dot")}
    run = model.simulate((0, 2), still, values, t_eval=times)
    assert run.success
    lengths, found = np.array([SIZES[a], SIZES[b]]), np.array([run[f"leg{number}.normal"] for number in range(legs)])
    rows = np.vstack([np.ones(4), LEGS.T * lengths[:, np.newaxis]]) if legs == 4 else np.array([[1.0] * 3, [-1, 0, 1]])
    rows[1] *= 1.0 if legs == 4 else SIZES[a]
    changes = 0
    for t, pressed in zip(times, found.T, strict=True):
        turning = (push + 40.0 * np.sin(6.0 * t)) * SIZES[h] * (1 if legs == 3 else -1)
        demand = np.array([WEIGHT, WEIGHT * SIZES[a] / 5 + turning, WEIGHT * SIZES[b] / 7][: len(rows)])
        pull = np.vstack([1e6 * rows, np.diag(np.sqrt(compliances))])
        wanted = nnls(pull, np.append(1e6 * demand, np.zeros(legs)))[0]
        np.testing.assert_allclose(pressed, wanted, rtol=1e-7, atol=1e-6)
        changes += np.any(wanted < 1e-9)
    assert 10 < changes < 70
    assert 4 <= len(run.phases) <= 12
