"""Values computed once, also when several threads need them at the same time.

`functools.cache` and `functools.cached_property` let two threads compute two values, of which one is dropped. Where a
value is loaded machine code whose address is in use, dropping it is a crash; where computing it changes shared objects,
two threads at once corrupt them. So everything that is kept for later, and is not a plain value, goes through here.

There are two kinds of lock. `once`, `once_property` and `computed_once` lock the one value that is computed, so that
others are computed meanwhile; such a computation must not take `DERIVING`. What is derived symbolically (a model, and
what a model derives later) changes graphs and the caches of SymPy, and is done by one thread of the process at a time:
`derived_once`, `derived_property`, `deriving` and `DERIVING` itself, which is always taken first.
"""

from __future__ import annotations

import gc
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import wraps
from typing import Any, Generic, ParamSpec, Protocol, TypeVar, cast, final, overload

P = ParamSpec("P")
T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
K = TypeVar("K", bound=Hashable)

DERIVING = threading.RLock()
"""Held by the thread that derives something symbolically."""

_GUARD = threading.Lock()
_PENDING: dict[Hashable, _Turn] = {}
"""Computations that run now, by key, with the threads that wait for them."""

_RARELY = 1_000_000
"""Collections of middle-aged objects between two of all objects while something is derived."""

_MISSING: Any = object()


@final
class _Turn:
    """The lock of a value that is being computed, and how many threads hold it or wait for it."""

    def __init__(self) -> None:
        self.lock, self.threads = threading.RLock(), 0


@final
class exclusively:
    """Context in which no other thread is in a context of the same key."""

    def __init__(self, key: Hashable) -> None:
        self._key = key

    def __enter__(self) -> None:
        with _GUARD:
            turn = _PENDING.get(self._key)
            if turn is None:
                turn = _PENDING[self._key] = _Turn()
            turn.threads += 1
            self._turn = turn
        try:
            turn.lock.acquire()
        except BaseException:  # Ctrl-C while waiting
            self._leave()
            raise

    def __exit__(self, *_: object) -> None:
        self._turn.lock.release()
        self._leave()

    def _leave(self) -> None:
        with _GUARD:
            self._turn.threads -= 1
            if self._turn.threads == 0 and _PENDING.get(self._key) is self._turn:
                del _PENDING[self._key]


class BoundedTable(OrderedDict[K, T]):
    """A table of at most so many values: adding one more removes the one that was used longest ago.

    What is removed lives on where it is in use, and is computed again when it is next needed.
    """

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most = most

    def get(self, key: Any, default: Any = None) -> Any:
        """Return the value of a key, which counts as a use of it."""
        try:  # this is called in every run
            self.move_to_end(key)
            return self[key]
        except KeyError:  # or another thread has just removed it
            return default

    def __setitem__(self, key: K, value: T) -> None:
        super().__setitem__(key, value)
        with suppress(KeyError):
            while len(self) > self.most:
                self.popitem(last=False)


def computed_once(table: dict[K, T], key: K, make: Callable[[], T]) -> T:
    """Return ``table[key]``, computed by the first thread that needs it while the others wait."""
    found = table.get(key, _MISSING)
    if found is _MISSING:
        with exclusively((id(table), key)):
            found = table.get(key, _MISSING)
            if found is _MISSING:
                found = table[key] = make()
    return cast(T, found)


def derived_once(table: dict[K, T], key: K, make: Callable[[], T]) -> T:
    """Return ``table[key]``, derived by one thread of the process at a time."""
    found = table.get(key, _MISSING)
    if found is _MISSING:
        with DERIVING:
            found = table.get(key, _MISSING)
            if found is _MISSING:
                found = table[key] = make()
    return cast(T, found)


class Once(Protocol[P, T_co]):
    """A function that computes its value once for each list of arguments."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> T_co:
        """Return the value."""
        ...

    def cache_clear(self) -> None:
        """Forget all values."""
        ...


def once(function: Callable[P, T]) -> Once[P, T]:
    """Return a function of hashable positional arguments that computes the value of each list of them once.

    Defaults count as given.
    """
    values: dict[Hashable, T] = {}
    count, defaults = function.__code__.co_argcount, function.__defaults__ or ()

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        assert not kwargs
        key = args if len(args) == count else (*args, *defaults[len(args) - count :])
        found = values.get(key, _MISSING)
        return computed_once(values, key, lambda: function(*args, **kwargs)) if found is _MISSING else cast(T, found)

    call.cache_clear = values.clear  # type: ignore[attr-defined]
    return cast("Once[P, T]", call)


class OnceProperty(Generic[T]):
    """A property that is computed once for each object, and then is an attribute of it.

    With `deriving` it is computed under `DERIVING`.
    """

    def __init__(self, function: Callable[[Any], T], *, deriving: bool = False) -> None:
        self._function, self._deriving = function, deriving
        self.__doc__ = function.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> OnceProperty[T]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> OnceProperty[T] | T:
        if instance is None:
            return self
        kept: dict[str, T] = instance.__dict__
        if self._deriving:
            return derived_once(kept, self._name, lambda: self._function(instance))
        return computed_once(kept, self._name, lambda: self._function(instance))


def once_property(function: Callable[[Any], T]) -> OnceProperty[T]:
    """Return a property that is computed once for each object."""
    return OnceProperty(function)


def derived_property(function: Callable[[Any], T]) -> OnceProperty[T]:
    """Return a property that is derived once for each object, under `DERIVING`."""
    return OnceProperty(function, deriving=True)


def deriving(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that runs under `DERIVING`, without collections of old garbage.

    Graphs grow meanwhile and are all in use, so that each collection of old objects looks through them in vain, which
    was a fifth of the time to compile 300 bodies. Young garbage is collected.
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        with DERIVING:
            young, middle, old = gc.get_threshold()
            gc.set_threshold(young, middle, max(old, _RARELY))
            try:
                return function(*args, **kwargs)
            finally:
                gc.set_threshold(young, middle, old)

    return call


def _before_fork() -> None:
    DERIVING.acquire()
    _GUARD.acquire()


def _after_fork() -> None:
    _GUARD.release()
    DERIVING.release()


def _after_fork_in_child() -> None:
    _PENDING.clear()  # the threads that computed these are not in the child
    _after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork_in_child)
