"""The description of a store: attributes of its root and, once more, of its group `progress`, with their digest."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ..codegen.llvm.target import target
from ..errors import MissingExtraError, OptionError, StoredSweepError
from ..version import __version__

# Digests of the arrays and texts of a store.


def digest_of(data: bytes) -> str:
    """Return the digest of bytes that are kept where others may write; they are not read without it."""
    return blake2b(data, digest_size=16).hexdigest()


def checksum(columns: Mapping[str, NDArray[Any]]) -> int:
    """Return a number above 0 that belongs to these results."""
    seal = blake2b(digest_size=8)
    for name in sorted(columns):
        values: NDArray[Any] = np.ascontiguousarray(columns[name])
        seal.update(f"{name} {values.shape} {values.dtype.str} {crc32(values.data)}".encode())
    return int.from_bytes(seal.digest(), "little") | 1


DIGEST, PROGRESS = "dalembert_digest", "progress"
_SEAL = "dalembert_seal"


def packages() -> tuple[Any, Any]:
    """Return the packages zarr and xarray.

    Raises
    ------
    MissingExtraError
        Without them.
    """
    try:
        import xarray
        import zarr
    except ImportError as reason:
        raise MissingExtraError(
            f'sweep(to=...) needs {reason.name}; install it with: pip install "dalembert[dask]"'
        ) from None
    return zarr, xarray


def begin(where: Any, attributes: Mapping[str, Any]) -> None:
    """Describe a new store; where other processes begin it at the same time, the description of the first is kept."""
    seal = {"names": sorted(attributes), "digest": _digest(attributes)}
    _write(where, PROGRESS, {**attributes, _SEAL: seal}, only_new=True)


def described_group(where: Any) -> Any:
    """Return the group of a store, after mending what is damaged of its description; None where there is no store.

    Raises
    ------
    OptionError
        Where there is something else, for what is no place of a store, and where both descriptions are damaged.
    StoredSweepError
        Where the place cannot be read.
    """
    zarr, _ = packages()
    _refuse_places(where)
    try:
        seen = _seen(where)
        found = {path: _attributes(where, path) for path in ("", PROGRESS)}
        intact = next((each for each in reversed(found.values()) if each is not None and _is_intact(each)), None)
        if intact is None:
            return _refuse_others(where, found[""], *seen)
        for path, each in found.items():
            if each is None or any(each.get(name) != intact[name] for name in (*intact[_SEAL]["names"], _SEAL)):
                _write(where, path, intact)
        return zarr.open_group(where, mode="r+")
    except OSError as error:
        raise StoredSweepError(f"the store {str(where)!r} could not be read: {error}") from error


def _refuse_places(where: Any) -> None:
    """Reject a file, where zarr makes a folder, and what is no place at all."""
    from zarr.core.sync import sync
    from zarr.storage import LocalStore
    from zarr.storage._common import make_store_path

    folder = where.root if isinstance(where, LocalStore) else where
    if isinstance(folder, str | Path) and Path(folder).is_file():
        raise OptionError(
            f"to={str(folder)!r} is a file, and a store is a folder; nothing was written. Choose another name"
        )
    try:
        sync(make_store_path(where, mode="r"))
    except TypeError as error:
        raise OptionError(
            f"to= takes a path of a folder or a store of zarr, not {where!r}, of type {type(where).__name__}"
        ) from error
    except (OSError, ValueError):  # nothing is there
        return


def _seen(where: Any) -> tuple[bool, bool]:
    """Return whether a folder has other files than a description, and whether it has one.

    A description that another process writes afterwards is not one that is damaged.
    """
    if not isinstance(where, str | Path) or not Path(where).is_dir():
        return False, False
    others = any(path.name != PROGRESS for path in Path(where).iterdir())
    return others, (Path(where) / PROGRESS / "zarr.json").exists()


def _refuse_others(where: Any, root: Mapping[str, Any] | None, others: bool, described: bool) -> None:
    """Reject what has no intact description, unless there is nothing."""
    name, nothing = repr(str(where)), "nothing was written. Choose another name"
    if root is not None and DIGEST not in root:
        raise OptionError(f"to={name} is a zarr group that no sweep wrote; {nothing}")
    if root is not None or described:
        raise OptionError(f"to={name} was begun by another version, or its description is damaged; {nothing}")
    if others:
        raise OptionError(f"to={name} exists and is no store of a sweep; {nothing}, or remove it")


def _attributes(where: Any, path: str) -> dict[str, Any] | None:
    """Return the attributes of a group, None where it is missing or damaged."""
    zarr, _ = packages()
    try:
        return dict(zarr.open_group(where, path=path, mode="r").attrs)
    except FileNotFoundError:
        return None
    except OSError:
        raise
    except Exception:  # whatever a decoder says of a damaged file
        return None


def _digest(attributes: Mapping[str, Any]) -> str:
    return digest_of(json.dumps(dict(attributes), sort_keys=True).encode())


def _is_intact(attributes: Mapping[str, Any]) -> bool:
    try:
        seal = attributes[_SEAL]
        return bool(_digest({name: attributes[name] for name in seal["names"]}) == seal["digest"])
    except (KeyError, TypeError):
        return False


def _write(where: Any, path: str, attributes: Mapping[str, Any], only_new: bool = False) -> None:
    """Write the file that describes a group, as a whole; with `only_new`, unless it exists.

    zarr looks whether a group exists before it writes one, and reads what it replaces, which may be damaged.
    """
    from zarr.core.buffer import default_buffer_prototype
    from zarr.core.sync import sync
    from zarr.storage._common import make_store_path

    text = json.dumps({"attributes": dict(attributes), "zarr_format": 3, "node_type": "group"}, indent=2)
    data = default_buffer_prototype().buffer.from_bytes(text.encode())
    place = sync(make_store_path(where, path=path, mode="a")) / "zarr.json"
    sync(place.set_if_not_exists(data) if only_new else place.set(data))


# Instruction set and versions on which the last bits of results depend.

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
