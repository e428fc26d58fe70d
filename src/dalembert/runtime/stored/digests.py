"""Digests of the arrays and texts of a store."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import blake2b
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

__all__ = ["checksum", "digest_of"]


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
