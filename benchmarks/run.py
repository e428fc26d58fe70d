"""The benchmarks: speed against error, growth of derivation, start-up.

``python benchmarks/run.py --quick`` takes two or three minutes, ``--full`` some twenty. Results go to build/bench:
JSON, tables in Markdown, figures. ``--save`` writes them to benchmarks/results instead, and fills
docs/benchmarks.md from them; ``--startup`` measures start-up alone. No time is asserted; only ratios within one run
mean anything.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")

import figures
import jax_speed
import report
from cases import PROBLEMS
from contact_speed import measure_contacts
from contenders import available_backends
from derivation import kane_scaling, scaling
from exact import ROOT
from measure import growth_exponent, machine
from memory import SWEEPS, sweep_memory
from precision import work_precision
from startup import first_trajectory, import_seconds
from sweeps import CASES, coverage, measure_sweeps, unequal_cases
from tables import describe_machine


@dataclass(frozen=True)
class Extent:
    """How much a mode measures."""

    tolerances: tuple[float, ...]
    formulations: tuple[str, ...]
    methods: dict[str, int]
    rounds: int
    seconds_each: float
    slowest: float
    sizes: tuple[int, ...]
    derivation_limit: float
    kane_sizes: tuple[int, ...]
    startups: int
    startup_backends: tuple[str, ...] | None
    names: tuple[str, ...]
    sweep_cases: tuple[int, ...]
    contact_cases: int
    memory_cases: int
    sweep_tolerances: tuple[float, ...]
    sweep_rounds: int
    sweep_slowest: float
    coverage_cases: int
    imports: int
    jax_scenes: int
    jax_tolerances: int


QUICK = Extent(
    tolerances=(1e-6, 1e-9),
    formulations=("minimal",),
    methods={"llvm": 2, "numba": 1, "numpy": 1, "jax": 1},
    rounds=5,
    seconds_each=0.1,
    slowest=0.05,
    sizes=(2, 4, 6),
    derivation_limit=10.0,
    kane_sizes=(2, 4),
    startups=1,
    startup_backends=("llvm",),
    names=("sleigh", "sphere", "unequal sphere"),
    sweep_cases=CASES[1:],
    contact_cases=2000,
    memory_cases=100_000,
    sweep_tolerances=(1e-6, 1e-9),
    sweep_rounds=5,
    sweep_slowest=0.2,
    coverage_cases=40,
    imports=2,
    jax_scenes=1,
    jax_tolerances=1,
)
FULL_TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-9, 1e-10, 1e-12, 1e-13)
"""Enough to read every curve at the errors of `equal_error.TARGETS`."""
FULL = Extent(
    tolerances=FULL_TOLERANCES,
    formulations=("minimal", "projected"),
    methods={"numba": 2, "numpy": 1, "jax": 1},
    rounds=15,
    seconds_each=0.2,
    slowest=0.2,
    sizes=(2, 4, 5, 6, 8, 10, 20),
    derivation_limit=120.0,
    kane_sizes=(2, 4, 6, 8),
    startups=3,
    startup_backends=None,
    names=tuple(PROBLEMS),
    sweep_cases=CASES,
    contact_cases=10_000,
    memory_cases=1_000_000,
    sweep_tolerances=FULL_TOLERANCES,
    sweep_rounds=9,
    sweep_slowest=0.4,
    coverage_cases=200,
    imports=5,
    jax_scenes=2,
    jax_tolerances=3,
)
MODES = {"quick": QUICK, "full": FULL}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    mode = parser.add_mutually_exclusive_group()
    for name in MODES:
        mode.add_argument(f"--{name}", dest="mode", action="store_const", const=name, help=f"the {name} benchmarks")
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results and into README.md")
    parser.add_argument("--jax", action="store_true", help="compilation and gradients of jax in quick runs too")
    parser.add_argument("--startup", action="store_true", help="start-up alone; all else is that of the last saved run")
    parser.set_defaults(mode="quick")
    options = parser.parse_args(arguments)
    folder = report.RESULT.parent if options.save else ROOT / "build" / "bench"
    if options.startup:
        result = json.loads(report.RESULT.read_text()) | measure_startup(available_backends()[0], MODES[options.mode])
    else:
        result = measure(options.mode, with_jax=options.jax or options.mode == "full")
    write(result, folder)
    if options.save:
        report.fill()
    print(f"\nwritten to {folder.relative_to(ROOT)}; {result['seconds']:.0f} s in all")
    return 0


def measure(mode: str, *, with_jax: bool = False) -> dict[str, Any]:
    """Return the result of all benchmarks, ready for JSON."""
    extent, begin = MODES[mode], time.perf_counter()
    backends, missing = available_backends()
    where = machine()
    print(describe_machine(where))
    for line in missing:
        print(line)
    say("speed against error")
    precision = work_precision(
        backends,
        extent.tolerances,
        formulations=extent.formulations,
        methods=extent.methods,
        rounds=extent.rounds,
        seconds_each=extent.seconds_each,
        slowest=extent.slowest,
        names=extent.names,
        say=say,
    )
    say("sweeps")
    sweeps = measure_sweeps(
        backends,
        extent.sweep_tolerances,
        rounds=extent.sweep_rounds,
        slowest=extent.sweep_slowest,
        say=say,
        counts=extent.sweep_cases,
    )
    say("friction and contacts")
    contacts = measure_contacts(extent.contact_cases, extent.sweep_rounds)
    say("derivation")
    chains = scaling(extent.sizes, extent.derivation_limit, say)
    kane = kane_scaling(extent.kane_sizes, say)
    say("one trajectory in a JAX program")
    singles = (
        jax_speed.singles(
            jax_speed.NAMES[: extent.jax_scenes],
            jax_speed.TOLERANCES[: extent.jax_tolerances],
            extent.rounds,
            1.0,
            say,
        )
        if "jax" in backends
        else []
    )
    say("the jax backend, compilation and gradients")
    jax_table = jax_speed.measure(True, say) if with_jax and "jax" in backends else None
    return {
        "mode": mode,
        "machine": where,
        "missing": missing,
        "precision": precision,
        "sweeps": sweeps,
        "contacts": contacts,
        "unequal": unequal_cases(extent.sweep_cases[0]),
        "coverage": coverage(extent.coverage_cases),
        "derivation": {"chains": chains, "kane": kane, "exponents": exponents(chains, kane)},
        "singles": singles,
        "jax": jax_table,
        "memory": {name: sweep_memory(extent.memory_cases, options) for name, options in SWEEPS.items()},
        **measure_startup(backends, extent),
        "seconds": round(time.perf_counter() - begin, 1),
    }


def measure_startup(backends: Sequence[str], extent: Extent) -> dict[str, Any]:
    """Return the times of new processes, to their first trajectory and of their imports."""
    say("start-up")
    startup = {
        backend: first_trajectory(backend, extent.startups)
        for backend in backends
        if extent.startup_backends is None or backend in extent.startup_backends
    }
    for backend in (name for name in ("llvm", "numba") if name in startup):
        startup[f"{backend}, sweep"] = first_trajectory(backend, extent.startups, "sweep")
    return {"startup": startup, "imports": import_seconds(extent.imports)}


def say(text: str) -> None:
    """Print progress at once."""
    print(text, flush=True)


def _mass_matrices(line: Sequence[dict[str, Any]]) -> tuple[list[int], list[int]]:
    """Return sizes and operations of the mass matrices that have a kernel."""
    made = [r for r in line if "mass_matrix" in r]
    return [r["n"] for r in made], [r["mass_matrix"]["flops"] for r in made]


def exponents(chains: Sequence[dict[str, Any]], kane: Sequence[dict[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Return fitted growth exponents of seconds and operations: chains from 5 links on, KanesMethod throughout."""
    fits: dict[str, dict[str, float | None]] = {}
    for chain in dict.fromkeys(r["chain"] for r in chains):
        line = [r for r in chains if r["chain"] == chain and "total" in r and r["n"] >= 5]
        n = [r["n"] for r in line]
        fits[f"{chain} chain"] = {
            "scene to reduced equations [s]": growth_exponent(n, [r["total"] - r["seconds"]["lower"] for r in line]),
            "scene to program [s]": growth_exponent(n, [r["total"] for r in line]),
            "mass matrix flops": growth_exponent(*_mass_matrices(line)),
            "rhs flops": growth_exponent(n, [r["rhs"]["flops"] for r in line]),
        }
    n = [r["n"] for r in kane]
    fits["KanesMethod, planar chain"] = {
        "equations and CSE [s]": growth_exponent(n, [r["total"] for r in kane]),
        "operations after CSE": growth_exponent(n, [r["operations"] for r in kane]),
    }
    return fits


def write(result: dict[str, Any], folder: Path) -> None:
    """Write a result as JSON, as a table and as figures."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bench.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (folder / "bench.md").write_text(report.markdown(result), encoding="utf-8")
    figures.work_precision(report.selected(result["precision"]), folder / "work_precision.png")
    figures.sweep_picture(result["sweeps"], folder / "sweeps.png")
    derivation = result["derivation"]
    figures.scaling_picture(derivation["chains"], derivation["kane"], folder / "derivation.png")


if __name__ == "__main__":
    sys.exit(main())
