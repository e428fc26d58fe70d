"""Tables from results: Markdown for files, plain text for terminals, and the figures in the README.

``python benchmarks/report.py`` writes the tables of the committed result into README.md, between its
markers; with ``--check`` it only says, by its exit status, whether they are up to date.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["RESULT", "describe_machine", "fill", "markdown", "precision_text", "startup_text"]

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "bench.json"
BEGIN, END = "<!-- benchmarks: begin (written by benchmarks/report.py) -->", "<!-- benchmarks: end -->"

Record = Mapping[str, Any]
Rows = Sequence[Sequence[str]]


def describe_machine(machine: Record) -> str:
    """Return where something was measured, in one line."""
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items() if name != "dalembert")
    return f"{machine['cores']} cores, {machine['cpu']}, Python {machine['python']}; {versions}"


def _markdown_table(head: Sequence[str], rows: Rows) -> str:
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, rule, *rows))


def _text_table(head: Sequence[str], rows: Rows) -> str:
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines = []
    for row in (head, *rows):
        others = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        lines.append("  ".join([row[0].ljust(widths[0]), *others]).rstrip())
    return "\n".join(lines)


def _microseconds(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}"


def _precision_rows(records: Sequence[Record], spread: bool) -> list[tuple[str, list[str], list[list[str]]]]:
    """Return name, head and rows of one table a scene: a row a contender, a column a tolerance."""
    tables = []
    for scene in dict.fromkeys(r["scene"] for r in records):
        own = [r for r in records if r["scene"] == scene]
        tolerances = sorted({r["rtol"] for r in own}, reverse=True)
        rows = []
        for label in dict.fromkeys(r["label"] for r in own):
            cells = {r["rtol"]: _precision_cell(r, spread) for r in own if r["label"] == label}
            rows.append([label, *(cells.get(rtol, "-") for rtol in tolerances)])
        tables.append((scene, [f"{scene}, rtol", *(f"{rtol:.0e}" for rtol in tolerances)], rows))
    return tables


def _precision_cell(record: Record, spread: bool) -> str:
    run, call = record["run_us"], record["call_us"]
    text = _microseconds(run["median"])
    if spread:
        text += f" [{_microseconds(run['low'])}, {_microseconds(run['high'])}]"
    return text + (f" / {_microseconds(call['median'])}" if call else "") + f" ({record['error']:.0e})"


def precision_text(records: Sequence[Record]) -> str:
    """Return speed against error as text: run / call in microseconds, and the error."""
    note = "run us / call us (error)\n"
    return note + "\n\n".join(_text_table(head, rows) for _, head, rows in _precision_rows(records, False))


_STAGES = ("import", "scene", "compile_model", "simulate", "simulate again", "process")


def _startup_rows(startup: Mapping[str, Mapping[str, Record]]) -> list[list[str]]:
    return [
        [f"{backend}, {process}", *(f"{seconds[stage]:.3f}" for stage in _STAGES)]
        for backend, processes in startup.items()
        for process, seconds in processes.items()
    ]


def startup_text(startup: Mapping[str, Mapping[str, Record]]) -> str:
    """Return start-up seconds as text."""
    return _text_table(["", *_STAGES], _startup_rows(startup))


def _scaling_rows(records: Sequence[Record]) -> list[list[str]]:
    rows = []
    for r in records:
        name = f"{r['chain']}, {r['n']} links"
        if "left_out" in r:
            rows.append([name, f"left out: {r['left_out']}", *[""] * 6])
            continue
        stages = [f"{r['seconds'][stage]:.3f}" for stage in ("scene", "read", "derive", "reduce", "lower")]
        rows.append([name, *stages, str(r["mass_matrix"]["flops"]), str(r["rhs"]["flops"])])
    return rows


def _exponents(exponents: Mapping[str, Mapping[str, float | None]]) -> str:
    lines = [
        f"- {name}: " + ", ".join(f"{what} n^{value:.1f}" for what, value in fits.items() if value is not None)
        for name, fits in exponents.items()
    ]
    return "\n".join(lines)


def _derivation(result: Record) -> list[str]:
    derivation = result["derivation"]
    head = ["chain", "scene", "read", "derive", "reduce", "lower [s]", "mass matrix flops", "rhs flops"]
    kane_head = ["KanesMethod, planar", "equations [s]", "CSE [s]", "operations after CSE"]
    kane = [
        [f"{r['n']} links", f"{r['seconds']['equations']:.3f}", f"{r['seconds']['cse']:.3f}", str(r["operations"])]
        for r in derivation["kane"]
    ]
    return [
        _markdown_table(head, _scaling_rows(derivation["chains"])),
        _markdown_table(kane_head, kane),
        "Growth fitted from 5 links on (KanesMethod: all sizes):\n\n" + _exponents(derivation["exponents"]),
    ]


def markdown(result: Record) -> str:
    """Return every table of a result."""
    precision = [_markdown_table(head, rows) for _, head, rows in _precision_rows(result["precision"], True)]
    imports = ", ".join(f"{name} {value:.2f} s" for name, value in result["imports"].items())
    return "\n\n".join(
        [
            f"# Benchmark, {result['mode']}",
            f"Measured on {describe_machine(result['machine'])}.",
            "## Speed against error, one trajectory of 10 s",
            "Microseconds of a run, median [quartiles] / of `simulate()` as called, and (largest error at the end)."
            " Peers solve equations that a person reduced by hand.",
            *precision,
            "## Derivation, chains of rods",
            *_derivation(result),
            "## Start-up: the sleigh's first trajectory in a new process, seconds",
            _markdown_table(["", *_STAGES], _startup_rows(result["startup"])),
            f"Imports in a new process: {imports}.",
            "",
        ]
    )


def readme_section(result: Record) -> str:
    """Return what the README shows of a result."""
    shown = [r for r in result["precision"] if r["rtol"] in (1e-6, 1e-9, 1e-12)]
    precision = [_markdown_table(head, rows) for _, head, rows in _precision_rows(shown, False)]
    last = {r["chain"]: r for r in result["derivation"]["chains"] if "total" in r}
    chains = "; ".join(
        f"{chain}, {r['n']} links: {r['total']:.2f} s to a program of {r['rhs']['flops']} flops per right-hand side"
        for chain, r in last.items()
    )
    kane = result["derivation"]["kane"][-1]
    head = ["start-up [s]", *_STAGES]
    return "\n\n".join(
        [
            f"Measured on {describe_machine(result['machine'])}.",
            "Microseconds of a run of 10 s / of `simulate()` as called, and (largest error at the end):",
            *precision,
            f"Derivation of chains of rods: {chains}; SymPy's KanesMethod and CSE, planar, {kane['n']} links:"
            f" {kane['total']:.2f} s and {kane['operations']} operations.",
            "The sleigh's first trajectory in a new process, with empty caches and with what that left behind:",
            _markdown_table(head, _startup_rows(result["startup"])),
        ]
    )


def fill(*, check: bool = False) -> bool:
    """Write the committed result's tables into README.md, unless `check`; return whether it was up to date."""
    path = ROOT / "README.md"
    held = path.read_text(encoding="utf-8")
    before, rest = held.split(BEGIN, 1)
    _, after = rest.split(END, 1)
    section = readme_section(json.loads(RESULT.read_text(encoding="utf-8")))
    filled = f"{before}{BEGIN}\n\n{section}\n\n{END}{after}"
    if not check:
        path.write_text(filled, encoding="utf-8")
    return filled == held


def main() -> int:
    """Fill, or check, the README."""
    parser = argparse.ArgumentParser(description="Write the committed result's tables into README.md.")
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 where README.md is stale")
    check = parser.parse_args().check
    current = fill(check=check)
    return int(check and not current)


if __name__ == "__main__":
    sys.exit(main())
