"""The content-addressed cache of generated modules.

A module lives in a folder of its own, named by its digest, with whatever the backend's compiler
keeps beside it. Files appear by an atomic rename, so that processes may share the cache; a file
that is not what it should be is rebuilt with a warning.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import linecache
import os
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

from ..errors import CacheWarning
from ..naming import Namer
from ..once import exclusively

__all__ = ["ENVIRONMENT_VARIABLE", "directory", "keep", "kept_text", "load", "load_in_memory", "rebuilding", "store"]

ENVIRONMENT_VARIABLE = "DALEMBERT_CACHE_DIR"


def directory() -> Path:
    """Return the folder of the cache: ``$DALEMBERT_CACHE_DIR``, or the user's cache folder of the platform."""
    chosen = os.environ.get(ENVIRONMENT_VARIABLE)
    if chosen:
        return Path(chosen).expanduser()
    import platformdirs

    return platformdirs.user_cache_path("dalembert", appauthor=False)


def store(name: str, digest: str, source: str) -> Path:
    """Return the path of the file that holds `source`, writing it where it is missing or damaged."""
    path = directory() / f"{Namer()(name)[:40]}_{digest}" / "kernels.py"
    try:
        held = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        held = None
    except UnicodeDecodeError:
        held = ""
    if held == source:
        return path
    if held is not None:
        warnings.warn(f"the cached module {path} was damaged and is rebuilt", CacheWarning, stacklevel=2)
        _discard(path)
    _write(path, source)
    return path


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
        file.write(text)
    os.replace(temporary, path)


def kept_text(digest: str, make: Callable[[], str]) -> str:
    """Return the text that `make` gives and `digest` determines: from the cache, with its checksum, or made and kept.

    A damaged text is made anew with a warning; where the cache cannot be used, nothing is kept, of which `keep` warns.
    """
    path = directory() / "texts" / digest
    with contextlib.suppress(OSError):
        checksum, _, text = path.read_bytes().decode("utf-8", "replace").partition("\n")
        if hashlib.sha256(text.encode()).hexdigest() == checksum:
            return text
        warnings.warn(f"the cached text {path} was damaged and is rebuilt", CacheWarning, stacklevel=2)
    text = make()
    with contextlib.suppress(OSError):
        _write(path, f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}")
    return text


def _discard(path: Path) -> None:
    """Remove what a compiler kept beside a module."""
    shutil.rmtree(path.parent / "__pycache__", ignore_errors=True)


def keep(name: str, digest: str, source: str) -> Path | None:
    """Return the path of `store`; None, with a warning, if the cache cannot be used."""
    try:
        return store(name, digest, source)
    except OSError as failure:
        text = f"the module cache {directory()} cannot be used ({failure}); nothing is kept. Set {ENVIRONMENT_VARIABLE}"
        warnings.warn(f"{text} to a folder that can be written", CacheWarning, stacklevel=2)
        return None


def load(path: Path | None, digest: str, source: str) -> ModuleType:
    """Return the module that holds `source`: the file that `keep` returned, or one in memory."""
    return load_in_memory(digest, source) if path is None else _import(path, digest)


@contextlib.contextmanager
def rebuilding(file: Path | None, again: Callable[[], object]) -> Iterator[None]:
    """Guard the loading of compiled code kept beside the module `file`: if it fails, discard that and do it `again`."""
    try:
        yield
    except Exception as failure:  # a damaged file may fail in any way; a real fault fails again below
        kept = None if file is None else file.parent / "__pycache__"
        if kept is None or not any(kept.glob("*.nb?")):
            raise
        text = f"compiled code cached in {kept} could not be used ({failure}) and is rebuilt"
        warnings.warn(text, CacheWarning, stacklevel=3)
        shutil.rmtree(kept, ignore_errors=True)
        again()


def _import(path: Path, digest: str) -> ModuleType:
    qualified = f"dalembert_generated_{digest}"
    spec = importlib.util.spec_from_file_location(qualified, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[qualified] = module
    with exclusively("bytecode"), _no_bytecode():
        spec.loader.exec_module(module)
    return module


@contextlib.contextmanager
def _no_bytecode() -> Iterator[None]:
    """Keep Python from caching bytecode, which it would trust by time stamp alone."""
    held, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = held


def load_in_memory(digest: str, source: str) -> ModuleType:
    """Return the module that holds `source` without touching the disk; tracebacks still show its lines."""
    filename = f"<dalembert generated {digest}>"
    module = ModuleType(f"dalembert_generated_{digest}")
    linecache.cache[filename] = (len(source), None, source.splitlines(keepends=True), filename)
    exec(compile(source, filename, "exec"), module.__dict__)
    return module
