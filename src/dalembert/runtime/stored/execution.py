"""Execution of the chunks that a store lacks: by threads of this process, or by the workers of a cluster."""

from __future__ import annotations

import errno
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

from ...errors import StoredSweepError
from ...options import StoreOptions
from ...processors import available_threads
from ...progress import meter
from .chunks import ChunkJob
from .outcomes import LostCluster, Outcomes

__all__ = ["compute_missing"]

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}
"""Errors of a store that takes no further chunk."""


def compute_missing(
    job: ChunkJob, missing: Sequence[int], where: StoreOptions, progress: bool, machine: Mapping[str, str]
) -> None:
    """Compute the chunks that are missing, and write them.

    Parameters
    ----------
    job : ChunkJob
    missing : sequence of int
    where : StoreOptions
    progress : bool
    machine : mapping of str to str
        Instruction set and versions that workers must have.

    Raises
    ------
    StoredSweepError
        Where some could not be computed.
    """
    finished, failed = 0, dict[int, str]()
    client = where.client
    if client is None:
        outcomes = _by_threads(job, missing)
    else:
        from .cluster import by_cluster

        outcomes = by_cluster(job, missing, client, machine)
    with meter(len(missing), progress, "chunk") as advance:
        for chunk, error in outcomes:
            advance(1)
            finished += error is None
            if error is None:
                continue
            failed[chunk] = f"{type(error).__name__}: {error}"
            if isinstance(error, LostCluster) or getattr(error, "errno", None) in _FULL:
                outcomes.close()
                break
    if failed:
        chunk, reason = next(iter(failed.items()))
        raise StoredSweepError(
            f"{job.store.count - len(missing) + finished} of {job.store.count} chunks are in {str(where.to)!r};"
            f" {len(missing) - finished} are missing. Chunk {chunk} could not be computed: {reason}. Nothing is lost:"
            " the same call continues with the missing ones"
        )


def _by_threads(job: ChunkJob, missing: Sequence[int]) -> Outcomes:
    """Compute chunks in threads of this process, each in one thread where there are enough of them."""
    threads = job.options.threads or available_threads()
    together = min(threads, len(missing))

    def attempt(chunk: int) -> BaseException | None:
        return _attempted(lambda: job.run(chunk, job.given(chunk), max(1, threads // together)))

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
