"""Cases of a sweep in parts and blocks, in threads, each of which runs its blocks in lanes."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

from ..codegen.engine import Engine
from ..codegen.runs import CaseRun
from ..lanes.cases import BlockResult
from ..methods.status import Status
from ..once import once
from ..progress import meter
from ..threads import STOPPED, check, stopped_by
from .block_runs import LARGEST_BLOCK, SMALLEST_BLOCK, check_results, columns_run, run_one_block, slices_of
from .case_settings import CaseSettings
from .cases import Cases, single_problem

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor

    from ..starts.initial_states import QuickStart

_BLOCKS_PER_THREAD = 8

_LARGEST_SHARE, _SHARES_PER_THREAD = 64, 64
_LARGEST_PART = 1 << 13
"""Cases of a thread whose starts are kept together: so many that memory which was freed before is large enough."""

_INTERRUPTED = float(Status.INTERRUPTED)
_BETWEEN_LOOKS = 0.1
_MOST_THREADS = 4096
_WORTH, _MANY = 1e-4, 512
"""Seconds of work that is left from which on other threads begin, twice what that takes; cases that take longer."""


def fitted(
    engine: Engine,
    cases: Cases,
    settings: CaseSettings,
    quick_start: Callable[[Iterable[str]], QuickStart],
    *,
    whole: bool = True,
) -> CaseSettings:
    """Return the settings with another method where the first, the middle or the last case shows need of it.

    `quick_start` is that of the model, by names of given values. Cases that are not `whole` motions of these settings
    are not tried.
    """
    if not cases.program.layout.state or not cases.count:
        return settings
    numbers = sorted({0, cases.count // 2, cases.count - 1})
    if cases.plain:
        columns = cases.columns(slice(0, cases.count), settings)
        if engine.surely_not_stiff(columns, numbers, settings.method if whole else None):
            return settings
    for i in numbers:
        problem = single_problem(cases, settings, i, quick_start)
        if problem is None:
            continue
        method, why = engine.fit(problem, settings.method)
        if method != settings.method:
            return replace(settings, method=method, note=f"case {i} is {why}")
    return settings


def run_cases(engine: Engine, cases: Cases, settings: CaseSettings, stop: bool = False) -> BlockResult:
    """Run cases, in threads where the engine supports it, and return all results; to `stop`, none is run.

    A case that fails is a status; an interrupt keeps what is finished, and the others are INTERRUPTED.
    """
    count, samples = cases.count, 0 if settings.t_eval is None else len(settings.t_eval)
    watch, n = settings.watch, len(cases.program.layout.state)
    events, reductions = (0, 0) if watch is None else (watch.reported, len(watch.plan))
    result = BlockResult.empty(count, n, samples, events, reductions)
    result.ends[:, 1] = _INTERRUPTED
    if stop:
        return _interrupted(result)
    threads = settings.threads if engine.parallel else 1
    # reductions and checks need the starts of all cases of a part, and these may have long lists of stops
    length = _LARGEST_PART * threads if watch is not None or settings.judge is not None else max(1, count)
    length = LARGEST_BLOCK * threads if engine.cuts else length
    # samples are projected at the end, block by block in threads
    blocks = samples > 0 and (engine.cuts or cases.program.projects)
    share = min(_LARGEST_SHARE, max(1, min(count, length) // (threads * _SHARES_PER_THREAD)))
    for part in slices_of(count, length):
        size = part.stop - part.start
        kept, here = cases.to_keep(size, settings), result if size == count else result[part]
        run = None if blocks else columns_run(engine, cases, settings, part, here, share, kept)
        if run is None:
            _in_blocks(engine, cases, settings, result, threads)
            return result
        whole = run_shared(run, size, max(1, min(threads, -(-size // share))), settings.progress)
        if not whole:
            _interrupted(result)
        check_results(cases, settings, part, here, kept)
        if not whole:
            break
    return result


def _interrupted(result: BlockResult) -> BlockResult:
    """Set NaN for the results of cases that an interrupt has stopped, or kept from running."""
    result.refuse(result.ends[:, 1] == _INTERRUPTED, Status.INTERRUPTED)
    return result


def _in_blocks(engine: Engine, cases: Cases, settings: CaseSettings, result: BlockResult, threads: int) -> None:
    """Run all cases, block by block."""
    count = cases.count
    share = 1 if engine.whole_blocks else threads * _BLOCKS_PER_THREAD
    length = min(LARGEST_BLOCK, max(SMALLEST_BLOCK, -(-count // share)))
    stopping = threading.Event()

    def run_block(block: slice) -> int:
        with stopped_by(stopping):
            check()
            try:
                kept = cases.to_keep(block.stop - block.start, settings)
                run_one_block(engine, cases, settings, block, result[block], kept)
                check_results(cases, settings, block, result[block], kept)
            except KeyboardInterrupt:  # its events and totals are not written yet, and nothing is checked
                result.ends[block, 1] = _INTERRUPTED
                raise
        return block.stop - block.start

    with meter(count, settings.progress) as advance, _workers(threads, stopping) as each:
        try:
            for finished in each(run_block, slices_of(count, length)):
                advance(finished)
        except KeyboardInterrupt:
            stopping.set()
    if stopping.is_set():
        _interrupted(result)


@once
def _pool() -> ThreadPoolExecutor:
    """Return threads that are kept: starting them takes longer than a hundred cases.

    There are as many as sweeps that run at the same time need, so that none waits for another.
    """
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(_MOST_THREADS, thread_name_prefix="dalembert")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked process has none of them


def run_shared(run: CaseRun, count: int, threads: int, progress: bool) -> bool:
    """Run the work in threads; return whether all cases have ended.

    This thread works, too, where it need not look at the others; these begin where it returns to Python and much is
    left to do, so that few cases wait for none.
    """
    workers: list[Future[None]] = []

    def begin(number: int) -> None:
        workers.extend(_pool().submit(run.work) for _ in range(number))

    def begin_others() -> bool:
        begun = min(int(run.turn[0]), count)
        if (count - begun) * (perf_counter() - started) < _WORTH * begun:
            return False
        begin(threads - 1)
        return True

    whole = True
    with meter(count, progress) as advance:
        try:
            if progress or run.stop is not None:
                begin(threads)
            else:
                started = perf_counter()
                if count >= _MANY:
                    begin(threads - 1)
                run.work(begin_others if 1 < threads and count < _MANY else None)
                workers[:] = [worker for worker in workers if not worker.cancel()]
            _look_at(workers, run, count, advance, progress)
        except BaseException as reason:
            _stop(workers, run)
            if not isinstance(reason, KeyboardInterrupt):
                raise
            whole = False
    for worker in workers:
        worker.result()
    run.finish()
    return whole


def _look_at(
    workers: list[Future[None]], run: CaseRun, count: int, advance: Callable[[int], None], progress: bool
) -> None:
    """Wait until the work of threads has ended, and show how many of the cases have begun."""
    if not progress and os.name != "nt":
        for worker in workers:  # Ctrl-C is raised here
            worker.result()
        return
    if not workers:
        return
    from concurrent.futures import wait

    shown = 0
    while wait(workers, _BETWEEN_LOOKS).not_done:
        begun = min(int(run.turn[0]), count)
        advance(begun - shown)
        shown = begun
    advance(count - shown)


def _stop(workers: list[Future[None]], run: CaseRun) -> None:
    """Stop the work of threads within a fraction of a second, and wait until it has ended."""
    run.turn[0] = STOPPED
    workers[:] = [worker for worker in workers if not worker.cancel()]
    if not workers:
        return
    from concurrent.futures import wait

    while wait(workers, _BETWEEN_LOOKS).not_done:
        run.turn[0] = STOPPED
        if run.stop is not None:
            run.stop()


Each = Callable[[Callable[[slice], int], list[slice]], Iterable[int]]


@contextmanager
def _workers(threads: int, stopping: threading.Event) -> Iterator[Each]:
    """Yield a function that runs blocks and gives the size of each as it is finished; an interrupt stops them all."""
    if threads == 1:
        yield map
        return
    from concurrent.futures import ThreadPoolExecutor, as_completed

    with ThreadPoolExecutor(threads) as pool:
        try:
            yield lambda run, blocks: (
                task.result() for task in as_completed([pool.submit(run, block) for block in blocks])
            )
        except BaseException:
            stopping.set()
            pool.shutdown(wait=True, cancel_futures=True)
            raise
