"""A batch of cases that XLA calls: division among threads of its pool, and the wait for those at work."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..lanes.sweep_arguments import SweepArguments
from ..subset.arguments import Address, IntMatrix, IntVector, place_of
from ..subset.compiled_subset import call_c, call_test, compiled_subset, row, take
from ..subset.packing import pack

# Threads of XLA's pool that run cases of a batch: what a call and its threads share, and what a thread does.
#
# A thread that comes when the others have done all cases touches nothing but its slot, which outlives the call. So no
# call waits for threads that have not begun, and calls on all threads of the pool do not wait for each other.

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
def TASK_LOOP(task: BatchTask) -> int:
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


HEAD = 16
"""Words before the arguments in the memory of a thread. In that of the first are the arguments of XLA's functions, and
in another cache line the count of cases that have begun."""

_TURN = 8
_FOUND = 7
_LARGEST_SHARE, _SHARES_PER_THREAD = 64, 64
_LOOKS = 1000
"""Number of looks at whether other threads have ended, after which a call sleeps between them."""

_CASES, _SHARE = place_of(SweepArguments, "shape.cases"), place_of(SweepArguments, "shape.share")
_TURN_WORD = place_of(SweepArguments, "turn")


class PoolFunctions(NamedTuple):
    """Places of XLA's functions in its table: number of threads, start of one, end of errors; 0 for none."""

    threads: int
    schedule: int
    destroy: int


class BatchCode(NamedTuple):
    """Addresses of the loop over lanes, of the loop of tasks, and of a C function that sleeps, with its argument."""

    loop: Address
    task: Address
    sleep: Address
    pause: int


class BatchArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    table : (n_functions,)
        Addresses of XLA's functions.
    context : int
        What they ask for.
    memory : (threads, n)
        For each thread that may run: `HEAD` words, arguments of the loop over lanes, and the arrays in these.
    words : (n_words,)
        These arguments, without what follows here, as `dalembert.subset.packing.pack` has them.
    arrays : (k, 2)
        Places among the words that are addresses of arrays of a thread, and where these lie in its memory.
    sweep : SweepArguments
        The arguments again.
    """

    table: IntVector
    context: int
    functions: PoolFunctions
    code: BatchCode
    slots: TaskSlots
    memory: IntMatrix
    words: IntVector
    arrays: IntMatrix
    sweep: SweepArguments


@compiled_subset
def LOOP(arguments: BatchArguments) -> int:
    """Run all cases, in as many threads as the pool lends; return when none is at work any more."""
    code, slots, memory = arguments.code, arguments.slots, arguments.memory
    threads, none = _threads(arguments), slots.tasks.shape[0]
    slot = reserve(slots) if threads > 1 else none
    if slot == none:
        threads = 1
    last = _write_words(arguments, threads)
    if slot != none:
        allot(slots, slot, code.loop, memory, HEAD, last)
        for _ in range(1, threads):
            _schedule(arguments, slot)
    run_cases(memory, 0, HEAD, last, code.loop)
    if slot != none:
        _close(arguments, slot)
    return 0


@compiled_subset
def _threads(arguments: BatchArguments) -> int:
    """Return the number of threads: as many as have memory, and no more than the pool has."""
    memory, place = arguments.memory, arguments.functions.threads
    if memory.shape[0] < 2 or place == 0:
        return 1
    memory[0, 0], memory[0, 1], memory[0, 2] = 32, 0, arguments.context
    memory[0, 3], memory[0, _FOUND] = row(memory, 0) + 8 * _FOUND, 0
    if _fails(arguments, place):
        return 1
    return max(1, min(memory[0, _FOUND], memory.shape[0]))


@compiled_subset
def _fails(arguments: BatchArguments, place: int) -> bool:
    """Call a function of XLA with the arguments at the beginning of the memory; return whether it rejected."""
    memory = arguments.memory
    error = call_c(arguments.table[place], row(memory, 0))
    if error != 0:
        memory[0, 0], memory[0, 1], memory[0, 2] = 24, 0, error
        call_c(arguments.table[arguments.functions.destroy], row(memory, 0))
    return error != 0


@compiled_subset
def _write_words(arguments: BatchArguments, threads: int) -> int:
    """Write the arguments of the loop over lanes for each thread; return where in the memory they end."""
    memory, words, arrays, cases = arguments.memory, arguments.words, arguments.arrays, arguments.sweep.out.shape[0]
    memory[0, _TURN] = 0
    for thread in range(threads):
        for place in range(words.size):
            memory[thread, HEAD + place] = words[place]
        for k in range(arrays.shape[0]):
            memory[thread, HEAD + arrays[k, 0]] = row(memory, thread) + 8 * arrays[k, 1]
        memory[thread, HEAD + _CASES] = cases
        memory[thread, HEAD + _SHARE] = max(1, min(cases // (threads * _SHARES_PER_THREAD), _LARGEST_SHARE))
        memory[thread, HEAD + _TURN_WORD] = row(memory, 0) + 8 * _TURN
    return HEAD + words.size


@compiled_subset
def _schedule(arguments: BatchArguments, slot: int) -> None:
    """Let a thread of the pool work, too, if the pool takes it."""
    memory, slots = arguments.memory, arguments.slots
    references = slots.counts[COUNTS * slot + REFERENCES]
    memory[0, 0], memory[0, 1], memory[0, 2] = 40, 0, arguments.context
    memory[0, 3], memory[0, 4] = arguments.code.task, row(slots.tasks, slot)
    take(references, 1)
    if _fails(arguments, arguments.functions.schedule):
        take(references, -1)


@compiled_subset
def _close(arguments: BatchArguments, slot: int) -> None:
    """Wait for the threads at work; others that come later find the slot closed."""
    counts, code, looks = arguments.slots.counts, arguments.code, 0
    working = counts[COUNTS * slot + WORKING]
    take(working, CLOSED)
    while take(working, 0) > CLOSED:
        looks += 1
        if looks > _LOOKS:
            call_c(code.sleep, code.pause)
    take(counts[COUNTS * slot + REFERENCES], -1)
