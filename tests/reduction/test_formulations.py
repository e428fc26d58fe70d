"""All formulations end at the same place; what each promises of the constraints; gains; the comparison of them."""

import functools

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import fsolve
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import FormulationError, MissingExtraError, OptionError
from dalembert.reduction import FORMULATIONS
from dalembert.reduction.stabilised import DEFAULT_GAIN, GAINS
from dalembert.starts.inputs import constants
from dalembert.steps.problem import IntegrationProblem
from scene.builders import cartesian_pendulum, double_pendulum, four_bar, quaternion_body

PENDULUM = {"m": 1.0, "l": 1.0, "g": 9.81}
HORIZONTAL = {"x": 1.0, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0}
BARS = {"m": 1.0, "l1": 1.0, "l2": 2.0, "l3": 1.5, "r": 2.0, "g": 9.81}
SLEIGH = {"m": 1.0, "b": 0.3, "I_C": 0.5}
SLEIGH_START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}


@functools.cache
def bars_start():
    def closing(z):
        a = np.cumsum([0.9, *z])
        return [np.cos(a) @ [1, 2, 1.5] - 2, np.sin(a) @ [1, 2, 1.5]]

    q2, q3 = fsolve(closing, [-0.5, -2], xtol=1e-14)
    return {"q1": 0.9, "q2": q2, "q3": q3, "q1_dot": 1.0}


SCENES = {
    "sleigh": (da.scenes.chaplygin_sleigh, SLEIGH_START, SLEIGH, 5.0),
    "pendulum": (cartesian_pendulum, HORIZONTAL, PENDULUM, 3.0),
    "four-bar": (four_bar, bars_start, BARS, 2.0),
    "top": (
        quaternion_body,
        {"x": 0, "y": 0, "z": 0, "x_dot": 0.1, "y_dot": 0, "z_dot": 0.2}
        | dict(zip(("e0", "e1", "e2", "e3"), np.array([0.7, 0.1, 0.5, 0.5]), strict=True))
        | {"e1_dot": 0.3, "e2_dot": 0.1, "e3_dot": -0.2},
        {"m": 1.1, "g": 9.81, "k": 0.2, "A": 1.0, "B": 1.7, "C": 2.3},
        2.0,
    ),
}


@functools.cache
def compiled(scene, formulation, backend="llvm"):
    try:
        return da.compile_model(SCENES[scene][0](), backend=backend, formulation=formulation)
    except FormulationError:
        return None


def simulate(scene, formulation, backend="llvm", **options):
    _, start, parameters, end = SCENES[scene]
    model = compiled(scene, formulation, backend)
    if model is None:
        return None
    run = model.simulate((0, end), start() if callable(start) else start, parameters, **options)
    assert run.success, run.message
    return run


@functools.cache
def reference(scene):
    return simulate(scene, "projected", method="dop853", rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("scene", SCENES)
def test_formulations_end_at_the_same_place(scene, formulation):
    run = simulate(scene, formulation, rtol=1e-9, atol=1e-10)
    if run is None:
        assert formulation == "minimal" and scene != "sleigh"
        return
    np.testing.assert_allclose(run.q[-1], reference(scene).q[-1], atol=1e-6)
    np.testing.assert_allclose(run.qdot[-1], reference(scene).qdot[-1], atol=1e-5)


@pytest.mark.parametrize("formulation", ["baumgarte", "ggl"])
def test_the_plain_reference_agrees(formulation):
    run = simulate("pendulum", formulation, "numpy", rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(run.q[-1], reference("pendulum").q[-1], atol=1e-5)
    times = np.array([0.0, 0.5, 2.9, 3.0])
    sampled = simulate("pendulum", formulation, "numpy", rtol=1e-7, atol=1e-8, t_eval=times)
    np.testing.assert_allclose(sampled.q, run(times).q, atol=1e-9)


def test_violations_over_a_long_run():
    """Projected steps hold to rounding, ggl to Newton's tolerance, baumgarte to some steps' error; the rest drifts."""
    worst = {}
    for formulation in ("projected", "ggl", "baumgarte", "augmented"):
        model = compiled("pendulum", formulation)
        method = "radau" if formulation == "ggl" else "taylor"
        run = model.simulate((0, 200), HORIZONTAL, PENDULUM, rtol=1e-6, atol=1e-7, method=method)
        worst[formulation] = np.abs(run.constraint_violation).max()
    assert worst["projected"] < 1e-14
    assert worst["ggl"] < 1e-8
    assert worst["baumgarte"] < 1e-7
    assert worst["augmented"] > 30 * worst["baumgarte"]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_ggl_holds_positions_and_velocities_as_the_tolerance_asks(tolerance):
    run = simulate("four-bar", "ggl", rtol=tolerance, atol=tolerance)
    assert np.abs(run.constraint_violation).max() < tolerance
    assert np.abs(run.velocity_violation).max() < tolerance
    assert np.abs(run.q[-1] - reference("four-bar").q[-1]).max() < 10 * tolerance


def test_ggl_is_for_implicit_methods():
    model = compiled("pendulum", "ggl")
    assert model.methods == ("radau",)
    with pytest.raises(OptionError, match=r"taylor.*radau"):
        model.simulate((0, 1), HORIZONTAL, PENDULUM, method="taylor")
    try:
        with pytest.raises(FormulationError, match="'ggl'"):
            da.compile_model(cartesian_pendulum(), backend="jax", formulation="ggl")
    except MissingExtraError:
        pytest.skip("the extra for jax is not installed")


def test_ggl_without_constraints_is_ordinary():
    model = da.compile_model(double_pendulum(True), formulation="ggl")
    assert set(model.methods) > {"radau", "taylor"}


@pytest.mark.parametrize("formulation", ["baumgarte", "ggl"])
def test_sweeps_are_single_runs(formulation):
    model, lengths = compiled("pendulum", formulation), np.array([1.0, 1.3, 0.8])
    start = {**HORIZONTAL, "x": lengths}
    given = {**PENDULUM, "l": lengths}
    if formulation == "baumgarte":
        given |= {"baumgarte_alpha": 4.0, "baumgarte_beta": 5.0}
    options = {"rtol": 1e-7, "atol": 1e-8, "method": "radau" if formulation == "ggl" else "taylor"}
    sweep = model.sweep((0, 2), start, given, **options)
    assert np.all(sweep.status == 0)
    for i, length in enumerate(lengths):
        single = model.simulate((0, 2), {**HORIZONTAL, "x": length}, {**given, "l": length}, **options)
        np.testing.assert_allclose(sweep.final["y"][i], single["y"][-1], rtol=1e-12)


def car_axis():
    """Two wheels on a bar that a moving ground tilts (test set for IVP solvers): its constraints depend on time."""
    xl, yl, xr, yr = q = dynamicsymbols("xl yl xr yr")
    N, O = ReferenceFrame("N"), Point("O")
    mass, ground = sp.Rational(1, 2000), sp.sin(10 * dynamicsymbols._t) / 10
    reach = sp.sqrt(1 - ground**2)
    scene = da.Scene("car_axis", frame=N, origin=O, coordinates=q)
    left, right = O.locatenew("left", xl * N.x + yl * N.y), O.locatenew("right", xr * N.x + yr * N.y)
    scene.add_bodies(Particle("left", left, mass), Particle("right", right, mass))
    for wheel, spring in ((left, xl * N.x + yl * N.y), (right, (xr - reach) * N.x + (yr - ground) * N.y)):
        length = sp.sqrt(spring.dot(spring))
        scene.add_loads((wheel, (sp.Rational(1, 2) - length) / length * spring - mass * N.y))
    scene.add_holonomic_constraints(reach * xl + ground * yl, (xl - xr) ** 2 + (yl - yr) ** 2 - 1)
    return scene


@pytest.mark.parametrize("formulation", ["projected", "baumgarte", "ggl"])
def test_constraints_that_depend_on_time(formulation):
    """Against a reference of 26 digits at t = 3."""
    start = {"xl": 0, "yl": 0.5, "xr": 1, "yr": 0.5, "xl_dot": -0.5, "xr_dot": -0.5, "yl_dot": 0, "yr_dot": 0}
    positions = [0.04934557842752409, 0.4969894602300681, 1.041742524885426, 0.3739110272653162]
    rates = [-0.07705836840359208, 0.007446866592068417, 0.01755681575354174, 0.7703410437796011]
    method = "radau" if formulation == "ggl" else "dop853"
    model = da.compile_model(car_axis(), formulation=formulation)
    run = model.simulate((0, 3), start, {}, method=method, rtol=1e-9, atol=1e-9)
    assert run.success
    np.testing.assert_allclose(run.q[-1], positions, atol=1e-8)
    np.testing.assert_allclose(run.qdot[-1], rates, atol=1e-7)


# -- gains --------------------------------------------------------------------------------


def test_gains_pull_violations_back_at_their_rate():
    """From a start off the constraint, phi'' + 2 alpha phi' + beta^2 phi = 0 with phi' = 0 at first."""
    alpha = beta = 3.0
    model = da.compile_model(cartesian_pendulum(), formulation="baumgarte", gains=(alpha, beta))
    assert not set(GAINS) & set(model.layout.parameters)
    y0 = np.array([1.001, 0.0, 0.0, 0.0])
    c = constants(model.stages.program, model.parameter_vector(PENDULUM))
    problem = IntegrationProblem(t0=0.0, t1=1.0, y0=y0, constants=c, rtol=1e-11, atol=1e-12)
    y = model.engine.integrate(problem, "taylor").y[-1]  # of no run, which would refuse the start
    expected = (1.001**2 - 1) / 2 * (1 + alpha) * np.exp(-alpha)
    assert (y[0] ** 2 + y[1] ** 2 - 1) / 2 == pytest.approx(expected, rel=1e-7)


def test_gains_are_parameters_unless_given_with_the_formulation():
    model = compiled("pendulum", "baumgarte")
    assert model.layout.parameters[-2:] == GAINS
    p = model.parameter_vector(PENDULUM)
    assert list(p[-2:]) == [DEFAULT_GAIN, DEFAULT_GAIN]
    given = {**PENDULUM, "baumgarte_alpha": 3.0, "baumgarte_beta": 3.0}
    by_parameter = model.simulate((0, 2), HORIZONTAL, given, method="dop853")
    fixed = da.compile_model(cartesian_pendulum(), formulation="baumgarte", gains=(3, 3))
    np.testing.assert_allclose(
        by_parameter.q[-1], fixed.simulate((0, 2), HORIZONTAL, PENDULUM, method="dop853").q[-1], atol=1e-10
    )


def test_gains_left_out_follow_the_steps():
    """Tighter tolerances take smaller steps and so larger gains, which the drift of a plain run does not have."""
    model = compiled("pendulum", "baumgarte")
    drift = {
        gain: np.abs(
            model.simulate((0, 20), HORIZONTAL, {**PENDULUM, **gains}, method="tsit5", rtol=1e-6).constraint_violation
        ).max()
        for gain, gains in {"chosen": {}, "none": dict.fromkeys(GAINS, 0.0)}.items()
    }
    assert drift["chosen"] < drift["none"] / 20


@pytest.mark.parametrize("gains", [3.0, (1, 2, 3), (1.0, -1.0), (np.inf, 1.0), ("a", "b")])
def test_gains_that_are_no_gains_are_refused(gains):
    with pytest.raises(OptionError, match="gains"):
        da.compile_model(cartesian_pendulum(), formulation="baumgarte", gains=gains)


def test_gains_of_another_formulation_are_refused():
    with pytest.raises(OptionError, match="'baumgarte', not of 'projected'"):
        da.compile_model(cartesian_pendulum(), formulation="projected", gains=(1, 1))


# -- comparison ---------------------------------------------------------------------------


def test_comparison_has_a_row_for_every_formulation():
    table = compiled("pendulum", "projected").compare_formulations((0, 10), HORIZONTAL, PENDULUM)
    assert [row.formulation for row in table] == list(FORMULATIONS)
    assert table["minimal"].status == "not supported" and "gives no coordinate" in table["minimal"].note
    for name in set(FORMULATIONS) - {"minimal"}:
        row = table[name]
        assert row.status == "SUCCESS" and row.steps > 10 and 0 < row.error < 1e-5 and row.seconds > 0
        assert row.energy_drift < 1e-4 and 0 <= row.rejected < row.steps
        assert row.velocity_violation < (1e-12 if name == "projected" else 1e-5)
    assert table["projected"].position_violation < 1e-14 < table["augmented"].position_violation
    text = str(table)
    assert all(name in text for name in FORMULATIONS) and "error est." in text
    assert table.to_dict()["formulation"] == list(FORMULATIONS)


def test_comparison_of_some_formulations_with_a_method_each():
    model = compiled("sleigh", "minimal")
    table = model.compare_formulations(
        (0, 5), SLEIGH_START, SLEIGH, formulations=["minimal", "projected"], method={"projected": "dop853"}
    )
    assert [(row.formulation, row.method) for row in table] == [("minimal", "taylor"), ("projected", "dop853")]
    with pytest.raises(KeyError, match="was not compared"):
        table["ggl"]
    with pytest.raises(OptionError, match="unknown formulation 'minimum'"):
        model.compare_formulations((0, 5), SLEIGH_START, SLEIGH, formulations=["minimum"])


@pytest.mark.filterwarnings("ignore::dalembert.errors.PrecisionWarning")
@pytest.mark.parametrize("rtol", [1e-10, 1e-12])
def test_ggl_of_nearly_dependent_constraints(rtol):
    """Rounding moves the multipliers of two surfaces that nearly touch far along a direction that moves nothing."""
    x, y, z, m, g, e = *dynamicsymbols("x y z"), *sp.symbols("m g e", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    bead = O.locatenew("bead", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("bead", N, O, [x, y, z])
    scene.add_bodies(Particle("bead", bead, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(z, z + e * (x**2 + y**2 - 1))
    begin = (0, 5), {"x": 0.6, "y": -0.8, "z": 0, "x_dot": 0.8, "y_dot": 0.6}, {"m": 1, "g": 9.81, "e": 1e-4}
    run = da.compile_model(scene, formulation="ggl").simulate(*begin, rtol=rtol, atol=rtol, max_steps=20_000)
    assert run.success, run.message
    assert run.stats.rejected < 20
    truth = da.compile_model(scene, formulation="projected").simulate(*begin, rtol=1e-13, atol=1e-13)
    assert abs(run["x"][-1] - truth["x"][-1]) < 1e-9
