"""Threads: what is kept is made once, and everything public may be used by several at the same time."""

import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.runs import CaseRun
from dalembert.methods.status import Status
from dalembert.once import BoundedTable, computed_once, derived_once, once, once_property
from dalembert.runs.case_blocks import run_shared
from dalembert.threads import STOPPED
from fuzz.cold_threads import round_of

START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1.0, "b": 0.3, "I_C": 0.5}


def together(work, count=8):
    """Call ``work(number)`` in threads that begin together; return what came out."""
    barrier, found, broken = threading.Barrier(count), [None] * count, []

    def run(number):
        barrier.wait()
        try:
            found[number] = work(number)
        except BaseException as failure:
            broken.append(failure)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not broken, broken
    return found


class Loaded:
    """Stands for loaded machine code."""


def slow():
    time.sleep(0.02)
    return Loaded()


class Holder:
    @once_property
    def value(self):
        """What is loaded."""
        return slow()


@once
def named(name):
    return slow()


def test_a_default_counts_as_given():
    @once
    def made(name: str, lanes: int = 1) -> list[object]:
        return [name, lanes]

    assert made("loop") is made("loop", 1)
    assert made("loop", 2) == ["loop", 2]


@pytest.mark.parametrize("ask", [computed_once, derived_once])
def test_tables_hold_one_value_for_all_threads(ask):
    table = {}
    assert len(set(together(lambda _: ask(table, "a", slow)))) == 1
    assert set(table) == {"a"}


def test_bounded_tables_keep_what_was_used_last():
    table = BoundedTable(2)
    first, second = (computed_once(table, name, Loaded) for name in "ab")
    assert computed_once(table, "a", Loaded) is first
    assert computed_once(table, "c", Loaded) is not None  # in place of what was used longest ago
    assert list(table) == ["a", "c"]
    assert computed_once(table, "b", Loaded) is not second
    assert table.get("a", 7) == 7


def test_bounded_tables_may_be_shared_by_threads():
    table = BoundedTable(3)

    def work(number):
        for k in range(2000):
            assert computed_once(table, (number + k) % 7, lambda k=k: (number + k) % 7) == (number + k) % 7

    together(work)
    assert len(table) <= 3


def test_properties_and_functions_have_one_value_for_all_threads():
    holder = Holder()
    assert len(set(together(lambda _, of=holder: of.value))) == 1
    assert holder.__dict__ == {"value": holder.value}
    found = together(lambda number: named(number % 2))
    assert len(set(found)) == 2 and named(0) is found[0]
    named.cache_clear()
    assert named(0) is not found[0]
    kept = weakref.ref(holder.value)
    del holder
    assert kept() is None  # nothing else keeps it


def test_different_values_are_computed_at_the_same_time():
    """Each waits for the other, which a single lock would not allow."""
    table, met = {}, threading.Barrier(2, timeout=20)
    together(lambda number: computed_once(table, number, met.wait), 2)
    assert len(table) == 2


def test_what_fails_is_asked_for_again_and_what_asks_for_itself_is_no_deadlock():
    table, tries = {}, []

    def failing():
        tries.append(1)
        if len(tries) < 3:
            raise ValueError("not yet")
        return 7

    for _ in range(2):
        with pytest.raises(ValueError, match="not yet"):
            computed_once(table, "a", failing)
    assert computed_once(table, "a", failing) == 7
    with pytest.raises(RecursionError):
        computed_once(table, "b", lambda: computed_once(table, "b", failing) if len(tries) > 5 else _recursive(table))


def _recursive(table):
    return computed_once(table, "b", lambda: _recursive(table))


@pytest.mark.parametrize(
    ("kind", "installed"), [("sweep", False), ("shared", False), ("contacts", False), ("contacts", True)]
)
def test_first_use_of_a_process_by_eight_threads(kind, installed):
    """Was a segmentation fault: the code of the thread that came second was unloaded while its address was in use."""
    assert round_of(kind, 1, installed) == ""


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_threads_may_share_a_prepared_run(method):
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    run, p = model.prepare((0, 1), method=method), model.parameter_vector(P)
    states = [model.state(START | {"theta_dot": 1.0 + i}, P) for i in range(8)]
    expected = [run(state, p).tobytes() for state in states]
    count = 300 if method != "radau" else 5

    def work(number):
        return {run(states[number], p).tobytes() for _ in range(count)}

    assert together(work) == [{result} for result in expected]


def test_the_status_of_a_prepared_run_is_that_of_the_thread():
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    run, p = model.prepare((0, 1)), model.parameter_vector(P)
    good, bad = model.state(START, P), np.full(len(model.layout.state), np.nan)

    def work(number):
        seen = set()
        for _ in range(200):
            run(bad if number % 2 else good, p)
            seen.add(run.status)
        return seen

    assert together(work) == [{Status.SUCCESS}, {Status.NON_FINITE}] * 4


def test_sweeps_of_different_threads_run_at_the_same_time():
    meeting = threading.Barrier(3)

    def meet(paused=None):
        meeting.wait(30)

    runs = [CaseRun(meet, np.zeros(1, np.int64), lambda: None) for _ in range(3)]
    with ThreadPoolExecutor(3) as pool:  # a broken barrier is raised by the first
        assert all(pool.map(lambda run: run_shared(run, 10_000, 1, False), runs))


def shared_by(work, threads, progress=False):
    """Return how many threads a run takes that calls ``work(paused)`` in each, and the names of these threads."""
    names, ended = [], []

    def named(paused=None):
        names.append(threading.current_thread().name)
        work(paused)

    assert run_shared(CaseRun(named, np.zeros(1, np.int64), lambda: ended.append(1)), 10, threads, progress)
    assert ended == [1]
    return names


def test_few_cases_wait_for_no_other_thread():
    """Starting another and waiting for it took longer than a hundred cases."""
    here = threading.current_thread().name
    assert shared_by(lambda paused: None, 8) == [here]
    long = shared_by(lambda paused: (paused and paused(), time.sleep(0.2)), 3)
    assert long[0] == here and len(long) == 3 and here not in long[1:]
    assert here not in shared_by(lambda paused: None, 2, progress=True)


def test_a_failure_of_this_thread_ends_the_others():
    stopped, turn = [], np.zeros(1, np.int64)

    def work(paused=None):
        if paused is not None:
            paused()
            time.sleep(0.1)
            raise ValueError("no")
        while turn[0] < STOPPED:
            time.sleep(0.01)
        stopped.append(1)

    with pytest.raises(ValueError, match="no"):
        run_shared(CaseRun(work, turn, lambda: None), 10, 2, False)
    assert stopped == [1]
