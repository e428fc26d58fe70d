"""Instruction set and versions on which the last bits of results depend."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from ...codegen.llvm.target import target
from ...version import __version__

__all__ = ["difference", "machine", "names_of"]

_INSTRUCTIONS = "instruction set"
_PACKAGES = ("numpy", "sympy", "llvmlite")
_OF_BACKENDS = {"numba": ("numba",), "jax": ("jax", "jaxlib", "diffrax"), "numpy": ("scipy",)}


def names_of(backend: str) -> tuple[str, ...]:
    """Return the names of the properties of a machine on which results of a backend depend."""
    return (_INSTRUCTIONS, "dalembert", *_PACKAGES, *_OF_BACKENDS.get(backend, ()))


def machine(names: Iterable[str]) -> dict[str, str]:
    """Return these properties of the present process, by name."""
    own = {_INSTRUCTIONS: lambda: target().key, "dalembert": lambda: __version__}
    return {name: own[name]() if name in own else _version(name) for name in names}


@cache
def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def difference(wanted: Mapping[str, str], has: Mapping[str, str]) -> str:
    """Return the differences of a machine, with the remedy; empty where there are none."""
    for name, value in wanted.items():
        if has.get(name) == value:
            continue
        remedy = f"install {name} {value}"
        if name == _INSTRUCTIONS:
            remedy = "set DALEMBERT_TARGET to a common one on all machines, and begin anew where none is set"
        return f"the {name} {has.get(name)!r}, and the sweep was begun with {value!r}; {remedy}"
    return ""
