"""Random scenes with contacts: ``python -m fuzz.contacts 0:200`` from the folder ``tests``, or ``make fuzz``.

Families are those of scenes (`fuzz.contacts.families`), and those of driven scenes (`fuzz.driven.families`).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from fuzz.contacts.families import FAMILIES, VERSION
from fuzz.contacts.worker import drawn_case
from fuzz.driven.families import FAMILIES as DRIVEN
from fuzz.workers import examine_all

__all__ = ["main", "table"]

LIMIT = 60.0
"""Seconds after which a case hangs, on top of those in which a worker compiles its first one."""
OUTCOMES = ("agree", "refused rightly", "set aside", "HANG", "CRASH", "BARE EXCEPTION", "FALSE REFUSAL", "WRONG")


def main() -> int:
    """Run the cases that have no result yet; return 1 if anything is a defect."""
    options = _options()
    first, last = (int(part) for part in options.seeds.split(":"))
    families = {"all": [*FAMILIES, *DRIVEN], "scenes": [*FAMILIES], "driven": [*DRIVEN]}.get(options.families)
    families = families or options.families.split(",")
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "contacts.jsonl"
    wanted = [f"{family}:{seed}" for seed in range(first, last) for family in families]
    known = _results(file)
    again = options.again.split(",")
    tasks = [task for task in wanted if task not in known or known[task]["outcome"] in again]
    if tasks and not options.report:
        print(f"{len(tasks)} of {len(wanted)} cases are left; results go to {file}", flush=True)
        _run(tasks, file, options.jobs, options.limit)
        known = _results(file)
    rows = {task: known[task] for task in wanted if task in known}
    print(table(rows))
    return int(any(_defect(row) for row in rows.values()))


def _options() -> Any:
    parser = argparse.ArgumentParser(prog="fuzz.contacts", description=__doc__)
    parser.add_argument("seeds", nargs="?", default="0:200", help="first and last seed of each family, as 0:200")
    parser.add_argument(
        "--families",
        default="all",
        help=f"scenes, driven, or names with commas between, of: {', '.join([*FAMILIES, *DRIVEN])}",
    )
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds a case")
    parser.add_argument("--out", default="build/fuzz", help="folder of the results")
    parser.add_argument("--again", default="", help="outcomes whose cases are run again, such as WRONG,HANG")
    parser.add_argument("--report", action="store_true", help="only summarise what there is")
    return parser.parse_args()


def _defect(row: dict[str, Any]) -> bool:
    return OUTCOMES.index(row["outcome"]) >= OUTCOMES.index("HANG")


def _results(file: Path) -> dict[str, dict[str, Any]]:
    """Return the last result of every case; lines that a kill cut short are left out."""
    rows: dict[str, dict[str, Any]] = {}
    for line in file.read_text().splitlines() if file.exists() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if row.get("version") == VERSION:
            rows[row["task"]] = row
    return rows


def _run(tasks: list[str], file: Path, jobs: int, limit: float) -> None:
    """Run cases in workers and append their results to a file."""
    begin, count = time.perf_counter(), 0

    def record(task: str, answer: dict[str, Any]) -> None:
        nonlocal count
        with file.open("a") as out:
            out.write(json.dumps({"task": task, "version": VERSION} | answer) + "\n")
        count += 1
        if _defect(answer):
            print(f"{task}: {answer['outcome']} {answer['verdict'][:400]}\n    {drawn_case(task)}", flush=True)
        if count % 100 == 0:
            print(f"{count} of {len(tasks)} cases in {time.perf_counter() - begin:.0f} s", flush=True)

    examine_all("fuzz.contacts.worker", tasks, jobs, lambda _: limit, record)


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Return outcomes by family as a Markdown table, and the reasons of what was refused or set aside."""
    counts: dict[str, Counter[str]] = {}
    for task, row in rows.items():
        counts.setdefault(task.split(":")[0], Counter())[row["outcome"]] += 1
    total = sum(counts.values(), Counter())
    heads = [outcome for outcome in OUTCOMES if total[outcome]]
    text = ["| family | cases | " + " | ".join(heads) + " |", "|---" * (2 + len(heads)) + "|"]
    for family, found in [*sorted(counts.items()), ("all", total)]:
        text.append(f"| {family} | {found.total()} | " + " | ".join(str(found[head]) for head in heads) + " |")
    agreed = [row for row in rows.values() if row["outcome"] == "agree"]
    if agreed:
        worst = max(row["error"] for row in agreed)
        text += ["", f"largest difference from the reference where they agree: {worst:.1e} of the size of the motion"]
    cpu = sum(row.get("cpu", 0.0) for row in rows.values())
    text += [f"{sum(row.get('phases', 0) for row in rows.values())} phases, {cpu:.0f} s of processor time"]
    return "\n".join(text)


if __name__ == "__main__":
    sys.exit(main())
