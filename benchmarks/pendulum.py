"""A pendulum in Cartesian coordinates: what holds its rod over 100,000 steps."""

from __future__ import annotations

from typing import Any

from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

__all__ = ["DRIFT_STEPS", "cartesian_pendulum", "drift"]

DRIFT_STEPS = 100_000
STEP = 0.02
"""Step size [s]; a small swing of the pendulum takes about 2 s."""


def cartesian_pendulum() -> da.Scene:
    """Return the scene of a bob at (x, y) with x**2 + y**2 = L**2."""
    x, y = dynamicsymbols("x y")
    m, L, g = symbols("m L g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("cartesian_pendulum", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bob", O.locatenew("P", x * N.x + y * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - L**2)
    return scene


def drift(formulation: str, method: str = "tsit5") -> Any:
    """Return the trajectory of `DRIFT_STEPS` steps of equal size: tolerances are so loose that `STEP` binds."""
    model = da.compile_model(cartesian_pendulum(), formulation=formulation)
    return model.simulate(
        (0.0, DRIFT_STEPS * STEP),
        {"x": 1.0, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0},
        {"m": 1.0, "L": 1.0, "g": 9.81},
        method=method,
        rtol=1e-2,
        atol=1e-2,
        first_step=STEP,
        max_step=STEP,
        dense=False,
    )
