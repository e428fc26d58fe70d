"""Random scenes for Hypothesis: one to three bodies in a tree of joints, with constraints, reactions and loads."""

from dataclasses import dataclass, field

import sympy as sp
from hypothesis import strategies as st
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.textbook.geometry import Geometry

TIME = dynamicsymbols._t
AXES = "xyz"
COORDINATES = 4
"""How many coordinates a scene has at most; one more takes SymPy three times as long."""


@dataclass
class Draft:
    """A scene under construction, and what random constraints and loads may refer to."""

    scene: da.Scene
    most: int = COORDINATES
    frames: list = field(default_factory=list)  # body k's frame; the Newtonian one for particles
    points: list = field(default_factory=list)  # body k's mass centre
    parents: list = field(default_factory=list)
    names: list = field(default_factory=list)
    rotations: list = field(default_factory=list)  # (coordinate, body, axis) of revolute joints, axis a vector
    count: int = 0

    def coordinate(self):
        """Return a new coordinate."""
        q = dynamicsymbols(f"q{len(self.scene.coordinates)}")
        self.scene.coordinates += (q,)
        return q

    def symbol(self, wish):
        """Return a new parameter."""
        self.count += 1
        return sp.Symbol(f"{wish}_{self.count}", positive=True)

    def unknown(self):
        """Return a new unknown."""
        self.count += 1
        return da.unknowns(f"X_{self.count}")


def axis(draw, frame):
    return getattr(frame, draw(st.sampled_from(AXES)))


def small_vector(draw, frame):
    """Return a vector fixed in a frame, one or two of its components not zero."""
    numbers = st.sampled_from([0, 0, 1, sp.Rational(1, 2), sp.Rational(-3, 4)])
    x, y, z = draw(numbers), draw(numbers), draw(numbers)
    return (x if (x, y, z) != (0, 0, 0) else 1) * frame.x + y * frame.y + z * frame.z


def room(draft):
    return draft.most - len(draft.scene.coordinates)


def add_body(draw, draft, k):
    """Hang a body on the origin or on an earlier body by a random joint."""
    scene = draft.scene
    parent = draw(st.integers(-1, k - 1))
    base, start = (scene.frame, scene.origin) if parent < 0 else (draft.frames[parent], draft.points[parent])
    hinge = start.locatenew(f"P{k}", small_vector(draw, base) * draft.symbol("a") if parent >= 0 else 0 * base.x)
    kinds = ["revolute", "prismatic", "particle"] + (["universal", "planar"] if room(draft) > 2 else [])
    kind = draw(st.sampled_from(kinds))
    body, frame = f"body{k}", base
    if kind in ("prismatic", "particle"):
        hinge = hinge.locatenew(f"H{k}", draft.coordinate() * axis(draw, base))
    if kind == "planar":
        hinge = hinge.locatenew(f"H{k}", draft.coordinate() * base.x + draft.coordinate() * base.y)
    if kind in ("revolute", "universal", "planar"):
        names = ["z"] if kind == "planar" else draw(st.permutations(AXES))[: 2 if kind == "universal" else 1]
        for i, name in enumerate(names):
            q, direction = draft.coordinate(), getattr(frame, name)
            frame = frame.orientnew(f"F{k}{i}", "Axis", (q, direction))
            if len(names) == 1:
                draft.rotations.append((q, k, direction))
    elif kind == "prismatic" and draw(st.booleans()):
        frame = frame.orientnew(f"F{k}", "Axis", (draw(st.sampled_from([sp.pi / 6, sp.Rational(2, 5)])), frame.y))
    centre = hinge.locatenew(f"G{k}", small_vector(draw, frame) * draft.symbol("b"))
    mass = draft.symbol("m")
    if kind == "particle":
        scene.add_bodies(Particle(body, centre, mass))
    else:
        J = draft.symbol("J")
        moments = inertia(frame, J, 2 * J, sp.Rational(5, 2) * J, J / 3 * draw(st.integers(0, 1)))
        scene.add_bodies(RigidBody(body, centre, frame, mass, (moments, centre)))
    draft.frames.append(frame)
    draft.points.append(centre)
    draft.parents.append(parent)
    draft.names.append(body)


def add_constraint(draw, draft):
    """Add a constraint, and the joint whose unknown force or torque holds it."""
    scene = draft.scene
    N = scene.frame
    kinds = ["height", "blade", "no joint"] + (["driven"] if draft.rotations else [])
    kind = draw(st.sampled_from(kinds))
    k = draw(st.integers(0, len(draft.points) - 1))
    X = draft.unknown()
    if kind == "driven":  # an angle is a given function of time; the torque acts between the two bodies
        q, k, direction = draft.rotations.pop(draw(st.integers(0, len(draft.rotations) - 1)))
        scene.add_holonomic_constraints(q - draft.symbol("w") * sp.sin(TIME))
        scene.add_joints(da.Joint(f"motor{X}", draft.names[k], draft.points[k], torque=X * direction))
        if draft.parents[k] >= 0 and isinstance(scene.bodies[draft.parents[k]], RigidBody):
            other = draft.parents[k]
            scene.add_joints(da.Joint(f"motor back{X}", draft.names[other], draft.points[other], torque=-X * direction))
        return
    P, apart = draft.points[k], small_vector(draw, draft.frames[k])
    if isinstance(scene.bodies[k], RigidBody):  # a particle has no other point
        P = P.locatenew(f"C{X}", apart)
    normal = axis(draw, draft.frames[k] if kind == "blade" else N)
    geometry = Geometry(scene)
    if kind == "blade":
        velocity = geometry.dot(geometry.velocity(P), normal)
        if not velocity.has(sp.Derivative):
            return
        scene.add_nonholonomic_constraints(velocity + draft.symbol("v") * draw(st.integers(0, 1)))
    else:
        height = geometry.dot(geometry.position(P), normal)
        if not height.has(*scene.coordinates):
            return
        scene.add_holonomic_constraints(height - draft.symbol("height"))
    if kind != "no joint":
        scene.add_joints(da.Joint(f"contact{X}", draft.names[k], P, force=X * normal))


def add_load(draw, draft):
    """Add a spring, a damper or a torque."""
    scene, k = draft.scene, draw(st.integers(0, len(draft.points) - 1))
    kind = draw(st.sampled_from(["spring", "damper", "torque"]))
    q = draw(st.sampled_from(list(scene.coordinates)))
    strength = draft.symbol("k")
    if kind == "torque":
        scene.add_loads((draft.frames[k], strength * sp.cos(TIME) * axis(draw, scene.frame)))
    else:
        size = -strength * (q if kind == "spring" else q.diff(TIME))
        scene.add_loads((draft.points[k], size * axis(draw, draft.frames[k])))


@st.composite
def scenes(draw, most=COORDINATES):
    """Return a scene of one to three bodies and up to `most` coordinates; what its constraints allow is not known."""
    N, O = ReferenceFrame("N"), Point("O")
    draft = Draft(da.Scene("random", frame=N, origin=O, coordinates=[]), most)
    for k in range(draw(st.sampled_from([1, 2, 2, 3]))):
        if room(draft):
            add_body(draw, draft, k)
    if draw(st.booleans()):
        draft.scene.apply_uniform_gravity(-draft.symbol("g") * axis(draw, N))
    for _ in range(draw(st.integers(0, 2))):
        add_load(draw, draft)
    for _ in range(draw(st.integers(0, min(2, len(draft.scene.coordinates))))):
        add_constraint(draw, draft)
    if draw(st.booleans()):  # a reaction that some parametrization hides
        k = draw(st.integers(0, len(draft.points) - 1))
        X = draft.unknown()
        draft.scene.add_joints(da.Joint("pin", draft.names[k], draft.points[k], force=X * axis(draw, N)))
    return draft.scene
