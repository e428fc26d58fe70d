"""Execution of the chunks that a store lacks: by threads of this process, or by the workers of a cluster."""

from __future__ import annotations

import errno
import pickle
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Event, Thread
from typing import Any, final

from ...codegen.llvm.target import target
from ...errors import StoredSweepError, StoredSweepWarning
from ...once import DERIVING, derived_once
from ...options import StoreOptions, SweepOptions
from ...progress import meter
from ..cases import available_threads
from .chunks import columns_of, results_of
from .request import Part, Request
from .store import Store
from .swept_models import SweptModel

__all__ = ["ChunkJob", "compute_missing"]

_WAITING = 3
"""Chunks that a thread of a cluster has before it."""
_MOST_DEATHS = 8
"""Times that a cluster may give up a chunk because its workers died, before it counts as failed."""
_LOOK = 20.0
"""Seconds after which it is looked again whether a cluster has any worker."""
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}
"""Errors of a store that takes no further chunk."""
_JOBS: dict[bytes, ChunkJob] = {}
"""Jobs that were sent to this process."""
_MOST_JOBS = 4


@final
@dataclass(frozen=True, eq=False)
class ChunkJob:
    """The common part of all chunks of a sweep: model, options, cases, leading cases, store, instruction set."""

    model: SweptModel
    options: SweepOptions
    request: Request
    leaders: Sequence[int]
    where: Any
    target: str

    @cached_property
    def store(self) -> Store:
        """The store as a process of a cluster sees it.

        Raises
        ------
        StoredSweepError
            Where there is none.
        """
        store = Store.open(self.where)
        if store is None:
            raise StoredSweepError(
                f"this worker does not see the store {str(self.where)!r}; all machines must share it"
            )
        return store

    def cases(self, store: Store, chunk: int) -> tuple[int, int]:
        """Return the number of the first case of a chunk, and of the one behind its last."""
        first = chunk * store.rows * self.request.row
        return first, min(first + store.rows * self.request.row, self.request.count)

    def given(self, store: Store, chunk: int) -> Part:
        """Return the arrays of a chunk."""
        return self.request.given(*self.cases(store, chunk), self.leaders)

    def run(self, store: Store, chunk: int, given: Part, threads: int) -> None:
        """Compute a chunk from its arrays, and write it."""
        part = self.request.completed(given, *self.cases(store, chunk), self.leaders)
        results = results_of(self.model, part, replace(self.options, threads=threads))
        store.write(chunk, self.request, columns_of(results, self.request))


def compute_missing(job: ChunkJob, store: Store, where: StoreOptions, progress: bool) -> None:
    """Compute the chunks that are missing, and write them.

    Raises
    ------
    StoredSweepError
        Where some could not be computed.
    """
    missing, finished = store.missing(job.request), 0
    failed: dict[int, str] = {}
    if not missing:
        return
    execute = _by_threads if where.client is None else _by_cluster
    with meter(len(missing), progress) as advance:
        outcomes = execute(job, store, missing, where.client)
        for chunk, error in outcomes:
            advance(1)
            finished += error is None
            if error is None:
                continue
            failed[chunk] = f"{type(error).__name__}: {error}"
            if isinstance(error, _LostCluster) or getattr(error, "errno", None) in _FULL:
                outcomes.close()
                break
    if failed:
        chunk, reason = next(iter(failed.items()))
        raise StoredSweepError(
            f"{store.count - len(missing) + finished} of {store.count} chunks are in {str(where.to)!r};"
            f" {len(missing) - finished} are missing. Chunk {chunk} could not be computed: {reason}. Nothing is lost:"
            " the same call goes on with what is missing"
        )


Outcomes = Iterator[tuple[int, BaseException | None]]
"""The number of each chunk that was tried, and what stopped it."""


def _by_threads(job: ChunkJob, store: Store, missing: Sequence[int], client: None) -> Any:
    """Compute chunks in threads of this process, each in one thread where there are enough of them."""
    threads = job.options.threads or available_threads()
    together = min(threads, len(missing))

    def attempt(chunk: int) -> BaseException | None:
        return _attempted(lambda: job.run(store, chunk, job.given(store, chunk), max(1, threads // together)))

    if together == 1:
        yield from ((chunk, attempt(chunk)) for chunk in missing)
        return
    rest, going = iter(missing), dict[Future[BaseException | None], int]()
    with ThreadPoolExecutor(together, thread_name_prefix="dalembert-chunks") as pool:
        try:
            for chunk in rest:
                going[pool.submit(attempt, chunk)] = chunk
                if len(going) == together:
                    break
            while going:
                for done in wait(going, return_when=FIRST_COMPLETED).done:
                    chunk = going.pop(done)
                    for following in rest:
                        going[pool.submit(attempt, following)] = following
                        break
                    yield chunk, done.result()
        finally:  # chunks that run come to their ends, and are kept
            pool.shutdown(wait=True, cancel_futures=True)


def _attempted(run: Callable[[], None]) -> BaseException | None:
    """Return why a chunk could not be computed or written, None where it was."""
    try:
        run()
    except (MemoryError, OSError) as error:
        return error
    return None


# -- clusters --------------------------------------------------------------------------------------


class _LostCluster(Exception):
    """The scheduler does not answer any more."""


def _by_cluster(job: ChunkJob, store: Store, missing: Sequence[int], client: Any) -> Any:
    """Compute chunks by the workers of a cluster.

    The job travels as bytes with every chunk, because data that is sent once is lost with the workers that hold it.
    """
    from distributed import KilledWorker, as_completed

    text = pickle.dumps(replace(job, request=job.request.without_arrays()))
    waiting: Any = as_completed()  # type: ignore[no-untyped-call]
    rest, deaths, chunks = iter(missing), Counter[int](), dict[Any, int]()

    def submit(chunk: int) -> None:
        task = client.submit(_run_remotely, text, chunk, job.given(store, chunk), pure=False, retries=2)
        chunks[task] = chunk
        waiting.add(task)

    watch = _watch(client)
    try:
        for _, chunk in zip(range(_WAITING * max(1, sum(client.nthreads().values()))), rest, strict=False):
            submit(chunk)
        for task in waiting:
            chunk, error = chunks.pop(task), None
            if task.status in ("cancelled", "lost"):
                error = _LostCluster("the cluster cancelled it, or does not answer any more")
            elif task.status != "finished":
                error = task.exception()
            task.release()
            if isinstance(error, KilledWorker) and deaths[chunk] < _MOST_DEATHS:
                deaths[chunk] += 1
                submit(chunk)
                continue
            for following in rest:
                submit(following)
                break
            yield chunk, error
    finally:
        watch.set()
        if chunks and client.status == "running":
            client.cancel(list(chunks))


def _watch(client: Any) -> Event:
    """Warn from now on, until the event is set, each time that a cluster comes to have no worker."""
    ended = Event()

    def look() -> None:
        absent = False
        while not ended.wait(_LOOK) and client.status == "running":
            without = not client.nthreads()
            if without and not absent:
                warnings.warn(
                    "the cluster of this sweep has no worker, and the sweep waits for one: start workers, or end it"
                    " (Ctrl-C) and call it again later; chunks that are done are kept",
                    StoredSweepWarning,
                    stacklevel=2,
                )
            absent = without

    Thread(target=look, daemon=True).start()
    return ended


def _run_remotely(text: bytes, chunk: int, given: Part) -> None:
    """Compute a chunk in a process of a cluster."""
    job = _job_of(text)
    if target().key != job.target:
        raise StoredSweepError(
            f"this worker has the instruction set {target().key!r}, and the sweep was begun for {job.target!r}; set"
            " DALEMBERT_TARGET to a common one on all machines"
        )
    job.run(job.store, chunk, given, threads=1)


def _job_of(text: bytes) -> ChunkJob:
    """Return a job that was sent to this process, its model compiled once, whichever threads need it."""

    def make() -> ChunkJob:
        job: ChunkJob = pickle.loads(text)
        if job.model.model.backend == "jax":
            from .jax_device import take_own_device

            take_own_device()
        return job

    with DERIVING:
        if text not in _JOBS and len(_JOBS) >= _MOST_JOBS:
            _JOBS.clear()
        return derived_once(_JOBS, text, make)
