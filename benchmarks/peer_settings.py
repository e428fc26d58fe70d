"""Peers at several settings: what each gives, and which of them the benchmarks use.

``python benchmarks/peer_settings.py`` prints tables of times and errors, and takes some minutes. ``--save`` keeps them
in benchmarks/results/peer_settings.json and writes docs/peer_settings.md; ``--only heyoka`` measures one peer. A
setting is faster where it takes less time at the same error; the one of `peers` and `peer_sweeps` is in bold.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import report
from batches import BATCHES, sample_states
from cases import PROBLEMS, Problem
from contenders import Prepared
from measure import interleaved, machine
from peer_sweeps import (
    SCALARS,
    DiffraxSweep,
    Solver,
    casadi_sweep,
    diffrax_sweep,
    heyoka_ensemble,
    heyoka_sweep,
    scipy_sweep,
)
from peers import (
    CVODES,
    DIFFRAX,
    HEYOKA,
    DiffraxSetting,
    casadi_run,
    diffrax_run,
    heyoka_run,
    installed,
    scipy_ode,
    scipy_solve_ivp,
)
from pydy_run import pydy_run
from tables import describe_machine, markdown_table

__all__ = ["FILE", "measure", "section"]

FILE = report.RESULT.parent / "peer_settings.json"
MARKERS = "<!-- settings: begin (written by benchmarks/peer_settings.py) -->", "<!-- settings: end -->"
COLUMNS = (("sleigh", 1e-6), ("sleigh", 1e-9), ("unequal sphere", 1e-6), ("unequal sphere", 1e-9))
SHOWN = [(scene, rtol) for scene, rtol in COLUMNS if rtol == report.SHOWN]
"""The columns on the page; the file of results has all."""
CASES = 2048
ROUNDS = 9

Record = dict[str, Any]


@dataclass(frozen=True)
class Tried:
    """A peer at one setting; `prepare` takes a problem or a batch, and rtol."""

    peer: str
    setting: str
    prepare: Callable[[Any, float], Any]
    chosen: bool = False
    scenes: tuple[str, ...] = ("sleigh", "unequal sphere")


# -- one trajectory -----------------------------------------------------------------------------


def single_runs() -> Iterator[Tried]:
    """Yield the settings that are tried for one trajectory."""
    yield Tried("SciPy", "`solve_ivp`, DOP853, right-hand side in Python", scipy_solve_ivp)
    yield Tried("SciPy", "`solve_ivp`, DOP853, compiled by numba", partial(scipy_solve_ivp, compiled=True))
    yield Tried("SciPy", "`ode`, dop853, right-hand side in Python", partial(scipy_ode, compiled=False))
    yield Tried("SciPy", "`ode`, dop853, compiled by numba", scipy_ode, chosen=True)
    yield Tried("SciPy", "`ode`, lsoda, compiled by numba", partial(scipy_ode, method="lsoda"))
    if (heyoka := installed("heyoka")) is not None:
        for options in _HEYOKA:
            yield Tried("heyoka", _words(options), partial(_heyoka, heyoka, options), chosen=options == HEYOKA)
    if installed("diffrax") is not None:
        for method in ("Tsit5", "Dopri8"):
            for name, setting in _DIFFRAX.items():
                yield Tried(
                    "diffrax", f"{method}, {name}", partial(_diffrax, method, setting), chosen=setting == DIFFRAX
                )
    if (casadi := installed("casadi")) is not None:
        for name, plugin, options in _CASADI:
            if not options.get("jit") or shutil.which("gcc"):
                yield Tried("CasADi", name, partial(_casadi, casadi, plugin, options), chosen=options == CVODES)
    if installed("pydy") is not None:
        for generator in ("lambdify", "symjit"):
            if generator != "symjit" or installed("symjit") is not None:
                name = f"`System` of a `KanesMethod`, `{generator}`, odeint"
                yield Tried("PyDy", name, partial(pydy_run, generator), scenes=("sleigh",))


_HEYOKA: tuple[Mapping[str, Any], ...] = (
    {},
    {"compact_mode": True},
    {"high_accuracy": True},
    {"opt_level": 2},
    HEYOKA,
    {"fast_math": True, "force_avx512": True, "slp_vectorize": True},
)
_DIFFRAX = {
    "an array, defaults": DiffraxSetting(adjoint="RecursiveCheckpointAdjoint", throw=True),
    "an array, `ForwardMode`, `throw=False`": DIFFRAX,
    "a tuple of scalars, `ForwardMode`, `throw=False`": SCALARS,
}
_CASADI: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    ("cvodes, defaults (BDF, Newton)", "cvodes", {}),
    ("cvodes, Adams, Newton", "cvodes", {"linear_multistep_method": "adams"}),
    ("cvodes, Adams, functional iteration", "cvodes", CVODES),
    (
        "the same, compiled by gcc",
        "cvodes",
        {**CVODES, "jit": True, "compiler": "shell", "jit_options": {"flags": ["-O3", "-march=native"]}},
    ),
    ("idas, defaults", "idas", {}),
)


def _words(options: Mapping[str, Any]) -> str:
    return ", ".join(f"`{name}={value}`" for name, value in options.items()) or "defaults"


def _heyoka(heyoka: Any, options: Mapping[str, Any], problem: Problem, rtol: float) -> Prepared:
    return heyoka_run(heyoka, problem, rtol, options)


def _diffrax(method: str, setting: DiffraxSetting, problem: Problem, rtol: float) -> Prepared:
    return diffrax_run(problem, method, rtol, setting)


def _casadi(casadi: Any, plugin: str, options: Mapping[str, Any], problem: Problem, rtol: float) -> Prepared:
    return casadi_run(casadi, problem, rtol, options, plugin)


# -- sweeps -------------------------------------------------------------------------------------


def sweeps() -> Iterator[Tried]:
    """Yield the settings that are tried for sweeps."""
    if (heyoka := installed("heyoka")) is not None:
        recommended = heyoka.recommended_simd_size()
        for lanes in (4, 8, 16, 32, 64, 128):
            note = ", the recommended size" if lanes == recommended else ""
            prepare = partial(_heyoka_sweep, heyoka, 2, lanes, HEYOKA)
            name = f"batches of {lanes}{note}, `fast_math=True`, 2 threads"
            yield Tried("heyoka", name, prepare, chosen=lanes in (8, 16, 32))
        for name, threads, options in (
            ("batches of 16, `fast_math=True`, 1 thread", 1, HEYOKA),
            ("batches of 16, defaults, 2 threads", 2, {}),
            ("batches of 16, `compact_mode=True`, `fast_math=True`, 2 threads", 2, {**HEYOKA, "compact_mode": True}),
        ):
            yield Tried("heyoka", name, partial(_heyoka_sweep, heyoka, threads, 16, options))
        name = "`ensemble_propagate_until_batch`, batches of 32, `fast_math=True`, 2 threads"
        yield Tried("heyoka", name, lambda batch, rtol: heyoka_ensemble(heyoka, batch, 2, rtol, 32))
    if installed("diffrax") is not None:
        for method in ("Tsit5", "Dopri8"):
            for name, setting in _DIFFRAX_SWEEPS.items():
                yield Tried(
                    "diffrax",
                    f"{method}, {name}",
                    partial(_diffrax_sweep, method, setting),
                    chosen=setting == DiffraxSweep(),
                )
    yield Tried("SciPy", "`ode`, dop853, compiled by numba, case after case", scipy_sweep, chosen=True)
    if (casadi := installed("casadi")) is not None:
        for name, options, chosen in (
            ("cvodes, defaults, `map` over 2 threads", {}, False),
            ("cvodes, Adams, functional iteration, `map` over 2 threads", CVODES, True),
        ):
            prepare = partial(_casadi_sweep, casadi, options)
            yield Tried("CasADi", name, prepare, chosen=chosen)


_DIFFRAX_SWEEPS = {
    "an array, defaults, `vmap`": DiffraxSweep(_DIFFRAX["an array, defaults"], None, 1),
    "an array, `ForwardMode`, `throw=False`, `vmap`": DiffraxSweep(DIFFRAX, None, 1),
    "a tuple, `ForwardMode`, `throw=False`, `vmap`": DiffraxSweep(SCALARS, None, 1),
    "a tuple, the same, `lax.map` of 256": DiffraxSweep(SCALARS, 256, 1),
    "a tuple, the same, `lax.map` of 1,024": DiffraxSweep(SCALARS, 1024, 1),
    "a tuple, the same, `lax.map` of 1,024, 2 threads": DiffraxSweep(),
}


def _heyoka_sweep(heyoka: Any, threads: int, lanes: int, options: Any, batch: Any, rtol: float) -> Solver:
    return heyoka_sweep(heyoka, batch, threads, rtol, lanes, options)


def _diffrax_sweep(method: str, setting: DiffraxSweep, batch: Any, rtol: float) -> Solver:
    return diffrax_sweep(batch, method, rtol, setting)


def _casadi_sweep(casadi: Any, options: Any, batch: Any, rtol: float) -> Solver:
    return casadi_sweep(casadi, batch, 2, rtol, options)


# -- measuring ----------------------------------------------------------------------------------


def measure(only: str | None, say: Callable[[str], None] = print) -> Record:
    """Return the records of all settings, or of one peer, ready for JSON."""
    where = machine()
    kinds = {"one trajectory": (single_runs, _prepare_runs), "sweeps": (sweeps, _prepare_sweeps)}
    found: Record = {"machine": where, "cases": CASES}
    for kind, (settings, prepare) in kinds.items():
        tried = [one for one in settings() if only in (None, one.peer)]
        found[kind] = []
        for scene, rtol in COLUMNS:
            own = [one for one in tried if scene in one.scenes]
            tasks, errors, share = prepare(scene, rtol, own)
            timings = interleaved(tasks, rounds=ROUNDS, seconds_each=1.0)
            found[kind] += [
                {
                    "peer": one.peer,
                    "setting": one.setting,
                    "chosen": one.chosen,
                    "scene": scene,
                    "rtol": rtol,
                    "us": {name: value / share for name, value in timings[i].microseconds().items()},
                    "error": errors[i],
                }
                for i, one in enumerate(own)
            ]
            say(f"{kind}, {scene}, rtol {rtol:g}: {len(own)} settings")
    return found


Timed = tuple[dict[int, Callable[[], Any]], list[float], int]
"""What is timed by number of the setting, errors, and the number of cases."""


def _prepare_runs(scene: str, rtol: float, tried: Sequence[Tried]) -> Timed:
    ready = [one.prepare(PROBLEMS[scene], rtol) for one in tried]
    return {i: one.run for i, one in enumerate(ready)}, [one.error for one in ready], 1


def _prepare_sweeps(scene: str, rtol: float, tried: Sequence[Tried]) -> Timed:
    batch = BATCHES[scene](CASES)
    exact = sample_states(batch)
    ready = [one.prepare(batch, rtol) for one in tried]
    errors = [float(np.abs(sample() - exact).max()) for _, sample, _ in ready]
    return {i: run for i, (run, _, _) in enumerate(ready)}, errors, CASES


# -- the page -----------------------------------------------------------------------------------


def section(result: Record) -> str:
    """Return the tables of a result, as docs/peer_settings.md shows them."""
    parts = [f"Measured on {describe_machine(result['machine'])}."]
    for kind, text in (
        (
            "one trajectory",
            "Run time in microseconds for 10 s of motion, lower quartile; in brackets, the error at the end:",
        ),
        (
            "sweeps",
            f"Time in microseconds for each of {result['cases']:,} cases, lower quartile; in brackets, the largest"
            " error of eight:",
        ),
    ):
        if records := result[kind]:
            head = [kind, *(f"{scene}, rtol {rtol:.0e}" for scene, rtol in SHOWN)]
            parts += [text, markdown_table(head, _rows(records))]
    return "\n\n".join(parts)


def _rows(records: Sequence[Record]) -> Iterator[list[str]]:
    """Yield a row for each setting that is chosen, or the fastest one of its program in a column."""
    for peer, setting, chosen in dict.fromkeys((r["peer"], r["setting"], r["chosen"]) for r in records):
        own = {(r["scene"], r["rtol"]): r for r in records if (r["peer"], r["setting"]) == (peer, setting)}
        cells = {key: f"{r['us']['low']:.3g} ({r['error']:.0e})" for key, r in own.items()}
        if chosen or any(column in own and own[column] is _fastest(records, peer, column) for column in SHOWN):
            name = f"{peer}: {setting}"
            yield [f"**{name}**" if chosen else name, *(cells.get(column, "-") for column in SHOWN)]


def _fastest(records: Sequence[Record], peer: str, column: tuple[str, float]) -> Record:
    own = (r for r in records if r["peer"] == peer and (r["scene"], r["rtol"]) == column)
    return min(own, key=lambda r: float(r["us"]["low"]))


def main() -> None:
    """Measure, print, and keep if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="PEER", help="measure one peer (SciPy, heyoka, diffrax, CasADi or PyDy)")
    parser.add_argument("--save", action="store_true", help="write peer_settings.json and docs/peer_settings.md")
    options = parser.parse_args()
    if options.only and options.save:
        parser.error("--save keeps the settings of all peers: leave out --only")
    result = measure(options.only)
    text = section(result)
    print(f"\n{text}")
    if options.save:
        FILE.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        report.fill_page(Path(report.ROOT) / "docs" / "peer_settings.md", MARKERS, text)


if __name__ == "__main__":
    main()
