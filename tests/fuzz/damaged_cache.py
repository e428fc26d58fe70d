"""Damaged caches: ``python tests/fuzz/damaged_cache.py [--rounds 1000] [--seed 0]``.

Every round spoils one to three files of a full cache, at random: cut, emptied, with bits turned, overwritten, swapped
with others that are whole, replaced by another user's valid file or by a folder, a link or nothing, with other rights;
or spoils folders. Then a process that uses all of them must find what is right without a cache, to the bit, with
warnings or without; a crash, an error or another result is a failure.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from fuzz.cached_runs import begun, ended, expected_of, prepared_models

STRANGER = 4321


def cut(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Keep the beginning of a file."""
    data = path.read_bytes()
    path.write_bytes(data[: chance.randrange(len(data) or 1)])


def emptied(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Leave nothing in a file."""
    path.write_bytes(b"")


def turned(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Turn some bits."""
    data = bytearray(path.read_bytes())
    for _ in range(chance.choice((1, 1, 2, 10))):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def overwritten(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Write noise over a part of a file."""
    data = bytearray(path.read_bytes())
    first = chance.randrange(len(data))
    data[first : first + 64] = chance.randbytes(chance.randrange(128))
    path.write_bytes(data)


def lengthened(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Append noise to a file."""
    path.write_bytes(path.read_bytes() + chance.randbytes(chance.randrange(1, 100)))


def swapped(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Swap a file with another, which is as whole."""
    other = chance.choice(any_of)
    first, second = path.read_bytes(), other.read_bytes()
    path.write_bytes(second)
    other.write_bytes(first)


def copied(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Put another whole file in its place, of the same kind where there is one."""
    alike = [other for other in any_of if other.suffix == path.suffix and other != path]
    shutil.copy(chance.choice(alike or any_of), path)


def of_others(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Let a file that is whole belong to another user, or be open to others."""
    if os.geteuid() == 0 and chance.random() < 0.5:
        os.chown(path, STRANGER, STRANGER)
    else:
        path.chmod(chance.choice((0o666, 0o660, 0o777, 0o000)))


def removed(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Remove a file."""
    path.unlink()


def linked(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Put a link in its place: to another file, to itself, or to nothing."""
    target = chance.choice((chance.choice(any_of), path, path.parent / "nothing"))
    path.unlink()
    path.symlink_to(target)


def foldered(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Put a folder in its place."""
    path.unlink()
    path.mkdir()


def folder_open(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Let others write its folder, or the cache, and spoil the file besides."""
    turned(path, any_of, chance)
    chance.choice((path.parent, path.parent.parent)).chmod(chance.choice((0o777, 0o770, 0o1777)))


def folder_swapped(path: Path, any_of: list[Path], chance: random.Random) -> None:
    """Swap its folder with another."""
    other = chance.choice(any_of).parent
    if other != path.parent:
        aside = path.parent.parent / "aside"
        path.parent.rename(aside)
        other.rename(path.parent)
        aside.rename(other)


SPOILS: tuple[Callable[[Path, list[Path], random.Random], None], ...] = (
    *(cut, emptied, turned, turned, overwritten, lengthened, swapped, swapped, copied, copied),
    *(of_others, removed, linked, foldered, folder_open, folder_swapped),
)


def spoiled(folder: Path, chance: random.Random) -> list[str]:
    """Spoil some files; return how."""
    done = []
    for _ in range(chance.choice((1, 1, 2, 3))):
        found = [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.is_symlink()]
        full = [path for path in found if path.stat().st_size and path.stat().st_mode & 0o400]
        if full:
            spoil, path = chance.choice(SPOILS), chance.choice(full)
            spoil(path, full, chance)
            done.append(f"{spoil.__name__} {path.name}")
    return done


def attacked(rounds: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Attack so often; return what became of the processes, and what was wrong."""
    counts, wrong = Counter[str](), []
    models = prepared_models()
    expected = {name: expected_of(model) for name, model in models.items()}
    with tempfile.TemporaryDirectory() as here:
        whole, folder = Path(here) / "whole", Path(here) / "cache"
        for name, model in models.items():
            outcome, said = ended(*begun(model, whole, expected[name]))
            assert outcome == "right" and not said, (outcome, said)
        for number in range(seed, seed + rounds):
            chance = random.Random(number)
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(whole, folder)
            done = spoiled(folder, chance)
            name = chance.choice(sorted(models))
            outcome, said = ended(*begun(models[name], folder, expected[name]))
            counts[f"{outcome}, warned" if outcome == "right" and said else outcome] += 1
            if outcome != "right" or said not in ("", "CacheWarning"):
                wrong.append(f"round {number}, {name}, {done}: {outcome}\n{said}")
    return counts, wrong


def main() -> int:
    """Run the attack."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    counts, wrong = attacked(options.rounds, options.seed)
    for trouble in wrong:
        print(trouble)
    print(f"{options.rounds} damaged caches: {dict(counts)}, {len(wrong)} wrong")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
