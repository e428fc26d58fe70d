"""Rolling and drilling resistance as laws of a contact, under its normal reaction: closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sympy import cos, exp, sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import OptionError

pytestmark = pytest.mark.usefixtures("quick_xla")

N, O = ReferenceFrame("N"), Point("O")
x, y, z, theta, psi = dynamicsymbols("x y z theta psi")
m, g, r, mu, d, c, e, alpha = symbols("m g r mu d c e alpha", positive=True)
k = symbols("k")
BODY = {"m": 0.2, "g": 9.81, "r": 0.1, "mu": 0.2}
P_ROLLING = {"m": 0.2, "g": 9.81, "r": 0.1, "d": 0.01}
P = {**BODY, "d": 0.01, "e": 0.0}
FORMULATIONS = ["minimal", "projected", "baumgarte", "ggl", "augmented"]


def ball(backend="llvm", impacts="newton", outputs=("floor.rolling_1", "floor.normal"), **options):
    """Return the model of a ball in a plane on a floor."""
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[x, y, theta])
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, 0, 0, 2 * m * r**2 / 5), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_contacts(
        da.SpherePlane(
            "floor",
            body="ball",
            centre=G,
            radius=r,
            plane=(O, N.y),
            restitution=e,
            friction=mu,
            rolling_resistance=d,
        )
    )
    return da.compile_model(scene, backend=backend, impacts=impacts, outputs=outputs, **options)


@pytest.fixture(scope="module")
def model():
    return ball()


def start(v, omega=0.0, height=0.1, fall=0.0):
    return {x: 0, y: height, theta: 0, x.diff(): v, y.diff(): fall, theta.diff(): omega}


def slides_and_rolls(v):
    """Return when a ball without spin starts to roll and when it stops, and how far it comes.

    It slides with a = -mu g and 2/5 r^2 w' = -(mu r - d) g, the slip being v + r w; it rolls with 7/5 a = -g d/r.
    """
    gravity, lever = P["g"], P["d"] / P["r"]
    rolls = v / (gravity * (3.5 * P["mu"] - 2.5 * lever))
    left = v - P["mu"] * gravity * rolls
    slowed = gravity * lever / 1.4
    return rolls, rolls + left / slowed, (v + left) / 2 * rolls + left**2 / (2 * slowed)


@pytest.mark.parametrize(
    ("backend", "options"),
    [
        *(("llvm", {"formulation": each}) for each in FORMULATIONS),
        *((backend, {}) for backend in ("numba", "jax", "numpy")),
    ],
)
def test_a_ball_slides_then_rolls_then_stops(backend, options):
    rolls, stops, way = slides_and_rolls(2.0)
    outputs = () if backend != "llvm" else ("floor.rolling_1",)
    run = ball(backend, outputs=outputs, **options).simulate((0, 3), start(2.0), P, rtol=1e-9)
    assert run.success
    assert [phase.modes for phase in run.phases] == [
        {"floor": "slip", "floor.rolling": "slip"},
        {"floor": "stick", "floor.rolling": "slip"},
        {"floor": "stick", "floor.rolling": "stick"},
    ]
    exact = options.get("formulation") != "augmented"
    np.testing.assert_allclose([phase.t0 for phase in run.phases], [0, rolls, stops], atol=1e-9 if exact else 1e-6)
    assert abs(run["x"][-1] - way) < (1e-9 if exact else 1e-6)
    if outputs:
        assert abs(abs(run["floor.rolling_1"][0]) - P["d"] * P["m"] * P["g"]) < 1e-9 and run["floor.rolling_1"][-1] == 0


def test_a_sweep_stops_its_cases(model):
    speeds = np.array([0.0, 0.5, 1.0, 2.0])
    sweep = model.sweep((0, 4), {**start(2.0), x.diff(): speeds}, P, rtol=1e-10)
    assert sweep.success.all()
    np.testing.assert_allclose(sweep["x"], [0, *(slides_and_rolls(v)[2] for v in speeds[1:])], atol=1e-9)
    assert sweep.phases.tolist() == [1, 3, 3, 3]


@pytest.mark.parametrize("law", ["newton", "poisson", "sequence"])
@pytest.mark.parametrize(("v", "omega"), [(3.0, 0.0), (0.2, 5.0), (0.05, 40.0), (0.0, -0.2), (0.01, -0.1)])
def test_an_impact_bounds_each_impulse_by_its_own_coefficient(law, v, omega):
    """An impulse p = (1 + e) m u has friction up to mu p and a moment up to d p; each holds its velocity or is full."""
    down, back, inertia_ = 1.0, 0.5, 0.4 * P["m"] * P["r"] ** 2
    p = (1 + back) * P["m"] * down
    found = []
    for slip, roll in ((s, t) for s in (0, 1, -1) for t in (0, 1, -1)):
        # v+ = v + F / m, w+ = w + (r F + M) / I; slip v + r w
        rows, right = np.zeros((2, 2)), np.zeros(2)
        rows[0], right[0] = (
            ((1, 0), -slip * P["mu"] * p)
            if slip
            else ((1 / P["m"] + P["r"] ** 2 / inertia_, P["r"] / inertia_), -v - P["r"] * omega)
        )
        rows[1], right[1] = ((0, 1), -roll * P["d"] * p) if roll else ((P["r"] / inertia_, 1 / inertia_), -omega)
        F, M = np.linalg.solve(rows, right)
        after = v + F / P["m"], omega + (P["r"] * F + M) / inertia_
        slipping, rolling = after[0] + P["r"] * after[1], after[1]
        fits = slip * slipping > 0 if slip else abs(F) <= P["mu"] * p
        if fits and (roll * rolling > 0 if roll else abs(M) <= P["d"] * p):
            found.append(after)
    assert len(found) == 1
    run = ball(impacts=law).simulate((0, 1e-9), start(v, omega, fall=-down), {**P, "e": back})
    np.testing.assert_allclose([run["x_dot"][-1], run["theta_dot"][-1]], found[0], atol=1e-7)
    assert abs(run["y_dot"][-1] - back * down) < 1e-7


def test_a_ball_bounces_and_comes_to_rest(model):
    run = model.simulate((0, 12), start(1.0, 30.0, height=0.5), {**P, "e": 0.7}, rtol=1e-9)
    assert run.success and run.phases[-1].modes == {"floor": "stick", "floor.rolling": "stick"}
    assert abs(run["y"][-1] - 0.1) < 1e-12 and run["theta_dot"][-1] == 0
    flying = [phase.modes for phase in run.phases if phase.modes["floor"] == "open"]
    assert len(flying) > 10 and all(modes["floor.rolling"] == "open" for modes in flying)


def wheel():
    """Return the model of a disc that rolls down a plane, y being the coordinate across it."""
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[x, y, theta])
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("disc", G, S, m, (inertia(S, m * r**2 / 4, m * r**2 / 4, m * r**2 / 2), G)))
    scene.add_loads((G, m * g * (sin(alpha) * N.x - cos(alpha) * N.y)))
    scene.add_contacts(
        da.DiscPlane(
            "slope", body="disc", centre=G, radius=r, axis=S.z, plane=(O, N.y), friction=mu, rolling_resistance=d
        )
    )
    return da.compile_model(scene, outputs=["slope.rolling_1", "slope.friction_1"])


def test_a_wheel_on_an_incline():
    """It rests while tan(alpha) < d/r, and rolls with 3/2 a = g (sin(alpha) - d/r cos(alpha)) otherwise."""
    model, still = wheel(), {**start(0.0)}
    for angle in (0.05, 0.0996, 0.0998, 0.2):  # atan(d / r) is 0.09967
        run = model.simulate((0, 2), still, {**BODY, "d": 0.01, "mu": 0.5, "alpha": angle}, rtol=1e-11)
        a = max(0.0, 9.81 * (np.sin(angle) - 0.1 * np.cos(angle)) / 1.5)
        assert run.success and abs(run["x"][-1] - 2 * a) < 1e-10
        assert run.phases[-1].modes == {"slope": "stick", "slope.rolling": "slip" if a else "stick"}
        if a == 0:
            held = 0.1 * 0.2 * 9.81 * np.sin(angle)
            np.testing.assert_allclose(np.abs(run["slope.rolling_1"]), held, rtol=1e-12)
    uphill = model.simulate((0, 3), start(-1.0, 10.0), {**BODY, "d": 0.01, "mu": 0.5, "alpha": 0.05}, rtol=1e-11)
    slowed = 9.81 * (np.sin(0.05) + 0.1 * np.cos(0.05)) / 1.5
    assert abs(uphill.phases[-1].t0 - 1 / slowed) < 1e-10 and abs(uphill["x"][-1] + 1 / (2 * slowed)) < 1e-10


def free_ball(**contact):
    """Return the scene of a ball in space on a table, oriented by a quaternion."""
    e_0, *e_v = dynamicsymbols("e0:4")
    scene = da.Scene("free_ball", frame=N, origin=O, coordinates=[x, y, z, e_0, *e_v])
    S, G = N.orientnew("S", "Quaternion", (e_0, *e_v)), O.locatenew("G", x * N.x + y * N.y + z * N.z)
    J = 2 * m * r**2 / 5
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, J, J, J), G)))
    scene.add_holonomic_constraints(e_0**2 + sum(each**2 for each in e_v) - 1)
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_contacts(da.SpherePlane("table", body="ball", centre=G, radius=r, plane=(O, N.z), friction=mu, **contact))
    return scene, {f"omega_{k}": each for k, each in zip("xyz", _omega(S), strict=True)}


def _omega(S):
    return [S.ang_vel_in(N).dot(axis) for axis in N]


def at_once(v, omega):
    """Return a start at the orientation of the frame."""
    names = ["x", "y", "z", "e0", "e1", "e2", "e3"]
    rates = [*v, 0.0, 0.0, *(w / 2 for w in omega)]
    values = dict(zip(names, [0, 0, 0.1, 1, 0, 0, 0], strict=True))
    return values | {f"{name}_dot": rate for name, rate in zip(names, rates, strict=True)}


def test_a_sphere_that_spins_in_place_stops_by_drilling_resistance():
    """I w' = -c m g; nothing else moves."""
    scene, outputs = free_ball(drilling_resistance=c)
    for backend in ("llvm", "numpy"):
        model = da.compile_model(scene, backend=backend, outputs=outputs)
        run = model.simulate((0, 2), at_once((0, 0), (0, 0, 40.0)), {**BODY, "c": 1e-2}, rtol=1e-10)
        stops = 0.4 * 0.1**2 * 40 / (1e-2 * 9.81)
        assert run.success and abs(run.phases[-1].t0 - stops) < 1e-8
        assert run.phases[0].modes == {"table": "stick", "table.drilling": "slip"}
        assert run.phases[-1].modes == {"table": "stick", "table.drilling": "stick"}
        turned = 40 * stops / 2
        assert abs(run["e0"][-1] - np.cos(turned / 2)) < 1e-8 and abs(run["x"][-1]) < 1e-12


def test_a_ball_in_space_with_sliding_rolling_and_drilling():
    """It slides, rolls and spins down, against equations by hand: three laws under one normal reaction."""
    scene, outputs = free_ball(rolling_resistance=d, drilling_resistance=c)
    run = da.compile_model(scene, outputs=outputs).simulate(
        (0, 4), at_once((1.5, 0.3), (2.0, -1.0, 60.0)), {**BODY, "c": 2e-2, "d": 0.01}, rtol=1e-10
    )
    assert run.success
    J, f, lever, spun, R = 0.4 * 0.1**2, 0.2 * 9.81, 0.01 * 9.81, 2e-2 * 9.81, 0.1  # a unit of mass

    def contact_slip(s):
        return np.array([s[2] - R * s[5], s[3] + R * s[4]])  # v + omega x (-r k)

    def sliding(t, s):
        w = contact_slip(s)
        F = -f * w / np.hypot(*w)
        roll = s[4:6] / np.hypot(*s[4:6])
        return [s[2], s[3], *F, R * F[1] / J - lever * roll[0] / J, -R * F[0] / J - lever * roll[1] / J, -spun / J]

    def grips(t, s):
        return np.hypot(*contact_slip(s)) - 1e-9

    grips.terminal = True
    s0 = [0, 0, 1.5, 0.3, 2.0, -1.0, 60.0]
    first = solve_ivp(sliding, (0, 4), s0, events=grips, rtol=1e-11, atol=1e-12, method="DOP853")
    later = [phase for phase in run.phases if phase.modes["table"] == "stick"]
    assert abs(later[0].t0 - first.t[-1]) < 1e-6
    assert later[0].modes == {"table": "stick", "table.rolling": "slip", "table.drilling": "slip"}
    s = first.y[:, -1]
    speed, slowed = np.hypot(s[2], s[3]), lever / R / 1.4
    rolled = first.t[-1] + speed / slowed
    spins = 60 * J / spun
    ends = {phase.t0: phase.modes for phase in later[1:]}
    np.testing.assert_allclose(sorted(ends), sorted([rolled, spins]), atol=1e-6)
    assert run.phases[-1].modes == dict.fromkeys(run.phases[-1].modes, "stick")
    way = s[:2] + s[2:4] / speed * speed**2 / (2 * slowed)
    np.testing.assert_allclose([run["x"][-1], run["y"][-1]], way, atol=1e-6)


def turned(*, carried=False):
    """Return the scene of a ball on the axis of a table that turns with the time, or freely in a drilling contact."""
    W, t = symbols("W", positive=True), dynamicsymbols._t
    turn = dynamicsymbols("turn")
    scene = da.Scene("turned", frame=N, origin=O, coordinates=[z, psi, *([turn] if carried else [])])
    T = N.orientnew("T", "Axis", (turn if carried else W * t, N.z))
    S, G = N.orientnew("S", "Axis", (psi, N.z)), O.locatenew("G", z * N.z)
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, 0, 0, 2 * m * r**2 / 5), G)))
    if carried:
        scene.add_bodies(RigidBody("table", O, T, 1, (inertia(T, 0, 0, m * r**2), O)))
    scene.apply_uniform_gravity(-g * N.z)
    plane = {"plane": (O, T.z), "drilling_resistance": c, "other": "table" if carried else None}
    scene.add_contacts(da.SpherePlane("axis", body="ball", centre=G, radius=r, **plane))
    return scene


def test_a_ball_on_a_turning_table_is_taken_along():
    """2/5 m r^2 w' = c m g until w = W; a free table loses what the ball wins."""
    values = {"m": 0.5, "g": 10, "r": 0.1, "c": 0.01}
    model = da.compile_model(turned(), outputs=["axis.drilling_1"])
    run = model.simulate((0, 1), {z: 0.1, psi: 0, z.diff(): 0, psi.diff(): 0}, {**values, "W": 10})
    assert run.success and abs(run.phases[-1].t0 - 0.4) < 1e-10 and run["psi_dot"][-1] == pytest.approx(10, abs=1e-12)
    assert run["axis.drilling_1"][0] == pytest.approx(0.05, abs=1e-14)
    both = da.compile_model(turned(carried=True))
    start = {z: 0.1, psi: 0, "turn": 0, z.diff(): 0, psi.diff(): 0, "turn_dot": 7}
    run = both.simulate((0, 1), start, values)
    assert run.success and run["psi_dot"][-1] == pytest.approx(5, abs=1e-12)
    assert run.phases[-1].t0 == pytest.approx(5 / 25, abs=1e-10)


def test_what_a_model_says(model):
    assert "rolling resistance floor.rolling_1 about N.z" in model.explain()
    assert model.contacts == ("floor", "floor.rolling")
    assert model.mode(floor="open").layout.unknowns == ()
    for states in ({"floor.rolling": "open"}, {"floor": "open", "floor.rolling": "stick"}):
        with pytest.raises(OptionError, match=r"'floor\.rolling' is a law of friction of 'floor'"):
            model.mode(**states)
    view = da.lagrange(turned())
    assert "sign" in str(view.friction_laws) and "axis.normal" in str(view.friction_laws)


def test_accelerations_are_those_of_the_mode_that_the_state_decides(model):
    p = model.parameter_vector(P)
    rolling = model.accelerations(0.0, [0, 0.1, 0], [1, 0, -10], p)
    slowed = -9.81 * 0.1 / 1.4
    np.testing.assert_allclose(rolling, [slowed, 0, -slowed / 0.1], atol=1e-12)
    np.testing.assert_allclose(model.accelerations(0.0, [0, 0.2, 0], [1, 0, -10], p), [0, -9.81, 0], atol=1e-12)


def test_prepared_runs_and_reductions(model):
    run = model.prepare((0, 4))
    end = run(model.state(start(2.0), P), model.parameter_vector(P))
    assert abs(end[0] - slides_and_rolls(2.0)[2]) < 1e-8
    sweep = model.sweep((0, 4), {**start(2.0), x.diff(): np.array([2.0])}, P, reduce={"top": da.maximum("x_dot")})
    assert sweep.reduced["top"][0] == 2.0


def test_a_smooth_law_of_rolling_creeps():
    scene = da.Scene("smooth", frame=N, origin=O, coordinates=[x, y, theta])
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, 0, 0, 2 * m * r**2 / 5), G)))
    scene.apply_uniform_gravity(-g * N.y)
    smooth = da.CoulombFriction(mu=d, regularization=1e-3)
    floor = {"centre": G, "radius": r, "plane": (O, N.y), "friction": mu, "rolling_resistance": smooth}
    scene.add_contacts(da.SpherePlane("floor", body="ball", **floor))
    run = da.compile_model(scene).simulate((0, 3), start(2.0), {**BODY, "d": 0.01})
    assert run.success and run.phases[-1].modes == {"floor": "stick", "floor.rolling": "smooth"}
    assert abs(run["x"][-1] - slides_and_rolls(2.0)[2]) < 1e-4


@pytest.mark.parametrize(("length", "mass"), [(1e-5, 1e-12), (1e4, 1e9)])
def test_units_do_not_matter(model, length, mass):
    """A ball that bounces, slides, rolls and rests, in other units of length and mass."""
    ends = []
    for L, M in ((1, 1), (length, mass)):
        p = {**P, "r": 0.1 * L, "d": 0.01 * L, "g": 9.81 * L, "m": 0.2 * M, "e": 0.5}
        run = model.simulate((0, 8), start(2.0 * L, 5.0, height=0.15 * L), p, rtol=1e-10, atol=1e-12 * L)
        assert run.success and set(run.phases[-1].modes.values()) == {"stick"}
        ends.append([run["x"][-1] / L, run["theta"][-1], run.phases[-1].t0, len(run.phases)])
    np.testing.assert_allclose(*ends, rtol=1e-9)


def pushed(force, **resistance):
    """Return the model of a ball in a plane that a force pushes."""
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x, y, theta])
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, 0, 0, 2 * m * r**2 / 5), G)))
    scene.add_loads((G, force * N.x - m * g * N.y))
    floor = {"centre": G, "radius": r, "plane": (O, N.y), "friction": (0.5, 0.4), **resistance}
    scene.add_contacts(da.SpherePlane("floor", body="ball", **floor))
    return da.compile_model(scene)


def test_a_ball_starts_to_roll_at_the_static_resistance():
    """At a force 2 d m g / r; then m a 7/5 = k t - d m g / r."""
    model = pushed(k * dynamicsymbols._t, rolling_resistance=(2 * d, d))
    run = model.simulate((0, 3), start(0.0), {"m": 0.2, "g": 9.81, "r": 0.1, "d": 0.01, "k": 0.3}, rtol=1e-10)
    begins, held = 0.2 * 0.2 * 9.81 / 0.3, 0.1 * 0.2 * 9.81
    assert [tuple(phase.modes.values()) for phase in run.phases] == [("stick", "stick"), ("stick", "slip")]
    assert abs(run.phases[1].t0 - begins) < 1e-9
    speed = (0.15 * (9 - begins**2) - held * (3 - begins)) / (1.4 * 0.2)
    assert abs(run["x_dot"][-1] - speed) < 1e-9


def test_resistance_that_depends_on_the_rate():
    """d (1 + exp(-w)), against SciPy."""
    law = da.CoulombFriction(mu=lambda w: d * (1 + exp(-w)))
    run = pushed(0, rolling_resistance=law).simulate((0, 3), start(1.0, -10.0), P_ROLLING, rtol=1e-11)
    still = lambda t, s: s[1] - 1e-12  # noqa: E731
    still.terminal = True
    slowed = lambda t, s: [s[1], -0.981 * (1 + np.exp(-s[1] / 0.1)) / 1.4]  # noqa: E731
    exact = solve_ivp(slowed, (0, 3), [0, 1], events=still, rtol=1e-12, atol=1e-13)
    assert abs(run.phases[-1].t0 - exact.t[-1]) < 1e-9 and abs(run["x"][-1] - exact.y[0, -1]) < 1e-9


def test_backwards_in_time(model):
    run = model.simulate((0, -1), start(1.0, -10.0), P)
    assert run.success and abs(run["x"][-1] + 1 + 0.981 / 2.8) < 1e-9
