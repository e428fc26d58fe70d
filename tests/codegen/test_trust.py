"""Who may put code into the cache: what is refused, each with a warning, a right result, and nothing planted run."""

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dalembert as da
from codegen.test_cache import P, files, homes, use
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE, folder_refusal, make_folder, read_kept, write_kept
from dalembert.codegen.llvm.assembly import compile_object
from dalembert.errors import CacheWarning

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="the platform has no owners")
root = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
STRANGER = 4321


@pytest.fixture
def folder(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(path))
    return path


@pytest.fixture(scope="module")
def expected():
    return use(cache=False)


def planted(where):
    """Put code in place of every file that would, if it were believed, be run."""
    for path in files(where):
        path.write_bytes(compile_object("define void @taylor13() { unreachable }"))


def refused(match, folder, expected):
    """Run with a cache that is to be refused."""
    before = {path: path.read_bytes() for path in files(folder)}
    with pytest.warns(CacheWarning, match=match):
        result = use()
    np.testing.assert_array_equal(result, expected)
    assert {path: path.read_bytes() for path in files(folder)} == before


@pytest.mark.parametrize(("mode", "match"), [(0o777, "everybody can write"), (0o770, "its group can write")])
def test_folders_that_others_can_write_are_not_used(folder, expected, mode, match):
    use()
    planted(folder)
    folder.chmod(mode)
    refused(match, folder, expected)


@pytest.mark.parametrize("mode", [0o1777, 0o1775])
def test_a_cache_itself_may_not_be_sticky(folder, expected, mode):
    use()
    folder.chmod(mode)
    refused("can write", folder, expected)


def test_folders_in_the_cache_that_others_can_write_are_not_used(folder, expected):
    use()
    (home,) = homes(folder)
    planted(home)
    home.chmod(0o777)
    refused("everybody can write", home, expected)


def test_pickles_of_others_are_not_read(folder):
    def constants():
        model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numba")
        c = np.empty(model.layout.constants)
        model.kernels.prepare(model.parameter_vector(P), c)
        return c

    expected, mark = constants(), folder.parent / "was run"
    (path,) = files(folder, "*.nbc")
    write_kept(path, pickle.dumps((eval, (f"open({str(mark)!r}, 'w')",))))
    folder.chmod(0o777)
    with pytest.warns(CacheWarning, match="everybody can write"):
        np.testing.assert_array_equal(constants(), expected)
    assert not mark.exists()


@root
def test_folders_of_others_are_not_used(folder, expected):
    use()
    os.chown(folder, STRANGER, STRANGER)
    refused(f"belongs to another user .number {STRANGER}.", folder, expected)


@root
def test_folders_below_those_of_others_are_not_used(tmp_path, monkeypatch, expected):
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    os.chown(theirs, STRANGER, STRANGER)
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(theirs / "cache"))
    refused("belongs to another user", theirs, expected)
    assert not (theirs / "cache").exists()


@pytest.mark.parametrize("mode", [0o777, 0o775])
def test_folders_below_those_that_others_can_write_are_not_used(tmp_path, monkeypatch, expected, mode):
    open_to_all = tmp_path / "open"
    (open_to_all / "cache").mkdir(parents=True, mode=0o700)
    open_to_all.chmod(mode)
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(open_to_all / "cache"))
    refused("can write", open_to_all, expected)


def test_sticky_folders_above_are_allowed(tmp_path):
    above = tmp_path / "like tmp"
    above.mkdir()
    above.chmod(0o1777)
    make_folder(above / "a" / "b")
    assert folder_refusal(above / "a" / "b") == ""
    assert all(path.stat().st_mode & 0o777 == 0o700 for path in (above / "a", above / "a" / "b"))


def test_links_are_followed_as_far_as_they_can_be_believed(tmp_path):
    real, link, bad = tmp_path / "real", tmp_path / "link", tmp_path / "open"
    (real / "deep").mkdir(parents=True, mode=0o700)
    link.symlink_to("real")
    assert folder_refusal(link / "deep") == "" and folder_refusal(link / "new") == ""
    bad.mkdir()
    bad.chmod(0o777)
    (bad / "link").symlink_to(real)
    assert "everybody can write" in folder_refusal(bad / "link")
    (tmp_path / "to bad").symlink_to(bad)
    assert "everybody can write" in folder_refusal(tmp_path / "to bad" / "cache")
    assert "everybody can write" in folder_refusal(real / ".." / "to bad")
    (tmp_path / "circle").symlink_to("circle")
    assert "circle" in folder_refusal(tmp_path / "circle")
    (tmp_path / "file").write_text("")
    assert "not a folder" in folder_refusal(tmp_path / "file" / "cache")


@root
def test_links_of_others_are_not_followed(tmp_path):
    (tmp_path / "real").mkdir(mode=0o700)
    link = tmp_path / "link"
    link.symlink_to("real")
    os.lchown(link, STRANGER, STRANGER)
    assert "belongs to another user" in folder_refusal(link)


def test_everything_is_made_for_the_user_alone(folder):
    held = os.umask(0)
    try:
        use()
    finally:
        os.umask(held)
    paths = [folder, *folder.rglob("*")]
    assert len(paths) > 3
    assert [path for path in paths if path.stat().st_mode & 0o077] == []


@pytest.mark.parametrize(("backend", "suffix"), [("llvm", ".o"), ("numba", ".nbo")])
def test_valid_files_under_other_names_are_noticed(folder, backend, suffix):
    """Was a segmentation fault: a whole object file, of other code."""
    expected = use(backend=backend)
    found = [path for path in files(folder, f"*{suffix}") if not path.parent.name.startswith("loops_")]
    assert len(found) > 1
    contents = [path.read_bytes() for path in found]
    for path, content in zip(found, [*contents[1:], contents[0]], strict=True):
        path.write_bytes(content)
    with pytest.warns(CacheWarning, match="damaged and is rebuilt"):
        result = use(backend=backend)
    np.testing.assert_array_equal(result, expected)


def test_folders_under_other_names_are_noticed(folder, expected):
    use()
    (home,) = homes(folder)
    use(formulation="projected")
    (other,) = (path for path in homes(folder) if path != home)
    shutil.rmtree(home)
    shutil.copytree(other, home)
    with pytest.warns(CacheWarning, match="damaged and is rebuilt"):
        result = use()
    np.testing.assert_array_equal(result, expected)


def test_checksums_cover_the_names_of_file_and_folder(tmp_path):
    path = tmp_path / "a" / "x.o"
    write_kept(path, b"code")
    assert read_kept(path) == b"code"
    for other in (tmp_path / "a" / "y.o", tmp_path / "b" / "x.o"):
        make_folder(other.parent)
        shutil.copy(path, other)
        with pytest.warns(CacheWarning, match="damaged"):
            assert read_kept(other) is None
        assert not other.exists()


@pytest.mark.parametrize("kind", ["link", "folder", "pipe", "open to all", "of others"])
def test_files_that_are_not_plain_files_of_the_user_are_not_believed(tmp_path, kind):
    path, elsewhere = tmp_path / "a" / "x.o", tmp_path / "b" / "x.o"
    write_kept(path, b"code")
    match kind:
        case "link":
            make_folder(elsewhere.parent)
            path.rename(elsewhere)
            path.symlink_to(elsewhere)
        case "folder":
            path.unlink()
            path.mkdir()
        case "pipe":
            path.unlink()
            os.mkfifo(path)
        case "open to all":
            path.chmod(0o666)
        case "of others":
            if os.geteuid() != 0:
                pytest.skip("only root gives files away")
            os.chown(path, STRANGER, STRANGER)
    with pytest.warns(CacheWarning, match="rebuilt"):
        assert read_kept(path) is None


def test_a_process_with_a_refused_cache_sweeps_without_it(tmp_path):
    """The library's own loops are compiled for the process, and nothing is written."""
    open_to_all = tmp_path / "cache"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    script = """
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh())
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
print(model.sweep((0, 1), start, {"m": 1.0, "b": [0.1, 0.2], "I_C": 0.5})["x"].sum())
"""
    environment = os.environ | {ENVIRONMENT_VARIABLE: str(open_to_all), "PYTHONWARNINGS": "default"}
    run = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=200)
    assert run.returncode == 0 and float(run.stdout) > 0.0
    assert run.stderr.count("is not used, because everybody can write") >= 1
    assert list(open_to_all.iterdir()) == []


def test_the_folder_of_the_tests_is_believed():
    assert folder_refusal(Path.home() / ".cache") in ("", folder_refusal(Path.home()))
