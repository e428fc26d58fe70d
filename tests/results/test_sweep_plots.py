"""Plots of sweeps: over time, over what varies, over an axis of a grid."""

import functools

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError

plt = pytest.importorskip("matplotlib.pyplot")

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1, "I_C": 0.5}


@functools.cache
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X"])


def swept(b, **options):
    return model().sweep((0, 2), START, P | {"b": b}, **options)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_final_values_and_reductions_over_the_parameter():
    x = model().stages.scene.coordinates[0]
    sweep = swept([0.5, 0.1, 0.3], reduce={"range": da.maximum(x)})
    figure = sweep.plot(x, "X", "range")
    assert figure.number in plt.get_fignums()
    assert [panel.get_ylabel() for panel in figure.axes] == ["x", "X", "range"]
    assert figure.axes[-1].get_xlabel() == "b"
    for panel, values in zip(figure.axes, (sweep.final["x"], sweep.final["X"], sweep.reduced["range"]), strict=True):
        np.testing.assert_array_equal(panel.lines[0].get_xydata(), np.transpose([[0.1, 0.3, 0.5], values[[1, 2, 0]]]))
    assert [panel.get_ylabel() for panel in sweep.plot().axes] == ["range"]
    assert [panel.get_ylabel() for panel in swept([0.1, 0.3]).plot().axes] == ["x", "y", "theta"]


def test_cases_over_time():
    times = np.linspace(0, 2, 5)
    sweep = swept(np.linspace(0.1, 0.5, 41), t_eval=times)
    (panel,) = sweep.plot("x").axes
    assert len(panel.lines) == 20
    np.testing.assert_array_equal(panel.lines[0].get_xydata(), np.transpose([times, sweep["x"][0]]))
    np.testing.assert_array_equal(panel.lines[-1].get_ydata(), sweep["x"][-1])
    assert [text.get_text() for text in panel.get_legend().get_texts()] == ["b = 0.1", "b = 0.5"]
    (panel,) = sweep.plot("x", cases=[0, 7]).axes
    np.testing.assert_array_equal(panel.lines[1].get_ydata(), sweep["x"][7])
    assert len(sweep.plot("x", cases=slice(0, 30)).axes[0].lines) == 30  # all that are named
    (panel,) = sweep.plot("x", over="b").axes
    np.testing.assert_array_equal(panel.lines[0].get_ydata(), sweep.final["x"])


def test_an_axis_of_a_grid_has_a_curve_for_each_value_of_the_others():
    axes = da.grid(b=[0.1, 0.2, 0.3], theta_dot=[1.0, 2.0])
    start = {name: value for name, value in START.items() if name != "theta_dot"}
    sweep = model().sweep((0, 2), start, P, grid=axes)
    (panel,) = sweep.plot("x", over="b").axes
    table = sweep.final["x"].reshape(3, 2)
    for line, values in zip(panel.lines, table.T, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), np.transpose([[0.1, 0.2, 0.3], values]))
    assert [line.get_label() for line in panel.lines] == ["theta_dot = 1", "theta_dot = 2"]
    with pytest.raises(OptionError, match=r"choose one by over=\. Known: theta_dot, b"):
        sweep.plot()


def test_a_case_that_failed_has_no_final_value():
    steps = swept([0.1, 0.5]).steps
    sweep = swept([0.1, 0.5], max_steps=int(min(steps)))
    assert sweep.success.tolist() == (steps == min(steps)).tolist() and not np.all(sweep.success)
    (panel,) = sweep.plot("x").axes
    np.testing.assert_array_equal(np.isfinite(panel.lines[0].get_ydata()), sweep.success)


def test_one_axes_for_all_names_and_wrong_input():
    sweep = swept([0.1, 0.3])
    own, ax = plt.subplots()
    assert sweep.plot("x", "y", ax=ax) is own
    assert [line.get_label() for line in ax.lines] == ["x", "y"]
    before = plt.get_fignums()
    with pytest.raises(UnknownNameError, match="thetta"):
        sweep.plot("thetta")
    with pytest.raises(OptionError, match=r"'m' does not vary\. Known: b"):
        sweep.plot(over="m")
    with pytest.raises(OptionError, match=r"numbers up to 1, or 2 booleans, not \[2\]"):
        sweep.plot(cases=[2])
    with pytest.raises(OptionError, match=r"choose one by over=\. Known: none"):
        swept(0.3).plot()
    with pytest.raises(UnknownNameError, match="It is a reduction"):
        swept([0.1, 0.3], t_eval=[0, 1, 2], reduce={"range": da.maximum("x")}).plot("range")
    assert plt.get_fignums() == before
