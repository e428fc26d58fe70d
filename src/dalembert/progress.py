"""Progress bars of runs, sweeps and compilations, by tqdm."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from .errors import MissingExtraError
from .threads import called_between_blocks

_STAGES = 8
"""Stages of the compilation of a scene without contacts: backend, read, derive, copy, reduce, lower, render, load."""

_RUN_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]"
_COMPILATION_FORMAT = "{desc} |{bar}| {n_fmt}/{total_fmt} stages [{elapsed}]"

_THREAD = threading.local()


def meter(total: int, wanted: bool, unit: str = "case") -> AbstractContextManager[Callable[[int], Any]]:
    """Return a context with a function that advances a progress bar, or does nothing where none is requested."""
    return _bar(total, unit) if wanted else _NO_BAR


_NO_BAR: AbstractContextManager[Callable[[int], Any]] = nullcontext(lambda count: None)


@contextmanager
def _bar(total: int, unit: str) -> Iterator[Callable[[int], Any]]:
    with _tqdm()(total=total, unit=unit, unit_scale=True) as bar:
        yield bar.update


@contextmanager
def run_meter(t0: float, t1: float) -> Iterator[Callable[[float], None]]:
    """Context in which a bar shows the time that a run of this thread has reached.

    Compiled loops return to Python between blocks of steps, where the bar advances; the steps stay the same. It gives
    the function that shows a time.
    """
    with _tqdm()(total=abs(t1 - t0), desc="simulating", bar_format=_RUN_FORMAT) as bar:

        def show(t: float) -> None:
            reached = abs(t - t0)
            if reached == reached:  # NaN where a loop does not know its time
                bar.set_description_str("simulating", refresh=False)
                bar.update(min(reached, bar.total) - bar.n)

        with called_between_blocks(show), _stages_shown(lambda stage: bar.set_description_str(f"compiling ({stage})")):
            yield show


@contextmanager
def compilation_meter(wanted: bool) -> Iterator[None]:
    """Context in which a bar shows the stages of a compilation by this thread, if requested."""
    if not wanted:
        yield
        return
    with _tqdm()(total=_STAGES, bar_format=_COMPILATION_FORMAT) as bar:

        def show(stage: str) -> None:
            bar.set_description_str(f"compiling ({stage})")
            bar.total = max(bar.total, bar.n + 1)
            bar.update(1)

        with _stages_shown(show):
            yield
        bar.total = bar.n  # scenes whose contacts change are compiled mode by mode, in runs
        bar.set_description_str("compiled")


def enter_stage(stage: str) -> None:
    """Show that a stage of a compilation begins, where a bar of this thread is open."""
    show = getattr(_THREAD, "show", None)
    if show is not None:
        show(stage)


@contextmanager
def _stages_shown(show: Callable[[str], Any]) -> Iterator[None]:
    """Context in which `enter_stage` calls a function in this thread."""
    outer = getattr(_THREAD, "show", None)
    _THREAD.show = show
    try:
        yield
    finally:
        _THREAD.show = outer


def _tqdm() -> Any:
    """Return the class of bars, for a terminal or a notebook.

    Raises
    ------
    MissingExtraError
        Without tqdm.
    """
    try:
        from tqdm.auto import tqdm
    except ImportError:
        raise MissingExtraError(
            'progress=True needs tqdm; install it with: pip install "dalembert[progress]"'
        ) from None
    return tqdm
