"""Functional mock-up units of scenes with events, run beside `simulate`."""

import itertools

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from codegen.c_programs import OPTIMISED, built
from export.test_controllers import NUMBERS, START, with_events
from export.test_events import TOLERANCES, pendulum, pushed
from export.units import VERSIONS, Unit, unpacked

both_versions = pytest.mark.parametrize("version", VERSIONS)


def exported(path, version, made, **options):
    """Return the description and folder of a unit with events."""
    model, start, numbers, events = made
    given = {"initial": start, "parameters": numbers, "events": events, "fmi": version, **TOLERANCES, **options}
    return unpacked(model, path / f"{version[0]}.fmu", **given)


def ending(made, count=2):
    """Return a scene whose first event ends its runs when it has occurred so often."""
    model, start, numbers, (first, *others) = made
    return model, start, numbers, [da.Event(first.expression, direction=1, terminal=count, name="last"), *others]


@both_versions
@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_events_map_the_state_within_steps(tmp_path, version, method):
    """Whatever the communication steps, to the last bit of those of simulate but for where steps are cut."""
    model, start, numbers, events = made = pendulum()
    unit = Unit(*exported(tmp_path, version, made, method=method))
    assert unit.begin(0.0) == 0
    times, found = [0.0, 0.07, 0.5, 1.3, 2.0, 3.1, 4.0], []
    for before, after in itertools.pairwise(times):
        assert unit.step(before, after - before) == 0
        found.append([unit.get(name) for name in ("theta", "theta_dot")])
    run = model.simulate((0, 4), start, numbers, events=events, t_eval=times[1:], method=method, **TOLERANCES)
    np.testing.assert_allclose(found, np.transpose([run["theta"], run["theta_dot"]]), rtol=1e-8, atol=1e-9)
    counts = {label: len(record.t) for label, record in run.events.items()}
    assert {label: unit.get(f"count({label})") for label in counts} == counts and counts["stop"] > 2


@both_versions
def test_an_event_ends_the_simulation(tmp_path, version):
    """A step of FMI 2.0 is discarded, and one of FMI 3.0 asks for the end; the state is that of the event."""
    model, start, numbers, events = made = ending(pendulum())
    run = model.simulate((0, 4), start, numbers, events=events, **TOLERANCES)
    files = exported(tmp_path, version, made)
    unit = Unit(*files)
    assert unit.begin(0.0) == 0 and unit.step(0.0, 0.5) == 0
    assert unit.ended(0.5, 3.5) == (pytest.approx(run.t[-1], rel=1e-9), False)
    assert unit.get("theta_dot") == pytest.approx(run["theta_dot"][-1], rel=1e-8) and unit.get("count(last)") == 2
    assert unit.ended(4.0, 0.5)[0] == pytest.approx(run.t[-1], rel=1e-9)
    if version == "3.0":
        unit.early_return = True
        unit.instance = unit.instantiated(unit.token)
        assert unit.begin(0.0) == 0
        assert unit.ended(0.0, 3.5) == (pytest.approx(run.t[-1], rel=1e-9), True)


@both_versions
def test_an_importer_takes_it(tmp_path, version):
    """In both kinds, with the events of `simulate` at its times; to an end by an event, too."""
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    from fmpy.validation import validate_fmu

    for made in (pendulum(), ending(pendulum(), 3)):
        model, start, numbers, events = made
        path = tmp_path / "a.fmu"
        given = {"events": events, **TOLERANCES}
        model.export(path, "fmu", fmi=version, initial=start, parameters=numbers, **given)
        assert validate_fmu(str(path)) == []
        run = model.simulate((0, 4), start, numbers, **given)
        for kind, error in (("CoSimulation", 1e-8), ("ModelExchange", 2e-6)):
            found = fmpy.simulate_fmu(
                str(path),
                stop_time=4,
                output_interval=0.1,
                fmi_type=kind,
                relative_tolerance=1e-9,
                early_return_allowed=True,
            )
            assert found["time"][-1] == pytest.approx(run.t[-1], abs=error)
            for name in ("theta", "theta_dot"):
                assert found[name][-1] == pytest.approx(run[name][-1], abs=error)
            for label, record in run.events.items():
                assert found[f"count({label})"][-1] == len(record.t) > 1


@both_versions
def test_maps_happen_in_event_mode(tmp_path, version):
    """Once, where the expression has changed its sign in the direction of the event, and with the others there."""
    unit = Unit(*exported(tmp_path, version, pendulum()), exchange=True)
    assert unit.begin(0.0) == 0 and unit.updated() == (False, False)
    np.testing.assert_allclose(unit.vector("GetEventIndicators", 2), [0.2, -0.3])
    unit.place(0.25, [0.5 + 1e-12, 2.0])
    assert unit.completed() == (False, False) and unit.get("count(stop)") == 0
    restore, found = unit.again(), []
    for _ in range(2):
        assert unit.updated() == (False, True) and unit.updated() == (False, False)
        found.append([*unit.vector("GetContinuousStates"), unit.get("count(stop)"), unit.get("count(lowest)")])
        restore()
    assert found == [[0.5 + 1e-12, -1.8, 1, 0]] * 2
    assert unit.updated() == (False, True)
    unit.place(0.5, [-0.1, -1.8])
    assert unit.updated() == (False, False)  # falls: no event
    unit.place(0.7, [0.1, 1.0])
    assert unit.updated() == (False, False) and unit.get("count(lowest)") == 1 and unit.get("count(stop)") == 1


@both_versions
def test_events_happen_where_inputs_jump(tmp_path, version):
    model, start, numbers, events = made = pushed()
    files = exported(tmp_path, version, made, inputs={"u": 1})
    unit = Unit(*files)
    assert unit.begin(0.0) == 0
    forces, times = [1.0, -2.0, 3.0, 0.5, -4.0, 2.0], 0.7 * np.arange(7)
    for force, (before, after) in zip(forces, itertools.pairwise(times), strict=True):
        assert unit.set("u", force) == 0 and unit.step(before, after - before) == 0
    inputs = {"u": da.samples(times, [*forces, forces[-1]], kind="hold")}
    run = model.simulate((0, times[-1]), start, numbers, inputs=inputs, events=events, **TOLERANCES)
    for label, record in run.events.items():
        assert unit.get(f"count({label})") == len(record.t) > 1
    assert unit.get("theta_dot") == pytest.approx(run["theta_dot"][-1], rel=1e-8)
    exchange = Unit(*files, exchange=True)
    assert exchange.begin(0.0) == 0 and exchange.updated() == (False, False)
    exchange.set("u", -5.0)
    assert exchange.updated() == (False, False) and exchange.get("count(balance)") == 1


@both_versions
def test_controllers_act_beside_events(tmp_path, version):
    """A force that jumps at an instant is an event there, in both kinds."""
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    model, events = with_events()
    path, given = tmp_path / "a.fmu", {"events": events, **TOLERANCES}
    model.export(path, "fmu", fmi=version, initial=START, parameters=NUMBERS, **given)
    run = model.simulate((0, 4), START, NUMBERS, t_eval=[2.96], **given)
    upto = model.simulate((0, 2.96), START, NUMBERS, **given)
    for kind, error in (("CoSimulation", 1e-8), ("ModelExchange", 2e-6)):
        found = fmpy.simulate_fmu(
            str(path), stop_time=2.96, output_interval=0.04, fmi_type=kind, relative_tolerance=1e-9
        )
        for name in model.layout.variables:
            assert found[name][-1] == pytest.approx(run[name][-1], abs=10 * error)
        for label, record in upto.events.items():
            assert found[f"count({label})"][-1] == len(record.t) > 0


@both_versions
def test_sources_have_no_warnings(tmp_path, version):
    """By dop853; `test_events` compiles simulators with implicit steps so."""
    _, folder = exported(tmp_path, version, ending(pendulum()), method="dop853")
    sources = [path.name for path in (folder / "sources").glob("*.c")]
    built(folder / "sources", sources, "-shared", "-fPIC", *OPTIMISED)


def test_maps_without_end_are_an_error_of_event_mode(tmp_path):
    theta = dynamicsymbols("theta")
    model, start, numbers, _ = pendulum()
    there = da.Event(theta - 0.5, direction=1, apply={theta: 0.4}, name="there")
    events = [there, da.Event(0.45 - theta, direction=1, apply={theta: 0.6}, name="back")]
    numbers = {name: value for name, value in numbers.items() if name != "e"}
    unit = Unit(*exported(tmp_path, "3.0", (model, start, numbers, events)), exchange=True)
    assert unit.begin(0.0) == 0 and unit.updated() == (False, False)
    unit.place(0.25, [0.55, 2.0])
    assert unit.updated() == (False, True)
