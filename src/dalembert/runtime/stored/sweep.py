"""`sweep(to=...)`: cases in chunks, in this process or by a cluster, into a store that a later call completes."""

from __future__ import annotations

import json
import pickle
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ...codegen.llvm.target import target
from ...errors import MissingExtraError, OptionError, StoredSweepError
from ...once import DERIVING, derived_once
from ...options import StoreOptions, SweepOptions
from ...progress import meter
from ...results.grid import Grid
from ...version import __version__
from .chunks import columns_of, results_of
from .request import Given, Part, Request, request_of
from .store import COORDINATES, DIGEST, Columns, Store, packages
from .swept_models import SweptModel

if TYPE_CHECKING:
    import xarray

__all__ = ["stored_sweep"]

_PILOT = 256
"""Cases that are run first, for names and kinds of results, and for the time that a case takes."""
_SECONDS, _BYTES = 4.0, 128 << 20
"""Most seconds of one thread, and most bytes of results, of a chunk."""
_WAITING = 3
"""Chunks that a thread of a cluster has before it."""
_MODELS: dict[bytes, SweptModel] = {}
"""Models that were sent to this process."""
_MOST_MODELS = 4
_TARGET = "dalembert_target"
_NO_MATTER = ("grid", "inputs", "threads", "progress")
"""Options on which results do not depend, or that are among the cases."""


@final
@dataclass(frozen=True, eq=False)
class _Job:
    """The parts of a task that all chunks share: the model as bytes, options, and the instruction set."""

    model: bytes
    options: SweepOptions
    target: str


def stored_sweep(model: SweptModel, given: Given, options: SweepOptions, where: StoreOptions) -> xarray.Dataset:
    """Return the results of a sweep from its store, after computing what is missing there.

    Parameters
    ----------
    model : SweptModel
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
        Where chunks could not be computed; it says how many, and a later call goes on.
    """
    packages()
    _require_distributed(where)
    model = model.with_event_parameters(given[2], options)
    request = request_of(model.model.layout, given, options.grid)
    store = Store.open(where.to)
    if store is not None and not where.resume:
        raise OptionError(f"to={where.to!r} exists and resume=False; nothing was written. Choose another name")
    each = replace(options, grid=None, progress=False)
    leaders = model.leading_cases(request, each)
    each = replace(each, chosen=model.methods(request, each))
    pilot, seconds = _pilot(model, request, leaders, each)
    columns, attributes = columns_of(pilot, request), _attributes(model, request, each, pilot)
    if store is None:
        rows = _rows(where.chunk, request, columns, seconds)
        attributes[COORDINATES] = sorted(set(map(str, pilot.coords)) & set(columns))
        told = {str(name): dict(values.attrs) for name, values in pilot.variables.items() if values.attrs}
        store = Store.create(where.to, request, columns, rows, attributes, _coordinates(request, pilot), told)
    _refuse_other(store, where, attributes)
    job = _Job(pickle.dumps(model), each, target().key)
    _compute(model, job, request, store, leaders, (where, options.progress))
    return store.dataset()


def _refuse_other(store: Store, where: StoreOptions, attributes: Mapping[str, Any]) -> None:
    """Refuse a store of another sweep, and one that was begun for another instruction set."""
    held = store.group.attrs
    if held[DIGEST] != attributes[DIGEST]:
        raise OptionError(
            f"to={where.to!r} holds another sweep ({_difference(held, attributes)}); nothing was written."
            " Choose another name, or remove it"
        )
    if held[_TARGET] != attributes[_TARGET]:
        raise OptionError(
            f"to={where.to!r} was begun for the instruction set {held[_TARGET]!r}, and this processor runs"
            f" {attributes[_TARGET]!r}: results would differ in their last digits. Set DALEMBERT_TARGET to a common one"
            " and begin anew"
        )


def _pilot(
    model: SweptModel, request: Request, leaders: list[int], options: SweepOptions
) -> tuple[xarray.Dataset, float]:
    """Return the results of the first cases, and the seconds that one case takes in one thread."""
    count = min(_PILOT, request.count)
    results_of(model, request.part(0, 1, leaders), options)  # compiles what is needed
    begin = time.perf_counter()
    results = results_of(model, request.part(0, count, leaders), replace(options, threads=1))
    return results, (time.perf_counter() - begin) / count


def _require_distributed(where: StoreOptions) -> None:
    if where.client is None:
        return
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise MissingExtraError('client= needs distributed; install it with: pip install "dalembert[dask]"') from None


def _coordinates(request: Request, pilot: xarray.Dataset) -> Columns:
    """Return the values along axes."""
    axes = {} if request.cases is None else dict(request.cases.axes)
    return axes | ({"time": np.asarray(pilot["time"])} if "time" in pilot.coords else {})


def _rows(chunk: int | None, request: Request, columns: Columns, seconds: float) -> int:
    """Return how many rows of the first axis a chunk has."""
    if chunk is None:
        size = sum(values.nbytes for values in columns.values()) / len(next(iter(columns.values())))
        chunk = max(1, int(min(_SECONDS / max(seconds, 1e-9), _BYTES / size)))
    return int(min(max(1, chunk // request.row), request.shape[0]))


def _attributes(model: SweptModel, request: Request, options: SweepOptions, pilot: xarray.Dataset) -> dict[str, Any]:
    """Return what the store says of itself."""
    chosen = ((field.name, getattr(options, field.name)) for field in fields(options))
    parts = {
        "scene": blake2b(model.text.encode(), digest_size=16).hexdigest(),
        "cases": request.digest(),
        "options": repr(sorted((name, _plain(value)) for name, value in chosen if name not in _NO_MATTER)),
    }
    whole_digest = blake2b(json.dumps([*parts.values(), __version__]).encode(), digest_size=16).hexdigest()
    known = {name: pilot.attrs[name] for name in ("scene", "formulation", "method", "parameters", "dalembert_version")}
    tolerances = {"rtol": options.rtol, "atol": options.atol}
    return {**known, **tolerances, DIGEST: whole_digest, "dalembert_parts": parts, _TARGET: target().key}


def _plain(value: Any) -> str:
    return value.tobytes().hex() if isinstance(value, np.ndarray) else repr(value)


def _difference(held: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    """Return what differs between a store and a request."""
    names = {"scene": "its scene", "cases": "its cases", "options": "its options"}
    old, new = held.get("dalembert_parts", {}), wanted["dalembert_parts"]
    different = [text for key, text in names.items() if old.get(key) != new[key]]
    if not different:
        different = [f"version {held.get('dalembert_version')} of dalembert"]
    return "other: " + ", ".join(different)


def _compute(
    model: SweptModel,
    job: _Job,
    request: Request,
    store: Store,
    leaders: list[int],
    how: tuple[StoreOptions, bool],
) -> None:
    """Compute the chunks that are missing, and write them; `how` says where, and whether to show a bar.

    Raises
    ------
    StoredSweepError
        Where some could not be computed.
    """
    (where, progress), missing = how, store.missing(request)
    parts = ((k, _part(request, store, k, leaders)) for k in missing)
    failed: dict[int, str] = {}
    with meter(len(missing), progress, "chunk") as advance:
        for chunk, reason in _outcomes(model, job, request, store, parts, where.client):
            if reason:
                failed[chunk] = reason
            advance(1)
    if failed:
        chunk, reason = next(iter(failed.items()))
        done = store.count - len(failed)
        raise StoredSweepError(
            f"{done} of {store.count} chunks are in {str(where.to)!r}; {len(failed)} could not be computed, the first"
            f" of them, {chunk}, because of: {reason}. Nothing is lost: the same call goes on with what is missing"
        )


def _part(request: Request, store: Store, chunk: int, leaders: list[int]) -> Part:
    """Return the cases of a chunk."""
    first = chunk * store.rows * request.row
    return request.part(first, min(first + store.rows * request.row, request.count), leaders)


def _outcomes(
    model: SweptModel, job: _Job, request: Request, store: Store, parts: Iterator[tuple[int, Part]], client: Any
) -> Iterator[tuple[int, str]]:
    """Yield the number of each chunk that was tried, and why it failed, or nothing."""
    if client is None:
        for chunk, part in parts:
            yield chunk, _attempt(partial(_write, model, job.options, request, store, chunk, part))
        return
    from distributed import as_completed

    axes = request.cases if isinstance(request.cases, Grid) else None
    shell = replace(request, initial={}, parameters={}, inputs=None, span={}, cases=axes)
    threads = max(1, sum(client.nthreads().values()))
    waiting: Any = as_completed()  # type: ignore[no-untyped-call]
    chunks: dict[Any, int] = {}

    def submit() -> None:
        for chunk, part in parts:
            task = client.submit(_remote, job, shell, store.where, chunk, part, pure=False, retries=2)
            chunks[task] = chunk
            waiting.add(task)
            return

    for _ in range(_WAITING * threads):
        submit()
    for task in waiting:
        chunk = chunks.pop(task)
        yield chunk, "" if task.status == "finished" else _said(task.exception())
        task.release()
        submit()


def _attempt(run: Callable[[], None]) -> str:
    """Return why a chunk could not be computed or written, or nothing."""
    try:
        run()
    except (MemoryError, OSError) as reason:
        return _said(reason)
    return ""


def _said(reason: BaseException | None) -> str:
    return f"{type(reason).__name__}: {reason}"


def _write(model: SweptModel, options: SweepOptions, request: Request, store: Store, chunk: int, part: Part) -> None:
    """Compute a chunk, and write it."""
    store.write(chunk, request, columns_of(results_of(model, part, options), request))


def _remote(job: _Job, request: Request, where: Any, chunk: int, part: Part) -> None:
    """Compute a chunk in a process of a cluster."""
    if target().key != job.target:
        raise StoredSweepError(
            f"this worker has the instruction set {target().key!r}, and the sweep was begun for {job.target!r}; set"
            " DALEMBERT_TARGET to a common one on all machines"
        )
    store = Store.open(where)
    assert store is not None
    _write(_model_of(job.model), replace(job.options, threads=1), request, store, chunk, part)


def _model_of(text: bytes) -> SweptModel:
    """Return a model that was sent to this process, compiled once, whichever threads need it at the same time."""
    with DERIVING:
        if text not in _MODELS and len(_MODELS) >= _MOST_MODELS:
            _MODELS.clear()
        return derived_once(_MODELS, text, lambda: pickle.loads(text))
