"""Random closed loops against minimal coordinates: ``python -m fuzz.loops 0:300`` from the folder ``tests``.

``python -m fuzz.loops 0:40 auto long`` takes the mechanisms whose conditions have a large rank.
"""

from __future__ import annotations

import sys
from collections import Counter

from fuzz.loops.compare import compared
from fuzz.loops.mechanisms import FAMILIES, LONG, Draw

__all__ = ["main"]


def main() -> int:
    """Run seeds, in a formulation if one is given; return 1 if any is wrong or an error, or ends before its time."""
    first, last = (int(part) for part in (sys.argv[1] if len(sys.argv) > 1 else "0:300").split(":"))
    formulation = sys.argv[2] if len(sys.argv) > 2 else "auto"
    families = LONG if sys.argv[3:] == ["long"] else FAMILIES
    counts = Counter[str]()
    for seed in range(first, last):
        try:
            name = list(families)[seed % len(families)]
            outcome, text = compared(name, families[name](Draw(seed)), formulation)
        except Exception as error:
            outcome, text = "ERROR", repr(error)
        counts[outcome] += 1
        if outcome != "agree":
            print(f"{seed}: {outcome} {text[:400]}", flush=True)
    print(f"closed loops: {dict(counts)}")
    return int(set(counts) != {"agree"})


if __name__ == "__main__":
    sys.exit(main())
