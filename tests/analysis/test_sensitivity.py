from functools import cache

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import CapabilityError, OptionError, UnknownNameError
from dalembert.methods.status import Status
from oracles.complex_step import derivatives

#: parameters, initial values, requested outputs
MOTIONS = {
    "chaplygin_sleigh": (
        {"m": 1.3, "b": 0.3, "I_C": 0.7},
        {"x": 0.1, "y": -0.2, "theta": 0.3, "x_dot": 0.9, "theta_dot": 1.4},
        ("X", "Y"),
    ),
    "rolling_sphere": (
        {"m": 1.3, "r": 0.5, "g": 9.81},
        {"x": 0.1, "y": -0.2, "psi": 0.4, "theta": 1.1, "phi": -0.3, "psi_dot": 0.3, "theta_dot": 0.2, "phi_dot": 0.9},
        ("F_u",),
    ),
    "corner_plate": (
        {"m": 1.1, "l": 0.6, "h": 0.5, "g": 9.81, "F_A": 7.0},
        {"theta": 1.1, "theta_dot": 0.3},
        ("N_Q",),
    ),
    "edge_plate": (
        {"m": 1.2, "A": 0.3, "B": 0.4, "C": 0.7, "F": 0.05, "h": 0.5, "g": 9.81},
        {"x": 0.0, "y": 0.1, "psi": 0.1, "theta": 1.0, "x_dot": 0.3, "y_dot": 0.2, "psi_dot": 1.1, "theta_dot": 0.2},
        ("Z",),
    ),
}
T = np.linspace(0.0, 0.5, 6)
TIGHT = {"rtol": 1e-12, "atol": 1e-14}


@cache
def compiled(scene, formulation, backend="llvm"):
    return da.compile_model(
        da.scenes.ALL[scene](), backend=backend, formulation=formulation, outputs=list(MOTIONS[scene][2])
    )


def of_everything(scene):
    layout = compiled(scene, "projected").layout
    return (*layout.coordinates, *layout.rates, *layout.outputs)


@cache
def oracle(scene, formulation):
    parameters, initial, _ = MOTIONS[scene]
    model = compiled(scene, formulation)
    return derivatives(model, T, initial, parameters, (*parameters, *initial), of_everything(scene))


def test_every_ready_scene_is_tried():
    assert set(MOTIONS) >= {"chaplygin_sleigh", "rolling_sphere", "corner_plate", "edge_plate"}


def assert_close(found, expected):
    """Compare with 1e-8 of the largest value that each derivative has along the motion, or with 1e-9 of its row's."""
    scale = np.abs(expected).max(axis=0, keepdims=True)
    scale = np.maximum(scale, 0.1 * scale.max(axis=2, keepdims=True)) + 1e-6
    np.testing.assert_array_less(np.abs(found - expected) / scale, 1e-8)


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("scene", MOTIONS)
@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_derivatives_are_those_of_complex_steps(backend, scene, formulation):
    parameters, initial, _ = MOTIONS[scene]
    values, expected = oracle(scene, formulation)
    wrt = (*parameters, *initial)
    model = compiled(scene, formulation, backend)
    run = model.sensitivity((T[0], T[-1]), initial, parameters, wrt=wrt, of=of_everything(scene), t_eval=T, **TIGHT)
    assert run.success and run.of == of_everything(scene) and run.wrt == wrt
    np.testing.assert_allclose(run.values, values, rtol=1e-9, atol=1e-10)
    assert_close(run.jacobians, expected)


def sleigh(**options):
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = compiled("chaplygin_sleigh", "minimal")
    return model.sensitivity((0.0, 2.0), initial, parameters, **options)


def test_names_and_symbols():
    model = compiled("chaplygin_sleigh", "minimal")
    x = model.stages.scene.coordinates[0]
    run = sleigh(wrt=["b", x.diff()], of=[x, "X", "y_dot"])
    assert (run.of, run.wrt) == (("x", "X", "y_dot"), ("b", "x_dot"))
    assert run.jacobians.shape == (len(run.t), 3, 2) and run.values.shape == (len(run.t), 3)
    np.testing.assert_array_equal(run.jacobian(x, x.diff()), run.jacobians[:, 0, 1])
    np.testing.assert_array_equal(run.value("X"), run.values[:, 1])
    with pytest.raises(UnknownNameError, match="m"):
        run.jacobian("x", "m")


def test_defaults_and_accepted_steps():
    run = sleigh(wrt="b")
    assert run.of == ("x", "y", "theta", "x_dot", "y_dot", "theta_dot") and run.wrt == ("b",)
    assert len(run.t) == run.steps + 1 and run.t[-1] == 2.0
    assert (run.jacobians[0] == 0.0).all()


def test_wrong_names():
    with pytest.raises(UnknownNameError, match=r"'bb'(.|\n)*'y_dot'"):
        sleigh(wrt=["bb", "y_dot"])
    with pytest.raises(UnknownNameError, match="'z'"):
        sleigh(wrt=["b"], of=["z"])
    with pytest.raises(OptionError, match="at least one"):
        sleigh(wrt=[])


def test_values_that_have_to_be_compiled_as_outputs():
    p, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")
    for name, kind in (("energy", "an energy"), ("X", "a reaction of the scene"), ("x_ddot", "an acceleration")):
        with pytest.raises(UnknownNameError, match=rf"It is {kind}; request .*\(scene, outputs=\['{name}'\]\)"):
            model.sensitivity((0, 1), initial, p, wrt=["b"], of=["x", name])
    asked = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", outputs=["kinetic_energy"])
    found = asked.sensitivity((0, 1), initial, p, wrt=["theta_dot"], of=["kinetic_energy"])
    slope = p["I_C"] * initial["theta_dot"]  # T = m v^2 / 2 + I_C w^2 / 2 is constant
    np.testing.assert_allclose(found.jacobian("kinetic_energy", "theta_dot"), slope, rtol=1e-7)


def test_options_that_only_other_calls_have():
    model, (p, initial, _) = compiled("chaplygin_sleigh", "projected"), MOTIONS["chaplygin_sleigh"]
    hit = da.Event("x", apply={"x_dot": "-x_dot"})
    with pytest.raises(CapabilityError, match=r"does not have events=.*differences of two runs of simulate\(events="):
        model.sensitivity((0, 1), initial, p, wrt=["b"], events=[hit])
    with pytest.raises(OptionError, match=r"'max_step'\. Did you mean 'max_steps'\? Known: wrt, inputs,.*t_eval gives"):
        model.sensitivity((0, 1), initial, p, wrt=["b"], max_step=0.1)
    with pytest.raises(OptionError, match=r"'progress'\. Known: (.|\n)*option 'with_respect'"):
        model.sensitivity((0, 1), initial, p, progress=True, with_respect=["b"])


def test_failure_is_a_status():
    run = sleigh(wrt=["b"], max_steps=2)
    assert run.status is Status.MAX_STEPS and not run.success and len(run.t) == 3
    assert run.message.startswith("The step budget")


@pytest.mark.parametrize("scene", MOTIONS)
def test_no_nan_at_rest(scene):
    parameters, initial, _ = MOTIONS[scene]
    still = {name: 0.0 if name.endswith("_dot") else value for name, value in initial.items()}
    model = compiled(scene, "minimal")
    run = model.sensitivity((0.0, 0.2), still, parameters, wrt=(*parameters, *still), of=of_everything(scene))
    assert run.success and np.isfinite(run.jacobians).all()


def test_no_nan_where_a_root_has_no_derivative():
    from sympy import sqrt

    scene = da.scenes.chaplygin_sleigh()
    x, y, _ = scene.coordinates
    speed = sqrt(x.diff() ** 2 + y.diff() ** 2)
    model = da.compile_model(scene, outputs=[speed])
    start = {"x": 0.0, "y": 0.0, "theta": 0.0, "x_dot": 0.0, "theta_dot": 0.0}
    parameters = MOTIONS["chaplygin_sleigh"][0]
    run = model.sensitivity((0.0, 1.0), start, parameters, wrt=["b", "x_dot"], of=[speed])
    assert np.isfinite(run.jacobians).all() and (run.jacobians == 0.0).all()


def test_coordinates_of_a_loop_move_to_the_nearest_closed_state_unless_another_follows():
    """Of a slider crank, by the length of the crank: with the slider's own change added, the angle stays."""
    N, O = ReferenceFrame("N"), Point("O")
    (a, b), (l, r) = dynamicsymbols("a b"), symbols("l r", positive=True)
    scene = da.Scene("slider_crank", frame=N, origin=O, coordinates=[a, b])
    pin, slider = l * cos(a) * N.x + l * sin(a) * N.y, b * N.x
    scene.add_bodies(Particle("pin", O.locatenew("A", pin), 1), Particle("slider", O.locatenew("B", slider), 2))
    scene.add_holonomic_constraints((pin - slider).dot(pin - slider) - r**2)
    model, p = da.compile_model(scene, backend="numpy"), {l: 0.5, r: 1.2}
    span, step = (0, 0.5), 1e-5
    start = model.assemble({a: 0.7, b: 1.5}, p, fixed=[a]) | {a.diff(): 1}
    found = model.sensitivity(span, start, p, wrt=[l, b], of=[a], rtol=1e-11)
    sides = [model.assemble({a: 0.7, b: 1.5}, p | {l: 0.5 + h}, fixed=[a]) | {a.diff(): 1} for h in (step, -step)]
    ends = [
        model.simulate(span, side, p | {l: 0.5 + h}, rtol=1e-12)["a"][-1]
        for side, h in zip(sides, (step, -step), strict=True)
    ]
    slider_rate = (sides[0]["b"] - sides[1]["b"]) / (2 * step)
    by_l = found.jacobian(a, l) + found.jacobian(a, b) * slider_rate
    assert abs(found.jacobian(a, l)[0]) > 0.5 and abs(by_l[0]) < 1e-8
    assert by_l[-1] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)
