"""Write docs/pictures: coins.gif, speed.png, and the pictures of docs/textbook_examples.md and of pages on robots.

Run it from the repository's root: ``python docs/generate_pictures.py``; ``quick`` leaves out the animations. speed.png
is drawn from the committed benchmark.
"""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")

import matplotlib.pyplot as plt
import numpy as np
from coins_picture import draw_coins

FOLDER = Path(__file__).parent / "pictures"
BENCH = FOLDER.parents[1] / "benchmarks" / "results" / "bench.json"
SOLVERS = {
    "dalembert llvm minimal taylor": "dalembert",
    "heyoka by hand taylor, fast_math": "heyoka",
    "diffrax by hand Tsit5, ForwardMode": "diffrax",
    "SciPy by hand dop853, numba rhs": "SciPy",
    "CasADi by hand cvodes, Adams": "CasADi",
}


def draw_examples() -> None:
    """Draw the motions that the code of docs/textbook_examples.md computes."""
    names = _computed("textbook_examples.md")
    plate, sphere, edge, sleigh = (names[name] for name in ("plate", "sphere", "edge", "sleigh"))
    _draw(
        "13.4.2", _over_time(plate, {"theta": "theta [rad]"}), _over_time(plate, {"N_A": "N_A [N]", "N_Q": "N_Q [N]"})
    )
    angles = {name: f"{name} [rad]" for name in ("psi", "theta", "phi")}
    _draw("13.4.3", _path(sphere), _over_time(sphere, angles))
    _draw(
        "13.4.4",
        _over_time(edge, {"theta": "theta [rad]", "psi": "psi [rad]"}),
        _over_time(edge, {"Z": "Z [N]"}),
    )
    _draw("13.4.6", _path(sleigh), _over_time(sleigh, {"theta_dot": "theta_dot [rad/s]", "energy": "energy [J]"}))


def draw_robots() -> None:
    """Draw the arm that follows a motion, and the one that is identified, as the code of their pages moves it."""
    names = _computed("robots.md", "driven")
    follows = names["driven"].simulate((0, 2), names["start"], {})
    follows(np.linspace(0, 2, 31)).animate(fps=15).save(FOLDER / "arm.gif")
    names = _computed("identify_robot.md", "run")
    names["run"].animate(fps=10).save(FOLDER / "excited_arm.gif")


def _computed(page: str, wanted: str = "") -> dict[str, Any]:
    """Return the names that the code of a page defines: all, or up to the block that defines a wanted one."""
    names: dict[str, Any] = {}
    text = (FOLDER.parent / page).read_text(encoding="utf-8")
    for code in re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S):
        exec(compile(code, page, "exec"), names)
        if wanted in names:
            break
    return names


def _path(run: Any) -> Any:
    def draw(axes: Any) -> None:
        fine = run(np.linspace(run.t[0], run.t[-1], 600))
        axes.plot(fine["x"], fine["y"])
        axes.plot(fine["x"][0], fine["y"][0], "o", color="C0")
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", "datalim")

    return draw


def _over_time(run: Any, labels: dict[str, str]) -> Any:
    def draw(axes: Any) -> None:
        fine = run(np.linspace(run.t[0], run.t[-1], 600))
        for name, label in labels.items():
            axes.plot(fine.t, fine[name], label=label)
        axes.axhline(0, color="0.8", lw=0.8, zorder=0)
        axes.set(xlabel="t [s]")
        axes.legend(fontsize="small")

    return draw


def _draw(section: str, *panels: Any) -> None:
    figure, grid = plt.subplots(1, len(panels), figsize=(7.2, 2.6), dpi=90, layout="constrained")
    for axes, panel in zip(grid, panels, strict=True):
        panel(axes)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(FOLDER / f"textbook_{section}.png", metadata={"Software": None})
    plt.close(figure)


def main() -> None:
    """Draw the pictures."""
    draw_examples()
    draw_speed()
    if "quick" not in sys.argv:
        draw_coins(FOLDER / "coins.gif")
        draw_robots()


def draw_speed() -> None:
    """Draw run time against error for two scenes, a line a solver, from the committed benchmark."""
    records = json.loads(BENCH.read_text(encoding="utf-8"))["precision"]
    figure, grid = plt.subplots(1, 2, figsize=(7.2, 3.0), dpi=110, sharey=True, layout="constrained")
    for axes, scene in zip(grid, ("sleigh", "unequal sphere"), strict=True):
        for label, name in SOLVERS.items():
            own = [r for r in records if (r["scene"], r["label"]) == (scene, label)]
            line = sorted((r["error"], r["run_us"]["median"]) for r in own)
            axes.loglog(*zip(*line, strict=True), "o-", ms=3, lw=2.5 if name == "dalembert" else 1.2, label=name)
        axes.set(title=f"{scene}, 10 s", xlabel="error at the end", xlim=(1e-4, 1e-14))
        axes.grid(alpha=0.3)
    grid[0].set_ylabel("run time [us]")
    grid[1].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.02, 0.5))
    figure.savefig(FOLDER / "speed.png", metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    main()
