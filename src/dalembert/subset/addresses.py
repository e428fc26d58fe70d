"""Addresses of code and data that compiled loops read, together with what keeps them valid."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NoReturn, final

import numpy as np


@final
class OwnedAddress(int):
    """An address, 0 where there is none, and the object that keeps valid what lies there.

    Machine code is unloaded with its owner, and the address may then belong to other code. Arguments of loops therefore
    take no bare integers for addresses (`dalembert.subset.packing.pack`).

    Attributes
    ----------
    owner : object
        The engine that has loaded the code, the callback of a Python function, or an array.
    """

    owner: object

    def __new__(cls, address: int, owner: object) -> OwnedAddress:
        """Return the address with its owner."""
        found = super().__new__(cls, address)
        found.owner = owner
        return found

    def function(self, prototype: Any) -> Any:
        """Return the code as a function of ctypes, which owns it."""
        found = prototype(self)
        found.owner = self.owner
        return found

    def __reduce__(self) -> NoReturn:
        raise TypeError("an address is that of one process: it is neither pickled nor copied")


NO_CODE = OwnedAddress(0, None)
"""In place of code that there is not."""


@final
class AddressTable:
    """Addresses that loops read by number, and what keeps them valid.

    Attributes
    ----------
    words : ndarray (n,) of int
        The addresses as loops see them.
    """

    def __init__(self, addresses: Iterable[OwnedAddress] = ()) -> None:
        self._addresses = list(addresses)
        self.words = np.array(self._addresses, np.int64)

    @classmethod
    def zeros(cls, count: int) -> AddressTable:
        """Return a table without code, to be filled in."""
        return cls([NO_CODE] * count)

    @property
    def size(self) -> int:
        """Number of addresses."""
        return len(self._addresses)

    def __getitem__(self, number: int) -> int:
        return self._addresses[number]

    def __setitem__(self, number: int, address: OwnedAddress) -> None:
        self._addresses[number], self.words[number] = address, address
