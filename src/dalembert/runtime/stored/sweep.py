"""`sweep(to=...)`: cases in chunks, in this process or by a cluster, into a store that a later call completes."""

from __future__ import annotations

import json
import pickle
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ...codegen.llvm.target import target
from ...errors import MissingExtraError, OptionError, StoredSweepError
from ...methods.status import Status
from ...results.grid import Grid
from ...values import flag, whole
from ...version import __version__
from ..cases import Cases
from .request import Part, Request, request_of
from .store import COORDINATES, DIGEST, Columns, Store, packages

if TYPE_CHECKING:
    import xarray

    from ..model import CompiledModel

__all__ = ["StoreOptions", "stored_sweep"]

_PILOT = 256
_SCANNED = 4096
_SECONDS, _BYTES = 4.0, 128 << 20
"""What a chunk takes at most: seconds of one thread, and memory of its results."""
_WAITING = 3
"""Chunks that a thread of a cluster has before it."""
_TARGET = "dalembert_target"


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class StoreOptions:
    """Where a stored sweep goes, and who computes it.

    Attributes
    ----------
    to : str, Path or zarr store
    chunk : int or None
        Cases of a chunk; None chooses it.
    client : distributed.Client or None
        The cluster; None for this process.
    resume : bool
        Whether an existing store of the same sweep is completed.
    progress : bool
    """

    to: Any
    chunk: int | None = None
    client: Any = None
    resume: bool = True
    progress: bool = False

    def __post_init__(self) -> None:
        if self.chunk is not None and whole("chunk", self.chunk) < 1:
            raise OptionError(f"chunk must be at least one case, not {self.chunk!r}; leave it out to have it chosen")
        flag("resume", self.resume)
        if self.client is not None and getattr(self.client, "status", None) != "running":
            raise OptionError(
                "client must be a running distributed.Client; this one is"
                f" {getattr(self.client, 'status', type(self.client).__name__)}. Make a new one, or leave it out"
            )


@final
@dataclass(frozen=True, eq=False)
class _Job:
    """What every chunk has in common: the model as bytes, the options of its sweeps, the request and the store."""

    model: bytes
    options: Mapping[str, Any]
    target: str


def stored_sweep(
    model: CompiledModel,
    t_span: tuple[Any, Any],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    options: Mapping[str, Any],
    where: StoreOptions,
) -> xarray.Dataset:
    """Return the results of a sweep from its store, after computing what is missing there.

    Parameters
    ----------
    options : mapping
        The other keyword arguments of `CompiledModel.sweep`.

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
    given = dict(options)
    request = request_of(t_span, initial, parameters, given.pop("inputs"), given.pop("grid"), model.layout.parameters)
    store = Store.open(where.to)
    if store is not None and not where.resume:
        raise OptionError(f"to={where.to!r} exists and resume=False; nothing was written. Choose another name")
    given["progress"] = False
    leaders = _leaders(model, request, given)
    given["method"] = _method(model, request, given)
    pilot_cases = min(_PILOT, request.count)
    _results(model, request.part(0, 1, leaders), given)  # compiles what is needed
    begin = time.perf_counter()
    pilot = _results(model, request.part(0, pilot_cases, leaders), {**given, "threads": 1})
    seconds = (time.perf_counter() - begin) / pilot_cases
    columns = _columns(pilot, request)
    attributes = _attributes(model, request, given, pilot)
    attributes[COORDINATES] = sorted(set(map(str, pilot.coords)) & set(columns))
    if store is None:
        rows = _rows(where.chunk, request, columns, seconds)
        store = Store.create(where.to, request, columns, rows, attributes, _coordinates(request, pilot))
    elif store.group.attrs[DIGEST] != attributes[DIGEST]:
        raise OptionError(
            f"to={where.to!r} holds another sweep ({_difference(store.group.attrs, attributes)}); nothing was written."
            " Choose another name, or remove it"
        )
    job = _Job(pickle.dumps(model), given, target().key)
    if store.group.attrs[_TARGET] != job.target:
        raise OptionError(
            f"to={where.to!r} was begun for the instruction set {store.group.attrs[_TARGET]!r}, and this processor runs"
            f" {job.target!r}: results would differ in their last digits. Set DALEMBERT_TARGET to a common one and"
            " begin anew"
        )
    missing = store.missing(request)
    _compute(model, job, request, store, missing, leaders, where)
    return store.dataset()


def _require_distributed(where: StoreOptions) -> None:
    if where.client is None:
        return
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise MissingExtraError('client= needs distributed; install it with: pip install "dalembert[dask]"') from None


def _leaders(model: CompiledModel, request: Request, options: Mapping[str, Any]) -> list[int]:
    """Return the cases by which a sweep decides what all cases have in common.

    The first; the first that can start; and the first at which no pivot of the constraints vanishes, if the first case
    has such a one.
    """
    lead = [0]
    plain = {**options, "reduce": None, "events": (), "error_estimate": False, "t_eval": None, "max_steps": 1}
    plain["project_invariants"] = False
    for first in range(0, request.count, _SCANNED):
        part = request.part(first, min(first + _SCANNED, request.count), [])
        found = model.sweep(part.t_span, part.initial, part.parameters, inputs=part.inputs, **plain)
        able = np.flatnonzero(~np.isin(found.status, (Status.INITIAL_STATE, Status.ASSUMPTION)))
        if len(able):
            lead.append(first + int(able[0]))
            break
    if model.stages.reduced.pivots and _lost(model, request, 0, 1)[0]:
        for first in range(0, request.count, _SCANNED):
            kept = np.flatnonzero(~_lost(model, request, first, min(first + _SCANNED, request.count)))
            if len(kept):
                lead.append(first + int(kept[0]))
                break
    return list(dict.fromkeys(lead))


def _lost(model: CompiledModel, request: Request, first: int, last: int) -> NDArray[np.bool_]:
    """Return at which of some cases a pivot of the constraints vanishes."""
    part = request.part(first, last, [])
    cases = Cases(model.stages.program, model.derived.start, part.t_span, part.initial, part.parameters)
    return np.broadcast_to(cases.lost_pivots(slice(0, cases.count)), last - first)


def _method(model: CompiledModel, request: Request, options: Mapping[str, Any]) -> str:
    """Return the method that a sweep of all cases takes: "auto" looks at the first, the middle and the last."""
    if options["method"] != "auto":
        return str(options["method"])
    few = [0, request.count // 2]
    part = request.part(request.count - 1, request.count, few)
    return str(model.sweep(part.t_span, part.initial, part.parameters, inputs=part.inputs, **options).stats.method)


def _results(model: CompiledModel, part: Part, options: Mapping[str, Any]) -> xarray.Dataset:
    """Return the results of a part, without its leaders."""
    sweep = model.sweep(part.t_span, part.initial, part.parameters, inputs=part.inputs, **options)
    found = sweep.to_xarray()
    if options["error_estimate"]:
        for name in (*model.layout.coordinates, *model.layout.rates):
            found[f"{name}_error"] = (found[name].dims, sweep.error_estimate[name])
    return found.isel(case=slice(part.leaders, None))


def _columns(results: xarray.Dataset, request: Request) -> Columns:
    """Return the arrays over the cases, results and what was varied; the values of axes are kept once, elsewhere."""
    columns = {str(name): np.asarray(v) for name, v in results.variables.items() if v.dims[:1] == ("case",)}
    for axis in () if request.cases is None else request.cases.axes:
        given = columns.pop(f"{axis}_given", None)
        values = columns.pop(axis)
        if given is not None:
            columns[f"{axis}_value"] = values
    return columns


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


def _attributes(
    model: CompiledModel, request: Request, options: Mapping[str, Any], pilot: xarray.Dataset
) -> dict[str, Any]:
    """Return what the store says of itself."""
    parts = {
        "scene": blake2b(str(model.stages.program).encode(), digest_size=16).hexdigest(),
        "cases": request.digest(),
        "options": repr(
            sorted((name, _plain(v)) for name, v in options.items() if name not in ("threads", "progress"))
        ),
    }
    whole_digest = blake2b(json.dumps([*parts.values(), __version__]).encode(), digest_size=16).hexdigest()
    known = {name: pilot.attrs[name] for name in ("scene", "formulation", "method", "parameters", "dalembert_version")}
    tolerances = {"rtol": options["rtol"], "atol": options["atol"]}
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
    model: CompiledModel,
    job: _Job,
    request: Request,
    store: Store,
    missing: list[int],
    leaders: list[int],
    where: StoreOptions,
) -> None:
    """Compute chunks and write them.

    Raises
    ------
    StoredSweepError
        Where some could not be computed.
    """
    parts = ((k, _part(request, store, k, leaders)) for k in missing)
    failed: dict[int, str] = {}
    with _meter(store.count, store.count - len(missing), where.progress) as advance:
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
    first = chunk * store.rows * request.row
    return request.part(first, min(first + store.rows * request.row, request.count), leaders)


def _outcomes(
    model: CompiledModel, job: _Job, request: Request, store: Store, parts: Iterator[tuple[int, Part]], client: Any
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
    try:
        run()
    except (MemoryError, OSError) as reason:
        return _said(reason)
    return ""


def _said(reason: BaseException | None) -> str:
    return f"{type(reason).__name__}: {reason}"


def _write(
    model: CompiledModel, options: Mapping[str, Any], request: Request, store: Store, chunk: int, part: Part
) -> None:
    store.write(chunk, request, _columns(_results(model, part, options), request))


def _remote(job: _Job, request: Request, where: Any, chunk: int, part: Part) -> None:
    """Compute a chunk in a process of a cluster."""
    if target().key != job.target:
        raise StoredSweepError(
            f"this worker has the instruction set {target().key!r}, and the sweep was begun for {job.target!r}; set"
            " DALEMBERT_TARGET to a common one on all machines"
        )
    store = Store.open(where)
    assert store is not None
    _write(_model_of(job.model), {**job.options, "threads": 1}, request, store, chunk, part)


@lru_cache(maxsize=4)
def _model_of(text: bytes) -> CompiledModel:
    """Return a model that was sent to this process, compiled once."""
    found: CompiledModel = pickle.loads(text)
    return found


def _meter(count: int, done: int, progress: bool) -> Any:
    """Return a bar with the chunks that are done, or nothing that looks like it."""
    from ..case_blocks import meter

    return meter(count - done, progress)
