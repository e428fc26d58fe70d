"""Compilers of exports: the C compiler of this machine, and the one of the package ziglang for other targets."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from ..errors import MissingExtraError, OptionError

_ZIG = (sys.executable, "-m", "ziglang", "cc")
_OTHER = "Install another release of ziglang, or remove its cache (~/.cache/zig)"
_LIBRARY = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=default")
_WEB = ("-target", "wasm32-wasi", "-mexec-model=reactor", "-std=c99", "-Wl,--strip-all")
_FAST = ("-O2",)
_SMALL = (*_FAST, "-Xclang", "-Os", "-fno-inline")
"""Code of the export is small; the C library remains that of `_FAST`, which ziglang builds once, in half a minute."""


def c_compiler() -> list[str] | None:
    """Return the command of a C compiler for this machine, None where there is none."""
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if found:
        return [found]
    return [*_ZIG, "-s"] if find_spec("ziglang") is not None else None


def shared_library(compiler: Sequence[str], texts: Mapping[str, str]) -> bytes:
    """Return C sources as a shared library for this machine.

    Raises
    ------
    OptionError
        Where the compiler fails.
    """
    remedy = "Repair it, or take it off the PATH: the export then has its sources alone"
    return _compiled([*compiler, *_LIBRARY], ["-lm"], texts, remedy)


def foreign_library(target: str, texts: Mapping[str, str]) -> bytes:
    """Return C sources as a shared library for another machine, a target of ziglang.

    Raises
    ------
    MissingExtraError
        Without the package ziglang.
    OptionError
        Where the compiler fails.
    """
    _need_ziglang("other machines")
    return _compiled([*_ZIG, "-target", target, *_LIBRARY, "-s"], ["-lm"], texts, _OTHER)


def web_assembly(texts: Mapping[str, str], exported: Sequence[str], *, small: bool) -> bytes:
    """Return C sources as a module of WebAssembly that imports nothing.

    Parameters
    ----------
    texts : mapping of str to str
        Sources and headers by their names.
    exported : sequence of str
        Functions that are called from outside.
    small : bool
        Whether its size matters more than its speed.

    Raises
    ------
    MissingExtraError
        Without the package ziglang.
    OptionError
        Where the compiler fails.
    """
    _need_ziglang("WebAssembly")
    command = [*_ZIG, *_WEB, *(_SMALL if small else _FAST), *(f"-Wl,--export={name}" for name in exported)]
    return _compiled(command, [], texts, _OTHER)


def _need_ziglang(target: str) -> None:
    if find_spec("ziglang") is None:
        raise MissingExtraError(
            f"a compiler for {target} is needed, which the package ziglang has; install it with:"
            ' pip install "dalembert[export]"'
        )


def _compiled(command: Sequence[str], libraries: Sequence[str], texts: Mapping[str, str], remedy: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        sources = [name for name in texts if name.endswith(".c")]
        whole = [*command, "-o", "made", *sources, *libraries]
        done = subprocess.run(whole, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise OptionError(
                f"{' '.join(command[:4])} cannot compile the export: {done.stderr.strip()[:500]}. {remedy}"
            )
        return (Path(folder) / "made").read_bytes()
