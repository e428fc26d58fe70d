"""Freeze a corpus from a tree that is right: ``python -m corpus.freeze`` from the folder ``tests``.

Random scenes are taken in the order of their seeds, beginning far from those of ``make fuzz``, when they agree with the
reference; a family gives so many at most, so that all are there.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

from corpus import named_scenes, random_scenes
from corpus.files import NAMED, RANDOM, entries, written

__all__ = ["main"]

FIRST_SEED = 1_000_000
MOST = {"tree": 90}
"""Family -> entries at most; 8 for others."""


def main() -> None:
    """Freeze named and random scenes; entries that exist are kept unless told otherwise."""
    parser = argparse.ArgumentParser(prog="corpus.freeze", description=__doc__)
    parser.add_argument("--random", type=int, default=150, help="number of random scenes")
    parser.add_argument("--anew", action="store_true", help="drop the entries that exist")
    options = parser.parse_args()
    named = [] if options.anew else entries(NAMED)
    for name in named_scenes.NAMES:
        if name in {row["name"] for row in named}:
            continue
        try:
            entry = named_scenes.frozen(name)
        except Exception as reason:
            print(f"{name}: left out: {type(reason).__name__}: {str(reason)[:150]}", file=sys.stderr)
            continue
        if entry is None:
            print(f"{name}: left out: its run is long", file=sys.stderr)
            continue
        named.append(entry)
        written(NAMED, named)
    rows = [] if options.anew else entries(RANDOM)
    seed = max((row["seed"] + 1 for row in rows), default=FIRST_SEED)
    counts = Counter(row["family"] for row in rows)
    while len(rows) < options.random:
        try:
            entry = random_scenes.frozen(seed)
        except Exception as reason:
            print(f"seed {seed}: left out: {type(reason).__name__}: {str(reason)[:150]}", file=sys.stderr)
            entry = None
        seed += 1
        if entry is not None and counts[entry["family"]] < MOST.get(entry["family"], 8):
            counts[entry["family"]] += 1
            rows.append(entry)
            written(RANDOM, rows)


if __name__ == "__main__":
    main()
