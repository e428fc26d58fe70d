"""Chunks of a stored sweep on the workers of a cluster of dask.

The program of the model is kept in the store while the sweep runs, and each process reads it once: data that workers
hold is lost with them, and a task that carried it would burden the scheduler. A task has the options of the sweep, a
few kilobytes, and the arrays of its chunk.
"""

from __future__ import annotations

import copyreg
import io
import pickle
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, final
from uuid import uuid4

from ..codegen import backend_named
from ..codegen.base import RenderedModule
from ..errors import StoredSweepError, StoredSweepWarning
from ..frozen import frozen
from ..ir.program import Program
from ..once import DERIVING, BoundedTable, derived_once
from ..options import SweepOptions
from ..pipeline import Compiled, SeveralModes, Stages
from .chunks import ChunkJob, LostCluster, Outcomes, SweptModel
from .description import difference, digest_of, machine
from .request import CasePart, Request
from .store import Store

if TYPE_CHECKING:
    from ..model.model import CompiledModel

# Models as bytes from which another process makes them without deriving anything.
#
# ``pickle.dumps(model)`` has the scene, which is small and is derived again where it is read. Here a model has its
# program and the equations of motion that it was made of, so that every process runs the very same program.


def packed(model: SweptModel) -> bytes:
    """Return a model as bytes."""
    kind: type[Any] = type(model.model)
    reductions: dict[type, Any] = {
        kind: lambda each: (_loaded, (kind, each.modes.several) if each.modes else (kind, each.stages, each.dropped)),
        RenderedModule: lambda each: (_rendered, (each.backend, each.program)),
    }
    data = io.BytesIO()
    pickler = pickle.Pickler(data, protocol=5)
    pickler.dispatch_table = copyreg.dispatch_table | reductions
    with DERIVING:  # graphs do not change meanwhile
        pickler.dump(model)
    return data.getvalue()


def unpacked(data: bytes) -> SweptModel:
    """Return the model that a process of the same versions packed."""
    model: SweptModel = pickle.loads(data)
    return model


def _rendered(backend: str, program: Program) -> RenderedModule:
    return backend_named(backend).render(program)


def _loaded(kind: type[CompiledModel], stages: Stages | SeveralModes, dropped: tuple[int, ...] = ()) -> CompiledModel:
    """Return the model of stages, its code compiled, or read from the cache, in this process."""
    if isinstance(stages, SeveralModes):
        return kind.of(stages)
    backend = backend_named(stages.rendered.backend)
    engine = backend.load(stages.rendered, cache=stages.options.cache)
    return kind.of(Compiled(stages, engine, backend.serving(stages.program)), dropped)


_WAITING = 3
"""Chunks that a thread of a cluster has before it."""
_MOST_DEATHS = 8
"""Times that a cluster may give up a chunk because its workers died, before it counts as failed."""
_LOOK = 20.0
"""Seconds after which it is looked again whether a cluster has any worker."""
_MOST = 4
"""Jobs, and models, that a process of a cluster keeps."""
_JOBS: BoundedTable[bytes, ChunkJob] = BoundedTable(_MOST)
"""Jobs that were sent to this process."""
_MODELS: BoundedTable[str, SweptModel] = BoundedTable(_MOST)
"""Models of these jobs, and of earlier ones, by the digests of their programs."""


@final
@frozen(eq=False)
class _SentJob:
    """A `ChunkJob` on its way to a worker.

    Attributes
    ----------
    program : str
        Digest of the program of the model, which is in the store.
    backend : str
        Of the model.
    options, request, leaders
        As in `ChunkJob`, the request without arrays.
    where : zarr store or path
    number : str
        Different in every sweep: a store of the same name may be another one by then.
    """

    program: str
    backend: str
    options: SweepOptions
    request: Request
    leaders: Sequence[int]
    where: Any
    number: str

    def received(self) -> ChunkJob:
        """Return the job in a process of a cluster.

        Raises
        ------
        StoredSweepError
            Where that sees another store, or none.
        """
        store = Store.open(self.where)
        program = None if store is None else store.program(self.program)
        if store is None or (program is None and self.program not in _MODELS):
            raise StoredSweepError(
                f"this worker does not see the store {str(self.where)!r}, or another one; all machines must share it"
            )
        if self.backend == "jax":
            from .jax_device import take_own_device

            take_own_device()
        model = derived_once(_MODELS, self.program, lambda: unpacked(program or b""))
        return ChunkJob(model, self.options, self.request, self.leaders, store)


def by_cluster(job: ChunkJob, missing: Sequence[int], client: Any, wanted: Mapping[str, str]) -> Outcomes:
    """Compute chunks by the workers of a cluster, which must have the `wanted` instruction set and versions."""
    from distributed import KilledWorker, as_completed

    program = packed(job.model)
    digest, request = digest_of(program), job.request.without_arrays()
    try:
        job.store.keep_program(digest, program)
    except OSError as full:
        yield missing[0], full
        return
    backend = job.model.model.backend
    where = _from_anywhere(job.store.where)
    text = pickle.dumps(_SentJob(digest, backend, job.options, request, job.leaders, where, uuid4().hex))
    waiting: Any = as_completed()  # type: ignore[no-untyped-call]
    rest, deaths, chunks = iter(missing), Counter[int](), dict[Any, int]()

    def submit(chunk: int) -> None:
        task = client.submit(_run_remotely, wanted, text, chunk, job.given(chunk), pure=False, retries=2)
        chunks[task] = chunk
        waiting.add(task)

    watch = _watch(client)
    try:
        for _, chunk in zip(range(_WAITING * max(1, sum(client.nthreads().values()))), rest, strict=False):
            submit(chunk)
        for task in waiting:
            chunk, error = chunks.pop(task), None
            if task.status in ("cancelled", "lost"):
                error = LostCluster("the cluster cancelled it, or does not answer any more")
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
        job.store.drop_programs()
    finally:
        watch.set()
        if chunks and client.status == "running":
            client.cancel(list(chunks))


def _from_anywhere(where: Any) -> Any:
    """Return the place of a store such that processes in other folders find it."""
    here = isinstance(where, Path) or (isinstance(where, str) and "://" not in where)
    return Path(where).absolute() if here else where


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


# -- in the processes of a cluster -----------------------------------------------------------------


def _run_remotely(wanted: Mapping[str, str], text: bytes, chunk: int, given: CasePart) -> None:
    """Compute a chunk in a process of a cluster."""
    different = difference(wanted, machine(wanted))
    if different:
        raise StoredSweepError(f"this worker has {different}")
    _job_of(text).run(chunk, given, threads=1)


def _job_of(text: bytes) -> ChunkJob:
    """Return a job that was sent to this process, its model compiled once, whichever threads need it."""
    return derived_once(_JOBS, text, lambda: _received(text))


def _received(text: bytes) -> ChunkJob:
    sent: _SentJob = pickle.loads(text)
    return sent.received()
