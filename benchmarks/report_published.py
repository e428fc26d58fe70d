"""Run the published multibody benchmarks that scenes can express and write docs/published.md.

``python benchmarks/report_published.py`` takes about a minute. Times are minima over calls; what is measured beside
them is deterministic.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from exact import ROOT  # puts tests/ on the path
from measure import machine

import dalembert as da
from hard_cases import hard_case
from hard_cases.case import HardCase, published_reference, reference
from hard_cases.flexible_crank import flexible_crank
from hard_cases.linkages import bricard, forty_windows, linear_benchmark, spring_linkage_scene
from hard_cases.machines import bicycle_linearized, bicycle_scene

OPENSIM = "OpenSim"
"""L. Tagliapietra et al., MBS benchmarks in OpenSim, help/benchmarks/*.rst."""

CALLS = 7


@dataclass(frozen=True)
class Row:
    """A row of the table: what is run, and what is published on it.

    Attributes
    ----------
    title, quantity : str
    error, seconds : float
        Ours.
    theirs : str
        Published times and machines.
    remark : str
    """

    title: str
    quantity: str
    error: float
    seconds: float
    theirs: str
    remark: str = ""

    def text(self) -> str:
        """Return the row as Markdown."""
        error = "0" if self.error == 0.0 else f"{self.error:.0e}"
        return (
            f"| {self.title} | {self.quantity} | {error} | {1e3 * self.seconds:.3g} |"
            f" {self.theirs or '-'} | {self.remark} |"
        )


@dataclass(frozen=True)
class Motion:
    """A motion of the table: a case, how it is run, and what is published."""

    title: str
    case: Callable[[], HardCase]
    end: float
    theirs: str = ""
    method: str = "auto"
    rtol: float = 1e-12
    remark: str = ""

    def row(self) -> Row:
        """Measure."""
        case = self.case()
        model = case.compile("auto")
        times = [0.0, *(t for t in case.times(all_of_them=True) if t <= self.end)]
        span = (0.0, times[-1])
        options = {"method": self.method, "rtol": self.rtol, "atol": self.rtol / 100, "dense": False}
        seconds, run = least_seconds(
            lambda: model.simulate(span, case.initial, case.parameters, t_eval=times, **options)
        )
        if not run.success:
            raise SystemExit(f"{self.title}: {run.message}")
        quantity = case.quantity or ", ".join(map(str, case.observed))
        return Row(self.title, f"{quantity}; {span[1]:g} s", case.error(run), seconds, self.theirs, self.remark)


def least_seconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the least time of some calls after a first one, which compiles, and what the last returned."""
    found, result = [], call()
    for _ in range(CALLS):
        begin = time.perf_counter()
        result = call()
        found.append(time.perf_counter() - begin)
    return min(found), result


EXUDYN = "Exudyn, implicit steps of 10 ms: 0.0776 s on an Intel i9"

MOTIONS = (
    Motion(
        "IFToMM A01, pendulum",
        lambda: hard_case("pendulum, Cartesian (IFToMM A01)"),
        10.0,
        f"0.637 s for 10 s ({OPENSIM})",
    ),
    Motion(
        "IFToMM A02, two windows",
        lambda: hard_case("four-bar through its singular position"),
        10.0,
        f"0.455 s for 10 s ({OPENSIM}); {EXUDYN}",
        remark="through all singular positions",
    ),
    Motion(
        "IFToMM A02, forty windows",
        forty_windows,
        4.0,
        method="taylor",
        remark="through all singular positions",
    ),
    Motion(
        "IFToMM A03, Andrews' mechanism",
        lambda: hard_case("Andrews' squeezing mechanism"),
        0.05,
        f"0.384 s for 0.05 s ({OPENSIM})",
        rtol=1e-10,
        remark="also in the test set for IVP solvers",
    ),
    Motion("IFToMM A04, Bricard's mechanism", bricard, 10.0, f"0.258 s for 10 s ({OPENSIM})"),
    Motion(
        "IFToMM A05, flyball governor",
        lambda: hard_case("stiff flyball governor"),
        10.0,
        f"0.233 s for 10 s ({OPENSIM})",
        rtol=1e-10,
        remark="stiff",
    ),
    Motion("IVP test set, car axis", lambda: hard_case("car axis"), 3.0),
    Motion(
        "IVP test set, slider-crank with flexible rod",
        flexible_crank,
        0.1,
        rtol=1e-10,
        remark="the published start and end have some nine digits; published: 180,090 steps of MEBDFI",
    ),
)


def linear_row() -> Row:
    """Return the row of the four bars with a diagonal spring."""
    entry = published_reference("iftomm_four_bar_with_spring")["values"]
    model = da.compile_model(spring_linkage_scene())
    seconds, (angle, eigenvalues) = least_seconds(lambda: linear_benchmark(model))
    expected = complex(float(entry["real"]), float(entry["imaginary"]))
    error = max(abs(angle - float(entry["phi"])), abs(eigenvalues[1] - expected))
    return Row(
        "IFToMM, four bars with a diagonal spring",
        "equilibrium and eigenvalues",
        float(error),
        seconds,
        "EoM: eigenvalues to 2.4e-11, time given as 7.5, without a unit (Intel Core i7-2600)",
        f"the published equilibrium differs by {abs(angle - 2.23433101898):.0e}; errors are to the closed form",
    )


def bicycle_row() -> Row:
    """Return the row of the Whipple bicycle."""
    model = da.compile_model(bicycle_scene(), formulation="projected")
    table = reference("whipple_bicycle_eigenvalues")["values"]["table"]
    seconds, _ = least_seconds(lambda: bicycle_linearized(model, 5))
    worst = 0.0
    for speed in range(11):
        theirs = np.sort_complex([complex(float(a), float(b)) for a, b in table[str(speed)]["mine"]])
        worst = max(worst, float(np.max(np.abs(np.sort_complex(bicycle_linearized(model, speed)) - theirs))))
    return Row("Whipple bicycle", "44 eigenvalues; 0 to 10 m/s", worst, seconds, "", "time of one speed")


TEMPLATE = """# Published multibody benchmarks

Compare the errors and times of dalembert with published ones. Errors are the largest over the observed quantities and
times, relative to max(scale, size of the value). Times are the least of {calls} calls once compiled, on {machine}.
Published times are of other machines and tolerances; those of OpenSim 3.2 are of an Intel Core i5-4570 at 3.2 GHz.

| benchmark | quantity and span | our error | our time, ms | published time | remark |
| --- | --- | ---: | ---: | --- | --- |
{rows}

The references for A01 to A05, the car axis and Andrews' mechanism have 20 digits and more, from closed forms,
quadrature or series on equations written by hand. That of the flexible slider-crank is the published end of the test
set. For Bricard's mechanism a number of Exudyn's own test, by implicit steps of 1 ms, agrees to 1.3e-6. For the four
bars with a spring, only digits of the equilibrium are published.

The wheelset of the test set for IVP solvers is missing: its creep forces depend nonlinearly on the normal reactions,
and reactions must enter actions linearly.

`python benchmarks/report_published.py` writes this page; the scenes and references are in `tests/hard_cases`.
"""


def main() -> None:
    """Measure and write."""
    rows = []
    for motion in MOTIONS:
        rows.append(motion.row().text())
        print(rows[-1], flush=True)
    rows += [linear_row().text(), bicycle_row().text()]
    print(*rows[-2:], sep="\n")
    known = machine()
    place = Path(ROOT) / "docs" / "published.md"
    text = TEMPLATE.format(machine=f"{known['cores']} cores, {known['cpu']}", calls=CALLS, rows="\n".join(rows))
    place.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
