"""Write pages that simulate: ``python docs/live_pages.py FOLDER``; the site has them in ``live/``.

Their scenes are ready scenes with shapes, and those of the gallery. They need the package ziglang (extra "export").
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sympy import Symbol, cos, symbols
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da

GALLERY = Path(__file__).parent / "gallery"
COMPILING = "model = da.compile_model(scene"
"""What follows the scene in a script of the gallery."""


@dataclass(frozen=True)
class Live:
    """A page: a scene, what it starts with, its end [s], its sliders, outputs that are shown, and events."""

    scene: Callable[[], da.Scene]
    initial: dict[str, float]
    parameters: dict[str, float]
    end: float
    sliders: dict[str, tuple[float, float]]
    outputs: list[str] = field(default_factory=list)
    events: Callable[[], list[da.Event]] = list


def of_gallery(name: str, what: str = "scene") -> Callable[[], Any]:
    """Return a function that returns the scene that a script of the gallery builds, or another name of it."""

    def build() -> Any:
        names: dict[str, Any] = {}
        text = (GALLERY / f"{name}.py").read_text(encoding="utf-8").partition(COMPILING)[0]
        exec(compile(text, name, "exec"), names)
        return names[what]

    return build


def parameter(scene: da.Scene, name: str) -> Symbol:
    """Return a parameter of a scene with its assumptions."""
    body = scene.bodies[0]
    found = body.mass.free_symbols | body.masscenter.pos_from(scene.origin).to_matrix(scene.frame).free_symbols
    return next(symbol for symbol in found if symbol.name == name)


def sleigh() -> da.Scene:
    """Return the sleigh with a shape."""
    scene = da.scenes.chaplygin_sleigh()
    b = parameter(scene, "b")
    scene.add_shapes({"sleigh": da.Box(3 * b, 1.4 * b, 0.5 * b), "ice": da.Ground(scene.frame.z)})
    return scene


def sphere() -> da.Scene:
    """Return the rolling sphere with shapes."""
    scene = da.scenes.rolling_sphere()
    scene.add_shapes({"sphere": da.Sphere(parameter(scene, "r")), "floor": da.Ground(scene.frame.z)})
    return scene


def plate() -> da.Scene:
    """Return the plate on its edge with shapes."""
    scene, h = da.scenes.edge_plate(), symbols("h", positive=True)
    scene.add_shapes({"plate": da.Box(3 * h, 2 * h, h / 12), "plane": da.Ground(scene.frame.z)})
    return scene


def corner_plate() -> da.Scene:
    """Return the plate that leans on a corner with friction, with shapes."""
    scene, l, h = da.scenes.corner_plate(friction=True), symbols("l", positive=True), symbols("h", positive=True)
    corner = scene.origin.locatenew("Q", h * scene.frame.y)
    step = da.Rod(scene.origin, corner)
    scene.add_shapes({"plate": da.Box(2 * l, l / 25, l), "ground": da.Ground(scene.frame.y), "step": step})
    return scene


def walker() -> da.Scene:
    """Return the compass walker with shapes; its foot at rest is drawn in one place."""
    scene = of_gallery("a38_compass_walker")()
    hip, foot = (body.masscenter for body in scene.bodies)
    legs = {"stance leg": da.Rod(scene.origin, hip, "gray"), "swing leg": da.Rod(hip, foot, "orange")}
    scene.add_shapes({**legs, "hip": da.Sphere(0.08), "slope": da.Ground(scene.frame.y)})
    return scene


def strikes() -> list[da.Event]:
    """Return the events of the compass walker: its strikes, and its fall, which ends the run."""
    fall = da.Event(cos(dynamicsymbols("stance")) - 0.5, direction=-1, terminal=True, name="fall")
    return [of_gallery("a38_compass_walker", "strike")(), fall]


def bouncing_ball() -> da.Scene:
    """Return the ball that bounces with shapes."""
    scene = of_gallery("a10_bouncing_ball")()
    scene.add_shapes({"ball": da.Sphere(0.05), "floor": da.Ground(scene.frame.y)})
    return scene


UPRIGHT = {"x": 0, "y": 0, "z": 0.3, "yaw": 0, "lean": 0, "pitch": 0, "steer": 0, "rear": 0, "front": 0}
BICYCLE = {"w": 1.02, "c": 0.08, "lam": 0.3141592653589793, "g": 9.81, "rR": 0.3, "mR": 2, "IRxx": 0.0603, "IRyy": 0.12}
BICYCLE |= {"xB": 0.3, "zB": -0.9, "mB": 85, "IBxx": 9.2, "IByy": 11, "IBzz": 2.8, "IBxz": 2.4}
BICYCLE |= {"xH": 0.9, "zH": -0.7, "mH": 4, "IHxx": 0.05892, "IHyy": 0.06, "IHzz": 0.00708, "IHxz": -0.00756}
BICYCLE |= {"rF": 0.35, "mF": 3, "IFxx": 0.1405, "IFyy": 0.28}

ANDREWS = {"beta": -0.06171389001427642, "Theta": 0.0, "gamma": 0.45527981916307037, "Phi": 0.22266839016588544}
ANDREWS |= {"delta": 0.4873649795438427, "Omega": -0.22266839016588522, "epsilon": 1.230547444549821, "Theta_dot": 0.0}
SEVEN = {"d": 0.028, "d_a": 0.0115, "e": 0.02, "e_a": 0.01421, "rr": 0.007, "ra": 0.00092, "l_0": 0.07785, "ss": 0.035}
SEVEN |= {"sa": 0.01874, "sb": 0.01043, "sc": 0.018, "sd": 0.02, "ta": 0.02308, "tb": 0.00916, "u": 0.04, "ua": 0.01228}
SEVEN |= {
    "ub": 0.00449,
    "zf": 0.02,
    "zt": 0.04,
    "fa": 0.01421,
    "c_0": 4530.0,
    "mom": 0.033,
    "m1": 0.04325,
    "m2": 0.00365,
}
SEVEN |= {"m3": 0.02373, "m4": 0.00706, "m5": 0.0705, "m6": 0.00706, "m7": 0.05498, "I1": 2.194e-6, "I2": 4.41e-7}
SEVEN |= {"I3": 5.255e-6, "I4": 5.667e-7, "I5": 1.169e-5, "I6": 5.667e-7, "I7": 1.912e-5}

PAGES = {
    "sleigh": Live(
        sleigh,
        {"x": 0, "y": 0, "theta": 0, "x_dot": 0.2, "theta_dot": 2.5},
        {"m": 1, "b": 0.2, "I_C": 0.6},
        12.0,
        {"b": (0.02, 0.6), "I_C": (0.4, 2), "theta_dot": (-5, 5), "x_dot": (-2, 2)},
        ["Y"],
    ),
    "rolling_sphere": Live(
        sphere,
        {"x": 0, "y": 0, "psi": 0.3, "theta": 0.9, "phi": 0, "psi_dot": 1, "theta_dot": 0.6, "phi_dot": 2},
        {"m": 2, "r": 0.4, "g": 9.81},
        8.0,
        {"r": (0.1, 0.8), "psi_dot": (-4, 4), "theta_dot": (-3, 3), "phi_dot": (-4, 4)},
    ),
    "plate": Live(
        plate,
        {"x": 0, "y": 0, "psi": 0.1, "theta": 1.2, "x_dot": 0.4, "y_dot": 0, "psi_dot": 1.5, "theta_dot": 0.2},
        {"m": 1, "A": 0.09, "B": 0.19, "C": 0.28, "F": 0.0, "h": 0.5, "g": 9.81},
        1.0,
        {"theta": (0.2, 2.9), "theta_dot": (-3, 3), "psi_dot": (-6, 6), "h": (0.3, 0.7), "F": (-0.1, 0.1)},
        ["Z"],
    ),
    "corner_plate": Live(
        corner_plate,
        {"theta": 0.7, "theta_dot": 2.0},
        {"m": 2, "l": 1, "h": 0.6, "g": 9.81, "F_A": 0.001, "mu": 0.2},
        1.0,
        {"mu": (0.01, 1), "theta": (0.4, 1.4), "theta_dot": (-2, 4), "h": (0.3, 0.9), "F_A": (0.001, 20)},
        ["N_Q", "F_Q", "N_A"],
    ),
    "bouncing_ball": Live(
        bouncing_ball,
        {"x": 0, "y": 1, "x_dot": 0.5, "y_dot": 0},
        {"m": 1, "g": 9.81, "e": 0.8},
        6.0,
        {"e": (0.01, 1), "y": (0.1, 2), "x_dot": (-2, 2), "y_dot": (-4, 4), "g": (1, 20)},
    ),
    "walker": Live(
        walker,
        {"stance": 0.2003109, "swing": -0.2003109, "stance_dot": -0.1998325, "swing_dot": -0.1840095},
        {"m": 1e-9, "slope": 0.009, "g": 1},
        20.0,
        {"slope": (0.002, 0.016), "stance_dot": (-0.22, -0.18), "swing_dot": (-0.22, -0.15)},
        events=strikes,
    ),
    "double_pendulum": Live(
        of_gallery("a02_double_pendulum"),
        {"a": 2.0, "b": 2.5, "a_dot": 0, "b_dot": 0},
        {"m": 1, "l": 1, "g": 9.81},
        20.0,
        {
            "a": (-3.1416, 3.1416),
            "b": (-3.1416, 3.1416),
            "a_dot": (-5, 5),
            "b_dot": (-5, 5),
            "l": (0.3, 2),
            "g": (0, 20),
        },
    ),
    "coin": Live(
        of_gallery("a04_rolling_coin"),
        {"x": 0, "y": 0, "heading": 0, "lean": 0.3, "spin": 0, "heading_dot": 0.8, "lean_dot": 0, "spin_dot": 4},
        {"m": 0.1, "r": 0.2, "g": 9.81},
        12.0,
        {"lean": (-1.2, 1.2), "heading_dot": (-4, 4), "lean_dot": (-2, 2), "spin_dot": (-12, 12), "r": (0.05, 0.5)},
    ),
    "top": Live(
        of_gallery("a05_gyroscope"),
        {"psi": 0, "theta": 0.6, "phi": 0, "psi_dot": 0, "theta_dot": 0, "phi_dot": 60},
        {"m": 1, "h": 0.1, "A": 0.015, "C": 0.01, "g": 9.81},
        4.0,
        {"theta": (0.05, 1.5), "psi_dot": (-6, 6), "phi_dot": (30, 150), "h": (0.03, 0.12)},
    ),
    "bicycle": Live(
        of_gallery("a25_bicycle"),
        {**UPRIGHT, "lean_dot": 0.4, "steer_dot": 0, "rear_dot": 15.3},
        BICYCLE,
        6.0,
        {"lean_dot": (-0.8, 0.8), "rear_dot": (12, 30), "c": (0.02, 0.15), "mB": (40, 120), "zB": (-1.2, -0.6)},
    ),
    "slider_crank": Live(
        of_gallery("a03_slider_crank"),
        {"alpha": 0.3, "beta": -0.09866674653012757, "s": 0.39407456415626446, "alpha_dot": 5},
        {"m_c": 1, "m_r": 0.5, "m_p": 0.8, "l_c": 0.1, "l_r": 0.3, "M": 2, "c": 20},
        3.0,
        {"alpha_dot": (-20, 20), "M": (-4, 4), "c": (0, 60), "m_c": (0.5, 5), "m_p": (0.2, 3)},
    ),
    "four_bar": Live(
        of_gallery("a20_four_bar"),
        {"beta": 0.9272952180016121, "gamma": 1.5707963267948963},
        {"l_1": 0.5, "l_2": 1.5, "l_3": 1.2, "d": 1.4, "p": 0.8, "q": 0.2, "w": 6.283185307179586, "m": 1},
        2.0,
        {"p": (-0.5, 2), "q": (-1, 1), "w": (-10, 10)},
    ),
    "snakeboard": Live(
        of_gallery("a17_snakeboard"),
        {"x": 0, "y": 0, "theta": 0, "x_dot": 0},
        {"m": 6, "J": 0.2, "J_r": 0.1, "L": 0.2, "A": 0.7, "B": 0.5, "w": 4},
        20.0,
        {"A": (-1.2, 1.2), "B": (-1, 1), "w": (1, 8), "L": (0.1, 0.4), "x_dot": (-1, 1)},
    ),
    "tippe_top": Live(
        of_gallery("a19_tippe_top"),
        {**dict.fromkeys(["x", "y", "x_dot", "y_dot", "z_dot", "e2_T", "e3_T", "omega_T_x", "omega_T_y"], 0), "z": 0.02}
        | {"e0_T": 0.9987502603949663, "e1_T": 0.04997916927067833, "omega_T_z": 155},
        {"m": 0.006, "r": 0.02, "a": 0.003, "A": 7.2e-7, "C": 8e-7, "g": 9.81, "mu": 0.3, "eps": 0.01},
        8.0,
        {"omega_T_z": (20, 300), "mu": (0.05, 0.6), "a": (0.001, 0.006)},
    ),
    "squeezing_mechanism": Live(
        of_gallery("a26_andrews"), ANDREWS, SEVEN, 0.03, {"mom": (-0.1, 0.1), "c_0": (1000, 9000), "m7": (0.01, 0.2)}
    ),
    "backlash": Live(
        of_gallery("a46_backlash"),
        {"a": 0, "b": 0, "a_dot": 20, "b_dot": -13.333333333333334},
        {"M": 3, "w": 200, "play": 0.004, "e": 0.6, "swing": 15},
        0.5,
        {"swing": (0, 30), "M": (0.5, 10), "w": (50, 400), "e": (0.1, 0.95), "play": (0.001, 0.005)},
    ),
}


def write(folder: Path) -> None:
    """Write all pages to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, live in PAGES.items():
        model = da.compile_model(live.scene(), outputs=live.outputs)
        given = {"initial": live.initial, "parameters": live.parameters, "sliders": live.sliders}
        given |= {"events": live.events()}
        model.export(folder / f"{name}.html", "page", t_span=(0, live.end), rtol=1e-9, **given)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
