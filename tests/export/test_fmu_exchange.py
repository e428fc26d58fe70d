"""Model exchange: units whose state an integrator of the importer moves, and their directional derivatives."""

import ctypes

import numpy as np
import pytest
from sympy import sign, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from export.test_c_simulators import driven
from export.units import VERSIONS, Unit, unpacked
from hard_cases import hard_case

MASS = {"initial": {"x": 0.1, "x_dot": 0, "z": 0.3}, "parameters": {"k": 2.0, "m": 1.5}}
SLEIGH = {
    "initial": {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0},
    "parameters": {"m": 1, "b": 0.3, "I_C": 0.5},
}
TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}

both_versions = pytest.mark.parametrize("version", VERSIONS)


@pytest.fixture(scope="module")
def mass_model():
    return da.compile_model(driven(), outputs=["x_ddot"])


@pytest.fixture(scope="module")
def sleigh_model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["Y"])


@pytest.fixture(scope="module")
def pendulum():
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    return case.compile("projected"), {"initial": case.initial, "parameters": case.parameters}


def exchanged(model, path, **options):
    """Export a unit; return an instance of it for model exchange, before it is initialized."""
    return Unit(*unpacked(model, path, **options), exchange=True)


@both_versions
@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_sleigh_moves_as_in_simulate(tmp_path, sleigh_model, version, method):
    """Whatever steps the unit takes in co-simulation: those of model exchange are the importer's."""
    unit = exchanged(sleigh_model, tmp_path / "a.fmu", fmi=version, method=method, **SLEIGH, **TOLERANCES)
    assert unit.begin(0.0) == 0 and unit.updated() == (False, False)
    assert unit.call("EnterContinuousTimeMode") == 0
    unit.integrate(0.0, 2.0, 2000)
    run = sleigh_model.simulate((0, 2), **SLEIGH, t_eval=[2.0], rtol=1e-12, atol=1e-14)
    for name in ("x", "y", "theta", "x_dot", "y_dot", "theta_dot", "Y"):
        assert unit.get(name) == pytest.approx(run[name][-1], rel=1e-10, abs=1e-10)
    layout = sleigh_model.layout
    state = [unit.get(name) for name in layout.state]
    np.testing.assert_array_equal(state, unit.vector("GetContinuousStates"))
    rates = [unit.get(f"der({name})") for name in layout.state]
    np.testing.assert_array_equal(rates, unit.vector("GetContinuousStateDerivatives"))
    np.testing.assert_array_equal(unit.vector("GetNominalsOfContinuousStates"), 1e-12 / 1e-10)


@both_versions
def test_inputs_and_parameters_are_the_importers(tmp_path, mass_model, version):
    unit = exchanged(mass_model, tmp_path / "a.fmu", fmi=version, **MASS)
    assert unit.begin(0.0, m=3.0, x_start=0.2) == 0
    unit.integrate(0.0, 1.5, 600, lambda unit, t: unit.set("force", 0.5 + 0.5 * t))
    force = da.samples([0, 2], [0.5, 1.5], kind="linear")
    initial, numbers = {**MASS["initial"], "x": 0.2}, {**MASS["parameters"], "m": 3.0}
    run = mass_model.simulate((0, 1.5), initial, numbers, inputs={"force": force}, t_eval=[1.5], **TOLERANCES)
    for name in ("x", "x_dot", "z", "x_ddot"):
        assert unit.get(name) == pytest.approx(run[name][-1], rel=1e-9)
    assert unit.set("m", 2.0) == 3  # the integrator has begun


@both_versions
def test_a_state_is_saved_and_restored(tmp_path, mass_model, version):
    unit = exchanged(mass_model, tmp_path / "a.fmu", fmi=version, **MASS)
    assert unit.begin(0.0) == 0
    unit.set("force", 1.0)
    unit.integrate(0.0, 0.5, 50)
    restore, saved = unit.again(), unit.vector("GetContinuousStates")
    found = []
    for _ in range(2):
        unit.integrate(0.5, 1.0, 50)
        found.append(unit.vector("GetContinuousStates"))
        unit.set("force", 7.0)
        restore()
        assert unit.get("force") == 1.0
        np.testing.assert_array_equal(unit.vector("GetContinuousStates"), saved)
    np.testing.assert_array_equal(*found)
    unit.call("Reset")
    assert unit.begin(2.0) == 0 and unit.get("x") == 0.1


@both_versions
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_constraints_are_kept(tmp_path, pendulum, version, method):
    """Where coordinates depend on each other, states that leave the constraints are put back onto them, by events."""
    model, given = pendulum
    unit = exchanged(model, tmp_path / "a.fmu", fmi=version, method=method, **given, rtol=1e-7, atol=1e-9)
    assert unit.begin(0.0) == 0
    events = unit.integrate(0.0, 2.0, 400)
    x, y, x_dot, y_dot = (unit.get(name) for name in ("x", "y", "x_dot", "y_dot"))
    assert events > 3
    assert abs(x * x + y * y - 1) < 3e-7 and abs(x * x_dot + y * y_dot) < 2e-6
    run = model.simulate((0, 2), **given, t_eval=[2.0], **TOLERANCES)
    for name in ("x", "y", "x_dot", "y_dot"):
        assert unit.get(name) == pytest.approx(run[name][-1], abs=3e-5)
    # a state off the constraint: the unit asks for an event, which puts it back
    state = unit.vector("GetContinuousStates")
    unit.place(2.0, state * 1.001)
    assert unit.completed() == (True, False)
    assert unit.updated() == (False, True) and unit.updated() == (False, False)
    x, y, x_dot, y_dot = (unit.get(name) for name in ("x", "y", "x_dot", "y_dot"))
    assert abs(x * x + y * y - 1) < 1e-14 and abs(x * x_dot + y * y_dot) < 1e-13
    unit.place(2.0, state * 0.0)  # the pivot, which has no nearest point of the circle
    event, end = ctypes.c_int(), ctypes.c_int()
    assert unit.call("CompletedIntegratorStep", 1, ctypes.byref(event), ctypes.byref(end)) == 3


@both_versions
def test_angles_that_lock_end_a_run(tmp_path, version):
    case = hard_case("sphere through theta = 0, in angles")
    given = {"initial": case.initial, "parameters": case.parameters, "fmi": version}
    description, folder = unpacked(case.compile("auto"), tmp_path / "a.fmu", **given)
    unit = Unit(description, folder, exchange=True)
    count = int(description.get("numberOfEventIndicators") or len(description.findall(".//EventIndicator")))
    assert unit.begin(0.0) == 0 and count == 1
    (before,) = unit.vector("GetEventIndicators", count)
    assert unit.updated() == (False, False)
    state = unit.vector("GetContinuousStates")
    state[case.compile("auto").layout.state.index("theta")] *= -1
    unit.place(0.1, state)
    (after,) = unit.vector("GetEventIndicators", count)
    assert before * after < 0 and unit.get("lock_1") == after
    assert unit.completed() == (False, True) and unit.updated() == (True, False)


@both_versions
def test_rates_that_are_not_finite_are_discarded(tmp_path, version):
    case = hard_case("sphere through theta = 0, in angles")
    model = case.compile("auto")
    unit = exchanged(model, tmp_path / "a.fmu", initial=case.initial, parameters=case.parameters, fmi=version)
    assert unit.begin(0.0) == 0
    state = unit.vector("GetContinuousStates")
    state[model.layout.state.index("theta")] = np.nan
    unit.place(0.1, state)
    rates = (ctypes.c_double * len(state))()
    assert unit.call("GetContinuousStateDerivatives", rates, ctypes.c_size_t(len(state))) == 2


@both_versions
def test_rates_that_jump_are_for_co_simulation_alone(tmp_path, version):
    x, (m, f) = dynamicsymbols("x"), symbols("m f", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("rough", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", O.locatenew("P", x * N.x), m))
    scene.add_loads((scene.bodies[0].masscenter, -f * sign(x.diff()) * N.x))
    given = {"initial": {"x": 0, "x_dot": 1.0}, "parameters": {"m": 1, "f": 0.2}, "fmi": version}
    description, folder = unpacked(da.compile_model(scene), tmp_path / "a.fmu", **given)
    assert description.find("ModelExchange") is None and description.find("CoSimulation") is not None
    assert "because rates jump or have pulses" in description.get("description")
    assert Unit(description, folder, exchange=True).instance is None
    unit = Unit(description, folder)
    assert unit.begin(0.0) == 0 and unit.step(0.0, 2.0) == 0
    assert unit.get("x") == pytest.approx(2.0 - 0.1 * 4.0, rel=1e-12)


@both_versions
def test_directional_derivatives_are_those_of_differences(tmp_path, sleigh_model, version):
    unit = exchanged(sleigh_model, tmp_path / "a.fmu", fmi=version, **SLEIGH)
    assert unit.begin(0.0) == 0
    names = sleigh_model.layout.state
    unknown = ["x_dot", "y_dot", "Y", *(f"der({name})" for name in names), "theta"]
    state, seed = unit.vector("GetContinuousStates"), np.array([0.3, -0.2, 0.7, 0.4, -0.9])

    def values(at):
        unit.place(0.0, at)
        return np.array([unit.get(name) for name in unknown])

    h = 1e-6
    expected = (values(state + h * seed) - values(state - h * seed)) / (2 * h)
    unit.place(0.0, state)
    found = unit.directional(unknown, names, seed)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)
    assert abs(expected).max() > 0.5
    parts = [unit.directional(unknown, [name], [part]) for name, part in zip(names, seed, strict=True)]
    np.testing.assert_allclose(sum(parts), found, rtol=1e-14, atol=1e-15)
    assert unit.directional(unknown, ["x_start"], [1.0]) == 3  # an error: by initial values there are none
    assert unit.directional(["m"], names, seed) == 3


@both_versions
@pytest.mark.parametrize("name", ["sleigh", "pendulum"])
def test_directional_derivatives_by_parameters_are_those_of_differences(tmp_path, request, name, version):
    """With constants that parameters make, and where coordinates depend on each other; beside parts of the state."""
    model, given = (
        (request.getfixturevalue("sleigh_model"), SLEIGH) if name == "sleigh" else request.getfixturevalue(name)
    )
    unit = exchanged(model, tmp_path / "a.fmu", fmi=version, **given)
    assert unit.begin(0.0) == 0
    state, names, h = unit.vector("GetContinuousStates"), model.layout.state, 1e-6
    numbers = {key: float(value) for key, value in given["parameters"].items()}
    seed = dict(zip(numbers, (0.7, -0.4, 0.3), strict=False)) | {names[-1]: 0.5}
    unknown = [*model.layout.outputs, *model.layout.rates, *(f"der({each})" for each in names)]
    found, values = unit.directional(unknown, list(seed), list(seed.values())), []
    for step in (h, -h):
        unit.call("Reset")
        assert unit.begin(0.0, **{key: value + step * seed[key] for key, value in numbers.items()}) == 0
        unit.place(0.0, state + step * np.array([seed.get(each, 0.0) for each in names]))
        values.append([unit.get(each) for each in unknown])
    expected = (np.array(values[0]) - values[1]) / (2 * h)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-8)
    assert abs(expected).max() > 0.1
    unit.call("Reset")
    assert unit.begin(0.0) == 0
    parts = [unit.directional(unknown, [key], [part]) for key, part in seed.items()]
    np.testing.assert_allclose(sum(parts), found, rtol=1e-13, atol=1e-14)


@both_versions
@pytest.mark.parametrize("exchange", [False, True])
def test_directional_derivatives_by_inputs(tmp_path, mass_model, version, exchange):
    unit = Unit(*unpacked(mass_model, tmp_path / "a.fmu", fmi=version, **MASS), exchange=exchange)
    assert unit.begin(0.0) == 0
    if not exchange:
        assert unit.step(0.0, 0.5) == 0
    found = unit.directional(["x_ddot", "x", "der(x_dot)", "der(z)"], ["force", "x"], [2.0, 1.0])
    slope = (unit.get("x_ddot") * 1.5 - unit.get("force")) / -2.0  # that of the spring's table, at the origin
    assert slope == pytest.approx(unit.get("x"))
    np.testing.assert_allclose(found, [(2.0 - 2.0) / 1.5, 1.0, (2.0 - 2.0) / 1.5, 1.0], rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(unit.directional(["x_ddot", "der(x)"], ["force"], [3.0]), [2.0, 0.0], rtol=1e-14)
    found = unit.directional(["x_ddot", "x"], ["m", "force"], [2.0, 3.0])
    np.testing.assert_allclose(found, [2.0 - 2.0 * unit.get("x_ddot") / 1.5, 0.0], rtol=1e-14)


@both_versions
def test_an_importer_integrates_it(tmp_path, mass_model, sleigh_model, pendulum, version):
    """CVode of fmpy: errors of its tolerance, with constraints too, and with an input that jumps at an event."""
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    from fmpy.validation import validate_fmu

    force = np.array([(0, 1.0), (0.7, 1.0), (0.7, -1.0), (2, -1.0)], dtype=[("time", float), ("force", float)])
    jump = da.samples([0.0, 0.7, 2.0], [1.0, -1.0, -1.0], kind="hold")
    cases = [(sleigh_model, SLEIGH, {}, {}), (*pendulum, {}, {}), (mass_model, MASS, {"force": jump}, {"input": force})]
    for number, (model, given, inputs, options) in enumerate(cases):
        path = model.export(tmp_path / f"{number}.fmu", "fmu", **given, fmi=version, rtol=1e-8, atol=1e-10)
        assert validate_fmu(str(path)) == []
        found = fmpy.simulate_fmu(
            str(path), stop_time=2, output_interval=0.05, fmi_type="ModelExchange", relative_tolerance=1e-8, **options
        )
        assert found["time"][-1] == pytest.approx(2.0)
        run = model.simulate((0, 2), **given, inputs=inputs, t_eval=[2.0], **TOLERANCES)
        for name in (*model.layout.coordinates, *model.layout.rates):
            assert found[name][-1] == pytest.approx(run[name][-1], rel=1e-6, abs=1e-6)
