"""Sweeps kept in a store: the bits of one call, whatever the chunks, restarts and processes; what is refused."""

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import sympy
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError, StoredSweepError, UnknownNameError, ValueInputError
from dalembert.methods.status import Status
from dalembert.options import StoreOptions, SweepOptions
from dalembert.results import cases as sampler
from dalembert.store import chunks as swept_models
from dalembert.store.chunks import ChunkJob
from dalembert.store.store import Store
from dalembert.store.sweep import _most_cases

zarr = pytest.importorskip("zarr")
xarray = pytest.importorskip("xarray")

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
MANY = {"m": 1, "b": np.linspace(0.1, 0.5, 101), "I_C": 0.5}


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X"])


def assert_same(stored, sweep, *names):
    """Compare results to the bit."""
    for name in ("x", "theta", "x_dot", "X", "energy", *names):
        values = stored[name].to_numpy()
        np.testing.assert_array_equal(values.reshape(len(sweep), *values.shape[stored["status"].ndim :]), sweep[name])
    np.testing.assert_array_equal(stored["status"].to_numpy().ravel(), sweep.status)
    np.testing.assert_array_equal(stored["steps"].to_numpy().ravel(), sweep.steps)


@pytest.mark.parametrize("chunk", [None, 1000, 40, 7, 1])
def test_results_do_not_depend_on_chunks(model, tmp_path, chunk):
    few = {**MANY, "b": MANY["b"][:20]} if chunk == 1 else MANY
    stored = model.sweep((0, 5), START, few, to=tmp_path / "s.zarr", chunk=chunk)
    assert_same(stored, model.sweep((0, 5), START, few))
    np.testing.assert_array_equal(stored["b"], few["b"])
    assert "b" in stored.coords and stored.attrs["rtol"] == 1e-8 and stored.attrs["method"] == "taylor"
    assert len(stored.attrs["scene_digest"]) == 32 and stored.attrs["numpy_version"] == np.__version__


def test_results_are_opened_lazily(model, tmp_path):
    stored = model.sweep((0, 1), START, MANY, to=tmp_path / "s.zarr", chunk=30)
    assert stored["x"].chunks == ((30, 30, 30, 11),)


def test_a_grid_labels_its_axes(model, tmp_path):
    grid = da.grid(b=np.linspace(0.1, 0.5, 6), theta_dot=[1.0, 2.0, 3.0, 4.0])
    given = ((0, 3), {k: v for k, v in START.items() if k != "theta_dot"}, {"m": 1, "I_C": 0.5})
    stored = model.sweep(*given, grid=grid, to=tmp_path / "s.zarr", chunk=9)
    sweep = model.sweep(*given, grid=grid)
    whole = sweep.to_xarray()
    assert set(whole.variables) == set(stored.variables)
    for name, values in whole.data_vars.items():
        np.testing.assert_array_equal(stored[name], values)
    assert float(stored["x"].sel(b=0.1, theta_dot=2.0)) == float(whole["x"].sel(b=0.1, theta_dot=2.0))


def test_stores_of_other_kinds_and_a_bar(model, tmp_path, monkeypatch, capsys):
    """A name in the present folder, and a store of zarr in memory."""
    pytest.importorskip("tqdm")
    monkeypatch.chdir(tmp_path)
    for store in ("results.zarr", zarr.storage.MemoryStore()):
        stored = model.sweep((0, 1), START, MANY, to=store, chunk=40, progress=True)
        assert_same(stored, model.sweep((0, 1), START, MANY))
        assert "3.00/3.00" in (shown := capsys.readouterr().err) and "chunk/s" in shown
    assert (tmp_path / "results.zarr").is_dir()


@pytest.mark.parametrize(
    ("seconds", "size", "cases"), [(2.0**-16, 80, 1 << 18), (1e-7, 80, (128 << 20) // 80), (10.0, 80, 1)]
)
def test_chunks_of_seconds_or_of_128_MiB(seconds, size, cases):
    """What a pilot found decides: between 1 and 10 s of one thread, or less where the results would take more."""
    found = {"x": np.zeros((10, size // 8))}
    most = _most_cases(SweepOptions(threads=1), StoreOptions(to="s"), seconds)(found)
    assert most == cases and most * size <= 128 << 20 and (most == 1 or most * seconds <= 10)


def test_units_are_those_of_labelled_arrays(model, tmp_path):
    """Those of an axis go to its values too, and a later call may change them, or leave them."""
    path, units = tmp_path / "s.zarr", {"x": "m", "theta_dot": "seconds", "m": "kg", "b": "m", "X": "N"}
    grid = {"grid": da.grid(b=[0.2, 0.3], theta_dot=[1.0, 2.0])}
    given = ((0, 1), {k: v for k, v in START.items() if k != "theta_dot"}, {"m": 1, "I_C": 0.5})
    with pytest.raises(UnknownNameError, match="unknown variable 'z'"):
        model.sweep(*given, **grid, to=path, units={"z": "m"})
    assert not path.exists()
    stored, whole = model.sweep(*given, **grid, to=path, units=units), model.sweep(*given, **grid).to_xarray(units)
    for name in whole.variables:
        assert stored[name].attrs.get("units", "") == whole[name].attrs.get("units", ""), name
        np.testing.assert_array_equal(stored[name], whole[name])
    assert stored.attrs["parameter_units"] == whole.attrs["parameter_units"]
    again = model.sweep(*given, **grid, to=path, units={"x": "mm"})
    assert (again["x"].units, again["X"].units) == ("mm", "N")
    assert model.sweep(*given, **grid, to=path)["x"].units == "mm"
    with pytest.raises(OptionError, match=r"to_xarray\(units=\.\.\.\)"):
        model.sweep(*given, **grid, units=units)


def test_samples_reductions_events_and_estimates(model, tmp_path):
    x, *_ = model.stages.scene.coordinates
    times, kept = [0.0, 1.0, 2.5], {"most": da.maximum(x), "when": da.first_crossing("theta_dot")}
    one = model.sweep((0, 3), START, MANY, t_eval=times, to=tmp_path / "a.zarr", chunk=30)
    assert_same(one, model.sweep((0, 3), START, MANY, t_eval=times))
    np.testing.assert_array_equal(one["time"], times)
    two = model.sweep((0, 3), START, MANY, reduce=kept, events=["X"], to=tmp_path / "b.zarr", chunk=30)
    sweep = model.sweep((0, 3), START, MANY, reduce=kept, events=["X"])
    np.testing.assert_array_equal(two["most"], sweep.reduced["most"])
    np.testing.assert_array_equal(two["X_count"], sweep.events["X"].count)
    three = model.sweep((0, 3), START, MANY, error_estimate=True, to=tmp_path / "c.zarr", chunk=30)
    estimate = model.sweep((0, 3), START, MANY, error_estimate=True).error_estimate["x"]
    np.testing.assert_array_equal(three["x_error"], estimate)


def test_cases_that_fail_are_statuses_in_the_store(model, tmp_path):
    b = MANY["b"].copy()
    b[[0, 50]] = np.nan
    stored = model.sweep((0, 3), START, {**MANY, "b": b}, to=tmp_path / "s.zarr", chunk=20)
    assert_same(stored, model.sweep((0, 3), START, {**MANY, "b": b}))
    assert int((stored["status"] != 0).sum()) == 2


def test_estimates_with_methods_that_depend_on_the_tolerance(tmp_path):
    """What "auto" takes for the twin at a tighter tolerance is another method."""
    model, options = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected"), {"rtol": 1e-5}
    stored = model.sweep((0, 3), START, MANY, error_estimate=True, to=tmp_path / "s.zarr", chunk=30, **options)
    sweep = model.sweep((0, 3), START, MANY, error_estimate=True, **options)
    assert set(sweep.stats.methods.values()) == {"dop853", "taylor"}
    np.testing.assert_array_equal(stored["x_error"], sweep.error_estimate["x"])


def test_gains_are_decided_once(tmp_path):
    """The formulation baumgarte takes its gains from the first case, in every chunk."""
    model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="baumgarte")
    stored = model.sweep((0, 2), START, MANY, to=tmp_path / "s.zarr", chunk=33)
    np.testing.assert_array_equal(stored["x"], model.sweep((0, 2), START, MANY).final["x"])


@pytest.mark.parametrize("cases", [sampler.random_cases, sampler.sobol_cases])
def test_random_cases_are_the_same_in_any_part(model, tmp_path, cases):
    chosen = cases(3000, 5, b=da.uniform(0.1, 0.5), x_dot=da.normal(1.0, 0.1))
    whole = chosen.columns()
    for first, last in ((0, 1), (1000, 1100), (1023, 1025), (2999, 3000), (7, 7)):
        for name, values in chosen.part(first, last).items():
            np.testing.assert_array_equal(values, whole[name][first:last])
    assert 0.1 <= whole["b"].min() < 0.11 and 0.49 < whole["b"].max() <= 0.5
    assert abs(whole["x_dot"].mean() - 1.0) < 0.01 and abs(whole["x_dot"].std() - 0.1) < 0.01
    start = {k: v for k, v in START.items() if k != "x_dot"}
    stored = model.sweep((0, 1), start, {"m": 1, "I_C": 0.5}, grid=chosen, to=tmp_path / "s.zarr", chunk=700)
    assert_same(stored, model.sweep((0, 1), start, {"m": 1, "I_C": 0.5}, grid=chosen))
    np.testing.assert_array_equal(stored["b"], whole["b"])


def test_arrays_that_are_read_in_parts(model, tmp_path):
    dask_array = pytest.importorskip("dask.array")
    lazy = {**MANY, "b": dask_array.from_array(MANY["b"], chunks=25)}
    stored = model.sweep((0, 2), START, lazy, to=tmp_path / "s.zarr", chunk=30)
    assert_same(stored, model.sweep((0, 2), START, MANY))


def test_a_store_is_completed_and_nothing_is_computed_twice(model, tmp_path, monkeypatch):
    path = tmp_path / "s.zarr"
    real, calls = ChunkJob.run, []

    def run(self, chunk, given, threads):
        if len(calls) == 2:
            raise KeyboardInterrupt
        calls.append(chunk)
        real(self, chunk, given, threads)

    monkeypatch.setattr(ChunkJob, "run", run)
    with pytest.raises(KeyboardInterrupt):
        model.sweep((0, 2), START, MANY, to=path, chunk=20, threads=1)
    done, calls[:] = calls[:], []
    monkeypatch.setattr(ChunkJob, "run", lambda *a: (calls.append(a[1]), real(*a)))
    stored = model.sweep((0, 2), START, MANY, to=path, chunk=20, threads=2)
    assert done == [0, 1] and sorted(calls) == [2, 3, 4, 5]
    assert_same(stored, model.sweep((0, 2), START, MANY))
    calls.clear()
    model.sweep((0, 2), START, MANY, to=path, chunk=20)
    assert calls == []


def test_what_was_interrupted_is_not_kept(model, tmp_path, monkeypatch):
    """Ctrl-C in the middle of a chunk leaves cases INTERRUPTED: these are computed by the next call."""
    real, path = swept_models.sweep_cases, tmp_path / "s.zarr"

    def sweep(self, t_span, initial, parameters, options):
        found = real(self, t_span, initial, parameters, options)
        if len(parameters["b"]) == 21 and parameters["b"][1] == MANY["b"][40]:
            found.status[5:] = Status.INTERRUPTED
        return found

    monkeypatch.setattr(swept_models, "sweep_cases", sweep)
    with pytest.raises(KeyboardInterrupt):
        model.sweep((0, 2), START, MANY, to=path, chunk=20, threads=1)
    monkeypatch.setattr(swept_models, "sweep_cases", real)
    assert_same(model.sweep((0, 2), START, MANY, to=path, chunk=20), model.sweep((0, 2), START, MANY))


@pytest.mark.parametrize("seed", range(6))
def test_a_store_that_was_cut_anywhere_is_completed(model, tmp_path, seed):
    """Every file of the store, those that describe it too, may be cut short or missing."""
    path, rng = tmp_path / "s.zarr", random.Random(seed)
    grid = {"grid": da.grid(b=MANY["b"][:12], m=[1.0, 2.0])}
    given = ((0, 1), START, {"I_C": 0.9})
    model.sweep(*given, **grid, to=path, chunk=8)
    files = sorted(p for p in path.rglob("*") if p.is_file())
    chosen = [path / "zarr.json"] if seed == 0 else rng.sample(files, 9)
    for file in chosen:
        if rng.random() < 0.3 and file.name != "zarr.json":
            file.unlink()
        else:
            file.write_bytes(file.read_bytes()[: rng.randrange(file.stat().st_size)])
    stored, whole = model.sweep(*given, **grid, to=path, chunk=8), model.sweep(*given, **grid).to_xarray()
    for name in whole.variables:
        np.testing.assert_array_equal(stored[name], whole[name])


def test_damaged_pieces_are_computed_again(model, tmp_path):
    path = tmp_path / "s.zarr"
    model.sweep((0, 2), START, MANY, to=path, chunk=20)
    rng = random.Random(3)
    pieces = sorted(p for p in path.rglob("c/*") if p.is_file())
    for piece in rng.sample(pieces, 12):
        data = piece.read_bytes()
        if rng.random() < 0.3:
            piece.unlink()
        elif rng.random() < 0.5:
            piece.write_bytes(data[: len(data) // 2])
        else:
            piece.write_bytes(bytes([data[0] ^ 255]) + data[1:])
    assert_same(model.sweep((0, 2), START, MANY, to=path, chunk=20), model.sweep((0, 2), START, MANY))


@pytest.mark.parametrize("file", ["zarr.json", "progress/zarr.json"])
def test_a_changed_byte_of_a_description_is_mended(model, tmp_path, file):
    """There are two, of which a byte in one does not count; where both are damaged, nothing is done."""
    path, given = tmp_path / "s.zarr", ((0, 1), START, {**MANY, "b": MANY["b"][:8]})
    whole = model.sweep(*given, to=path, chunk=4)
    good, described = (path / file).read_bytes(), dict(Store.open(path).group.attrs)
    chosen = random.Random(5).sample(range(len(good)), 20)
    for number in (good.index(b'_chunk": ') + len(b'_chunk": '), *chosen):
        for bit in (1, 128):
            (path / file).write_bytes(good[:number] + bytes([good[number] ^ bit]) + good[number + 1 :])
            assert dict(Store.open(path).group.attrs) == described and Store.open(path).rows == 4
    xarray.testing.assert_identical(model.sweep(*given, to=path, chunk=4).load(), whole)
    for one in ("zarr.json", "progress/zarr.json"):
        (path / one).write_bytes(good[:100] + b"\xff" + good[101:])
    with pytest.raises(OptionError, match="its description is damaged; nothing was written"):
        model.sweep(*given, to=path, chunk=4)


@pytest.mark.parametrize("moment", ["create", "lay_out", "_make", "write"])
def test_writers_that_begin_one_store_at_the_same_time(model, tmp_path, monkeypatch, moment):
    """Another writer, with other chunks, comes to its end while the first is at that moment."""
    path, given, done = tmp_path / "s.zarr", ((0, 2), START, MANY), []
    whole = model.sweep(*given)
    real = getattr(Store, moment)

    def overtaken(*arguments, **options):
        if not done:
            done.append(True)
            assert_same(model.sweep(*given, to=path, chunk=30, threads=1), whole)
        return getattr(real, "__func__", real)(*arguments, **options)

    monkeypatch.setattr(Store, moment, classmethod(overtaken) if moment == "create" else overtaken)
    assert_same(model.sweep(*given, to=path, chunk=20, threads=1), whole)
    assert done


def test_another_sweep_that_began_the_store_in_the_meantime(model, tmp_path, monkeypatch):
    path, real = tmp_path / "s.zarr", Store.create.__func__

    def overtaken(cls, *arguments):
        monkeypatch.undo()
        model.sweep((0, 1), START, MANY, to=path)
        return real(cls, *arguments)

    monkeypatch.setattr(Store, "create", classmethod(overtaken))
    with pytest.raises(OptionError, match=r"holds another sweep .*its cases"):
        model.sweep((0, 2), START, MANY, to=path)


WRITERS = """
import os, sys
import numpy as np, xarray, zarr
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X"])
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
many = {"m": 1, "b": np.linspace(0.1, 0.5, 101), "I_C": 0.5}
first = os.fork()
stored = model.sweep((0, 2), start, many, to=sys.argv[1], chunk=10 if first else 11)
os.write(1, (" ".join(stored.variables) + chr(10)).encode())
assert np.all(np.isfinite(stored["x"])) and len(stored["x"]) == 101
assert not first or os.wait()[1] == 0
"""


def test_processes_that_begin_one_store(model, tmp_path):
    """All end well, and have the variables in the same order, that of the sweep."""
    path = tmp_path / "s.zarr"
    command = [sys.executable, "-c", WRITERS, path]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200)
    assert done.returncode == 0, done.stderr
    names = "b x y theta x_dot y_dot theta_dot X energy status steps t_end"
    assert done.stdout.splitlines() == [names, names]
    assert_same(model.sweep((0, 2), START, MANY, to=path), model.sweep((0, 2), START, MANY))


def test_what_was_asked_before_is_refused_by_name(model, tmp_path):
    path = tmp_path / "s.zarr"
    model.sweep((0, 2), START, MANY, to=path)
    before = sorted((p, p.stat().st_mtime_ns) for p in path.rglob("*"))
    with pytest.raises(OptionError, match=r"holds another sweep .*its cases"):
        model.sweep((0, 2), START, {**MANY, "m": 2}, to=path)
    with pytest.raises(OptionError, match="other: its options"):
        model.sweep((0, 2), START, MANY, rtol=1e-9, to=path)
    with pytest.raises(OptionError, match="other: its scene"):
        da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X", "Y"]).sweep((0, 2), START, MANY, to=path)
    with pytest.raises(OptionError, match="exists and resume=False"):
        model.sweep((0, 2), START, MANY, to=path, resume=False)
    assert before == sorted((p, p.stat().st_mtime_ns) for p in path.rglob("*"))


def test_what_is_no_store_is_left_alone(model, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OptionError, match="exists and is no store of a sweep"):
        model.sweep((0, 2), START, MANY, to=tmp_path)
    zarr.create_group(tmp_path / "other.zarr")
    with pytest.raises(OptionError, match="a zarr group that no sweep wrote"):
        model.sweep((0, 2), START, MANY, to=tmp_path / "other.zarr")
    with pytest.raises(OptionError, match=r"notes\.txt' is a file, and a store is a folder; nothing was written"):
        model.sweep((0, 2), START, MANY, to=tmp_path / "notes.txt")
    with pytest.raises(OptionError, match=r"notes\.txt' is a file, and a store is a folder; nothing was written"):
        model.sweep((0, 2), START, MANY, to=zarr.storage.LocalStore(tmp_path / "notes.txt"))
    with pytest.raises(OptionError, match="to= takes a path of a folder or a store of zarr, not 3, of type int"):
        model.sweep((0, 2), START, MANY, to=3)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_options_of_stores(model, tmp_path):
    with pytest.raises(OptionError, match="chunk must be at least one case, not 0"):
        model.sweep((0, 2), START, MANY, to=tmp_path / "s", chunk=0)
    with pytest.raises(OptionError, match=r"client must be a running distributed\.Client"):
        model.sweep((0, 2), START, MANY, to=tmp_path / "s", client="cluster")
    with pytest.raises(ValueInputError, match="must have one length: m has 3, b has 101"):
        model.sweep((0, 2), START, {**MANY, "m": [1, 2, 3]}, to=tmp_path / "s")
    with pytest.raises(ValueInputError, match="takes distributions"):
        da.random_cases(10, 1, b=0.3)
    with pytest.raises(ValueInputError, match="count must be at least 1"):
        da.sobol_cases(0, 1, b=da.uniform(0, 1))
    with pytest.raises(OptionError, match="give to= too"):
        model.sweep((0, 2), START, MANY, chunk=10)
    assert not (tmp_path / "s").exists()


def test_a_full_disk_ends_with_a_message_that_says_how_to_go_on(model, tmp_path, monkeypatch):
    from dalembert.store.store import Store

    real = Store.write

    def write(self, chunk, request, columns):
        if chunk >= 2:
            raise OSError(28, "No space left on device")
        real(self, chunk, request, columns)

    monkeypatch.setattr(Store, "write", write)
    with pytest.raises(StoredSweepError, match=r"2 of 6 chunks are in .*No space left.*the same call continues"):
        model.sweep((0, 2), START, MANY, to=tmp_path / "s.zarr", chunk=20, threads=1)
    monkeypatch.setattr(Store, "write", real)
    assert_same(model.sweep((0, 2), START, MANY, to=tmp_path / "s.zarr", chunk=20), model.sweep((0, 2), START, MANY))


def test_parameters_of_events_may_be_random(model, tmp_path):
    """A parameter that only an event has, as a random case of a plain sweep and of a stored one."""
    x, threshold = model.stages.scene.coordinates[0], sympy.Symbol("threshold")
    cases = da.random_cases(50, 2, threshold=da.uniform(0.0, 0.6))
    given, options = (
        ((0, 3), START, {"m": 1, "b": 0.3, "I_C": 0.5}),
        {"grid": cases, "events": [da.Event(x - threshold, name="passed")]},
    )
    sweep = model.sweep(*given, **options)
    assert 0 < sweep.events["passed"].count.sum()
    stored = model.sweep(*given, **options, to=tmp_path / "s.zarr", chunk=20)
    np.testing.assert_array_equal(stored["passed_first"], sweep.events["passed"].first)


WATCHED = """
import sys
import numpy as np
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X"])
x, *_ = model.stages.scene.coordinates
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
bounce = da.Event(x - 0.3, direction=1, terminal=3, name="there")
kept = {"most": da.maximum(x), "when": da.first_crossing(x - 0.1)}
found = model.sweep((0, 2), start, {"m": 1, "b": np.linspace(0.1, 0.5, 9), "I_C": 0.5}, to=sys.argv[1], chunk=4,
                    events=[bounce], reduce=kept)
print(float(found["most"].sum()))
"""


@pytest.mark.matrix
def test_another_process_knows_the_sweep_again(tmp_path):
    """Events and reductions are the same in every process, whatever its hash seed."""
    told = []
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", WATCHED, tmp_path / "s.zarr"]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        assert done.returncode == 0, done.stderr
        told.append(done.stdout)
    assert told[0] == told[1]


def test_every_case_has_its_own_record(tmp_path):
    q, u = dynamicsymbols("q u")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", q * N.x)
    scene = da.Scene("driven", frame=N, origin=O, coordinates=[q])
    scene.add_bodies(Particle("p", P, 1))
    scene.add_inputs(u)
    scene.add_loads((P, (u - q) * N.x))
    model, times = da.compile_model(scene), np.linspace(0, 2, 9)
    records = {u: da.samples(times, np.random.default_rng(4).normal(size=(30, 9)))}
    given = ((0, 2), {q: 0.1, q.diff(): 0.0}, {})
    stored = model.sweep(*given, inputs=records, to=tmp_path / "s.zarr", chunk=7)
    np.testing.assert_array_equal(stored["q"], model.sweep(*given, inputs=records).final["q"])


KILLED = """
import sys
import numpy as np
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X"])
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
print("ready", flush=True)
model.sweep((0, 5), start, {"m": 1, "b": np.linspace(0.1, 0.5, 101), "I_C": 0.5}, to=sys.argv[1], chunk=1)
print("done", flush=True)
"""


@pytest.mark.matrix
def test_a_process_may_be_killed_at_any_moment(model, tmp_path):
    path, rng = tmp_path / "s.zarr", random.Random(7)
    for _ in range(4):
        process = subprocess.Popen([sys.executable, "-c", KILLED, path], stdout=subprocess.PIPE, text=True)
        assert process.stdout.readline() == "ready\n"
        time.sleep(rng.uniform(0.1, 0.8))
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    assert_same(model.sweep((0, 5), START, MANY, to=path, chunk=1), model.sweep((0, 5), START, MANY))


@pytest.fixture(scope="module")
def client():
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "10 minutes"}),  # a killed one may take a while
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_a_cluster_gives_the_same_bits(model, tmp_path, client):
    stored = model.sweep((0, 5), START, MANY, to=tmp_path / "s.zarr", chunk=9, client=client)
    assert_same(stored, model.sweep((0, 5), START, MANY))
    grid = da.grid(b=np.linspace(0.1, 0.5, 6), m=[1.0, 2.0])
    given = ((0, 3), START, {"I_C": 0.9})
    np.testing.assert_array_equal(
        model.sweep(*given, grid=grid, to=tmp_path / "g.zarr", chunk=4, client=client)["x"].to_numpy().ravel(),
        model.sweep(*given, grid=grid).final["x"],
    )
    cases = da.sobol_cases(90, 3, b=da.uniform(0.1, 0.5), m=da.normal(1.0, 0.01))
    np.testing.assert_array_equal(
        model.sweep(*given, grid=cases, to=tmp_path / "r.zarr", chunk=7, client=client)["x"],
        model.sweep(*given, grid=cases).final["x"],
    )


@pytest.mark.matrix
def test_workers_may_be_killed(model, tmp_path, client):
    import threading

    rng, over = random.Random(1), threading.Event()

    def kill():
        for _ in range(3):
            if over.wait(rng.uniform(0.3, 0.8)):
                return
            pids = list(client.run(os.getpid).values())
            if pids:  # both may be starting again
                os.kill(rng.choice(pids), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        stored = model.sweep((0, 5), START, MANY, to=tmp_path / "s.zarr", chunk=1, client=client)
    finally:
        over.set()
        killer.join()
    assert_same(stored, model.sweep((0, 5), START, MANY))


def test_a_closed_client_is_refused(model, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster:
        closed = distributed.Client(cluster)
        closed.close()
    with pytest.raises(OptionError, match="this one is closed"):
        model.sweep((0, 2), START, MANY, to=tmp_path / "s.zarr", client=closed)
