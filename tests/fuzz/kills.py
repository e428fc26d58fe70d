"""Processes killed while they fill a cache: ``python tests/fuzz/kills.py [--kills 500] [--seed 0]``.

A process with an empty cache compiles and is killed (``kill -9``) at a random moment, the next one goes on with what it
left and is killed too, and the fourth must find what is right, to the bit. No warning either: files appear whole or not
at all.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from fuzz.cached_runs import begun, ended, expected_of, prepared_models

IN_A_ROW = 3


def attacked(kills: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Kill so many processes; return what became of those that came after them, and what was wrong."""
    counts, wrong = Counter[str](), []
    models = prepared_models()
    expected = {name: expected_of(model) for name, model in models.items()}
    longest = dict.fromkeys(models, 1.0)
    round_number = seed
    while counts["killed"] + counts["killed too late"] < kills:
        chance = random.Random(round_number)
        name = chance.choice(sorted(models))
        with tempfile.TemporaryDirectory() as here:
            folder = Path(here) / "cache"
            for _ in range(IN_A_ROW):
                child, reading = begun(models[name], folder, None)
                time.sleep(chance.random() ** 2 * longest[name])
                os.kill(child, signal.SIGKILL)
                outcome, _ = ended(child, reading)
                counts["killed" if outcome == "signal 9" else "killed too late"] += 1
            begin = time.monotonic()
            left = len(list(folder.rglob("*")))
            outcome, said = ended(*begun(models[name], folder, expected[name]))
            if not left:
                longest[name] = time.monotonic() - begin
            counts[outcome] += 1
            if outcome != "right" or said:
                wrong.append(f"round {round_number}, {name}: {outcome}\n{said}")
        round_number += 1
    return counts, wrong


def main() -> int:
    """Run the attack."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    counts, wrong = attacked(options.kills, options.seed)
    for trouble in wrong:
        print(trouble)
    print(f"{options.kills} kills: {dict(counts)}, {len(wrong)} wrong")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
