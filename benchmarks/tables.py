"""Tables of results: rows of times and errors, as Markdown and as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from equal_error import TARGETS, ratios

__all__ = ["EQUAL", "STAGES", "describe_machine", "fewer_cases", "markdown_table", "marked", "microseconds"]
__all__ += ["precision_rows", "precision_text", "ratio_rows", "startup_rows", "startup_text"]

_QUIET = 0.25
"""Load a core, at the start, up to which a machine counts as quiet."""

Record = Mapping[str, Any]
Rows = Sequence[Sequence[str]]


def describe_machine(machine: Record) -> str:
    """Return where something was measured, in one line."""
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items() if name != "dalembert")
    clock = f", {machine['clock']:g} GHz" if machine.get("clock") else ""
    cpu = f"{machine['cpu']} ({machine['processor']}{clock})" if "processor" in machine else machine["cpu"]
    text = f"{machine['cores']} cores, {cpu}, Python {machine['python']}; {versions}"
    load = machine["load"]
    if load is not None and load > _QUIET * machine["cores"]:
        text += f"; other processes were busy (load {load:g} at the start), so that times are too long and uneven"
    return text


def markdown_table(head: Sequence[str], rows: Rows) -> str:
    """Return a table in Markdown."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, rule, *rows))


def _text_table(head: Sequence[str], rows: Rows) -> str:
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines = []
    for row in (head, *rows):
        others = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        lines.append("  ".join([row[0].ljust(widths[0]), *others]).rstrip())
    return "\n".join(lines)


def microseconds(value: float) -> str:
    """Return a time with a digit after the point where it is short."""
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}"


def precision_rows(records: Sequence[Record], spread: bool) -> list[tuple[str, list[str], list[list[str]]]]:
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
    text = microseconds(run["median"])
    if spread:
        text += f" [{microseconds(run['low'])}, {microseconds(run['high'])}]"
    return text + (f" / {microseconds(call['median'])}" if call else "") + f" ({record['error']:.0e})"


def precision_text(records: Sequence[Record]) -> str:
    """Return speed against error as text: run / call in microseconds, and the error."""
    note = "run us / call us (error)\n"
    return note + "\n\n".join(_text_table(head, rows) for _, head, rows in precision_rows(records, False))


STAGES = ("import", "scene", "compile_model", "first call", "second call", "process")


def startup_rows(startup: Mapping[str, Mapping[str, Record]]) -> list[list[str]]:
    """Return a row a backend and process."""
    return [
        [f"{backend}, {process}", *(f"{seconds[stage]:.3f}" for stage in STAGES)]
        for backend, processes in startup.items()
        for process, seconds in processes.items()
    ]


def startup_text(startup: Mapping[str, Mapping[str, Record]]) -> str:
    """Return start-up seconds as text."""
    return _text_table(["", *STAGES], startup_rows(startup))


EQUAL = ["", *(f"error {target:.0e}" for target in TARGETS)]
"""Head of a table at equal error."""


def marked(records: Sequence[Record], label: str) -> str:
    """Return a label, with a star where a record of sweeps has fewer cases than others."""
    most = max((r.get("cases", 1) for r in records), default=1)
    return f"{label} *" if any(r.get("cases", 1) < most for r in records if r["label"] == label) else label


def fewer_cases(records: Sequence[Record]) -> list[str]:
    """Return a line that says what a star means, where there is one."""
    counts = sorted({r["cases"] for r in records}, reverse=True)
    if len(counts) == 1:
        return []
    fewer = " or ".join(f"{count:,}" for count in counts[1:])
    return [f"\\* with {fewer} cases, because a call with {counts[0]:,} takes too long."]


def ratio_rows(records: Sequence[Record], kind: str, reference: str) -> list[list[str]]:
    """Return rows of time and ratio at equal errors, a row a scene and contender."""
    rows = []
    for r in ratios(records, kind, reference):
        cells = [
            "-" if time is None else microseconds(time) + ("" if share is None else f" ({float(f'{share:.2g}'):g}x)")
            for time, share in zip(r["times"], r["ratios"], strict=True)
        ]
        own = [x for x in records if x["scene"] == r["scene"]]
        rows.append([f"{r['scene']}: {marked(own, r['label'])}", *cells])
    return rows
