"""Measured tables as CSV files in benchmarks/results, and the parts of them that pages show.

[benchmarks/results/NAME.csv] -> the part of a page between the markers of NAME. Scripts that measure call `save`;
``python benchmarks/saved_tables.py`` writes all parts anew, as after a change of `SHOWN`. The files of `jax_singles`,
`jax_batches`, `contact_counts` and `smooth_contacts` are filled by hand from what the scripts print.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import final

from report import fill_page

__all__ = ["SHOWN", "Shown", "cells", "file", "load", "markers", "part", "save", "write"]

ROOT = Path(__file__).resolve().parents[1]


@final
@dataclass(frozen=True)
class Shown:
    """What a page shows of a table: some columns, and the rows whose first cells are among `rows`, or all.

    `file` names the table, where it is not the name of the part. `about` makes a text of all rows, without the head,
    that stands before the table.
    """

    page: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...] = ()
    file: str = ""
    about: Callable[[list[list[str]]], str] | None = None


def robots(rows: list[list[str]]) -> str:
    """Return what was read of the robots of example-robot-data, and the errors of the others."""
    read = [row for row in rows if row[7]]
    error, residual = (max(float(x) for row in read for x in row[at].split(", ") if x != "-") for at in (6, 7))
    faults = [f"- {row[0]}, {row[8]}" for row in rows if row[8]]
    return (
        f"{len(rows)} files: {len(read)} load and compile, {len(rows) - len(read)} raise an error with the reason. The"
        f" largest difference from Pinocchio is {error:.0e} relative to the largest acceleration, {residual:.0e} by"
        f" residual.\n\nRead: {_names(row[0] for row in read)}.\n\n" + "\n".join(faults)
    )


def models(rows: list[list[str]]) -> str:
    """Return which models of MuJoCo were read, and the errors of the others."""
    read = [row for row in rows if row[1]]
    compared = [float(row[2]) for row in read if row[2]]
    reasons = Counter(row[3] for row in rows if row[3])
    names: dict[str, list[str]] = {}
    for row in read:
        package, *folders, name = row[0].removesuffix("/robot").split("/")
        names.setdefault(package, []).append("/".join((*folders, name)) if package == "menagerie" else name)
    return "\n".join(
        (
            f"{len(rows)} models: {len(read)} are read, {len(rows) - len(read)} raise an error with the reason. Of"
            f" {len(compared)} the accelerations were compared: the largest difference is {max(compared):.0e} of the"
            " largest acceleration.\n",
            *(f"- {package}: {_names(dict.fromkeys(each))}" for package, each in names.items()),
            "",
            *(f"- {count} {'models' if count > 1 else 'model'}: {text}" for text, count in reasons.most_common()),
        )
    )


def _names(paths: Iterable[str]) -> str:
    """Return paths with those of one folder together."""
    folders: dict[str, list[str]] = {}
    for path in paths:
        folder, _, name = path.rpartition("/")
        folders.setdefault(folder or path, []).append(name)
    return ", ".join(map(_together, folders, folders.values()))


def _together(folder: str, names: list[str]) -> str:
    if names[1:]:
        return f"{folder} ({', '.join(names)})"
    return folder if names[0] in ("", folder) else f"{folder}/{names[0]}"


CHAINS = tuple((chain, bodies) for chain in ("planar", "spatial") for bodies in ("7", "100", "300", "1,000"))
MOTIONS = (
    "chaplygin sleigh",
    "rolling disk",
    "double pendulum, angles",
    "slider-crank",
    "Whipple bicycle",
    "plate pushed and pulled",
)
JAX = (("sleigh, 10 s",), ("unequal sphere, 10 s",), ("planar chain of 2, 1 s",), ("planar chain of 6, 1 s",))
SHOWN = {
    "robots": Shown(
        "robots_measured",
        ("robot", "bodies", "coordinates", "read [s]", "compile [s]"),
        (
            ("a1/a1",),
            ("g1/g1_29dof_rev_1_0",),
            ("panda/panda",),
            ("pr2/pr2",),
            ("tiago/tiago_dual",),
            ("ur/ur5_robot",),
        ),
        about=robots,
    ),
    "robots_mujoco": Shown("robots_measured", (), about=models),
    "many_bodies_growth": Shown(
        "many_bodies_measured",
        ("chain", "bodies", "compilation, s", "in all, s", "next run, ms", "method"),
        CHAINS,
    ),
    "many_bodies_evaluations": Shown(
        "many_bodies_measured", ("chain", "bodies", "dalembert", "Pinocchio", "MuJoCo", "Drake", "Exudyn"), CHAINS
    ),
    "many_bodies_residuals": Shown(
        "many_bodies_measured",
        ("by", "7", "100", "1,000"),
        tuple(("spatial", program) for program in ("dalembert", "Pinocchio", "MuJoCo", "Drake", "Exudyn")),
    ),
    "many_bodies_loops": Shown(
        "many_bodies_measured",
        ("mechanism", "n", "in all, s", "next run, ms", "evaluation, us"),
        (
            *(("windows", n) for n in ("10", "100")),
            *((name, n) for name in ("track", "arch") for n in ("10", "80")),
            *(("net", n) for n in ("5", "10", "20")),
        ),
    ),
    "slow_cases": Shown(
        "many_bodies_measured",
        ("mechanism", "coordinates", "in all, s", "next run, ms", "change of energy", "reported"),
    ),
    "gradients": Shown(
        "many_bodies_measured",
        ("robot", "base", "compiled, s", "one state, us", "of 1,000 states, us", "Pinocchio, us", "apart"),
    ),
    "stored_throughput": Shown(
        "stored_measured",
        ("", "us of CPU a case", "million cases a second", "of the plain sweep, CPU", "by the clock"),
        tuple(
            (f"{scene}: {way}",)
            for scene in ("sleigh", "double pendulum")
            for way in ("plain sweep, 2 threads", "stored, 2 threads", "cluster, 2 workers", "cluster, 4 workers")
        ),
    ),
    "stored_starts": Shown("stored_measured", ("", "imports", "from the program", "empty cache", "cached")),
    "stored_plan": Shown(
        "stored_measured",
        ("", "computing", "scheduler", "store", "bottleneck"),
        tuple((f"{cases} cases, {nodes} nodes",) for cases, nodes in (("1e+09", 10), ("1e+12", 100), ("1e+12", 1000))),
    ),
    "contact_counts": Shown(
        "contacts_measured",
        ("scene", "contacts", "phases", "first run", "second run"),
        (
            *(("point on sprung legs", n) for n in ("1", "2", "4", "8", "12")),
            *(("trunk on legs of three joints", n) for n in ("1", "4")),
        ),
    ),
    "smooth_contacts": Shown(
        "contacts_measured",
        ("contact", "rtol", "method", "time", "error"),
        (
            *(("rigid, Coulomb's law", rtol) for rtol in ("1e-6", "1e-8")),
            *((f"k = 1e{k} N/m, eps = 1e-{eps} m/s",) for k, eps in ((4, 2), (6, 3), (8, 4), (12, 6))),
        ),
    ),
    "jax_singles": Shown("jax_measurements", ("scene", "dalembert, 1e-9", "diffrax, 1e-9"), JAX),
    "jax_batches": Shown("jax_measurements", ("scene", "dalembert, 1e-9", "diffrax, 1e-9", "ratio, 1e-9"), JAX),
    "exports": Shown(
        "export_measured",
        ("motion", "kind", "method", "run [us]", "`prepare` [us]", "`simulate` [us]", "size [kB]", "compiled in [s]"),
        (
            *((motion, "C", method) for motion in MOTIONS for method in ("taylor", "dop853")),
            ("plate pushed and pulled", "C, contacts"),
            *((motion, "fmu") for motion in ("chaplygin sleigh", "slider-crank")),
            ("plate pushed and pulled", "fmu, contacts"),
            *(
                (motion, kind)
                for motion in ("chaplygin sleigh", "double pendulum, angles")
                for kind in ("numba", "jax")
            ),
            *(("chaplygin sleigh", kind) for kind in ("wheel", "page")),
        ),
    ),
    "fixed_steps": Shown(
        "export_measured",
        ("motion", "kind", "step [ns]", "operations", "difference", "size [kB]"),
        tuple((motion, kind, "rk4, 0.001 s") for motion in MOTIONS for kind in ("C", "C, single")),
        file="exports",
    ),
    "pages": Shown(
        "export_measured",
        ("motion", "C [us]", "WebAssembly [us]", "page [kB]"),
        tuple((motion,) for motion in (*MOTIONS, "compass walker")),
    ),
}


def file(name: str) -> Path:
    """Return the file of a table."""
    return ROOT / "benchmarks" / "results" / f"{name}.csv"


def markers(name: str) -> tuple[str, str]:
    """Return the comments of a page between which the part of a table lies."""
    return f"<!-- {name}: begin (benchmarks/saved_tables.py) -->", f"<!-- {name}: end -->"


def cells(table: str) -> list[list[str]]:
    """Return the rows of a table in Markdown, its head first."""
    lines = [line.strip().removeprefix("|").removesuffix("|") for line in table.splitlines() if line.startswith("|")]
    head, _, *rows = [[cell.strip() for cell in line.split("|")] for line in lines]
    return [head, *rows]


def save(name: str, table: str) -> None:
    """Write a table in Markdown to its file, and a part of it to its page."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(cells(table))
    file(name).write_text(text.getvalue(), encoding="utf-8")
    write(*(each for each, shown in SHOWN.items() if (shown.file or each) == name))


def load(name: str) -> list[list[str]]:
    """Return the rows of a file, its head first."""
    return list(csv.reader(file(name).read_text(encoding="utf-8").splitlines()))


def part(name: str) -> str:
    """Return what the page shows of a table, in Markdown."""
    shown = SHOWN[name]
    head, *rows = load(shown.file or name)
    texts = [shown.about(rows)] if shown.about else []
    if shown.columns:
        chosen = [row for row in rows if not shown.rows or any(tuple(row[: len(few)]) == few for few in shown.rows)]
        columns = [[row[head.index(column)] for row in chosen] for column in shown.columns]
        rule = ["---", *("--:" if all(not x or x[0].isdigit() for x in column) else "---" for column in columns[1:])]
        lines = (shown.columns, rule, *zip(*columns, strict=True))
        texts.append("\n".join(f"| {' | '.join(line)} |" for line in lines))
    return "\n\n".join(texts)


def write(*names: str) -> None:
    """Write the parts of tables to their pages."""
    for name in names:
        fill_page(ROOT / "docs" / f"{SHOWN[name].page}.md", markers(name), part(name))


if __name__ == "__main__":
    write(*SHOWN)
