"""Every fault of a friction law or a contact is reported, by name, with what to do."""

import math
import re

import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import (
    CapabilityError,
    ConstraintError,
    InitialStateError,
    OptionError,
    SceneError,
    UnknownNameError,
    ValueInputError,
)
from dalembert.methods.status import Status
from dalembert.scene.reading import read
from hard_cases.contacts import corner_plate, loose_plate

x, theta = dynamicsymbols("x theta")
N_A, N_Q, F_Q, F_P = da.unknowns("N_A N_Q F_Q F_P")
mu = sp.Symbol("mu", positive=True)
P = {"m": 1, "l": 1, "h": 0.8, "g": 9.81}
START = {"x": -0.8 / math.tan(0.7), "theta": 0.7, "theta_dot": 0.0}


def law(normal=N_Q, tangential=F_Q, **changes):
    return da.CoulombFriction(normal, tangential, **({"mu": mu, "name": "corner"} | changes))


GAP = -x - sp.Symbol("h", positive=True) * sp.cot(theta)


def contact(normal=N_Q, gap=GAP, **changes):
    return da.UnilateralContact(normal, gap, **({"name": "corner"} | changes))


@pytest.mark.parametrize(
    "added, texts",
    [
        (law(mu=-0.2), ["mu of friction 'corner' is -0.2", "must not be negative"]),
        (law(mu=None), ["'corner'", "mu is missing", "give the coefficient"]),
        (law(mu_static=-1), ["mu_static of friction 'corner' is -1", "must not be negative"]),
        (law(mu=0.4, mu_static=0.3), ["mu_static is 0.3", "mu = 0.4", "at least as large"]),
        (law(mu=dynamicsymbols("w")), ["mu of friction 'corner'", "w(t)", "coordinates of the scene"]),
        (law(normal=None), ["normal reaction", "is missing", "da.unknowns"]),
        (law(normal=da.unknowns("N_P")), ["N_P", "no unknown of a joint", "N_A, F_Q, N_Q", "da.unknowns"]),
        (law(tangential=F_P), ["tangential reaction", "F_P", "no unknown of a joint", "da.unknowns"]),
        (law(tangential=N_Q), ["normal and tangential reactions must be different"]),
        (law(tangential=(F_Q, N_A), slip=x.diff()), ["tangential and slip must be", "a pair each"]),
        (law(slip=x), ["slip velocity of friction 'corner'", "not affine in the rates"]),
        (law(slip=x.diff() ** 2), ["slip velocity of friction 'corner'", "not affine in the rates"]),
        (law(regularization=0), ["regularization is zero", "leave it out"]),
        (law(regularization=-1e-3), ["regularization of friction 'corner' is -0.001", "must not be negative"]),
        ("no law", ["'no law' is not a CoulombFriction"]),
    ],
    ids=lambda value: value[0][:30] if isinstance(value, list) else "",
)
def test_faults_of_friction(added, texts):
    scene = da.scenes.corner_plate()
    scene.add_friction(added)
    with pytest.raises(SceneError) as caught:
        read(scene)
    assert any(all(text in fault for text in texts) for fault in caught.value.faults), caught.value.faults


@pytest.mark.parametrize(
    "added, texts",
    [
        (contact(restitution=2), ["restitution of contact 'corner' is 2", "between 0 and 1"]),
        (contact(restitution=-0.1), ["restitution of contact 'corner' is -0.1", "between 0 and 1"]),
        (contact(gap=x.diff()), ["gap of contact 'corner'", "in coordinates", "without rates"]),
        (contact(gap=sp.Symbol("a")), ["gap of contact 'corner'", "in coordinates"]),
        (contact(normal=da.unknowns("N_P")), ["N_P", "no unknown of a joint", "da.unknowns"]),
        ("no contact", ["'no contact' is not a UnilateralContact"]),
    ],
    ids=lambda value: value[0][:30] if isinstance(value, list) else "",
)
def test_faults_of_contacts(added, texts):
    scene = da.scenes.corner_plate()
    scene.add_contacts(added)
    with pytest.raises(SceneError) as caught:
        read(scene)
    assert any(all(text in fault for text in texts) for fault in caught.value.faults), caught.value.faults


def test_all_faults_at_once():
    scene = da.scenes.corner_plate()
    scene.add_friction(law(mu=-0.2, tangential=F_P))
    scene.add_contacts(contact(restitution=3))
    with pytest.raises(SceneError) as caught:
        read(scene)
    text = str(caught.value)
    assert "-0.2" in text and "F_P" in text and "restitution" in text


def test_one_normal_one_law():
    scene = da.scenes.corner_plate()
    scene.add_friction(law(), law(name="again"))
    with pytest.raises(SceneError, match=r"two frictions have the normal reaction N_Q.*need a UnilateralContact"):
        read(scene)


def test_several_laws_of_a_contact():
    scene = da.scenes.corner_plate()
    scene.add_contacts(contact())
    scene.add_friction(law(), law(name=None))
    with pytest.raises(SceneError, match=r"two frictions have the normal reaction N_Q.*a name= each"):
        read(scene)
    scene = da.scenes.corner_plate()
    scene.add_contacts(contact())
    scene.add_friction(law(), law(name="rolling"))
    with pytest.raises(SceneError, match="two laws of friction have the reaction F_Q: 'corner' and 'rolling'"):
        read(scene)
    scene = da.scenes.corner_plate()
    scene.add_contacts(contact())
    scene.add_friction(law(), law(name="rolling", tangential=N_A), law(name="rolling", tangential=N_A))
    with pytest.raises(SceneError, match="two contacts are called 'rolling'"):
        read(scene)


@pytest.mark.parametrize("slip", [-x.diff() * sp.cos(theta), 2 * x.diff() * sp.cos(theta), x.diff()])
def test_slip_must_be_what_friction_has_power_on(slip):
    """The other sign would drive the motion on."""
    scene = da.scenes.corner_plate()
    scene.add_friction(law(slip=slip))
    with pytest.raises(SceneError, match="'corner': the slip velocity given for F_Q is not the one that F_Q has power"):
        da.compile_model(scene)


def test_slip_that_says_what_is_known():
    scene = da.scenes.corner_plate()
    scene.add_friction(law(slip=x.diff() * sp.cos(theta) + 0 * theta))
    with_slip, without = da.compile_model(scene), da.compile_model(corner_plate())
    p = {**P, "F_A": 0, "mu": 0.1}
    np_end = [model.simulate((0, 0.3), START, p)["theta"][-1] for model in (with_slip, without)]
    assert np_end[0] == pytest.approx(np_end[1], abs=1e-12)


def test_friction_without_a_normal_reaction_that_the_equations_determine():
    """A moves on the ground by parametrization: N_A has no power until y is released."""
    scene = da.scenes.corner_plate()
    scene.add_friction(law(normal=N_A))
    with pytest.raises(ConstraintError, match=r"friction 'corner' needs N_A.*do not determine.*scene\.release\("):
        da.compile_model(scene)


@pytest.mark.parametrize("value, text", [(-0.1, "must not be negative"), (math.nan, "finite")])
def test_coefficients_at_run_time(value, text):
    model = da.compile_model(corner_plate(mu=sp.Symbol("mu")))
    with pytest.raises(ValueInputError, match=text):
        model.simulate((0, 1), START, {**P, "F_A": 0, "mu": value})


def test_coefficients_of_a_sweep():
    model = da.compile_model(corner_plate(mu=sp.Symbol("mu")))
    sweep = model.sweep((0, 1), START, {**P, "F_A": 0, "mu": [0.1, -0.1]})
    assert list(sweep.status) == [Status.SUCCESS, Status.INITIAL_STATE]


def test_a_start_that_penetrates():
    model = da.compile_model(loose_plate())
    with pytest.raises(InitialStateError, match=r"contact 'ground' penetrates: its gap is -0\.1; start with gap >= 0"):
        model.simulate((0, 1), {"x": -2, "y": -0.1, "theta": 0.7, "x_dot": 0, "y_dot": 0, "theta_dot": 0}, P)


def test_names_of_events():
    model = da.compile_model(corner_plate(0))
    with pytest.raises(UnknownNameError, match=r"unknown name 'slipp'.*Known: .*theta"):
        model.simulate((0, 1), START, {**P, "mu": 0.2}, events=["slipp"])


def test_names_of_contacts():
    run = da.compile_model(corner_plate(0)).simulate((0, 0.1), START, {**P, "mu": 0.2})
    with pytest.raises((OptionError, UnknownNameError), match="corner"):
        run.mode("korner")


def test_names_of_what_a_sweep_has():
    sweep = da.compile_model(corner_plate(0)).sweep((0, 0.1), START, {**P, "mu": [0.2, 0.3]})
    with pytest.raises(UnknownNameError, match=r"unknown output 'thta'\. Did you mean 'theta'\?"):
        sweep["thta"]
    with pytest.raises(UnknownNameError, match=r"N_Q.*It is a reaction of the scene; request it with compile_model"):
        sweep["N_Q"]


def test_what_only_the_model_of_a_mode_has():
    model = da.compile_model(da.scenes.bouncing_ball(), backend="numpy")
    with pytest.raises(AttributeError, match=r"no 'expand' of its own.*model\.mode\(.*\)\.expand"):
        _ = model.expand
    with pytest.raises(
        CapabilityError, match=r"across changes of contacts \(ground\).* model\.mode\(ground='open'\)\.sens"
    ):
        model.sensitivity((0, 1), {}, {}, wrt=["g"])
    assert not hasattr(model, "velocity") and model.mode().prepare


def call_in(error):
    """Return the arguments of the call of `mode` that a message gives."""
    return re.search(r"as model\.mode\((.*?)\)\.sensitivity", str(error.value)).group(1)


def test_messages_give_a_call_of_one_mode_that_works():
    m, l, g, d = sp.symbols("m l g d", positive=True)
    frame, origin = ReferenceFrame("N"), Point("O")
    rod = frame.orientnew("S", "Axis", (theta, frame.z))
    bob = origin.locatenew("P", -l * rod.y)
    scene = da.Scene("stopped", frame=frame, origin=origin, coordinates=[theta])
    scene.add_bodies(Particle("bob", bob, m))
    scene.apply_uniform_gravity(-g * frame.y)
    scene.add_joints(da.Stop("stop", theta, upper=d, restitution=0.5, body="bob", at=bob, direction=rod.x))
    start, given = {theta: -1.0, theta.diff(): 0}, {"m": 1, "l": 1, "g": 9.81, "d": 0.3}
    model = da.compile_model(scene)
    with pytest.raises(CapabilityError) as error:
        model.sensitivity((0, 0.3), start, given, wrt=["l"])
    assert call_in(error) == "**{'stop.upper': 'open'}"
    open_mode = eval(f"model.mode({call_in(error)})", {"model": model})
    found = open_mode.sensitivity((0, 0.3), start, given, wrt=["l"], of=["theta"], t_eval=[0.3])
    high, low = (model.simulate((0, 0.3), start, given | {"l": 1 + h})["theta"][-1] for h in (1e-4, -1e-4))
    assert found.jacobian("theta", "l")[-1] == pytest.approx((high - low) / 2e-4, rel=1e-5)


@pytest.mark.parametrize("count", [2, 4])
def test_messages_give_a_call_for_several_contacts(count):
    heights, frame, origin = dynamicsymbols(f"h:{count}"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("balls", frame=frame, origin=origin, coordinates=heights)
    for i, h in enumerate(heights):
        point = origin.locatenew(f"P_{i}", h * frame.y + i * frame.x)
        scene.add_bodies(Particle(f"ball_{i}", point, sp.Symbol("m", positive=True)))
        scene.add_contacts(da.PointPlane(f"floor_{i}", body=f"ball_{i}", point=point, plane=(origin, frame.y)))
    balls = da.compile_model(scene, backend="numpy")
    with pytest.raises(CapabilityError) as error:
        balls.sensitivity((0, 1), {}, {}, wrt=["m"])
    falling = eval(f"model.mode({call_in(error)})", {"model": balls})
    assert falling is balls.mode(**{f"floor_{i}": "open" for i in range(count)})


def test_messages_give_a_call_for_friction_that_never_opens():
    belt = da.compile_model(da.scenes.belt_oscillator(), backend="numpy")
    with pytest.raises(CapabilityError) as error:
        belt.sensitivity((0, 1), {}, {}, wrt=["m"])
    assert "'slip'" in call_in(error)
    assert eval(f"belt.mode({call_in(error)})", {"belt": belt}) is belt.mode()


def test_a_start_where_the_direction_of_a_contact_is_undefined():
    frame, origin = ReferenceFrame("N"), Point("O")
    y, force = dynamicsymbols("y"), da.unknowns("F")
    ring = da.Scene("ball in a ring", frame=frame, origin=origin, coordinates=[x, y])
    ball = origin.locatenew("B", x * frame.x + y * frame.y)
    ring.add_bodies(Particle("ball", ball, 1))
    r = sp.sqrt(x**2 + y**2)
    ring.add_joints(da.Joint("ring", body="ball", at=ball, force=-force / r * (x * frame.x + y * frame.y)))
    ring.add_contacts(da.UnilateralContact(force, gap=1 - r, name="ring"))
    with pytest.raises(InitialStateError, match=r"contact 'ring': .* no finite gradient here.*start from another"):
        da.compile_model(ring, backend="numpy").simulate((0, 1), {"x": 0, "y": 0, "x_dot": 1, "y_dot": 0}, {})
