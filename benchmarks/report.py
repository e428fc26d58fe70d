"""Pages from results: bench.md, and the tables in docs/benchmarks.md.

``python benchmarks/report.py`` writes the tables of the committed result into that page, between its markers; with
``--check`` it only says, by its exit status, whether they are up to date.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from equal_error import TARGETS, ratios
from peer_sweeps import SWEEP_SETTINGS
from peers import SETTINGS
from tables import (
    EQUAL,
    STAGES,
    describe_machine,
    fewer_cases,
    markdown_table,
    marked,
    microseconds,
    precision_rows,
    ratio_rows,
    startup_rows,
)

__all__ = ["RESULT", "fill", "markdown", "selected"]

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "bench.json"
BEGIN, END = "<!-- benchmarks: begin (written by benchmarks/report.py) -->", "<!-- benchmarks: end -->"

SHOWN = 1e-9
"""The error at which docs/benchmarks.md compares solvers; bench.md has all `TARGETS`."""

Record = Mapping[str, Any]
Rows = Sequence[Sequence[str]]


def _scaling_rows(records: Sequence[Record]) -> list[list[str]]:
    rows = []
    for r in records:
        name = f"{r['chain']}, {r['n']} links"
        if "left_out" in r:
            rows.append([name, f"left out: {r['left_out']}", *[""] * 6])
            continue
        stages = [f"{r['seconds'][stage]:.3f}" for stage in ("scene", "read", "derive", "reduce", "lower")]
        flops = [str(r[kernel]["flops"]) if kernel in r else "" for kernel in ("mass_matrix", "rhs")]
        rows.append([name, *stages, *flops])
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
        markdown_table(head, _scaling_rows(derivation["chains"])),
        markdown_table(kane_head, kane),
        "Growth fitted from 5 links on (KanesMethod: all sizes):\n\n" + _exponents(derivation["exponents"]),
    ]


def markdown(result: Record) -> str:
    """Return every table of a result."""
    precision = [markdown_table(head, rows) for _, head, rows in precision_rows(result["precision"], True)]
    imports = ", ".join(f"{name} {value:.2f} s" for name, value in result["imports"].items())
    return "\n\n".join(
        [
            f"# Benchmark, {result['mode']}",
            f"Measured on {describe_machine(result['machine'])}.",
            "## Speed against error, one trajectory of 10 s",
            "Microseconds of a run, median [quartiles] / of `simulate()` as called, and (largest error at the end)."
            " Peers solve equations that a person reduced by hand.",
            *precision,
            "At equal error, microseconds of a run (times that of dalembert's Taylor method):",
            markdown_table(EQUAL, ratio_rows(_for_equal_error(result["precision"]), "trajectory", _OWN_RUN)),
            _settings(SETTINGS, result["precision"]),
            f"## Sweeps of {_cases(result):,} cases of 10 s",
            "Microseconds of a case, median [quartiles] of the whole call (peers: of their loop), and (largest error of"
            " a sample at the end).",
            *_sweeps(result),
            *_contacts(result),
            "## Derivation, chains of rods",
            *_derivation(result),
            *_jax(result),
            "## Start-up: the sleigh's first trajectory, or first sweep, in a new process, seconds",
            markdown_table(["", *STAGES], startup_rows(result["startup"])),
            f"Imports in a new process: {imports}.",
            "",
        ]
    )


_OWN_RUN, _OWN_SWEEP = "dalembert llvm minimal taylor", "dalembert llvm taylor, 2 threads"


def _for_equal_error(records: Sequence[Record]) -> list[Record]:
    """Return what a table at equal error shows: the first contender of each backend, and all peers."""
    first: dict[tuple[str, str], str] = {}
    for r in records:
        first.setdefault((r["scene"], r["solver"]), r["label"])
    return [
        r for r in records if not r["solver"].startswith("dalembert") or r["label"] == first[r["scene"], r["solver"]]
    ]


def _settings(settings: Mapping[str, str], records: Sequence[Record]) -> str:
    """Return the settings of the peers that records are of, as a sentence."""
    measured = {r["label"].split()[0] for r in records}
    return "Peers: " + "; ".join(f"{name}: {text}" for name, text in settings.items() if name in measured) + "."


def _cases(result: Record) -> int:
    """Return the number of cases of sweeps."""
    return int(max(r["cases"] for r in result["sweeps"]))


def _sweep_cell(r: Record, most: int) -> str:
    share = r["peak_share"]
    text = f"{r['us']['median']:.3g} [{r['us']['low']:.3g}, {r['us']['high']:.3g}] ({r['error']:.0e})"
    text += f" {r['cases']:,} cases" if r["cases"] < most else ""
    return text + ("" if share is None else f" {100 * share:.0f}% of peak")


def _sweeps(result: Record) -> list[str]:
    """Return the tables of sweeps."""
    records, parts = result["sweeps"], []
    most = max(r["cases"] for r in records)
    for scene in dict.fromkeys(r["scene"] for r in records):
        own = [r for r in records if r["scene"] == scene]
        tolerances = sorted({r["rtol"] for r in own}, reverse=True)
        rows = []
        for label in dict.fromkeys(r["label"] for r in own):
            cells = {r["rtol"]: _sweep_cell(r, most) for r in own if r["label"] == label}
            rows.append([marked(own, label), *(cells.get(rtol, "-") for rtol in tolerances)])
        parts.append(markdown_table([f"{scene}, rtol", *(f"{rtol:.0e}" for rtol in tolerances)], rows))
    unequal = [[r["kind"], f"{1e3 * r['us_per_step']:.1f}", f"{100 * r['throughput']:.0f}%"] for r in result["unequal"]]
    estimates = "; ".join(f"rtol {r['rtol']:.0e}: {100 * r['within']:.1f}%" for r in result["coverage"])
    return [
        *parts,
        *fewer_cases(records),
        _settings(SWEEP_SETTINGS, records),
        "At equal error, microseconds of a case (times those of dalembert on two threads):",
        markdown_table(EQUAL, ratio_rows(records, "sweep", _OWN_SWEEP)),
        markdown_table(["sleighs at rtol 1e-9", "ns of a step", "throughput of steps"], unequal),
        f"Cases whose estimated error is within a factor 10 of the true one: {estimates}.",
        markdown_table(
            ["memory of a sweep, MB", "output", "growth of the process", "growth / output"],
            [
                [name, f"{r['output']:.1f}", f"{r['growth']:.1f}", f"{r['growth'] / r['output']:.2f}"]
                for name, r in result["memory"].items()
            ],
        ),
    ]


def _contacts(result: Record) -> list[str]:
    """Return the section on friction and contacts, where it was measured."""
    if not result.get("contacts"):
        return []
    from contact_speed import HEAD, contacts_rows

    return [
        "## Friction and contacts: modes against the same scene without",
        markdown_table(HEAD, contacts_rows(result["contacts"])),
    ]


def _singles(result: Record) -> list[str]:
    """Return the table of single runs in JAX programs, where they were measured."""
    records = result.get("singles")
    if not records:
        return []
    return [
        "Run time in microseconds of one trajectory in a JAX program, a jitted `solve_fn` beside diffrax on equations"
        " reduced by hand, at the same final error; in brackets, the ratio to `taylor`:",
        markdown_table(EQUAL, ratio_rows(records, "trajectory", "dalembert jax solve_fn taylor")),
    ]


def _jax(result: Record) -> list[str]:
    """Return the section on the jax backend, where it was measured."""
    table, singles = result.get("jax"), _singles(result)
    if not table and not singles:
        return []
    from jax_speed import text

    return ["## The jax backend against diffrax used by hand", *singles, *([text(table)] if table else [])]


def selected(records: Sequence[Record]) -> list[Record]:
    """Return what the picture shows: llvm but for `augmented`, of every other solver its first contender."""
    first: dict[tuple[str, str], str] = {}
    for r in records:
        first.setdefault((r["scene"], r["solver"]), r["label"])
    return [
        r
        for r in records
        if r["label"] == first[r["scene"], r["solver"]]
        or (r["solver"] == "dalembert llvm" and r["formulation"] != "augmented")
    ]


def _chains_in_short(derivation: Record) -> str:
    """Return the largest chains, and the largest planar one that KanesMethod did too, as a paragraph."""
    done = {(r["chain"], r["n"]): r for r in derivation["chains"] if "total" in r}
    largest = {chain: n for chain, n in sorted(done)}
    kane = max((r for r in derivation["kane"] if ("planar", r["n"]) in done), key=lambda r: r["n"])
    own = done["planar", kane["n"]]
    parts = [
        f"{chain}, {n} links: {done[chain, n]['total']:.2f} s and {done[chain, n]['rhs']['flops']:,} flops"
        for chain, n in largest.items()
    ]
    return (
        f"Compilation of chains of rods, and flops of an evaluation of their right-hand side: {'; '.join(parts)}. The"
        f" planar chain of {kane['n']} links takes {own['total']:.2f} s and {own['rhs']['flops']:,} flops; SymPy's"
        f" KanesMethod with relative angles and its CSE takes {kane['total']:.2f} s and {kane['operations']:,}"
        " operations, for mass matrix and forcing only."
    )


def fastest_table(records: Sequence[Record], kind: str, reference: str) -> str:
    """Return the times of each scene at the error `SHOWN`: one column for each solver, its fastest contender."""
    solvers = [*dict.fromkeys(_solver(r["label"]) for r in records if r["label"].startswith("dalembert ")), *SETTINGS]
    found = ratios(records, kind, reference)
    rows = []
    for scene in dict.fromkeys(r["scene"] for r in found):
        own = [r for r in found if r["scene"] == scene]
        rows.append([scene, *(_fastest(own, solver) for solver in solvers)])
    return markdown_table(["", *(solver.removeprefix("dalembert ") for solver in solvers)], rows)


def _solver(label: str) -> str:
    """Return the name of the package of a contender, for dalembert with the backend."""
    return " ".join(label.split()[:2])


def _fastest(found: Sequence[Record], solver: str) -> str:
    """Return the shortest time of the contenders of a solver at the error `SHOWN`, and its ratio to the reference."""
    place = TARGETS.index(SHOWN)
    own = [r for r in found if r["label"].startswith(f"{solver} ")]
    known = [(r["times"][place], r["ratios"][place]) for r in own if r["times"][place] is not None]
    return f"{microseconds(min(known)[0])} ({float(f'{min(known)[1]:.2g}'):g}x)" if known else "-"


def benchmarks_section(result: Record) -> str:
    """Return what docs/benchmarks.md shows of a result."""
    return "\n\n".join(
        [
            f"Measured on {describe_machine(result['machine'])}.",
            "Microseconds for 10 s of motion, by `model.prepare()` for dalembert (llvm, numba, jax, numpy), at an error"
            f" of {SHOWN:.0e}; in brackets, the ratio to the Taylor method on llvm:",
            fastest_table(_for_equal_error(result["precision"]), "trajectory", _OWN_RUN),
            _settings(SETTINGS, result["precision"]),
            f"Microseconds for each of {_cases(result):,} cases (slow programs: fewer) of a sweep, by `model.sweep()`"
            f" on two threads for dalembert, at a largest error of {SHOWN:.0e}:",
            fastest_table(result["sweeps"], "sweep", _OWN_SWEEP),
            _settings(SWEEP_SETTINGS, result["sweeps"]),
            _chains_in_short(result["derivation"]),
            "Seconds of a process that imports dalembert, compiles the sleigh and simulates or sweeps it, with an empty"
            " cache (first process) and with a filled one (second process):",
            markdown_table(
                ["", *result["startup"]["llvm"]],
                [
                    [name, *(f"{seconds['process']:.1f}" for seconds in processes.values())]
                    for name, processes in result["startup"].items()
                ],
            ),
        ]
    )


def fill(*, check: bool = False) -> bool:
    """Write the committed result's tables into their page; return whether it was up to date.

    With `check`, nothing is written.
    """
    result = json.loads(RESULT.read_text(encoding="utf-8"))
    return fill_page(ROOT / "docs" / "benchmarks.md", (BEGIN, END), benchmarks_section(result), check=check)


def fill_page(path: Path, markers: tuple[str, str], section: str, *, check: bool = False) -> bool:
    """Write a section between its markers in a page, unless `check`; return whether it was up to date."""
    begin, end = markers
    held = path.read_text(encoding="utf-8")
    before, rest = held.split(begin, 1)
    _, after = rest.split(end, 1)
    filled = f"{before}{begin}\n\n{section}\n\n{end}{after}"
    if not check:
        path.write_text(filled, encoding="utf-8")
    return filled == held


def main() -> int:
    """Fill, or check, the page."""
    parser = argparse.ArgumentParser(description="Write the committed result's tables into docs/benchmarks.md.")
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 where the page is stale")
    check = parser.parse_args().check
    current = fill(check=check)
    return int(check and not current)


if __name__ == "__main__":
    sys.exit(main())
