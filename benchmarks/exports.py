"""Exported simulators beside the default backend: time of a run, steps to the bit, sizes of code and binary.

``python benchmarks/exports.py`` prints; ``--save`` writes exports.csv, and parts of it to docs/export_measured.md. It
needs a C compiler, numba and JAX, and ziglang. Kinds other than C with chosen steps are measured by `export_kinds`.
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
from saved_tables import save

import dalembert as da

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from corpus.named_scenes import READY  # noqa: E402
from hard_cases import hard_case  # noqa: E402
from hard_cases.machines import bicycle_parameters, bicycle_scene, upright_bicycle  # noqa: E402

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

CLOCK = """
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
"""

PROGRAM = """
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
    """A motion of a model, over a span from 0, with events."""

    name: str
    model: Any
    initial: Any
    parameters: Any
    end: float
    events: tuple[Any, ...] = ()


@final
@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was measured of an export: seconds of runs and of compilation, lines, bytes; None for what there is not.

    `difference` is that of the end from `simulate`, relative to a state above 1; "none" where all steps are the same.
    `operations` are those of a step.
    """

    name: str
    kind: str = "C"
    method: str
    steps: int | None = None
    own: float | None = None
    operations: int | None = None
    prepared: float | None = None
    simulate: float | None = None
    difference: str = ""
    lines: int | None = None
    size: int
    compilation: float | None = None


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


def compiled(path: Path, program: str) -> tuple[int, float]:
    """Compile an export with a program around it, ``time``; return its bytes of machine code, and seconds."""
    prefix = next(path.glob("*.h")).stem
    (path / "time.c").write_text(program)
    begin = time.perf_counter()
    subprocess.run(["cc", *FLAGS, "-c", f"{prefix}.c"], cwd=path, check=True)
    seconds = time.perf_counter() - begin
    subprocess.run(["cc", *FLAGS, "-o", "time", "time.c", f"{prefix}.o", "-lm"], cwd=path, check=True)
    sizes = subprocess.run(["size", f"{prefix}.o"], cwd=path, check=True, capture_output=True, text=True)
    return int(sizes.stdout.splitlines()[1].split()[0]), seconds


def ran(motion: Motion, path: Path) -> tuple[float, list[list[str]]]:
    """Run the program beside an export; return the seconds of a run, and the words of the lines behind it."""
    prefix, model = next(path.glob("*.h")).stem, motion.model
    known = {**model.read_initial(motion.initial), **model.read_parameters(motion.parameters)}
    marks = (f"{prefix}_initial_", f"{prefix}_parameter_")
    declared = [line for line in (path / f"{prefix}.h").read_text().splitlines() if line.strip().startswith(marks)]
    values = [repr(float(known[line.split("/* ")[1].removesuffix(" */")])) for line in declared]
    done = subprocess.run([path / "time", repr(motion.end), *values], check=True, capture_output=True, text=True)
    (status, own), *further = (line.split() for line in done.stdout.splitlines())
    if status != "0":
        raise RuntimeError(f"{motion.name} ends with the status {status}")
    return float(own), further


def method_of(path: Path) -> str:
    """Return the method of an export."""
    text = (path / "README.md").read_text().split("in the formulation")[0]
    return "taylor" if "Taylor" in text else "radau" if "method radau" in text else "dop853"


def difference_of(found: Any, expected: Any) -> str:
    """Return the largest difference of states of the same shape, relative to states above 1."""
    largest = np.max(np.abs(found - expected) / np.maximum(1.0, np.abs(expected)))
    return f"{largest:.0e}" if largest else "none"


def default_times(motion: Motion, method: str) -> dict[str, float]:
    """Return the seconds of a run of the default backend."""
    model, end, options = motion.model, motion.end, {"method": method, "rtol": RTOL, "atol": ATOL}
    given = motion.initial, motion.parameters
    prepared = model.prepare((0, end), **options)
    state, p = model.state(*given), model.parameter_vector(motion.parameters)
    return {
        "prepared": shortest(lambda: prepared(state, p)),
        "simulate": shortest(lambda: model.simulate((0, end), *given, t_eval=[end], dense=False, **options)),
    }


def lines_of(path: Path) -> int:
    """Return the number of lines of the source of an export."""
    return len((path / f"{next(path.glob('*.h')).stem}.c").read_text().splitlines())


def measured(motion: Motion, folder: Path) -> Measured:
    """Export a motion as C, compile it, and measure runs of it and of the default backend."""
    model, end = motion.model, motion.end
    given = {"initial": motion.initial, "parameters": motion.parameters}
    path = model.export(folder / "export", t_span=(0, end), rtol=RTOL, atol=ATOL, **given)
    method, prefix = method_of(path), next(path.glob("*.h")).stem
    size, compilation = compiled(path, (CLOCK + PROGRAM).format(prefix, prefix.upper(), LEAST))
    own, steps = ran(motion, path)
    options = {"method": method, "rtol": RTOL, "atol": ATOL}
    run = model.simulate((0, end), motion.initial, motion.parameters, **options, dense=False)
    found = np.array([[float.fromhex(number) for number in line] for line in steps])
    expected = np.column_stack([run.t, run.y])[1:]
    return Measured(
        name=motion.name,
        method=method,
        steps=len(found),
        own=own,
        **default_times(motion, method),
        difference=difference_of(found, expected) if len(found) == len(expected) else "other steps",
        lines=lines_of(path),
        size=size,
        compilation=compilation,
    )


def table(rows: list[Measured]) -> str:
    """Return the table."""
    columns = (
        *("motion", "kind", "method", "steps", "run [us]", "step [ns]", "operations"),
        *("`prepare` [us]", "`simulate` [us]", "difference", "lines", "size [kB]", "compiled in [s]"),
    )
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for row in rows:
        step = 1e9 * row.own / row.steps if row.own and row.steps else None
        cells = (
            *(row.name, row.kind, row.method, row.steps, _number(row.own, 1e6), _number(step), row.operations),
            *(_number(row.prepared, 1e6), _number(row.simulate, 1e6), row.difference, row.lines),
            *(_number(row.size, 1e-3), "" if row.compilation is None else f"{row.compilation:.1f}"),
        )
        lines.append("| " + " | ".join("" if cell is None else str(cell) for cell in cells) + " |")
    return "\n".join(lines)


def _number(value: float | None, unit: float = 1.0) -> str:
    return "" if value is None else f"{unit * value:.0f}"


def main() -> None:
    """Measure, and print or save the table."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--save", action="store_true", help="write exports.csv, and docs/export_measured.md")
    reader.add_argument("--quick", action="store_true", help="two hard cases")
    options = reader.parse_args()
    from export_kinds import further  # which imports this file

    if shutil.which("cc") is None:
        sys.exit("there is no C compiler")
    warnings.simplefilter("ignore")
    rows = []
    for measure, motion in (*((measured, motion) for motion in motions(options.quick)), *further(options.quick)):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(measure(motion, Path(folder)))
        print(table(rows[-1:]).splitlines()[-1], flush=True)
    if options.save:
        save("exports", table(rows))


if __name__ == "__main__":
    main()
