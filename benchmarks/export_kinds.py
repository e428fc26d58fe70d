"""Exports of other kinds than C with chosen steps: contacts that change, steps of a fixed size, files, packages."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from exports import (
    ATOL,
    CLOCK,
    LEAST,
    PROGRAM,
    RTOL,
    Measured,
    Motion,
    compiled,
    default_times,
    difference_of,
    lines_of,
    method_of,
    motions,
    ran,
)

from export.units import Unit, unpacked
from hard_cases.contacts import contact_motion

Measure = Callable[[Motion, Path], Measured]

CONTACTS = ("bouncing ball", "plate pushed and pulled", "plate through the upright position")
STEP = 1e-3
"""Seconds of a step of a fixed size."""

FIXED = (
    "chaplygin sleigh",
    "rolling disk",
    "pendulum, Cartesian (IFToMM A01)",
    "double pendulum, angles",
    "slider-crank",
)
SINGLE = FIXED[:1] + FIXED[2:3]
PYTHON = ("chaplygin sleigh", "double pendulum, angles")
PACKED = ("chaplygin sleigh",)
UNITS = ("chaplygin sleigh", "double pendulum, angles", "slider-crank")

STEPS = """
int main(int argc, char **argv)
{{
    static {0}_run run;
    {3} values[256];
    double best = 1e9, all = 0.0;
    const int64_t steps = (int64_t)(atof(argv[1]) / (double){1}_STEP + 0.5);
    int i;
    for (i = 2; i < argc; i++) {{
        values[i - 2] = ({3})atof(argv[i]);
    }}
    while (all < {2}) {{
        const double begin = seconds();
        double spent;
        {0}_start(&run, 0, values, values + {1}_INITIAL);
        while (run.steps < steps && run.status < 0) {{
            {0}_step(&run);
        }}
        spent = seconds() - begin;
        best = spent < best ? spent : best;
        all += spent;
    }}
    printf("%d %.17g\\n", (int)run.status + 1, best);
    for (i = 0; i < {1}_STATES; i++) {{
        printf("%a ", (double)run.state[i]);
    }}
    return 0;
}}
"""

PROCESS = """
import importlib.util, json, sys, time
import numpy as np
sys.modules["dalembert"] = None
begin = time.perf_counter()
spec = importlib.util.spec_from_file_location("made", sys.argv[1])
made = importlib.util.module_from_spec(spec)
spec.loader.exec_module(made)
times = np.array([0.0, float(sys.argv[2])])
simulate = made.simulate
if sys.argv[3] == "jax":
    import jax
    compiled = jax.jit(made.simulate)
    def simulate(times):
        return jax.block_until_ready(compiled(times))
found = simulate(times)
first, best, begun = time.perf_counter() - begin, 1e9, time.perf_counter()
while time.perf_counter() - begun < LEAST:
    start = time.perf_counter()
    found = simulate(times)
    best = min(best, time.perf_counter() - start)
end = {name: float(np.asarray(values)[-1]) for name, values in found.items() if np.ndim(values) == 1}
print(json.dumps({"first": first, "run": best, "end": end, "status": int(found.get("status", 0))}))
"""


def changing(quick: bool) -> list[Motion]:
    """Return motions whose contacts change."""
    found = []
    for name in CONTACTS[:1] if quick else CONTACTS:
        case = contact_motion(name).motion
        end = min(case.times()[-1], 10.0)
        found.append(Motion(name, case.compile("auto"), case.initial, case.parameters, end))
    return found


def further(quick: bool) -> Iterator[tuple[Measure, Motion]]:
    """Yield motions, and how each is measured."""
    known, with_contacts = {motion.name: motion for motion in motions(quick)}, changing(quick)
    yield from ((contacts, motion) for motion in with_contacts)
    yield from ((unit, motion) for motion in (*(known[name] for name in UNITS if name in known), *with_contacts))
    for precision, names in (("double", FIXED), ("single", SINGLE)):
        yield from ((partial(fixed, precision=precision), known[name]) for name in names if name in known)
    for kind in ("numba", "jax"):
        yield from ((partial(file, kind=kind), known[name]) for name in PYTHON if name in known)
    yield from ((partial(packed, kind=kind), known[name]) for kind in ("wheel", "page") for name in PACKED)


def _example(motion: Motion) -> dict[str, Any]:
    return {"initial": motion.initial, "parameters": motion.parameters, "t_span": (0, motion.end)}


def contacts(motion: Motion, folder: Path) -> Measured:
    """Measure C of a scene whose contacts change."""
    model, end = motion.model, motion.end
    path = model.export(folder / "export", rtol=RTOL, atol=ATOL, **_example(motion))
    method, prefix = method_of(path), next(path.glob("*.h")).stem
    size, compilation = compiled(path, (CLOCK + PROGRAM).format(prefix, prefix.upper(), LEAST))
    own, steps = ran(motion, path)
    options = {"method": method, "rtol": RTOL, "atol": ATOL}
    run = model.simulate((0, end), motion.initial, motion.parameters, t_eval=[end], **options)
    last = np.array([float.fromhex(number) for number in steps[-1][1:]])
    expected = np.array([run[name][-1] for name in model.layout.variables])
    return Measured(
        name=motion.name,
        kind="C, contacts",
        method=method,
        steps=len(steps),
        own=own,
        **default_times(motion, method),
        difference=difference_of(last, expected),
        lines=lines_of(path),
        size=size,
        compilation=compilation,
    )


def fixed(motion: Motion, folder: Path, *, precision: str) -> Measured:
    """Measure C with steps of a fixed size."""
    model, end, real = motion.model, motion.end, {"double": "double", "single": "float"}[precision]
    given = {"method": "rk4", "step": STEP, "precision": precision}
    path = model.export(folder / "export", **given, **_example(motion))
    prefix = next(path.glob("*.h")).stem
    size, compilation = compiled(path, (CLOCK + STEPS).format(prefix, prefix.upper(), LEAST, real))
    own, (last,) = ran(motion, path)
    counted = (path / "README.md").read_text().split("| operation | a step |")[1].split("\n\n")[0]
    run = model.simulate((0, end), motion.initial, motion.parameters, t_eval=[end], rtol=1e-12, atol=1e-13)
    return Measured(
        name=motion.name,
        kind="C" if precision == "double" else f"C, {precision}",
        method=f"rk4, {STEP:g} s",
        steps=round(end / STEP),
        own=own,
        operations=sum(int(line.split("|")[2]) for line in counted.splitlines()[2:]),
        difference=difference_of(np.array([float.fromhex(number) for number in last]), run.y[-1]),
        lines=lines_of(path),
        size=size,
        compilation=compilation,
    )


def file(motion: Motion, folder: Path, *, kind: str) -> Measured:
    """Measure one file of Python in a process of its own, which compiles it at the first call."""
    model, end = motion.model, motion.end
    method = "dop853" if kind == "jax" else "taylor"
    path = model.export(folder / f"made_{kind}.py", kind, method=method, rtol=RTOL, atol=ATOL, **_example(motion))
    command = [sys.executable, "-c", PROCESS.replace("LEAST", str(LEAST)), path, repr(end), kind]
    done = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    if done["status"]:
        raise RuntimeError(f"{motion.name} ends with the status {done['status']}")
    run = model.simulate((0, end), motion.initial, motion.parameters, t_eval=[end], rtol=RTOL, atol=ATOL, method=method)
    found = np.array([done["end"][name] for name in model.layout.variables])
    expected = np.array([run[name][-1] for name in model.layout.variables])
    return Measured(
        name=motion.name,
        kind=kind,
        method=method,
        own=done["run"],
        difference=difference_of(found, expected),
        lines=len(path.read_text().splitlines()),
        size=path.stat().st_size,
        compilation=done["first"],
    )


def unit(motion: Motion, folder: Path) -> Measured:
    """Measure a unit of FMI 3.0 whose co-simulation takes one step over the whole span."""
    model, end, options = motion.model, motion.end, {"rtol": RTOL, "atol": ATOL}
    begin = time.perf_counter()
    path = folder / "unit.fmu"
    description, unit_folder = unpacked(model, path, fmi="3.0", **options, **_example(motion))
    compilation, best, begun = time.perf_counter() - begin, np.inf, time.perf_counter()
    while time.perf_counter() - begun < LEAST:
        made = Unit(description, unit_folder)
        start = time.perf_counter()
        if made.begin(0.0) or made.step(0.0, end):
            raise RuntimeError(f"the unit of {motion.name} fails")
        best = min(best, time.perf_counter() - start)
    run = model.simulate((0, end), motion.initial, motion.parameters, t_eval=[end], **options)
    found = np.array([made.get(name) for name in model.layout.variables])
    expected = np.array([run[name][-1] for name in model.layout.variables])
    return Measured(
        name=motion.name,
        kind="fmu" if model.modes is None else "fmu, contacts",
        method="auto",
        own=float(best),
        difference=difference_of(found, expected),
        size=path.stat().st_size,
        compilation=compilation,
    )


def packed(motion: Motion, folder: Path, *, kind: str) -> Measured:
    """Measure the size of a package or page, and the seconds until it is written."""
    names, options = {"wheel": "package", "page": "page.html"}, {"rtol": RTOL, "atol": ATOL}
    begin = time.perf_counter()
    path = motion.model.export(folder / names[kind], kind, method="taylor", **options, **_example(motion))
    seconds = time.perf_counter() - begin
    (path,) = path.glob("*.whl") if kind == "wheel" else (path,)
    return Measured(
        name=motion.name,
        kind=kind,
        method="taylor",
        size=path.stat().st_size,
        compilation=seconds,
    )
