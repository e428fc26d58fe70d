"""What users give while a model runs: every fault is named, and nothing defaults silently."""

import functools
import pickle

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, dynamicsymbols

import dalembert as da
from dalembert.errors import (
    DalembertError,
    ExpressionError,
    InitialStateError,
    OptionError,
    SceneError,
    UnknownNameError,
    ValueInputError,
)
from scene.builders import cartesian_pendulum, shaken_pendulum

P = {"m": 1.0, "b": 0.3, "I_C": 0.5}
START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
m, b, I_C = sp.symbols("m b I_C", positive=True)
x, y, theta = dynamicsymbols("x y theta")


@functools.cache
def sleigh(formulation="minimal"):
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", formulation=formulation)


def run(initial=START, parameters=P, formulation="minimal", **options):
    return sleigh(formulation).simulate((0, 0.1), initial, parameters, **options)


def without(mapping, *names):
    return {name: value for name, value in mapping.items() if name not in names}


both = pytest.mark.parametrize("formulation", ["minimal", "projected"])


# -- names --------------------------------------------------------------------------------


def test_names_and_symbols_mean_the_same():
    by_name = run()
    by_symbol = run(
        {x: 0, y: 0, theta: 0.2, x.diff(): 0.98, theta.diff(): 2.0}, {m: 1, b: sp.Rational(3, 10), I_C: np.float32(0.5)}
    )
    mixed = run({x: 0, "y": 0, "theta": 0.2, x.diff(): 0.98, "theta_dot": 2}, {m: 1, "b": 0.3, "I_C": 0.5})
    np.testing.assert_array_equal(by_name.q, by_symbol.q)
    np.testing.assert_array_equal(by_name.q, mixed.q)


def test_missing_parameters_are_all_named():
    with pytest.raises(UnknownNameError, match=r"missing parameters: I_C, b\. The scene needs: I_C, b, m"):
        run(parameters={"m": 1.0})


def test_unknown_parameters_are_all_named_with_suggestions():
    with pytest.raises(UnknownNameError) as caught:
        run(parameters={**P, "I_c": 1.0, "mass": 2.0})
    text = str(caught.value)
    assert "'I_c'" in text and "Did you mean 'I_C'" in text
    assert "'mass'" in text and "Known: I_C, b, m" in text


def test_missing_and_unknown_parameters_are_named_together():
    with pytest.raises(UnknownNameError) as caught:
        run(parameters={"m": 1.0, "bee": 0.3, "I_C": 0.5})
    assert "'bee'" in str(caught.value)
    assert "missing parameters: b" in str(caught.value)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_all_named(value):
    with pytest.raises(ValueInputError) as caught:
        run(parameters={**P, "m": value, "b": value})
    assert "m = " in str(caught.value) and "b = " in str(caught.value) and "not finite" in str(caught.value)
    with pytest.raises(ValueInputError) as caught:
        run({**START, "x": value, "theta_dot": value})
    assert "x = " in str(caught.value) and "theta_dot = " in str(caught.value)


@pytest.mark.parametrize("value", ["heavy", None, [1.0, 2.0], 1j, {}])
def test_values_that_are_no_numbers_are_named(value):
    with pytest.raises(ValueInputError, match=r"m = .*not a number"):
        run(parameters={**P, "m": value})


@pytest.mark.parametrize("given", [None, [1.0, 0.3, 0.5], "m"])
def test_parameters_must_be_a_mapping(given):
    with pytest.raises(ValueInputError, match="must be a mapping"):
        run(parameters=given)


def test_unknown_initial_values_are_named():
    with pytest.raises(UnknownNameError) as caught:
        run({**START, "thetta": 1.0, "psi_dot": 0.0})
    assert "Did you mean 'theta'" in str(caught.value) and "'psi_dot'" in str(caught.value)


def test_one_quantity_by_name_and_by_symbol_is_given_twice():
    with pytest.raises(UnknownNameError, match="'x' is given twice"):
        run({**START, x: 0.0})
    with pytest.raises(UnknownNameError, match="'m' is given twice"):
        run(parameters={**P, m: 1.0})


def test_parameters_at_which_an_expression_is_not_finite():
    with pytest.raises(ValueInputError, match=r"I_C = 0.*divides by is zero"):
        run(parameters={**P, "I_C": 0.0})


def sleigh_with_height():
    """The sleigh and a bead of mass m at the height q."""
    q = dynamicsymbols("q")
    scene = da.scenes.chaplygin_sleigh()
    scene.coordinates += (q,)
    scene.add_bodies(Particle("bead", scene.origin.locatenew("B", q * scene.frame.z), m))
    return scene, q


# -- initial states -----------------------------------------------------------------------


@both
def test_contradictory_rates_name_constraint_residual_and_tolerance(formulation):
    with pytest.raises(InitialStateError) as caught:
        run({**START, "y_dot": 5.0}, formulation=formulation)
    text = str(caught.value)
    residual = -0.98 * np.sin(0.2) + 5.0 * np.cos(0.2)
    assert "nonholonomic constraint 1" in text
    assert f"residual {residual:.3g}" in text
    assert "tolerance" in text and "leave out" in text


@both
def test_consistent_rates_are_accepted_with_the_rounding_of_decimals(formulation):
    exact = 0.98 * np.tan(0.2)
    trajectory = run({**START, "y_dot": float(f"{exact:.10f}")}, formulation=formulation)
    assert np.abs(trajectory.constraint_violation[0]).max() < 1e-15


@both
def test_rates_that_the_constraints_fix_are_solved_for(formulation):
    assert run(START, formulation=formulation)["y_dot"][0] == pytest.approx(0.98 * np.tan(0.2), rel=1e-14)
    other = run({**without(START, "x_dot"), "y_dot": 0.3}, formulation=formulation)
    assert other["x_dot"][0] == pytest.approx(0.3 / np.tan(0.2), rel=1e-13)


@both
@pytest.mark.parametrize("lost", [("theta_dot",), ("x_dot",), ("theta_dot", "x_dot")])
def test_rates_that_nothing_fixes_are_named(formulation, lost):
    with pytest.raises(InitialStateError, match="missing for the rates") as caught:
        run(without(START, *lost), formulation=formulation)
    assert all(name in str(caught.value) for name in lost)
    assert "nothing defaults to zero" in str(caught.value)


@both
@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_rate_that_the_constraint_does_not_fix_at_this_configuration(formulation, speed):
    """Across the blade, at theta = pi/2, the constraint says nothing about y_dot."""
    with pytest.raises(InitialStateError):
        sleigh(formulation).simulate((0, 0), {**START, "theta": np.pi / 2, "x_dot": speed}, P)


@both
def test_coordinates_never_default(formulation):
    with pytest.raises(InitialStateError, match="coordinates x, theta") as caught:
        run(without(START, "x", "theta"), formulation=formulation)
    assert "nothing defaults to zero" in str(caught.value)


@both
def test_positions_are_solved_for_where_the_constraints_give_them_linearly(formulation):
    scene, q = sleigh_with_height()
    scene.add_holonomic_constraints(3 * q - scene.coordinates[0] ** 2 - b)
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    trajectory = model.simulate((0, 0), {**START, "x": 0.6}, P)
    assert trajectory["q"][0] == pytest.approx((0.36 + 0.3) / 3, rel=1e-14)
    assert trajectory["q_dot"][0] == pytest.approx(2 * 0.6 * 0.98 / 3, rel=1e-14)


def test_positions_are_refused_where_the_constraint_has_two_solutions():
    model = da.compile_model(cartesian_pendulum(), backend="numpy")
    with pytest.raises(InitialStateError, match=r"coordinates y: .*uniquely"):
        model.simulate((0, 1), {"x": 0.3, "x_dot": 0.0, "y_dot": 0.0}, {"m": 1, "l": 0.5, "g": 9.81})


def test_contradictory_positions_name_the_constraint():
    model = da.compile_model(cartesian_pendulum(), backend="numpy")
    initial = {"x": 0.3, "y": -0.5, "x_dot": 0.0, "y_dot": 0.0}
    with pytest.raises(InitialStateError, match=r"positions contradict.*\n.*holonomic constraint 1.*residual 0\.045"):
        model.simulate((0, 1), initial, {"m": 1, "l": 0.5, "g": 9.81})


def test_small_violations_are_projected_away_at_the_start():
    model = da.compile_model(cartesian_pendulum(), backend="numpy")
    initial = {"x": 0.3 + 1e-9, "y": -0.4, "x_dot": 0.4, "y_dot": 0.3}
    trajectory = model.simulate((0, 0), initial, {"m": 1, "l": 0.5, "g": 9.81})
    assert np.abs(trajectory.constraint_violation[0]).max() < 1e-15


@both
def test_start_at_which_a_constraint_has_no_value(formulation):
    """z = sqrt(x) at x = -1: an error that names what is not finite, before anything is integrated."""
    scene, q = sleigh_with_height()
    scene.add_holonomic_constraints(q - sp.sqrt(scene.coordinates[0]))
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    with pytest.raises(InitialStateError, match="not finite") as caught:
        model.simulate((0, 1), {**START, "x": -1.0}, P)
    assert "none" not in str(caught.value)


# -- options ------------------------------------------------------------------------------


@pytest.mark.parametrize(("wrong", "meant"), [("llvmm", "llvm"), ("Numpy", "numpy"), ("cuda", None)])
def test_unknown_backend_lists_the_known_ones(wrong, meant):
    with pytest.raises(OptionError) as caught:
        da.compile_model(da.scenes.chaplygin_sleigh(), backend=wrong)
    text = str(caught.value)
    assert repr(wrong) in text and "Known: llvm, numba, jax, numpy" in text
    assert (f"Did you mean {meant!r}" in text) if meant else ("Did you mean" not in text)


def test_unknown_formulation_lists_the_known_ones():
    with pytest.raises(
        OptionError, match=r"'minimum'.*Did you mean 'minimal'.*auto, minimal, projected, baumgarte, ggl, augmented"
    ):
        da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", formulation="minimum")


def test_unknown_method_lists_those_of_the_backend():
    with pytest.raises(OptionError, match=r"'dop835'.*Did you mean 'dop853'.*auto, .*lsoda.*backend 'numpy'"):
        run(method="dop835")


@pytest.mark.parametrize("wrong", [None, 3, ["llvm"]])
def test_options_that_are_no_names_are_refused_as_options(wrong):
    with pytest.raises(OptionError):
        da.compile_model(da.scenes.chaplygin_sleigh(), backend=wrong)
    with pytest.raises(OptionError):
        da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", formulation=wrong)
    with pytest.raises(OptionError):
        run(method=wrong)


@pytest.mark.parametrize("wrong", [None, 3, ["X", 3], da.scenes.chaplygin_sleigh().frame, [np.sin]])
def test_outputs_are_names_expressions_or_points(wrong):
    with pytest.raises(OptionError, match=r"outputs are names, expressions .* or Points, or a mapping .*, not "):
        da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", outputs=wrong)


def test_a_mapping_among_outputs_has_its_entries():
    scene = da.scenes.chaplygin_sleigh()
    named = da.compile_model(scene, backend="numpy", outputs={"blade": {"push": "X", "lift": {"a": "Y"}}})
    assert named.layout.outputs == ("blade.push", "blade.lift.a")
    listed = da.compile_model(scene, backend="numpy", outputs=["Y", {"push": "X"}])
    assert set(listed.layout.outputs) == {"Y", "push"}


def test_one_output_may_be_given_alone():
    scene = da.scenes.chaplygin_sleigh()
    for alone in ("X", x.diff() ** 2, scene.origin):
        model = da.compile_model(scene, backend="numpy", outputs=alone)
        assert model.layout.outputs == da.compile_model(scene, backend="numpy", outputs=[alone]).layout.outputs


@pytest.mark.parametrize("t_span", ["01", ("0", "1"), 3, (0,), (0, 1, 2), "ab", None, (0, "x")])
def test_span_must_be_two_numbers(t_span):
    with pytest.raises(ValueInputError, match="t_span must be two numbers"):
        sleigh().simulate(t_span, START, P)


@pytest.mark.parametrize(
    "options",
    [
        {"rtol": -1.0},
        {"rtol": np.nan},
        {"rtol": np.inf},
        {"rtol": 0.0, "atol": 0.0},
        {"atol": np.nan},
        {"max_step": 0.0},
        {"first_step": -1.0},
        {"max_steps": 0},
        {"t_eval": [0.0, 3.0]},
        {"t_eval": [0.1, 0.05]},
    ],
    ids=str,
)
def test_options_out_of_range_are_refused(options):
    with pytest.raises(OptionError) as caught:
        run(**options)
    assert any(name in str(caught.value) for name in options)


def test_comparison_of_unknown_formulations_and_methods():
    run = ((0, 0.1), START, P)
    for options in ({"method": "dop835"}, {"method": {"minimal": "dop835"}}):
        with pytest.raises(OptionError, match=r"unknown method 'dop835'.*Did you mean 'dop853'"):
            sleigh().compare_formulations(*run, **options)
    with pytest.raises(OptionError, match=r"unknown formulation 'mininal'.*Did you mean 'minimal'"):
        sleigh().compare_formulations(*run, method={"mininal": "dop853"})
    assert len(sleigh().compare_formulations(*run, formulations="minimal").rows) == 1


def test_no_events_are_none():
    assert run(events=None).success
    with pytest.raises(ExpressionError, match="not a SymPy expression"):
        run(events=[None])


def test_span_that_is_not_finite_is_refused():
    with pytest.raises(DalembertError, match="finite"):
        sleigh().simulate((0, np.inf), START, P)


# -- kernels ------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["numpy", "llvm"])
def test_shapes_of_evaluated_kernels(backend):
    model = da.compile_model(da.scenes.rolling_sphere(), backend=backend, cache=False)
    rng = np.random.default_rng(1)
    q, qdot = rng.uniform(0.3, 1.2, (7, 5)), rng.normal(size=(7, 5))
    p = {"m": 1.0, "r": 0.4, "g": 9.81}
    vector = [p[name] for name in model.layout.parameters]
    shapes = {
        "mass_matrix": (5, 5),
        "forcing": (5,),
        "constraint_jacobian": (2, 5),
        "accelerations": (5,),
    }
    for name, shape in shapes.items():
        function = getattr(model, name)

        def call(q, qdot, p, t=0.0, function=function, name=name):
            if name == "mass_matrix":
                return function(q, p, t=t)
            return function(t, q, p) if name == "constraint_jacobian" else function(t, q, qdot, p)

        many = call(q, qdot, p)
        assert many.shape == (7, *shape)
        one = call(q[3], qdot[3], p)
        assert one.shape == shape
        np.testing.assert_array_equal(one, many[3])
        np.testing.assert_array_equal(call(q.tolist(), qdot.tolist(), vector), many)
        assert call(q[3], qdot[3], p, t=np.linspace(0, 1, 4)).shape == (4, *shape)
        assert call(q[:0], qdot[:0], p).shape == (0, *shape)
    np.testing.assert_array_equal(model.forcing(0.0, q[0], qdot, p), model.forcing(0.0, np.tile(q[0], (7, 1)), qdot, p))


def test_time_reaches_the_kernels_row_by_row():
    model = da.compile_model(shaken_pendulum(), backend="numpy")
    p = {"m": 1.0, "A": 0.3, "l": 0.5, "h": 0.2, "w": 3.0, "g": 9.81}
    times = np.array([0.0, 0.4, 1.3])
    rows = model.accelerations(times, [0.2], [1.0], p)
    single = [model.accelerations(t, [0.2], [1.0], p) for t in times]
    np.testing.assert_array_equal(rows, single)
    assert len(np.unique(rows)) == 3


def test_scene_without_constraints_has_an_empty_jacobian():
    model = da.compile_model(shaken_pendulum(), backend="numpy")
    p = {"m": 1.0, "A": 0.3, "l": 0.5, "h": 0.2, "w": 3.0, "g": 9.81}
    assert model.constraint_jacobian(0.0, [0.2], p).shape == (0, 1)
    assert model.constraint_jacobian(0.0, [[0.2], [0.3]], p).shape == (2, 0, 1)


@pytest.mark.parametrize("q", [[0.0], [0.0] * 4, np.zeros((2, 2, 3)), 1.0])
def test_coordinates_of_the_wrong_shape_are_refused(q):
    with pytest.raises(ValueInputError, match=r"q must have shape \(3,\) or \(k, 3\)"):
        sleigh().mass_matrix(q, P)


def test_parameters_of_the_wrong_shape_are_refused():
    with pytest.raises(ValueInputError, match=r"p must have shape \(3,\)"):
        sleigh().mass_matrix([0, 0, 0], [1.0, 2.0])
    for rows in ([[0.5, 0.3, 1.0]], [[0.5, 0.3, 1.0]] * 2):
        with pytest.raises(ValueInputError, match=r"p must have shape \(3,\), not \(., 3\)"):
            sleigh().mass_matrix([0, 0, 0], rows)


def test_numbers_of_rows_that_do_not_match_are_refused():
    with pytest.raises(ValueInputError):
        sleigh().forcing(0.0, np.zeros((2, 3)), np.zeros((3, 3)), P)


# -- errors -------------------------------------------------------------------------------


def test_every_error_is_a_dalembert_error_and_survives_pickling():
    for kind in (InitialStateError, OptionError, UnknownNameError, ValueInputError):
        error = kind("what, where, remedy")
        assert isinstance(error, DalembertError)
        assert str(pickle.loads(pickle.dumps(error))) == "what, where, remedy"
    text = str(SceneError("s", ["first", "second"]))
    assert "2 faults" in text and "first" in text and "second" in text
    assert str(pickle.loads(pickle.dumps(SceneError("s", ["first", "second"])))) == text
