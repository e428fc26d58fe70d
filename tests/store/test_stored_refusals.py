"""Messages of stored sweeps where packages, memory, space, workers or a common instruction set are missing."""

import builtins
import os
import subprocess
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import MissingExtraError, OptionError, StoredSweepError, StoredSweepWarning
from dalembert.store import cluster as on_cluster
from dalembert.store import sweep as stored_sweep
from dalembert.store.chunks import ChunkJob
from dalembert.store.description import difference, machine
from dalembert.store.jax_device import device_of

zarr = pytest.importorskip("zarr")
xarray = pytest.importorskip("xarray")

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
MANY = {"m": 1, "b": np.linspace(0.1, 0.5, 60), "I_C": 0.5}


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh())


@pytest.mark.parametrize("package", ["zarr", "xarray", "distributed"])
def test_missing_packages_are_named_with_the_line_that_installs_them(model, tmp_path, monkeypatch, package):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name.split(".")[0] == package:
            raise ImportError(f"No module named {package!r}", name=package)
        return real(name, *rest, **more)

    class Running:
        status = "running"

    monkeypatch.setattr(builtins, "__import__", without)
    client = Running() if package == "distributed" else None
    with pytest.raises(MissingExtraError, match=rf'needs {package}; install it with: pip install "dalembert\[dask\]"'):
        model.sweep((0, 1), START, MANY, to=tmp_path / "s.zarr", client=client)
    assert not (tmp_path / "s.zarr").exists()


@pytest.mark.parametrize("what", ["instruction set", "numpy"])
def test_a_store_begun_with_other_code_is_not_completed_but_opened(model, tmp_path, monkeypatch, what):
    """Where nothing is missing, nothing would be mixed."""
    path, given = tmp_path / "s.zarr", ((0, 1), START, MANY)
    whole = model.sweep(*given, to=path, chunk=20)
    monkeypatch.setattr(stored_sweep, "machine", lambda names: {**machine(names), what: "another"})
    np.testing.assert_array_equal(model.sweep(*given, to=path, chunk=20)["x"], whole["x"])
    next((path / "x" / "c").iterdir()).unlink()
    with pytest.raises(OptionError, match=rf"lacks chunks.*has the {what} 'another', and the sweep was begun with"):
        model.sweep(*given, to=path, chunk=20)


def test_a_package_that_a_machine_lacks_is_named():
    assert "the no_such_package 'none'" in difference({"no_such_package": "1.0"}, machine(["no_such_package"]))


@pytest.mark.parametrize("what", ["instruction set", "dalembert", "numpy"])
def test_a_worker_with_other_code_is_refused(model, tmp_path, monkeypatch, what):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(on_cluster, "machine", lambda names: {**machine(names), what: "another"})
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
        pytest.raises(StoredSweepError, match=f"this worker has the {what} 'another'"),
    ):
        model.sweep((0, 1), START, MANY, to=tmp_path / "s.zarr", chunk=20, client=client)


def test_a_cluster_without_workers_is_named_and_waited_for(model, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    watch = on_cluster._watch
    monkeypatch.setattr(on_cluster, "_LOOK", 0.1)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        later = threading.Timer(1.0, cluster.scale, (1,))
        monkeypatch.setattr(on_cluster, "_watch", lambda client: (later.start(), watch(client))[1])
        with pytest.warns(StoredSweepWarning, match=r"has no worker, and the sweep waits for one.*kept"):
            stored = model.sweep((0, 1), START, MANY, to=tmp_path / "s.zarr", chunk=20, client=client)
        later.join()
    np.testing.assert_array_equal(stored["x"], model.sweep((0, 1), START, MANY).final["x"])


def test_a_cluster_that_goes_away_ends_with_a_message(model, tmp_path):
    distributed = pytest.importorskip("distributed")
    real, calls = ChunkJob.given, []
    cluster = distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None)
    client = distributed.Client(cluster)

    def given(self, chunk):
        calls.append(chunk)
        if len(calls) == 40:
            client.cancel(list(client.futures.values()) and [distributed.Future(k, client) for k in client.futures])
        return real(self, chunk)

    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ChunkJob, "given", given)
            with pytest.raises(StoredSweepError, match=r"the cluster cancelled it.*the same call continues"):
                model.sweep((0, 1), START, MANY, to=tmp_path / "s.zarr", chunk=1, client=client)
    finally:
        client.close()
        cluster.close()
    stored = model.sweep((0, 1), START, MANY, to=tmp_path / "s.zarr", chunk=1)
    np.testing.assert_array_equal(stored["x"], model.sweep((0, 1), START, MANY).final["x"])


LIMITS = {"RLIMIT_FSIZE": (20_000, 5_000, "OSError"), "RLIMIT_AS": (3_000_000, 1_500_000, "MemoryError")}
"""The number of cases, those of a chunk, and what is raised."""

LIMITED = f"""
import os, resource, sys
import numpy as np, xarray, zarr
import dalembert as da
from dalembert.errors import StoredSweepError
model = da.compile_model(da.scenes.chaplygin_sleigh())
start = {{"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}}
for name, (count, chunk, _) in {LIMITS}.items():
    if not os.fork():
        path = os.path.join(sys.argv[1], name)
        span, many = (0, 1), {{"m": 1, "b": np.linspace(0.1, 0.5, count), "I_C": 0.5}}
        model.sweep(span, start, {{**many, "b": many["b"][:300]}}, to=path + "-few", chunk=100, threads=1)
        which = getattr(resource, name)
        if which == resource.RLIMIT_AS:
            used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
            limit = used + (60 << 20)
        else:
            import signal
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            limit = 20_000
        resource.setrlimit(which, (limit, resource.getrlimit(which)[1]))
        try:
            model.sweep(span, start, many, to=path, chunk=chunk, threads=1)
        except StoredSweepError as error:
            print(name, error, flush=True)
        os._exit(0)
    os.wait()
"""


@pytest.fixture(scope="module")
def limited(tmp_path_factory):
    """Return a folder with the stores of processes with limits, and what each printed."""
    folder = tmp_path_factory.mktemp("limited")
    done = subprocess.run([sys.executable, "-c", LIMITED, folder], capture_output=True, text=True, check=False)
    return folder, done.stdout, done.stderr


@pytest.mark.parametrize("limit", LIMITS)
def test_limits_of_files_and_memory_end_with_a_message(model, limited, limit):
    """Real ones: files of 20 kB, which arrays of a chunk exceed, and 60 MB of memory for chunks that need more."""
    folder, told, errors = limited
    count, chunk, reason = LIMITS[limit]
    message = "\n".join(line for line in told.splitlines() if line.startswith(limit))
    assert "0 of" in message and reason in message and "the same call continues" in message, errors
    if limit == "RLIMIT_FSIZE":
        many = {**MANY, "b": np.linspace(0.1, 0.5, count)}
        stored = model.sweep((0, 1), START, many, to=folder / limit, chunk=chunk)
        np.testing.assert_array_equal(stored["x"], model.sweep((0, 1), START, many).final["x"])


def test_a_chunk_whose_workers_die_again_and_again(model, tmp_path, monkeypatch):
    """As where it needs more memory than workers have: it is sent again some times, the others are computed."""
    distributed, real, tried = pytest.importorskip("distributed"), on_cluster._run_remotely, []
    path = tmp_path / "s.zarr"

    def run(wanted, text, chunk, given):
        if chunk == 1:
            raise distributed.KilledWorker("task", SimpleNamespace(address="inproc"), 3)
        real(wanted, text, chunk, given)

    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        submit = client.submit

        def submit_instead(_, *given, **options):
            tried.append(given[2])
            return submit(run, *given, **options)

        monkeypatch.setattr(client, "submit", submit_instead)
        with pytest.raises(StoredSweepError, match=r"2 of 3 chunks are in .*Chunk 1 could not be computed: KilledWor"):
            model.sweep((0, 1), START, MANY, to=path, chunk=20, client=client)
    assert sorted(tried) == [0, *[1] * (1 + on_cluster._MOST_DEATHS), 2]
    stored = model.sweep((0, 1), START, MANY, to=path, chunk=20)
    np.testing.assert_array_equal(stored["x"], model.sweep((0, 1), START, MANY).final["x"])


def test_workers_in_other_folders_find_the_store(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert on_cluster._from_anywhere("s.zarr") == on_cluster._from_anywhere(tmp_path / "s.zarr") == tmp_path / "s.zarr"
    assert on_cluster._from_anywhere("s3://bucket/s.zarr") == "s3://bucket/s.zarr"


def test_a_worker_that_sees_another_store_is_named(model, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(on_cluster, "_from_anywhere", lambda where: tmp_path / "elsewhere.zarr")
    monkeypatch.setattr(on_cluster, "_MODELS", {})
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
        pytest.raises(StoredSweepError, match=r"does not see the store '.*elsewhere.zarr'.*all machines must share it"),
    ):
        model.sweep((0, 1), START, MANY, to=tmp_path / "s.zarr", chunk=20, client=client)


class SmallStore(zarr.storage.LocalStore):
    """A store on a disk that becomes full."""

    room = 0

    async def set(self, key, value, *rest):
        if len(value) > type(self).room:
            raise OSError(28, "No space left on device")
        type(self).room -= len(value)
        await super().set(key, value, *rest)


@pytest.mark.parametrize("on_a_cluster", [False, True])
def test_a_disk_that_becomes_full(model, tmp_path, on_a_cluster):
    """At the layout, then after some chunks; with more room the same call comes to its end."""
    distributed, many = pytest.importorskip("distributed"), {**MANY, "b": np.linspace(0.1, 0.5, 4000)}
    store, given = SmallStore(tmp_path / "s.zarr"), ((0, 1), START, many)
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        options = {"to": store, "chunk": 500, "client": client if on_a_cluster else None, "threads": 1}
        SmallStore.room = 5_000
        with pytest.raises(StoredSweepError, match=r"could not be laid out: .*No space left.*same call continues"):
            model.sweep(*given, **options)
        if on_a_cluster:  # no room for the program of the model
            SmallStore.room = 20_000
            with pytest.raises(StoredSweepError, match=r"0 of 8 chunks are in .*No space left.*same call continues"):
                model.sweep(*given, **options)
        SmallStore.room = 100_000 + 80_000 * on_a_cluster
        with pytest.raises(StoredSweepError, match=r"[1-7] of 8 chunks are in .*No space left.*same call continues"):
            model.sweep(*given, **options)
        SmallStore.room = 10_000_000
        stored = model.sweep(*given, **options)
    np.testing.assert_array_equal(stored["x"], model.sweep(*given).final["x"])


DEVICES = """
import sys
from types import SimpleNamespace
sys.modules["distributed"] = SimpleNamespace(get_worker=lambda: SimpleNamespace(name=1))
from dalembert.store.jax_device import take_own_device
take_own_device()
import jax.numpy as jnp
print(*(device.id for device in jnp.zeros(3).devices()))
"""


def test_a_worker_takes_the_device_of_its_number():
    """One that sees two devices: this processor twice. Of its cluster the code asks for its name alone."""
    pytest.importorskip("jax")
    environment = {**os.environ, "XLA_FLAGS": "--xla_force_host_platform_device_count=2", "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-c", DEVICES]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.stdout.strip() == "1", done.stderr


@pytest.mark.parametrize(("worker", "device"), [(0, "a"), (4, "b"), ("cluster-0-2", "c"), ("alone", "a")])
def test_devices_go_round_by_the_numbers_of_workers(worker, device):
    assert device_of(worker, "abc") == device
