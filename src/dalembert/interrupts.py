"""Ctrl-C in threads that run cases: it is raised in the main thread, which has the others told.

Compiled loops return to Python every so often, where Ctrl-C is raised in the main thread, and others look here.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["STOPPED", "check", "stopped_by"]

STOPPED = 1 << 62
"""Value of the shared count of cases begun which makes loops over lanes stop, whatever they are at."""

_THREAD = threading.local()


@contextmanager
def stopped_by(event: threading.Event) -> Iterator[None]:
    """Context in which `check` stops this thread once an event is set."""
    held = getattr(_THREAD, "event", None)
    _THREAD.event = event
    try:
        yield
    finally:
        _THREAD.event = held


def check() -> None:
    """Raise KeyboardInterrupt in a thread that is to stop."""
    event = getattr(_THREAD, "event", None)
    if event is not None and event.is_set():
        raise KeyboardInterrupt
