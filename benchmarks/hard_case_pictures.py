"""Pictures of hard cases, where they say more than an error: ``python benchmarks/hard_case_pictures.py`` draws them.

They are docs/hard_cases_motions.png, which the page of `report_hard_cases` shows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from exact import ROOT  # puts tests/ on the path

from hard_cases import hard_case

__all__ = ["draw_motions"]


def _run(name: str, formulation: str, end: float, count: int = 2000, **options: Any) -> Any:
    case = hard_case(name)
    times = np.linspace(0.0, end, count)
    model = case.compile(formulation)
    options = {"method": "dop853", "rtol": 1e-12, "atol": 1e-14} | options
    return model.simulate((0.0, end), case.initial, case.parameters, t_eval=times, max_steps=1_000_000, **options)


def _path(axes: Any, name: str, end: float) -> None:
    run = _run(name, "minimal", end)
    axes.plot(run["x"], run["y"])
    axes.set_aspect("equal", "datalim")
    axes.set_xlabel("x")
    axes.set_ylabel("y")


def _tumbles(axes: Any) -> None:
    run = _run("free body near its unstable axis", "minimal", 100.0)
    for name in hard_case("free body near its unstable axis").observed[:3]:
        axes.plot(run.t, run[name])
    axes.set_xlabel("time")
    axes.set_ylabel("angular velocity in the body")


def _squeezer(axes: Any) -> None:
    run = _run("Andrews' squeezing mechanism", "projected", 0.03)
    for name in ("be", "ga", "ph", "de", "ep"):
        axes.plot(1e3 * run.t, run[name], label=name)
    axes.set_ylim(-2, 4)
    axes.set_xlabel("time in ms")
    axes.set_ylabel("angles (be turns 2.5 times)")
    axes.legend(fontsize=6)


def _chaos(axes: Any) -> None:
    tight = _run("double pendulum, angles", "minimal", 40.0, method="taylor", rtol=1e-16, atol=1e-18)
    for rtol in (1e-6, 1e-9, 1e-12, 1e-15):
        run = _run("double pendulum, angles", "minimal", 40.0, rtol=rtol, atol=rtol / 100)
        gap = np.max(np.abs(run.q - tight.q), axis=1)
        axes.semilogy(run.t[1:], np.maximum(gap[1:], 1e-17), label=f"rtol {rtol:g}")
    axes.set_xlabel("time")
    axes.set_ylabel("distance from the run at 1e-16")
    axes.legend(fontsize=6)


def _singular(axes: Any) -> None:
    run = _run("four-bar through its singular position", "projected", 2.0, rtol=1e-8, atol=1e-9)
    axes.plot(run.t, np.abs(np.cos(run["phi0"])))
    axes.set_xlabel("time")
    axes.set_ylabel("|cos| of the cranks: no rank at 0")


def draw_motions(path: Path) -> None:
    """Draw six of the cases."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(2, 3, figsize=(11, 6.5))
    panels = {
        "sleigh against its stable direction": lambda axes, name: _path(axes, name, 40.0),
        "sphere on a tilted turntable": lambda axes, name: _path(axes, name, 20.0),
        "free body near its unstable axis": lambda axes, _: _tumbles(axes),
        "Andrews' squeezing mechanism": lambda axes, _: _squeezer(axes),
        "double pendulum, angles": lambda axes, _: _chaos(axes),
        "four-bar through its singular position": lambda axes, _: _singular(axes),
    }
    for axes, (name, draw) in zip(grid.ravel(), panels.items(), strict=True):
        draw(axes, name)
        axes.set_title(name, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=100, metadata={"Software": None})


if __name__ == "__main__":
    draw_motions(ROOT / "docs" / "hard_cases_motions.png")
