"""Short passages of an expression through zero: how many are missed by each method, at which tolerance.

An oscillator and another of its own frequency and amplitude; a third particle is pushed while the sum of the first's
place and the second's rate is above a level. The level lies 1e-6 to 0.1 below one of the maxima. A passage counts as
missed where the speed of the third particle is off by half of what it is, or by 0.1.
"""

from __future__ import annotations

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

CASES, END = 400, 10.0


def scene() -> da.Scene:
    """Return the three particles."""
    a, b, z = dynamicsymbols("a b z")
    level, w = sp.symbols("level w", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    made = da.Scene("gate", frame=N, origin=O, coordinates=[a, b, z])
    places = [O.locatenew(name, q * axis) for name, q, axis in zip("ABC", (a, b, z), (N.x, N.y, N.z), strict=True)]
    made.add_bodies(*(Particle(name, place, 1) for name, place in zip("abc", places, strict=True)))
    push = sp.Heaviside(a + b.diff() / w - level, 0)
    made.add_loads((places[0], -a * N.x), (places[1], -(w**2) * b * N.y), (places[2], push * N.z))
    return made


def main() -> None:
    """Print a line for each method and tolerance."""
    rng = np.random.default_rng(1)
    phases, others = rng.uniform(0, 2 * np.pi, (2, CASES))
    w, amplitudes = rng.uniform(0.5, 3, CASES), rng.uniform(0.1, 1, CASES)
    t = np.linspace(0, END, 400_001)
    levels, exact = np.empty(CASES), np.empty(CASES)
    for i in range(CASES):
        height = np.cos(t + phases[i]) - amplitudes[i] * np.sin(w[i] * t + others[i])
        tops = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
        levels[i] = height[tops[np.argmax(height[tops])] if len(tops) else 0] - 10 ** rng.uniform(-6, -1)
        exact[i] = np.mean(height > levels[i]) * END
    start = {"a": np.cos(phases), "a_dot": -np.sin(phases), "z": 0.0, "z_dot": 0.0}
    start |= {"b": amplitudes * np.cos(others), "b_dot": -w * amplitudes * np.sin(others)}
    model = da.compile_model(scene())
    for method in ("taylor", "dop853", "tsit5"):
        for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
            options = {"method": method, "rtol": rtol, "atol": rtol / 100}
            sweep = model.sweep((0, END), start, {"level": levels, "w": w}, **options)
            error = np.abs(sweep["z_dot"] - exact)
            missed = int(np.sum(error > np.minimum(0.5 * exact, 0.1)))
            steps = sweep.steps.sum() / CASES
            print(f"{method:7s} rtol {rtol:g}: {missed:3d} of {CASES} missed, {steps:.0f} steps a run", flush=True)


if __name__ == "__main__":
    main()
