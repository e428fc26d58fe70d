"""Kernels compiled by numba, in the checked cache instead of numba's own, which reads files without a check.

A kernel that is evaluated by name is an ordinary function of numba. Its own cache keeps an index beside the code,
believes both, and puts them where ``NUMBA_CACHE_DIR`` says. Here each kernel and signature has one file, in
the folder of the module, under its checksum. The file is a pickle, as numba makes it.
"""

from __future__ import annotations

import hashlib
import pickle
import warnings
from pathlib import Path
from typing import Any, final

import numba
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from ...errors import CacheWarning
from ..cache import read_kept, write_kept


def keep_compiled(kernel: Any, folder: Path) -> None:
    """Keep the code that numba compiles of a kernel in the folder of its module."""
    kernel._cache = _Kept(kernel.py_func.__name__, folder)


@final
class _Kept(NullCache):
    """Compiled kernels on disk, in place of numba's own `FunctionCache`."""

    def __init__(self, name: str, folder: Path) -> None:
        self._name, self._folder = name, folder

    @property
    def cache_path(self) -> str:
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for a signature, None where there is none."""
        target_context.refresh()
        path = self._path(sig, target_context.codegen())
        data = read_kept(path)
        if data is None:
            return None
        try:
            return CompileResult._rebuild(target_context, *pickle.loads(data))
        except Exception as failure:  # perhaps made by another version of numba
            text = f"the cached code {path} could not be used ({failure}) and is rebuilt"
            warnings.warn(text, CacheWarning, stacklevel=2)
            return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep the code for a signature."""
        if not cres.library.has_dynamic_globals and all(lifted.can_cache for lifted in cres.lifted):
            write_kept(self._path(sig, cres.codegen), dumps(cres._reduce()))

    def _path(self, sig: Any, codegen: Any) -> Path:
        key = repr((numba.__version__, sig, codegen.magic_tuple()))
        return self._folder / f"{self._name}_{hashlib.sha256(key.encode()).hexdigest()[:16]}.nbc"
