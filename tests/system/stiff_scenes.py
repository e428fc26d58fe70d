"""Scenes with modes that die out a thousand times faster than anything happens."""

import numpy as np
import sympy as sp
from sympy import cos, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

GOVERNOR = {"K": 8e5, "C": 4e4, "l0": 0.5, "e": 0.05, "g": 9.81, "m_r": 0.3, "m_p": 5.0, "m_s": 3.0}
GOVERNOR |= {"I_t": 0.3 * (1 + 1e-4) / 12, "I_a": 0.3 * 1e-4 / 6}
GOVERNOR_START = {"al": np.pi / 6, "s": 0.5, "phi": 0.0, "al_dot": 0.0, "s_dot": 0.0, "phi_dot": 2 * np.pi}
GOVERNOR_END = {"al": 0.39007370184464508, "s": 0.61962291706136566, "phi": 55.935409909102379}
"""At t = 10 (multibody benchmark A05; values computed with 22 digits)."""


def governor():
    """The stiff flyball governor: springs with strong dampers between a slider and the rods of two balls."""
    al, s, phi = dynamicsymbols("al s phi")
    K, C, l0, e, g, m_r, m_p, m_s, I_t, I_a = symbols("K C l0 e g m_r m_p m_s I_t I_a", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("governor", frame=N, origin=O, coordinates=[al, s, phi])
    shaft = N.orientnew("shaft", "Axis", (phi, N.y))
    middle = O.locatenew("middle", s * N.y)
    cube = inertia(shaft, 0, m_s * sp.Rational(1, 600), 0)
    scene.add_bodies(
        RigidBody("shaft", O, shaft, m_r, (inertia(shaft, 0, I_a, 0), O)),
        RigidBody("slider", middle, shaft, m_s, (cube, middle)),
    )
    length = sqrt(cos(al) ** 2 / 4 + (1 - sin(al) / 2 - s) ** 2)
    force = K * (length - l0) + C * length.diff(dynamicsymbols._t)
    for side in (1, -1):
        rod = shaft.orientnew(f"rod{side + 1}", "Axis", (-side * al, shaft.z))
        hinge = O.locatenew(f"hinge{side + 1}", side * e * shaft.x + shaft.y)
        centre = hinge.locatenew(f"centre{side + 1}", side * rod.x / 2)
        ball = hinge.locatenew(f"ball{side + 1}", side * rod.x)
        scene.add_bodies(
            RigidBody(f"rod{side + 1}", centre, rod, m_r, (inertia(rod, I_a, I_t, I_t), centre)),
            Particle(f"ball{side + 1}", ball, m_p),
        )
        foot = O.locatenew(f"foot{side + 1}", side * e * shaft.x + s * shaft.y)
        pull = force / length * centre.pos_from(foot)
        scene.add_loads((centre, -pull), (foot, pull))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def damped_pair(count=1):
    """Pendulums on carts that strong dampers tie to the ground: ``x`` creeps, ``a`` swings."""
    q = dynamicsymbols(f"x0:{count}") + dynamicsymbols(f"a0:{count}")
    m, l, g, c, k = symbols("m l g c k", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(f"damped_{count}", frame=N, origin=O, coordinates=q)
    for i in range(count):
        x, a = q[i], q[count + i]
        F = N.orientnew(f"F{i}", "Axis", (a, N.z))
        cart = O.locatenew(f"cart{i}", x * N.x)
        bob = cart.locatenew(f"bob{i}", -l * F.y)
        scene.add_bodies(Particle(f"cart{i}", cart, m), Particle(f"bob{i}", bob, m))
        scene.add_loads((cart, (-c * x.diff() - k * x) * N.x))
    scene.apply_uniform_gravity(-g * N.y)
    return scene
