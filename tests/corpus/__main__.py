"""This tree against the corpus: ``python -m corpus`` from the folder ``tests``, or ``make corpus``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

from corpus import named_scenes, random_scenes
from corpus.files import NAMED, RANDOM, entries

__all__ = ["main"]


def main() -> int:
    """Compare every entry; return 1 if one is beyond its bound."""
    parser = argparse.ArgumentParser(prog="corpus", description=__doc__)
    parser.add_argument("--only", default="", help="part of the name, family or seed of the entries to compare")
    options = parser.parse_args()
    begin, count, worst = time.perf_counter(), 0, 0
    kinds: list[tuple[Any, Callable[..., Any]]] = [(NAMED, named_scenes.checked), (RANDOM, random_scenes.checked)]
    for file, check in kinds:
        for entry in entries(file):
            name = entry.get("name") or f"seed {entry['seed']} ({entry['family']}, {entry['style']})"
            if options.only not in name:
                continue
            count += 1
            try:
                _, bad = check(entry)
            except Exception as reason:
                bad = [f"{type(reason).__name__}: {str(reason)[:300]}"]
            for text in bad:
                print(f"{name}: {text}", flush=True)
            worst += bool(bad)
    print(f"{count} entries, {worst} beyond their bounds, {time.perf_counter() - begin:.0f} s")
    return int(worst > 0)


if __name__ == "__main__":
    sys.exit(main())
