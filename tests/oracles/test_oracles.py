"""The references checked against each other, and against numbers computed elsewhere."""

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import KanesMethod, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from oracles import chain_recursion
from oracles.cases import SLEIGH_CASES, SPHERE_CASES
from oracles.lagrange_sleigh import sleigh_equations
from oracles.lagrange_sphere import sphere_equations
from oracles.sleigh_exact import sleigh_state
from oracles.sphere_exact import (
    euler_rotation,
    spatial_angular_velocity,
    sphere_state,
    spin,
    theta_range,
)

# Values of the closed form (Chaplygin 1911; Neimark and Fufaev) that an independent 55-digit Taylor
# integration of the sleigh in coordinates of the mass centre, with a multiplier, confirms to every digit.
# Parameters: m, b, I_cm, x, y, theta, v, omega at time 0; rows: t, x, y, theta, v, omega.
SLEIGH_REFERENCES = {
    "nearly balanced": (
        ("1", "1e-8", "0.5", "0", "0", "1.5", "1", "1"),
        [
            (
                "1",
                "-0.39902284269092191448788760661640603335091313000924",
                "0.87188082329353832823320962845274011663492348881493",
                "2.4999999900000000333333358333333043333328566666791",
                "1.0000000099999998000000020000000399999987466666688",
                "0.9999999800000001000000059999998949999990066667161",
            ),
            (
                "10",
                "-1.8729478948556030398324138171730375008090179483981",
                "-0.41256688281253465748143371925166257645640816722957",
                "11.499999000000033333338533332413333388626670219999",
                "1.0000000999999800000020000000039999670666715191998",
                "0.99999980000001000000203999954400003345866904199912",
            ),
            (
                "100",
                "-0.17320924902426964481053518061132138778789514747135",
                "-0.49544214555785025821329055763244943759618232993958",
                "101.49990000003333338335324331338998669272123387068",
                "1.0000009999980000020000000003967990714671978644529",
                "0.99999800000100000200039549940339946868939171081505",
            ),
        ],
    ),
    "turning on the spot": (
        ("1", "0.2", "0.05", "0", "0", "0.3", "0", "3"),
        [
            (
                "1",
                "-0.09054534687401471431881401546166419633253385402109",
                "0.53417467191562365419314512407086089633192118744161",
                "2.2526405040690226498142343950485669328341169560784",
                "0.86762482206823519555177235169083083522952697861684",
                "0.7974066865022390763625882194596669145923479632968",
            ),
            (
                "3",
                "-1.5777781746975774301826942556332036981543757626244",
                "1.516731760540528897540825259982167148147151626661",
                "2.6487582488922694527990693497603916355810093993136",
                "0.89998894048571601350791396711970885878324625817945",
                "0.014872421680681136190938635306486356507154870152131",
            ),
        ],
    ),
}

# exp(t [omega]) R(0), confirmed by Taylor integration of R' = [omega] R. psi and phi are known modulo 2 pi.
SPHERE_START = {"psi": "0.4", "theta": "1.1", "phi": "-0.3", "omega": ("0.7", "-1.2", "0.9")}
SPHERE_REFERENCES = [  # t, psi, theta, phi, x/r, y/r
    (
        "1",
        "0.650557109325501559027257824068",
        "1.10479067305875005616584101823",
        "1.2301384880178052921656607372",
        "-1.2",
        "-0.7",
    ),
    (
        "10",
        "0.529189839372558888606104916417",
        "0.843913817264744620231088333672",
        "-2.66139192147599348246990125405",
        "-12.0",
        "-7.0",
    ),
    (
        "100",
        "0.698758904114297850424542214372",
        "1.0409281528547486061260728725",
        "1.71279377384726440038676506682",
        "-120.0",
        "-70.0",
    ),
]


def random_states(n_q, count=20, seed=1):
    """Return coordinates and rates of shape (count, n_q)."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (count, n_q)), rng.uniform(-2, 2, (count, n_q))


# --- the Chaplygin sleigh ----------------------------------------------------------------------


@pytest.mark.parametrize("name", SLEIGH_REFERENCES)
def test_sleigh_closed_form_equals_the_published_digits(name):
    """All digits given, positions by quadrature included."""
    (m, b, I_cm, *start), rows = SLEIGH_REFERENCES[name]
    with mp.workdps(60):
        I_C = mp.mpf(I_cm) + mp.mpf(m) * mp.mpf(b) ** 2
        for t, *expected in rows:
            state = sleigh_state(t, m, b, I_C, *start)
            values = state.x, state.y, state.theta, state.v, state.omega
            for value, digits in zip(values, expected, strict=True):
                assert abs(value - mp.mpf(digits)) < mp.mpf("1e-38") * max(1, abs(value))


@pytest.mark.parametrize(
    ("m", "b", "I_C", "v", "omega"),
    [
        (1, 0.3, 0.5, 1, 2),
        (2, 0.4, 0.9, -1.2, -0.4),
        (1.3, -0.2, 0.8, 0.5, -0.9),
        (1, 0, 0.5, 1, 2),
        (1, 0.3, 0.5, -1, 0),
    ],
)
def test_sleigh_closed_form_solves_the_reduced_equations(m, b, I_C, v, omega):
    """The derivatives in time, by differences in high precision, at both signs of time."""
    with mp.workdps(50):
        m, b, I_C, h = mp.mpf(m), mp.mpf(b), mp.mpf(I_C), mp.mpf("1e-12")
        for t in (mp.mpf("-0.7"), mp.mpf("1.9")):
            here, before, after = (sleigh_state(s, m, b, I_C, 0.1, -0.2, 0.3, v, omega) for s in (t, t - h, t + h))
            expected = {
                "x": here.v * mp.cos(here.theta),
                "y": here.v * mp.sin(here.theta),
                "theta": here.omega,
                "v": b * here.omega**2,
                "omega": -m * b * here.v * here.omega / I_C,
            }
            for name, rate in expected.items():
                slope = (getattr(after, name) - getattr(before, name)) / (2 * h)
                assert abs(slope - rate) < 1e-20


def test_sleigh_operator_is_the_text_equations_4_to_6():
    """The Lagrange operator on T gives the printed left-hand sides."""
    equations = sleigh_equations()
    (_, _, theta), (_, _, dtheta), (ddx, ddy, ddtheta) = equations.q, equations.qdot, equations.qddot
    m, b, I_C = equations.p
    sin, cos = sp.sin(theta), sp.cos(theta)
    printed = [
        m * (ddx - b * ddtheta * sin - b * dtheta**2 * cos),
        m * (ddy + b * ddtheta * cos - b * dtheta**2 * sin),
        I_C * ddtheta + m * b * (-ddx * sin + ddy * cos),
    ]
    assert (equations.operator - sp.Matrix(printed)).expand() == sp.zeros(3, 1)


def test_sleigh_accelerations_are_the_text_equations_of_motion():
    """Eliminating X, Y, N by the saddle-point system gives the last display of example 13.4.6."""
    p = {"m": 1.7, "b": 0.4, "I_C": 0.9}
    for q, qdot in zip(*random_states(3), strict=True):
        theta, dtheta, v = q[2], qdot[2], qdot[0]
        dx, dy = v * np.cos(theta), v * np.sin(theta)
        qddot, reaction = sleigh_equations().accelerations(q, np.array([dx, dy, dtheta]), p)
        expected = [
            p["b"] * dtheta**2 * np.cos(theta) - dx * dtheta * np.tan(theta),
            p["b"] * dtheta**2 * np.sin(theta) + dx * dtheta,
            -p["m"] * p["b"] * dtheta * v / p["I_C"],
        ]
        np.testing.assert_allclose(qddot, expected, rtol=1e-12, atol=1e-12)
        blade = p["m"] * v * dtheta * (1 - p["m"] * p["b"] ** 2 / p["I_C"])
        expected = [-blade * np.sin(theta), blade * np.cos(theta), 0]
        np.testing.assert_allclose(reaction, expected, rtol=1e-12, atol=1e-12)


def test_sleigh_equations_integrate_to_the_closed_form():
    """DOP853 on the saddle-point equations, from T alone, ends at the closed form."""
    p = {"m": 1.0, "b": 0.3, "I_C": 0.5}
    start = sleigh_state(0, *p.values(), 0, 0, 0.2, 1, 2)
    q, qdot = integrate(sleigh_equations(), start.q, start.qdot, 4.0, p)
    end = sleigh_state(4, *p.values(), 0, 0, 0.2, 1, 2)
    np.testing.assert_allclose(q, end.q, atol=1e-11)
    np.testing.assert_allclose(qdot, end.qdot, atol=1e-11)


def test_sleigh_cases_do_what_their_names_say():
    """One turns past pi/2, where the text's equations of motion divide by zero; one reverses; one neither."""
    times = np.linspace(0, 10, 11)
    exact = {case.name: [case.exact(t) for t in times] for case in SLEIGH_CASES}
    theta = {name: np.array([float(state.theta) for state in states]) for name, states in exact.items()}
    v = {name: np.array([float(state.v) for state in states]) for name, states in exact.items()}
    assert theta["past pi/2"][0] < np.pi / 2 < theta["past pi/2"][-1]
    assert v["backwards"][0] < 0 < v["backwards"][-1]
    assert np.abs(theta["generic"]).max() < np.pi / 2
    assert v["generic"].min() > 0


# --- the rolling sphere ------------------------------------------------------------------------


@pytest.mark.parametrize("row", SPHERE_REFERENCES, ids=lambda row: f"t={row[0]}")
def test_sphere_closed_form_equals_the_published_digits(row):
    """Angles modulo 2 pi, and the centre."""
    with mp.workdps(45):
        t, psi, theta, phi, x, y = map(mp.mpf, row)
        coordinates = sphere_state(t, 2, 0, 0, **SPHERE_START).coordinates
        differences = np.array(coordinates) - np.array([2 * x, 2 * y, psi, theta, phi])
        for difference, period in zip(differences, (0, 0, 2 * mp.pi, 0, 2 * mp.pi), strict=True):
            turns = mp.nint(difference / period) if period else 0
            assert abs(difference - turns * period) < 1e-27  # the references carry 30 digits


def test_sphere_angles_are_continuous_and_rebuild_the_rotation():
    """No jump between close times over many turns; R(psi, theta, phi) is exp(t [omega]) R(0)."""
    start = {"psi": 0.4, "theta": 1.1, "phi": -0.3}
    omega = (0.2, 0.6, -1.9)
    angles = []
    for t in np.linspace(0, 10, 41):
        state = sphere_state(t, 1, 0, 0, **start, omega=omega)
        angles.append(state.q[2:])
        with mp.workdps(40):
            exact = spin(omega, mp.mpf(t)) * euler_rotation(*start.values())
            assert mp.mnorm(euler_rotation(*state.coordinates[2:]) - exact) < 1e-35
    assert np.abs(np.diff(angles, axis=0)).max() < 2
    assert abs(angles[-1][0] - angles[0][0]) > 2 * np.pi
    low, high = theta_range(start["psi"], start["theta"], omega)
    thetas = np.array(angles)[:, 1]
    assert low <= thetas.min() < low + 0.05
    assert high - 0.05 < thetas.max() <= high


def test_sphere_rates_are_the_slopes_of_the_coordinates():
    """Differences in high precision; and back to the angular velocity."""
    omega = (0.2, 0.6, -1.9)
    with mp.workdps(45):
        t, h = mp.mpf("3.3"), mp.mpf("1e-12")
        here, before, after = (sphere_state(s, 0.7, 1, 2, 0.4, 1.1, -0.3, omega) for s in (t, t - h, t + h))
        for rate, low, high in zip(here.rates, before.coordinates, after.coordinates, strict=True):
            assert abs((high - low) / (2 * h) - rate) < 1e-20
    np.testing.assert_allclose(spatial_angular_velocity(here.q, here.qdot), omega, rtol=1e-14)


@pytest.mark.parametrize("case", SPHERE_CASES, ids=lambda case: case.name)
def test_sphere_cases_stay_away_from_the_vertical(case):
    """At all times, hence over the run."""
    start = case.exact(0)
    low, high = theta_range(*start.coordinates[2:4], spatial_angular_velocity(start.q, start.qdot))
    assert 0.7 < low < high < np.pi - 0.7


def test_sphere_near_the_vertical_is_refused():
    """The angles have no meaning at theta = 0."""
    with pytest.raises(ValueError, match="theta ranges over"):
        sphere_state(1, 1, 0, 0, 0.4, 1, -0.3, (-np.cos(0.4), -np.sin(0.4), 0))


def test_sphere_operator_is_the_text_equations_1_to_5():
    """The Lagrange operator on T gives the printed left-hand sides."""
    equations = sphere_equations()
    (_, _, _, theta, _), (_, _, dpsi, dtheta, dphi) = equations.q, equations.qdot
    ddx, ddy, ddpsi, ddtheta, ddphi = equations.qddot
    m, r = equations.p
    sin, cos = sp.sin(theta), sp.cos(theta)
    I = sp.Rational(2, 5) * m * r**2
    printed = [
        m * ddx,
        m * ddy,
        I * (ddpsi + ddphi * cos - dphi * dtheta * sin),
        I * (ddtheta + dpsi * dphi * sin),
        I * (ddphi + ddpsi * cos - dpsi * dtheta * sin),
    ]
    assert (equations.operator - sp.Matrix(printed)).expand() == sp.zeros(5, 1)


def test_sphere_rolls_without_friction_force():
    """The saddle-point system at random rolling states: no reaction, the centre not accelerated."""
    p = {"m": 1.7, "r": 0.6}
    for q, qdot in zip(*random_states(5), strict=True):
        omega = spatial_angular_velocity(q, qdot)
        qdot[:2] = p["r"] * omega[1], -p["r"] * omega[0]
        np.testing.assert_allclose(sphere_equations().constraint_jacobian(q, p) @ qdot, 0, atol=1e-14)
        qddot, reaction = sphere_equations().accelerations(q, qdot, p)
        scale = np.abs(qddot).max()
        np.testing.assert_allclose(reaction, 0, atol=1e-13 * scale)
        np.testing.assert_allclose(qddot[:2], 0, atol=1e-13 * scale)


def test_sphere_equations_integrate_to_the_closed_form():
    """DOP853 on the saddle-point equations, from T alone, ends at the closed form."""
    p = {"m": 1.3, "r": 0.5}
    start, end = (sphere_state(t, p["r"], 0.1, 0.2, **SPHERE_START) for t in (0, 4))
    q, qdot = integrate(sphere_equations(), start.q, start.qdot, 4.0, p)
    np.testing.assert_allclose(q, end.q, atol=1e-10)
    np.testing.assert_allclose(qdot, end.qdot, atol=1e-10)


def integrate(equations, q, qdot, duration, p):
    """Return q and qdot after `duration`."""
    n_q = len(q)

    def rhs(_, y):
        return np.concatenate([y[n_q:], equations.accelerations(y[:n_q], y[n_q:], p)[0]])

    run = solve_ivp(rhs, (0, duration), np.concatenate([q, qdot]), method="DOP853", rtol=1e-12, atol=1e-13)
    return run.y[:n_q, -1], run.y[n_q:, -1]


# --- serial chains -----------------------------------------------------------------------------


def chain_case(kind, n, seed=3):
    """Return q, qdot and the remaining arguments of a chain's functions."""
    rng = np.random.default_rng(seed)
    inertias = rng.uniform(0.1, 0.6, n if kind == "planar" else (n, 3))
    q, qdot = rng.uniform(-3, 3, n), rng.uniform(-2, 2, n)
    return q, qdot, (rng.uniform(0.5, 2, n), rng.uniform(0.4, 1.5, n), inertias, 9.81)


@pytest.mark.parametrize("kind", ["planar", "spatial"])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 20])
def test_chain_terms_equal_the_lagrange_operator_on_its_energies(kind, n):
    """M by polarization of T, forcing from derivatives of T and V by the complex step."""
    q, qdot, rest = chain_case(kind, n)
    terms = getattr(chain_recursion, f"{kind}_chain")
    energies = getattr(chain_recursion, f"{kind}_energies")
    unit, h = np.eye(n), 1e-30

    def kinetic(q, qdot):
        return energies(q, qdot, *rest)[0]

    def mass_matrix(q):
        single = np.array([kinetic(q, e) for e in unit])
        return np.array([[kinetic(q, unit[i] + unit[j]) for j in range(n)] for i in range(n)]) - (
            single[:, None] + single[None, :]
        )

    M, forcing = terms(q, qdot, *rest)
    np.testing.assert_allclose(M, mass_matrix(q), rtol=1e-12, atol=1e-12 * np.abs(M).max())
    M_dot = mass_matrix(q + 1j * h * qdot).imag / h
    dL_dq = np.array([(T - V).imag / h for T, V in (energies(q + 1j * h * e, qdot, *rest) for e in unit)])
    np.testing.assert_allclose(forcing, dL_dq - M_dot @ qdot, rtol=1e-11, atol=1e-12 * np.abs(M).max())


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_chain_conventions_are_those_of_the_sympy_scene(kind):
    """Kane's method on the scene written in the module's docstring, four links."""
    n = 4
    q_values, qdot_values, (masses, lengths, inertias, g) = chain_case(kind, n)
    terms = getattr(chain_recursion, f"{kind}_chain")
    M, forcing = terms(q_values, qdot_values, masses, lengths, inertias, g)

    q, u, t = dynamicsymbols(f"q:{n}"), dynamicsymbols(f"u:{n}"), dynamicsymbols._t
    N, O = ReferenceFrame("N"), Point("O")
    O.set_vel(N, 0)
    frame, joint, bodies, loads = N, O, [], []
    down = -g * (N.y if kind == "planar" else N.z)
    for i in range(n):
        axis = frame.z if kind == "planar" else (frame.z, frame.y, frame.x)[i % 3]
        moments = (0, 0, inertias[i]) if kind == "planar" else inertias[i]
        frame = frame.orientnew(f"E{i + 1}", "Axis", (q[i], axis))
        frame.set_ang_vel(N, frame.ang_vel_in(N).subs({q[j].diff(t): u[j] for j in range(n)}))
        G = joint.locatenew(f"G{i}", lengths[i] / 2 * frame.x)
        G.v2pt_theory(joint, N, frame)
        bodies.append(RigidBody(f"link{i}", G, frame, masses[i], (inertia(frame, *moments), G)))
        loads.append((G, masses[i] * down))
        end = joint.locatenew(f"P{i + 1}", lengths[i] * frame.x)
        end.v2pt_theory(joint, N, frame)
        joint = end
    kane = KanesMethod(N, q, u, [u_i - q_i.diff(t) for q_i, u_i in zip(q, u, strict=True)])
    kane.kanes_equations(bodies, loads)
    at = dict(zip((*q, *u), (*q_values, *qdot_values), strict=True))
    np.testing.assert_allclose(M, np.array(kane.mass_matrix.subs(at), float), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(forcing, np.array(kane.forcing.subs(at), float)[:, 0], rtol=1e-11, atol=1e-12)
