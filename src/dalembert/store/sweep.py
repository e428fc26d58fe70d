"""`sweep(to=...)`: cases in chunks, in this process or by a cluster, into a store that a later call completes."""

from __future__ import annotations

import errno
import json
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import fields, replace
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MissingExtraError, OptionError, StoredSweepError
from ..options import StoreOptions, SweepOptions, atol_attribute
from ..progress import meter
from ..results.labels import given_name, with_units
from ..threads import available_threads
from ..version import __version__
from .chunks import ChunkJob, LostCluster, Outcomes, SweptModel, columns_of, results_of
from .description import DIGEST, difference, machine, names_of, packages
from .request import Given, Request, request_of
from .store import COORDINATES, VARIABLES, Columns, Store, StoreLayout

if TYPE_CHECKING:
    import xarray

    from ..model.model import CompiledModel


# Execution of the chunks that a store lacks: by threads of this process, or by the workers of a cluster.

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


_PILOT, _LARGEST_PILOT, _PILOT_SECONDS = 256, 1 << 14, 0.02
"""Cases that are run first, at least and at most, and for how long, to learn the time that a case takes [s]."""
_SECONDS, _BYTES, _FEWEST_BYTES = 4.0, 128 << 20, 16 << 20
"""Most seconds of one thread, and most bytes of results, of a chunk; threads of this process share these bytes."""
_MACHINE = "dalembert_machine"
_NO_MATTER = ("grid", "inputs", "threads", "progress", "origin")
"""Options on which results do not depend, or that are among the cases: the origin is the start of each."""


def stored_sweep(compiled: CompiledModel, given: Given, options: SweepOptions, where: StoreOptions) -> xarray.Dataset:
    """Return the results of a sweep from its store, after computing what is missing there.

    Parameters
    ----------
    compiled : CompiledModel
    given : tuple
        Span, initial values, parameters and inputs, as `CompiledModel.sweep` takes them.
    options : SweepOptions
        Without inputs, which each chunk reads for its cases.
    where : StoreOptions

    Raises
    ------
    MissingExtraError
        Without zarr and xarray.
    OptionError
        Where the store belongs to something else, or exists and `resume` is off.
    StoredSweepError
        Where chunks could not be computed; the message says how many; a later call continues.
    """
    packages()
    _require_distributed(where)
    model = SweptModel(compiled).with_event_parameters(given[2], options)
    request = request_of(model.model.layout, given, options.grid)
    store = Store.open(where.to)
    if store is not None and not where.resume:
        raise OptionError(f"to={where.to!r} exists and resume=False; nothing was written. Choose another name")
    each = replace(options, grid=None, progress=False)
    leaders = model.leading_cases(request, each)
    each = replace(each, chosen=model.methods(request, each))
    pilot, seconds = _pilot(model, request, leaders, each)
    attributes = _attributes(model, request, each, pilot)
    names = model.model.layout.aliases, json.loads(attributes["parameters"])
    with_units(pilot, where.units, *names)  # rejects units before anything is written
    if store is not None:
        _refuse_other(store, where, attributes)
    try:
        store = _laid_out(store, request, where, pilot, attributes, _most_cases(options, where, seconds))
        if where.units is not None:
            store.label(with_units(store.dataset(), where.units, *names))
    except OSError as error:
        raise StoredSweepError(
            f"the store {str(where.to)!r} could not be laid out: {error}. Make room, or choose a folder that can be"
            " written; the same call continues where this one ended"
        ) from error
    missing = store.missing(request)
    if missing:
        _refuse_other_machine(store, where, attributes)
        job = ChunkJob(model, each, request, leaders, store)
        compute_missing(job, missing, where, options.progress, attributes[_MACHINE])
    return store.dataset()


def _laid_out(
    store: Store | None,
    request: Request,
    where: StoreOptions,
    pilot: xarray.Dataset,
    attributes: Mapping[str, Any],
    most: Callable[[Columns], int],
) -> Store:
    """Return the store with all its arrays; a new one has chunks of as many cases as `most` says of some results."""
    columns, axes = columns_of(pilot, request), _coordinates(request, pilot)
    if store is None:
        coordinates = [name for name in map(str, pilot.coords) if name in columns]
        rows = int(min(max(1, most(columns) // request.row), request.shape[0]))
        names = {COORDINATES: coordinates, VARIABLES: list(dict.fromkeys((*axes, *coordinates, *columns)))}
        store = Store.create(where.to, rows, {**attributes, **names})
        _refuse_other(store, where, attributes)  # another process may have begun another sweep in the meantime
    labels = {str(name): dict(values.attrs) for name, values in pilot.variables.items() if values.attrs}
    store.lay_out(request, StoreLayout(columns, axes, labels))
    return store


def _refuse_other(store: Store, where: StoreOptions, attributes: Mapping[str, Any]) -> None:
    """Reject a store of another sweep."""
    held = store.group.attrs
    if held[DIGEST] != attributes[DIGEST]:
        raise OptionError(
            f"to={where.to!r} holds another sweep ({_difference(held, attributes)}); nothing was written."
            " Choose another name, or remove it"
        )


def _refuse_other_machine(store: Store, where: StoreOptions, attributes: Mapping[str, Any]) -> None:
    """Raise an error if a store was begun with another instruction set, or with other versions."""
    different = difference(store.group.attrs.get(_MACHINE, {}), attributes[_MACHINE])
    if different:
        raise OptionError(
            f"to={where.to!r} lacks chunks, whose last digits would be other ones here: this process has {different}"
        )


def _pilot(
    model: SweptModel, request: Request, leaders: list[int], options: SweepOptions
) -> tuple[xarray.Dataset, float]:
    """Return the results of the first cases, and the seconds that one case takes in one thread."""
    results = results_of(model, request.part(0, 1, leaders), options)  # compiles what is needed
    count, seconds = min(_PILOT, request.count), 0.0
    while True:
        begin = time.process_time()
        results = results_of(model, request.part(0, count, leaders), replace(options, threads=1))
        seconds = time.process_time() - begin
        if seconds >= _PILOT_SECONDS or count == min(_LARGEST_PILOT, request.count):
            return results, seconds / count
        count = min(4 * count, _LARGEST_PILOT, request.count)


def _require_distributed(where: StoreOptions) -> None:
    if where.client is None:
        return
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise MissingExtraError('client= needs distributed; install it with: pip install "dalembert[dask]"') from None


def _coordinates(request: Request, pilot: xarray.Dataset) -> Columns:
    """Return the values along axes."""
    axes = {} if request.cases is None else {given_name(name): values for name, values in request.cases.axes.items()}
    return axes | ({"time": np.asarray(pilot["time"])} if "time" in pilot.coords else {})


def _most_cases(options: SweepOptions, where: StoreOptions, seconds: float) -> Callable[[Columns], int]:
    """Return a function from seconds a case to the number of cases of a chunk, from results of some cases."""
    threads = 1 if where.client is not None else options.threads or available_threads()
    most = max(_FEWEST_BYTES, _BYTES // threads)

    def cases(columns: Columns) -> int:
        size = sum(values.nbytes for values in columns.values()) / len(next(iter(columns.values())))
        return where.chunk or max(1, int(min(_SECONDS / max(seconds, 1e-9), most / size)))

    return cases


def _attributes(model: SweptModel, request: Request, options: SweepOptions, pilot: xarray.Dataset) -> dict[str, Any]:
    """Return the attributes of the store."""
    chosen = ((field.name, getattr(options, field.name)) for field in fields(options))
    parts = {
        "scene": blake2b(model.text.encode(), digest_size=16).hexdigest(),
        "cases": request.digest(),
        "options": repr(sorted((name, _plain(value)) for name, value in chosen if name not in _NO_MATTER)),
    }
    whole_digest = blake2b(json.dumps([*parts.values(), __version__]).encode(), digest_size=16).hexdigest()
    known = {name: pilot.attrs[name] for name in ("scene", "formulation", "method", "parameters", "dalembert_version")}
    tolerances = {"rtol": options.rtol, "atol": atol_attribute(options.atol)}
    versions = {"python_version": platform.python_version(), "numpy_version": np.__version__}
    attributes = {**known, **tolerances, **versions, "scene_digest": parts["scene"]}
    return {
        **attributes,
        DIGEST: whole_digest,
        "dalembert_parts": parts,
        _MACHINE: machine(names_of(model.model.backend)),
    }


def _plain(value: Any) -> str:
    return value.tobytes().hex() if isinstance(value, np.ndarray) else repr(value)


def _difference(held: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    """Return the differences between a store and a request."""
    names = {"scene": "its scene", "cases": "its cases", "options": "its options"}
    old, new = held.get("dalembert_parts", {}), wanted["dalembert_parts"]
    different = [text for key, text in names.items() if old.get(key) != new[key]]
    if not different:
        different = [f"version {held.get('dalembert_version')} of dalembert"]
    return "other: " + ", ".join(different)
