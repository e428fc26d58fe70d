"""Trajectories: everything by name, at any time, and on the constraints for as long as one likes."""

import functools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError
from scene.builders import cartesian_pendulum, particles

P = {"m": 1.0, "b": 0.3, "I_C": 0.5}
START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
x, y, theta = dynamicsymbols("x y theta")
OUTPUTS = ("X", x.diff() ** 2 + y.diff() ** 2, sp.Symbol("m", positive=True) * sp.cos(theta))


@functools.cache
def model(formulation="minimal"):
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", formulation=formulation, outputs=OUTPUTS)


@functools.cache
def trajectory(formulation="minimal", **options):
    return model(formulation).simulate((0, 2), START, P, **options)


both = pytest.mark.parametrize("formulation", ["minimal", "projected"])


@both
def test_fields(formulation):
    run = trajectory(formulation)
    assert run.success and run.status == 0 and "reached" in run.message
    steps = len(run.t)
    assert run.t[0] == 0 and run.t[-1] == 2 and (np.diff(run.t) > 0).all()
    assert run.q.shape == run.qdot.shape == (steps, 3)
    assert run.y.shape == (steps, len(model(formulation).layout.state))
    assert run.constraint_violation.shape == run.velocity_violation.shape == (steps, 1)
    assert run.stats.steps == steps - 1
    assert run.stats.method == "dop853" and run.stats.evaluations > steps
    assert run.stats.run_seconds > 0 and run.stats.compile_seconds > 0


@both
def test_everything_can_be_asked_for_by_name(formulation):
    run = trajectory(formulation)
    for name in run.names:
        assert run[name].shape == run.t.shape, name
    assert {"x", "y_dot", "energy", "kinetic_energy", "potential_energy", "X", *model(formulation).layout.state} <= set(
        run.names
    )


@both
def test_symbols_serve_as_names(formulation):
    run = trajectory(formulation)
    np.testing.assert_array_equal(run[theta], run["theta"])
    np.testing.assert_array_equal(run[theta.diff()], run["theta_dot"])
    np.testing.assert_array_equal(run[x], run.q[:, 0])
    np.testing.assert_array_equal(run[y.diff()], run.qdot[:, 1])
    np.testing.assert_allclose(run[OUTPUTS[1]], run["x_dot"] ** 2 + run["y_dot"] ** 2, rtol=1e-12)
    np.testing.assert_allclose(run[OUTPUTS[2]], np.cos(run["theta"]), rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(run[str(OUTPUTS[1])], run[OUTPUTS[1]])


@both
def test_energy_is_that_of_the_text_and_kept(formulation):
    """2 T = m v^2 + I_C omega^2, v along the blade."""
    run = trajectory(formulation, rtol=1e-10)
    v = np.hypot(run["x_dot"], run["y_dot"])
    expected = (v**2 + 0.5 * run["theta_dot"] ** 2) / 2
    np.testing.assert_allclose(run["energy"], expected, rtol=1e-12)
    np.testing.assert_array_equal(run["potential_energy"], 0.0)
    assert np.ptp(run["energy"]) < 1e-9


def test_potential_of_gravity_is_part_of_the_energy():
    scene = particles()
    run = da.compile_model(scene, backend="numpy").simulate(
        (0, 1),
        dict.fromkeys(("x", "y", "s", "x_dot", "y_dot", "z_dot", "s_dot"), 0.0) | {"z": 2.0},
        {"m": 1.5, "M": 1.0, "k": 0.0, "g": 9.81},
        rtol=1e-10,
    )
    np.testing.assert_allclose(run["potential_energy"], 1.5 * 9.81 * run["z"], rtol=1e-12)
    assert np.ptp(run["energy"]) < 1e-9


def test_unknown_names_list_what_there_is():
    with pytest.raises(UnknownNameError, match=r"'thetta'.*Did you mean 'theta'.*Known: x, y, theta"):
        trajectory()["thetta"]
    with pytest.raises(KeyError):
        trajectory()["nothing"]


def test_reaction_that_was_not_asked_for_says_how_to_ask():
    with pytest.raises(UnknownNameError, match=r"compile_model\(scene, outputs=\['Y'\]\)"):
        trajectory()["Y"]


# -- times --------------------------------------------------------------------------------


@both
def test_t_eval_records_exactly_the_times_asked_for(formulation):
    times = np.array([0.0, 0.1, 0.1, 0.55, 1.9, 2.0])
    run = model(formulation).simulate((0, 2), START, P, t_eval=times, rtol=1e-11, atol=1e-13)
    np.testing.assert_array_equal(run.t, times)
    dense = model(formulation).simulate((0, 2), START, P, rtol=1e-11, atol=1e-13)(times)
    np.testing.assert_allclose(run.q, dense.q, atol=1e-10)
    assert model(formulation).simulate((0, 2), START, P, t_eval=1.0).t.tolist() == [1.0]
    assert len(model(formulation).simulate((0, 2), START, P, t_eval=[]).t) == 0


@both
def test_evaluation_between_steps(formulation):
    run = trajectory(formulation, rtol=1e-10, atol=1e-12)
    assert run.can_evaluate
    times = np.array([1.7, 0.3, 0.0, 2.0])
    between = run(times)
    np.testing.assert_array_equal(between.t, times)
    np.testing.assert_allclose(between.q[3], run.q[-1], rtol=1e-12)
    exact = [model(formulation).simulate((0, t), START, P, rtol=1e-12, atol=1e-14).q[-1] for t in times[:2]]
    np.testing.assert_allclose(between.q[:2], exact, atol=1e-8)
    assert np.abs(between.constraint_violation).max() < 1e-12
    assert run(0.5)["theta"].shape == (1,)
    np.testing.assert_array_equal(run(0.5)(1.5).q, run(1.5).q)
    assert between["X"].shape == (4,)


@pytest.mark.parametrize("t", [-0.1, 2.1, np.nan, [0.5, 3.0]])
def test_evaluation_outside_of_the_run_is_refused(t):
    with pytest.raises(OptionError, match=r"between 0\.0 and 2\.0"):
        trajectory()(t)


def test_run_without_dense_output_says_so():
    run = model().simulate((0, 2), START, P, dense=False)
    assert not run.can_evaluate
    with pytest.raises(OptionError, match="dense=True"):
        run(1.0)


def test_arrays_are_the_callers_own():
    first, second = (model().simulate((0, 1), START, P) for _ in range(2))
    first.q[:] = 0
    first.t[:] = 0
    assert second.t[-1] == 1 and second.q[-1].any()


def test_repr_says_what_it_is():
    assert repr(trajectory()).startswith("<Trajectory 'chaplygin_sleigh': t = 0 .. 2, ")
    assert "SUCCESS" in repr(trajectory())


# -- other libraries ----------------------------------------------------------------------


def test_to_xarray():
    xarray = pytest.importorskip("xarray")
    run = trajectory()
    data = run.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert set(data) == {"x", "y", "theta", "x_dot", "y_dot", "theta_dot", "energy", *map(str, OUTPUTS)}
    np.testing.assert_array_equal(data["theta"], run["theta"])
    np.testing.assert_array_equal(data["time"], run.t)
    known = {"scene": "chaplygin_sleigh", "formulation": "minimal", "status": "SUCCESS", "method": run.stats.method}
    assert data.attrs.items() >= known.items()


def test_plot_returns_a_figure_with_one_panel_a_name():
    figures = pytest.importorskip("matplotlib.figure")
    run = trajectory()
    figure = run.plot("x", theta.diff(), "energy", "X")
    assert isinstance(figure, figures.Figure)
    assert figure.axes[0].get_ylabel() == "x"
    assert len(figure.axes) == 4
    line = figure.axes[0].get_lines()[0]
    assert len(line.get_xdata()) > len(run.t)
    assert len(run.plot().axes) == 3


@pytest.mark.parametrize("options", [{"dense": False}, {"t_eval": [1.0]}], ids=str)
def test_plot_of_whatever_was_recorded(options):
    pytest.importorskip("matplotlib")
    assert len(model().simulate((0, 2), START, P, **options).plot("theta").axes) == 1


def test_plot_of_an_unknown_name_is_refused():
    pytest.importorskip("matplotlib")
    with pytest.raises(UnknownNameError, match="thetta"):
        trajectory().plot("thetta")


# -- constraints over many steps ----------------------------------------------------------


def test_projection_holds_the_constraints_over_a_hundred_thousand_steps():
    """A Cartesian pendulum for 1,000 s; the same run without projection shows the drift that is removed."""
    p, initial = {"m": 1.0, "l": 1.0, "g": 9.81}, {"x": 0.6, "y": -0.8, "x_dot": 0.0, "y_dot": 0.0}
    worst = {}
    for formulation in ("projected", "augmented"):
        compiled = da.compile_model(cartesian_pendulum(), backend="llvm", formulation=formulation, cache=False)
        run = compiled.simulate(
            (0, 1000), initial, p, method="dop853", rtol=1e-9, atol=1e-11, first_step=0.01, max_step=0.01, dense=False
        )
        assert run.success
        assert run.stats.steps >= 100_000
        worst[formulation] = np.abs(run.constraint_violation).max(), np.abs(run.velocity_violation).max()
    assert max(worst["projected"]) <= 1e-12
    assert worst["augmented"][0] > 1e3 * worst["projected"][0]
    assert worst["augmented"][1] > 1e2 * worst["projected"][1]


def test_an_estimate_of_two_runs_that_take_the_same_steps_says_so():
    """A pendulum that a controller with a quantised angle holds up: between instants, tolerances choose nothing."""
    a, u = dynamicsymbols("a u")
    N, O = ReferenceFrame("N"), Point("O")
    P1 = O.locatenew("P", sp.sin(a) * N.x + sp.cos(a) * N.y)
    scene = da.Scene("quantised", frame=N, origin=O, coordinates=[a])
    scene.add_bodies(Particle("bob", P1, 1))
    scene.add_inputs(u)
    scene.add_loads((P1, -10 * N.y + u * N.x))
    law = -40 * sp.Rational(1, 500) * sp.floor(500 * a + sp.Rational(1, 2)) - 8 * a.diff()
    scene.add_controllers(da.Controller("hold", period=sp.Rational(1, 50), inputs={u: law}))
    held = da.compile_model(scene)
    start = {"a": 0.1, "a_dot": 0.0}
    run = held.simulate((0, 4), start, {}, error_estimate=True)
    sweep = held.sweep((0, 4), start | {"a": np.array([0.1, 0.2])}, {}, error_estimate=True)
    for result in (run, sweep):
        assert "take the same steps" in result.stats.note
        assert np.max(result.error_estimate["a"]) < 1e-16
    assert trajectory(error_estimate=True).stats.note == ""
