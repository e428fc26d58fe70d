"""The pages of the hard cases, from the data of a run: ``python benchmarks/hard_case_pages.py`` writes them.

[benchmarks/results/hard_cases.json] -> docs/hard_cases.md (worst error and best method of each case),
docs/hard_cases_details.md (errors by method) and docs/hard_cases_errors.png. `report_hard_cases` and
`report_contacts` write the data.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hard_case_texts import DETAILS, PAGE
from saved_tables import cells

__all__ = ["DATA", "details", "dump", "load", "number", "overview", "rounded", "table", "write"]

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "benchmarks" / "results" / "hard_cases.json"
DEFAULT = ("minimal", "projected", "all")
"""Formulations that "auto" chooses from; "all" stands for a scene without constraints, where they are one."""

Record = Mapping[str, Any]


def load() -> dict[str, Any]:
    """Return the data of the committed run."""
    found: dict[str, Any] = json.loads(DATA.read_text(encoding="utf-8"))
    return found


def dump(data: Record) -> str:
    """Return the data as JSON with a line for each entry."""
    entries = []
    for key, value in data.items():
        if isinstance(value, dict):
            lines = [f"  {json.dumps(name)}: {json.dumps(entry)}" for name, entry in value.items()]
            entries.append(f"{json.dumps(key)}: {{\n" + ",\n".join(lines) + "\n}")
        elif isinstance(value, list):
            entries.append(f"{json.dumps(key)}: [\n" + ",\n".join(f"  {json.dumps(x)}" for x in value) + "\n]")
        else:
            entries.append(f"{json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(entries) + "\n}\n"


def number(value: float | str) -> str:
    """Return a figure with one digit; a text stands for itself."""
    return value if isinstance(value, str) else "0" if value == 0.0 else f"{value:.0e}"


def rounded(value: float) -> float:
    """Return a figure with two digits, as the data have it."""
    return float(f"{value:.1e}")


def table(text: str) -> Record:
    """Return head and rows of the first table of a Markdown text."""
    head, *rows = cells(text)
    return {"head": head, "rows": rows}


def default_runs(case: Record) -> Iterator[tuple[str, str, Record]]:
    """Yield formulation, method and figures of the runs in formulations that "auto" chooses from."""
    for formulation, found in case["formulations"].items():
        if formulation in DEFAULT and "why" not in found:
            yield from ((formulation, method, entry) for method, entry in found.items())


def _line(name: str, case: Record) -> list[str]:
    """Return the case in one line: what is hard, the worst error, and the run with the least one."""
    runs = list(default_runs(case))
    statuses = sorted({entry["why"] for _, _, entry in runs if "why" in entry})
    measured = [
        (entry["error"], entry["ms"], method, formulation) for formulation, method, entry in runs if "error" in entry
    ]
    if not measured:
        return [f"{name}: {case['hard']}", " or ".join(statuses), "-"]
    error, _, method, formulation = min(measured)
    used = f"`{method}`" + ("" if formulation == "all" else f", `{formulation}`")
    worst = number(max(measured)[0]) + ("; other runs fail with a status" if statuses else "")
    return [f"{name}: {case['hard']}", worst, f"{number(error)} ({used})"]


def _rows(rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _table(table: Record, *columns: str, only: str = "") -> str:
    """Return columns of a table; `only` leaves the rows with a cell that ends with it."""
    places, rows, last = [table["head"].index(column) for column in columns], [], ""
    for row in table["rows"]:
        last = row[0] or last
        if any(cell.endswith(only) for cell in row):
            rows.append([last if place == 0 else row[place] for place in places])
    return f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}\n{_rows(rows)}"


def overview(data: Record) -> str:
    """Return the page with a line for each case."""
    contacts = [
        [f"{name}: {case['hard']}", str(case["phases"]), number(case["transitions"]), number(case["error"])]
        for name, case in data["contacts"].items()
    ]
    return PAGE.format(
        machine=data["machine"],
        settings=", ".join(f"`{method}` at {rtol:g}" for method, rtol in data["tolerances"].items()),
        cases=_rows([_line(name, case) for name, case in data["cases"].items()]),
        contacts=_rows(contacts),
        checks=data["checks"],
        count=len(data["cases"]) + len(data["contacts"]),
    )


def _worst(case: Record, method: str) -> str:
    """Return the largest error of a method in formulations that "auto" chooses from, or how its runs end."""
    runs = [entry for _, used, entry in default_runs(case) if used == method]
    errors = [number(max(entry["error"] for entry in runs))] if all("error" in entry for entry in runs) else []
    return ", ".join(errors or sorted({entry["why"] for entry in runs if "why" in entry}))


def details(data: Record) -> str:
    """Return the page with the errors of each method, and what else was measured."""
    cases = [[name, *(_worst(case, method) for method in data["tolerances"])] for name, case in data["cases"].items()]
    long = data["table_long"]
    return DETAILS.format(
        methods=" | ".join(data["tolerances"]),
        rule="|".join("---:" for _ in data["tolerances"]),
        cases=_rows(cases),
        checks=data["checks"],
        smooth=_table(data["table_smooth"], "eps, m/s", "error at 8 s", "steps", 'method of "auto"'),
        ends=", ".join(sorted({row[long["head"].index("status")] for row in long["rows"]})),
        long=_table(long, "case", "formulation", "time", "energy", "other integrals", "positions"),
        stiff=_table(data["table_stiff"], "case", "method", "error", "evaluations", "ms", only="1e-08"),
        kept=_table(
            data["table_kept"],
            "scene",
            "method, rtol",
            "error at the end",
            "change of energy",
            "time, with over without",
            only="1e-06",
        ),
    )


def draw_errors(data: Record, path: Path) -> None:
    """Draw the error of every run against its time, a colour a method."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 4.8))
    for method in data["tolerances"]:
        runs = [
            run
            for case in data["cases"].values()
            for run in default_runs(case)
            if run[1] == method and "error" in run[2]
        ]
        axes.loglog(
            [e["ms"] for *_, e in runs], [max(e["error"], 1e-16) for *_, e in runs], "o", ms=4, alpha=0.7, label=method
        )
    axes.set_xlabel("time of a run [ms]")
    axes.set_ylabel("largest error")
    axes.set_title("each point is a hard case by one method, at that method's tightest tolerance", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120, metadata={"Software": None})


def write(data: Record, folder: Path = ROOT / "docs") -> None:
    """Write both pages and the picture of errors."""
    (folder / "hard_cases.md").write_text(overview(data), encoding="utf-8")
    (folder / "hard_cases_details.md").write_text(details(data), encoding="utf-8")
    draw_errors(data, folder / "hard_cases_errors.png")


if __name__ == "__main__":
    write(load())
