"""Worker processes that examine random scenes, each replaced when it hangs or dies."""

from __future__ import annotations

import json
import queue
import selectors
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, final

__all__ = ["examine_all"]

LIFE = 150
"""Scenes after which a worker is started anew, for its memory."""


def examine_all(
    module: str,
    tasks: Sequence[str],
    jobs: int,
    limit: Callable[[str], float],
    record: Callable[[str, dict[str, Any]], None],
) -> None:
    """Have tasks, a line of text each, examined by processes of a module, which answer a line of JSON each.

    `limit` gives the seconds of a task, `record` is called with each task and its result, by one thread at a time. A
    task without an answer has the outcome HANG or CRASH.
    """
    waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
    for task in tasks:
        waiting.put(task)
    lock = threading.Lock()

    def serve() -> None:
        worker, age = None, 0
        while True:
            try:
                task = waiting.get_nowait()
            except queue.Empty:
                break
            if worker is None or age >= LIFE:
                _end(worker)
                worker, age = _Worker(module), 0
            age += 1
            row = worker.examine(task, limit(task))
            if row["outcome"] in ("HANG", "CRASH"):
                _end(worker)
                worker = None
            with lock:
                record(task, row)
        _end(worker)

    threads = [threading.Thread(target=serve) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


@final
class _Worker:
    """A process that examines one task after the other."""

    def __init__(self, module: str) -> None:
        command = [sys.executable, "-X", "faulthandler", "-m", module]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self._errors: list[bytes] = []
        assert self._process.stderr is not None
        threading.Thread(target=self._listen, args=(self._process.stderr,), daemon=True).start()

    def _listen(self, pipe: Any) -> None:
        for line in pipe:
            self._errors = [*self._errors[-20:], line]

    def examine(self, task: str, limit: float) -> dict[str, Any]:
        """Return the result of a task, or that the worker hung or died."""
        process, begin = self._process, time.perf_counter()
        assert process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(f"{task}\n".encode())
            process.stdin.flush()
        except BrokenPipeError:
            return {"outcome": "CRASH", "verdict": "the worker died between scenes", "seconds": 0.0}
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            ready = selector.select(limit)
        seconds = round(time.perf_counter() - begin, 1)
        if not ready:
            return {"outcome": "HANG", "verdict": f"no result after {limit:g} s", "seconds": seconds}
        line = process.stdout.readline()
        if not line.endswith(b"\n"):
            code = process.wait()
            last = b"".join(self._errors[-8:]).decode(errors="replace")
            return {"outcome": "CRASH", "verdict": f"exit status {code}: {last}", "seconds": seconds}
        found: dict[str, Any] = json.loads(line)
        return found

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()


def _end(worker: _Worker | None) -> None:
    if worker is not None:
        worker.close()
