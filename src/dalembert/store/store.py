"""The store of a sweep: arrays in zarr, one piece of each for every chunk of cases, and which chunks are done."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..frozen import frozen
from .description import PROGRESS, begin, checksum, described_group, digest_of, packages
from .request import Request

if TYPE_CHECKING:
    import xarray

CHUNK, COORDINATES, VARIABLES = "dalembert_chunk", "dalembert_coordinates", "dalembert_variables"
_DONE, _PROGRAM = f"{PROGRESS}/done", "program-"

Columns = Mapping[str, NDArray[Any]]


@final
@frozen
class StoreLayout:
    """Names, kinds and coordinates of the arrays of a store.

    Attributes
    ----------
    columns : mapping of str to ndarray
        Results of some cases, from which names and kinds of numbers are taken.
    coordinates : mapping of str to ndarray
        Values along the axes, and times to record.
    attributes : mapping of str to mapping
        Of arrays.
    """

    columns: Columns
    coordinates: Columns
    attributes: Mapping[str, Mapping[str, Any]]


@final
class Store:
    """A zarr group with the results of a sweep.

    A chunk is some whole rows of the first axis. Its piece of every array is one piece of the store, so that chunks are
    written independently, in any order, by any process. ``progress/done`` has a number for each chunk, 0 until it is
    done, then a checksum of its results: what was cut short or damaged does not have it. The group ``progress`` has the
    attributes of the store once more, in case its first file is damaged.
    """

    def __init__(self, where: Any, group: Any, rows: int) -> None:
        self.where, self.group, self.rows = where, group, rows
        self._arrays: dict[str, Any] = {}

    def _array(self, name: str) -> Any:
        """Return an array whose description is read once; others do not change it while chunks are written."""
        if name not in self._arrays:
            self._arrays[name] = self.group[name]
        return self._arrays[name]

    @classmethod
    def create(cls, where: Any, rows: int, attributes: Mapping[str, Any]) -> Store:
        """Begin a store without arrays, or return the one that another process has begun in the meantime."""
        begin(where, {**attributes, CHUNK: rows})
        store = cls.open(where)
        assert store is not None
        return store

    @classmethod
    def open(cls, where: Any) -> Store | None:
        """Return the store that is there, None where there is none; see `described_group`."""
        group = described_group(where)
        return None if group is None else cls(where, group, int(group.attrs[CHUNK]))

    def lay_out(self, request: Request, layout: StoreLayout) -> None:
        """Make the arrays that are missing or damaged."""
        for name, values in layout.coordinates.items():
            units = {"units": "s" if name == "time" else ""}
            self._make(name, values.shape, values.dtype, dimension_names=(name,), attributes=units)
            if not self._has(name, values):
                self.group[name][:] = values
        for name, values in layout.columns.items():
            self._make_column(name, values, request, layout.attributes.get(name, {}))
        count = -(-request.shape[0] // self.rows)
        self._make(_DONE, (count,), np.dtype("uint64"), chunks=(1,), fill_value=0, config={"write_empty_chunks": True})

    def _make_column(self, name: str, values: NDArray[Any], request: Request, attributes: Mapping[str, Any]) -> None:
        """Make an array over the cases."""
        from zarr.codecs import BloscCodec

        further = values.shape[1:]
        self._make(
            name,
            (*request.shape, *further),
            values.dtype,
            chunks=(min(self.rows, request.shape[0]), *request.shape[1:], *further),
            compressors=BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"),
            fill_value=np.nan if values.dtype.kind == "f" else -1,
            dimension_names=(*request.dims, *(("time",) if further else ())),
            attributes=dict(attributes),
            config={"write_empty_chunks": True},
        )

    def _make(self, name: str, shape: tuple[int, ...], dtype: Any, **further: Any) -> None:
        """Make an array, unless it is there.

        Another process may make it at the same time: what is not damaged is not replaced, since there may be results.
        """
        zarr, _ = packages()
        damaged = False
        try:
            found = self.group[name]
            if (found.shape, found.dtype) == (shape, dtype) and found.chunks == further.get("chunks", found.chunks):
                return
            damaged = True
        except KeyError:
            pass
        except Exception:  # whatever a decoder says of a damaged file
            damaged = True
        with contextlib.suppress(zarr.errors.ContainsArrayError):
            self.group.create_array(name, shape=shape, dtype=dtype, **further, overwrite=damaged)

    def _has(self, name: str, values: NDArray[Any]) -> bool:
        """Whether an array has these values."""
        try:
            return np.array_equal(self.group[name][:], values)
        except Exception:  # whatever a decoder says of a damaged piece
            return False

    @property
    def count(self) -> int:
        """Number of chunks."""
        return int(self.group[_DONE].shape[0])

    def write(self, chunk: int, request: Request, columns: Columns) -> None:
        """Write the results of the cases of a chunk, and then that they are there."""
        some = slice(chunk * self.rows, min((chunk + 1) * self.rows, request.shape[0]))
        for name, values in columns.items():
            shape = (some.stop - some.start, *request.shape[1:], *values.shape[1:])
            self._array(name)[some] = values.reshape(shape)
        self._array(_DONE)[chunk : chunk + 1] = np.array([checksum(columns)], dtype=np.uint64)

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

    def keep_program(self, digest: str, data: bytes) -> None:
        """Keep the program of a model for the workers of a cluster."""
        if self.program(digest) != data:
            place = f"{PROGRESS}/{_PROGRAM}{digest}"
            self.group.create_array(place, data=np.frombuffer(data, np.uint8), overwrite=True)

    def program(self, digest: str) -> bytes | None:
        """Return the program that has a digest, None where there is none, or where it is damaged."""
        try:
            data = np.asarray(self.group[f"{PROGRESS}/{_PROGRAM}{digest}"][:]).tobytes()
        except Exception:  # whatever a decoder says of a damaged piece
            return None
        return data if digest_of(data) == digest else None

    def drop_programs(self) -> None:
        """Remove the programs, of clusters that were lost too."""
        progress = self.group[PROGRESS]
        for name in [name for name in progress.array_keys() if name.startswith(_PROGRAM)]:
            del progress[name]

    def label(self, found: xarray.Dataset) -> None:
        """Write the units of the variables and parameters of a data set, that of this store."""
        for name, variable in found.variables.items():
            unit = variable.attrs.get("units")
            if unit != self.group[str(name)].attrs.get("units"):
                self.group[str(name)].attrs["units"] = unit
        for group in (self.group, self.group[PROGRESS]):
            if "parameter_units" in found.attrs:
                group.attrs["parameter_units"] = found.attrs["parameter_units"]

    def dataset(self) -> Any:
        """Return the results as an ``xarray.Dataset`` that reads the store on demand, in the order of a sweep's own.

        Units are texts: those of times do not make dates.
        """
        _, xarray = packages()
        found = xarray.open_zarr(self.where, consolidated=False, decode_times=False)
        return found.set_coords(list(self.group.attrs[COORDINATES]))[list(self.group.attrs[VARIABLES])]
