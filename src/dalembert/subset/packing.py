"""Arguments of compiled loops as words: packed for machine code, and unpacked again."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any, NoReturn, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from .arguments import DTYPES, AddressTable, OwnedAddress, Record, kind_of
from .compiled_subset import INTEGER, NUMBER, Array, Fields, Group, Kind, Scalar

T = TypeVar("T")
_Collect = Callable[[Any, list[Any]], None]
_Build = Callable[[Iterator[int], str], Any]
_WORD = 8
_CHARACTER: Any = ctypes.c_char
_CONSTANT: dict[int, tuple[Any, list[Any]]] = {}


def pack(arguments: tuple[Any, ...]) -> NDArray[np.int64]:
    """Return a NamedTuple of arguments as words: integers, bits of doubles, and addresses of arrays with their lengths.

    Arrays and records must live as long as the words are used.

    Raises
    ------
    TypeError
        For a field that is not what its annotation says; the message names the field.
    """
    collect, layout = _packing(type(arguments))
    values: list[Any] = []
    collect(arguments, values)
    words = np.empty(layout.size // _WORD, np.int64)
    try:
        layout.pack_into(words.data, 0, *values)
    except struct.error:
        _refuse_scalars(arguments)
        raise
    return words


def replace_array(words: NDArray[np.int64], place: int, array: NDArray[Any]) -> None:
    """Let packed words point to another array of the same type, which must live as long as they are used.

    `place` is that of its field (`place_of`).
    """
    words[place : place + 1 + array.ndim] = address_of(array), *array.shape


def constant_group(group: T) -> T:
    """Return a NamedTuple of arguments that never changes: its words are computed once, and it stays alive."""
    values: list[Any] = []
    annotation: Any = type(group)
    _collector(kind_of(annotation), annotation.__name__)(group, values)
    _CONSTANT[id(group)] = group, values
    return group


def unpack(arguments: Callable[..., T], words: NDArray[np.int64], wrap: Callable[[Any, str], Any] | None = None) -> T:
    """Return the arguments that `pack` made words of; arrays and records are on the same memory.

    Parameters
    ----------
    arguments : type
        The NamedTuple.
    words : (n,) int64
    wrap : function, optional
        Of each array and its name, returns what takes its place.
    """
    build = _builder(kind_of(arguments), arguments, wrap or (lambda array, _: array))
    return build(iter(words.tolist()), "")


def address_of(array: NDArray[Any]) -> int:
    """Return the address of the first element of an array, 0 where it is empty."""
    try:
        return ctypes.addressof(_CHARACTER.from_buffer(array))
    except TypeError:  # it cannot be written to
        return int(array.__array_interface__["data"][0]) if array.size else 0
    except ValueError:
        if array.size:
            raise
        return 0


def words_of(arrays: Iterable[NDArray[Any]]) -> list[int]:
    """Return what packed arguments have of arrays: the address of each, and its lengths."""
    words: list[int] = []
    for array in arrays:
        if array.size == 0:
            words += (0, *array.shape)
        else:
            assert array.flags.c_contiguous
            words += (address_of(array), *array.shape)
    return words


def owned_address(array: NDArray[Any]) -> OwnedAddress:
    """Return the address of the first element of an array, with the array."""
    return OwnedAddress(address_of(array), array)


@cache
def _packing(arguments: type[tuple[Any, ...]]) -> tuple[_Collect, struct.Struct]:
    kind = kind_of(arguments)
    formats = {"double": "d"}
    layout = struct.Struct("=" + "".join(formats.get(word, "q") for word in kind.words))
    return _collector(kind, arguments.__name__), layout


def _collector(kind: Kind, name: str) -> _Collect:
    """Return the function that appends the words of a value to a list."""
    if isinstance(kind, Array):
        return _table_collector(name) if kind.item.owned else _array_collector(kind, name)
    if isinstance(kind, Scalar) and kind.owned:
        return _address_collector(name)
    if isinstance(kind, Fields):
        return _record_collector(kind, name)
    if isinstance(kind, Group):
        collectors = tuple(
            _collector(part, f"{name}.{field}") for part, field in zip(kind.parts, kind.names, strict=True)
        )

        def collect(group: tuple[Any, ...], values: list[Any]) -> None:
            constant = _CONSTANT.get(id(group))
            if constant is not None:
                values.extend(constant[1])
                return
            if len(group) != len(collectors):
                raise TypeError(f"{name} must have the fields {', '.join(kind.names)}, and is {group!r}")
            for part, following in zip(group, collectors, strict=True):
                following(part, values)

        return collect
    return lambda number, values: values.append(number)


def _array_collector(kind: Array, name: str) -> _Collect:
    dtype, dimensions = DTYPES[kind.item], kind.dimensions

    def collect(array: NDArray[Any], values: list[Any]) -> None:
        try:
            shape = array.shape
            fits = len(shape) == dimensions and array.flags.c_contiguous
            fits = fits and (array.dtype is dtype or array.dtype == dtype)
        except AttributeError:
            fits = False
        if not fits:
            _refuse_array(name, kind, array)
        values.append(address_of(array))
        values.extend(shape)

    return collect


def _address_collector(name: str) -> _Collect:
    def collect(address: Any, values: list[Any]) -> None:
        if address.__class__ is not OwnedAddress and address != 0:
            raise TypeError(f"{name} must be an address with its owner (OwnedAddress), or 0, and is {address!r}")
        values.append(address)

    return collect


def _table_collector(name: str) -> _Collect:
    def collect(table: Any, values: list[Any]) -> None:
        if table.__class__ is not AddressTable:
            raise TypeError(f"{name} must be an AddressTable, and is {table!r}")
        values += address_of(table.words), table.size

    return collect


def _record_collector(kind: Fields, name: str) -> _Collect:
    def collect(record: Record, values: list[Any]) -> None:
        if getattr(record, "kind", None) is not kind:
            raise TypeError(f"{name} must be a record of {', '.join(kind.names)}, and is {record!r}")
        values.append(address_of(record.words))

    return collect


def _refuse_array(name: str, kind: Array, given: Any) -> NoReturn:
    wanted = f"a C-contiguous array of {DTYPES[kind.item]} with {kind.dimensions} dimension(s)"
    is_ = f"of type {type(given).__name__}"
    if isinstance(given, np.ndarray):
        order = "C-contiguous" if given.flags.c_contiguous else "not C-contiguous"
        is_ = f"an array of {given.dtype} with {given.ndim} dimension(s), {order}"
    raise TypeError(f"{name} must be {wanted}, and is {is_}")


def _refuse_scalars(arguments: Any, name: str = "") -> None:
    """Name the number that `struct` rejects."""
    kind, name = kind_of(arguments.__class__), name or type(arguments).__name__
    assert isinstance(kind, Group)
    for part, field, value in zip(kind.parts, kind.names, arguments, strict=True):
        if isinstance(part, Group):
            _refuse_scalars(value, f"{name}.{field}")
        elif isinstance(part, Scalar):
            try:
                struct.pack("=d" if part == NUMBER else "=q", value)
            except struct.error as reason:
                raise TypeError(f"{name}.{field} is {value!r}: {reason}") from None


def _builder(kind: Kind, annotation: Any, wrap: Callable[[Any, str], Any]) -> _Build:
    """Return the function that makes a value of words."""
    if isinstance(kind, Array):
        dtype, dimensions = DTYPES[kind.item], kind.dimensions

        def array(words: Iterator[int], name: str) -> Any:
            address, shape = next(words), [next(words) for _ in range(dimensions)]
            return wrap(_memory(address, shape, dtype), name)

        return array
    if isinstance(kind, Fields):
        return lambda words, _: annotation(_memory(next(words), [len(kind.names)], DTYPES[INTEGER]))
    if isinstance(kind, Group):
        hints = get_type_hints(annotation, include_extras=True)
        parts = [
            (field, _builder(part, hints[field], wrap)) for part, field in zip(kind.parts, kind.names, strict=True)
        ]
        return lambda words, name: annotation(*(build(words, f"{name}.{field}".strip(".")) for field, build in parts))
    if kind == NUMBER:
        return lambda words, _: np.int64(next(words)).view(np.float64)
    return lambda words, _: next(words) if kind == INTEGER else bool(next(words))


def _memory(address: int, shape: list[int], dtype: np.dtype[Any]) -> NDArray[Any]:
    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    return np.ndarray(shape, dtype, buffer=memoryview((ctypes.c_char * size).from_address(address)).cast("B"))
