"""Constraints that depend on each other, mass matrices that are singular, and reactions."""

import functools
import re

import numpy as np
import pytest
from sympy import Rational, cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError, InitialStateError, SingularMassMatrixError
from dalembert.ir.kernel import count_operations
from dalembert.methods.status import Status
from dalembert.reduction import FORMULATIONS
from scene.builders import cartesian_pendulum

m, g, l, k, A = symbols("m g l k A", positive=True)


def bead(*names):
    coordinates = dynamicsymbols(" ".join(names))
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=coordinates)
    position = sum((q * axis for q, axis in zip(coordinates, (N.x, N.y, N.z), strict=False)), 0 * N.x)
    P = O.locatenew("P", position)
    scene.add_bodies(Particle("bead", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    return scene, N, P, coordinates


# -- dependent and contradictory constraints ----------------------------------------------


FALL = {"m": 1.5, "g": 9.81}


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
@pytest.mark.parametrize("repeat", ["the same", "a multiple", "a combination"])
def test_holonomic_constraints_that_follow_from_others_are_left_out_and_named(formulation, repeat):
    """The bead slides down the line that the first two constraints leave; all three are watched."""
    scene, _, _, (x, y, z) = bead("x", "y", "z")
    first, second = x - y - 1, y + 2 * z
    third = {"the same": first, "a multiple": -3 * second, "a combination": first + second}[repeat]
    scene.add_holonomic_constraints(first, second, third)
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    assert re.search(
        r"left out, because they follow from the other constraints: holonomic constraint \d", model.explain()
    )
    start = {"x": 1.0, "y": 0.0, "z": 0.0, "y_dot": 0.0}
    run = model.simulate((0, 1), start, FALL, rtol=1e-9, atol=1e-9)
    assert run.success and run.constraint_violation.shape[1] == 3
    np.testing.assert_allclose(run["y"], -9.81 * run.t**2 / 2 / 2.25, atol=1e-6)
    assert np.abs(run.constraint_violation).max() < 1e-7


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_nonholonomic_constraints_that_follow_from_others_are_left_out_and_named(formulation):
    scene, _, _, (x, y, z) = bead("x", "y", "z")
    knife = x.diff() - y.diff() * cos(z)
    scene.add_nonholonomic_constraints(knife, z.diff() - 1, 2 * knife * (1 + x**2) - z.diff() + 1)
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    assert "nonholonomic constraint 3" in "".join(model.stages.program.notes)
    run = model.simulate((0, 1), {"x": 0, "y": 0, "z": 0.3, "y_dot": 0.4}, FALL, rtol=1e-8, atol=1e-8)
    assert run.success and np.abs(run.velocity_violation).max() < 1e-6
    np.testing.assert_allclose(run["z"], 0.3 + run.t, atol=1e-7)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_rate_of_a_holonomic_constraint_given_as_a_nonholonomic_one(formulation):
    scene, _, _, (x, y) = bead("x", "y")
    scene.add_holonomic_constraints(y - sin(x))
    scene.add_nonholonomic_constraints(y.diff() - cos(x) * x.diff())
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    assert "nonholonomic constraint 1" in "".join(model.stages.program.notes)
    run = model.simulate((0, 0.5), {"x": 0.5, "y": np.sin(0.5), "x_dot": 0.0}, FALL, rtol=1e-9, atol=1e-9)
    assert np.ptp(run["energy"]) < 1e-6


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_nonholonomic_constraints_that_contradict_each_other_are_named(formulation):
    scene, _, _, (x, y) = bead("x", "y")
    scene.add_nonholonomic_constraints(x.diff() - y.diff(), 2 * x.diff() - 2 * y.diff() - 1)
    with pytest.raises(ConstraintError, match=r"nonholonomic constraint 2.*contradicts"):
        da.compile_model(scene, backend="numpy", formulation=formulation)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_contradictory_constraints_are_named(formulation):
    scene, _, _, (x, y) = bead("x", "y")
    scene.add_holonomic_constraints(x - y, x - y - 1)
    with pytest.raises(ConstraintError, match=r"holonomic constraint [12].*contradicts"):
        da.compile_model(scene, backend="numpy", formulation=formulation)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_more_constraints_than_coordinates(formulation):
    scene, _, _, (x, y) = bead("x", "y")
    scene.add_holonomic_constraints(x - y, x + y - 2, x**2 - y**2 + x - 1)
    with pytest.raises(ConstraintError, match=r"holonomic constraint \d"):
        da.compile_model(scene, backend="numpy", formulation=formulation)


# -- singular inertia ---------------------------------------------------------------------


def spinning_bead():
    """A particle on a frame that turns about the line that the particle is on: the angle moves no inertia."""
    x, spin = dynamicsymbols("x spin")
    N, O = ReferenceFrame("N"), Point("O")
    F = N.orientnew("F", "Axis", (spin, N.x))
    scene = da.Scene("spinning", frame=N, origin=O, coordinates=[x, spin])
    P = O.locatenew("P", x * F.x)
    scene.add_bodies(RigidBody("needle", P, F, m, (inertia(F, 0, A, A), P)))
    return scene, x, spin


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_coordinate_that_moves_no_inertia_is_named(formulation):
    scene, *_ = spinning_bead()
    with pytest.raises(SingularMassMatrixError, match=r"'spinning'.*spin") as caught:
        da.compile_model(scene, backend="numpy", formulation=formulation)
    assert "moves no inertia" in str(caught.value)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_a_constraint_on_it_mends_it(formulation):
    scene, x, spin = spinning_bead()
    scene.add_nonholonomic_constraints(spin.diff() - k * x.diff())
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    found = model.accelerations(0.0, [0.1, 0.2], [2.0, 1.0], {"m": 1.0, "A": 1.0, "k": 0.5})
    np.testing.assert_allclose(found, [0.0, 0.0], atol=1e-14)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_coordinate_that_nothing_uses_is_named(formulation):
    scene, *_ = bead("x", "y")
    scene.coordinates += (dynamicsymbols("idle"),)
    with pytest.raises(SingularMassMatrixError, match="idle"):
        da.compile_model(scene, backend="numpy", formulation=formulation)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_two_coordinates_of_one_motion_are_singular(formulation):
    a, b = dynamicsymbols("a b")
    N, O = ReferenceFrame("N"), Point("O")
    F = N.orientnew("F", "Axis", (a + b, N.z))
    scene = da.Scene("doubled", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(RigidBody("wheel", O, F, m, (inertia(F, A, A, A), O)))
    with pytest.raises(SingularMassMatrixError, match=r"'doubled'.*'(a|b)"):
        da.compile_model(scene, backend="numpy", formulation=formulation)


@pytest.mark.parametrize("w", [(1, 1, 1), (Rational(1, 10), Rational(3, 10), Rational(7, 10)), (0.1, 0.3, 0.7)])
def test_singular_diagonal_less_a_dyad_is_named(w):
    """M = |w|^2 - w w^T: the particle stays where it is along w."""
    a, b, c = q = dynamicsymbols("a b c")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("across", frame=N, origin=O, coordinates=q)
    place = (w[1] * a - w[0] * b) * N.x + (w[2] * b - w[1] * c) * N.y + (w[0] * c - w[2] * a) * N.z
    scene.add_bodies(Particle("p", O.locatenew("P", place), 1.3))
    with pytest.raises(SingularMassMatrixError):
        da.compile_model(scene, backend="numpy")


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_redundant_coordinates_with_a_constraint_are_ordinary(formulation):
    a, b = dynamicsymbols("a b")
    N, O = ReferenceFrame("N"), Point("O")
    F = N.orientnew("F", "Axis", (a + b, N.z))
    scene = da.Scene("geared", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(RigidBody("wheel", O, F, m, (inertia(F, A, A, A), O)))
    scene.add_holonomic_constraints(a - 3 * b)
    scene.add_loads((F, k * N.z))
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    found = model.accelerations(0.0, [0.3, 0.1], [0.6, 0.2], {"A": 2.0, "k": 1.0, "m": 1.0})
    np.testing.assert_allclose(found, [0.375, 0.125], rtol=1e-13)


# -- reactions ----------------------------------------------------------------------------

READY = {"chaplygin_sleigh": ["X", "Y"], "rolling_sphere": ["F_u", "F_v"]}


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("scene", READY)
def test_reactions_cost_nothing_unless_asked_for(scene, formulation):
    """Kernels with and without outputs are equal but for the kernel of outputs."""
    plain = da.compile_model(da.scenes.ALL[scene](), backend="numpy", formulation=formulation).stages.program
    asked = da.compile_model(
        da.scenes.ALL[scene](), backend="numpy", formulation=formulation, outputs=READY[scene]
    ).stages.program
    assert "outputs" not in plain
    assert len(asked.kernel("outputs").outputs) == 2
    for kernel in plain:
        if kernel.name != "prepare":
            assert count_operations(kernel) == count_operations(asked.kernel(kernel.name)), kernel.name
    assert {kernel.name for kernel in asked} - {kernel.name for kernel in plain} == {"outputs"}
    unknowns = set(plain.layout.unknowns)
    for kernel in plain:
        assert not unknowns & {load.target for load in kernel.loads}


def test_no_constraint_machinery_without_constraints():
    scene, *_ = bead("x", "y")
    for formulation in FORMULATIONS:
        program = da.compile_model(scene, backend="numpy", formulation=formulation).stages.program
        names = {kernel.name for kernel in program}
        assert not names & {
            "project_position",
            "project_velocity",
            "constraint_jacobian",
            "position_residual",
            "outputs",
        }
        assert count_operations(program.kernel("rhs"))["flops"] <= 1


@pytest.mark.parametrize("formulation", ["projected", "augmented"])
def test_tension_of_a_pendulum(formulation):
    """S = m (l omega^2 + g cos(angle)), the angle from the downward vertical."""
    model = da.compile_model(cartesian_pendulum(), backend="numpy", formulation=formulation, outputs=["S"])
    p = {"m": 2.0, "l": 0.5, "g": 9.81}
    angle, rate = 0.4, 1.3
    initial = {
        "x": p["l"] * np.sin(angle),
        "y": -p["l"] * np.cos(angle),
        "x_dot": p["l"] * rate * np.cos(angle),
        "y_dot": p["l"] * rate * np.sin(angle),
    }
    trajectory = model.simulate((0, 1), initial, p, rtol=1e-10, atol=1e-12)
    assert trajectory["S"][0] == pytest.approx(p["m"] * (p["l"] * rate**2 + p["g"] * np.cos(angle)), rel=1e-12)
    angles = np.arctan2(trajectory["x"], -trajectory["y"])
    rates = (trajectory["x_dot"] * np.cos(angles) + trajectory["y_dot"] * np.sin(angles)) / p["l"]
    expected = p["m"] * (p["l"] * rates**2 + p["g"] * np.cos(angles))
    np.testing.assert_allclose(trajectory["S"], expected, rtol=1e-8)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_reaction_of_the_sleighs_blade(formulation):
    """(X, Y) = m v omega (1 - m b^2/I_C) (-sin theta, cos theta) and N = 0, from the scene's own notes."""
    model = da.compile_model(
        da.scenes.chaplygin_sleigh(), backend="numpy", formulation=formulation, outputs=["X", "Y", "N"]
    )
    p = {"m": 1.3, "b": 0.3, "I_C": 0.5}
    initial = {"x": 0.1, "y": 0.2, "theta": 0.7, "x_dot": 0.9 * np.cos(0.7), "theta_dot": 1.7}
    trajectory = model.simulate((0, 2), initial, p, rtol=1e-9)
    theta, omega = trajectory["theta"], trajectory["theta_dot"]
    v = trajectory["x_dot"] * np.cos(theta) + trajectory["y_dot"] * np.sin(theta)
    size = p["m"] * v * omega * (1 - p["m"] * p["b"] ** 2 / p["I_C"])
    np.testing.assert_allclose(trajectory["X"], -size * np.sin(theta), atol=1e-9)
    np.testing.assert_allclose(trajectory["Y"], size * np.cos(theta), atol=1e-9)
    np.testing.assert_allclose(trajectory["N"], 0.0, atol=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_contact_forces_of_the_rolling_sphere_vanish(formulation):
    model = da.compile_model(
        da.scenes.rolling_sphere(), backend="numpy", formulation=formulation, outputs=["F_u", "F_v"]
    )
    initial = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.0, "phi": 0.2, "psi_dot": 0.7, "theta_dot": 0.2, "phi_dot": 1.1}
    trajectory = model.simulate((0, 1), initial, {"m": 1.3, "r": 0.4, "g": 9.81})
    assert max(np.abs(trajectory["F_u"]).max(), np.abs(trajectory["F_v"]).max()) < 1e-12


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_reaction_without_power_is_the_weight(formulation):
    model = da.compile_model(da.scenes.rolling_sphere(), backend="numpy", formulation=formulation, outputs=["N"])
    initial = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.0, "phi": 0.2, "psi_dot": 0.7, "theta_dot": 0.2, "phi_dot": 1.1}
    trajectory = model.simulate((0, 0.2), initial, {"m": 1.3, "r": 0.4, "g": 9.81})
    np.testing.assert_allclose(trajectory["N"], 1.3 * 9.81, rtol=1e-12)


def test_undetermined_reactions_are_known_to_the_layout_and_explained():
    model = da.compile_model(da.scenes.rolling_sphere(), backend="numpy")
    assert model.layout.undetermined == ("N",)
    assert "N, which the equations do not determine" in model.explain()


def test_two_reactions_of_which_only_the_sum_is_determined():
    scene, N, P, (_, y) = bead("x", "y")
    R, T, S = da.unknowns("R T S")
    scene.add_joints(da.Joint("rail", body="bead", at=P, force=(R + T) * N.y + S * N.x))
    scene.add_holonomic_constraints(y)
    with pytest.raises(ConstraintError, match="R"):
        da.compile_model(scene, backend="numpy", outputs=["R"])
    model = da.compile_model(scene, backend="numpy", outputs=["S"])
    assert model.layout.undetermined == ("R", "T")


def test_component_that_occurs_in_no_reaction_is_zero():
    """As the moment of the sleigh's blade, which the text writes down beside the forces, and ideality makes zero."""
    scene, N, P, (_, y) = bead("x", "y")
    R, S = da.unknowns("R S")
    scene.add_joints(da.Joint("rail", body="bead", at=P, force=R * N.y + S * N.x))
    scene.add_holonomic_constraints(y)
    model = da.compile_model(scene, backend="numpy", outputs=["R", "S"])
    run = model.simulate((0, 1), {"x": 0.0, "y": 0.0, "x_dot": 1.5, "y_dot": 0.0}, FALL)
    np.testing.assert_allclose(run["R"], FALL["m"] * FALL["g"], rtol=1e-12)
    np.testing.assert_array_equal(run["S"], 0.0)
    assert run["x"][-1] == pytest.approx(1.5, rel=1e-12)


def test_joint_that_cannot_exert_the_reaction():
    scene, N, P, (_, y) = bead("x", "y")
    R = da.unknowns("R")
    scene.add_joints(da.Joint("rail", body="bead", at=P, force=R * N.x))
    scene.add_holonomic_constraints(y)
    with pytest.raises(ConstraintError, match=r"joint 'rail' cannot exert the reactions of any constraint"):
        da.compile_model(scene, backend="numpy")


def test_constraint_that_no_joint_exerts_a_reaction_of():
    """A bead on a line, of which a joint holds one coordinate alone: its force is the same whatever holds the other."""
    scene, N, P, (x, y, _) = bead("x", "y", "z")
    R = da.unknowns("R")
    scene.add_joints(da.Joint("rail", body="bead", at=P, force=R * N.y))
    scene.add_holonomic_constraints(x, y)
    run = da.compile_model(scene, backend="numpy", outputs=["R"]).simulate(
        (0, 0.5), {"x": 0, "y": 0, "z": 0, "x_dot": 0, "y_dot": 0, "z_dot": 1.0}, FALL
    )
    np.testing.assert_allclose(run["R"], FALL["m"] * FALL["g"], rtol=1e-12)


def guided_bead(direction):
    """A bead that slides in a top, which a unit quaternion turns; its velocity along N.x is cos t."""
    *e, x = q = dynamicsymbols("e0 e1 e2 e3 x")
    N, O = ReferenceFrame("N"), Point("O")
    F = N.orientnew("F", "Quaternion", e)
    scene = da.Scene("guided_bead", frame=N, origin=O, coordinates=q)
    place = O.locatenew("P", x * F.x + Rational(1, 2) * F.y)
    scene.add_bodies(RigidBody("top", O, F, 1, (inertia(F, 1, 2, Rational(5, 2)), O)), Particle("bead", place, 1))
    scene.add_holonomic_constraints(sum(c**2 for c in e) - 1)
    time = dynamicsymbols._t
    scene.add_nonholonomic_constraints(place.pos_from(O).dot(N.x).diff(time) - cos(time))
    R = da.unknowns("R")
    scene.add_joints(da.Joint("guide", body="bead", at=place, force=R * direction(N)))
    return scene


@pytest.mark.parametrize("formulation", ["auto", "projected", "augmented"])
def test_reaction_on_a_body_turned_by_a_quaternion_without_a_regular_basis(formulation):
    """Off the unit sphere, the velocity has another gradient than the power of R. d(kinetic energy)/dt = R cos t."""
    model = da.compile_model(
        guided_bead(lambda N: N.x), backend="numpy", formulation=formulation, outputs=["R", "kinetic_energy"]
    )
    assert model.formulation == ("projected" if formulation == "auto" else formulation)
    start = {"e0": 0.6, "e1": 0.0, "e2": 0.8, "e3": 0.0, "x": 0.3, "e0_dot": 0.0, "e1_dot": 0.2, "e3_dot": 0.3}
    run = model.simulate((0, 0.5), model.assemble(start, {}), {}, rtol=1e-10, t_eval=np.linspace(0, 0.5, 201))
    power = run["R"] * np.cos(run.t)
    work = np.sum(np.diff(run.t) * (power[1:] + power[:-1]) / 2)
    assert abs(work) > 0.1
    assert run["kinetic_energy"][-1] - run["kinetic_energy"][0] == pytest.approx(work, rel=1e-4)


def test_joint_that_cannot_exert_the_reaction_on_a_body_turned_by_a_quaternion():
    scene = guided_bead(lambda N: N.x + N.y / 1000)
    with pytest.raises(ConstraintError, match=r"joint 'guide' cannot exert the reactions of any constraint"):
        da.compile_model(scene, backend="numpy")


def test_expressions_of_states_and_reactions_are_outputs():
    scene = cartesian_pendulum()
    S = da.unknowns("S")
    x, y = scene.coordinates
    power = S * x.diff() + m * y**2
    model = da.compile_model(scene, backend="numpy", outputs=["x", power, "S"])
    p = {"m": 2.0, "l": 0.5, "g": 9.81}
    trajectory = model.simulate((0, 0.3), {"x": 0.3, "y": -0.4, "x_dot": 0.4, "y_dot": 0.3}, p)
    expected = trajectory["S"] * trajectory["x_dot"] + 2.0 * trajectory["y"] ** 2
    np.testing.assert_allclose(trajectory[power], expected, rtol=1e-12)


def test_reaction_at_a_point_that_travels_over_the_body_takes_the_bodys_velocity():
    """A ladder's foot on the floor, held by a joint at the contact: the normal force carries the weight."""
    x, a = dynamicsymbols("x a")
    y = dynamicsymbols("y")
    N, O = ReferenceFrame("N"), Point("O")
    F = N.orientnew("F", "Axis", (a, N.z))
    scene = da.Scene("ladder", frame=N, origin=O, coordinates=[x, y, a])
    G = O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ladder", G, F, m, (inertia(F, 0, 0, A), G)))
    foot = G.locatenew("foot", -l * F.x)
    R = da.unknowns("R")
    scene.add_joints(da.Joint("floor", body="ladder", at=foot, force=R * N.y))
    scene.add_holonomic_constraints(y - l * sin(a))
    scene.apply_uniform_gravity(-g * N.y)
    model = da.compile_model(scene, backend="numpy", outputs=["R"])
    p = {"m": 1.5, "A": 0.2, "l": 0.8, "g": 9.81}
    trajectory = model.simulate((0, 0), {"x": 0, "a": 0.6, "x_dot": 0, "a_dot": 0}, p)
    # m y'' = R - m g, A a'' = -R l cos a, y'' = l cos a a''
    arm = p["l"] * np.cos(0.6)
    expected = p["m"] * p["g"] / (1 + p["m"] * arm**2 / p["A"])
    assert trajectory["R"][0] == pytest.approx(expected, rel=1e-12)


# -- constraints that depend on each other at some parameters -------------------------------


@functools.cache
def two_blades(formulation):
    """A body on two blades, d apart, that cannot turn unless they are one; a torque of its own turns it then."""
    x, y, theta = dynamicsymbols("x y theta")
    d, J = symbols("d J", real=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    scene = da.Scene("two_blades", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("body", C, S, symbols("m", real=True), (inertia(S, 0, 0, J), C)))
    scene.add_loads((S, N.z))
    across = -x.diff() * sin(theta) + y.diff() * cos(theta)
    scene.add_nonholonomic_constraints(across, across + d * theta.diff())
    return da.compile_model(scene, backend="numpy", formulation=formulation)


BLADES = {"x": 0, "y": 0, "theta": 0, "x_dot": 0, "y_dot": 0, "theta_dot": 0}


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_constraint_that_follows_from_others_at_some_parameters_is_left_out_there(formulation):
    model = two_blades(formulation)
    one = model.simulate((0, 1), BLADES, {"m": 1, "J": 1, "d": 0})
    assert one["theta"][-1] == pytest.approx(0.5, rel=1e-6) and "nonholonomic constraint 2" in one.stats.note
    apart = model.simulate((0, 1), BLADES, {"m": 1, "J": 1, "d": 0.5})
    assert abs(apart["theta"][-1]) < 1e-9 and "not enforced" not in apart.stats.note
    sweep = model.sweep((0, 1), BLADES, {"m": 1, "J": [1, 2], "d": 0.0})
    assert list(sweep.status) == [Status.SUCCESS, Status.SUCCESS]
    np.testing.assert_allclose(sweep["theta"], [0.5, 0.25], 1e-6)
    sweep = model.sweep((0, 1), BLADES, {"m": 1, "J": 1, "d": [0.5, 0.0]})
    if model.formulation == "minimal":
        assert list(sweep.status) == [Status.SUCCESS, Status.INITIAL_STATE]
    else:
        assert list(sweep.status) == [Status.SUCCESS, Status.SINGULAR_CONFIGURATION]
        assert "1 of 2 cases" in sweep.stats.note


def test_minimal_refuses_parameters_at_which_it_divides_by_zero():
    """At a = 0 the constraint does not follow from others: it fixes the other rate."""
    scene, _, _, (x, y) = bead("x", "y")
    a, b = symbols("a b")
    scene.add_nonholonomic_constraints(a * x.diff() - b * y.diff())
    model = da.compile_model(scene, backend="numpy", formulation="minimal")
    start = {"x": 0, "y": 0, "x_dot": 1, "y_dot": 0}
    with pytest.raises(InitialStateError) as caught:
        model.simulate((0, 1), start, FALL | {"a": 0, "b": 1})
    for text in ("a = 0", "nonholonomic constraint 1", 'formulation="projected"'):
        assert text in str(caught.value)
    sweep = model.sweep((0, 1), start, FALL | {"a": [1e-20, 1e-21], "b": 1})
    assert list(sweep.status) == [Status.INITIAL_STATE, Status.INITIAL_STATE]


@pytest.mark.parametrize("formulation", ["auto", "projected", "augmented"])
@pytest.mark.parametrize("kind", ["circle", "line", "rate"])
def test_constraints_that_parameters_make_agree_or_contradict_are_decided_at_the_start(kind, formulation):
    x, y = dynamicsymbols("x y")
    a, b = symbols("a b")
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("P", x * frame.x + y * frame.y)
    scene = da.Scene(kind, frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("P", place, 1))
    scene.add_loads((place, -10 * frame.y))
    if kind == "circle":
        scene.add_holonomic_constraints(x**2 + y**2 - a**2, 2 * x**2 + 2 * y**2 - b)
    elif kind == "line":
        scene.add_holonomic_constraints(x - a, 2 * x - b)
    else:
        scene.add_nonholonomic_constraints(x.diff() - a, 2 * x.diff() - b)
    model = da.compile_model(scene, formulation=formulation)
    start = {x: 1, y: 0, x.diff(): 1 if kind == "rate" else 0, y.diff(): 0}
    run = model.simulate((0, 0.5), start, {a: 1, b: 2})
    assert run.success
    if kind != "circle":
        assert run["y"][-1] == pytest.approx(-1.25)
    with pytest.raises(da.errors.InitialStateError, match="constraint 2"):
        model.simulate((0, 0.5), start, {a: 1, b: 2.5})
    sweep = model.sweep((0, 0.5), start, {"a": 1.0, "b": np.array([2.0, 2.5])})
    assert [Status(s) for s in sweep.status] == [Status.SUCCESS, Status.INITIAL_STATE]
