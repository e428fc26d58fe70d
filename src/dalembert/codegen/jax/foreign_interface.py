"""XLA's interface for foreign functions, as the headers that come with JAX describe it."""

from __future__ import annotations

import re
from pathlib import Path

import jax

from ...once import once
from ..llvm.foreign_batch import Interface

__all__ = ["foreign_interface"]

_KNOWN_VERSION = 0, 5
"""The major version that the handlers are written for, and its last minor one: a later one may add fields to what the
handlers read."""

_BEFORE = 6
"""Words before the first function of the interface."""


@once
def foreign_interface() -> Interface | None:
    """Return the interface; None where it is not one that is known."""
    header = Path(jax.ffi.include_dir()) / "xla" / "ffi" / "api" / "c_api.h"
    try:
        text = header.read_text(encoding="utf-8")
    except OSError:
        return None
    found = [re.search(rf"#define XLA_FFI_API_{part} (\d+)", text) for part in ("MAJOR", "MINOR")]
    if found[0] is None or found[1] is None:
        return None
    version = int(found[0][1]), int(found[1][1])
    if version[0] != _KNOWN_VERSION[0] or version[1] > _KNOWN_VERSION[1]:
        return None
    functions = re.findall(r"^ *_XLA_FFI_API_STRUCT_FIELD\(XLA_FFI_(\w+)\);", text, re.MULTILINE)
    return Interface(version, {name: _BEFORE + place for place, name in enumerate(functions)})
