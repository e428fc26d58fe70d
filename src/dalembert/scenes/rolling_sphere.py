"""A homogeneous sphere that rolls without slip on a horizontal plane: example 13.4.3."""

from sympy import Rational, cos, sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from ..scene import Joint, Scene, unknowns


def rolling_sphere() -> Scene:
    r"""Build the scene of example 13.4.3, a homogeneous sphere in contact at I with a horizontal plane.

    Its coordinates are

    - x, y: horizontal position of the centre G [m];
    - psi, theta, phi: angles of the rotations about N.z, then A.x = u, then B.z [rad];

    its parameters

    - m: mass [kg];
    - r: radius [m];
    - g: acceleration of gravity [m/s^2];

    its unknowns

    - F_u, F_v: friction force of the plane on the sphere, along A.x and A.y [N];
    - N: normal force of the plane on the sphere [N].

    Returns
    -------
    Scene
        Five coordinates, two nonholonomic constraints.

    Notes
    -----
    The velocity of the sphere at its contact point vanishes, equations (6) and (7) of the example:

    .. math::

        \dot x &= \phantom{-} r\dot\theta\sin\psi - r\dot\phi\sin\theta\cos\psi \\
        \dot y &= -r\dot\theta\cos\psi - r\dot\phi\sin\theta\sin\psi

    With the angular velocity omega taken along N.x, N.y and N.z, equations (1) to (7) reduce to

    .. math::

        \dot\omega_x = \dot\omega_y = \dot\omega_z = 0, \qquad
        \dot x = r\,\omega_y, \quad \dot y = -r\,\omega_x, \qquad F_u = F_v = 0:

    the centre moves uniformly on a straight line, and the rotation is about an axis fixed in space. The
    rates of the three angles follow from omega; only the sum or the difference of psi and phi has a meaning
    where sin(theta) = 0. The height of G is r by parametrization, so N has no power in any virtual motion
    and no equation of a coordinate determines it: it is m g, from the balance of the sphere along N.z.
    """
    x, y, psi, theta, phi = dynamicsymbols("x y psi theta phi")
    m, r, g = symbols("m r g", positive=True)

    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (psi, N.z))
    B = A.orientnew("B", "Axis", (theta, A.x))
    S = B.orientnew("S", "Axis", (phi, B.z))
    G = O.locatenew("G", x * N.x + y * N.y + r * N.z)
    I = G.locatenew("I", -r * N.z)

    scene = Scene("rolling_sphere", frame=N, origin=O, coordinates=[x, y, psi, theta, phi])
    J = Rational(2, 5) * m * r**2
    scene.add_bodies(RigidBody("sphere", G, S, m, (inertia(S, J, J, J), G)))
    scene.apply_uniform_gravity(-g * N.z)
    F_u, F_v, N_I = unknowns("F_u F_v N")
    scene.add_joints(Joint("ground", body="sphere", at=I, force=F_u * A.x + F_v * A.y + N_I * N.z))
    scene.add_nonholonomic_constraints(
        x.diff() - r * theta.diff() * sin(psi) + r * phi.diff() * sin(theta) * cos(psi),
        y.diff() + r * theta.diff() * cos(psi) + r * phi.diff() * sin(theta) * sin(psi),
    )
    return scene
