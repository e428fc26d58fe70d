"""The machine's peak of double-precision multiply-adds, measured, and the operations of a Taylor step."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable
from functools import cache
from typing import Any

from dalembert.codegen.llvm.assembly import LoadedCode, compile_object, load_object
from dalembert.codegen.llvm.target import fma_name, native_lanes
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import order_at, step_kernel

__all__ = ["flops_of_step", "multiply_adds", "peak_flops"]

_CHAINS, _REPETITIONS = 12, 20_000_000
"""Independent sums, enough to hide the latency of a multiply-add; and turns of the loop."""

_WEIGHTS = {"fma": 2, "sin": 0, "cos": 0}
"""Sines and cosines are left out, so that the share reported is rather too small."""


def _assembly(count: int) -> str:
    lanes, chains = native_lanes(), range(count)
    v, fma = f"<{lanes} x double>", fma_name(lanes)
    one = f"<{', '.join(['double 1.0'] * lanes)}>"
    small = f"<{', '.join(['double 0x3CB0000000000000'] * lanes)}>"
    phis = "\n".join(f"  %a{i} = phi {v} [{one}, %entry], [%b{i}, %loop]" for i in chains)
    steps = "\n".join(f"  %b{i} = call {v} @{fma}({v} %a{i}, {v} {one}, {v} {small})" for i in chains)
    stores = "\n".join(
        f"  %p{i} = getelementptr {v}, ptr %out, i64 {i}\n  store {v} %b{i}, ptr %p{i}, align 8" for i in chains
    )
    return f"""declare {v} @{fma}({v}, {v}, {v})
define void @peak(ptr %out, i64 %n) {{
entry:
  br label %loop
loop:
  %k = phi i64 [0, %entry], [%next, %loop]
{phis}
{steps}
  %next = add i64 %k, 1
  %more = icmp ult i64 %next, %n
  br i1 %more, label %loop, label %done
done:
{stores}
  ret void
}}
"""


@cache
def _code(chains: int) -> LoadedCode:
    return load_object(compile_object(_assembly(chains)))


def multiply_adds(chains: int) -> Callable[[], float]:
    """Return what gives the seconds of a multiply-add of a pack, in so many chains in which each waits for the last."""
    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)(_code(chains).address("peak"))
    room, count = (ctypes.c_double * (chains * native_lanes()))(), 600_000 // chains

    def run() -> float:
        begin = time.thread_time()
        function(ctypes.addressof(room), count)
        return (time.thread_time() - begin) / (count * chains)

    return run


@cache
def peak_flops(threads: int) -> float:
    """Return the largest of three measurements, in operations a second; a multiply-add counts as two."""
    lanes = native_lanes()
    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)(_code(_CHAINS).address("peak"))

    def run() -> None:
        room = (ctypes.c_double * (_CHAINS * lanes))()
        function(ctypes.addressof(room), _REPETITIONS)

    best = 0.0
    for _ in range(3):
        workers = [threading.Thread(target=run) for _ in range(threads)]
        begin = time.perf_counter()
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        best = max(best, threads * 2.0 * lanes * _CHAINS * _REPETITIONS / (time.perf_counter() - begin))
    return best


def flops_of_step(model: Any, rtol: float) -> int:
    """Return the operations of one Taylor step of one case."""
    known = recurrences(model.stages.program.kernel("rhs"))
    kernel = step_kernel(known, order_at(rtol, 0.0), dense=False)
    return sum(_WEIGHTS.get(line.op, 1) for line in kernel.body)
