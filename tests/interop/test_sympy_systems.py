"""Systems of SymPy as sources: their equations, their names, and what cannot be taken over."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import (
    KanesMethod,
    LagrangesMethod,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    System,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import InitialStateError, SceneError, UnknownNameError
from dalembert.interop import sympy_systems as interop
from dalembert.reduction import FORMULATIONS
from interop.sympy_systems import CASES, rates_function, state_names, sympy_rates

SMALL = [name for name in CASES if name != "bicycle"]
PLAIN = ("double_pendulum_kane", "double_pendulum_system", "four_bar", "spherical_pendulum", "thrown_body")


@pytest.fixture(scope="module", params=SMALL)
def compiled(request):
    case = CASES[request.param]()
    return request.param, case, da.compile_model(case.source, backend="numpy", cache=False)


@pytest.mark.filterwarnings("ignore::dalembert.errors.EnergyWarning")  # a torque on one rod alone has no potential
def test_accelerations_are_those_of_sympy(compiled):
    """At the start and after a while, against SymPy's mass_matrix_full and forcing_full."""
    _, case, model = compiled
    motion = model.simulate((0, 0.6), case.state, case.parameters, rtol=1e-10, atol=1e-12)
    for k in (0, -1):
        values = {name: motion[name][k] for name in motion.names}
        expected = sympy_rates(case, motion.t[k], values)
        second = model.accelerations(motion.t[k], motion.q[k], motion.qdot[k], case.parameters)
        found = {name: motion[f"{name}_dot"][k] for name in model.layout.coordinates}
        found |= {f"{name}_dot": a for name, a in zip(model.layout.coordinates, second, strict=True)}
        aliases = model.layout.aliases
        compared = [name for name in expected if aliases.get(name) in model.layout.rates or name in found]
        assert set(model.layout.coordinates) <= set(compared)
        for name in compared:
            ours = found[name] if name in found else found[aliases[name]]
            assert ours == pytest.approx(expected[name], rel=1e-12, abs=1e-12), name


@pytest.mark.parametrize("name", ["rolling_disc", "rolling_disc_with_contact", "thrown_body"])
def test_speeds_change_as_those_of_sympy(name):
    """Speeds that are no rates: differences of their values along the motion."""
    case = CASES[name]()
    model = da.compile_model(case.source, backend="numpy", cache=False)
    h = 1e-3
    times = h * np.arange(-2, 3)
    motion = model.simulate((0, 0.2), case.state, case.parameters, t_eval=0.1 + times, rtol=1e-12, atol=1e-13)
    expected = sympy_rates(case, 0.1, {key: motion[key][2] for key in motion.names})
    for u in case.source.u:
        values = motion[u]
        slope = (values[0] - 8 * values[1] + 8 * values[3] - values[4]) / (12 * h)
        assert slope == pytest.approx(expected[u.func.__name__], rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("name", ["double_pendulum_kane", "double_pendulum_system", "rolling_disc"])
def test_motion_is_that_of_sympy(name):
    case = CASES[name]()
    model = da.compile_model(case.source, cache=False)
    names = state_names(case.source)
    reference = solve_ivp(
        rates_function(case), (0, 1), [case.state[n] for n in names], "DOP853", rtol=1e-12, atol=1e-13
    )
    motion = model.simulate((0, 1), case.state, case.parameters, rtol=1e-11, atol=1e-13)
    for n, values in zip(names, reference.y, strict=True):
        assert motion[n][-1] == pytest.approx(values[-1], abs=1e-9)


def test_an_upright_disc():
    """Nothing is divided by that SymPy's solved kinematic equations divide by: in the upright state theirs have 0/0."""
    case = CASES["rolling_disc"]()
    state = case.state | {"q1": 0.0, "q2": 0.0, "q3": 0.0, "u1": 0.0, "u3": 0.0}
    motion = da.compile_model(case.source, backend="numpy", cache=False).simulate((0, 1), state, case.parameters)
    assert motion.success
    np.testing.assert_allclose(motion["q3"], 1.3 * motion.t, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(motion["q2"], 0.0, atol=1e-12)


def test_bicycle():
    """Roll and steer accelerations of Meijaard et al. (2007), table 3 and equation (B11), at 4.6 m/s and a roll rate.

    Wheels without orientations, speeds without coordinates, dependent coordinates and speeds in one.
    """
    case = CASES["bicycle"]()
    model = da.compile_model(case.source, backend="numpy", cache=False)
    motion = model.simulate((0, 1e-3), case.state, case.parameters)
    second = dict(
        zip(model.layout.coordinates, model.accelerations(0, motion.q[0], motion.qdot[0], case.parameters), strict=True)
    )
    assert motion["u6"][0] == pytest.approx(4.6 / 0.35, rel=1e-13)
    assert second["roll"] == pytest.approx(-0.105522449805691 * 4.6 * 0.5, rel=1e-12)
    assert second["steer"] == pytest.approx(3.67680523332152 * 4.6 * 0.5, rel=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ["rolling_disc_lagrange", "rolling_disc_with_contact"])
def test_every_formulation(name, formulation):
    np.testing.assert_allclose(end_of(name, formulation), end_of(name, "auto"), rtol=0, atol=1e-7)


@cache
def end_of(name, formulation):
    """Return the coordinates of a system at the end of a motion."""
    case = CASES[name]()
    model = da.compile_model(case.source, formulation=formulation, backend="numpy", cache=False)
    return model.simulate((0, 0.5), case.state, case.parameters, rtol=1e-10, atol=1e-12).q[-1]


def test_two_routes_to_one_pendulum():
    """KanesMethod with its forces, and LagrangesMethod with its energies, less the friction of the latter."""
    kane, lagrange = CASES["double_pendulum_kane"](), CASES["double_pendulum_lagrange"]()
    parameters = {str(key): value for key, value in kane.parameters.items()}
    runs = [
        da.compile_model(kane.source, cache=False).simulate((0, 2), kane.state, parameters, rtol=1e-11),
        da.compile_model(lagrange.source, cache=False).simulate(
            (0, 2), lagrange.state, {**parameters, "c": 0.0}, rtol=1e-11
        ),
    ]
    np.testing.assert_allclose(runs[0].q[-1], runs[1].q[-1], rtol=0, atol=1e-8)
    for run in runs:
        assert np.ptp(run["energy"]) < 1e-8
        assert set(run.invariants) == {"energy"}


@pytest.mark.parametrize("name", SMALL)
def test_positions_are_kept_where_velocities_follow_from_them(name):
    scene = da.Scene.from_sympy(CASES[name]().source)
    assert (not scene.velocities and scene.lagrangian is None) == (name in PLAIN)


@pytest.mark.filterwarnings("ignore::dalembert.errors.EnergyWarning")  # a torque on one rod alone has no potential
def test_weights_become_gravity():
    """So that the energy has its potential; the ground, which does nothing, brings no parameters."""
    case = CASES["double_pendulum_system"]()
    scene = da.Scene.from_sympy(case.source, name="arm")
    assert scene.name == "arm" and scene.gravity == -sp.Symbol("g", positive=True) * scene.frame.y
    assert [body.name for body in scene.bodies] == ["upper", "lower"]
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert set(model.layout.parameters) == {str(key) for key in case.parameters}
    free = {key: 0.0 if str(key) in ("tau", "k") else value for key, value in case.parameters.items()}
    assert np.ptp(model.simulate((0, 1), case.state, free, rtol=1e-10)["energy"]) < 1e-8


def test_speeds_by_name_and_symbol():
    case = CASES["thrown_body"]()
    model = da.compile_model(case.source, backend="numpy", cache=False)
    motion = model.simulate((0, 0.1), case.state, case.parameters)
    np.testing.assert_array_equal(motion[case.source.u[0]], motion["w1"])
    fewer = {key: value for key, value in case.state.items() if key not in ("w2", "w3")}
    with pytest.raises(InitialStateError, match=r"for the rates w2, w3: .* In their place, a_dot, b_dot, c_dot may"):
        model.simulate((0, 1), fewer, case.parameters)
    with pytest.raises(UnknownNameError, match="w3"):
        model.simulate((0, 1), {**case.state, "v": 1.0}, case.parameters)
    sweep = model.sweep((0, 0.1), {**case.state, "w1": np.array([0.5, 0.6])}, case.parameters)
    np.testing.assert_allclose(sweep.final["w1"][0], motion["w1"][-1], rtol=1e-6)


def test_speeds_that_are_rates():
    case = CASES["spherical_pendulum"]()
    model = da.compile_model(case.source, backend="numpy", cache=False)
    motion = model.simulate((0, 0.1), case.state, case.parameters)
    assert motion["u_slide"][0] == motion["q_slide_dot"][0] == motion[case.source.u[-1]][0] == -0.3
    assert "u_slide" in motion.names


def test_textbook_view_of_a_system():
    view = da.lagrange(da.Scene.from_sympy(CASES["double_pendulum_system"]().source))
    q2 = view.coordinates[1]
    assert view.power_coefficient(q2).has(q2)
    with pytest.raises(SceneError, match="came from SymPy with a Lagrangian"):
        da.lagrange(da.Scene.from_sympy(CASES["cartesian_pendulum"]().source))
    scene = da.Scene.from_sympy(CASES["double_pendulum_kane"]().source)
    _, u2 = scene.speeds
    scene.kinematic_equations = (scene.kinematic_equations[0] + u2, scene.kinematic_equations[1])
    with pytest.raises(SceneError, match="has not one speed but 2"):
        da.lagrange(scene)
    with pytest.raises(SceneError, match="not the rates of positions"):
        da.Scene.from_sympy(CASES["rolling_disc"]().source).impose(dynamicsymbols("q1"))


def test_auxiliary_speeds_are_zero():
    """Forces that they bring into evidence have no power."""
    q, u, aux, force = dynamicsymbols("q u aux force")
    m, l, g = sp.symbols("m l g", positive=True)
    N = ReferenceFrame("N")
    A = N.orientnew("A", "Axis", [q, N.z])
    A.set_ang_vel(N, u * N.z)
    pivot = Point("pivot")
    pivot.set_vel(N, aux * N.x)
    end = pivot.locatenew("end", l * A.x)
    end.v2pt_theory(pivot, N, A)
    loads = [(end, m * g * N.x), (pivot, force * N.x)]
    kane = KanesMethod(
        N, [q], [u], [q.diff() - u], u_auxiliary=[aux], bodies=[Particle("bob", end, m)], forcelist=loads
    )
    model = da.compile_model(kane, backend="numpy", cache=False)
    found = model.accelerations(0, [0.3], [0.1], {m: 1, l: 2, g: 9.81})
    assert found == pytest.approx(-9.81 / 2 * np.sin(0.3), rel=1e-14)


def test_velocities_alone():
    """A point that has a velocity and no position, and kinematic equations with factors."""
    q, u = dynamicsymbols("q u")
    m, k = sp.symbols("m k")
    N, P = ReferenceFrame("N"), Point("P")
    P.set_vel(N, u * N.x)
    kane = KanesMethod(N, [q], [u], [q.diff() / 2 - u / 2])
    kane.kanes_equations([Particle("block", P, m)], [(P, -k * q * N.x)])
    motion = da.compile_model(kane, cache=False).simulate((0, 1), {q: 1, u: 0}, {m: 2, k: 8}, rtol=1e-11)
    assert motion[u][-1] == pytest.approx(-2 * np.sin(2.0), abs=1e-9)


def test_what_sympy_hides_is_where_it_was():
    """Two functions read attributes that SymPy does not promise; if it changes, this says so."""
    case = CASES["rolling_disc_with_contact"]()
    hidden = interop._hidden_of_kane(case.source)
    assert len(hidden.kinematic_equations) == 5 and not any(c.has(sp.Pow) for c in hidden.kinematic_equations[3:])
    assert hidden.frame.name == "ground_frame" and len(hidden.nonholonomic) == 2 and hidden.holonomic == ()
    assert all(c.has(*dynamicsymbols("u4 u5")) for c in hidden.nonholonomic[:1])
    q1, q2 = dynamicsymbols("q1:3")
    constraint = q1**2 + q2**2 - 1
    method = LagrangesMethod(q1.diff() ** 2 + q2.diff() ** 2, [q1, q2], hol_coneqs=[constraint])
    assert interop._hidden_of_lagrange(method) == (q1.diff() ** 2 + q2.diff() ** 2, (constraint,))


# -- what cannot be taken over ------------------------------------------------------------------


def _particle(q=None, load=None, **options):
    q = dynamicsymbols("q") if q is None else q
    u, m = dynamicsymbols("u"), sp.Symbol("m")
    N, O = ReferenceFrame("N"), Point("O")
    O.set_vel(N, 0)
    P = O.locatenew("P", q * N.x)
    P.set_vel(N, u * N.x)
    return KanesMethod(
        N,
        [q],
        [u],
        [q.diff() - u],
        bodies=[Particle("P", P, m)],
        forcelist=[(P, load * N.x)] if load else None,
        **options,
    )


def test_other_sources_are_refused():
    with pytest.raises(SceneError, match=r"compile_model takes a Scene, or one of SymPy's System, KanesMethod, Lagr"):
        da.compile_model("pendulum")


def test_a_method_without_bodies():
    q, u = dynamicsymbols("q u")
    with pytest.raises(SceneError, match=r"was given no bodies; give it bodies= and forcelist="):
        da.compile_model(KanesMethod(ReferenceFrame("N"), [q], [u], [q.diff() - u]))


def test_an_actuator_that_is_a_function_of_time():
    with pytest.raises(SceneError, match=r"F\(t\) is a function of time that is no coordinate"):
        da.compile_model(_particle(load=dynamicsymbols("F")))


def test_speeds_fewer_than_coordinates():
    """A quaternion with three speeds."""
    e = dynamicsymbols("e0:4")
    w = dynamicsymbols("w0:3")
    N, B, G = ReferenceFrame("N"), ReferenceFrame("B"), Point("G")
    B.orient(N, "Quaternion", e)
    B.set_ang_vel(N, w[0] * B.x + w[1] * B.y + w[2] * B.z)
    G.set_vel(N, 0)
    matrix = sp.Matrix([[-e[1], -e[2], -e[3]], [e[0], -e[3], e[2]], [e[3], e[0], -e[1]], [-e[2], e[1], e[0]]])
    kdes = list(sp.Matrix(e).diff(dynamicsymbols._t) - matrix * sp.Matrix(w) / 2)
    body = RigidBody("body", G, B, sp.Symbol("m"), (inertia(B, 1, 2, 3), G))
    with pytest.raises(SceneError, match=r"4 kinematic equations tie 3 speeds.*free_orientation"):
        da.compile_model(KanesMethod(N, e, w, kdes, bodies=[body]))


def test_a_lagrangian_of_degree_four():
    q = dynamicsymbols("q")
    with pytest.raises(SceneError, match=r"not of degree two in the rates: dL/dq_dot is not affine"):
        da.compile_model(LagrangesMethod(q.diff() ** 4, [q]))


def test_forces_need_a_frame():
    q = dynamicsymbols("q")
    P = Point("P")
    with pytest.raises(SceneError, match="give it frame="):
        da.compile_model(LagrangesMethod(q.diff() ** 2, [q], forcelist=[(P, ReferenceFrame("N").x)]))


def test_points_that_nothing_is_known_of():
    system = System()
    system.add_bodies(Particle("lost", Point("lost"), sp.Symbol("m")))
    with pytest.raises(SceneError, match=r"SymPy has no velocity of the point 'lost' in .*set_vel"):
        da.compile_model(system)


def test_no_joints_without_positions():
    scene = da.Scene.from_sympy(CASES["cartesian_pendulum"]().source)
    N = da.unknowns("N")
    scene.add_joints(da.Joint("wall", body="bob", at=scene.origin, force=N * scene.frame.x))
    with pytest.raises(SceneError, match="cannot have joints"):
        da.compile_model(scene)
