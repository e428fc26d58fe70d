"""Packages that pip installs: the simulator in C as a library, and a module that calls it."""

from __future__ import annotations

import base64
import hashlib
import platform
import re
import sysconfig
from typing import Any

from ..codegen.c.contact_simulator import c_files
from ..codegen.c.descriptions import CSource, plain
from ..codegen.c.printing import prefix_of
from ..codegen.rendering import render
from ..errors import MissingExtraError
from ..version import __version__
from .compilers import c_compiler, shared_library
from .folder import zipped

_SUFFIXES = {"Darwin": "dylib", "Windows": "dll"}
_TAG = "py3-none-{}"


def wheel_files(source: CSource) -> dict[str, bytes]:
    """Return a package for this machine, by the name of its file.

    Raises
    ------
    MissingExtraError
        Where there is no C compiler.
    OptionError
        Where the compiler fails.
    """
    compiler = c_compiler()
    if compiler is None:
        raise MissingExtraError(
            "a package has compiled code, and this machine has no C compiler on its PATH (cc, gcc or clang); install"
            ' one, or pip install "dalembert[export]"'
        )
    prefix, texts = prefix_of(source.program.name), c_files(source)
    library = f"simulator.{_SUFFIXES.get(platform.system(), 'so')}"
    sources = {name: texts[name] for name in (f"{prefix}.c", f"{prefix}.h")}
    sources["package.c"] = render("wheel/package.c.j2", _functions(source, prefix))
    tag = _TAG.format(re.sub(r"\W", "_", sysconfig.get_platform()))
    described = f"{prefix}-1.0.dist-info"
    metadata = render("wheel/metadata.j2", {"name": prefix, "scene": plain(source.program.name)})
    files: dict[str, bytes] = {
        f"{prefix}/__init__.py": render("wheel/package.py.j2", _module(source, prefix, library)).encode(),
        f"{prefix}/{library}": shared_library(compiler, sources),
        f"{described}/METADATA": metadata.encode(),
        f"{described}/WHEEL": render("wheel/wheel.j2", {"tag": tag}).encode(),
    }
    record = [f"{name},sha256={_digest(content)},{len(content)}" for name, content in files.items()]
    files[f"{described}/RECORD"] = "\n".join([*record, f"{described}/RECORD,,", ""]).encode()
    return {f"{prefix}-1.0-{tag}.whl": zipped(files)}


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()


def _functions(source: CSource, prefix: str) -> dict[str, Any]:
    """Return the variables of ``wheel/package.c.j2``."""
    layout, variables = source.program.layout, len(source.program.kernel("expand").outputs)
    return {
        "prefix": prefix,
        "upper": prefix.upper(),
        "n_row": variables + len(layout.outputs) + 2,
        "n_inputs": len(layout.inputs),
        "n_outputs": len(layout.outputs),
        "n_variables": variables,
        "first_energy": variables + len(layout.outputs),
        "n_events": len(source.watched),
    }


def _module(source: CSource, prefix: str, library: str) -> dict[str, Any]:
    """Return the variables of ``wheel/package.py.j2``; mappings and names are printed as Python prints them."""
    layout, numbers = source.program.layout, source.numbers

    def known(names: tuple[str, ...], otherwise: float | None = None) -> str:
        return ascii({name: float(numbers[name]) if name in numbers else otherwise for name in names})

    names = [*layout.coordinates, *layout.rates, *layout.states, *layout.outputs, "kinetic", "potential"]
    return {
        "prefix": prefix,
        "scene": ascii(source.program.name)[1:-1],
        "first": ascii(names[0])[1:-1],
        "method": source.method,
        "order": source.order,
        "rtol": repr(source.tolerances[0]),
        "atol": repr(source.tolerances[1]),
        "version": __version__,
        "initial": known(source.start.given),
        "parameters": known(source.parameters),
        "inputs": known(layout.inputs, 0.0),
        "names": ascii(names),
        "events": ascii(list(source.watched)) if source.watched else "",
        "library": library,
    }
