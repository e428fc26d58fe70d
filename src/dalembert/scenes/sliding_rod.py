"""A rod whose end slides on rough ground: the scene of Painleve's paradoxes."""

from sympy import Rational, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from ..scene import CoulombFriction, Joint, Scene, UnilateralContact, unknowns


def sliding_rod() -> Scene:
    r"""Build the scene of a homogeneous rod with one end A on rough ground.

    Its coordinates are

    - x, y: position of A, and its height above the ground [m];
    - theta: angle from the ground N.x to the rod's axis S.x, from A to the mass centre G [rad];

    its parameters

    - m: mass [kg];
    - l: distance from A to G; the rod is 2 l long [m];
    - mu: coefficient of friction;
    - g: acceleration of gravity [m/s^2];

    its unknowns

    - N, F: force of the ground on the rod at A, upwards and along N.x [N].

    Returns
    -------
    Scene
        Three coordinates, one contact with friction, "ground".

    Notes
    -----
    While A slides with x_dot < 0 and stays on the ground, the normal reaction follows from p N + b = 0, where

    .. math::

        m\,p = 1 + 3\cos\theta\,(\cos\theta - \mu\sin\theta), \qquad b = l\,\dot\theta^2\sin\theta - g.

    p is negative for some angles once mu > 4/3, first at tan(theta) = 2. There the laws of contact and friction
    contradict each other when b < 0, and leave the motion undetermined when b > 0 (P. Painleve, Lecons sur le
    frottement, 1895; F. Genot and B. Brogliato, European Journal of Mechanics A 18 (1999) 653).
    """
    x, y, theta = dynamicsymbols("x y theta")
    m, l, mu, g = symbols("m l mu g", positive=True)

    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    A = O.locatenew("A", x * N.x + y * N.y)
    G = A.locatenew("G", l * S.x)

    scene = Scene("sliding_rod", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("rod", G, S, m, (inertia(S, 0, 0, Rational(1, 3) * m * l**2), G)))
    scene.apply_uniform_gravity(-g * N.y)
    normal, friction = unknowns("N F")
    scene.add_joints(Joint("ground", body="rod", at=A, force=friction * N.x + normal * N.y))
    scene.add_contacts(UnilateralContact(normal, gap=y, name="ground"))
    scene.add_friction(CoulombFriction(normal, friction, mu=mu))
    return scene
