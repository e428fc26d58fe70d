"""A worker of random scenes with contacts: reads "family:seed" from its input, writes one line of JSON a case."""

from __future__ import annotations

import json
import sys
import time
import traceback
from typing import Any

__all__ = ["drawn_case", "examined", "main"]


def drawn_case(task: str) -> Any:
    """Return the case of a family and a seed, "family:seed"."""
    from fuzz.contacts import families as scenes
    from fuzz.driven import families as driven

    family, seed = task.split(":")
    return (driven if family in driven.FAMILIES else scenes).drawn(family, int(seed))


def examined(task: str) -> dict[str, Any]:
    """Return what became of a case."""
    from fuzz.contacts import compare as scenes
    from fuzz.driven import compare as driven

    begin, cpu = time.perf_counter(), time.process_time()
    try:
        case = drawn_case(task)
        report = driven.examine(case) if isinstance(case, driven.Driven) else scenes.examine(case)
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
