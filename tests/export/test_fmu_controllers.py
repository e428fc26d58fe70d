"""Functional mock-up units of scenes with sampled controllers, run beside `simulate`."""

import itertools

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import OPTIMISED, built
from dalembert.errors import CapabilityError
from export.test_controllers import pulled
from export.units import VERSIONS, Unit, unpacked

x, u, w, e = dynamicsymbols("x u w e")
m, r, k_p, k_d, k_i, T = symbols("m r k_p k_d k_i T")
LAW = {"states": {e: e + T * (w - x)}, "inputs": {u: k_p * (w - x) - k_d * x.diff() + k_i * e}}
START = {"x": 0, "x_dot": 0.1, "e": 0, "w": 0.2}
NUMBERS = {"m": 2, "r": 1, "T": 0.1, "k_p": 8, "k_d": 6, "k_i": 1}
GIVEN = {"initial": START, "parameters": NUMBERS}
NAMES = ("x", "x_dot", "e", "u", "w", "x_ddot")
TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}

both_versions = pytest.mark.parametrize("version", VERSIONS)


def cart(**options):
    """Return a cart whose force is held, which follows what a slower controller sets late."""
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("cart", x * N.x)
    scene.add_bodies(Particle("cart", place, m))
    scene.add_inputs(u, w)
    scene.add_loads((place, u * N.x))
    scene.add_controllers(da.Controller("plan", period=1, offset=0.35, inputs={w: r * cos(dynamicsymbols._t)}))
    scene.add_controllers(da.Controller("pid", period=T, **(options or LAW)))
    return scene


@pytest.fixture(scope="module")
def model():
    return da.compile_model(cart(), outputs=["x_ddot"])


@both_versions
@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_loops_of_two_rates_move_as_in_simulate(tmp_path, model, version, method):
    """Whatever the communication steps, of which some end at instants: values are those after the controllers."""
    unit = Unit(*unpacked(model, tmp_path / "a.fmu", fmi=version, method=method, **GIVEN, **TOLERANCES))
    assert unit.begin(0.0, T=0.07) == 0
    times, found = [0.0, 0.07, 0.1, 0.14, 0.35, 0.5, 1.3, 2.0, 3.1], []
    for before, after in itertools.pairwise(times):
        found.append([unit.get(name) for name in NAMES])
        assert unit.step(before, after - before) == 0
    run = model.simulate((0, 4), START, {**NUMBERS, "T": 0.07}, t_eval=times[:-1], method=method, **TOLERANCES)
    for name, column in zip(NAMES, np.transpose(found), strict=True):
        np.testing.assert_allclose(column, run[name], rtol=1e-11, atol=1e-11, err_msg=name)


@both_versions
def test_a_state_is_saved_between_instants(tmp_path, model, version):
    unit, found = Unit(*unpacked(model, tmp_path / "a.fmu", fmi=version, **GIVEN)), []
    assert unit.begin(2.0) == 0 and unit.step(2.0, 0.93) == 0
    restore = unit.again()
    for _ in range(2):
        assert unit.step(2.93, 0.71) == 0
        found.append([unit.get(name) for name in NAMES])
        restore()
    assert found[0] == found[1]
    unit.call("Reset")
    assert unit.begin(0.0, T=-0.1) == 3  # an error: it is no period


def test_laws_have_angles_with_all_turns(tmp_path):
    """Taylor steps unwind angles, and a law that brakes by the angle counts turns."""
    q, torque, N, O = dynamicsymbols("q"), dynamicsymbols("M"), ReferenceFrame("N"), Point("O")
    frame = N.orientnew("B", "Axis", (q, N.z))
    place = O.locatenew("P", frame.x)
    place.set_vel(N, q.diff() * frame.y)
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[q])
    scene.add_bodies(Particle("bob", place, m))
    scene.add_inputs(torque)
    scene.add_loads((place, (torque - sin(q)) * frame.y))
    scene.add_controllers(da.Controller("spring", period=0.25, inputs={torque: -q / 50}))
    model = da.compile_model(scene)
    given = {"initial": {"q": 0, "q_dot": 9}, "parameters": {"m": 1}, "method": "taylor", **TOLERANCES}
    unit = Unit(*unpacked(model, tmp_path / "a.fmu", **given))
    assert unit.begin(0.0) == 0
    for k in range(40):
        assert unit.step(0.2 * k, 0.2) == 0
    run = model.simulate((0, 8.1), {"q": 0, "q_dot": 9}, {"m": 1}, t_eval=[8.0], method="taylor", **TOLERANCES)
    assert run["q"][-1] > 4 * np.pi
    for name in ("q", "q_dot", "M"):
        assert unit.get(name) == pytest.approx(run[name][-1], rel=1e-9)


def test_laws_read_the_inputs_of_the_start(tmp_path):
    v, N, O = dynamicsymbols("v"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", O.locatenew("cart", x * N.x), m))
    scene.add_inputs(u, v)
    scene.add_loads((scene.bodies[0].masscenter, u * N.x))
    scene.add_controllers(da.Controller("law", period=0.1, inputs={u: v - x}))
    given = {"initial": {"x": 0.5, "x_dot": 0}, "parameters": {"m": 1}, "inputs": {"v": 2}}
    for events in ([], [x - 9]):
        unit = Unit(*unpacked(da.compile_model(scene), tmp_path / f"{len(events)}.fmu", events=events, **given))
        assert unit.begin(0.0) == 0 and unit.get("u") == 1.5


@both_versions
def test_an_importer_takes_it(tmp_path, model, version):
    """In both kinds: instants are time events of model exchange."""
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    from fmpy.validation import validate_fmu

    path = model.export(tmp_path / "a.fmu", "fmu", fmi=version, **GIVEN, **TOLERANCES)
    assert validate_fmu(str(path)) == []
    run = model.simulate((0, 4), **GIVEN, t_eval=[2.96], **TOLERANCES)
    for kind, error in (("CoSimulation", 1e-12), ("ModelExchange", 5e-7)):
        found = fmpy.simulate_fmu(
            str(path), stop_time=2.96, output_interval=0.04, fmi_type=kind, relative_tolerance=1e-9
        )
        for name in NAMES:
            assert found[name][-1] == pytest.approx(run[name][-1], abs=error * (10 if name == "x_ddot" else 1))


@both_versions
def test_instants_are_time_events(tmp_path, model, version):
    unit = Unit(*unpacked(model, tmp_path / "a.fmu", fmi=version, **GIVEN), exchange=True)
    assert unit.begin(0.0) == 0
    assert unit.get("u") == pytest.approx(8 * 0.2 - 6 * 0.1) and unit.updated(0.1) == (False, False)
    state = unit.vector("GetContinuousStates")
    unit.place(0.1, state)
    assert unit.updated(0.2) == (False, True)
    unit.place(0.34, state)
    assert unit.updated(0.3) == (False, True) and unit.updated(0.35) == (False, True)


@both_versions
def test_sources_have_no_warnings(tmp_path, model, version):
    _, folder = unpacked(model, tmp_path / "a.fmu", fmi=version, method="dop853", **GIVEN)
    sources = [path.name for path in (folder / "sources").glob("*.c")]
    built(folder / "sources", sources, "-shared", "-fPIC", *OPTIMISED)


def test_what_is_not_carried(tmp_path, model):
    for kind in ("numba", "jax"):
        with pytest.raises(CapabilityError, match=rf"kind='{kind}' does not carry sampled controllers \(plan, pid\)"):
            model.export(tmp_path / "here.py", kind, **GIVEN)
    with pytest.raises(CapabilityError, match=r"method='rk4' does not carry sampled controllers"):
        model.export(tmp_path / "here", method="rk4", step=0.01, **GIVEN)
    pushed, start, numbers, _ = pulled()
    with pytest.raises(CapabilityError, match=r"contacts that change beside sampled controllers \(table, pull\)"):
        pushed.export(tmp_path / "a.fmu", "fmu", initial=start, parameters=numbers)

    def law(t, q, qdot, states, parameters):
        return [0.0], [0.0]

    own = da.compile_model(cart(states=[e], inputs=[u], function=law))
    with pytest.raises(CapabilityError, match=r"in Python \(pid\).*write them as expressions"):
        own.export(tmp_path / "a.fmu", "fmu", initial=START, parameters={"m": 2, "r": 1, "T": 1})
