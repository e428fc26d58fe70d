"""``frozen``: what `dataclasses.dataclass(frozen=True)` makes, in a fraction of the time.

`dataclasses` writes, compiles and runs the text of six methods for each class: for the two hundred classes of this
package that takes as long as deriving a scene, in each process. Here the text of the constructor alone is written; the
other methods are the same functions for all classes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, Field, FrozenInstanceError, dataclass, field, fields
from operator import attrgetter
from typing import Any, NoReturn, TypeVar, dataclass_transform, overload

T = TypeVar("T")


@overload
def frozen(cls: type[T], /) -> type[T]: ...
@overload
def frozen(*, eq: bool = ..., kw_only: bool = ...) -> Callable[[type[T]], type[T]]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(cls: Any = None, /, *, eq: bool = True, kw_only: bool = False) -> Any:
    """Make a class a frozen dataclass: `dataclasses.replace`, `fields` and `asdict` take its objects.

    Parameters
    ----------
    cls
        The class, with its fields as annotations.
    eq
        Objects are equal, and have one hash, where their fields are equal; else where they are one object.
    kw_only
        Fields are given by name.
    """

    def made(cls: Any) -> Any:
        dataclass(init=False, repr=False, eq=False, match_args=False, kw_only=kw_only)(cls)
        cls.__setattr__, cls.__delattr__ = _no_assignment, _no_deletion
        if "__init__" not in cls.__dict__:
            cls.__init__ = _constructor(cls)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = _text
        if eq:
            _compare_by_fields(cls)
        return cls

    return made if cls is None else made(cls)


def _no_assignment(self: Any, name: str, value: Any) -> NoReturn:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _no_deletion(self: Any, name: str) -> NoReturn:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _text(self: Any) -> str:
    values = ", ".join(f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if f.repr)
    return f"{type(self).__qualname__}({values})"


def _compare_by_fields(cls: Any) -> None:
    """Give a class `__eq__` and `__hash__` by its fields, if it has none of its own."""
    compared = _values([f.name for f in fields(cls) if f.compare])
    hashed = _values([f.name for f in fields(cls) if (f.compare if f.hash is None else f.hash)])

    def equal(self: Any, other: Any) -> Any:
        if other is self:
            return True
        return compared(self) == compared(other) if other.__class__ is self.__class__ else NotImplemented

    def hash_of(self: Any) -> int:
        return hash(hashed(self))

    own = cls.__dict__
    if "__eq__" not in own:
        cls.__eq__ = equal
    if own.get("__hash__") is None:
        cls.__hash__ = hash_of


def _values(names: list[str]) -> Callable[[Any], Any]:
    """Return the function that takes an object to its values of these names."""
    return attrgetter(*names) if names else lambda _: ()


def _constructor(cls: Any) -> Any:
    """Return `__init__` of a class with fields, as `dataclasses` writes it for frozen classes."""
    found = fields(cls)
    given = [f for f in found if f.init]
    names: dict[str, Any] = {"_set": object.__setattr__, "_missing": MISSING}
    by_name = [_parameter(f, names) for f in given if f.kw_only]
    parameters = [
        "self",
        *(_parameter(f, names) for f in given if not f.kw_only),
        *(["*", *by_name] if by_name else []),
    ]
    body = [_assignment(f, names) for f in found if f.init or f.default_factory is not MISSING]
    if hasattr(cls, "__post_init__"):
        body.append(" self.__post_init__()")
    exec(f"def __init__({', '.join(parameters)}):\n" + ("\n".join(body) or " pass"), names)
    init = names["__init__"]
    init.__qualname__, init.__module__ = f"{cls.__qualname__}.__init__", cls.__module__
    return init


def _parameter(f: Field[Any], names: dict[str, Any]) -> str:
    if f.default_factory is not MISSING:
        return f"{f.name}=_missing"
    if f.default is MISSING:
        return f.name
    names[f"_default_{f.name}"] = f.default
    return f"{f.name}=_default_{f.name}"


def _assignment(f: Field[Any], names: dict[str, Any]) -> str:
    value = f.name
    if f.default_factory is not MISSING:
        names[f"_make_{f.name}"] = f.default_factory
        value = f"_make_{f.name}()" + (f" if {f.name} is _missing else {f.name}" if f.init else "")
    return f' _set(self, "{f.name}", {value})'
