"""Closed loops whose constraints lose rank: at some configurations, or at all that they allow."""

import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

m, M, L, g = sp.symbols("m M L g", positive=True)


def _cranks(name, count, more):
    """Return a scene with upright cranks in a row, and their tips."""
    angles = dynamicsymbols(f"a0:{count}")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(name, frame=N, origin=O, coordinates=[*angles, *more])
    tips = []
    for i, angle in enumerate(angles):
        F = N.orientnew(f"crank{i}", "Axis", (-angle, N.z))
        foot = O.locatenew(f"foot{i}", i * L * N.x)
        G = foot.locatenew(f"G{i}", L / 2 * F.y)
        scene.add_bodies(RigidBody(f"crank{i}", G, F, m, (inertia(F, 0, 0, m * L**2 / 12), G)))
        tips.append(foot.locatenew(f"tip{i}", L * F.y))
    return scene, N, tips


def unequal_window():
    """One window whose bar is longer than its base by D: it is nearly singular where the cranks lie down."""
    return windows(1, sp.Symbol("D", positive=True))


def windows(count, longer=0):
    """The N-four-bar mechanism (multibody benchmark A02): all bars are parallel at every quarter turn."""
    angles = dynamicsymbols(f"b0:{count}")
    scene, N, tips = _cranks(f"windows_{count}", count + 1, angles)
    for i, angle in enumerate(angles):
        F = N.orientnew(f"bar{i}", "Axis", (angle, N.z))
        G = tips[i].locatenew(f"H{i}", L / 2 * F.x)
        scene.add_bodies(RigidBody(f"bar{i}", G, F, m, (inertia(F, 0, 0, m * L**2 / 12), G)))
        gap = tips[i].locatenew(f"end{i}", (L + longer) * F.x).pos_from(tips[i + 1])
        scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def platform(count=3, joints=False):
    """A bar on parallel cranks: from the third on, a constraint follows from the others; with the forces at their tips.

    The first crank's force has no power on any coordinate.
    """
    b = dynamicsymbols("b")
    scene, N, tips = _cranks(f"platform_{count}", count, [b])
    F = N.orientnew("bar", "Axis", (b, N.z))
    G = tips[0].locatenew("G", L * F.x)
    scene.add_bodies(RigidBody("bar", G, F, M, (inertia(F, 0, 0, M * L**2 / 3), G)))
    for i in range(1, count):
        end = tips[0].locatenew(f"on{i}", i * L * F.x)
        gap = end.pos_from(tips[i])
        scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
        if joints:
            X, Y = da.unknowns(f"X{i} Y{i}")
            force = X * N.x + Y * N.y
            scene.add_joints(
                da.Joint(f"bar at {i}", body="bar", at=end, force=force),
                da.Joint(f"crank at {i}", body=f"crank{i}", at=tips[i], force=-force),
            )
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def folding_crank():
    """A slider on a crank and a rod of one length: the row of the guide vanishes whenever both stand upright."""
    a, b, x = dynamicsymbols("a b x")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("folding_crank", frame=N, origin=O, coordinates=[a, b, x])
    P = O
    for name, angle in (("crank", a), ("rod", b)):
        F = N.orientnew(name, "Axis", (angle, N.z))
        G = P.locatenew(f"G_{name}", L / 2 * F.x)
        scene.add_bodies(RigidBody(name, G, F, m, (inertia(F, 0, 0, m * L**2 / 12), G)))
        P = P.locatenew(f"end_{name}", L * F.x)
    slider = O.locatenew("slider", x * N.x)
    scene.add_bodies(Particle("slider", slider, M))
    gap = P.pos_from(slider)
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def parallelogram(*, by_angles=False, with_ball=False):
    """Two cranks of one length whose ends stay level at one distance: a row vanishes every quarter turn."""
    a, b, z = dynamicsymbols("a b z")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("parallelogram", frame=N, origin=O, coordinates=[a, b, z] if with_ball else [a, b])
    ends = []
    for i, angle in enumerate((a, b)):
        foot = O.locatenew(f"foot{i}", 2 * i * N.x)
        ends.append(foot.locatenew(f"end{i}", L * sp.cos(angle) * N.x + L * sp.sin(angle) * N.y))
        scene.add_bodies(Particle(f"end{i}", ends[i], m))
    gap = ends[1].pos_from(ends[0]) - 2 * N.x
    scene.add_holonomic_constraints(*((a - b,) if by_angles else (gap.dot(N.x), gap.dot(N.y))))
    if with_ball:
        ball = O.locatenew("ball", z * N.y)
        scene.add_bodies(Particle("ball", ball, m))
        force, X, Y = da.unknowns("F X Y")
        scene.add_joints(
            da.Joint("floor", body="ball", at=ball, force=force * N.y),
            da.Joint("bar at 0", body="end0", at=ends[0], force=X * N.x + Y * N.y),
            da.Joint("bar at 1", body="end1", at=ends[1], force=-X * N.x - Y * N.y),
        )
        scene.add_contacts(da.UnilateralContact(force, gap=z, restitution=0))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def carried(length):
    """A bar that three cranks of a length carry without turning: more constraints than coordinates."""
    cranks = dynamicsymbols("a0:3")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("carried", frame=N, origin=O, coordinates=cranks)
    ends = []
    for i, angle in enumerate(cranks):
        end = O.locatenew(f"end{i}", (i + length * sp.sin(angle)) * N.x + length * sp.cos(angle) * N.y)
        scene.add_bodies(Particle(f"end{i}", end, m))
        ends.append(end)
        if i:
            gap = end.pos_from(ends[0]) - i * N.x
            scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def bars(parallel=False):
    """A bar on three parallel cranks, two of which are lengths alone; `parallel`: the bar only shifts."""
    a, b = dynamicsymbols("a b")
    N, O = ReferenceFrame("N"), Point("O")
    A, B = N.orientnew("A", "Axis", (a, N.z)), N.orientnew("B", "Axis", (0 if parallel else a + b, N.z))
    tip = O.locatenew("tip", sp.Rational(4, 5) * A.x)
    scene = da.Scene("bars", frame=N, origin=O, coordinates=[a] if parallel else [a, b])
    scene.add_bodies(RigidBody("bar", tip, B, 1, (inertia(B, 0, 0, 1), tip)))
    scene.add_loads((tip, sp.Symbol("F") * N.y))
    for name, at in () if parallel else (("middle", sp.Rational(7, 5)), ("end", sp.Rational(14, 5))):
        gap = tip.locatenew(name, at * B.x).pos_from(O.locatenew(f"foot_{name}", at * N.x))
        scene.add_holonomic_constraints(gap.dot(gap) - sp.Rational(16, 25))
    return scene
