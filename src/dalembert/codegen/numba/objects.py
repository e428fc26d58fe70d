"""Object code on disk: written whole, checked when read."""

from __future__ import annotations

import hashlib
import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

from ...errors import CacheWarning
from .llvm import compile_object, target_name

__all__ = ["object_code"]


def object_code(folder: Path | None, name: str, text: Callable[[], str], *, straight: bool = True) -> bytes:
    """Return object code of a module of assembly: from `folder` where it is there and whole, else compiled and kept.

    The file is named after `name` and the processor; with no folder, nothing is kept. See `compile_object` for
    `straight`.
    """
    if folder is None:
        return compile_object(text(), straight=straight)
    key = hashlib.sha256(target_name().encode()).hexdigest()[:16]
    path = folder / f"{name}_{key}.o"
    held = _read(path)
    if held is not None:
        return held
    code = compile_object(text(), straight=straight)
    _write(path, code)
    return code


def _read(path: Path) -> bytes | None:
    """Return what `_write` wrote, or None where the file is missing or damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, code = data[:32], data[32:]
    if hashlib.sha256(code).digest() == digest:
        return code
    warnings.warn(f"the cached code {path} was damaged and is rebuilt", CacheWarning, stacklevel=2)
    return None


def _write(path: Path, code: bytes) -> None:
    """Write code with its digest, by an atomic rename; a folder that cannot be written keeps nothing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        with os.fdopen(handle, "wb") as file:
            file.write(hashlib.sha256(code).digest() + code)
        os.replace(temporary, path)
    except OSError:
        return
