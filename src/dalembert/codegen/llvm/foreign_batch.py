"""Runs that XLA calls: a handler in machine code, which runs cases in lanes, in threads of XLA's own pool.

A single run is a batch of one case, in one lane.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ...frozen import frozen
from ...lanes.row_steps import no_row_steps
from ...lanes.sweep_arguments import (
    CaseRows,
    CaseShape,
    Columns,
    KeptStarts,
    SweepArguments,
    SweepKernels,
    no_part_samples,
)
from ...lanes.workspace import LaneNumbers, LaneState, lane_state, no_event_workspace, no_events
from ...loops.foreign_batch_loop import HEAD, BatchArguments, BatchCode, PoolFunctions, TaskSlots, task_slots
from ...once import once
from ...stops.stops import no_stops
from ...subset.arguments import AddressTable, OwnedAddress, place_of
from ...subset.packing import pack
from ..rendering import render
from .assembly import compile_object, load_object
from .loops import compiled_entry

_WORD, _LINE = 8, 8
_SLOTS = 64
"""Calls that may have threads at once; others run their cases alone."""


@final
@frozen(eq=False)
class ForeignCode:
    """A handler of XLA's interface for foreign functions.

    Attributes
    ----------
    address : OwnedAddress
        The handler.
    memory : int
        Length of the last result for each thread; 0 where there is none.
    held : tuple
        The arguments that it has copied, and the code that it calls.
    """

    address: OwnedAddress
    memory: int
    held: tuple[Any, ...]


@final
@frozen
class Interface:
    """XLA's interface for foreign functions.

    Attributes
    ----------
    version : (int, int)
        Major and minor.
    places : mapping of str to int
        Words before each of its functions; without those that start threads a batch has one.
    """

    version: tuple[int, int]
    places: Mapping[str, int]

    @property
    def pool(self) -> PoolFunctions:
        """The functions that start threads."""
        names = "ThreadPool_NumThreads", "ThreadPool_Schedule", "Error_Destroy"
        known = all(name in self.places for name in names)
        return PoolFunctions(*(self.places[name] if known else 0 for name in names))


@final
@frozen
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
    its results those of `dalembert.lanes.sweep_arguments`: last states, ends and, if any, records; and, of more
    than one lane, memory for each thread. Limits are the largest step, the number of attempts, and what a step reads
    behind the largest step and the direction of time.

    Parameters
    ----------
    kernels : SweepKernels
        Without those that make cases.
    recorded : bool
        Whether steps are recorded.
    """
    projected = bool(kernels.position or kernels.velocity)
    entry = compiled_entry("recorded_lane_loop" if recorded else "projected_lane_loop" if projected else "lane_loop")
    code = BatchCode(entry, compiled_entry("foreign_task"), *_sleep())
    arguments = batch_arguments(kernels, sizes, interface, code)
    called = compiled_entry("foreign_batch_loop")
    text, memory = batch_assembly(arguments, recorded, interface, called)
    return ForeignCode(load_object(compile_object(text)).address("handler"), memory, (arguments, called))


@once
def _slots() -> TaskSlots:
    """Return the slots of all batches, for the life of the process."""
    return task_slots(_SLOTS)


def _sleep() -> tuple[OwnedAddress, int]:
    """Return the address of a C function that lets other threads run, and its argument."""
    library, name, pause = ("kernel32", "Sleep", 0) if os.name == "nt" else (None, "usleep", 20)
    function = getattr(ctypes.CDLL(library), name)
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert address is not None
    return OwnedAddress(address, function), pause


def batch_arguments(kernels: SweepKernels, sizes: BatchSizes, interface: Interface, code: BatchCode) -> BatchArguments:
    """Return the arguments of a batch; what is not given here lies in buffers of the call."""
    sweep, none = sweep_arguments(kernels, sizes), np.zeros(0, np.int64)
    arrays, size = _own_arrays(sweep.state, len(pack(sweep)))
    memory = np.zeros((0, size), np.int64)
    return BatchArguments(none, 0, interface.pool, code, _slots(), memory, none, arrays, sweep)


def sweep_arguments(kernels: SweepKernels, sizes: BatchSizes) -> SweepArguments:
    """Return the arguments of the loop over lanes; what its arrays hold lies in buffers of the call."""
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
        kept=KeptStarts(none, none),
        state=lane_state(lanes, n, sizes.n_c, sizes.n_s, rows, 0, n + rows),
        events=no_events(),
        workspace=no_event_workspace(),
        happened=none,
        totals=none,
        stops=no_stops(),
        steps=none,
        rows=CaseRows(none, none, none, none),
        part=no_part_samples(),
        implicit=no_row_steps(),
    )


def batch_assembly(arguments: BatchArguments, recorded: bool, interface: Interface, entry: int) -> tuple[str, int]:
    """Return a handler in assembly that calls the code at an address, and the words of memory that a thread is given.

    A single lane has its memory on the stack: XLA takes functions with arrays of more than 512 bytes for long ones, and
    leaves them to other threads, which takes some ten microseconds.
    """
    words, sweep, size = pack(arguments), place_of(BatchArguments, "sweep"), arguments.memory.shape[1]
    words[place_of(BatchArguments, "words") + 1] = len(words) - sweep
    memory, alone = place_of(BatchArguments, "memory"), arguments.sweep.state.clock.shape[1] == 1
    words[memory + 1 : memory + 3] = 1, size
    in_result = _buffer("memory", "results", 3 if recorded else 2, [memory], [memory + 1, memory + 2])
    variables = {
        "words": words.tolist(),
        "count": len(words),
        "size": _WORD * len(words),
        "version": {"major": interface.version[0], "minor": interface.version[1]},
        "buffers": [
            _rows("times", "given", 0, "rows.times"),
            _rows("start", "given", 1, "rows.states"),
            _rows("constants", "given", 2, "rows.constants"),
            _rows("end", "results", 0, "out"),
            _rows("numbers", "results", 1, "ends"),
            _rows("limits", "given", 3, "limits"),
            *([_rows("rows", "results", 2, "rows.record")] if recorded else []),
            *([] if alone else [in_result]),
        ],
        "stack": size if alone else 0,
        "memory": memory,
        "table": place_of(BatchArguments, "table"),
        "context": place_of(BatchArguments, "context"),
        "own": place_of(BatchArguments, "words"),
        "sweep": sweep,
        "entry": entry,
    }
    return render("llvm/foreign_batch_handler.ll.j2", variables), 0 if alone else size


def _own_arrays(state: LaneState, words: int) -> tuple[NDArray[np.int64], int]:
    """Return the words that are addresses of a thread's own arrays, with their places in its memory, and its size."""
    found, used = [], _to_line(HEAD + words)
    for field in LaneState._fields:
        value: Any = getattr(state, field)
        parts = zip(LaneNumbers._fields, value, strict=True) if field == "numbers" else [("", value)]
        for name, array in parts:
            found.append((place_of(SweepArguments, f"state.{field}.{name}".rstrip(".")), used))
            used += _to_line(len(array.words) if field == "progress" else array.size)
    return np.array(found), used


def _to_line(words: int) -> int:
    return -(-words // _LINE) * _LINE


def _rows(name: str, side: str, number: int, field: str) -> dict[str, Any]:
    """Return the template's variables of a buffer that is a matrix among the arguments."""
    place = place_of(BatchArguments, f"sweep.{field}")
    return _buffer(name, side, number, [place], [place + 1, place + 2])


def _buffer(name: str, side: str, number: int, words: Sequence[int], lengths: Sequence[int]) -> dict[str, Any]:
    """Return the template's variables of a buffer: the places of its address and of its lengths."""
    return {
        "name": name,
        "side": side,
        "number": number,
        "parts": [{"word": word, "offset": 0} for word in words],
        "lengths": lengths,
    }
