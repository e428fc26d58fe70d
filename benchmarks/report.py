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

from equal_error import TARGETS, ratios

__all__ = ["RESULT", "describe_machine", "fill", "markdown", "precision_text", "selected", "startup_text"]

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "bench.json"
BEGIN, END = "<!-- benchmarks: begin (written by benchmarks/report.py) -->", "<!-- benchmarks: end -->"

_QUIET = 0.25
"""Load a core, at the start, up to which a machine counts as quiet."""

Record = Mapping[str, Any]
Rows = Sequence[Sequence[str]]


def describe_machine(machine: Record) -> str:
    """Return where something was measured, in one line."""
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items() if name != "dalembert")
    text = f"{machine['cores']} cores, {machine['cpu']}, Python {machine['python']}; {versions}"
    load = machine["load"]
    if load is not None and load > _QUIET * machine["cores"]:
        text += f"; other processes were busy (load {load:g} at the start), so that times are too long and uneven"
    return text


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


_STAGES = ("import", "scene", "compile_model", "first call", "second call", "process")


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
            "At equal error, microseconds of a run (times that of dalembert's Taylor method):",
            _markdown_table(_EQUAL, _ratio_rows(result["precision"], "trajectory", _OWN_RUN, (_OWN_RUN, *_PEERS))),
            f"## Sweeps of {result['sweeps'][0]['cases']:,} cases of 10 s",
            "Microseconds of a case, median [quartiles] of the whole call (peers: of their loop), and (largest error of"
            " a sample at the end).",
            *_sweeps(result),
            *_contacts(result),
            "## Derivation, chains of rods",
            *_derivation(result),
            *_jax(result),
            "## Start-up: the sleigh's first trajectory, or first sweep, in a new process, seconds",
            _markdown_table(["", *_STAGES], _startup_rows(result["startup"])),
            f"Imports in a new process: {imports}.",
            "",
        ]
    )


def _fewer_cases(records: Sequence[Record]) -> list[str]:
    """Return a line that says who ran fewer cases than the others, if anyone did."""
    most = max(r["cases"] for r in records)
    few = [r for r in records if r["cases"] < most]
    if not few:
        return []
    names = ", ".join(dict.fromkeys(r["label"] for r in few))
    return [f"{names}: with {few[0]['cases']:,} cases, and fewer tolerances, where {most:,} take longer than a limit."]


def _ratio_rows(records: Sequence[Record], kind: str, reference: str, labels: Sequence[str] = ()) -> list[list[str]]:
    """Return rows of time and ratio at equal errors, a row a scene and contender."""
    rows = []
    for r in ratios(records, kind, reference):
        if labels and r["label"] not in labels:
            continue
        cells = [
            "-" if time is None else f"{_microseconds(time)}" + ("" if share is None else f" ({share:.2g}x)")
            for time, share in zip(r["times"], r["ratios"], strict=True)
        ]
        rows.append([f"{r['scene']}: {r['label']}", *cells])
    return rows


_EQUAL = ["", *(f"error {target:.0e}" for target in TARGETS)]
_OWN_RUN, _OWN_SWEEP = "dalembert llvm minimal taylor", "dalembert llvm taylor, 2 threads"
_PEERS = ("heyoka by hand taylor", "diffrax by hand Tsit5", "diffrax by hand Dopri8", "SciPy by hand DOP853")


def _sweep_cell(r: Record) -> str:
    share = r["peak_share"]
    text = f"{r['us']['median']:.3g} [{r['us']['low']:.3g}, {r['us']['high']:.3g}] ({r['error']:.0e})"
    return text + ("" if share is None else f" {100 * share:.0f}% of peak")


def _sweeps(result: Record) -> list[str]:
    """Return the tables of sweeps."""
    records, parts = result["sweeps"], []
    for scene in dict.fromkeys(r["scene"] for r in records):
        own = [r for r in records if r["scene"] == scene]
        tolerances = sorted({r["rtol"] for r in own}, reverse=True)
        rows = []
        for label in dict.fromkeys(r["label"] for r in own):
            cells = {r["rtol"]: _sweep_cell(r) for r in own if r["label"] == label}
            rows.append([label, *(cells.get(rtol, "-") for rtol in tolerances)])
        parts.append(_markdown_table([f"{scene}, rtol", *(f"{rtol:.0e}" for rtol in tolerances)], rows))
    unequal = [[r["kind"], f"{1e3 * r['us_per_step']:.1f}", f"{100 * r['throughput']:.0f}%"] for r in result["unequal"]]
    estimates = "; ".join(f"rtol {r['rtol']:.0e}: {100 * r['within']:.1f}%" for r in result["coverage"])
    return [
        *parts,
        "At equal error, microseconds of a case (times those of dalembert on two threads):",
        _markdown_table(_EQUAL, _ratio_rows(records, "sweep", _OWN_SWEEP)),
        _markdown_table(["sleighs at rtol 1e-9", "ns of a step", "throughput of steps"], unequal),
        f"Cases whose estimated error is within a factor 10 of the true one: {estimates}.",
        _markdown_table(
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
    from contacts import HEAD, contacts_rows

    return [
        "## Friction and contacts: modes against the same scene without",
        _markdown_table(HEAD, contacts_rows(result["contacts"])),
    ]


def _singles(result: Record) -> list[str]:
    """Return the table of single runs in JAX programs, where they were measured."""
    records = result.get("singles")
    if not records:
        return []
    return [
        "One trajectory in a JAX program, a jitted `solve_fn` against diffrax on equations reduced by hand, at equal"
        " error: microseconds of a run (times that of `taylor`):",
        _markdown_table(_EQUAL, _ratio_rows(records, "trajectory", "dalembert jax solve_fn taylor")),
    ]


def _jax(result: Record) -> list[str]:
    """Return the section on the jax backend, where it was measured."""
    table, singles = result.get("jax"), _singles(result)
    if not table and not singles:
        return []
    from jax_speed import text

    return ["## The jax backend against diffrax used by hand", *singles, *([text(table)] if table else [])]


def selected(records: Sequence[Record]) -> list[Record]:
    """Return what a short table shows: numba but for `augmented`, of every other solver its first contender."""
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
        f"Chains of rods, from scene to program, and flops of an evaluation of the right-hand side: {'; '.join(parts)}."
        f" The planar chain of {kane['n']} links: {own['total']:.2f} s and {own['rhs']['flops']:,} flops, accelerations"
        f" included; SymPy's KanesMethod with relative angles and its CSE: {kane['total']:.2f} s and"
        f" {kane['operations']:,} operations, mass matrix and forcing only."
    )


def readme_section(result: Record) -> str:
    """Return what the README shows of a result."""
    shown = [r for r in selected(result["precision"]) if r["rtol"] in (1e-6, 1e-9, 1e-12)]
    precision = [_markdown_table(head, rows) for _, head, rows in _precision_rows(shown, False)]
    return "\n\n".join(
        [
            f"Measured on {describe_machine(result['machine'])}.",
            "Microseconds of a run of 10 s / of `simulate()` as called, and (largest error at the end):",
            *precision,
            "One trajectory at equal error, by `model.prepare()`: microseconds of a run (times dalembert's):",
            _markdown_table(_EQUAL, _ratio_rows(result["precision"], "trajectory", _OWN_RUN, (_OWN_RUN, *_PEERS))),
            *_singles(result),
            f"`model.sweep()` of {result['sweeps'][0]['cases']:,} cases, the whole call, at equal error: microseconds"
            " of a case (times those of dalembert's Taylor method on two threads):",
            _markdown_table(_EQUAL, _ratio_rows(result["sweeps"], "sweep", _OWN_SWEEP)),
            *_fewer_cases(result["sweeps"]),
            _chains_in_short(result["derivation"]),
            "Seconds to the sleigh's first trajectory, or first sweep, in a new process, with empty caches (loops of"
            " the library are compiled too) and with what that left behind:",
            _markdown_table(["", *_STAGES], _startup_rows(result["startup"])),
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
