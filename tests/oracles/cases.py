"""Motions whose exact solution is known: parameters, initial state and state at any time."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import final

from oracles.sleigh_exact import SleighState, sleigh_state
from oracles.sphere_exact import SphereState, sphere_state


@final
@dataclass(frozen=True, eq=False)
class Case:
    """One motion of a ready scene; cases compare, and serve as keys, by identity.

    Attributes
    ----------
    name : str
        What the motion does.
    scene : str
        Name of the ready scene.
    coordinates : tuple of str
        Names of its coordinates, in order.
    parameters : mapping of str to float
        Values of its parameters.
    exact : callable
        Time -> exact state, an object with the arrays `q` and `qdot`.
    """

    name: str
    scene: str
    coordinates: tuple[str, ...]
    parameters: Mapping[str, float]
    exact: Callable[[float], SleighState | SphereState]

    @property
    def initial(self) -> dict[str, float]:
        """Coordinates and rates at time 0 by name."""
        start = self.exact(0)
        rates = [f"{name}_dot" for name in self.coordinates]
        return {
            **dict(zip(self.coordinates, start.q.tolist(), strict=True)),
            **dict(zip(rates, start.qdot.tolist(), strict=True)),
        }


def _sleigh(name, parameters, **start) -> Case:
    @functools.cache
    def exact(t):
        return sleigh_state(t, **parameters, **start)

    return Case(name, "chaplygin_sleigh", ("x", "y", "theta"), parameters, exact)


def _sphere(name, parameters, **start) -> Case:
    @functools.cache
    def exact(t):
        return sphere_state(t, parameters["r"], **start)

    return Case(name, "rolling_sphere", ("x", "y", "psi", "theta", "phi"), parameters, exact)


#: Small errors of the initial state grow by a factor of at most 20 within 10 s.
SLEIGH_CASES = (
    _sleigh("past pi/2", {"m": 1.0, "b": 0.3, "I_C": 0.5}, x=0.0, y=0.0, theta=0.2, v=1.0, omega=2.0),
    _sleigh("backwards", {"m": 2.0, "b": 0.4, "I_C": 0.9}, x=-0.5, y=1.0, theta=2.8, v=-1.2, omega=-0.4),
    _sleigh("generic", {"m": 1.3, "b": 0.15, "I_C": 0.8}, x=1.5, y=-0.7, theta=-0.6, v=0.6, omega=0.35),
)

#: theta stays within [0.84, 1.15] and [0.75, 1.87].
SPHERE_CASES = (
    _sphere(
        "slow nutation",
        {"m": 1.3, "r": 0.5, "g": 9.81},
        **{"x": 0.1, "y": -0.2, "psi": 0.4, "theta": 1.1, "phi": -0.3},
        omega=(0.7, -1.2, 0.9),
    ),
    _sphere(
        "wide nutation",
        {"m": 0.8, "r": 1.2, "g": 9.81},
        **{"x": 1.0, "y": 0.5, "psi": 2.5, "theta": 1.4, "phi": 0.5},
        omega=(-0.9, 0.4, -1.6),
    ),
)

CASES = SLEIGH_CASES + SPHERE_CASES
