"""Batches that XLA calls: a handler in machine code, which runs cases in lanes, in threads of XLA's own pool.

A thread that comes when the others have done all cases touches nothing but what they share, which the last to let go of
it frees: so no call waits for threads that have not begun, and calls on all threads of the pool do not wait for each
other.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from ...integrators.addresses import AddressTable
from ...integrators.arguments import pack, place_of
from ...integrators.input_steps import no_inputs
from ...integrators.sweep_arguments import CaseRows, CaseShape, Columns, SweepArguments, SweepKernels
from ...integrators.workspace import LaneNumbers, LaneState, lane_state, no_event_workspace, no_events
from ..rendering import render
from .assembly import compile_object, load_object
from .foreign import ForeignCode, buffer
from .loops import compiled_entry

__all__ = ["BatchSizes", "Interface", "batch_arguments", "batch_assembly", "foreign_batch"]

_WORD, _LINE = 8, 64
_LARGEST_SHARE, _SHARES_PER_THREAD = 64, 64
_CLOSED = 1 << 32
_ROUNDS = 1000
"""Number of looks at whether other threads have ended, after which a call sleeps between them."""

_THREADING = {"schedule": "ThreadPool_Schedule", "threads": "ThreadPool_NumThreads", "destroy": "Error_Destroy"}
"""Functions of XLA's interface by which threads are started."""

_WAIT = {"name": "Sleep", "argument": 0} if os.name == "nt" else {"name": "usleep", "argument": 20}


@final
@dataclass(frozen=True)
class Interface:
    """XLA's interface for foreign functions.

    Attributes
    ----------
    version : (int, int)
        Major and minor.
    places : mapping of str to int
        Bytes before each of its functions; without those that start threads a batch has one.
    """

    version: tuple[int, int]
    places: Mapping[str, int]


@final
@dataclass(frozen=True)
class BatchSizes:
    """Lanes, and numbers of components of the state, of constants, of what a step remembers, and of limits."""

    lanes: int
    n: int
    n_c: int
    memory: int
    n_s: int


def foreign_batch(kernels: SweepKernels, sizes: BatchSizes, recorded: bool, interface: Interface) -> ForeignCode:
    """Return the handler of batches by the same steps.

    Its arguments are rows of times, first states and constants, one for each case or one for all, and one of limits;
    its results those of `dalembert.integrators.sweep_arguments`: last states, ends and, if any, records, and memory
    for each thread. Limits are the largest step, the number of attempts, and what a step reads behind the largest step
    and the direction of time.

    Parameters
    ----------
    kernels : SweepKernels
        Without those that make cases.
    recorded : bool
        Whether steps are recorded.
    """
    projected = bool(kernels.position or kernels.velocity)
    entry = compiled_entry("recorded_lane_loop" if recorded else "projected_lane_loop" if projected else "lane_loop")
    arguments = batch_arguments(kernels, sizes)
    text, memory = batch_assembly(arguments, recorded, interface, entry)
    return ForeignCode(load_object(compile_object(text)).address("handler"), memory, (arguments, entry))


def batch_arguments(kernels: SweepKernels, sizes: BatchSizes) -> SweepArguments:
    """Return the arguments of the loop; what its arrays hold lies in buffers of the call."""
    lanes, n, rows = sizes.lanes, sizes.n, sizes.n + 2 + sizes.memory
    none, nothing = np.zeros((0, 0)), np.zeros(0, np.int64)
    return SweepArguments(
        kernels=kernels,
        shape=CaseShape(n, 0, 0, sizes.memory, 0, 0, 0, 0, 0),
        limits=none,
        columns=Columns(AddressTable(), nothing),
        turn=np.zeros(1, np.int64),
        t_eval=np.zeros(0),
        out=np.zeros((1, n)),
        ends=np.zeros((1, 5)),
        samples=none,
        inside=np.zeros((0, 0), np.bool_),
        kept_constants=none,
        state=lane_state(lanes, n, sizes.n_c, sizes.n_s, rows, 0, n + rows),
        events=no_events(),
        workspace=no_event_workspace(),
        happened=none,
        totals=none,
        inputs=no_inputs(),
        steps=none,
        rows=CaseRows(none, none, none, none),
    )


def batch_assembly(arguments: SweepArguments, recorded: bool, interface: Interface, entry: int) -> tuple[str, int]:
    """Return a handler in assembly that calls the loop at an address, and how many doubles a thread needs."""
    words = pack(arguments).tolist()
    parts, used = _thread_parts(arguments.state)
    size = _WORD * len(words)
    thread_size = _to_line(used + size) + _LINE
    variables = {
        "words": words,
        "count": len(words),
        "size": size,
        "version": {"major": interface.version[0], "minor": interface.version[1]},
        "buffers": [
            _rows("times", "given", 0, "rows.times"),
            _rows("start", "given", 1, "rows.states"),
            _rows("constants", "given", 2, "rows.constants"),
            _rows("end", "results", 0, "out"),
            _rows("numbers", "results", 1, "ends"),
            _rows("limits", "given", 3, "limits"),
            *([_rows("rows", "results", 2, "rows.record")] if recorded else []),
            buffer("memory", "results", 3 if recorded else 2, [], []),
        ],
        "thread_parts": parts,
        "thread_size": thread_size,
        "arguments_offset": used,
        "cases": _place("shape.cases"),
        "share": _place("shape.share"),
        "turn": _place("turn"),
        "shares": _SHARES_PER_THREAD,
        "largest_share": _LARGEST_SHARE,
        "closed": _CLOSED,
        "rounds": _ROUNDS,
        "wait": _WAIT,
        "pooled": all(name in interface.places for name in _THREADING.values()),
        "api": {key: interface.places.get(name, 0) for key, name in _THREADING.items()},
        "entry": entry,
    }
    return render("llvm/foreign_batch_handler.ll.j2", variables), thread_size // _WORD


def _thread_parts(state: LaneState) -> tuple[list[dict[str, int]], int]:
    """Return the offsets [bytes] of the arrays of a thread in its memory, and the size of all of them."""
    arrays: dict[str, int] = {}
    for field in LaneState._fields:
        value: Any = getattr(state, field)
        if field == "numbers":
            arrays |= {f"numbers.{name}": row.size for name, row in zip(LaneNumbers._fields, value, strict=True)}
        else:
            arrays[field] = len(value.words) if field == "progress" else value.size
    parts, used = [], 0
    for name, size in arrays.items():
        parts.append({"word": _place(f"state.{name}"), "offset": used})
        used += _to_line(_WORD * size)
    return parts, used


def _to_line(size: int) -> int:
    return -(-size // _LINE) * _LINE


def _place(field: str) -> int:
    return place_of(SweepArguments, field)


def _rows(name: str, side: str, number: int, field: str) -> dict[str, Any]:
    """Return the template's variables of a buffer that is a matrix among the arguments."""
    place = _place(field)
    return buffer(name, side, number, [place], [place + 1, place + 2])
