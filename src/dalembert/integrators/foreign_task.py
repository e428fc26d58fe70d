"""Threads of XLA's pool that run cases of a batch: what a call and its threads share, and what a thread does.

A thread that comes when the others have done all cases touches nothing but its slot, which outlives the call. So no
call waits for threads that have not begun, and calls on all threads of the pool do not wait for each other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arguments import IntMatrix, pack, place_of
from .compiled_subset import call_test, compiled_subset, row, take

__all__ = [
    "BEGUN",
    "CLOSED",
    "COUNTS",
    "LOOP",
    "REFERENCES",
    "WORKING",
    "BatchTask",
    "TaskSlots",
    "allot",
    "reserve",
    "run_cases",
    "task_slots",
]

REFERENCES, WORKING, BEGUN = range(3)
"""Rows of the counts of a slot: threads that still refer to it, threads at work, and threads that have begun."""

COUNTS = 3
CLOSED = 1 << 32
"""Count of threads at work from which no other begins."""

_LINE = 8


class BatchTask(NamedTuple):
    """The task of a thread of the pool.

    Attributes
    ----------
    counts : (COUNTS, 8)
        In a cache line each.
    loop : int
        Address of the loop over lanes.
    memory : (threads, n)
        The memory of each thread, of which the loop's arguments take the words from ``first`` up to ``last``.
    """

    counts: IntMatrix
    loop: int
    memory: IntMatrix
    first: int
    last: int


class TaskSlots(NamedTuple):
    """Slots for calls that have threads: the counts of each, one below the other, and the words of its `BatchTask`."""

    counts: IntMatrix
    tasks: IntMatrix


_LOOP, _MEMORY = place_of(BatchTask, "loop"), place_of(BatchTask, "memory")
_FIRST, _LAST = place_of(BatchTask, "first"), place_of(BatchTask, "last")


def task_slots(number: int) -> TaskSlots:
    """Return slots that nobody refers to; they must live as long as the pool has tasks."""
    counts, none = np.zeros((COUNTS * number, _LINE), np.int64), np.zeros((0, 0), np.int64)
    rows = [counts[COUNTS * slot : COUNTS * (slot + 1)] for slot in range(number)]
    return TaskSlots(counts, np.array([pack(BatchTask(own, 0, none, 0, 0)) for own in rows]))


@compiled_subset
def LOOP(task: BatchTask) -> int:
    """Run cases in a thread of the pool, unless the call has ended before it came to that."""
    if take(task.counts[WORKING], 1) < CLOSED:
        run_cases(task.memory, take(task.counts[BEGUN], 1), task.first, task.last, task.loop)
    take(task.counts[WORKING], -1)
    take(task.counts[REFERENCES], -1)
    return 0


@compiled_subset
def run_cases(memory: IntMatrix, number: int, first: int, last: int, loop: int) -> None:
    """Run cases until none is left, in the memory of the thread of a number."""
    for place in range(last, memory.shape[1]):
        memory[number, place] = 0
    call_test(loop, row(memory, number) + 8 * first, 0, 0, 0, 0)


@compiled_subset
def reserve(slots: TaskSlots) -> int:
    """Return the number of a slot that nobody referred to; as many as there are where each is in use."""
    for slot in range(slots.tasks.shape[0]):
        if take(slots.counts[COUNTS * slot + REFERENCES], 1) == 0:
            return slot
        take(slots.counts[COUNTS * slot + REFERENCES], -1)
    return slots.tasks.shape[0]


@compiled_subset
def allot(slots: TaskSlots, slot: int, loop: int, memory: IntMatrix, first: int, last: int) -> None:
    """Write the task of a call into the slot that it has reserved; the calling thread has begun."""
    counts, tasks = slots.counts, slots.tasks
    counts[COUNTS * slot + WORKING, 0], counts[COUNTS * slot + BEGUN, 0] = 0, 1
    tasks[slot, _LOOP], tasks[slot, _FIRST], tasks[slot, _LAST] = loop, first, last
    tasks[slot, _MEMORY] = row(memory, 0)
    tasks[slot, _MEMORY + 1], tasks[slot, _MEMORY + 2] = memory.shape[0], memory.shape[1]
