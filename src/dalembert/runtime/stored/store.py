"""The store of a sweep: arrays in zarr, one piece of each for every chunk of cases, and which chunks are done."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...errors import MissingExtraError, OptionError
from .request import Request

__all__ = ["COORDINATES", "DIGEST", "Store", "packages"]

DIGEST, CHUNK, COORDINATES = "dalembert_digest", "dalembert_chunk", "dalembert_coordinates"
_DONE = "progress/done"

Columns = Mapping[str, NDArray[Any]]


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


@final
class Store:
    """A zarr group with the results of a sweep.

    A chunk is some whole rows of the first axis. Its piece of every array is one piece of the store, so that chunks are
    written independently, in any order, by any process. ``progress/done`` has a number for each chunk, 0 until it is
    done, then a checksum of its results: what was cut short or damaged does not have it.
    """

    def __init__(self, where: Any, group: Any, rows: int) -> None:
        self.where, self.group, self.rows = where, group, rows

    @classmethod
    def create(
        cls,
        where: Any,
        request: Request,
        columns: Columns,
        rows: int,
        attributes: Mapping[str, Any],
        names: Columns,
        told: Mapping[str, Mapping[str, Any]],
    ) -> Store:
        """Lay out a store; `columns` are results of some cases, from which it takes names and kinds of numbers.

        `names` are coordinates: values along the axes, and times to record; `told` are attributes of arrays.
        """
        zarr, _ = packages()
        group = zarr.create_group(where, attributes={**attributes, CHUNK: rows}, overwrite=False)
        for name, values in names.items():
            array = group.create_array(name, data=np.asarray(values), dimension_names=(name,))
            array.attrs["units"] = "s" if name == "time" else ""
        for name, values in columns.items():
            further = values.shape[1:]
            group.create_array(
                name,
                shape=(*request.shape, *further),
                chunks=(min(rows, request.shape[0]), *request.shape[1:], *further),
                dtype=values.dtype,
                fill_value=np.nan if values.dtype.kind == "f" else -1,
                dimension_names=(*request.dims, *(("time",) if further else ())),
                attributes=dict(told.get(name, {})),
                config={"write_empty_chunks": True},
            )
        count = -(-request.shape[0] // rows)
        done = {"shape": (count,), "chunks": (1,), "dtype": "uint64", "fill_value": 0}
        group.create_array(_DONE, **done, config={"write_empty_chunks": True})
        return cls(where, group, rows)

    @classmethod
    def open(cls, where: Any) -> Store | None:
        """Return the store that is there, None where there is none.

        Raises
        ------
        OptionError
            Where there is something else.
        """
        zarr, _ = packages()
        try:
            group = zarr.open_group(where, mode="r+")
        except (FileNotFoundError, zarr.errors.GroupNotFoundError):
            if isinstance(where, str | Path) and Path(where).exists() and any(Path(where).iterdir()):
                raise OptionError(
                    f"to={str(where)!r} exists and is no store of a sweep; nothing was written. Choose another name, or"
                    " remove it"
                ) from None
            return None
        if DIGEST not in group.attrs:
            raise OptionError(
                f"to={where!r} is a zarr group that no sweep wrote; nothing was written. Choose another name"
            )
        return cls(where, group, int(group.attrs[CHUNK]))

    @property
    def count(self) -> int:
        """Number of chunks."""
        return int(self.group[_DONE].shape[0])

    def write(self, chunk: int, request: Request, columns: Columns) -> None:
        """Write the results of the cases of a chunk, and then that they are there."""
        some = slice(chunk * self.rows, min((chunk + 1) * self.rows, request.shape[0]))
        for name, values in columns.items():
            shape = (some.stop - some.start, *request.shape[1:], *values.shape[1:])
            self.group[name][some] = values.reshape(shape)
        self.group[_DONE][chunk : chunk + 1] = np.array([checksum(columns)], dtype=np.uint64)

    def missing(self, request: Request) -> list[int]:
        """Return the chunks that are not there, whole and unchanged."""
        names = [name for name, array in self.group.arrays() if name not in (*request.dims, "time")]
        try:
            done = np.asarray(self.group[_DONE][:])
        except Exception:  # a damaged piece: each is looked at alone
            done = np.array([self._mark(k) for k in range(self.count)], dtype=np.uint64)
        return [k for k in range(self.count) if not done[k] or not self._whole(k, int(done[k]), names, request)]

    def _mark(self, chunk: int) -> int:
        try:
            return int(self.group[_DONE][chunk])
        except Exception:
            return 0

    def _whole(self, chunk: int, mark: int, names: list[str], request: Request) -> bool:
        some = slice(chunk * self.rows, min((chunk + 1) * self.rows, request.shape[0]))
        cases = (some.stop - some.start) * request.row
        try:
            found = {name: self.group[name][some] for name in names}
        except Exception:  # whatever a decoder says of a damaged piece
            return False
        further = {name: self.group[name].shape[len(request.shape) :] for name in names}
        return mark == checksum({name: values.reshape(cases, *further[name]) for name, values in found.items()})

    def dataset(self) -> Any:
        """Return the results as an ``xarray.Dataset`` that reads the store when it is asked."""
        _, xarray = packages()
        found = xarray.open_zarr(self.where, consolidated=False)
        return found.set_coords(list(self.group.attrs[COORDINATES]))


def checksum(columns: Columns) -> int:
    """Return a number above 0 that belongs to these results."""
    seal = blake2b(digest_size=8)
    for name in sorted(columns):
        values: FloatArray = np.ascontiguousarray(columns[name])
        seal.update(f"{name} {values.shape} {values.dtype.str}".encode())
        seal.update(values.tobytes())
    return int.from_bytes(seal.digest(), "little") | 1
