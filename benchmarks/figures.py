"""Figures of the demo and of the benchmarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from measure import growth_exponent

__all__ = [
    "drift_picture",
    "energy_picture",
    "growth_picture",
    "scaling_picture",
    "sleigh_picture",
    "sphere_picture",
    "sweep_picture",
    "work_precision",
]

COLOURS = {
    "dalembert llvm": "#0072B2",
    "dalembert numba": "#000000",
    "dalembert jax": "#D55E00",
    "dalembert numpy": "#009E73",
    "SciPy": "#999999",
    "heyoka": "#CC79A7",
    "diffrax": "#E69F00",
    "CasADi": "#56B4E9",
}
_PLAIN = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
_ROUNDING = 1e-16
_MARKERS = "osD^vP"
_LINES = {"minimal": "-", "projected": "--", "augmented": ":", "by hand": "-"}


def _save(figure: Figure, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    return path


def work_precision(records: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Draw microseconds of a run against the error at the end, one panel a scene."""
    scenes = list(dict.fromkeys(record["scene"] for record in records))
    figure = Figure(figsize=(6.4 * len(scenes), 6.0), layout="constrained")
    panels = figure.subplots(1, len(scenes), sharey=True, squeeze=False)[0]
    methods: dict[str, list[str]] = {}
    for panel, scene in zip(panels, scenes, strict=True):
        labels = dict.fromkeys(record["label"] for record in records if record["scene"] == scene)
        for label in labels:
            line = [r for r in records if r["scene"] == scene and r["label"] == label]
            known = methods.setdefault(line[0]["solver"], [])
            if line[0]["method"] not in known:
                known.append(line[0]["method"])
            time = [r["run_us"]["median"] for r in line]
            spread = [
                [t - r["run_us"]["low"] for t, r in zip(time, line, strict=True)],
                [r["run_us"]["high"] - t for t, r in zip(time, line, strict=True)],
            ]
            panel.errorbar(
                [r["error"] for r in line],
                time,
                yerr=np.maximum(spread, 0.0),
                label=label,
                color=COLOURS.get(line[0]["solver"], "brown"),
                linestyle=_LINES.get(line[0]["formulation"], "-."),
                marker=_MARKERS[known.index(line[0]["method"]) % len(_MARKERS)],
                markersize=4.5,
                linewidth=1.3,
                elinewidth=0.8,
            )
        panel.set(xscale="log", yscale="log", title=f"{scene}, 10 s", xlabel="largest error at the end")
        panel.invert_xaxis()
        panel.grid(alpha=0.3, which="major")
    panels[0].set_ylabel("microseconds of a run (median, quartiles)")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return _save(figure, path)


def sweep_picture(records: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Draw microseconds of a case against the error at the end, one panel a scene."""
    scenes = list(dict.fromkeys(record["scene"] for record in records))
    figure = Figure(figsize=(6.4 * len(scenes), 5.2), layout="constrained")
    panels = figure.subplots(1, len(scenes), sharey=True, squeeze=False)[0]
    labels = list(dict.fromkeys(record["label"] for record in records))
    for panel, scene in zip(panels, scenes, strict=True):
        for i, label in enumerate(labels):
            line = [r for r in records if r["scene"] == scene and r["label"] == label]
            solver = next((name for name in COLOURS if label.startswith(name)), "")
            panel.plot(
                [r["error"] for r in line],
                [r["us"]["median"] for r in line],
                label=label,
                color=COLOURS.get(solver, "brown"),
                linestyle=":" if "1 thread" in label else "-",
                marker=_MARKERS[i % len(_MARKERS)],
                markersize=4.5,
            )
        panel.set(xscale="log", yscale="log", title=f"{scene}, many cases of 10 s", xlabel="largest error at the end")
        panel.invert_xaxis()
        panel.grid(alpha=0.3, which="major")
    panels[0].set_ylabel("microseconds of a case (median)")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8, frameon=False
    )
    return _save(figure, path)


def scaling_picture(records: Sequence[Mapping[str, Any]], kane: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Draw seconds from scene to program, and operations of the right-hand side, over the number of links."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    seconds, operations = figure.subplots(1, 2)
    for colour, chain in zip(_PLAIN, dict.fromkeys(record["chain"] for record in records), strict=False):
        line = [r for r in records if r["chain"] == chain and "total" in r]
        n = [r["n"] for r in line]
        equations = [r["total"] - r["seconds"]["lower"] for r in line]
        seconds.plot(n, [r["total"] for r in line], "o-", color=colour, label=f"{chain}: scene to program")
        seconds.plot(n, equations, "s--", color=colour, markersize=4, label=f"{chain}: scene to reduced equations")
        for kernel, style in (("rhs", "o-"), ("mass_matrix", "s--")):
            made = [r for r in line if kernel in r]
            sizes, flops = [r["n"] for r in made], [r[kernel]["flops"] for r in made]
            larger = [(k, f) for k, f in zip(sizes, flops, strict=True) if k >= 5]
            slope = growth_exponent([k for k, _ in larger], [f for _, f in larger])
            label = f"{chain}: {kernel.replace('_', ' ')}" + (f" ~ n^{slope:.1f}" if slope else "")
            operations.plot(sizes, flops, style, color=colour, markersize=4, label=label)
    if kane:
        n = [r["n"] for r in kane]
        seconds.plot(n, [r["total"] for r in kane], "^-", color="#999999", label="planar: SymPy KanesMethod and CSE")
        both = [r["operations"] for r in kane]
        operations.plot(n, both, "^-", color="#999999", label="planar: KanesMethod, mass matrix and forcing")
    seconds.set(xscale="log", yscale="log", xlabel="links", ylabel="seconds")
    operations.set(xscale="log", yscale="log", xlabel="links", ylabel="floating-point operations")
    for panel in (seconds, operations):
        ticks = [n for n in sorted({r["n"] for r in records}) if n in (2, 5, 10, 20, 40)]
        panel.set_xticks(ticks, [str(n) for n in ticks], minor=False)
        panel.minorticks_off()
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    return _save(figure, path)


PROGRAM_COLOURS = {
    "dalembert": "k",
    "PyDy": "C4",
    "Pinocchio": "C0",
    "MuJoCo": "C1",
    "Drake": "C2",
    "Exudyn": "C3",
}
"""Colours of programs for mechanics, as all pictures have them."""


def growth_picture(found: Sequence[Any], path: Path) -> Path:
    """Draw microseconds of an evaluation over the number of bodies, a panel a chain, and seconds to a trajectory.

    `found` has the attributes name, bodies, total and evaluations (by the names of programs).
    """
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    chains = list(dict.fromkeys(g.name for g in found))
    *panels, seconds = figure.subplots(1, len(chains) + 1)
    for panel, chain in zip(panels, chains, strict=True):
        line = [g for g in found if g.name == chain]
        for program, colour in PROGRAM_COLOURS.items():
            points = [(g.bodies, g.evaluations[program]) for g in line if program in g.evaluations]
            if points:
                width = 2.2 if program == "dalembert" else 1.2
                panel.plot(*zip(*points, strict=True), "o-", markersize=3, color=colour, lw=width, label=program)
        panel.set(title=f"{chain} chain: accelerations", ylabel="microseconds of an evaluation")
    for chain, style in zip(chains, ("o-", "s--"), strict=False):
        line = [g for g in found if g.name == chain]
        seconds.plot([g.bodies for g in line], [g.total for g in line], style, color="k", markersize=3, label=chain)
    seconds.set(title="dalembert: scene to trajectory", ylabel="seconds of the processor")
    for panel in (*panels, seconds):
        panel.set(xscale="log", yscale="log", xlabel="bodies")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    return _save(figure, path)


def sleigh_picture(motion: Any, b: float, path: Path) -> Path:
    """Draw the path of the sleigh's blade, with the body's axis at several times."""
    fine = motion(np.linspace(motion.t[0], motion.t[-1], 800))
    still = motion(motion.t[0] + (motion.t[-1] - motion.t[0]) * np.linspace(0, 1, 13) ** 1.5)
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    panel = figure.subplots()
    panel.plot(fine["x"], fine["y"], color=_PLAIN[0], linewidth=1.6, label="path of the blade's contact C")
    length = 3 * b
    for k, (x, y, theta) in enumerate(zip(still["x"], still["y"], still["theta"], strict=True)):
        ends = x + length * np.cos(theta) * np.array([0, 1]), y + length * np.sin(theta) * np.array([0, 1])
        panel.plot(*ends, color=_PLAIN[1], linewidth=2.2, solid_capstyle="round", label=None if k else "axis S.x")
        panel.plot(x, y, "o", color=_PLAIN[0], markersize=4)
        panel.plot(
            *(x + b * np.cos(theta), y + b * np.sin(theta)),
            "o",
            color="black",
            markersize=3.5,
            label=None if k else "mass centre G",
        )
    start = still.t[0]
    panel.annotate(f"t = {start:g} s", (still["x"][0], still["y"][0]), (6, -12), textcoords="offset points")
    panel.annotate(f"t = {still.t[-1]:g} s", (still["x"][-1], still["y"][-1]), (8, -4), textcoords="offset points")
    panel.set(xlabel="x [m]", ylabel="y [m]", title="Chaplygin sleigh (example 13.4.6)", aspect="equal")
    panel.set_adjustable("datalim")
    panel.grid(alpha=0.3)
    panel.legend()
    return _save(figure, path)


def sphere_picture(motion: Any, omega: Any, path: Path) -> Path:
    """Draw the path of the rolling sphere, the angles and the angular velocity `omega` (n_t, 3)."""
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    plane, angles, spin = figure.subplots(1, 3)
    plane.plot(motion["x"], motion["y"], color=_PLAIN[0])
    every = slice(None, None, max(1, len(motion.t) // 10))
    plane.plot(motion["x"][every], motion["y"][every], "o", color=_PLAIN[0], markersize=4)
    plane.set(xlabel="x [m]", ylabel="y [m]", title="path of the centre", aspect="equal", adjustable="datalim")
    for colour, name in zip(_PLAIN, ("psi", "theta", "phi"), strict=False):
        angles.plot(motion.t, motion[name], color=colour, label=name)
    angles.set(xlabel="t [s]", ylabel="[rad]", title="angles")
    for colour, axis, component in zip(_PLAIN, "xyz", omega.T, strict=False):
        spin.plot(motion.t, component, color=colour, label=f"along N.{axis}")
    spin.set(xlabel="t [s]", ylabel="[rad/s]", title="angular velocity")
    for panel in (plane, angles, spin):
        panel.grid(alpha=0.3)
    angles.legend()
    spin.legend(loc="center right", bbox_to_anchor=(1.0, 0.62))
    return _save(figure, path)


def energy_picture(runs: Mapping[str, Any], path: Path, title: str) -> Path:
    """Draw the relative energy error of trajectories over time, by label."""
    figure = Figure(figsize=(7.5, 4.2), layout="constrained")
    panel = figure.subplots()
    for number, (label, motion) in enumerate(runs.items()):
        error = np.abs(motion["energy"] / motion["energy"][0] - 1.0)[1:]
        panel.semilogy(
            motion.t[1:],
            np.maximum(error, _ROUNDING),
            ("-", "--")[number % 2],
            marker=".",
            markersize=4,
            linewidth=1.1,
            label=label,
            color=_PLAIN[number // 2 % len(_PLAIN)],
        )
    panel.set(xlabel="t [s]", ylabel="|E/E(0) - 1|, below 1e-16 drawn there", title=title)
    panel.grid(alpha=0.3)
    figure.legend(loc="outside lower center", fontsize=8, ncols=4, frameon=False)
    return _save(figure, path)


def drift_picture(runs: Mapping[str, Any], path: Path, title: str) -> Path:
    """Draw the position and the velocity violation of one constraint over the steps, by formulation."""
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    panels = figure.subplots(1, 2)
    for colour, (label, motion) in zip(_PLAIN, runs.items(), strict=False):
        steps = np.arange(len(motion.t))
        for panel, violation in zip(panels, (motion.constraint_violation, motion.velocity_violation), strict=True):
            chunks = np.array_split(np.abs(violation[:, 0]), 400)
            largest = np.maximum([chunk.max() for chunk in chunks], 1e-17)
            panel.plot(np.linspace(0, steps[-1], len(largest)), largest, color=colour, label=label)
    for panel, name in zip(panels, ("position: |x^2 + y^2 - L^2|", "velocity: |2 (x x_dot + y y_dot)|"), strict=True):
        panel.set(yscale="log", xlabel="steps", ylabel="violation (largest in 250 steps)", title=name)
        panel.grid(alpha=0.3)
        panel.legend()
    figure.suptitle(title)
    return _save(figure, path)
