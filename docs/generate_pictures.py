"""Write docs/pictures/sleighs.gif: Chaplygin sleighs that differ in the offset b of their mass centre.

Run it from the repository's root: ``python docs/generate_pictures.py``.
"""

from __future__ import annotations

import os
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter

import dalembert as da

FOLDER = Path(__file__).parent / "pictures"
OFFSETS = (0.08, 0.12, 0.2, 0.3, 0.45)
END, FRAMES, FPS = 12.0, 90, 18
START = {"x": 0, "y": 0, "theta": 0.0, "x_dot": 0.2, "theta_dot": 2.5}


def main() -> None:
    """Simulate the sleighs and draw them."""
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    times = np.linspace(0.0, END, FRAMES)
    runs = [model.simulate((0, END), START, {"m": 1, "b": b, "I_C": 0.6}, t_eval=times) for b in OFFSETS]
    figure, panel = plt.subplots(figsize=(5.6, 3.2), dpi=80, layout="constrained")
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 0.85, len(runs)))
    paths = [panel.plot([], [], color=c, lw=1.3)[0] for c in colors]
    blades = [panel.plot([], [], color=c, lw=4, solid_capstyle="round")[0] for c in colors]
    centres = [
        panel.plot([], [], "o", color=c, ms=5, label=f"b = {b:g} m")[0] for c, b in zip(colors, OFFSETS, strict=True)
    ]
    x, y = np.concatenate([run["x"] for run in runs]), np.concatenate([run["y"] for run in runs])
    panel.set(xlim=(x.min() - 0.5, x.max() + 0.5), ylim=(y.min() - 0.5, y.max() + 0.5), aspect="equal")
    panel.set(xlabel="x [m]", ylabel="y [m]")
    panel.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.02, 0.5))
    figure.draw_without_rendering()
    figure.set_layout_engine("none")

    def draw(k: int) -> None:
        for run, b, path, blade, centre in zip(runs, OFFSETS, paths, blades, centres, strict=True):
            along = 0.18 * np.array([np.cos(run["theta"][k]), np.sin(run["theta"][k])])
            at = np.array([run["x"][k], run["y"][k]])
            path.set_data(run["x"][: k + 1], run["y"][: k + 1])
            blade.set_data(*np.transpose([at - along, at + along]))
            centre.set_data(*(at + along * b / 0.18)[:, np.newaxis])

    FOLDER.mkdir(exist_ok=True)
    FuncAnimation(figure, draw, frames=FRAMES).save(FOLDER / "sleighs.gif", writer=PillowWriter(FPS))


if __name__ == "__main__":
    main()
