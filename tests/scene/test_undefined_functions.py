"""Delays and undefined functions in scenes: messages that say what is supported in their place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sympy import Function, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import DalembertError

x, y, u, d1, d2 = dynamicsymbols("x y u d1 d2")
m, tau = symbols("m tau")
X, F, t = Function("x"), Function("F"), dynamicsymbols._t
DELAY = r"'x' at another time, and delays are not supported.*add_states.*da\.Controller"
UNDEFINED = r"is an undefined function.*dalembert\.table\("


def scene_with(place: str, e: Any) -> da.Scene:
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("undefined", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, (e if place == "load" else 0) * N.x))
    if place == "holonomic":
        scene.add_holonomic_constraints(y - e)
    if place == "nonholonomic":
        scene.add_nonholonomic_constraints(y.diff() - e)
    if place == "state":
        scene.add_states({u: e})
    return scene


@pytest.mark.parametrize("place", ["load", "holonomic", "nonholonomic", "state", "output"])
def test_messages_say_what_is_supported(place: str) -> None:
    for e, message in (
        (X(t - tau), DELAY),
        (X(t - tau).diff(t), DELAY),
        (X(0), "'x' at a fixed time: declare a parameter"),
        (F(x), r"F\(x\(t\)\) " + UNDEFINED),
        (F(x).diff(x), UNDEFINED),
        (F(t - tau), r"F\(t - tau\) " + UNDEFINED),
        (F(x, y), r"undefined function.*a surface of data dalembert.table\(\(x\(t\), y\(t\)\), knots"),
        (F(x, y, x * y), "undefined function.*a table of data has one argument or two"),
        (F(t), "is a function of time that is no coordinate.*add_inputs"),
    ):
        with pytest.raises(DalembertError, match=message):
            da.compile_model(scene_with(place, e), outputs={"o": e} if place == "output" else ())


def test_a_controller_has_past_values() -> None:
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("delayed", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", P, m))
    scene.add_inputs(u)
    scene.add_controllers(da.Controller("delay", period=0.1, states={d1: x, d2: d1}, inputs={u: d2}))
    times = np.linspace(0.0, 1.0, 11)[:-1] + 0.05
    run = da.compile_model(scene, outputs=[u]).simulate((0, 1), {x: 0, x.diff(): 1, d1: 0, d2: 0}, {m: 1}, t_eval=times)
    np.testing.assert_allclose(run["u"], np.maximum(times - 0.25, 0.0), atol=1e-12)
