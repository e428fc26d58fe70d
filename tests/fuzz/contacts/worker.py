"""A worker of random scenes with contacts: reads "family:seed" from its input, writes one line of JSON a case."""

from __future__ import annotations

import json
import sys
import time
import traceback
from typing import Any

__all__ = ["examined", "main"]


def examined(task: str) -> dict[str, Any]:
    """Return what became of a case."""
    from fuzz.contacts.compare import compared

    begin, cpu = time.perf_counter(), time.process_time()
    family, seed = task.split(":")
    try:
        report = compared(family, int(seed))
        row: dict[str, Any] = {
            "outcome": report.outcome,
            "verdict": "; ".join(report.found),
            "error": float(f"{report.error:.2e}"),
            "doubt": float(f"{report.doubt:.2e}"),
            "phases": report.phases,
            "tie": report.tie,
        }
    except Exception as reason:
        place = "".join(traceback.format_tb(reason.__traceback__)[-2:])
        row = {"outcome": "BARE EXCEPTION", "verdict": f"{type(reason).__name__}: {reason}{place}"}
    return row | {"seconds": round(time.perf_counter() - begin, 2), "cpu": round(time.process_time() - cpu, 2)}


def main() -> None:
    """Serve cases until the input ends."""
    output = sys.stdout
    sys.stdout = sys.stderr  # nothing but results may be written to the pipe
    for line in sys.stdin:
        output.write(json.dumps(examined(line.strip())) + "\n")
        output.flush()


if __name__ == "__main__":
    main()
