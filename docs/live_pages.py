"""Write pages that simulate: ``python docs/live_pages.py FOLDER``; the site has them in ``live/``.

Their scenes are ready scenes with shapes, and those of the gallery, which begin as in their scripts. They need the
package ziglang (extra "export").
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

from sympy import Symbol, cos, symbols
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.model.model import CompiledModel

GALLERY = Path(__file__).parent / "gallery"
COMPILING = "model = da.compile_model(scene"
"""What follows the scene in a script of the gallery."""


@dataclass(frozen=True)
class Run:
    """What a page begins with: a model, a time span [s], initial values, parameters, and events."""

    model: Any
    t_span: tuple[float, float]
    initial: Mapping[Any, float]
    parameters: Mapping[Any, float]
    events: Sequence[da.Event] = ()


class Begun(BaseException):
    """The first run of a script, which ends there."""


@dataclass(frozen=True)
class Live:
    """A page: what makes its run, its sliders, and its end [s], unless it is that of the run."""

    begin: Callable[[], Run]
    sliders: Mapping[str, tuple[float, float]]
    end: float | None = None


def of_gallery(name: str) -> Callable[[], Run]:
    """Return a function that returns the first run of a script of the gallery."""

    @cache
    def begin() -> Run:
        def first(model: Any, *given: Any, events: Sequence[da.Event] = (), **_: Any) -> None:
            raise Begun(Run(model, *given, events=events))

        text = (GALLERY / f"{name}.py").read_text(encoding="utf-8")
        with mock.patch.object(CompiledModel, "simulate", first):
            try:
                exec(compile(text, name, "exec"), {})
            except Begun as begun:
                run: Run = begun.args[0]
                return run
        raise ValueError(f"the script {name!r} simulates nothing")

    return begin


def scene_of_gallery(name: str) -> da.Scene:
    """Return the scene of a script of the gallery."""
    names: dict[str, Any] = {}
    text = (GALLERY / f"{name}.py").read_text(encoding="utf-8").partition(COMPILING)[0]
    exec(compile(text, name, "exec"), names)
    scene: da.Scene = names["scene"]
    return scene


def parameter(scene: da.Scene, name: str) -> Symbol:
    """Return a parameter of a scene with its assumptions."""
    body = scene.bodies[0]
    found = body.mass.free_symbols | body.masscenter.pos_from(scene.origin).to_matrix(scene.frame).free_symbols
    return next(symbol for symbol in found if symbol.name == name)


def sleigh() -> Run:
    """Return the sleigh with a shape."""
    scene = da.scenes.chaplygin_sleigh()
    b = parameter(scene, "b")
    scene.add_shapes({"sleigh": da.Box(3 * b, 1.4 * b, 0.5 * b), "ice": da.Ground(scene.frame.z)})
    start = {"x": 0, "y": 0, "theta": 0, "x_dot": 0.2, "theta_dot": 2.5}
    return Run(da.compile_model(scene, outputs=["Y"]), (0, 12), start, {"m": 1, "b": 0.2, "I_C": 0.6})


def sphere() -> Run:
    """Return the rolling sphere with shapes."""
    scene = da.scenes.rolling_sphere()
    scene.add_shapes({"sphere": da.Sphere(parameter(scene, "r")), "floor": da.Ground(scene.frame.z)})
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 0.9, "phi": 0, "psi_dot": 1, "theta_dot": 0.6, "phi_dot": 2}
    return Run(da.compile_model(scene), (0, 8), start, {"m": 2, "r": 0.4, "g": 9.81})


def plate() -> Run:
    """Return the plate on its edge with shapes."""
    scene, h = da.scenes.edge_plate(), symbols("h", positive=True)
    scene.add_shapes({"plate": da.Box(3 * h, 2 * h, h / 12), "plane": da.Ground(scene.frame.z)})
    start = {"x": 0, "y": 0, "psi": 0.1, "theta": 1.2, "x_dot": 0.4, "y_dot": 0, "psi_dot": 1.5, "theta_dot": 0.2}
    values = {"m": 1, "A": 0.09, "B": 0.19, "C": 0.28, "F": 0.0, "h": 0.5, "g": 9.81}
    return Run(da.compile_model(scene, outputs=["Z"]), (0, 1), start, values)


def corner_plate() -> Run:
    """Return the plate that leans on a corner with friction, with shapes."""
    scene, l, h = da.scenes.corner_plate(friction=True), symbols("l", positive=True), symbols("h", positive=True)
    corner = scene.origin.locatenew("Q", h * scene.frame.y)
    step = da.Rod(scene.origin, corner)
    scene.add_shapes({"plate": da.Box(2 * l, l / 25, l), "ground": da.Ground(scene.frame.y), "step": step})
    model = da.compile_model(scene, outputs=["N_Q", "F_Q", "N_A"])
    values = {"m": 2, "l": 1, "h": 0.6, "g": 9.81, "F_A": 0.001, "mu": 0.2}
    return Run(model, (0, 1), {"theta": 0.7, "theta_dot": 2.0}, values)


def walker() -> Run:
    """Return the compass walker, whose fall ends the run."""
    walk = of_gallery("a38_compass_walker")()
    fall = da.Event(cos(dynamicsymbols("stance")) - 0.5, direction=-1, terminal=True, name="fall")
    return Run(walk.model, walk.t_span, walk.initial, walk.parameters, [*walk.events, fall])


LEGS = {"stance_dot": (-0.22, -0.18), "swing_dot": (-0.22, -0.15)}
TURNS = {name: (-3.1416, 3.1416) for name in "ab"} | {f"{name}_dot": (-5, 5) for name in "ab"}

PAGES = {
    "sleigh": Live(sleigh, {"b": (0.02, 0.6), "I_C": (0.4, 2), "theta_dot": (-5, 5), "x_dot": (-2, 2)}),
    "rolling_sphere": Live(sphere, {"r": (0.1, 0.8), "psi_dot": (-4, 4), "theta_dot": (-3, 3), "phi_dot": (-4, 4)}),
    "plate": Live(
        plate, {"theta": (0.2, 2.9), "theta_dot": (-3, 3), "psi_dot": (-6, 6), "h": (0.3, 0.7), "F": (-0.1, 0.1)}
    ),
    "corner_plate": Live(
        corner_plate,
        {"mu": (0.01, 1), "theta": (0.4, 1.4), "theta_dot": (-2, 4), "h": (0.3, 0.9), "F_A": (0.001, 20)},
    ),
    "walker": Live(walker, {"slope": (0.002, 0.016), **LEGS}, 20.0),
    "double_pendulum": Live(of_gallery("a02_double_pendulum"), {**TURNS, "l": (0.3, 2), "g": (0, 20)}, 20.0),
    "slider_crank": Live(
        of_gallery("a03_slider_crank"),
        {"alpha_dot": (-20, 20), "M": (-4, 4), "c": (0, 60), "m_c": (0.5, 5), "m_p": (0.2, 3)},
    ),
    "coin": Live(
        of_gallery("a04_rolling_coin"),
        {"lean": (-1.2, 1.2), "heading_dot": (-4, 4), "lean_dot": (-2, 2), "spin_dot": (-12, 12), "r": (0.05, 0.5)},
    ),
    "top": Live(
        of_gallery("a05_gyroscope"),
        {"theta": (0.05, 1.5), "psi_dot": (-6, 6), "phi_dot": (30, 150), "h": (0.03, 0.12)},
    ),
    "turntable": Live(
        of_gallery("a06_turntable"), {"w": (-12, 12), "omega_T_x": (-20, 80), "omega_T_y": (-40, 40)}, 6.0
    ),
    "bouncing_ball": Live(
        of_gallery("a10_bouncing_ball"),
        {"e": (0.01, 1), "y": (0.1, 2), "x_dot": (-2, 2), "y_dot": (-4, 4), "g": (1, 20)},
    ),
    "snakeboard": Live(
        of_gallery("a17_snakeboard"),
        {"A": (-1.2, 1.2), "B": (-1, 1), "w": (1, 8), "L": (0.1, 0.4), "x_dot": (-1, 1)},
    ),
    "satellite": Live(of_gallery("a18_satellite"), {"k_p": (0.1, 5), "k_d": (0.5, 10), "J_x": (2, 20)}),
    "tippe_top": Live(of_gallery("a19_tippe_top"), {"omega_T_z": (20, 300), "mu": (0.05, 0.6), "a": (0.001, 0.006)}),
    "four_bar": Live(of_gallery("a20_four_bar"), {"p": (-0.5, 2), "q": (-1, 1), "w": (-10, 10)}, 2.0),
    "rattleback": Live(
        of_gallery("a23_rattleback"), {"omega_S_z": (-8, 8), "delta": (-0.05, 0.05), "h": (0.002, 0.015)}
    ),
    "bicycle": Live(
        of_gallery("a25_bicycle"),
        {"lean_dot": (-0.8, 0.8), "rear_dot": (12, 30), "c": (0.02, 0.15), "mB": (40, 120), "zB": (-1.2, -0.6)},
        6.0,
    ),
    "rocking_block": Live(
        of_gallery("a39_rocking_block"), {"mu": (0.05, 1), "g": (2, 20), "z": (1.0258, 1.3), "x_dot": (-1, 1)}
    ),
    "squeezing_mechanism": Live(
        of_gallery("a26_andrews"), {"mom": (-0.1, 0.1), "c_0": (1000, 9000), "m7": (0.01, 0.2)}
    ),
    "three_blocks": Live(
        of_gallery("a45_three_blocks"), {"v": (0.01, 0.5), "k": (5, 80), "mu": (0.05, 0.45), "mu_s": (0.46, 1)}
    ),
    "backlash": Live(
        of_gallery("a46_backlash"),
        {"swing": (0, 30), "M": (0.5, 10), "w": (50, 400), "e": (0.1, 0.95), "play": (0.001, 0.005)},
    ),
    "stewart_platform": Live(of_gallery("a41_stewart_platform"), {"w": (0.2, 6), "m": (50, 2000)}),
    "furuta_pendulum": Live(
        of_gallery("a43_furuta_pendulum"), {"step": (0.0005, 0.02), "lean": (-0.2, 0.2), "lean_dot": (-1, 1)}, 3.0
    ),
    "monorail": Live(
        of_gallery("a48_monorail"),
        {"w": (-1, 1), "c": (0, 1), "e": (0, 30), "lean": (-0.1, 0.1), "spin1_dot": (150, 400)},
    ),
    "delta_robot": Live(of_gallery("a47_delta_robot"), {"w": (2, 20), "m": (0.1, 3)}, 2.0),
    "unicycle": Live(
        of_gallery("a49_unicycle"), {"lean_dot": (-0.3, 0.3), "pitch_dot": (-0.5, 0.5), "spin_dot": (-4, 8)}, 10.0
    ),
}


def written(live: Live, path: Path) -> Path:
    """Write a page, and return its path."""
    run = live.begin()
    span = run.t_span if live.end is None else (0, live.end)
    given = {"initial": run.initial, "parameters": run.parameters, "events": run.events, "sliders": live.sliders}
    page: Path = run.model.export(path, "page", t_span=span, rtol=1e-9, **given)
    return page


def write(folder: Path) -> None:
    """Write all pages to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, live in PAGES.items():
        written(live, folder / f"{name}.html")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
