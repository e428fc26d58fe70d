"""Functional mock-up units of scenes whose contacts change, run beside `simulate`."""

import itertools

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from codegen.c_programs import OPTIMISED, built
from dalembert.contacts.equations.contact_laws import STATES
from export.test_contact_simulators import block
from export.units import VERSIONS, Unit, unpacked, variables_of
from hard_cases.contacts import contact_motion

TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}

both_versions = pytest.mark.parametrize("version", VERSIONS)


@pytest.fixture(scope="module")
def ball():
    """Return a ball over a floor, and the values of its motion."""
    case = contact_motion("bouncing ball").motion
    model = da.compile_model(da.scenes.bouncing_ball(), outputs=["N"])
    return model, {"initial": case.initial, "parameters": case.parameters}


@pytest.fixture(scope="module")
def units(ball, tmp_path_factory):
    """Return the descriptions and folders of the ball as units of both versions."""
    folder, (model, given) = tmp_path_factory.mktemp("units"), ball
    return {
        version: unpacked(model, folder / f"{version[0]}.fmu", t_span=(0, 2), fmi=version, **given, **TOLERANCES)
        for version in VERSIONS
    }


def computed(unit, model):
    """Return coordinates, rates and outputs."""
    return [unit.get(name) for name in (*model.layout.variables, *model.layout.outputs)]


@pytest.mark.parametrize(
    ("name", "method", "version", "steps", "error"),
    [
        ("block on a belt", "auto", "3.0", 40, 1e-11),
        pytest.param("plate through the upright position", "auto", "2.0", 30, 1e-11, marks=pytest.mark.matrix),
        ("plate pushed and pulled", "dop853", "3.0", 70, 1e-10),
        pytest.param("rod that falls on the ground", "radau", "2.0", 12, 1e-8, marks=pytest.mark.matrix),
    ],
)
def test_motions_in_phases_are_those_of_simulate(tmp_path, name, method, version, steps, error):
    """Whatever the communication steps: stick and slip, contacts that open, impacts."""
    case = contact_motion(name).motion
    model, end = case.compile("auto"), min(case.times()[-1], 20.0 if method != "radau" else 0.6)
    given = {"method": method, **TOLERANCES}
    values = {"initial": case.initial, "parameters": case.parameters}
    unit = Unit(*unpacked(model, tmp_path / "a.fmu", t_span=(0, end), fmi=version, **values, **given))
    assert unit.begin(0.0) == 0
    times, found = np.linspace(0, end, steps + 1), [computed(unit, model)]
    for before, after in itertools.pairwise(times):
        assert unit.step(before, after - before) == 0
        found.append(computed(unit, model))
    run = model.simulate((0, end), **values, t_eval=times, **given)
    assert len(run.phases) > 1
    for key, column in zip((*model.layout.variables, *model.layout.outputs), np.transpose(found), strict=True):
        np.testing.assert_allclose(column, run[key], rtol=error, atol=error * max(1.0, abs(run[key]).max()))
    contact = model.contacts[0]
    assert STATES[int(unit.get(f"mode({contact})"))] == run.phases[-1].modes[contact]


def test_both_versions_give_the_same_bits_from_a_saved_state_too(ball, units):
    """The state is saved in flight, and the ball bounces after that."""
    model, found = ball[0], []
    for version in VERSIONS:
        unit, restore = Unit(*units[version]), None
        assert unit.begin(0.0) == 0
        for first in (0, 4):
            for k in range(first, 10):
                if k == 4 and restore is None:
                    restore = unit.again()
                assert unit.step(0.2 * k, 0.2) == 0
            found.append(computed(unit, model))
            restore()
    assert found[0] == found[1] == found[2] == found[3]


@both_versions
def test_initial_values_and_parameters_are_the_importers(ball, units, version):
    """And so is the time of the start; an impact at the start has happened when initialization ends."""
    model, given = ball
    start = {**given["initial"], "y": 0.0, "y_dot": -2.0}
    unit = Unit(*units[version])
    assert unit.begin(1.0, **{f"{name}_start": value for name, value in start.items()}, g=5.0) == 0
    numbers = {**given["parameters"], "g": 5.0}
    assert unit.get("y_dot") == pytest.approx(2.0 * numbers["e"], rel=1e-14)
    run = model.simulate((1, 3), start, numbers, t_eval=[3.0], **TOLERANCES)
    for k in range(4):
        assert unit.step(1 + 0.5 * k, 0.5) == 0
    for name in model.layout.variables:
        assert unit.get(name) == pytest.approx(run[name][-1], rel=1e-10, abs=1e-10)
    assert unit.set("g", 9.0) == 3  # the run has begun
    unit.call("Reset")
    assert unit.begin(0.0, y_start=-0.1) == 3  # contacts forbid it


def test_steps_end_early_where_contacts_change(ball, units):
    """In event mode of FMI 3.0: rates before an impact, then those after it, at the times of the phases."""
    model, given = ball
    unit = Unit(*units["3.0"], events=True)
    assert unit.begin(0.0) == 0 and unit.updated() == (False, False) and unit.call("EnterStepMode") == 0
    t, impacts = 0.0, []
    while t < 2.0:
        end = min(2.0, np.floor(t / 0.3 + 1) * 0.3)
        t, event, early = unit.early(t, end - t)
        assert early == (event and t < end)
        if event:
            before = unit.get("y_dot")
            assert unit.call("EnterEventMode") == 0 and unit.updated() == (False, True)
            assert unit.call("EnterStepMode") == 0 and unit.get("time") == t
            impacts.append((t, before, unit.get("y_dot")))
    run = model.simulate((0, 2), **given, t_eval=[2.0], **TOLERANCES)
    times, before, after = np.transpose(impacts)
    np.testing.assert_allclose(times, [phase.t0 for phase in run.phases[1:]], rtol=1e-12)
    np.testing.assert_allclose(after, -given["parameters"]["e"] * before, rtol=1e-12)
    for name in model.layout.variables:
        assert unit.get(name) == pytest.approx(run[name][-1], rel=1e-12, abs=1e-12)


def test_an_impact_at_a_communication_point_is_part_of_the_step(ball, units):
    """Without event mode; the next step goes on behind it."""
    model, given = ball
    first = model.simulate((0, 2), **given, **TOLERANCES).phases[1].t0
    for version in VERSIONS:
        unit = Unit(*units[version])
        assert unit.begin(0.0) == 0 and unit.step(0.0, first) == 0
        before = unit.get("y_dot")
        assert unit.step(first, 1.0 - first) == 0
        run = model.simulate((0, 1), **given, t_eval=[first, 1.0], **TOLERANCES)
        assert min(abs(before - run["y_dot"][0]), abs(before + run["y_dot"][0] / given["parameters"]["e"])) < 1e-11
        assert unit.get("y_dot") == pytest.approx(run["y_dot"][1], rel=1e-11)


@both_versions
def test_the_description_says_what_contacts_do(units, version):
    description, folder = units[version]
    modes = [variable for variable in variables_of(description) if variable.get("name").startswith("mode(")]
    assert [(mode.get("causality"), mode.get("variability")) for mode in modes] == [("output", "discrete")]
    assert "0 open" in modes[0].get("description") and "3 stick" in modes[0].get("description")
    assert description.find("CoSimulation").get("hasEventMode") == (None if version == "2.0" else "true")
    sources = {path.name for path in (folder / "sources").glob("*.c")}
    simulator = "bouncing_ball.c"  # which is the same in both versions
    if version == "2.0":
        texts = [(path / "sources" / simulator).read_bytes() for _, path in units.values()]
        assert texts[0] == texts[1]
        sources.remove(simulator)
    built(folder / "sources", [*sources], "-shared", "-fPIC", *OPTIMISED)


@both_versions
def test_an_importer_takes_it(ball, units, version):
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    from fmpy.validation import validate_fmu

    model, given = ball
    path = units[version][1].with_suffix(".fmu")
    assert validate_fmu(str(path)) == []
    events = {"use_event_mode": True, "early_return_allowed": True}
    for options in [{}] if version == "2.0" else [{}, events]:
        found = fmpy.simulate_fmu(str(path), stop_time=2, output_interval=0.1, fmi_type="CoSimulation", **options)
        run = model.simulate((0, 2), **given, t_eval=[2.0], **TOLERANCES)
        assert found["time"][-1] == pytest.approx(2.0)
        assert len(found) == 21 + (2 * (len(run.phases) - 1) if options else 0)
        for name in model.layout.variables:
            assert found[name][-1] == pytest.approx(run[name][-1], rel=1e-11, abs=1e-11)


@both_versions
def test_inputs_make_contacts_slip_and_stick(tmp_path, version):
    """As runs of `simulate` from there; such units are for co-simulation alone."""
    scene, _ = block(push=dynamicsymbols("u"))
    model, state, numbers = da.compile_model(scene), {"x": 0, "x_dot": 0}, {"m": 1, "mu": 0.5}
    given = {"initial": state, "parameters": numbers, "inputs": {"u": 0}, "t_span": (0, 3), "fmi": version}
    description, folder = unpacked(model, tmp_path / "block.fmu", **given, **TOLERANCES)
    assert description.find("ModelExchange") is None
    unit, did = Unit(description, folder), []
    assert unit.begin(0.0) == 0
    for number, force in enumerate([2.0, 5.0, 3.0, -4.5, 0.0, -9.0, 4.4]):
        begin, end = 0.3 * number, 0.3 * (number + 1)
        assert unit.set("u", force) == 0 and unit.step(begin, end - begin) == 0
        run = model.simulate((begin, end), state, numbers, inputs={"u": force}, **TOLERANCES)
        state = {name: unit.get(name) for name in state}
        assert state == pytest.approx({name: run[name][-1] for name in state}, rel=1e-12, abs=1e-12)
        did.append(STATES[int(unit.get("mode(table)"))])
        assert did[-1] == run.phases[-1].modes["table"]
    assert {*did} == {"stick", "slip"}


# -- model exchange -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "formulation", "version", "end", "error"),
    [
        pytest.param("block on a belt", "auto", "2.0", 20.0, 3e-6, marks=pytest.mark.matrix),
        ("plate pushed and pulled", "auto", "3.0", 8.0, 1e-7),
        pytest.param("plate pushed and pulled", "projected", "2.0", 8.0, 1e-7, marks=pytest.mark.matrix),
    ],
)
def test_an_importer_integrates_through_the_phases(tmp_path, name, formulation, version, end, error):
    """CVode of fmpy finds where guards fall through zero: the modes of `simulate`, at its times."""
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    from fmpy.validation import validate_fmu

    case = contact_motion(name).motion
    model, path = case.compile(formulation), tmp_path / "a.fmu"
    given = {"initial": case.initial, "parameters": case.parameters}
    model.export(path, "fmu", t_span=(0, end), fmi=version, **given, rtol=1e-9, atol=1e-11)
    assert validate_fmu(str(path)) == []
    found = fmpy.simulate_fmu(
        str(path), stop_time=end, output_interval=end / 40, fmi_type="ModelExchange", relative_tolerance=1e-9
    )
    run = model.simulate((0, end), **given, t_eval=[end], **TOLERANCES)
    modes = found[f"mode({model.contacts[0]})"]
    changes = [(0.0, modes[0])] + [(found["time"][k], modes[k]) for k in np.flatnonzero(np.diff(modes)) + 1]
    assert [STATES[int(mode)] for _, mode in changes] == [phase.modes[model.contacts[0]] for phase in run.phases]
    np.testing.assert_allclose([t for t, _ in changes], [phase.t0 for phase in run.phases], atol=error)
    for key in (*model.layout.variables, *model.layout.outputs):
        assert found[key][-1] == pytest.approx(run[key][-1], abs=error)


@both_versions
def test_an_impact_is_an_event_of_model_exchange(ball, units, version):
    """A guard falls through zero; the event gives new rates, and a state between events none."""
    model, given = ball
    unit = Unit(*units[version], exchange=True)
    assert unit.begin(0.0) == 0 and unit.updated() == (False, False)
    names, e, g = model.layout.variables, given["parameters"]["e"], given["parameters"]["g"]
    start = dict(zip(names, unit.vector("GetContinuousStates"), strict=True))
    assert start == {name: given["initial"][name] for name in names}
    rates = unit.rate(0.0, [1.0, 0.5, 2.0, -3.0])
    np.testing.assert_allclose(rates, [2.0, -3.0, 0.0, -g], rtol=1e-15)
    assert [unit.get(f"der({name})") for name in names] == list(rates)
    assert unit.vector("GetEventIndicators", 1) == [0.5] == [unit.get("guard_1")]
    assert unit.completed() == (False, False) and unit.updated() == (False, False)
    unit.place(0.25, [1.0, -1e-12, 2.0, -3.0])
    assert unit.vector("GetEventIndicators", 1) < 0.0
    restore, found = unit.again(), []
    for _ in range(2):
        assert unit.updated() == (False, True) and unit.updated() == (False, False)
        found.append(unit.vector("GetContinuousStates"))
        np.testing.assert_allclose(found[-1], [1.0, 0.0, 2.0, 3.0 * e], atol=1e-11)
        restore()
    np.testing.assert_array_equal(*found)


def test_states_are_put_back_onto_closed_contacts(tmp_path):
    """Where an integrator has left them: the unit asks for an event."""
    case = contact_motion("plate through the upright position").motion
    model = case.compile("auto")
    given = {"initial": case.initial, "parameters": case.parameters, **TOLERANCES}
    unit = Unit(*unpacked(model, tmp_path / "a.fmu", **given), exchange=True)
    assert unit.begin(0.0) == 0
    state = unit.vector("GetContinuousStates")
    assert STATES[int(unit.get(f"mode({model.contacts[0]})"))] == "slip"
    unit.place(0.0, state)
    assert unit.completed() == (False, False)
    unit.place(0.0, state + 1e-6)
    assert unit.completed() == (True, False) and unit.updated() == (False, True)
    moved = unit.vector("GetContinuousStates")
    assert 0.0 < abs(moved - state).max() < 2e-5 and unit.updated() == (False, False)
    x, theta = moved[:2]
    assert abs(x + case.parameters["h"] / np.tan(theta)) < 1e-15
    assert abs(unit.vector("GetContinuousStateDerivatives")[:2] - moved[2:]).max() < 1e-13


def test_an_importer_may_find_events_late(tmp_path):
    """Steps of a fixed size, and events where they end: contacts that close have no gap after them."""
    case = contact_motion("rod that falls on the ground").motion
    model, end, steps = case.compile("auto"), 0.6, 4000
    given = {"initial": case.initial, "parameters": case.parameters}
    unit = Unit(*unpacked(model, tmp_path / "a.fmu", fmi="3.0", t_span=(0, end), **given), exchange=True)
    assert unit.begin(0.0) == 0 and unit.updated() == (False, False)
    h, state, modes = end / steps, unit.vector("GetContinuousStates"), ["open"]
    for k in range(steps):
        t = k * h
        state = state + h * unit.rate(t + 0.5 * h, state + 0.5 * h * unit.rate(t, state))
        unit.place(t + h, state)
        ended, changed = unit.updated()
        assert not ended
        if changed:
            state = unit.vector("GetContinuousStates")
            modes.append(STATES[int(unit.get(f"mode({model.contacts[0]})"))])
    run = model.simulate((0, end), **given, t_eval=[end], **TOLERANCES)
    assert modes == [phase.modes[model.contacts[0]] for phase in run.phases]
    names = model.layout.variables
    assert state[names.index("y")] == state[names.index("y_dot")] == 0.0
    np.testing.assert_allclose(state, [run[name][-1] for name in names], atol=1e-3)
