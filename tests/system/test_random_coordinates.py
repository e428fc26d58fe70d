"""Particles in random coordinates: whatever these are, a run that succeeds keeps the energy, and methods agree.

Most coordinates are singular somewhere: roots and logarithms end, slopes vanish. A motion that comes there has to end.
"""

import random

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import DalembertError

x, y = dynamicsymbols("x y")
m, g = sp.symbols("m g", positive=True)
NUMBERS = {m: 1.0, g: 9.81}
KINDS = {
    "sin": lambda a, b, c: sp.sin(a),
    "cos": lambda a, b, c: sp.cos(a),
    "square": lambda a, b, c: a**2,
    "end": lambda a, b, c: sp.sqrt(c - a**2),
    "root": lambda a, b, c: sp.sqrt(c + a**2),
    "bare root": lambda a, b, c: sp.sqrt(a),
    "asin": lambda a, b, c: sp.asin(a / c),
    "acos": lambda a, b, c: sp.acos(a / c),
    "atan": lambda a, b, c: sp.atan(a),
    "exp": lambda a, b, c: sp.exp(a / 2),
    "log": lambda a, b, c: sp.log(c + a),
    "tan": lambda a, b, c: sp.tan(a / 2),
    "inverse": lambda a, b, c: 1 / (c + a),
    "power": lambda a, b, c: (c + a) ** sp.Rational(3, 2),
    "cube": lambda a, b, c: a**3,
    "product": lambda a, b, c: a * b,
    "sum": lambda a, b, c: a + c * b,
}


def expression(draw, moving, depth=0):
    """Return a random function of coordinates."""
    kind = draw.choice(["", "", *KINDS]) if depth < 3 else ""
    if not kind:
        return draw.choice(moving)
    a, b = (expression(draw, moving, depth + 1) for _ in range(2))
    return KINDS[kind](a, b, sp.Rational(draw.randint(2, 9), 4))


def particle(seed):
    """Return the first model of a seed that can be compiled and has energy at its start, and the start."""
    draw = random.Random(seed)
    for _ in range(50):
        moving = [x, y] if draw.random() < 0.4 else [x]
        N, O = ReferenceFrame("N"), Point("O")
        place = expression(draw, moving) * N.x + expression(draw, moving) * N.y
        start = {q: draw.uniform(-1, 1) for q in moving} | {q.diff(): draw.uniform(-3, 3) for q in moving}
        scene = da.Scene("particle", frame=N, origin=O, coordinates=moving)
        scene.add_bodies(Particle("bead", O.locatenew("P", place), m))
        scene.apply_uniform_gravity(-g * N.y)
        try:
            model = da.compile_model(scene, outputs=["energy", "kinetic_energy"])
            energy = model.simulate((0, 0.01), start, NUMBERS)["energy"]
        except DalembertError:
            continue
        if np.isfinite(energy[0]):
            return model, start
    raise AssertionError("no coordinates can be compiled")


@pytest.mark.parametrize("seed", range(16))
def test_success_keeps_the_energy(seed):
    model, start = particle(seed)
    ends = []
    for method in ("taylor", "dop853", "tsit5", "radau"):
        run = model.simulate((0, 3), start, NUMBERS, method=method, max_steps=20_000)
        if not run.success:
            continue
        energy = run["energy"]
        size = np.max(np.abs(energy)) + np.max(run["kinetic_energy"])
        assert np.max(np.abs(energy - energy[0])) <= 1e-3 * size, method
        ends.append(run["x"][-1])
        sweep = model.sweep((0, 3), start, NUMBERS, method=method, max_steps=20_000)
        assert sweep.success.all() and sweep["x"][-1] == pytest.approx(ends[-1], rel=1e-2, abs=1e-2), method
    assert np.ptp(ends or [0.0]) <= 1e-2 * (1 + np.max(np.abs(ends or [0.0])))
