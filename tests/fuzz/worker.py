"""A worker of ``make fuzz``: reads seeds from its input, writes one line of JSON a scene."""

from __future__ import annotations

import json
import sys
import time
import traceback
from typing import Any

__all__ = ["examined", "main"]


def examined(seed: int) -> dict[str, Any]:
    """Return what became of a seed."""
    from fuzz.compare import compared
    from fuzz.generator import VERSION, generated

    begin, cpu = time.perf_counter(), time.process_time()
    result: dict[str, Any] = {"seed": seed, "version": VERSION}
    try:
        description = generated(seed)
        result |= {"family": description.family, "style": description.style, "intent": description.intent}
        report = compared(description, formulations=seed % 10 == 0, backends=seed % 20 == 0)
        result |= {
            "outcome": report.outcome,
            "verdict": report.verdict,
            "paths": report.paths,
            "errors": {path: float(f"{error:.2e}") for path, error in report.errors.items()},
            "parts": report.seconds,
        }
    except Exception as reason:  # of the fuzzer itself
        result |= {"outcome": "BROKEN", "verdict": f"{type(reason).__name__}: {reason}", "paths": {}}
        result["verdict"] += "".join(traceback.format_tb(reason.__traceback__)[-2:])
    result["seconds"] = round(time.perf_counter() - begin, 2)
    result["cpu"] = round(time.process_time() - cpu, 2)
    return result


def main() -> None:
    """Serve seeds until the input ends."""
    output = sys.stdout
    sys.stdout = sys.stderr  # nothing but results may be written to the pipe
    for line in sys.stdin:
        output.write(json.dumps(examined(int(line))) + "\n")
        output.flush()


if __name__ == "__main__":
    main()
