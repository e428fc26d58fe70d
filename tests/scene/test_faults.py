"""Every fault of a scene is reported, by name, and all of them at once."""

import pytest
import sympy as sp
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import DalembertError, SceneError, UnknownNameError
from dalembert.scene.reading import read

m, g, l, I = symbols("m g l I", positive=True)
t = dynamicsymbols._t


class Stage:
    """A sound scene, a planar pendulum on a slider, with its parts at hand so that a test can spoil one."""

    def __init__(self):
        self.x, self.theta = dynamicsymbols("x theta")
        self.N, self.O = ReferenceFrame("N"), Point("O")
        self.B = self.N.orientnew("B", "Axis", (self.theta, self.N.z))
        self.P = self.O.locatenew("P", self.x * self.N.x)
        self.G = self.P.locatenew("G", l * self.B.x)
        self.scene = da.Scene("stage", frame=self.N, origin=self.O, coordinates=[self.x, self.theta])
        self.rod = RigidBody("rod", self.G, self.B, m, (inertia(self.B, 0, 0, I), self.G))
        self.scene.add_bodies(self.rod)


@pytest.fixture
def stage():
    return Stage()


def faults(scene, outputs=()):
    with pytest.raises(SceneError) as caught:
        read(scene, outputs)
    assert scene.name in str(caught.value)
    for fault in caught.value.faults:
        assert fault in str(caught.value)
    return caught.value.faults


def assert_fault(scene, *texts, outputs=()):
    """Assert that the scene has exactly one fault, and that the fault says all of `texts`."""
    found = faults(scene, outputs)
    assert len(found) == 1, found
    for text in texts:
        assert text in found[0]


def test_the_stage_is_sound(stage):
    model = read(stage.scene)
    assert model.symbols.coordinates == ("x", "theta")
    assert model.symbols.parameters == ("I", "l", "m")


# -- frames and points --------------------------------------------------------------------


def test_frame_that_is_not_oriented(stage):
    lone = ReferenceFrame("Lone")
    stage.scene.add_bodies(RigidBody("disc", stage.P, lone, m, (inertia(lone, I, I, I), stage.P)))
    assert_fault(stage.scene, "'disc'", "frame 'Lone' is not oriented in 'N'")


def test_inertia_on_a_frame_that_is_not_oriented(stage):
    lone = ReferenceFrame("Lone")
    stage.scene.add_bodies(RigidBody("disc", stage.P, stage.B, m, (inertia(lone, I, I, I), stage.P)))
    assert_fault(stage.scene, "inertia of body 'disc'", "frame 'Lone' is not oriented in 'N'")


def test_inertia_of_a_body_whose_frame_is_not_oriented(stage):
    lone = ReferenceFrame("Lone")
    stage.scene.add_bodies(RigidBody("disc", stage.P, lone, m, (inertia(stage.N, I, I, I), stage.P)))
    assert_fault(stage.scene, "body 'disc'", "frame 'Lone' is not oriented in 'N'")


def test_point_that_is_not_located(stage):
    stage.scene.add_bodies(Particle("bead", Point("Nowhere"), m))
    assert_fault(stage.scene, "'bead'", "point 'Nowhere' is not located from 'O'")


def test_body_left_with_sympys_own_frame_and_centre(stage):
    stage.scene.add_bodies(RigidBody("default"))
    found = faults(stage.scene)
    assert any("frame 'default_frame' is not oriented" in fault for fault in found)
    assert any("point 'default_masscenter' is not located" in fault for fault in found)


def test_load_on_what_is_not_connected(stage):
    stage.scene.add_loads((Point("Q"), g * stage.N.y), (ReferenceFrame("F"), g * stage.N.z))
    found = faults(stage.scene)
    assert len(found) == 2
    assert "force at 'Q'" in found[0] and "torque on 'F'" in found[1]


def test_vector_on_a_frame_that_is_not_oriented(stage):
    other = ReferenceFrame("Other")
    stage.scene.add_loads((stage.G, g * other.x))
    assert_fault(stage.scene, "force at 'G'", "'Other'")


# -- coordinates and symbols --------------------------------------------------------------


def test_function_of_time_that_is_no_coordinate(stage):
    z = dynamicsymbols("z")
    stage.scene.add_loads((stage.G, m * z * stage.N.y))
    assert_fault(stage.scene, "force at 'G'", "z(t)", "no coordinate", "x(t)", "theta(t)")


def test_rate_of_what_is_no_coordinate(stage):
    z = dynamicsymbols("z")
    stage.scene.add_nonholonomic_constraints(stage.x.diff() - z.diff())
    assert any("Derivative(z(t), t)" in fault and "no coordinate" in fault for fault in faults(stage.scene))


def test_acceleration_in_an_expression(stage):
    stage.scene.add_loads((stage.G, m * stage.x.diff().diff() * stage.N.y))
    assert_fault(stage.scene, "force at 'G'", "Derivative(x(t), (t, 2))", "acceleration")


def test_acceleration_in_a_constraint(stage):
    stage.scene.add_nonholonomic_constraints(stage.x.diff() + stage.theta.diff(t, 2))
    assert any("acceleration" in fault for fault in faults(stage.scene))


@pytest.mark.parametrize("wrong", [sp.Symbol("s"), sp.Function("f")(sp.Symbol("s")), 3, "x", sp.sin(t)])
def test_coordinate_that_is_no_function_of_time(stage, wrong):
    stage.scene.coordinates += (wrong,)
    assert_fault(stage.scene, f"{wrong!r}", "not a function of time", "dynamicsymbols")


def test_rate_given_as_a_coordinate(stage):
    stage.scene.coordinates += (stage.x.diff(),)
    assert_fault(stage.scene, "Derivative(x(t), t)", "not a function of time")


def test_coordinate_with_other_assumptions(stage):
    stage.scene.add_loads((stage.G, dynamicsymbols("x", real=True) * stage.N.y))
    assert_fault(stage.scene, "x(t) is not the coordinate of that name", "other assumptions")


@pytest.mark.parametrize("wrong", [None, 5, "x theta", dynamicsymbols("x")])
def test_coordinates_are_a_sequence(stage, wrong):
    with pytest.raises(SceneError, match=r"coordinates must be a sequence of dynamicsymbols, such as \[x, y\]"):
        da.Scene("wrong", frame=stage.N, origin=stage.O, coordinates=wrong)


def test_constraints_that_are_no_expressions(stage):
    stage.scene.add_holonomic_constraints([stage.x - 1], sp.Eq(stage.x, 1))
    _, first, second = faults(stage.scene)
    assert "not a SymPy expression" in first and "left side minus right side" in second


def test_coordinate_given_twice(stage):
    stage.scene.coordinates += (stage.x,)
    assert_fault(stage.scene, "'x' is given twice")


def test_no_coordinates(stage):
    scene = da.Scene("still", frame=stage.N, origin=stage.O, coordinates=[])
    scene.add_bodies(Particle("post", stage.O, m))
    assert_fault(scene, "no coordinates")


def test_two_symbols_with_one_name(stage):
    stage.scene.add_loads((stage.G, -sp.Symbol("m") * g * stage.N.y))
    assert_fault(stage.scene, "two different symbols", "'m'", "assumptions")


def test_unknown_and_parameter_with_one_name(stage):
    X = da.unknowns("l")
    stage.scene.add_joints(da.Joint("slot", body="rod", at=stage.P, force=X * stage.N.y))
    assert_fault(stage.scene, "'l'", "two different symbols")


@pytest.mark.parametrize(("name", "text"), [("x", "a coordinate"), ("theta_dot", "a rate"), ("t", "time")])
def test_parameter_with_a_name_that_is_taken(stage, name, text):
    stage.scene.add_loads((stage.G, sp.Symbol(name, positive=True) * stage.N.y))
    assert_fault(stage.scene, f"the parameter {name!r}", f"the name of {text}", "rename")


@pytest.mark.parametrize("name", ["energy", "kinetic_energy", "potential_energy"])
def test_names_of_the_energies_are_taken(stage, name):
    stage.scene.add_loads((stage.G, sp.Symbol(name) * stage.N.y))
    assert_fault(stage.scene, name, "output of every model")


def test_coordinate_named_like_a_rate():
    x, rate = dynamicsymbols("x x_dot")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("names", frame=N, origin=O, coordinates=[x, rate])
    scene.add_bodies(Particle("a", O.locatenew("A", x * N.x + rate * N.y), m))
    assert_fault(scene, "'x_dot'", "rate")


# -- joints and loads ---------------------------------------------------------------------


def test_unknown_outside_of_joints(stage):
    X = da.unknowns("X")
    stage.scene.add_loads((stage.G, X * stage.N.y))
    assert_fault(stage.scene, "the unknown X", "force or torque of a joint", "force at 'G'")


def test_unknown_in_a_constraint(stage):
    stage.scene.add_holonomic_constraints(stage.x - da.unknowns("X"))
    assert any("the unknown X" in fault for fault in faults(stage.scene))


def test_unknown_that_enters_nonlinearly(stage):
    X = da.unknowns("X")
    stage.scene.add_joints(da.Joint("slot", body="rod", at=stage.P, force=X**2 * stage.N.x))
    with pytest.raises(SceneError, match=r"'X' enters an action nonlinearly"):
        da.compile_model(stage.scene, backend="numpy")


def test_joint_on_an_unknown_body(stage):
    stage.scene.add_joints(da.Joint("slot", body="rood", at=stage.P, force=da.unknowns("X") * stage.N.y))
    assert_fault(stage.scene, "joint 'slot'", "'rood'", "rod")


def test_joint_at_a_point_that_is_not_located(stage):
    stage.scene.add_joints(da.Joint("slot", body="rod", at=Point("Q"), force=da.unknowns("X") * stage.N.y))
    assert_fault(stage.scene, "joint 'slot'", "'Q'")


def test_not_a_joint(stage):
    stage.scene.add_joints("slot")
    assert_fault(stage.scene, "'slot' is not a Joint")


@pytest.mark.parametrize("load", [3, (1, 2), ("G", 0), (None, None), (1, 2, 3, 4)])
def test_not_a_load(stage, load):
    stage.scene.add_loads(load)
    assert_fault(stage.scene, "load 1", "neither (point, force), (frame, torque) nor (body, point, force)")


def test_force_that_is_no_vector(stage):
    stage.scene.add_loads((stage.G, m * g))
    assert_fault(stage.scene, "force at 'G'", "not a vector")


def test_gravity_that_is_no_vector(stage):
    stage.scene.apply_uniform_gravity(g)
    assert_fault(stage.scene, "gravity", "not a vector; write it on a frame")


def test_a_comparison_in_place_of_a_constraint(stage):
    (q, *_) = stage.scene.coordinates
    stage.scene.add_nonholonomic_constraints(q.diff() == 3)
    assert_fault(stage.scene, "nonholonomic constraint", "a comparison with ==; write an expression")


# -- constraints --------------------------------------------------------------------------


def test_constraint_that_is_not_affine_in_the_rates(stage):
    stage.scene.add_nonholonomic_constraints(stage.x.diff() ** 2 + stage.theta.diff() - 1)
    assert_fault(stage.scene, "nonholonomic constraint 1", "not affine in the rate of x")


def test_constraint_with_a_product_of_rates(stage):
    stage.scene.add_nonholonomic_constraints(stage.x.diff() * stage.theta.diff())
    assert_fault(stage.scene, "not affine")


def test_affine_constraint_in_disguise_is_accepted(stage):
    """(a + v)**2 - (a - v)**2 = 4 a v is affine in v, and identified as such."""
    a, v = sin(stage.theta) + 2, stage.x.diff()
    stage.scene.add_nonholonomic_constraints((a + v) ** 2 - (a - v) ** 2 + stage.theta.diff() - t)
    assert len(read(stage.scene).nonholonomic) == 1


def test_rate_in_a_holonomic_constraint(stage):
    stage.scene.add_holonomic_constraints(stage.x.diff() - 1)
    assert_fault(stage.scene, "holonomic constraint 1", "contains rates", "nonholonomic")


def test_holonomic_constraint_without_coordinates(stage):
    stage.scene.add_holonomic_constraints(l - 1)
    assert_fault(stage.scene, "holonomic constraint 1", "no coordinate")


def test_nonholonomic_constraint_without_rates(stage):
    stage.scene.add_nonholonomic_constraints(stage.x - l)
    assert_fault(stage.scene, "nonholonomic constraint 1", "no rate", "add_holonomic_constraints")


# -- expressions --------------------------------------------------------------------------


@pytest.mark.parametrize("function", [sp.gamma, sp.erf, sp.besselj, sp.LambertW])
def test_function_that_cannot_be_compiled(stage, function):
    value = function(1, stage.x) if function is sp.besselj else function(stage.x)
    stage.scene.add_loads((stage.G, value * stage.N.y))
    assert_fault(stage.scene, "force at 'G'", "cannot be compiled", "sin", "Piecewise")


def test_condition_that_cannot_be_compiled(stage):
    value = sp.Piecewise((g, sp.Xor(stage.x > 1, g > 1)), (0, True))
    stage.scene.add_loads((stage.G, value * stage.N.y))
    assert_fault(stage.scene, "condition", "x(t) > 1")


def test_division_by_zero_in_disguise(stage):
    stage.scene.add_loads((stage.G, g / (sin(stage.x) ** 2 + cos(stage.x) ** 2 - 1) * stage.N.y))
    assert_fault(stage.scene, "divides by zero")


@pytest.mark.parametrize("number", [sp.I, sp.nan, sp.oo, sp.zoo])
def test_number_that_is_not_real_and_finite(stage, number):
    stage.scene.add_loads((stage.G, (g + stage.x * number) * stage.N.y))
    found = faults(stage.scene)
    assert any("force at 'G'" in fault for fault in found)


# -- velocities that were set -------------------------------------------------------------


def test_spin_that_was_set_without_an_angle(stage):
    wheel = stage.B.orientnew("wheel", "Axis", (0, stage.B.z))
    wheel.set_ang_vel(stage.B, m * stage.B.x)
    stage.scene.add_bodies(RigidBody("wheel", stage.G, wheel, m, (inertia(wheel, I, I, I), stage.G)))
    assert_fault(stage.scene, "frame 'wheel' in 'B' was set to m*B.x", "is constant", "KanesMethod")
    wheel.set_ang_vel(stage.B, dynamicsymbols("spin") * stage.B.x)
    assert_fault(stage.scene, "frame 'wheel' in 'B' was set to spin(t)*B.x", "is constant")


def test_velocities_that_contradict_positions(stage):
    stage.G.set_vel(stage.N, 2 * stage.x.diff() * stage.N.x)
    stage.B.set_ang_vel(stage.N, -stage.theta.diff() * stage.N.z)
    turning, moving = faults(stage.scene)
    assert "angular velocity of frame 'B' in 'N' was set to" in turning and "another" in turning
    assert "velocity of point 'G' was set to" in moving and "another" in moving


def test_velocities_that_contradict_inputs(stage):
    turned, tilt = stage.N.orientnew("turned", "Axis", (0, stage.N.z)), dynamicsymbols("tilt")
    turned.orient_axis(stage.N, tilt, stage.N.z)
    stage.scene.add_inputs(tilt)
    stage.scene.add_loads((stage.G, g * turned.x))
    read(stage.scene)
    turned.set_ang_vel(stage.N, 2 * tilt.diff() * stage.N.z)
    assert_fault(stage.scene, "angular velocity of frame 'turned' in 'N' was set to 2*", "gives another one")


def test_origin_that_was_set_to_move(stage):
    stage.O.set_vel(stage.N, g * stage.N.x)
    assert_fault(stage.scene, "velocity of point 'O' was set to g*N.x", "is constant")


def test_velocities_that_agree_or_are_in_other_symbols(stage):
    stage.O.set_vel(stage.N, 0)
    stage.P.set_vel(stage.N, stage.x.diff() * stage.N.x)
    stage.B.set_ang_vel(stage.N, dynamicsymbols("u") * stage.N.z)
    stage.G.v2pt_theory(stage.P, stage.N, stage.B)
    read(stage.scene)
    stage.B.set_ang_vel(stage.N, stage.theta.diff() * stage.B.z)
    stage.G.v2pt_theory(stage.P, stage.N, stage.B)
    read(stage.scene)


@pytest.mark.parametrize(
    "turn", [sp.sqrt(dynamicsymbols("x") ** 4), sp.Max(0, dynamicsymbols("x")) ** 2, sp.cbrt(dynamicsymbols("x") ** 6)]
)
def test_velocities_that_sympy_writes_in_its_own_way(stage, turn):
    """SymPy sets the angular velocity of a frame that is oriented."""
    turned, away = stage.N.orientnew("turned", "Axis", (turn, stage.N.z)), stage.O.locatenew("away", turn * stage.N.x)
    stage.scene.add_bodies(RigidBody("vane", away, turned, m, (inertia(turned, I, I, I), away)))
    away.set_vel(stage.N, turn.diff(t) * stage.N.x)
    read(stage.scene)
    away.set_vel(stage.N, (2 - sp.sign(stage.x)) * turn.diff(t) * stage.N.x + sp.Min(0, stage.x) * stage.N.x)
    assert_fault(stage.scene, "velocity of point 'away' was set to", "gives another one")


def test_mass_and_inertia_that_vary(stage):
    stage.scene.add_bodies(
        Particle("fuel", stage.P, m * sp.exp(-t)),
        RigidBody("plate", stage.G, stage.B, m, (inertia(stage.N, I, 2 * I, 3 * I), stage.G)),
    )
    first, second = faults(stage.scene)
    assert "mass of body 'fuel' changes along the motion" in first and "take the mass 1 and divide" in first
    assert "inertia of body 'plate' changes along the motion on the frame 'B'" in second


# -- bodies -------------------------------------------------------------------------------


def test_no_bodies(stage):
    scene = da.Scene("empty", frame=stage.N, origin=stage.O, coordinates=[stage.x])
    assert_fault(scene, "no bodies", "add_bodies")


def test_not_a_body(stage):
    stage.scene.add_bodies("brick")
    assert any("'brick' is not a RigidBody or Particle" in fault for fault in faults(stage.scene))


@pytest.mark.parametrize(
    "method", ["bodies", "joints", "loads", "holonomic_constraints", "nonholonomic_constraints", "inputs", "contacts"]
)
def test_lists_are_to_be_unpacked(stage, method):
    getattr(stage.scene, f"add_{method}")([stage.x])
    assert f"add_{method} was given a list: unpack it, add_{method}(*items)" in faults(stage.scene)


def test_two_bodies_with_one_name(stage):
    stage.scene.add_bodies(Particle("rod", stage.P, m))
    assert_fault(stage.scene, "two bodies are called 'rod'")


def test_inertia_that_is_not_symmetric(stage):
    B = stage.B
    crooked = inertia(B, I, I, I) + I * (B.x | B.y)
    stage.scene.add_bodies(RigidBody("wing", stage.P, B, m, (crooked, stage.P)))
    assert_fault(stage.scene, "'wing'", "not symmetric")


# -- all at once --------------------------------------------------------------------------


def test_all_faults_are_reported_at_once(stage):
    z = dynamicsymbols("z")
    lone, nowhere = ReferenceFrame("Lone"), Point("Nowhere")
    scene = stage.scene
    scene.add_bodies(
        Particle("bead", nowhere, m), RigidBody("disc", stage.P, lone, m, (inertia(lone, I, I, I), stage.P))
    )
    scene.coordinates += (stage.x, sp.Symbol("s"))
    scene.add_loads((stage.G, z * stage.N.y), 7)
    scene.add_joints(da.Joint("slot", body="nobody", at=stage.P))
    scene.add_nonholonomic_constraints(stage.x.diff() ** 3)
    scene.add_holonomic_constraints(stage.theta.diff())
    scene.apply_uniform_gravity(9.81)
    text = "\n".join(faults(scene))
    for name in ("Nowhere", "Lone", "'x' is given twice", "coordinate s is not a function", "z(t)"):
        assert name in text
    for name in ("load 2", "nobody", "not affine", "contains rates", "gravity"):
        assert name in text
    assert len(faults(scene)) >= 10


def test_fault_of_an_undeclared_symbol_does_not_hide_those_of_constraints(stage):
    stage.scene.add_loads((stage.G, dynamicsymbols("z") * stage.N.y))
    stage.scene.add_nonholonomic_constraints(stage.x - l)
    stage.scene.add_holonomic_constraints(l - 1)
    text = "\n".join(faults(stage.scene))
    assert "no rate" in text
    assert "no coordinate, so" in text


def test_compile_model_raises_the_same_error(stage):
    stage.scene.add_bodies("brick")
    with pytest.raises(SceneError, match="brick") as caught:
        da.compile_model(stage.scene, backend="numpy")
    assert isinstance(caught.value, DalembertError)
    assert isinstance(caught.value, ValueError)


def test_reading_does_not_change_the_scene(stage):
    before = dict(stage.scene.__dict__)
    read(stage.scene)
    da.compile_model(stage.scene, backend="numpy")
    assert stage.scene.__dict__ == before


def test_later_changes_do_not_reach_a_compiled_model(stage):
    model = da.compile_model(stage.scene, backend="numpy")
    stage.scene.add_loads((stage.G, g * stage.N.y))
    assert model.layout.parameters == ("I", "l", "m")
    assert model.stages.scene.loads == ()


@pytest.mark.parametrize("arguments", [{"frame": "N"}, {"origin": None}, {"frame": Point("O"), "origin": "O"}])
def test_scene_refuses_what_is_no_frame_or_point(stage, arguments):
    with pytest.raises(SceneError) as caught:
        da.Scene("s", **{"frame": stage.N, "origin": stage.O, "coordinates": [stage.x], **arguments})
    assert len(caught.value.faults) == len(arguments)


def test_source_that_is_no_scene():
    with pytest.raises(SceneError, match="takes a Scene"):
        da.compile_model("sleigh")


def test_output_that_the_scene_does_not_have(stage):
    with pytest.raises(UnknownNameError, match=r"thetta.*Did you mean 'theta'"):
        da.compile_model(stage.scene, backend="numpy", outputs=["thetta"])


def test_output_expression_with_an_undeclared_symbol(stage):
    assert_fault(stage.scene, "z(t)", "output", outputs=[dynamicsymbols("z") + 1])


def test_output_of_an_undeclared_parameter_is_one_more_parameter(stage):
    """A plain symbol is a parameter wherever it stands; it must then be given a value."""
    k = sp.Symbol("k", positive=True)
    model = da.compile_model(stage.scene, backend="numpy", outputs=[k * stage.x**2 / 2])
    assert model.layout.parameters == ("I", "k", "l", "m")
