"""Memory of sweeps: the peak of a process that sweeps ever more cases, beside the size of what it gets.

``python benchmarks/memory.py`` prints a small table. Each row is a process of its own, and its growth is counted from
the peak that the same process had after a sweep of a thousand cases, when everything was compiled.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

__all__ = ["SWEEPS", "memory_table", "sweep_memory"]

Record = dict[str, Any]

SWEEPS = {
    "final states": "{}",
    "two reductions": '{"reduce": {"x": da.final("x"), "far": da.maximum("x")}}',
    "two reductions, an event": '{"reduce": {"x": da.final("x"), "far": da.maximum("x")}, "events": ["theta_dot"]}',
}

_CHILD = """
import json, resource, sys
import numpy as np
import dalembert as da

def peak():
    try:  # what getrusage tells starts from the size of the parent process on Linux
        lines = open("/proc/self/status").read().splitlines()
        return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1e3
    except OSError:
        size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return size / 1e6 if sys.platform == "darwin" else size / 1e3

def sweep(cases):
    initial = {"x": 0, "y": 0, "theta": 0.2, "theta_dot": 2.0, "x_dot": 0.98}
    parameters = {"m": 1.0, "b": np.linspace(0.1, 0.5, cases), "I_C": 0.5}
    return model.sweep((0, 1), initial, parameters, rtol=1e-6, **options)

model = da.compile_model(da.scenes.chaplygin_sleigh())
options = eval(sys.argv[2])
sweep(1000)
before = peak()
done = sweep(int(sys.argv[1]))
after = peak()
arrays = [done.y, done.t, done.status, done.steps, *done.reduced.values()]
arrays += [part for counts in done.events.values() for part in (counts.count, counts.first, counts.last)]
given = sum(values.nbytes for values in (*done.parameters.values(), *done.initial.values()))
print(json.dumps({"peak": after, "growth": after - before, "given": given / 1e6,
                  "output": sum(array.nbytes for array in arrays) / 1e6}))
"""


def sweep_memory(cases: int, options: str) -> Record:
    """Return megabytes of a sweep of the sleigh in a new process: peak, growth, what was given, and its output."""
    command = [sys.executable, "-c", _CHILD, str(cases), options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"a process of the memory benchmark failed:\n{done.stderr}")
    record: Record = json.loads(done.stdout)
    return record


def memory_table(sizes: Sequence[int] = (100_000, 1_000_000)) -> str:
    """Return a table of the memory of sweeps: megabytes, and the growth over the output."""
    lines = [f"{'sweep':26}{'cases':>10}{'output':>9}{'given':>8}{'peak':>8}{'growth':>9}{'growth / output':>18}"]
    for name, options in SWEEPS.items():
        for cases in sizes:
            record = sweep_memory(cases, options)
            ratio = record["growth"] / record["output"]
            numbers = f"{record['output']:9.1f}{record['given']:8.1f}{record['peak']:8.0f}{record['growth']:9.1f}"
            lines.append(f"{name:26}{cases:10,}{numbers}{ratio:18.2f}")
    return "\n".join(lines)


if __name__ == "__main__":
    print(memory_table())
