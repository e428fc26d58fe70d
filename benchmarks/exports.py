"""Exported simulators in C beside the default backend: time of a run, steps to the bit, sizes of code and binary.

``python benchmarks/exports.py`` prints; ``--save`` writes the table of docs/export.md. It needs a C compiler.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from report import fill_page

import dalembert as da

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from corpus.named_scenes import READY  # noqa: E402
from hard_cases import hard_case  # noqa: E402
from hard_cases.machines import bicycle_parameters, bicycle_scene, upright_bicycle  # noqa: E402

PAGE = ROOT / "docs" / "export.md"
MARKERS = ("<!-- exports: begin (written by benchmarks/exports.py) -->", "<!-- exports: end -->")
RTOL, ATOL = 1e-10, 1e-12
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2", "-march=native")
HARD = (
    "rolling disk",
    "Routh sphere",
    "heavy top, fast precession",
    "free body near its unstable axis",
    "pendulum, Cartesian (IFToMM A01)",
    "double pendulum, angles",
    "slider-crank",
    "Andrews' squeezing mechanism",
    "stiff flyball governor",
    "chain of 8 pendulums",
)
LEAST = 0.3
"""Seconds for which each run is repeated; the shortest counts."""

PROGRAM = """
#define _POSIX_C_SOURCE 199309L
#include "{0}.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
static double seconds(void)
{{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}}
int main(int argc, char **argv)
{{
    static {0}_run run;
    double values[256], state[256], best = 1e9, all = 0.0;
    const double end = atof(argv[1]);
    int i;
    int32_t status = 0;
    for (i = 2; i < argc; i++) {{
        values[i - 2] = atof(argv[i]);
    }}
    while (all < {2} && status == 0) {{
        const double begin = seconds();
        double spent;
        status = {0}_simulate(&run, 0.0, values, values + {1}_INITIAL, 1, &end, state);
        spent = seconds() - begin;
        best = spent < best ? spent : best;
        all += spent;
    }}
    printf("%d %.17g\\n", (int)status, best);
    {0}_start(&run, 0.0, end, values, values + {1}_INITIAL, 0.0, 0);
    while ({0}_step(&run) <= 0) {{
        {0}_at(&run, {0}_time(&run), state);
        printf("%a", {0}_time(&run));
        for (i = 0; i < {1}_STATES; i++) {{
            printf(" %a", state[i]);
        }}
        printf("\\n");
        if (run.status == 0) {{
            break;
        }}
    }}
    return 0;
}}
"""


@final
@dataclass(frozen=True)
class Motion:
    """A motion of a model, over a span from 0."""

    name: str
    model: Any
    initial: Any
    parameters: Any
    end: float


@final
@dataclass(frozen=True)
class Measured:
    """What was measured of an export: seconds of runs, steps, lines of C, bytes of machine code."""

    name: str
    method: str
    steps: int
    same: bool
    largest: float
    own: float
    prepared: float
    simulate: float
    lines: int
    code: int
    compilation: float


def motions(quick: bool) -> Iterator[Motion]:
    """Yield the motions: ready scenes, then hard cases and the bicycle."""
    for name, case in READY.items():
        model = da.compile_model(case.build())
        if model.modes is None:
            yield Motion(
                name.removeprefix("ready: ").replace("_", " "), model, case.initial, case.parameters, case.span[1]
            )
    for name in HARD[:2] if quick else HARD:
        case = hard_case(name)
        end = min(case.times()[-1], 10.0)
        yield Motion(name, case.compile("auto"), case.initial, case.parameters, end)
    if not quick:
        bicycle = da.compile_model(bicycle_scene(), formulation="projected")
        yield Motion("Whipple bicycle", bicycle, upright_bicycle(4.6), bicycle_parameters(), 2.0)


def shortest(run: Callable[[], Any]) -> float:
    """Return the seconds of a call, the shortest of many."""
    best, begin = np.inf, time.perf_counter()
    while time.perf_counter() - begin < LEAST:
        start = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - start)
    return float(best)


def measured(motion: Motion, folder: Path) -> Measured:
    """Export a motion, compile it, and measure runs of it and of the default backend."""
    model, end = motion.model, motion.end
    given = {"initial": motion.initial, "parameters": motion.parameters}
    path = model.export(folder / "export", t_span=(0, end), rtol=RTOL, atol=ATOL, **given)
    method = "taylor" if "Taylor" in (path / "README.md").read_text().split("in the formulation")[0] else "dop853"
    method = "radau" if "method radau" in (path / "README.md").read_text() else method
    prefix = next(path.glob("*.h")).stem
    (path / "time.c").write_text(PROGRAM.format(prefix, prefix.upper(), LEAST))
    begin = time.perf_counter()
    subprocess.run(["cc", *FLAGS, "-c", f"{prefix}.c"], cwd=path, check=True)
    compilation = time.perf_counter() - begin
    subprocess.run(["cc", *FLAGS, "-o", "time", "time.c", f"{prefix}.o", "-lm"], cwd=path, check=True)
    sizes = subprocess.run(["size", f"{prefix}.o"], cwd=path, check=True, capture_output=True, text=True)
    known = {**model.read_initial(motion.initial), **model.read_parameters(motion.parameters)}
    marks = (f"{prefix}_initial_", f"{prefix}_parameter_")
    declared = [line for line in (path / f"{prefix}.h").read_text().splitlines() if line.strip().startswith(marks)]
    values = [repr(float(known[line.split("/* ")[1].removesuffix(" */")])) for line in declared]
    done = subprocess.run([path / "time", repr(end), *values], check=True, capture_output=True, text=True)
    (status, own), *steps = (line.split() for line in done.stdout.splitlines())
    if status != "0":
        raise RuntimeError(f"{motion.name} ends with the status {status}")
    options = {"method": method, "rtol": RTOL, "atol": ATOL}
    state, p = model.state(motion.initial, motion.parameters), model.parameter_vector(motion.parameters)
    prepared = model.prepare((0, end), **options)
    run = model.simulate((0, end), motion.initial, motion.parameters, **options, dense=False)
    found = np.array([[float.fromhex(number) for number in line] for line in steps])
    expected = np.column_stack([run.t, run.y])[1:]
    differences = (
        np.abs(found - expected) / np.maximum(1.0, np.abs(expected)) if len(found) == len(expected) else np.inf
    )
    return Measured(
        motion.name,
        method,
        len(found),
        bool(found.shape == expected.shape and np.array_equal(found, expected)),
        float(np.max(differences)),
        float(own),
        shortest(lambda: prepared(state, p)),
        shortest(
            lambda: model.simulate((0, end), motion.initial, motion.parameters, t_eval=[end], dense=False, **options)
        ),
        len((path / f"{prefix}.c").read_text().splitlines()),
        int(sizes.stdout.splitlines()[1].split()[0]),
        compilation,
    )


def table(rows: list[Measured]) -> str:
    """Return the table."""
    columns = (
        *("motion", "method", "steps", "C [us]", "`prepare` [us]", "`simulate` [us]", "difference"),
        *("lines of C", "code [kB]", "gcc [s]"),
    )
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for row in rows:
        times = (f"{1e6 * seconds:.0f}" for seconds in (row.own, row.prepared, row.simulate))
        difference = "none" if row.same else f"{row.largest:.0e}"
        cells = (
            row.name,
            row.method,
            row.steps,
            *times,
            difference,
            row.lines,
            f"{row.code / 1e3:.0f}",
            f"{row.compilation:.1f}",
        )
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def main() -> None:
    """Measure, and print or save the table."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--save", action="store_true", help="write the table of docs/export.md")
    reader.add_argument("--quick", action="store_true", help="two hard cases")
    options = reader.parse_args()
    if shutil.which("cc") is None:
        sys.exit("there is no C compiler")
    warnings.simplefilter("ignore")
    rows = []
    for motion in motions(options.quick):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(measured(motion, Path(folder)))
        print(table(rows[-1:]).splitlines()[-1], flush=True)
    if options.save:
        fill_page(PAGE, MARKERS, table(rows))


if __name__ == "__main__":
    main()
