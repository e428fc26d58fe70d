"""Measuring: interleaved timings with their spread, growth exponents, and what a machine is called."""

from __future__ import annotations

import gc
import os
import platform
import statistics
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from sympy.core.cache import clear_cache

from dalembert.transforms import lower_kernels

__all__ = ["Timing", "Watch", "calls_of_sample", "forget", "growth_exponent", "interleaved", "machine", "sample"]

K = TypeVar("K", bound=Hashable)

_SAMPLE_SECONDS = 2e-3
_MOST_CALLS = 1000
_PACKAGES = ("dalembert", "llvmlite", "numba", "jax", "diffrax", "heyoka", "casadi", "numpy", "scipy", "sympy")


def forget() -> None:
    """Forget what SymPy and dalembert remember of scenes that were compiled, as in a new process."""
    clear_cache()
    remembered: dict[Any, Any] = vars(lower_kernels).get("LOWERED", {})  # earlier versions remember nothing
    remembered.clear()


@dataclass(frozen=True)
class Timing:
    """Seconds of one call: the median of the rounds, their quartiles, how many they were, and the least."""

    median: float
    low: float
    high: float
    rounds: int
    least: float

    @classmethod
    def of(cls, samples: Sequence[float]) -> Timing:
        """Return the timing that samples [s] amount to."""
        low, middle, high = np.percentile(samples, [25, 50, 75])
        return cls(float(middle), float(low), float(high), len(samples), float(min(samples)))

    def microseconds(self) -> dict[str, float]:
        """Return median and quartiles in microseconds, as JSON takes them."""
        return {name: round(1e6 * getattr(self, name), 3) for name in ("median", "low", "high")}


def interleaved(
    tasks: Mapping[K, Callable[[], Any]], *, rounds: int, seconds_each: float, seconds: float = _SAMPLE_SECONDS
) -> dict[K, Timing]:
    """Time tasks in turn, round after round, so that a change of the machine's speed meets all of them alike.

    Parameters
    ----------
    tasks : mapping to functions without arguments
        What to time; they must have run before, so that nothing is compiled now.
    rounds : int
        Samples a task.
    seconds_each : float
        What a task may take in all [s]; a slow one is sampled less often, three times at least.
    seconds : float
        A sample is as many calls as take this time [s]. Where it is longer, fewer of them come after other tasks, whose
        code and numbers have filled the caches.
    """
    calls, wanted = {}, {}
    for name, task in tasks.items():
        calls[name], once = calls_of_sample(task, seconds)
        wanted[name] = int(min(rounds, max(3, seconds_each / (once * calls[name]))))
    samples: dict[K, list[float]] = {name: [] for name in tasks}
    for turn in range(max(wanted.values(), default=0)):
        for name, task in tasks.items():
            # The fewer samples a task has, the further apart they are taken.
            if len(samples[name]) * rounds <= turn * wanted[name] and len(samples[name]) < wanted[name]:
                samples[name].append(sample(task, calls[name]))
    return {name: Timing.of(values) for name, values in samples.items()}


def calls_of_sample(task: Callable[[], Any], seconds: float = _SAMPLE_SECONDS) -> tuple[int, float]:
    """Return how many calls in a row make a sample of some time [s], and the seconds of one of them."""
    once = min(sample(task, 1) for _ in range(2))
    return int(min(max(1, seconds / once), _MOST_CALLS)), once


def sample(task: Callable[[], Any], calls: int) -> float:
    """Return the seconds of one of `calls` calls in a row, without garbage collection."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        begin = time.perf_counter()
        for _ in range(calls):
            task()
        return (time.perf_counter() - begin) / calls
    finally:
        if collecting:
            gc.enable()


class Watch:
    """Takes down how long each of several stages takes."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, run: Callable[[], Any]) -> Any:
        """Return ``run()``."""
        begin = time.perf_counter()
        result = run()
        self.seconds[stage] = time.perf_counter() - begin
        return result


def growth_exponent(sizes: Sequence[float], values: Sequence[float]) -> float | None:
    """Return the slope of values over sizes on logarithmic axes; None with fewer than two points."""
    pairs = [(n, v) for n, v in zip(sizes, values, strict=True) if v > 0]
    if len(pairs) < 2:
        return None
    slope, _ = statistics.linear_regression(*np.log(np.array(pairs)).T.tolist())
    return round(slope, 2)


def machine() -> dict[str, Any]:
    """Return core count, processor, its clock [GHz], versions, and how many processes were busy."""
    return {
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "cpu": _feature_level(),
        "processor": _processor(),
        "clock": _clock(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "versions": {name: version for name in _PACKAGES if (version := _version(name))},
    }


def _processor() -> str:
    """Return the name that LLVM has for the processor."""
    from llvmlite import binding

    return str(binding.get_host_cpu_name())


def _clock() -> float | None:
    """Return the clock that Linux tells [GHz]; None elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    found = [float(line.split(":")[1]) for line in lines if line.startswith("cpu MHz")]
    return round(found[0] / 1e3, 1) if found else None


def _feature_level() -> str:
    from llvmlite import binding

    if platform.machine().lower() not in ("x86_64", "amd64"):
        return platform.machine().lower()
    has = dict(binding.get_host_cpu_features())
    levels = {
        "x86-64-v4": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
        "x86-64-v3": ("avx2", "bmi2", "fma"),
        "x86-64-v2": ("sse4.2",),
    }
    return next((level for level, needed in levels.items() if all(has.get(f) for f in needed)), "x86-64")


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
