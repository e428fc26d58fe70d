"""Equilibria and steady motions, against closed forms."""

import functools
import itertools
import math

import numpy as np
import pytest
import sympy as sp
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.analysis.linear_equations import LinearPoint, scene_equations
from dalembert.errors import InitialStateError, OptionError, UnknownNameError
from dalembert.mechanics import virtual_power
from dalembert.starts.inputs import prepare_rows
from hard_cases import machines
from scene.builders import cartesian_pendulum, double_pendulum, four_bar

FORMULATIONS = ("minimal", "projected", "baumgarte", "ggl", "augmented")
G = 9.81


@functools.cache
def compiled(build, formulation="auto"):
    return da.compile_model(build(), backend="numpy", formulation=formulation)


def cart_pole():
    """A cart that a force F pushes, with a bob on a rod of angle a from the upper vertical, and a hanging load T."""
    x, a = dynamicsymbols("x a")
    F, T, M, m, l, g = symbols("F T M m l g")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, a])
    R = N.orientnew("R", "Axis", (a, N.z))
    cart = O.locatenew("cart", x * N.x)
    bob = cart.locatenew("bob", l * R.y)
    scene.add_bodies(Particle("cart", cart, M), Particle("bob", bob, m))
    scene.add_loads((cart, F * N.x), (bob, T * N.x))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def rolling_disc():
    """A thin disc on a plane: point of contact, heading psi, angle theta of its plane to the ground, turn phi."""
    x, y, psi, theta, phi = dynamicsymbols("x y psi theta phi")
    m, r, g = symbols("m r g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("rolling_disc", frame=N, origin=O, coordinates=[x, y, psi, theta, phi])
    H = N.orientnew("H", "Axis", (psi, N.z))
    L = H.orientnew("L", "Axis", (theta, H.x))
    D = L.orientnew("D", "Axis", (phi, L.z))
    contact = O.locatenew("contact", x * N.x + y * N.y)
    centre = contact.locatenew("centre", r * L.y)
    scene.add_bodies(RigidBody("disc", centre, D, m, (inertia(D, m * r**2 / 4, m * r**2 / 4, m * r**2 / 2), centre)))
    slip = centre.pos_from(O).dt(N) + D.ang_vel_in(N).cross(-r * L.y)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def spring_chain(count=6):
    """Masses that hang on springs below each other."""
    z = dynamicsymbols(f"z1:{count + 1}")
    k, l0, m, g, c = symbols("k l0 m g c", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("spring_chain", frame=N, origin=O, coordinates=z)
    above, height = O, sp.S.Zero
    for i, own in enumerate(z):
        mass = O.locatenew(f"P{i}", own * N.z)
        pull = k * (height - own - l0) - c * own.diff()
        scene.add_bodies(Particle(f"mass{i}", mass, m))
        scene.add_loads((mass, pull * N.z))
        if above is not O:
            scene.add_loads((above, -k * (height - own - l0) * N.z))
        above, height = mass, own
    scene.apply_uniform_gravity(-g * N.z)
    return scene


POLE = {"F": 0.0, "T": 0.0, "M": 2.0, "m": 0.5, "l": 1.2, "g": G}


def test_the_cart_pole_stands_and_hangs():
    model = compiled(cart_pole)
    for guess, angle in ((0.4, 0.0), (2.6, math.pi)):
        start = {"x": 0.7, "a": guess, "x_dot": 0, "a_dot": 0}
        point = model.trim(start, POLE)
        assert point.converged
        assert point["a"] == pytest.approx(angle, abs=1e-14)
        assert point["x"] == pytest.approx(0.7, abs=1e-14)
        assert point.undetermined == ("x",)
        assert "do not determine x" in point.message
        assert max(map(abs, point.derivatives.values())) < 1e-13
        assert max(map(abs, point.residual.values())) < 1e-13
        run = model.simulate((0, 1), point.initial, point.parameters)
        np.testing.assert_allclose(run["a"], angle, atol=1e-9)


def _ends(model, p, fixed, equilibria, most, count):
    """Return guesses on a grid of angles around equilibria from which `trim` does not end in that equilibrium."""
    names = model.layout.coordinates[-len(equilibria[0]) :]
    lost = []
    for place in equilibria:
        for change in itertools.product(np.linspace(-most, most, count), repeat=len(place)):
            if np.linalg.norm(change) > most + 1e-12:
                continue
            guess = dict(zip(names, np.add(place, change), strict=True))
            point = model.trim(fixed | guess | {f"{name}_dot": 0.0 for name in names}, p)
            found = [point[name] for name in names]
            if not (point.converged and np.allclose(found, place, rtol=0.0, atol=1e-9)):
                lost.append((guess, found))
    return lost


@pytest.mark.parametrize("absolute", [True, False])
def test_a_double_pendulum_ends_in_the_nearest_equilibrium(absolute):
    model = compiled(functools.partial(double_pendulum, absolute))
    p = {"m": 1.0, "M": 1.0, "g": G, "l": 1.0, "r": 1.0, "A": 0.1}
    up, down = math.pi / 2, -math.pi / 2
    places = [(a, b if absolute else b - a) for a in (up, down) for b in (up, down)]
    assert _ends(model, p, {}, places, 1.1, 5) == []


@pytest.mark.parametrize("cart", [2.0, 0.1])  # of a light cart the acceleration of the rod is largest 0.46 rad off
def test_a_cart_pole_ends_in_the_nearest_equilibrium(cart):
    places = [(0.0,), (math.pi,)]
    assert _ends(compiled(cart_pole), POLE | {"M": cart}, {"x": 0.7, "x_dot": 0.0}, places, 1.5, 13) == []


@pytest.mark.parametrize("kernel", ["mass_matrix", "momenta"])
def test_forces_and_their_derivatives(kernel, monkeypatch):
    """The mass matrix times the accelerations, from the whole matrix and, as of many bodies, from momenta."""
    if kernel == "momenta":
        monkeypatch.setattr(virtual_power, "_LEAST", 2)
        monkeypatch.setattr(virtual_power, "WORTH", 0)
    model = da.compile_model(double_pendulum(False), backend="numpy")
    program, partials = model.stages.program, model.derived.partials
    assert kernel in program
    x = np.array([0.4, -0.9, 1.3, 0.8])
    p = np.array([{"m": 1.2, "M": 0.7, "g": G, "l": 1.1, "r": 0.6, "A": 0.3}[name] for name in model.layout.parameters])

    def forces(values):
        c = prepare_rows(program, values[np.newaxis, 4:])[0]
        y = partials.value("initial", 0.0, values[:4], c)
        return scene_equations(LinearPoint(program, partials, 0.0, y, c), values[:4]).rates_in_forces()

    values = np.concatenate([x, p])
    found = forces(values)
    second = partials.value("accelerations", 0.0, x, prepare_rows(program, p[np.newaxis])[0])
    np.testing.assert_allclose(found.value, [*x[2:], *model.mass_matrix(x[:2], p) @ second], rtol=1e-13)
    for i, slopes in enumerate(np.hstack([found.by_state, found.by_parameters]).T):
        step = 1e-5 * np.eye(len(values))[i]
        measured = (forces(values + step).value - forces(values - step).value) / 2e-5
        np.testing.assert_allclose(slopes, measured, rtol=1e-7, atol=1e-7)


def test_the_cart_pole_in_a_wind_with_the_force_free():
    """T/m g = tan of the lean, and the cart is held by F = -T; with F free and the bob accelerating along."""
    model = compiled(cart_pole)
    start = {"x": 0.0, "a": 0.1, "x_dot": 0, "a_dot": 0}
    point = model.trim(start, POLE | {"T": 1.5}, free=["a", "F"])
    lean = math.atan2(-1.5, -0.5 * G) + math.pi  # R.y is (-sin a, cos a), and the rod pushes along it
    assert point.converged and not point.undetermined
    assert point["F"] == pytest.approx(-1.5, rel=1e-12)
    assert point["a"] == pytest.approx(lean, rel=1e-12)
    assert point.free == ("a", "F")
    assert point.parameters["F"] == point["F"]
    accelerated = model.trim(start, POLE | {"F": 5.0}, free=["a"], steady=["a_dot"])
    assert accelerated["a"] == pytest.approx(-math.atan(5.0 / 2.5 / G), rel=1e-12)
    assert accelerated.derivatives["x_dot"] == pytest.approx(2.0, rel=1e-12)
    inverse = model.trim({**start, "a": -0.2}, POLE, free=["F"], steady=["a_dot"])
    assert inverse["F"] == pytest.approx(2.5 * G * math.tan(0.2), rel=1e-12)


def test_what_cannot_vanish_is_said():
    model = compiled(cart_pole)
    start = {"x": 0.0, "a": 0.1, "x_dot": 0, "a_dot": 0}
    with pytest.raises(OptionError, match=r"2 conditions .* 1 free values \(a\).*d\(x_dot\)/dt = "):
        model.trim(start, POLE | {"F": 5.0}, free=["a"])
    pushed = model.trim(start, POLE | {"F": 5.0}, free=["x", "a"])
    assert not pushed.converged
    assert "d(x_dot)/dt" in pushed.message and "no equilibrium" in pushed.message
    assert "NOT CONVERGED" in repr(pushed)
    falling = model.trim(start, POLE, free=["g"])  # 0 would do, and is found
    assert falling.converged and falling["g"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS[1:])
def test_a_pendulum_on_a_circle_in_every_formulation(formulation):
    model = compiled(cartesian_pendulum, formulation)
    p = {"m": 1.3, "l": 2.0, "g": G}
    point = model.trim({"x": 0.9, "y": -1.5, "x_dot": 0.0, "y_dot": 0.0}, p)
    assert point.converged and not point.undetermined
    assert (point["x"], point["y"]) == pytest.approx((0.0, -2.0), abs=1e-13)
    by_length = model.trim({"x": 0.0, "y": -1.5, "x_dot": 0.0}, p, free=["l"])
    assert by_length["l"] == pytest.approx(1.5, rel=1e-13)
    assert by_length["y_dot"] == 0.0
    sideways = model.trim({"x": 1.9, "y": -0.2, "x_dot": 0.0}, p, steady=["x_dot"])
    assert sideways.converged  # x_dot alone was asked for, and y may fall


def test_loops_close_on_the_way():
    model = compiled(four_bar)
    bars = {"m": 1.0, "l1": 1.0, "l2": 2.0, "l3": 1.5, "r": 2.0, "g": G}
    point = model.trim({"q1": 0.9, "q2": -0.5, "q3": -2.0, "q1_dot": 0, "q2_dot": 0, "q3_dot": 0}, bars)
    assert point.converged
    q = np.cumsum([point["q1"], point["q2"], point["q3"]])
    lengths = np.array([1.0, 2.0, 1.5])
    assert [np.cos(q) @ lengths, np.sin(q) @ lengths] == pytest.approx([2.0, 0.0], abs=1e-13)
    assert max(abs(point.derivatives[f"q{i}_dot"]) for i in (1, 2, 3)) < 1e-12


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("free", ["theta", "phi_dot"])
def test_the_steady_turn_of_a_disc(formulation, free):
    """(C + m r^2) w psi' sin(theta) - A psi'^2 sin cos + m g r cos(theta) = 0, w the spin about the axis."""
    model = compiled(rolling_disc, formulation)
    p = {"m": 2.0, "r": 0.4, "g": G}
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.2, "phi": 0, "psi_dot": 1.1, "theta_dot": 0.0, "phi_dot": -6.0}
    point = model.trim(start, p, free=[free])
    assert point.converged and not point.undetermined
    theta, turn = point["theta"], point["psi_dot"]
    spin = point["phi_dot"] + turn * math.cos(theta)
    left = 1.5 * spin * turn * math.sin(theta) - 0.25 * turn**2 * math.sin(theta) * math.cos(theta)
    assert left + G / 0.4 * math.cos(theta) == pytest.approx(0.0, abs=1e-11)
    assert abs(point.derivatives["x_dot"]) > 0.1  # the path is a circle
    run = model.simulate((0.0, 1.0), point.initial, point.parameters, rtol=1e-10)
    np.testing.assert_allclose(run["theta"], theta, atol=1e-7)
    np.testing.assert_allclose(run["psi_dot"], turn, atol=1e-7)


def test_rates_that_follow_may_be_asked_to_rest_but_say_so():
    model = compiled(rolling_disc, "projected")
    p = {"m": 2.0, "r": 0.4, "g": G}
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.2, "phi": 0, "psi_dot": 1.1, "theta_dot": 0.0, "phi_dot": -6.0}
    rates = ["x_dot", "y_dot", "psi_dot", "theta_dot", "phi_dot"]
    with pytest.raises(OptionError, match="follow from velocity constraints"):
        model.trim(start, p, free=["theta"], steady=rates)


def test_a_loaded_chain_of_springs():
    model = compiled(spring_chain)
    p = {"k": 2.5e4, "l0": 0.3, "m": 4.0, "g": G, "c": 1.0}
    start = {f"z{i}": 0.0 for i in range(1, 7)} | {f"z{i}_dot": 0.0 for i in range(1, 7)}
    point = model.trim(start, p)
    lengths = 0.3 + np.arange(6, 0, -1) * 4.0 * G / 2.5e4
    assert point.converged and point.iterations <= 3
    np.testing.assert_allclose([point[f"z{i}"] for i in range(1, 7)], -np.cumsum(lengths), rtol=1e-13)
    by_load = model.trim({**point.initial, "z6": -2.0}, p, free=["z1", "z2", "z3", "z4", "z5", "g"])
    assert by_load["z6"] == -2.0
    assert by_load["g"] == pytest.approx((2.0 - 1.8) * 2.5e4 / 4.0 / 21, rel=1e-12)


def test_symbols_serve_as_names():
    scene = cart_pole()
    x, a = scene.coordinates
    model = da.compile_model(scene, backend="numpy")
    point = model.trim(
        {x: 0, a: 0.2, x.diff(): 0, a.diff(): 0}, POLE, free=[a, sp.Symbol("F")], steady=[a.diff(), x.diff()]
    )
    assert point[a] == point["a"] == pytest.approx(0.0, abs=1e-14)
    assert point[a.diff()] == 0.0
    with pytest.raises(UnknownNameError, match="unknown name 'b'"):
        point["b"]


def test_a_solution_that_a_symbol_excludes_is_none():
    scene = rolling_disc()
    model = da.compile_model(scene, backend="numpy")
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.2, "phi": 0, "psi_dot": 1.1, "theta_dot": 0.0, "phi_dot": 6.0}
    point = model.trim(start, {"m": 2.0, "r": 0.4, "g": G}, free=["g"])
    assert not point.converged
    assert "contradicts positive=True" in point.message


@pytest.mark.parametrize(
    "change, error, text",
    [
        ({"free": ["b"]}, UnknownNameError, "unknown free value 'b'"),
        ({"free": []}, OptionError, "free names nothing"),
        ({"steady": ["F"]}, UnknownNameError, "unknown steady value 'F'"),
        ({"steady": []}, OptionError, "steady names nothing"),
        ({"guess": {"x": 0.0, "x_dot": 0, "a_dot": 0}}, InitialStateError, "missing for the coordinates a"),
        ({"guess": {"x": 0.0, "a": 0.1, "x_dot": 0}}, InitialStateError, "rates a_dot.*nothing defaults to zero"),
        ({"guess": {"x": 0.0, "a": 0.1, "b": 0}}, UnknownNameError, "unknown initial value 'b'"),
        ({"parameters": {"M": 1.0}}, UnknownNameError, "missing parameters"),
        ({"tolerance": 0.0}, OptionError, "tolerance must be"),
        ({"max_iterations": 0}, OptionError, "max_iterations must be"),
        ({"t": "now"}, OptionError, "t must be a number"),
    ],
)
def test_wrong_input_is_named(change, error, text):
    given = {"guess": {"x": 0.0, "a": 0.1, "x_dot": 0, "a_dot": 0}, "parameters": POLE} | change
    with pytest.raises(error, match=text):
        compiled(cart_pole).trim(given.pop("guess"), given.pop("parameters"), **given)


def test_constraints_that_follow_from_others_do_no_harm():
    x, y = dynamicsymbols("x y")
    m, l, g = symbols("m l g")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("twice", frame=N, origin=O, coordinates=[x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bob", P, m))
    scene.add_holonomic_constraints(x**2 + y**2 - l**2, (x**2 + y**2 - l**2) * (1 + x**2))
    scene.apply_uniform_gravity(-g * N.y)
    model = da.compile_model(scene, backend="numpy", formulation="projected")
    point = model.trim({"x": 0.9, "y": -1.5, "x_dot": 0.0, "y_dot": 0.0}, {"m": 1.0, "l": 2.0, "g": G})
    assert point.converged
    assert (point["x"], point["y"]) == pytest.approx((0.0, -2.0), abs=1e-12)


def test_a_small_load_beside_stiff_springs_is_not_lost():
    """Two masses on a spring of 1e9 N/m between them and a soft one to the ground; without it, nothing holds them."""
    x, y = dynamicsymbols("x y")
    k, s, F = symbols("k s F")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("stiff_pair", frame=N, origin=O, coordinates=[x, y])
    P, Q = O.locatenew("P", x * N.x), O.locatenew("Q", y * N.x)
    scene.add_bodies(Particle("P", P, 1), Particle("Q", Q, 1))
    scene.add_loads((P, (k * (y - x) - s * x) * N.x), (Q, (F - k * (y - x)) * N.x))
    model, start = da.compile_model(scene, backend="numpy"), {"x": 0, "y": 0, "x_dot": 0, "y_dot": 0}
    held = model.trim(start, {"k": 1e9, "s": 1.0, "F": 2.0})
    assert held.converged and not held.undetermined
    assert (held["x"], held["y"]) == pytest.approx((2.0, 2.0), rel=1e-6)
    loose = model.trim(start, {"k": 1e9, "s": 0.0, "F": 1e-4})
    assert not loose.converged and "is left" in loose.message


def test_hands_free_turn_of_the_bicycle():
    """A steady turn without a steering torque: the run after it stays in it."""
    model = compiled(machines.bicycle_scene, "projected")
    p, start = machines.bicycle_parameters(), machines.upright_bicycle(5.0)
    rates = ("psi_dot", "psif_dot", "betar_dot")
    start = {k: v for k, v in start.items() if not k.endswith("_dot") or k in rates}
    point = model.trim({**start, "psi": math.pi / 2 + 0.3, "psif": 0.1}, p, free=["psi", "psif", "z", "phi"])
    assert point.converged and point["psif"] > 0.1
    run = model.simulate((0.0, 1.0), point.initial, p, rtol=1e-10)
    for name in ("psi", "psif", "theta_dot", "betar_dot"):
        assert np.ptp(run[name]) < 1e-9


def test_rounding_of_forces_that_cancel_is_no_fault():
    """Gravity and the pull of the string cancel whatever the values are; what rounding leaves of them is met."""
    model, rng = compiled(cartesian_pendulum, "projected"), np.random.default_rng(4)
    for _ in range(12):
        g, l = rng.uniform(0.5, 15.0), rng.uniform(0.3, 3.0)
        angle = rng.uniform(-1.2, 1.2)
        guess = {"x": l * math.sin(angle), "y": -l * math.cos(angle), "x_dot": 0.0, "y_dot": 0.0}
        point = model.trim(guess, {"m": 1.3, "l": l, "g": g})
        assert point.converged, point.message


def test_a_start_on_the_other_side_of_a_loop():
    """Newton's method alone ends off the loop; steps along it arrive."""
    bars = {"m": 1.0, "l1": 1.0, "l2": 2.0, "l3": 1.5, "r": 2.0, "g": G}
    start = {"q1": 5.472, "q2": -10.409, "q3": -2.302, "q1_dot": 0, "q2_dot": 0, "q3_dot": 0}
    point = compiled(four_bar).trim(start, bars)
    assert point.converged
    assert point["q1"] == pytest.approx(4.4855, abs=1e-4)
