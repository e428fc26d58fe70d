"""Sweeps whose model has run before: what is kept of it saves calls, and changes nothing that is found."""

import gc
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.codegen.kernel_code import INTERPRETED
from dalembert.codegen.llvm import sweep_memory
from dalembert.errors import OptionError, UnknownNameError, ValueInputError
from dalembert.methods.status import Status
from dalembert.runs import sweep as sweeps
from hard_cases import hard_case
from system.singular_scenes import windows
from system.stiff_scenes import GOVERNOR, GOVERNOR_START, governor

SLEIGH = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "y_dot": 0.98 * np.tan(0.2), "theta_dot": 2.0}
SLEIGH_VALUES = {"m": 1.0, "b": 0.3, "I_C": 0.5}
SPHERE = {"x": 0.0, "y": 0.0, "psi": 0.3, "theta": 1.1, "phi": 0.2, "psi_dot": 0.5, "theta_dot": 0.1, "phi_dot": 2.0}
SPHERE_VALUES = {"g": 9.81, "m": 1.0, "r": 0.5}
WATCHED = (
    {"events": ["theta", da.Event("x_dot", direction=-1)]},
    {"reduce": {"far": da.maximum("x"), "mean": da.mean("theta"), "when": da.first_crossing("x_dot")}},
    {"t_eval": np.linspace(0.0, 1e-3, 3)},
    {"method": "radau"},
)
WARM = 40
"""Sweeps after which everything is compiled and kept."""


@pytest.fixture(scope="module")
def sleigh():
    return da.compile_model(da.scenes.chaplygin_sleigh())


@pytest.fixture(scope="module")
def sphere():
    return da.compile_model(da.scenes.rolling_sphere())


def calls_of(run):
    """Return how many Python functions a run calls."""
    count = 0

    def profile(frame, event, argument):
        nonlocal count
        count += event == "call"

    sys.setprofile(profile)
    try:
        run()
    finally:
        sys.setprofile(None)
    return count


def test_warm_calls_have_few_python_calls(sleigh, sphere):
    """Sweeps had 720 and 840 of them before anything was kept: their number is most of what a call costs."""
    theta = np.array([0.2, 0.3])

    def sweep_sleigh():
        sleigh.sweep((0.0, 1e-3), {**SLEIGH, "x": theta}, SLEIGH_VALUES, threads=1)

    def sweep_sphere():
        sphere.sweep((0.0, 1e-3), {**SPHERE, "theta": theta}, SPHERE_VALUES, threads=1)

    def simulate():
        sleigh.simulate((0.0, 1e-3), SLEIGH, SLEIGH_VALUES)

    for run, most in ((sweep_sleigh, 132), (sweep_sphere, 158), (simulate, 110)):
        for _ in range(WARM):
            run()
        assert calls_of(run) <= most


@pytest.mark.parametrize(("options", "most"), [*zip(WATCHED, (160, 178, 142, 118), strict=True)])
def test_warm_calls_with_more_to_do_have_few_python_calls(sleigh, options, most):
    """They had 680, 690, 520 and 550 of them while arguments were packed anew."""

    def run():
        sleigh.sweep((0.0, 1e-3), {**SLEIGH, "x": np.array([0.2, 0.3])}, SLEIGH_VALUES, threads=1, **options)

    for _ in range(WARM):
        run()
    assert calls_of(run) <= most


def finals(sweep):
    counts = [array for each in sweep.events.values() for array in (each.count, each.first, each.last)]
    samples = [] if sweep.samples is None else [sweep.samples]
    return [sweep.y, sweep.t, sweep.status, sweep.steps, *samples, *counts, *sweep.reduced.values()]


@pytest.mark.parametrize("options", [{"method": "taylor"}, {"method": "dop853"}, *WATCHED])
def test_warm_sweeps_have_the_bits_of_cold_ones(sleigh, options):
    """Memory that served other cases before, more or fewer, leaves nothing behind; nor do results share any."""
    rng = np.random.default_rng(1)
    starts = [{**SLEIGH, "theta": rng.uniform(-1.4, 1.4, count), "x": rng.normal()} for count in (3, 70, 1, 17, 2)]
    starts = [{**start, "y_dot": start["x_dot"] * np.tan(start["theta"])} for start in starts]
    spans = [(0, 1.0), (0.0, -2.0), (0.0, 0.0), (0, 3), (0.0, 1.0)]
    if "t_eval" in options:
        spans = [(0, end) for _, end in spans if end > 0.0]
    starts = starts[: len(spans)]
    fresh = [
        finals(da.compile_model(da.scenes.chaplygin_sleigh()).sweep(span, start, SLEIGH_VALUES, **options))
        for span, start in zip(spans, starts, strict=True)
    ]
    found = [
        finals(sleigh.sweep(span, start, SLEIGH_VALUES, **options))
        for _ in range(WARM // 4)
        for span, start in zip(spans, starts, strict=True)
    ]
    for number, arrays in enumerate(found):
        for array, expected in zip(arrays, fresh[number % len(fresh)], strict=True):
            np.testing.assert_array_equal(array, expected)


def test_cases_that_cannot_begin_between_others(sleigh):
    """A lane that a case has left without a step starts the next one anew."""
    theta = np.array([0.2, np.nan, 0.2, 1.0])
    for _ in range(WARM):
        found = sleigh.sweep((0.0, 1.0), {**SLEIGH, "theta": theta}, SLEIGH_VALUES)
        assert found.status.tolist() == [0, Status.NON_FINITE, 0, Status.INITIAL_STATE]
        alone = sleigh.sweep((0.0, 1.0), {**SLEIGH, "theta": theta[:1]}, SLEIGH_VALUES)
        np.testing.assert_array_equal(found.y[[0, 2]], np.repeat(alone.y, 2, axis=0))


def test_threads_that_sweep_with_one_model(sleigh):
    """Each has memory of its own."""
    angles = [np.linspace(0.1, 1.0, count) for count in (2, 3, 5, 9, 40, 100)]

    def sweep(theta):
        start = {**SLEIGH, "theta": theta, "y_dot": 0.98 * np.tan(theta)}
        return [finals(sleigh.sweep((0.0, 2.0), start, SLEIGH_VALUES, threads=2)) for _ in range(10)]

    expected = [sweep(theta)[0] for theta in angles]
    with ThreadPoolExecutor(len(angles)) as pool:
        for found, wanted in zip(pool.map(sweep, angles), expected, strict=True):
            for each in found:
                for array, value in zip(each, wanted, strict=True):
                    np.testing.assert_array_equal(array, value)


def test_stopped_memory_is_not_used_again(sleigh, monkeypatch):
    """Ctrl-C leaves the loop anywhere."""
    whole = finals(sleigh.sweep((0.0, 1.0), {**SLEIGH, "x": np.zeros(3)}, SLEIGH_VALUES, threads=1))

    def press(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(sweep_memory, "run_loop", press)
        broken = sleigh.sweep((0.0, 1.0), {**SLEIGH, "x": np.zeros(3)}, SLEIGH_VALUES, threads=1)
    assert np.all(broken.status == Status.INTERRUPTED)
    for array, value in zip(
        finals(sleigh.sweep((0.0, 1.0), {**SLEIGH, "x": np.zeros(3)}, SLEIGH_VALUES, threads=1)), whole, strict=True
    ):
        np.testing.assert_array_equal(array, value)


def test_times_are_checked_again_in_another_span(sleigh):
    for end in (1.0, 1.0, 2.0):
        sleigh.sweep((0.0, end), SLEIGH, SLEIGH_VALUES, t_eval=np.array([0.0, 1.0]))
    for _ in range(2):
        with pytest.raises(OptionError, match="t_eval must lie between"):
            sleigh.sweep((0.0, 0.5), SLEIGH, SLEIGH_VALUES, t_eval=np.array([0.0, 1.0]))


def test_results_and_arguments_are_not_aliased(sleigh):
    """A later call, or a change of what was given, changes no results."""
    x = np.array([0.0, 1.0])
    first = sleigh.sweep((0.0, 1.0), {**SLEIGH, "x": x}, SLEIGH_VALUES)
    kept = [array.copy() for array in finals(first)]
    x[:] = 5.0
    sleigh.sweep((0.0, 2.0), {**SLEIGH, "x": x}, SLEIGH_VALUES)
    np.testing.assert_array_equal(first.initial["x"], [0.0, 1.0])
    for array, value in zip(finals(first), kept, strict=True):
        np.testing.assert_array_equal(array, value)
    times = np.linspace(0.0, 1.0, 3)
    sampled = sleigh.sweep((0.0, 1.0), SLEIGH, SLEIGH_VALUES, t_eval=times)
    sampled.t_eval[:] = times[:] = 9.0
    again = sleigh.sweep((0.0, 1.0), SLEIGH, SLEIGH_VALUES, t_eval=np.linspace(0.0, 1.0, 3))
    np.testing.assert_array_equal(again.t_eval, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(again.samples, sampled.samples)
    first.parameters["m"][0] = 7.0
    assert sleigh.sweep((0.0, 1.0), {**SLEIGH, "x": x}, SLEIGH_VALUES).parameters["m"] == 1.0


@pytest.mark.usefixtures("small_heap")
def test_no_results_are_kept():
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    for _ in range(2):
        found = model.sweep((0.0, 1.0), {**SLEIGH, "x": np.zeros(3)}, SLEIGH_VALUES)
        arrays = [weakref.ref(found.y), weakref.ref(found.initial["x"]), weakref.ref(found)]
        del found
        gc.collect()
        assert [ref() for ref in arrays] == [None] * 3


def test_errors_are_those_of_cold_calls(sleigh):
    for _ in range(3):
        sleigh.sweep((0.0, 1.0), SLEIGH, SLEIGH_VALUES)
    with pytest.raises(ValueInputError, match="must have one length"):
        sleigh.sweep((0.0, 1.0), {**SLEIGH, "x": np.zeros(2), "y": np.zeros(3)}, SLEIGH_VALUES)
    with pytest.raises(ValueInputError, match="x has shape"):
        sleigh.sweep((0.0, 1.0), {**SLEIGH, "x": np.zeros((2, 2))}, SLEIGH_VALUES)
    with pytest.raises(ValueInputError, match="m = -1 contradicts positive"):
        sleigh.sweep((0.0, 1.0), SLEIGH, {**SLEIGH_VALUES, "m": -1.0})
    with pytest.raises(ValueInputError, match="is not a number"):
        sleigh.sweep((0.0, 1.0), SLEIGH, {**SLEIGH_VALUES, "m": "1"})
    with pytest.raises(UnknownNameError, match="missing parameters: b"):
        sleigh.sweep((0.0, 1.0), SLEIGH, {"m": 1.0, "I_C": 0.5})
    with pytest.raises(OptionError, match="finite"):
        sleigh.sweep((0.0, np.inf), SLEIGH, SLEIGH_VALUES)
    found = sleigh.sweep((0.0, 1.0), SLEIGH, {**SLEIGH_VALUES, "m": np.array([1.0, -1.0])})
    assert found.status.tolist() == [0, Status.ASSUMPTION]


def test_stiff_cases_are_found_by_warm_models():
    """The screen passes cases that are not stiff alone; it never decides that one is."""
    model = da.compile_model(governor())
    short, long = (0.0, 1e-6), (0.0, 10.0)
    options = {"rtol": 1e-6, "atol": 1e-6}
    start = {**GOVERNOR_START, next(iter(GOVERNOR_START)): np.array([*GOVERNOR_START.values()][:1] * 2)}
    for _ in range(INTERPRETED + 2):
        assert model.sweep(short, start, GOVERNOR, **options).stats.method != "radau"
    found = model.sweep(long, start, GOVERNOR, **options)
    assert found.stats.method == "radau" and "stiff" in found.stats.note


def test_locked_angles_are_found_by_warm_models(sphere):
    """The screen of signs passes cases whose determinants keep theirs alone."""
    still, values = {**SPHERE, "psi_dot": 0.0, "phi_dot": 0.0, "psi": 0.0, "phi": 0.0}, SPHERE_VALUES
    rates = np.array([0.1, 1.5, 0.2])
    cold = sphere.sweep((0.0, 2.0), {**still, "theta_dot": rates}, values)
    for _ in range(INTERPRETED + 2):
        assert np.all(sphere.sweep((0.0, 0.1), {**still, "theta_dot": rates}, values).success)
    warm = sphere.sweep((0.0, 2.0), {**still, "theta_dot": rates}, values)
    assert cold.status.tolist() == warm.status.tolist() == [0, Status.SINGULAR_COORDINATES, 0]


def test_options_that_python_takes_for_equal_are_told_apart(sleigh):
    """A list of names is not a mapping of them, and events differ in each of their fields."""
    kept = [{"x": da.final("x")}, {"x": da.maximum("x")}, ["x"], ["x_dot"]]
    for _ in range(2):
        found = [sleigh.sweep((0.0, 1.0), SLEIGH, SLEIGH_VALUES, reduce=each).reduced for each in kept]
        assert [list(each) for each in found] == [["x"], ["x"], ["x"], ["x_dot"]]
        assert found[0]["x"] == found[2]["x"] <= found[1]["x"]
        for field, status in (({}, 0), ({"terminal": True}, Status.EVENT), ({"terminal": 1, "direction": -1}, 0)):
            events = [da.Event(dynamicsymbols("theta") - 0.5, **field)]
            assert sleigh.sweep((0.0, 1.0), SLEIGH, SLEIGH_VALUES, events=events).status.tolist() == [status]


@pytest.mark.parametrize("name", ["double pendulum, Cartesian", "four-bar", "slider-crank"])
def test_starts_with_independent_constraints_are_screened(name, monkeypatch):
    """Nothing is interpreted then, and the results are those of cold sweeps."""
    case = hard_case(name)
    model = da.compile_model(case.scene, formulation="projected")
    initial = {name: np.full(3, float(value)) for name, value in case.initial.items()}

    def sweep():
        return finals(model.sweep((0.0, 0.1), initial, case.parameters))

    cold, *_ = [sweep() for _ in range(INTERPRETED + 2)]

    def interpret(*_):
        raise AssertionError("the starts are interpreted")

    monkeypatch.setattr(sweeps, "independent_cases", interpret)
    for array, value in zip(sweep(), cold, strict=True):
        np.testing.assert_array_equal(array, value)


def test_dependent_constraints_are_found_by_warm_models():
    """The screen passes starts whose constraints are independent by far alone; it never decides that some are not."""
    model, bars = da.compile_model(windows(1), formulation="projected"), {"m": 1.0, "L": 1.0, "g": 9.81}
    angles = np.array([0.3, np.pi / 2, 0.5, np.pi / 2 - 1e-9, np.pi / 2 - 1e-3])

    def sweep(a):
        start = {"a0": a, "a1": a, "b0": 0.0, "a0_dot": 1.0, "a1_dot": 1.0, "b0_dot": 0.0}
        found = model.sweep((0.0, 0.1), start, bars)
        return found.status.tolist(), found.stats.note, finals(found)

    cold = sweep(angles)
    for _ in range(INTERPRETED + 2):
        assert sweep(angles[:1])[0] == [0]
    warm = sweep(angles)
    assert cold[:2] == warm[:2] and "in 2 of 5 cases" in cold[1]
    assert cold[0] == [0, Status.SINGULAR_CONFIGURATION, 0, Status.SINGULAR_CONFIGURATION, 0]
    for array, value in zip(warm[2], cold[2], strict=True):
        np.testing.assert_array_equal(array, value)
