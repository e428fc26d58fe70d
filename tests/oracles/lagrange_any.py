"""Mass matrix and forcing of any scene at a state, by the Lagrange operator on SymPy's own kinetic energy.

Nothing here is shared with the compiler: SymPy differentiates positions for the velocities and forms T body by
body, and the operator d/dt dT/dqdot - dT/dq is applied by central differences in 50-digit arithmetic, which
leaves far more than the 16 digits that are compared. T is quadratic in the rates, so that its differences in
them are exact.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import mpmath
import numpy as np
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols
from sympy.physics.vector import Vector

from dalembert import Scene

DIGITS = 50
STEP = "1e-15"


@final
@dataclass(frozen=True)
class LagrangeScene:
    """A scene's energies and actions as functions of time, state and parameters, all in extended precision.

    Attributes
    ----------
    coordinates, parameters : tuple of str
        Names, in the order of the arguments.
    kinetic, potential : callable
        (t, q, qdot, p) -> list of one number; the potential is that of gravity.
    velocities, actions : callable
        (t, q, qdot, p) -> components on the Newtonian referential of what the given forces and torques do work
        with (v of the point, omega of the frame), and of these forces and torques.
    """

    coordinates: tuple[str, ...]
    parameters: tuple[str, ...]
    kinetic: Callable
    potential: Callable
    velocities: Callable
    actions: Callable

    def terms(self, t: float, q: Sequence[float], qdot: Sequence[float], p: Mapping[str, float]):
        """Return the mass matrix (n_q, n_q) and the forcing (n_q,) at a state."""
        with mpmath.workdps(DIGITS):
            numbers = [mpmath.mpf(float(p[name])) for name in self.parameters]
            return self._terms(mpmath.mpf(t), list(map(mpmath.mpf, q)), list(map(mpmath.mpf, qdot)), numbers)

    def energies(self, t, q, qdot, p) -> tuple[float, float]:
        """Return the kinetic energy and the potential of gravity at a state."""
        numbers = [float(p[name]) for name in self.parameters]
        return float(self.kinetic(t, q, qdot, numbers)[0]), float(self.potential(t, q, qdot, numbers)[0])

    def _terms(self, t, q, qdot, p):
        size, h = len(q), mpmath.mpf(STEP)

        def shifted(values, steps):
            return [value + step for value, step in zip(values, steps, strict=True)]

        def unit(place, length=1):
            return [length if i == place else 0 for i in range(size)]

        def momentum(time, position, rates, place):
            above = self.kinetic(time, position, shifted(rates, unit(place)), p)[0]
            below = self.kinetic(time, position, shifted(rates, unit(place, -1)), p)[0]
            return (above - below) / 2

        momenta = [momentum(t, q, qdot, i) for i in range(size)]
        mass = [[momentum(t, q, shifted(qdot, unit(j)), i) - momenta[i] for j in range(size)] for i in range(size)]
        ahead = shifted(q, [h * v for v in qdot])
        behind = shifted(q, [-h * v for v in qdot])
        forces = self.actions(t, q, qdot, p)
        velocity = self.velocities(t, q, qdot, p)
        forcing = []
        for i in range(size):
            drift = (momentum(t + h, ahead, qdot, i) - momentum(t - h, behind, qdot, i)) / (2 * h)
            lagrangian = [
                self.kinetic(t, shifted(q, unit(i, s)), qdot, p)[0]
                - self.potential(t, shifted(q, unit(i, s)), qdot, p)[0]
                for s in (h, -h)
            ]
            partial = self.velocities(t, q, shifted(qdot, unit(i)), p)
            power = sum(f * (w - v) for f, v, w in zip(forces, velocity, partial, strict=True))
            forcing.append(power + (lagrangian[0] - lagrangian[1]) / (2 * h) - drift)
        return np.array(mass, dtype=float), np.array(forcing, dtype=float)


def lagrange_scene(scene: Scene) -> LagrangeScene:
    """Return the Lagrange equations of a scene, its reactions and constraints left out."""
    N, time = scene.frame, dynamicsymbols._t
    kinetic = sum((_kinetic_energy(body, scene) for body in scene.bodies), sp.S.Zero)
    potential = sum(
        (-body.mass * scene.gravity.dot(_centre(body).pos_from(scene.origin)) for body in scene.bodies)
        if scene.gravity is not None
        else (),
        sp.S.Zero,
    )
    velocities, actions = [], []
    for place, action in map(tuple, scene.loads):
        velocity = place.pos_from(scene.origin).dt(N) if isinstance(place, Point) else place.ang_vel_in(N)
        velocities += _components(velocity, N)
        actions += _components(action, N)

    q = list(scene.coordinates)
    qdot = [sp.Symbol(f"{c.func.__name__}_dot") for c in q]
    flat = [sp.Symbol(c.func.__name__) for c in q]
    plain = dict(zip([c.diff(time) for c in q], qdot, strict=True)), dict(zip(q, flat, strict=True))

    def statics(expression):
        return sp.sympify(expression).doit().xreplace(plain[0]).xreplace(plain[1])

    everything = [statics(e) for e in (kinetic, potential, *velocities, *actions)]
    clock = sp.Symbol("clock")
    everything = [e.xreplace({time: clock}) for e in everything]
    used = set().union(*(e.free_symbols for e in everything)) - {*flat, *qdot, clock}
    parameters = sorted(used, key=lambda symbol: symbol.name)

    def function(expressions):
        return sp.lambdify([clock, flat, qdot, parameters], list(expressions), modules="mpmath", cse=True)

    count = len(velocities)
    return LagrangeScene(
        tuple(symbol.name for symbol in flat),
        tuple(symbol.name for symbol in parameters),
        function(everything[:1]),
        function(everything[1:2]),
        function(everything[2 : 2 + count]),
        function(everything[2 + count :]),
    )


def _centre(body: RigidBody | Particle) -> Point:
    return body.point if isinstance(body, Particle) else body.masscenter


def _kinetic_energy(body: RigidBody | Particle, scene: Scene) -> sp.Expr:
    centre, N = _centre(body), scene.frame
    centre.set_vel(N, centre.pos_from(scene.origin).dt(N))
    return body.kinetic_energy(N)


def _components(vector: Vector, frame: ReferenceFrame) -> list[sp.Expr]:
    return list(vector.to_matrix(frame)) if vector != 0 else [sp.S.Zero] * 3
