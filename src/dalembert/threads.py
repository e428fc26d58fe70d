"""Threads that run cases: how many there are processors for, Ctrl-C in them, and calls between blocks of steps.

Compiled loops return to Python every so often. There Ctrl-C is raised in the main thread, which tells the other
threads; they look here.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

STOPPED = 1 << 62
"""Value of the shared count of cases begun which makes loops over lanes stop, whatever they are at."""


class _Thread(threading.local):
    """The function that this thread calls between blocks of steps, or None."""

    observe: Callable[[float], None] | None = None


_THREAD = _Thread()


@contextmanager
def called_between_blocks(observe: Callable[[float], None]) -> Iterator[None]:
    """Context in which `check` calls a function of the time that a run of this thread has reached."""
    outer = _THREAD.observe
    _THREAD.observe = observe
    try:
        yield
    finally:
        _THREAD.observe = outer


@contextmanager
def stopped_by(event: threading.Event) -> Iterator[None]:
    """Context in which `check` stops this thread once an event is set."""

    def stop(t: float) -> None:
        if event.is_set():
            raise KeyboardInterrupt

    with called_between_blocks(stop):
        yield


def check(t: float = math.nan) -> None:
    """Call the hook of this thread between blocks of steps, with the time reached, NaN where unknown.

    Raises
    ------
    KeyboardInterrupt
        In a thread that is to stop.
    """
    observe = _THREAD.observe
    if observe is not None:
        observe(t)


def is_observed() -> bool:
    """Return whether this thread is in a context of `called_between_blocks`."""
    return _THREAD.observe is not None


def available_threads() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
