"""Cache of object code on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from ..cache import read_kept, write_kept
from .assembly import Shape, compile_object
from .target import target

__all__ = ["object_code"]


def object_code(folder: Path | None, name: str, text: Callable[[], str], shape: Shape = "straight") -> bytes:
    """Return object code of a module of assembly: from `folder` where it is there and whole, else compiled and kept.

    The file is named after `name` and the target; with no folder, nothing is kept. See `compile_object` for
    `shape`.
    """
    if folder is None:
        return compile_object(text(), shape)
    key = hashlib.sha256(target().key.encode()).hexdigest()[:16]
    path = folder / f"{name}_{key}.o"
    held = read_kept(path)
    if held is not None:
        return held
    code = compile_object(text(), shape)
    write_kept(path, code)
    return code
