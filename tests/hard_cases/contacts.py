"""Motions with Coulomb friction and contacts that open and close, with reference values: `CONTACT_CASES`, by name."""

import math
from functools import cache

from sympy import Rational, cos, cot, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from hard_cases.contact_case import ContactCase, contact_case
from hard_cases.rotations import spin

__all__ = ["CONTACT_CASES", "contact_motion", "corner_plate", "incline_scene", "loose_plate", "table_oscillator"]

TIME = dynamicsymbols._t


def corner_plate(force=None, *, contact=False, **law):
    """Return the plate of example 13.4.2 with friction at its corner, which may open; `force` pushes it at A."""
    scene = da.scenes.corner_plate()
    x, theta = scene.coordinates
    h = symbols("h", positive=True)
    N_Q, F_Q = da.unknowns("N_Q F_Q")
    if force is not None:
        A, _ = scene.loads[0]
        scene.loads = ((A, force * scene.frame.x),)
    scene.add_friction(da.CoulombFriction(N_Q, F_Q, **({"mu": symbols("mu", positive=True), "name": "corner"} | law)))
    if contact:
        scene.add_contacts(da.UnilateralContact(N_Q, gap=-x - h * cot(theta), name="corner"))
    return scene


def loose_plate(force=0, *, ground=None, corner=None):
    """Return the plate with its end A at (x, y), rough where a friction is given, both contacts free to open."""
    x, y, theta = dynamicsymbols("x y theta")
    m, l, h, g = symbols("m l h g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    A = O.locatenew("A", x * N.x + y * N.y)
    G = A.locatenew("G", l * S.x)
    Q = A.locatenew("Q", (-x * cos(theta) + (h - y) * sin(theta)) * S.x)  # the foot of the corner on the plate
    scene = da.Scene("loose_plate", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("plate", G, S, m, (inertia(S, 0, 0, Rational(1, 3) * m * l**2), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((A, force * N.x))
    N_A, T_A, N_Q, F_Q = da.unknowns("N_A T_A N_Q F_Q")
    rough = {"ground": ground, "corner": corner}
    scene.add_joints(
        da.Joint("ground", body="plate", at=A, force=N_A * N.y + (T_A if ground is not None else 0) * N.x),
        da.Joint("corner", body="plate", at=Q, force=N_Q * S.y + (F_Q if corner is not None else 0) * S.x),
    )
    scene.add_contacts(
        da.UnilateralContact(N_A, gap=y, name="ground"),
        da.UnilateralContact(N_Q, gap=-x * sin(theta) + (y - h) * cos(theta), name="corner"),
    )
    for name, (normal, tangential) in {"ground": (N_A, T_A), "corner": (N_Q, F_Q)}.items():
        if rough[name] is not None:
            scene.add_friction(da.CoulombFriction(normal, tangential, mu=rough[name], name=name))
    return scene


def _block(name, direction, gravity, load=None, **law):
    """Return a block on a rough plane, with its height given back so that the normal reaction is determined."""
    x, y = dynamicsymbols("x y")
    m = symbols("m", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    B = O.locatenew("B", x * N.x + y * N.y)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", B, m))
    scene.apply_uniform_gravity(gravity(N))
    if load is not None:
        scene.add_loads((B, load(x) * N.x))
    normal, friction = da.unknowns("N F")
    scene.add_joints(da.Joint("plane", body="block", at=B, force=friction * N.x + normal * N.y))
    scene.add_holonomic_constraints(y)
    law = {"mu": symbols("mu", positive=True), "name": direction} | law
    scene.add_friction(da.CoulombFriction(normal, friction, **law))
    return scene


def incline_scene(**law):
    """Return a block on an incline, x upwards along it."""
    g, alpha = symbols("g alpha", positive=True)
    return _block("incline", "incline", lambda N: -g * (sin(alpha) * N.x + cos(alpha) * N.y), **law)


def table_oscillator(load=None, **law):
    """Return a block on a table at a spring."""
    g, k = symbols("g k", positive=True)
    return _block("table_oscillator", "table", lambda N: -g * N.y, load or (lambda x: -k * x), **law)


# -- cases --------------------------------------------------------------------------------------


def push_pull():
    """F_A = 4 + 7 sin(3 t): slips eight times, and sticks in between."""
    case = "plate_push_pull"
    start = {"x": -0.5 / math.tan(0.5), "theta": 0.5, "x_dot": 0.0, "theta_dot": 0.0}
    scene = corner_plate(4 + 7 * sin(3 * TIME))
    return contact_case(case, scene, start, ["theta", "theta_dot", "N_Q"], bound=1e-11, renamed={"mu_Q": "mu"})


def upright():
    """Slip reverses at the upright position, where it cannot stick; then the plate leaves the corner."""
    start = {"x": -0.8 / math.tan(1.3), "theta": 1.3, "theta_dot": 2.0}
    scene = corner_plate(4, contact=True)
    names = ["x", "theta", "x_dot", "theta_dot"]
    return contact_case("plate_upright", scene, start, names, bound=1e-11, renamed={"mu_Q": "mu"})


def lifts():
    """Pushed by 20 N, its end leaves the ground while it slips on the corner."""
    start = {"x": -0.8 / math.tan(1.0), "y": 0.0, "theta": 1.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    scene = loose_plate(20, corner=symbols("mu_Q", positive=True))
    return contact_case("plate_lifts", scene, start, ["theta", "theta_dot", "N_Q"], bound=1e-11)


@cache
def _rough_at_both():
    mu_A, mu_Q = symbols("mu_A mu_Q", positive=True)
    return loose_plate(ground=mu_A, corner=mu_Q)


def _both(name):
    start = {"x": -0.8 / math.tan(0.7), "y": 0.0, "theta": 0.7, "y_dot": 0.0, "theta_dot": 1.0}
    return contact_case(name, _rough_at_both(), start, ["theta", "theta_dot"], bound=1e-11)


def slides_back():
    """Friction at both ends: slides up, stops, and slides back at once."""
    return _both("plate_slides_back")


def sticks():
    """Friction at both ends: slides up and sticks; how the ends share the load is not determined."""
    return _both("plate_sticks")


_rod, _slope = cache(da.scenes.sliding_rod), cache(incline_scene)


def rod_stops():
    """A rod whose end slides, sticks, and slips away as the rod falls."""
    start = {"x": 0.0, "y": 0.0, "theta": 1.2, "x_dot": -1.0, "y_dot": 0.0, "theta_dot": 0.0}
    names = ["x", "theta", "x_dot", "theta_dot"]
    return contact_case("rod_stops", _rod(), start, names, bound=1e-11)


def rod_lifts():
    """Spins so fast that its end leaves the ground, grazing it."""
    start = {"x": 0.0, "y": 0.0, "theta": 0.5, "x_dot": -3.0, "y_dot": 0.0, "theta_dot": 3.5}
    names = ["x", "theta", "x_dot", "theta_dot", "y"]
    return contact_case("rod_lifts", _rod(), start, names, bound=1e-11)


def rod_falls():
    """An impact with friction that stops its end, which then slides and sticks."""
    start = {"x": 0.0, "y": 0.5, "theta": 1.0, "x_dot": 1.0, "y_dot": 0.0, "theta_dot": 0.0}
    names = ["x", "theta", "x_dot", "theta_dot"]
    return contact_case("rod_falls", _rod(), start, names, bound=1e-11)


def belt():
    """A block on a belt, 0.5 in stick and 0.3 in slip: thirty phases in 100 s."""
    start = {"x": 0.0, "x_dot": 0.2}
    return contact_case("belt", da.scenes.belt_oscillator(), start, ["x", "x_dot"], bound=1e-11)


def oscillator():
    """Thirteen half cycles, then stuck beside the middle; smooth friction creeps there."""
    start = {"x": 0.5, "x_dot": 0.0}
    return contact_case("coulomb_oscillator", table_oscillator(), start, ["x"], bound=1e-12)


def _incline(name):
    return contact_case(name, _slope(), {"x": 0.0, "x_dot": 3.0}, ["x", "x_dot"], bound=1e-13)


def incline_back():
    """Up an incline, stops, and slides back at once: mu = 0.3 < tan(alpha)."""
    return _incline("incline_back")


def incline_sticks():
    """Up an incline, stops and sticks: mu = 0.7 > tan(alpha)."""
    return _incline("incline_sticks")


def billiard():
    """Slides until it rolls: the direction of slip is 0/0 there, and two constraints take over."""
    scene = da.scenes.billiard_ball()
    start = {"x": 0.0, "y": 0.0, "z": 0.03, "x_dot": 2.0, "y_dot": 0.5, "z_dot": 0.0}
    start |= spin((1, 0, 0, 0), (20.0, -60.0, 15.0))
    e = scene.coordinates[3:]
    rates = [q.diff() for q in e]
    # omega in space is 2 e_dot o conj(e)
    space = [
        2 * (-rates[0] * e[1] + rates[1] * e[0] - rates[2] * e[3] + rates[3] * e[2]),
        2 * (-rates[0] * e[2] + rates[1] * e[3] + rates[2] * e[0] - rates[3] * e[1]),
        2 * (-rates[0] * e[3] - rates[1] * e[2] + rates[2] * e[1] + rates[3] * e[0]),
    ]
    observed = ["x", "y", "x_dot", "y_dot", *space]
    return contact_case("billiard", scene, start, observed, bound=1e-11, quantity="position, velocity, omega in space")


def bouncing():
    """Six impacts with restitution 0.8; the phases that follow are ever shorter."""
    start = {"x": 0.0, "y": 1.0, "x_dot": 1.0, "y_dot": 0.0}
    names = ["x", "y", "x_dot", "y_dot"]
    return contact_case("bouncing", da.scenes.bouncing_ball(), start, names, bound=1e-12)


CONTACT_CASES = {
    "plate pushed and pulled": push_pull,
    "plate through the upright position": upright,
    "plate that lifts off": lifts,
    "plate with two frictions that slides back": slides_back,
    "plate with two frictions that sticks": sticks,
    "rod that sticks and slips": rod_stops,
    "rod that lifts off": rod_lifts,
    "rod that falls on the ground": rod_falls,
    "block on a belt": belt,
    "oscillator with dry friction": oscillator,
    "block that slides back": incline_back,
    "block that sticks": incline_sticks,
    "billiard ball that rolls": billiard,
    "bouncing ball": bouncing,
}


@cache
def contact_motion(name: str) -> ContactCase:
    """Return a case by name, built once."""
    return CONTACT_CASES[name]()
