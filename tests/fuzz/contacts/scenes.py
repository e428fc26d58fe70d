"""Scenes of the families, written with SymPy as users write them: `SCENES`, by name.

Each has symbols in the order of the numbers that its function in `systems` unpacks, and the same coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, final

from sympy import Rational, cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

__all__ = ["SCENES", "Contact", "Numbers", "Setting", "compiled", "setting"]

TIME = dynamicsymbols._t


@final
@dataclass(frozen=True)
class Contact:
    """A contact of a scene: its name, and its unknowns along the normal and the tangents."""

    name: str
    normal: str
    tangential: tuple[str, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class Setting:
    """A scene, the name of its system, and the names of its parameters in the order of the system."""

    system: str
    scene: Any
    parameters: tuple[str, ...]
    contacts: tuple[Contact, ...]

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(str(q).removesuffix("(t)") for q in self.scene.coordinates)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all reactions."""
        return tuple(name for contact in self.contacts for name in (contact.normal, *contact.tangential))


def _frame() -> tuple[Any, Any]:
    return ReferenceFrame("N"), Point("O")


@final
class Numbers:
    """Symbols for the numbers of a scene, by their names; some may be replaced by given expressions.

    Attributes
    ----------
    names : list of str
        Names of all that were asked for, in that order.
    """

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        self.names: list[str] = []
        self._given = {} if given is None else dict(given)

    def __call__(self, names: str) -> Any:
        """Return the symbols of some names, as `sympy.symbols` does."""
        made = symbols(names, real=True)
        if not isinstance(made, tuple):
            return self._one(made)
        return tuple(self._one(symbol) for symbol in made)

    def _one(self, symbol: Any) -> Any:
        self.names.append(symbol.name)
        return self._given.get(symbol.name, symbol)


def particle(real: Numbers, static: bool) -> Setting:
    """Return a particle on or above a moving floor, at a spring, lifted and pushed."""
    x, y = dynamicsymbols("x y")
    m, g_x, g_y, k, c, x_0, A, omega, phi, B, C, nu, belt, mu, mu_s, e = real(
        "m g_x g_y k c x_0 A omega phi B C nu belt mu mu_s e"
    )
    N, O = _frame()
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("particle", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("particle", P, m))
    along = m * g_x - k * (x - x_0) - c * x.diff(TIME) + A * sin(omega * TIME + phi)
    scene.add_loads((P, along * N.x + (-m * g_y + B * TIME + C * sin(nu * TIME)) * N.y))
    R, F = da.unknowns("R F")
    scene.add_joints(da.Joint("floor", body="particle", at=P, force=F * N.x + R * N.y))
    scene.add_contacts(da.UnilateralContact(R, gap=y, restitution=e, name="floor"))
    law = {"mu_static": mu_s} if static else {}
    scene.add_friction(da.CoulombFriction(R, F, slip=x.diff(TIME) - belt, mu=mu, name="floor", **law))
    return Setting("particle", scene, tuple(real.names), (Contact("floor", "R", ("F",)),))


def stack(real: Numbers, count: int) -> Setting:
    """Return blocks that lie on each other on a moving floor, each pushed; the uppermost may be lifted."""
    g, belt, lift, nu = real("g belt lift nu")
    N, O = _frame()
    places = [dynamicsymbols(f"x{i + 1} y{i + 1}") for i in range(count)]
    scene = da.Scene("stack", frame=N, origin=O, coordinates=[q for place in places for q in place])
    contacts: list[Contact] = []
    below: Any = (0, 0)
    points = [O.locatenew(f"P{i + 1}", x * N.x + y * N.y) for i, (x, y) in enumerate(places)]
    for i, (x, y) in enumerate(places):
        m, A, omega, mu = real(f"m{i + 1} A{i + 1} omega{i + 1} mu{i + 1}")
        P, name = points[i], f"c{i + 1}"
        R, F = da.unknowns(f"R{i + 1} F{i + 1}")
        scene.add_bodies(Particle(f"block{i + 1}", P, m))
        up = lift * sin(nu * TIME) if i == count - 1 else 0
        scene.add_loads((P, A * sin(omega * TIME) * N.x + (up - m * g) * N.y))
        scene.add_joints(da.Joint(f"{name} up", body=f"block{i + 1}", at=P, force=F * N.x + R * N.y))
        if i > 0:
            scene.add_joints(da.Joint(f"{name} down", body=f"block{i}", at=points[i - 1], force=-F * N.x - R * N.y))
        scene.add_contacts(da.UnilateralContact(R, gap=y - below[1], name=name))
        slip = x.diff(TIME) - (belt if i == 0 else below[0].diff(TIME))
        scene.add_friction(da.CoulombFriction(R, F, slip=slip, mu=mu, name=name))
        contacts.append(Contact(name, f"R{i + 1}", (f"F{i + 1}",)))
        below = (x, y)
    return Setting(f"stack of {count}", scene, tuple(real.names), tuple(contacts))


def _rod(real: Numbers, name: str, more: str) -> tuple[Any, ...]:
    """Return a rod with its centre at (x, y) and ends at its distance l: scene, further numbers, coordinates, ends."""
    x, y, theta = dynamicsymbols("x y theta")
    m, l, g, A, omega, *further = real(f"m l g A omega {more}")
    N, O = _frame()
    S = N.orientnew("S", "Axis", (theta, N.z))
    G = O.locatenew("G", x * N.x + y * N.y)
    ends = G.locatenew("A", l * S.x), G.locatenew("B", -l * S.x)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("rod", G, S, m, (inertia(S, 0, 0, Rational(1, 3) * m * l**2), G)))
    scene.add_loads((G, A * sin(omega * TIME) * N.x - m * g * N.y))
    return scene, further, (x, y, theta, l), ends


def _touch(scene: Any, name: str, at: Any, gap: Any, mu: Any, wall: bool, e: Any = 0, *, body: str = "rod") -> Contact:
    """Add a contact of a point with the floor, or with the wall at the left."""
    R, F = da.unknowns(f"R_{name} F_{name}")
    N = scene.frame
    normal, tangent = (N.x, N.y) if wall else (N.y, N.x)
    scene.add_joints(da.Joint(name, body=body, at=at, force=F * tangent + R * normal))
    scene.add_contacts(da.UnilateralContact(R, gap=gap, restitution=e, name=name))
    scene.add_friction(da.CoulombFriction(R, F, mu=mu, name=name))
    return Contact(name, f"R_{name}", (f"F_{name}",))


def rod_floor(real: Numbers) -> Setting:
    """Return a rod, both ends of which may touch the floor."""
    scene, (mu, e), (_, y, theta, l), (A, B) = _rod(real, "rod_floor", "mu e")
    contacts = (
        _touch(scene, "a", A, y + l * sin(theta), mu, False, e),
        _touch(scene, "b", B, y - l * sin(theta), mu, False, e),
    )
    return Setting("rod on floor", scene, tuple(real.names), contacts)


def rod_corner(real: Numbers) -> Setting:
    """Return a rod that leans in a corner, and may lie down on the floor."""
    scene, (mu, mu_wall), (x, y, theta, l), (A, B) = _rod(real, "rod_corner", "mu mu_wall")
    contacts = (
        _touch(scene, "a", A, y + l * sin(theta), mu, False),
        _touch(scene, "wall", B, x - l * cos(theta), mu_wall, True),
        _touch(scene, "b", B, y - l * sin(theta), mu, False),
    )
    return Setting("rod in corner", scene, tuple(real.names), contacts)


def trammel(real: Numbers) -> Setting:
    """Return a rod, the ends of which slide in two slots with friction."""
    scene, (mu, mu_wall), (x, y, theta, l), (A, B) = _rod(real, "trammel", "mu mu_wall")
    N = scene.frame
    R_a, F_a, R_b, F_b = da.unknowns("R_a F_a R_b F_b")
    scene.add_joints(
        da.Joint("a", body="rod", at=A, force=F_a * N.x + R_a * N.y),
        da.Joint("b", body="rod", at=B, force=F_b * N.y + R_b * N.x),
    )
    scene.add_holonomic_constraints(y + l * sin(theta), x - l * cos(theta))
    scene.add_friction(
        da.CoulombFriction(R_a, F_a, mu=mu, name="a"), da.CoulombFriction(R_b, F_b, mu=mu_wall, name="b")
    )
    return Setting("trammel", scene, tuple(real.names), (Contact("a", "R_a", ("F_a",)), Contact("b", "R_b", ("F_b",))))


def plate(real: Numbers) -> Setting:
    """Return a plate on two feet, pushed at its mass centre."""
    x, y, theta = dynamicsymbols("x y theta")
    m, I, b, h, g, mu, A, omega, phi = real("m I b h g mu A omega phi")
    N, O = _frame()
    S = N.orientnew("S", "Axis", (theta, N.z))
    G = O.locatenew("G", x * N.x + y * N.y)
    scene = da.Scene("plate", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("plate", G, S, m, (inertia(S, 0, 0, I), G)))
    scene.add_loads((G, A * sin(omega * TIME + phi) * N.x - m * g * N.y))
    contacts = []
    for name, side in (("left", -1), ("right", 1)):
        foot = G.locatenew(f"foot_{name}", side * b * S.x - h * S.y)
        gap = y + side * b * sin(theta) - h * cos(theta)
        contacts.append(_touch(scene, name, foot, gap, mu, False, body="plate"))
    return Setting("plate", scene, tuple(real.names), tuple(contacts))


def wheel(real: Numbers) -> Setting:
    """Return a wheel on a moving floor, driven, before a wall."""
    x, y, theta = dynamicsymbols("x y theta")
    m, I, r, g_x, g_y, belt, T, omega, A, mu, mu_wall, x_wall, e = real(
        "m I r g_x g_y belt T omega A mu mu_wall x_wall e"
    )
    N, O = _frame()
    S = N.orientnew("S", "Axis", (theta, N.z))
    G = O.locatenew("G", x * N.x + y * N.y)
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("wheel", G, S, m, (inertia(S, 0, 0, I), G)))
    scene.add_loads((G, (m * g_x + A * cos(omega * TIME)) * N.x - m * g_y * N.y), (S, T * sin(omega * TIME) * N.z))
    R, F, R_w, F_w = da.unknowns("R F R_w F_w")
    bottom, side = G.locatenew("I", -r * N.y), G.locatenew("K", r * N.x)
    scene.add_joints(
        da.Joint("floor", body="wheel", at=bottom, force=F * N.x + R * N.y),
        da.Joint("wall", body="wheel", at=side, force=F_w * N.y - R_w * N.x),
    )
    scene.add_contacts(
        da.UnilateralContact(R, gap=y - r, restitution=e, name="floor"),
        da.UnilateralContact(R_w, gap=x_wall - x - r, restitution=e, name="wall"),
    )
    scene.add_friction(
        da.CoulombFriction(R, F, slip=x.diff(TIME) + r * theta.diff(TIME) - belt, mu=mu, name="floor"),
        da.CoulombFriction(R_w, F_w, mu=mu_wall, name="wall"),
    )
    return Setting("wheel", scene, tuple(real.names), (Contact("floor", "R", ("F",)), Contact("wall", "R_w", ("F_w",))))


def slot(real: Numbers) -> Setting:
    """Return a block in a straight slot, pressed to either side."""
    x, y = dynamicsymbols("x y")
    m, k, A, omega, B, nu, load, belt, mu = real("m k A omega B nu load belt mu")
    N, O = _frame()
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("slot", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", P, m))
    scene.add_loads((P, (A * sin(omega * TIME) - k * x) * N.x + (load + B * sin(nu * TIME)) * N.y))
    R, F = da.unknowns("R F")
    scene.add_joints(da.Joint("slot", body="block", at=P, force=F * N.x + R * N.y))
    scene.add_holonomic_constraints(y)
    scene.add_friction(da.CoulombFriction(R, F, slip=x.diff(TIME) - belt, mu=mu, name="slot"))
    return Setting("slot", scene, tuple(real.names), (Contact("slot", "R", ("F",)),))


def ring(real: Numbers) -> Setting:
    """Return a bead on a vertical ring."""
    x, y = dynamicsymbols("x y")
    m, R, g, A, omega, mu = real("m R g A omega mu")
    N, O = _frame()
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("ring", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, m))
    scene.add_loads((P, A * sin(omega * TIME) * N.x - m * g * N.y))
    normal, F = da.unknowns("H F")
    outward, along = (x * N.x + y * N.y) / R, (x * N.y - y * N.x) / R
    scene.add_joints(da.Joint("ring", body="bead", at=P, force=F * along + normal * outward))
    scene.add_holonomic_constraints((x**2 + y**2 - R**2) / (2 * R))
    scene.add_friction(da.CoulombFriction(normal, F, mu=mu, name="ring"))
    return Setting("ring", scene, tuple(real.names), (Contact("ring", "H", ("F",)),))


def chain(real: Numbers) -> Setting:
    """Return three masses on a line before a wall, each at a spring; the last is pushed."""
    q = dynamicsymbols("x1:4")
    m, k, a = real("m1:4"), real("k1:4"), real("a1:4")
    c, A, omega, e_wall, e = real("c A omega e_wall e")
    N, O = _frame()
    scene = da.Scene("chain", frame=N, origin=O, coordinates=list(q))
    points = [O.locatenew(f"P{i + 1}", q[i] * N.x) for i in range(3)]
    contacts = []
    for i in range(3):
        push = A * sin(omega * TIME) if i == 2 else 0
        scene.add_bodies(Particle(f"mass{i + 1}", points[i], m[i]))
        scene.add_loads((points[i], (push - k[i] * (q[i] - a[i]) - c * q[i].diff(TIME)) * N.x))
        R = da.unknowns(f"R{i + 1}")
        scene.add_joints(da.Joint(f"c{i + 1} right", body=f"mass{i + 1}", at=points[i], force=R * N.x))
        if i > 0:
            scene.add_joints(da.Joint(f"c{i + 1} left", body=f"mass{i}", at=points[i - 1], force=-R * N.x))
        gap = q[i] - q[i - 1] if i > 0 else q[0]
        scene.add_contacts(da.UnilateralContact(R, gap=gap, restitution=e if i > 0 else e_wall, name=f"c{i + 1}"))
        contacts.append(Contact(f"c{i + 1}", f"R{i + 1}"))
    return Setting("chain", scene, tuple(real.names), tuple(contacts))


def disc(real: Numbers) -> Setting:
    """Return a particle on or above a plane that moves, with friction in the plane."""
    x, y, z = dynamicsymbols("x y z")
    m, g_x, g_y, g_z, k_x, k_y, c, u_x, u_y, A, omega, C, nu, mu, e = real(
        "m g_x g_y g_z k_x k_y c u_x u_y A omega C nu mu e"
    )
    N, O = _frame()
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("disc", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("particle", P, m))
    f_x = m * g_x - k_x * x - c * x.diff(TIME) + A * cos(omega * TIME)
    f_y = m * g_y - k_y * y - c * y.diff(TIME) + A * sin(omega * TIME)
    scene.add_loads((P, f_x * N.x + f_y * N.y + (C * sin(nu * TIME) - m * g_z) * N.z))
    R, F_x, F_y = da.unknowns("R F_x F_y")
    scene.add_joints(da.Joint("plane", body="particle", at=P, force=F_x * N.x + F_y * N.y + R * N.z))
    scene.add_contacts(da.UnilateralContact(R, gap=z, restitution=e, name="plane"))
    slip = (x.diff(TIME) - u_x, y.diff(TIME) - u_y)
    scene.add_friction(da.CoulombFriction(R, (F_x, F_y), slip=slip, mu=mu, name="plane"))
    return Setting("disc", scene, tuple(real.names), (Contact("plane", "R", ("F_x", "F_y")),))


def puck(real: Numbers) -> Setting:
    """Return a particle on a rough table between two smooth walls, that is pushed round."""
    x, y, z = dynamicsymbols("x y z")
    m, g_x, g_y, g_z, A, omega, B, nu, a, b, mu, e = real("m g_x g_y g_z A omega B nu a b mu e")
    N, O = _frame()
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("puck", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("particle", P, m))
    along = (m * g_x + A * cos(omega * TIME)) * N.x + (m * g_y + B * sin(nu * TIME)) * N.y
    scene.add_loads((P, along - m * g_z * N.z))
    R, F_x, F_y, S, T = da.unknowns("R F_x F_y S T")
    scene.add_joints(da.Joint("table", body="particle", at=P, force=F_x * N.x + F_y * N.y + R * N.z))
    scene.add_joints(da.Joint("walls", body="particle", at=P, force=-S * N.x - T * N.y))
    scene.add_contacts(da.UnilateralContact(R, gap=z, name="table", restitution=0))
    scene.add_contacts(da.UnilateralContact(S, gap=a - x, name="right", restitution=e))
    scene.add_contacts(da.UnilateralContact(T, gap=b - y, name="left", restitution=e))
    scene.add_friction(da.CoulombFriction(R, (F_x, F_y), mu=mu, name="table"))
    contacts = Contact("table", "R", ("F_x", "F_y")), Contact("right", "S"), Contact("left", "T")
    return Setting("puck", scene, tuple(real.names), contacts)


def pendulum(real: Numbers) -> Setting:
    """Return a double pendulum, both masses of which may touch a rough wall."""
    a, b = dynamicsymbols("a b")
    m_1, m_2, l_1, l_2, g, d, A, omega, c, mu, e, mu_elbow = real("m_1 m_2 l_1 l_2 g d A omega c mu e mu_elbow")
    N, O = _frame()
    P = O.locatenew("P", l_1 * (sin(a) * N.x - cos(a) * N.y))
    Q = P.locatenew("Q", l_2 * (sin(b) * N.x - cos(b) * N.y))
    U, V = N.orientnew("U", "Axis", (a, N.z)), N.orientnew("V", "Axis", (b, N.z))
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(Particle("elbow", P, m_1), Particle("tip", Q, m_2))
    scene.add_loads((P, -m_1 * g * N.y), (Q, -m_2 * g * N.y))
    scene.add_loads((U, (A * sin(omega * TIME) - c * a.diff(TIME)) * N.z), (V, -c * b.diff(TIME) * N.z))
    contacts = []
    for name, point, out, rough in (("tip", Q, l_1 * sin(a) + l_2 * sin(b), mu), ("elbow", P, l_1 * sin(a), mu_elbow)):
        R, F = da.unknowns(f"R_{name} F_{name}")
        scene.add_joints(da.Joint(name, body=name, at=point, force=F * N.y - R * N.x))
        scene.add_contacts(da.UnilateralContact(R, gap=d - out, restitution=e, name=name))
        scene.add_friction(da.CoulombFriction(R, F, mu=rough, name=name))
        contacts.append(Contact(name, f"R_{name}", (f"F_{name}",)))
    return Setting("pendulum", scene, tuple(real.names), tuple(contacts))


SCENES: dict[str, Callable[[Numbers], Setting]] = {
    "particle": lambda real: particle(real, False),
    "particle static": lambda real: particle(real, True),
    "stack of 2": lambda real: stack(real, 2),
    "stack of 3": lambda real: stack(real, 3),
    "rod on floor": rod_floor,
    "rod in corner": rod_corner,
    "plate": plate,
    "wheel": wheel,
    "slot": slot,
    "ring": ring,
    "trammel": trammel,
    "chain": chain,
    "disc": disc,
    "pendulum": pendulum,
    "puck": puck,
}


@cache
def setting(name: str) -> Setting:
    """Return a scene by name, built once."""
    return SCENES[name](Numbers())


@cache
def compiled(name: str) -> Any:
    """Return the model of a scene, compiled once."""
    return da.compile_model(setting(name).scene, outputs=list(setting(name).outputs))
