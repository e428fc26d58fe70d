"""Arrays and other values by name, with an error that lists the names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Generic, TypeVar, final

from ..errors import UnknownNameError, unknown_name

__all__ = ["NamedValues"]

T = TypeVar("T")


@final
class NamedValues(dict[str, T], Generic[T]):
    """Arrays, or other values, by name.

    Parameters
    ----------
    kind : str
        Kind of the values, for messages.
    values : mapping of str
    aliases : mapping of str to str, optional
        Names by the texts of SymPy symbols, which may be given in place of them.

    Raises
    ------
    UnknownNameError
        For a name that is not there.
    """

    def __init__(self, kind: str, values: Mapping[str, T], aliases: Mapping[str, str] | None = None) -> None:
        super().__init__(values)
        self._kind, self._aliases = kind, aliases or {}

    def __missing__(self, key: Any) -> T:
        name = self._aliases.get(str(key), str(key))
        if name in self:
            return self[name]
        raise UnknownNameError(unknown_name(self._kind, name, self))

    def __reduce__(self) -> tuple[Any, ...]:
        return NamedValues, (self._kind, dict(self), self._aliases)
