"""What notebooks show: scenes, models, trajectories, sweeps; completion of names; pictures on axes of the user."""

import json
import pickle

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1, "b": 0.3, "I_C": 0.5}
BELT = {"m": 1, "k": 10, "v_b": 0.2, "mu": 0.2, "mu_s": 0.3, "g": 9.81}


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", cache=False, outputs=["X"])


@pytest.fixture(scope="module")
def run(model):
    return model.simulate((0, 2), START, P)


def test_a_scene_is_shown_with_its_constraints():
    text = da.scenes.chaplygin_sleigh()._repr_markdown_()
    assert "**Scene chaplygin_sleigh**" in text
    assert r"\theta" in text and "Nonholonomic constraints: $0 =" in text and "blade of sleigh" in text
    assert "Contacts" not in text and "Inputs" not in text


def test_a_model_is_shown_by_its_explanation(model):
    text = model._repr_html_()
    assert text.startswith("<pre>") and "formulation" in text and "<built" not in text


def test_a_trajectory_is_shown_with_its_ranges(run):
    text = run._repr_html_()
    assert "SUCCESS" in text and "<td>theta</td>" in text
    assert f"<td>{run['theta'].max():.6g}</td>" in text


def test_a_sweep_is_shown_with_its_statuses(model):
    sweep = model.sweep((0, 1), START, {**P, "b": [0.1, 0.2, 0.3]}, reduce={"most": da.maximum("x")})
    text = sweep._repr_html_()
    assert "SUCCESS: 3 cases" in text and "<td>b</td><td>0.1</td><td>0.3</td>" in text and "<td>most</td>" in text
    assert {"x", "theta_dot", "X", "energy"} <= set(sweep._ipython_key_completions_())


def test_a_model_with_contacts_and_its_motion_are_shown():
    model = da.compile_model(da.scenes.belt_oscillator(), backend="numpy", cache=False)
    assert "a model for each mode" in model._repr_html_()
    motion = model.simulate((0, 1), {"x": 0, "x_dot": 0}, BELT)
    assert "SUCCESS" in motion._repr_html_() and "<td>x_dot</td>" in motion._repr_html_()
    sweep = model.sweep((0, 1), {"x": 0, "x_dot": 0}, {**BELT, "k": [9, 10]})
    assert "SUCCESS: 2 cases" in sweep._repr_html_()


def test_the_textbook_view_is_shown_as_latex():
    text = da.lagrange(da.scenes.chaplygin_sleigh())._repr_markdown_()
    assert "$" in text and r"\theta" in text and "## Constraints" in text


def test_a_scene_counts_what_it_has():
    assert repr(da.scenes.chaplygin_sleigh()) == "<Scene 'chaplygin_sleigh': 1 body, 3 coordinates>"


def test_results_of_sweeps_name_what_they_have(model):
    sweep = model.sweep((0, 1), START, {**P, "b": [0.1, 0.2]}, reduce={"most": da.maximum("x")})
    np.testing.assert_array_equal(sweep.final[dynamicsymbols("x")], sweep.final["x"])
    assert dict(sweep.reduced) == {"most": sweep.reduced["most"]}
    with pytest.raises(UnknownNameError, match=r"unknown final value 'thta'\. Did you mean 'theta'"):
        sweep.final["thta"]
    with pytest.raises(UnknownNameError, match=r"unknown reduction 'least'\. Known: most"):
        sweep.reduced["least"]
    with pytest.raises(UnknownNameError, match=r"unknown output 'most'.*sweep\.reduced\['most'\]"):
        sweep["most"]
    with pytest.raises(UnknownNameError, match=r"'x_ddot'.* It is an acceleration; request it with compile_model"):
        sweep["x_ddot"]
    copy = pickle.loads(pickle.dumps(sweep.reduced))
    np.testing.assert_array_equal(copy["most"], sweep.reduced["most"])
    assert list(copy) == ["most"] and type(copy) is type(sweep.reduced)


def test_names_are_completed(run):
    assert {"x", "x_dot", "X", "energy"} <= set(run._ipython_key_completions_())
    for name in run._ipython_key_completions_():
        assert len(run[name]) == len(run.t)


def test_labelled_arrays_know_where_they_come_from(run):
    pytest.importorskip("xarray")
    attributes = run.to_xarray().attrs
    assert json.loads(attributes["parameters"]) == {"m": 1.0, "b": 0.3, "I_C": 0.5}
    assert attributes["method"] == run.stats.method and attributes["dalembert_version"] == da.__version__


def test_plots_belong_to_pyplot_and_take_axes(run):
    plt = pytest.importorskip("matplotlib.pyplot")
    figure = run.plot("x")
    assert figure.number in plt.get_fignums()
    own, ax = plt.subplots()
    assert run.plot("x", "y", ax=ax) is own
    assert [line.get_label() for line in ax.lines if not line.get_label().startswith("_")] == ["x", "y"]
    own, two = plt.subplots(2)
    run.plot("x", "y", ax=two)
    assert [panel.get_ylabel() for panel in two] == ["x", "y"]
    with pytest.raises(OptionError, match="one for each of the 3 names, not 2"):
        run.plot("x", "y", dynamicsymbols("theta"), ax=two)
    with pytest.raises(OptionError, match="ax must be Axes of matplotlib, not 3"):
        run.plot("x", ax=3)
    before = plt.get_fignums()
    with pytest.raises(UnknownNameError):
        run.plot("thetta")
    assert plt.get_fignums() == before
    np.testing.assert_array_equal(two[0].lines[1].get_ydata(), run["x"])
    plt.close("all")


def test_a_pair_is_drawn_over_each_other(run):
    plt = pytest.importorskip("matplotlib.pyplot")
    figure = run.plot("x", ("theta", dynamicsymbols("theta").diff()))
    over_time, phase = figure.axes
    np.testing.assert_array_equal(phase.lines[1].get_xydata(), np.stack([run["theta"], run["theta_dot"]], axis=1))
    assert len(phase.lines[0].get_xdata()) > len(run.t)
    assert phase.get_xlabel() == "theta" and over_time.get_ylim() != phase.get_ylim()
    with pytest.raises(OptionError, match=r'pairs of them such as \("x", "x_dot"\), not \(\'x\',\)'):
        run.plot(("x",))
    plt.close("all")


def test_a_status_is_written_by_its_name(run):
    assert str(run.status) == f"{run.status}" == "SUCCESS" and f"{run.status:>9}" == "  SUCCESS"
    assert run.status == 0 and int(run.status) == 0
