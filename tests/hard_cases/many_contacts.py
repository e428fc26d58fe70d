"""Scenes of many contacts: bodies on sprung legs, and stacks of boxes, with values and states at rest."""

import math
from collections.abc import Mapping

import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

__all__ = [
    "boxes",
    "boxes_at_rest",
    "feet",
    "feet_at_rest",
    "legged",
    "legged_at_rest",
    "standing",
    "standing_at_rest",
    "turning",
    "turning_at_rest",
]

TIME = dynamicsymbols._t


def _rough_floor(scene: da.Scene, name: str, body: str, at: Point, gap: sp.Expr, tangents: tuple, mu: sp.Expr) -> None:
    """Add a contact of a point with the floor, with friction along one direction or two."""
    normal, *forces = da.unknowns(" ".join([f"N_{name}", *(f"F{i}_{name}" for i in range(len(tangents)))]))
    force = normal * scene.frame.z + sum((f * e for f, e in zip(forces, tangents, strict=True)), 0 * scene.frame.x)
    scene.add_joints(da.Joint(name, body=body, at=at, force=force))
    scene.add_contacts(da.UnilateralContact(normal, gap=gap, name=name))
    tangential = forces[0] if len(forces) == 1 else tuple(forces)
    scene.add_friction(da.CoulombFriction(normal, tangential, mu=mu, name=name))


def _soft_floor(scene: da.Scene, at: Point, gap: sp.Expr, m: sp.Expr, mu: sp.Expr) -> None:
    """Add a load in place of a contact: a spring with a damper that only pushes, and friction that is smooth in slip.

    The damping is critical for the mass `m`. Stiffness and slip speed are the parameters k_floor and eps.
    """
    k, eps = sp.symbols("k_floor eps", positive=True)
    velocity = at.pos_from(scene.origin).dt(scene.frame)
    x, y, z = (velocity.dot(axis) for axis in scene.frame)
    normal = sp.Piecewise((sp.Max(0, -k * gap - 2 * sp.sqrt(k * m) * z), gap < 0), (0, True))
    opposing = -mu * normal / sp.sqrt(x**2 + y**2 + eps**2)
    scene.add_loads((at, opposing * (x * scene.frame.x + y * scene.frame.y) + normal * scene.frame.z))


def feet(count: int) -> da.Scene:
    """Return a body in a vertical plane on legs with springs and dampers, whose feet have masses, on a rough floor."""
    m, M, J, g, mu, k, c, l, w = sp.symbols("m M J g mu k c l w", positive=True)
    push = sp.Symbol("push", real=True)
    N, O = ReferenceFrame("N"), Point("O")
    x, z, a = dynamicsymbols("x z a")
    places = [dynamicsymbols(f"x{i} z{i}") for i in range(count)]
    coordinates = [x, z, a, *(q for place in places for q in place)]
    scene = da.Scene(f"body on {count} legs", frame=N, origin=O, coordinates=coordinates)
    B, C = N.orientnew("B", "Axis", (a, -N.y)), O.locatenew("C", x * N.x + z * N.z)
    scene.add_bodies(RigidBody("trunk", C, B, M, (inertia(B, 0, J, 0), C)))
    for i, (u, v) in enumerate(places):
        foot = O.locatenew(f"P{i}", u * N.x + v * N.z)
        hip = C.locatenew(f"H{i}", w * (sp.Rational(2 * i, count - 1) - 1) * B.x)
        scene.add_bodies(Particle(f"foot{i}", foot, m))
        _rough_floor(scene, f"c{i}", f"foot{i}", foot, v, (N.x,), mu)
        leg, rate = hip.pos_from(foot), hip.pos_from(foot).diff(TIME, N)
        force = k * (l * N.z - leg) - c * rate
        scene.add_loads((hip, force), (foot, -force))
    scene.add_loads((C, push * sp.sin(3 * TIME) * N.x))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def feet_at_rest(count: int, uneven: float = 0.01) -> tuple[dict[str, float], dict[str, float]]:
    """Return a start and parameters; the feet are displaced from their hips by `uneven` times 1, 4, 9 and so on."""
    p = {"m": 0.2, "M": 4.0, "J": 0.3, "g": 10.0, "mu": 0.5, "k": 400.0, "c": 8.0, "l": 0.5, "w": 0.4, "push": 25.0}
    names = ["x", "z", "a", *(f"{b}{i}" for i in range(count) for b in "xz")]
    start = dict.fromkeys([*names, *(f"{name}_dot" for name in names)], 0.0) | {"z": 0.5}
    start |= {f"x{i}": 0.4 * (2 * i / (count - 1) - 1) + uneven * (i + 1) ** 2 for i in range(count)}
    return start, p


def standing(count: int = 4, *, soft: bool = False) -> da.Scene:
    """Return a point on sprung legs around it, whose feet have masses, on a rough floor with friction in a plane.

    On a `soft` floor there are no contacts: springs, dampers and smooth friction are loads.
    """
    m, M, g, mu, k, c, l = sp.symbols("m M g mu k c l", positive=True)
    push, w = sp.Symbol("push", real=True), sp.Symbol("w", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    whole = dynamicsymbols("x y z")
    places = [dynamicsymbols(f"x{i} y{i} z{i}") for i in range(count)]
    coordinates = [*whole, *(q for place in places for q in place)]
    scene = da.Scene(f"point on {count} legs", frame=N, origin=O, coordinates=coordinates)
    C = O.locatenew("C", whole[0] * N.x + whole[1] * N.y + whole[2] * N.z)
    scene.add_bodies(Particle("trunk", C, M))
    for i, (a, b, h) in enumerate(places):
        foot = O.locatenew(f"P{i}", a * N.x + b * N.y + h * N.z)
        aside = w * ((-1) ** i * N.x + (-1) ** (i // 2) * N.y)
        scene.add_bodies(Particle(f"foot{i}", foot, m))
        if soft:
            _soft_floor(scene, foot, h, m, mu)
        else:
            _rough_floor(scene, f"c{i}", f"foot{i}", foot, h, (N.x, N.y), mu)
        leg = C.pos_from(foot) + aside
        force = k * (l * N.z - leg) - c * leg.diff(TIME, N)
        scene.add_loads((C, force), (foot, -force))
    scene.add_loads((C, push * (sp.sin(3 * TIME) * N.x + sp.cos(2 * TIME) * N.y)))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def standing_at_rest(count: int = 4) -> tuple[dict[str, float], dict[str, float]]:
    """Return a start and parameters of a point on sprung legs."""
    p = {"m": 0.2, "M": 4.0, "g": 10.0, "mu": 0.5, "k": 400.0, "c": 8.0, "l": 0.5, "w": 0.4, "push": 30.0}
    names = ["x", "y", "z", *(f"{b}{i}" for i in range(count) for b in "xyz")]
    start = dict.fromkeys([*names, *(f"{name}_dot" for name in names)], 0.0) | {"z": 0.5}
    start |= {f"x{i}": 0.4 * (-1) ** i + 0.01 * (i + 1) for i in range(count)}
    start |= {f"y{i}": 0.4 * (-1) ** (i // 2) - 0.01 * i**2 for i in range(count)}
    return start, p


def turning() -> da.Scene:
    """Return a body that a quaternion turns, on four sprung legs whose feet have masses, on a rough floor in space."""
    m, M, J, g, mu, k, c, l, w = sp.symbols("m M J g mu k c l w", positive=True)
    push, N, O = sp.Symbol("push", real=True), ReferenceFrame("N"), Point("O")
    whole, e = dynamicsymbols("x y z"), dynamicsymbols("e0:4")
    places = [dynamicsymbols(f"x{i} y{i} z{i}") for i in range(4)]
    coordinates = [*whole, *e, *(q for place in places for q in place)]
    scene = da.Scene("turning body on 4 legs", frame=N, origin=O, coordinates=coordinates)
    B, C = ReferenceFrame("B"), O.locatenew("C", sum((q * axis for q, axis in zip(whole, N, strict=True)), 0 * N.x))
    B.orient(N, "Quaternion", e)
    scene.add_holonomic_constraints(sum(each**2 for each in e) - 1)
    scene.add_bodies(RigidBody("trunk", C, B, M, (inertia(B, J, 2 * J, 3 * J), C)))
    for i, (a, b, h) in enumerate(places):
        foot = O.locatenew(f"P{i}", a * N.x + b * N.y + h * N.z)
        hip = C.locatenew(f"H{i}", w * ((-1) ** i * B.x + (-1) ** (i // 2) * B.y))
        scene.add_bodies(Particle(f"foot{i}", foot, m))
        _rough_floor(scene, f"c{i}", f"foot{i}", foot, h, (N.x, N.y), mu)
        leg = hip.pos_from(foot)
        force = k * (l * N.z - leg) - c * leg.diff(TIME, N)
        scene.add_loads((hip, force), (foot, -force))
    scene.add_loads((C, push * (sp.sin(3 * TIME) * N.x + sp.cos(2 * TIME) * N.y)))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def turning_at_rest() -> tuple[dict[str, float], dict[str, float]]:
    """Return a start and parameters of the body that a quaternion turns."""
    start, p = standing_at_rest()
    turned = {"e0": 0.96, "e1": 0.0, "e2": 0.0, "e3": 0.28}
    return start | turned | {f"{name}_dot": 0.0 for name in turned}, p | {"J": 0.1}


_PARTS = {"hip": (0.5, 5e-4), "thigh": (0.8, 3e-3), "shank": (0.15, 6e-4)}
"""Mass and moment of inertia of the bodies of a leg."""


def legged(count: int = 4, period: float = 0.002) -> da.Scene:
    """Return a trunk that moves freely on legs of three joints, which a controller holds, with rough point feet.

    Pairs of legs stand one behind the other, a left and a right one each.
    """
    g, mu, push, N, O = *sp.symbols("g mu push"), ReferenceFrame("N"), Point("O")
    T, place, e = ReferenceFrame("T"), dynamicsymbols("x y z"), dynamicsymbols("e0:4")
    angles = [dynamicsymbols(f"hip{i} thigh{i} knee{i}") for i in range(count)]
    torques = [dynamicsymbols(f"tau{i}_1:4") for i in range(count)]
    T.orient(N, "Quaternion", e)
    C = O.locatenew("C", sum((q * axis for q, axis in zip(place, N, strict=True)), 0 * N.x))
    coordinates = [*place, *e, *(q for leg in angles for q in leg)]
    scene = da.Scene(f"trunk on {count} legs", frame=N, origin=O, coordinates=coordinates)
    scene.add_holonomic_constraints(sum(each**2 for each in e) - 1)
    scene.add_bodies(RigidBody("trunk", C, T, 8, (inertia(T, 0.05, 0.2, 0.22), C)))
    scene.add_inputs(*(tau for leg in torques for tau in leg))
    scene.add_loads((C, push * N.y))
    scene.apply_uniform_gravity(-g * N.z)
    law, pairs = {}, (count + 1) // 2
    for i in range(count):
        side, last = (-1) ** i, T
        ahead = 0.4 * (sp.Rational(1, 2) - sp.Rational(i // 2, pairs - 1)) if pairs > 1 else 0
        start = C.locatenew(f"H{i}", ahead * T.x + 0.05 * side * T.y)
        for part, q, tau, letter in zip(_PARTS, angles[i], torques[i], "xyy", strict=True):
            axis, (m, J) = getattr(last, letter), _PARTS[part]
            S = last.orientnew(f"{part}{i}", "Axis", (q, axis))
            torque = (tau - 0.2 * q.diff(TIME)) * axis
            scene.add_loads((S, torque), (last, -torque))
            way = 0.08 * side * S.y if part == "hip" else -0.2 * S.z
            G = start.locatenew(f"G_{part}{i}", way / 2)
            about = inertia(S, J, J, J if part == "hip" else J / 10)
            scene.add_bodies(RigidBody(f"{part}{i}", G, S, m, (about, G)))
            start, last = start.locatenew(f"{part}_{i}", way), S
        floor = {"point": start, "plane": (O, N.z), "friction": mu}
        scene.add_contacts(da.PointPlane(f"foot{i}", body=f"shank{i}", **floor))
        for q, tau, angle in zip(angles[i], torques[i], _BENT, strict=True):
            law[tau] = 300 * (angle - q) - 1.5 * q.diff(TIME)
    scene.add_controllers(da.Controller("legs", period=period, inputs=law))
    return scene


_BENT = 0, 0.7, -1.4


def legged_at_rest(count: int = 4) -> tuple[dict[str, float], dict[str, float]]:
    """Return a start and parameters of a trunk on legs, whose feet touch the floor."""
    legs = {
        f"{part}{i}": angle for i in range(count) for part, angle in zip(("hip", "thigh", "knee"), _BENT, strict=True)
    }
    start = {"x": 0.0, "y": 0.0, "z": 0.4 * math.cos(0.7), "e0": 1.0, "e1": 0.0, "e2": 0.0, "e3": 0.0} | legs
    return start | {f"{name}_dot": 0.0 for name in start}, {"g": 9.81, "mu": 0.6, "push": 0.0}


def boxes(count: int) -> da.Scene:
    """Return boxes in a vertical plane on each other, each on two corners with friction; the lowest one is pushed."""
    m, g, mu, w, h, J = sp.symbols("m g mu w h J", positive=True)
    push = sp.Symbol("push", real=True)
    N, O = ReferenceFrame("N"), Point("O")
    places = [dynamicsymbols(f"x{i} z{i} a{i}") for i in range(count)]
    scene = da.Scene(f"stack of {count}", frame=N, origin=O, coordinates=[q for place in places for q in place])
    below: tuple[ReferenceFrame, Point] | None = None
    for i, (x, z, a) in enumerate(places):
        B, C = N.orientnew(f"B{i}", "Axis", (a, -N.y)), O.locatenew(f"C{i}", x * N.x + z * N.z)
        scene.add_bodies(RigidBody(f"box{i}", C, B, m, (inertia(B, 0, J, 0), C)))
        for side, sign in (("l", -1), ("r", 1)):
            corner, name = C.locatenew(f"P{i}{side}", sign * w * B.x - h * B.z), f"c{i}{side}"
            if below is None:
                _rough_floor(scene, name, f"box{i}", corner, corner.pos_from(O).dot(N.z), (N.x,), mu)
            else:
                _rough_lid(scene, name, (f"box{i}", f"box{i - 1}"), corner, below, h, mu)
        below = B, C
    scene.add_loads((scene.bodies[0].masscenter, push * sp.sin(3 * TIME) * N.x))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def _rough_lid(
    scene: da.Scene,
    name: str,
    bodies: tuple[str, str],
    corner: Point,
    below: tuple[ReferenceFrame, Point],
    h: sp.Expr,
    mu: sp.Expr,
) -> None:
    """Add a contact of a corner with the upper side of the box below."""
    A, D = below
    along, up = (sp.simplify(corner.pos_from(D).dot(axis)) for axis in (A.x, A.z))
    normal, force = da.unknowns(f"N_{name} F0_{name}")
    touched, pressing = D.locatenew(f"Q_{name}", along * A.x + up * A.z), force * A.x + normal * A.z
    scene.add_joints(da.Joint(f"{name}_up", body=bodies[0], at=corner, force=pressing))
    scene.add_joints(da.Joint(f"{name}_down", body=bodies[1], at=touched, force=-pressing))
    scene.add_contacts(da.UnilateralContact(normal, gap=up - h, name=name))
    scene.add_friction(da.CoulombFriction(normal, force, slip=along.diff(TIME), mu=mu, name=name))


def boxes_at_rest(count: int, **values: float) -> tuple[dict[str, float], Mapping[str, float]]:
    """Return a start and parameters of a stack of boxes."""
    p = {"m": 1.0, "g": 10.0, "mu": 0.5, "w": 0.5, "h": 0.25, "J": 0.1, "push": 8.0 * count, **values}
    start = {f"{n}{i}{rate}": 0.0 for n in "xza" for i in range(count) for rate in ("", "_dot")}
    return start | {f"z{i}": 0.25 + 0.5 * i for i in range(count)}, p
