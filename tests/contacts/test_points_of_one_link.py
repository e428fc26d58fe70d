"""Two feet of one rigid link that stick while a third contact slides, against computations in plain NumPy."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError, ValueInputError

HEIGHT, GRAVITY, PLATE, ROD, TURNING, ROD_TURNING = 0.1, 10.0, 2.0, 1.0, 0.25, 0.05
CENTRE, END, MU, MU_END = 0.2, 0.4, 0.5, 0.05
FEET = np.array([[-0.1, -0.2], [-0.1, 0.3]])
LEVELS = "normal", "friction_1", "friction_2", "gap"
PUSHES = [{"X": 20.0}, {"Y": 25.0}, {"M": 6.0}, {"X": 9.0, "Y": -9.0, "M": 3.0}, {"X": -8.0, "Y": 12.0, "M": -3.0}]


@cache
def model():
    """Return the model of a plate on two feet, on which a rod turns about a vertical hinge; its end slides."""
    x, y, z, *e = dynamicsymbols("x y z e0:4")
    a, t = dynamicsymbols("a"), dynamicsymbols._t
    N, O, T, R = ReferenceFrame("N"), Point("O"), ReferenceFrame("T"), ReferenceFrame("R")
    T.orient(N, "Quaternion", e)
    R.orient_axis(T, a, T.z)
    C = O.locatenew("C", x * N.x + y * N.y + z * N.z)
    G = C.locatenew("G", CENTRE * R.x)
    scene = da.Scene("foot", frame=N, origin=O, coordinates=[x, y, z, *e, a])
    scene.add_holonomic_constraints(sum(c**2 for c in e) - 1)
    scene.add_bodies(
        RigidBody("plate", C, T, PLATE, (inertia(T, 0.1, 0.2, TURNING), C)),
        RigidBody("rod", G, R, ROD, (inertia(R, 0.01, 0.05, ROD_TURNING), G)),
    )
    scene.apply_uniform_gravity(-GRAVITY * N.z)
    X, Y, M = sp.symbols("X Y M", real=True)
    scene.add_loads((C, sp.sin(2 * t) * (X * N.x + Y * N.y)), (T, M * sp.sin(2 * t) * N.z))
    for name, (p, q) in zip(("heel", "toe"), FEET.tolist(), strict=True):
        foot = C.locatenew(name, p * T.x + q * T.y - HEIGHT * T.z)
        scene.add_contacts(da.PointPlane(name, body="plate", point=foot, plane=(O, N.z), friction=MU))
    end = C.locatenew("end", END * R.x - HEIGHT * R.z)
    scene.add_contacts(da.PointPlane("end", body="rod", point=end, plane=(O, N.z), friction=MU_END))
    return da.compile_model(scene, outputs=[f"{n}.{w}" for n in ("heel", "toe", "end") for w in LEVELS])


def fall(push, span, turn=0.0):
    """Return the motion of the foot, turned about the vertical together with what pushes it."""
    start = dict.fromkeys(("x", "y", "e1", "e2"), 0.0) | {"z": HEIGHT, "e0": np.cos(turn / 2), "e3": np.sin(turn / 2)}
    start |= {"a": 0.0} | {f"{name}_dot": 0.0 for name in (*start, "a")} | {"a_dot": 3.0}
    x, y = push.get("X", 0.0), push.get("Y", 0.0)
    c, s = np.cos(turn), np.sin(turn)
    values = {"X": c * x - s * y, "Y": s * x + c * y, "M": push.get("M", 0.0)}
    return model().simulate((0.0, span), start, values, rtol=1e-9, atol=1e-11)


def balances(push, t, q, v):
    """Return A, b of A (qddot, N, F) = b of the plane motion q = (x, y, angle, a), with F of both feet (2, 2).

    Nothing tilts. The end of the rod slides; a last row for each foot is left to what it does. Also the slips.
    """
    x, y, angle, a = q
    rod = angle + a
    way, across = np.array([np.cos(rod), np.sin(rod)]), np.array([-np.sin(rod), np.cos(rod)])
    turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    arms = FEET @ turned
    points = np.array([x, y]) + np.vstack([arms, END * way])
    slopes = np.zeros((3, 2, 4))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
    slopes[:2, 0, 2], slopes[:2, 1, 2] = -arms[:, 1], arms[:, 0]
    slopes[2, :, 2] = slopes[2, :, 3] = END * across
    centre = np.array([[1.0, 0.0, CENTRE * across[0], CENTRE * across[0]], [0.0, 1.0, *[CENTRE * across[1]] * 2]])
    mass = PLATE * np.diag([1.0, 1.0, 0.0, 0.0]) + ROD * centre.T @ centre
    mass[2, 2] += TURNING
    mass[2:, 2:] += ROD_TURNING
    spin = (v[2] + v[3]) ** 2 * CENTRE * way
    force, moment = (
        np.sin(2 * t) * np.array([push.get("X", 0.0), push.get("Y", 0.0)]),
        np.sin(2 * t) * push.get("M", 0.0),
    )
    slips = slopes @ v
    friction = -MU_END * slips[2] / np.linalg.norm(slips[2])
    A, b = np.zeros((7, 11)), np.zeros(7)
    A[:4, :4], A[:4, 6] = mass, -slopes[2].T @ friction
    A[:4, 7:9], A[:4, 9:] = -slopes[0].T, -slopes[1].T
    b[:4] = [*force, moment, 0.0] + ROD * centre.T @ spin
    A[4, 4:7], b[4] = 1.0, (PLATE + ROD) * GRAVITY
    A[5:, 4:7] = points.T  # moments about the floor: friction acts there, and all else at one height
    A[5:, 6] += HEIGHT * friction
    A[5:, 7:9] = A[5:, 9:] = HEIGHT * np.eye(2)
    b[5:] = GRAVITY * (PLATE * np.array([x, y]) + ROD * (np.array([x, y]) + CENTRE * way))
    return A, b, slips


def pinned(push, t, a, speed):
    """Return the angular acceleration of the rod, N (3,), and F with one share of the load: the plate is pinned."""
    A, b, _ = balances(push, t, [0.0, 0.0, 0.0, a], np.array([0.0, 0.0, 0.0, speed]))
    x = np.linalg.lstsq(A[:, 3:], b, rcond=None)[0]
    return x[0], x[1:4], x[4:].reshape(2, 2)


def hold(push, end):
    """Return the motion of the rod about the plate that stands, for times up to an end."""
    rates = lambda t, s: [s[1], pinned(push, t, *s)[0]]  # noqa: E731
    return solve_ivp(rates, (0.0, end), [0.0, 3.0], rtol=1e-11, atol=1e-13, dense_output=True).sol


def margin(press, friction):
    """Return by how much friction of the feet can be less than its limit, with the best share of the load."""
    line = (FEET[1] - FEET[0]) / np.linalg.norm(FEET[1] - FEET[0])

    def worst(share):
        forces = friction + share * np.array([line, -line])
        return -np.min(MU * press[:2] - np.linalg.norm(forces, axis=1))

    return -minimize_scalar(worst, bounds=(-60.0, 60.0), method="bounded", options={"xatol": 1e-12}).fun


def breaks(push):
    """Return when no share of the load holds the plate any more."""
    motion = hold(push, 0.6)
    held = lambda t: margin(*pinned(push, t, *motion(t))[1:])  # noqa: E731
    times = np.linspace(0.0, 0.6, 121)
    k = next(k for k, t in enumerate(times) if held(t) < 0.0)
    return brentq(held, times[k - 1], times[k], xtol=1e-12)


def slide(push, t0, state, t1):
    """Return the plane motion (q, v) at t1 of the plate that slides on both feet."""

    def rates(t, state):
        A, b, slips = balances(push, t, state[:4], state[4:])
        for i in range(2):
            A[:, 4 + i] -= MU * A[:, 7 + 2 * i : 9 + 2 * i] @ slips[i] / np.linalg.norm(slips[i])
        return [*state[4:], *np.linalg.solve(A[:, :7], b)[:4]]

    return solve_ivp(rates, (t0, t1), state, rtol=1e-11, atol=1e-13).y[:, -1]


def plane(run, k):
    """Return (q, v) of the plane motion at a sample."""
    e, rate = (np.array([run[f"e{n}{dot}"][k] for n in (0, 3)]) for dot in ("", "_dot"))
    turn, spin = 2 * np.arctan2(e[1], e[0]), 2 * (e[0] * rate[1] - e[1] * rate[0])
    names = "x", "y", "a"
    (x, y, a), (u, v, w) = ([run[f"{n}{dot}"][k] for n in names] for dot in ("", "_dot"))
    return np.array([x, y, turn, a, u, v, spin, w])


@pytest.mark.parametrize("turn", [0.0, 0.7, np.pi / 2])
@pytest.mark.parametrize("push", [{}, {"X": 6.0, "Y": 5.0, "M": 1.0}])
def test_a_foot_that_stands_is_pinned(push, turn):
    run, motion = fall(push, 0.25, turn), hold(push, 0.25)
    assert run.success and [phase.modes for phase in run.phases] == [{"heel": "stick", "toe": "stick", "end": "slip"}]
    np.testing.assert_allclose([run["a"], run["a_dot"]], motion(run.t), atol=2e-8)
    still = np.column_stack([run[name] for name in ("x", "y", "e0", "e3")])
    np.testing.assert_allclose(
        still, np.tile([0.0, 0.0, np.cos(turn / 2), np.sin(turn / 2)], (len(run.t), 1)), atol=1e-12
    )
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    for k, t in enumerate(run.t):
        _, press, friction = pinned(push, t, *motion(t))
        names = "heel", "toe", "end"
        np.testing.assert_allclose([run[f"{name}.normal"][k] for name in names], press, atol=1e-6)
        found = np.array([[run[f"{name}.friction_{n}"][k] for n in (1, 2)] for name in names[:2]]) @ rotation.T
        apart = found - friction
        np.testing.assert_allclose(apart[0], -apart[1], atol=1e-6)
        assert abs(apart[0] @ np.array([1.0, 0.0])) < 1e-6  # they share a load along the line alone
        assert np.all(np.linalg.norm(found, axis=1) <= MU * press[:2])


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("push", PUSHES)
def test_a_foot_breaks_away_where_no_share_of_the_load_holds_it(push, turn):
    begins = breaks(push)
    run = fall(push, begins + 0.02, turn)
    assert run.success
    stands = [phase for phase in run.phases if phase.modes == {"heel": "stick", "toe": "stick", "end": "slip"}]
    assert stands == [run.phases[0]] and run.phases[1].t0 == pytest.approx(begins, abs=1e-7)


@pytest.mark.parametrize("push", [PUSHES[1], PUSHES[4]])
def test_a_foot_that_has_broken_away_slides_as_the_equations_of_the_plane_say(push):
    run = fall(push, breaks(push) + 0.08)
    assert {*run.phases[-1].modes.values()} == {"slip"}
    k = next(k for k, t in enumerate(run.t) if t > run.phases[-1].t0 + 0.01)
    np.testing.assert_allclose(plane(run, -1), slide(push, run.t[k], plane(run, k), run.t[-1]), atol=1e-7)


def skate(planes, radii, line):
    """Return the model of a body on two spheres, one on each plane of a height, along a line of the body."""
    x, y, z, *e = dynamicsymbols("x y z e0:4")
    N, O, T = ReferenceFrame("N"), Point("O"), ReferenceFrame("T")
    T.orient(N, "Quaternion", e)
    C = O.locatenew("C", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("skate", frame=N, origin=O, coordinates=[x, y, z, *e])
    scene.add_holonomic_constraints(sum(c**2 for c in e) - 1)
    scene.add_bodies(RigidBody("skate", C, T, 1.0, (inertia(T, 1, 1, 1), C)))
    for name, place, height, radius in zip(("heel", "toe"), (0, 1), planes, radii, strict=True):
        centre, floor = C.locatenew(name, place * line * T.x), O.locatenew(f"floor {name}", height * N.z)
        contact = da.SpherePlane(name, body="skate", plane=(floor, N.z), centre=centre, radius=radius, friction=0.5)
        scene.add_contacts(contact)
    return da.compile_model(scene)


@pytest.mark.parametrize(("planes", "radii"), [((0.0, 0.1), (0.1, 0.1)), ((0.0, 0.0), (0.1, 0.15))])
def test_points_on_two_levels_or_of_two_spheres_that_roll_as_a_cone_are_refused(planes, radii):
    """A share of friction on two levels changes the normal reactions; the line of contact of a cone turns."""
    with pytest.raises(ConstraintError, match="'toe' and 'heel' hold each other"):
        skate(planes, radii, 0.5).mode(heel="stick", toe="stick")


def test_points_of_two_equal_spheres_on_one_plane_stick_together():
    unknowns = skate((0.0, 0.0), (0.1, 0.1), 0.5).mode(heel="stick", toe="stick").layout.unknowns
    assert "friction across heel and toe" in unknowns


def test_the_direction_across_two_points_is_asked_for_in_a_model_of_their_mode():
    mode = model().mode(heel="stick", toe="stick", end="slip")
    start = dict.fromkeys(mode.layout.state, 0.0) | {"e0": 1.0, "z": HEIGHT, "a_dot": 3.0}
    push = dict.fromkeys("XYM", 0.0)
    with pytest.raises(ValueInputError, match="slip direction 1 of toe = nan"):
        mode.simulate((0.0, 0.1), start, push)
    across = {"slip direction 1 of toe": 1.0, "slip direction 2 of toe": 0.0}
    sliding = {"slip direction 1 of end": 0.0, "slip direction 2 of end": 1.0, "rest speed of end": -1e-9}
    run = mode.simulate((0.0, 0.1), start, push | across | sliding, rtol=1e-9, atol=1e-11)
    assert run["a_dot"][-1] == pytest.approx(hold({}, 0.1)(0.1)[1], abs=1e-7)
