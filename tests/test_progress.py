"""Progress bars of runs, sweeps and compilations."""

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import MissingExtraError, OptionError

tqdm = pytest.importorskip("tqdm.auto")

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1, "b": 0.3, "I_C": 0.5}
BELT = {"m": 1, "k": 10, "v_b": 0.2, "mu": 0.2, "mu_s": 0.3, "g": 9.81}


@pytest.fixture
def bars(monkeypatch):
    """All bars that are made, each with the places that it has shown and what it was called."""
    made = []

    class Recorded(tqdm.tqdm):
        def __init__(self, *args, **kwargs):
            self.places, self.titles = [], []
            made.append(self)
            super().__init__(*args, **kwargs)

        def update(self, n=1):
            super().update(n)
            self.places.append(self.n)

        def set_description_str(self, desc=None, refresh=True):
            self.titles.append(desc)
            super().set_description_str(desc, refresh)

    monkeypatch.setattr(tqdm, "tqdm", Recorded)
    return made


@pytest.fixture(scope="module")
def sleigh():
    return da.compile_model(da.scenes.chaplygin_sleigh())


@pytest.mark.parametrize("options", [{}, {"method": "radau"}, {"method": "dop853", "t_eval": [400.0], "dense": False}])
@pytest.mark.parametrize("start", [0.0, 1e5])
def test_a_run_advances_its_bar_and_keeps_its_bits(sleigh, bars, options, start):
    if "t_eval" in options:
        options = {**options, "t_eval": [start + 400.0]}
    span = (start, start + 400.0)
    shown = sleigh.simulate(span, START, P, progress=True, **options)
    plain = sleigh.simulate(span, START, P, **options)
    (bar,) = bars
    assert bar.total == 400.0 and bar.places[-1] == 400.0
    assert np.all(np.diff(bar.places) >= 0.0) and len(np.unique(bar.places)) >= 3
    assert np.array_equal(shown.t, plain.t) and np.array_equal(shown.y, plain.y)


def test_backwards_and_with_events_and_by_scipy(sleigh, bars):
    sleigh.simulate((0, -50), START, P, progress=True, events=["x"])
    plain = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")
    plain.simulate((0, 3), START, P, progress=True)
    assert [bar.places[-1] for bar in bars] == [50.0, 3.0]
    assert all(len(bar.places) > 3 for bar in bars)


def test_a_run_that_ends_early_leaves_its_bar_where_it_ended(sleigh, bars):
    run = sleigh.simulate((0, 400), START, P, progress=True, max_steps=40)
    assert not run.success
    assert bars[0].places[-1] == run.t_end < 400.0


@pytest.mark.parametrize("options", [{}, {"backend": "numpy"}])
def test_contacts(bars, options):
    """By the loop over phases, and phase by phase."""
    span = 3 if options else 400
    model = da.compile_model(da.scenes.belt_oscillator(), **options)
    run = model.simulate((0, span), {"x": 0.0, "x_dot": 0.0}, BELT, progress=True)
    (bar,) = bars
    assert run.success and bar.total == bar.places[-1] == span
    assert len(np.unique(bar.places)) >= 3 and "simulating" in bar.titles
    assert np.array_equal(model.simulate((0, span), {"x": 0.0, "x_dot": 0.0}, BELT).y, run.y)


def test_compilation_names_its_stages(bars):
    da.compile_model(da.scenes.chaplygin_sleigh(), progress=True)
    (bar,) = bars
    assert bar.n == bar.total
    assert next(title for title in bar.titles if "(" in title) == "compiling (backend)"
    assert {"compiling (derive)", "compiling (reduce)", "compiling (lower)"} <= {*bar.titles}
    assert bar.titles[-1] == "compiled"


def test_nothing_is_shown_unless_it_is_wanted(sleigh, bars, capsys):
    da.compile_model(da.scenes.chaplygin_sleigh())
    sleigh.simulate((0, 10), START, P)
    assert not bars and capsys.readouterr().err == ""


def test_wrong_values_and_no_tqdm(sleigh, monkeypatch):
    with pytest.raises(OptionError, match="progress"):
        sleigh.simulate((0, 1), START, P, progress="yes")
    with pytest.raises(OptionError, match="progress"):
        da.compile_model(da.scenes.chaplygin_sleigh(), progress="yes")
    monkeypatch.setitem(__import__("sys").modules, "tqdm.auto", None)
    with pytest.raises(MissingExtraError, match=r"dalembert\[progress\]"):
        sleigh.simulate((0, 1), START, P, progress=True)
