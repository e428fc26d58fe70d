"""Processes that share an empty cache: ``python tests/fuzz/cold_processes.py [--rounds 50] [--seed 0]``.

Every round, eight processes that have compiled nothing begin at the same moment, with one empty cache. Each must find
what is right, to the bit and without a warning; what they leave behind must be whole.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

from fuzz.cached_runs import begun, ended, expected_of, prepared_models

PROCESSES = 8


def attacked(rounds: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Begin so often; return what became of the processes, and what was wrong."""
    counts, wrong = Counter[str](), []
    models = prepared_models()
    expected = {name: expected_of(model) for name, model in models.items()}
    for number in range(seed, seed + rounds):
        chance = random.Random(number)
        with tempfile.TemporaryDirectory() as here:
            folder = Path(here) / "cache"
            names = [chance.choice(sorted(models)) for _ in range(PROCESSES)]
            children = [begun(models[name], folder, expected[name]) for name in names]
            outcomes = [ended(*child) for child in children]
            outcomes += [ended(*begun(model, folder, expected[name])) for name, model in models.items()]
            left = [str(path) for path in folder.rglob("*.part")]
        counts.update(outcome for outcome, _ in outcomes)
        if left or any(outcome != "right" or said for outcome, said in outcomes):
            wrong.append(f"round {number}: {outcomes} {left}")
    return counts, wrong


def main() -> int:
    """Run the attack."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    counts, wrong = attacked(options.rounds, options.seed)
    for trouble in wrong:
        print(trouble)
    print(f"{options.rounds} starts of {PROCESSES} processes: {dict(counts)}, {len(wrong)} wrong")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
