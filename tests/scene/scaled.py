"""Scenes with constraints, and values of them in any units of length, mass and time."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

__all__ = ["Units", "closed_chain", "pendulum", "plate", "r", "slider_crank", "two_feet"]

m, g, l, r, I_C, mu, F_0, w = symbols("m g l r I_C mu F_0 w", positive=True)


@dataclass(frozen=True)
class Units:
    """Values of one unit of length, mass and time in others, in which a scene is described."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def of(self, values: Mapping[str, float], dimensions: Mapping[str, tuple[int, int, int]]) -> dict[str, float]:
        """Return values in the units; `dimensions` has powers of length, mass and time, none for numbers and rates."""
        return {
            name: value * self.length**p * self.mass**q * self.time**s
            for name, value in values.items()
            for p, q, s in [_dimension(name, dimensions)]
        }

    def without(self, values: Mapping[str, float], dimensions: Mapping[str, tuple[int, int, int]]) -> dict[str, float]:
        """Return values that are in the units, in ordinary ones."""
        ones = self.of(dict.fromkeys(values, 1.0), dimensions)
        return {name: value / ones[name] for name, value in values.items()}


def _dimension(name: str, dimensions: Mapping[str, tuple[int, int, int]]) -> tuple[int, int, int]:
    """Return the powers of length, mass and time of a value; a rate without its own has those of its coordinate."""
    if name in dimensions or not name.endswith("_dot"):
        return dimensions.get(name, (0, 0, 0))
    length, mass, time = _dimension(name.removesuffix("_dot"), dimensions)
    return length, mass, time - 1


def pendulum() -> da.Scene:
    """Return a pendulum in the coordinates of its bob."""
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bob", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    return scene


def plate() -> da.Scene:
    """Return a plate, its corner at (x, y) on a line that is turned, its weight at the end of the plate."""
    x, y, theta = dynamicsymbols("x y theta")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    A = O.locatenew("A", x * N.x + y * N.y)
    G = A.locatenew("G", l * S.x)
    scene = da.Scene("plate", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("plate", G, S, m, (inertia(S, 0, 0, I_C), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(y, x * sin(theta) - r * cos(theta))
    return scene


def slider_crank() -> da.Scene:
    """Return a crank of length r, a rod of length 3 l and a slider at s."""
    phi, beta, s = dynamicsymbols("phi beta s")
    N, O = ReferenceFrame("N"), Point("O")
    crank, rod = N.orientnew("K", "Axis", (phi, N.z)), N.orientnew("R", "Axis", (-beta, N.z))
    A = O.locatenew("A", r * crank.x)
    B, G, C = A.locatenew("B", 3 * l * rod.x), A.locatenew("G", l * rod.x), O.locatenew("C", s * N.x)
    scene = da.Scene("slider_crank", frame=N, origin=O, coordinates=[phi, beta, s])
    scene.add_bodies(
        RigidBody("crank", O, crank, m, (inertia(crank, 0, 0, I_C), O)),
        RigidBody("rod", G, rod, m, (inertia(rod, 0, 0, I_C), G)),
        Particle("slider", C, m),
    )
    scene.apply_uniform_gravity(-g * N.y)
    gap = B.pos_from(C)
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    return scene


def closed_chain() -> da.Scene:
    """Return a chain of three particles between two nails, in Cartesian coordinates."""
    q = dynamicsymbols("x_1 y_1 x_2 y_2 x_3 y_3")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("closed_chain", frame=N, origin=O, coordinates=q)
    places = [(0, 0), *zip(q[::2], q[1::2], strict=True), (3 * r, 0)]
    for i, (x, y) in enumerate(places[1:-1]):
        scene.add_bodies(Particle(f"link {i}", O.locatenew(f"P_{i}", x * N.x + y * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    for (a, b), (x, y) in pairwise(places):
        scene.add_holonomic_constraints((x - a) ** 2 + (y - b) ** 2 - l**2)
    return scene


def two_feet(height=0, **law) -> da.Scene:
    """Return a block on two rough feet, l to the left and to the right of its centre and r below; pushed over it."""
    x, y, theta = dynamicsymbols("x y theta")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    G = O.locatenew("G", x * N.x + y * N.y)
    scene = da.Scene("two_feet", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("block", G, S, m, (inertia(S, 0, 0, I_C), G)))
    scene.apply_uniform_gravity(-g * N.y)
    H = G.locatenew("H", height * S.y)
    scene.add_loads((H, F_0 * sin(w * dynamicsymbols._t) * N.x))
    for name, side in (("left", -1), ("right", 1)):
        normal, friction = da.unknowns(f"N_{name} F_{name}")
        P = G.locatenew(f"P_{name}", side * l * S.x - r * S.y)
        scene.add_joints(da.Joint(name, body="block", at=P, force=normal * N.y + friction * N.x))
        gap = y + side * l * sin(theta) - r * cos(theta)
        scene.add_contacts(da.UnilateralContact(normal, gap=gap, name=name, **law))
        scene.add_friction(da.CoulombFriction(normal, friction, mu=mu, name=name))
    return scene
