"""Batches that XLA calls, with a pool of threads in place of XLA's."""

import ctypes
from threading import Thread

import numpy as np
import pytest

from dalembert.codegen.llvm import foreign_batch
from dalembert.codegen.llvm.foreign_batch import BatchSizes, Interface, batch_arguments, sweep_arguments
from dalembert.codegen.llvm.loops import Loop
from dalembert.lanes.sweep_arguments import SweepArguments, SweepKernels
from dalembert.loops.foreign_batch_loop import HEAD, BatchCode, task_slots
from dalembert.subset.arguments import NO_CODE, OwnedAddress
from dalembert.subset.packing import pack, unpack

CASES, N, CONTEXT, ERROR = 1000, 2, 77, 99
PLACES = {"ThreadPool_NumThreads": 0, "Error_Destroy": 1, "ThreadPool_Schedule": 2}


def address_of(function, *arguments):
    code = ctypes.CFUNCTYPE(ctypes.c_int64, *arguments)(function)
    return OwnedAddress(ctypes.cast(code, ctypes.c_void_p).value, code)


def words_at(address, count):
    return np.ctypeslib.as_array((ctypes.c_int64 * count).from_address(int(address)))


class Pool:
    """XLA's functions; `begins` is called with each task that is to run."""

    def __init__(self, run, threads=4, begins=Thread.start, refused=()):
        self.run, self.threads, self.begins, self.refused = run, threads, begins, refused
        self.tasks, self.destroyed, self.slept = [], 0, 0
        self.functions = [address_of(f, ctypes.c_int64) for f in (self.count, self.destroy, self.schedule, self.sleep)]

    def count(self, address):
        size, extension, context, found = words_at(address, 4)
        assert (size, extension, context) == (32, 0, CONTEXT)
        words_at(found, 1)[0] = self.threads
        return ERROR if "count" in self.refused else 0

    def schedule(self, address):
        size, extension, context, _, data = words_at(address, 5)
        assert (size, extension, context) == (40, 0, CONTEXT)
        if "schedule" in self.refused:
            return ERROR
        self.tasks.append(Thread(target=self.run, args=(int(data),)))
        self.begins(self.tasks[-1])
        return 0

    def destroy(self, address):
        size, extension, error = words_at(address, 3)
        assert (size, extension, error) == (24, 0, ERROR)
        self.destroyed += 1
        return 0

    def sleep(self, pause):
        assert pause == 5
        self.slept += 1
        return 0


@pytest.fixture(params=[False, True], ids=["compiled", "plain"])
def batch(request, monkeypatch):
    """Return a function that runs a batch by a pool, and gives what its threads did."""
    loop, task = Loop("foreign_batch_loop", plain=request.param), Loop("foreign_task", plain=request.param)
    slots, interface = task_slots(2), Interface((0, 3), {name: place + 3 for name, place in PLACES.items()})
    monkeypatch.setattr(foreign_batch, "_slots", lambda: slots)

    def run(memories=4, cases=CASES, **options):
        work, out = [], np.zeros((cases, N))

        def lanes(address, *_):
            sweep = unpack(SweepArguments, words_at(address, len(pack(arguments.sweep))).copy())
            assert not sweep.state.states.any() and not sweep.state.progress.words.any()
            sweep.state.states[...] = sweep.state.progress.rounds = len(work) + 1
            taken = []
            work.append((sweep, taken))
            while (first := sweep.turn[0]) < cases:
                sweep.turn[0] += sweep.shape.share
                taken += range(first, min(first + sweep.shape.share, cases))
            return 0

        pool = Pool(lambda data: task.call(ctypes.c_void_p(data)), **options)
        code = BatchCode(address_of(lanes, *(ctypes.c_int64,) * 5), task.entry, pool.functions.pop(), 5)
        kernels = SweepKernels(*(NO_CODE,) * len(SweepKernels._fields))
        arguments = batch_arguments(kernels, BatchSizes(2, N, 1, 0, 4), interface, code)
        words = pack(sweep_arguments(kernels, BatchSizes(2, N, 1, 0, 4))._replace(out=out))
        memory = np.full((memories, arguments.memory.shape[1]), -1)
        table = np.array([0, 0, 0, *pool.functions])
        arguments = arguments._replace(table=table, context=CONTEXT, memory=memory, words=words)
        loop(arguments._replace(sweep=arguments.sweep._replace(out=out)))
        return pool, work, memory, slots

    return run


def share_of(work):
    return [sweep.shape.share for sweep, _ in work]


def in_use(slots):
    return slots.counts.reshape(-1, 3, 8)[:, 0, 0].tolist()


def test_threads_have_memory_of_their_own_and_share_the_cases(batch):
    pool, work, memory, slots = batch(begins=lambda thread: (thread.start(), thread.join()))
    assert len(pool.tasks) == 3 and len(work) == 4 and share_of(work) == [CASES // (4 * 64)] * 4
    assert sorted(case for _, taken in work for case in taken) == list(range(CASES))
    assert len({sweep.state.states.ctypes.data for sweep, _ in work}) == 4
    assert len({sweep.turn.ctypes.data for sweep, _ in work}) == 1
    assert [sweep.state.progress.rounds for sweep, _ in work] == [1, 2, 3, 4]
    first, last = memory.ctypes.data, memory.ctypes.data + memory.nbytes
    assert all(first + 8 * HEAD < sweep.state.states.ctypes.data < last for sweep, _ in work)
    assert in_use(slots) == [0, 0]


def test_a_call_waits_for_threads_at_work_alone(batch):
    late, _, _, slots = batch(begins=lambda thread: None)
    assert in_use(slots) == [3, 0]
    second, *_ = batch(begins=lambda thread: None)
    assert in_use(slots) == [3, 3]
    alone, work, _, _ = batch(begins=lambda thread: None)
    assert not alone.tasks and share_of(work) == [CASES // 64]  # each slot is in use
    for thread in (*late.tasks, *second.tasks):
        thread.start()
        thread.join()
    assert in_use(slots) == [0, 0]
    again, work, _, _ = batch()
    assert len(again.tasks) == 3
    for thread in again.tasks:
        thread.join()
    assert in_use(slots) == [0, 0] and {case for _, taken in work for case in taken} == set(range(CASES))


@pytest.mark.parametrize(("refused", "errors"), [(("count",), 1), (("schedule",), 3)])
def test_errors_of_the_pool_are_freed_and_the_call_works_alone(batch, refused, errors):
    pool, work, _, slots = batch(refused=refused)
    assert pool.destroyed == errors and len(work) == 1 and len(work[0][1]) == CASES
    assert in_use(slots) == [0, 0]


@pytest.mark.parametrize(("memories", "threads", "cases"), [(1, 4, 10), (4, 0, 10), (4, 1, 0)])
def test_one_thread_has_no_slot(batch, memories, threads, cases):
    pool, work, _, slots = batch(memories, cases, threads=threads)
    assert not pool.tasks and len(work) == 1 and share_of(work) == [1] and not slots.counts.any()
