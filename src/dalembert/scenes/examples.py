"""The worked examples of section 13.4."""

from sympy import Rational, cos, cot, sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from ..scene import CoulombFriction, Joint, Scene, unknowns


def corner_plate(*, friction: bool = False) -> Scene:
    r"""Build the scene of example 13.4.2, a plate whose end A slides on the ground and which leans on a corner Q.

    Its coordinates are

    - x: position of A on the ground [m], counted from the foot of the corner, so that the constant of
      equation (3) is zero;
    - theta: angle from the ground N.x to the plate's axis S.x, between 0 and pi [rad];

    its parameters

    - m: mass [kg];
    - l: distance from A to the mass centre G, along S.x; the plate is 2 l long [m];
    - h: height of the corner Q above the ground [m];
    - g: acceleration of gravity [m/s^2];
    - F_A: given horizontal force on the plate at A [N];
    - mu: coefficient of friction at the corner, where there is friction;

    its unknowns

    - N_Q, F_Q: force of the corner on the plate, along S.y and S.x [N];
    - N_A: vertical force of the ground on the plate at A [N].

    Parameters
    ----------
    friction : bool
        Whether the plate rubs on the corner, equation (4) of the example; without, the corner is an ideal joint.

    Returns
    -------
    Scene
        Two coordinates, one holonomic constraint; with friction, "corner".

    Notes
    -----
    The plate touches the corner, equation (3) of the example:

    .. math:: x + h \cot\theta = 0

    N_Q holds it. As an ideal joint the corner has F_Q = 0; with friction, Coulomb's law holds, equation (4):

    .. math:: |F_Q| = \mu N_Q

    while the plate slips, with the sign that opposes the slip velocity of Q. The power of the force at A is
    taken along N.x alone, because A moves on the ground by parametrization: N_A is an output of models, and
    `dalembert.lagrange` has it once that coordinate is released, ``scene.release(y, A, N.y)``.
    """
    x, theta = dynamicsymbols("x theta")
    m, l, h, g, F_A = symbols("m l h g F_A", positive=True)

    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    A = O.locatenew("A", x * N.x)
    G = A.locatenew("G", l * S.x)
    Q = A.locatenew("Q", h / sin(theta) * S.x)

    scene = Scene("corner_plate", frame=N, origin=O, coordinates=[x, theta])
    scene.add_bodies(RigidBody("plate", G, S, m, (inertia(S, 0, 0, Rational(1, 3) * m * l**2), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((A, F_A * N.x))
    N_A, N_Q, F_Q = unknowns("N_A N_Q F_Q")
    scene.add_joints(
        Joint("ground", body="plate", at=A, force=N_A * N.y),
        Joint("corner", body="plate", at=Q, force=N_Q * S.y + F_Q * S.x),
    )
    scene.add_holonomic_constraints(x + h * cot(theta))
    if friction:
        scene.add_friction(CoulombFriction(N_Q, F_Q, mu=symbols("mu", positive=True), name="corner"))
    return scene


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


def edge_plate() -> Scene:
    r"""Build the scene of example 13.4.4, a plate that slides with its edge on the plane (O, N.x, N.y).

    Its coordinates are

    - x, y, z: position of the mass centre G [m];
    - psi, theta: angles of the rotations about N.z, then about the edge A.x [rad];

    its parameters

    - m: mass [kg];
    - A, B, C: moments of inertia about G along S.x, S.y and the normal S.z; C = A + B for a thin plate [kg m^2];
    - F: entry (x, y) of the inertia matrix about G, zero where S.x and S.y are principal directions [kg m^2];
    - h: distance from the edge to G, from H along S.y [m];
    - g: acceleration of gravity [m/s^2];

    its unknowns

    - X, Y, Z: force of the plane on the plate at H, along N.x, N.y and N.z [N];
    - L, M, N: moment of the plane on the plate about H, along A.x (the edge), A.y and A.z [N m].

    Returns
    -------
    Scene
        Five coordinates, one holonomic constraint.

    Notes
    -----
    The edge stays on the plane, equation (1) of the example:

    .. math:: z = h \sin\theta

    The joint is ideal when X = Y = 0 and L = N = 0. No coordinate is left on which M has power: the two
    angles keep the edge horizontal. It is an output of models, and `dalembert.lagrange` has it once a rotation about
    A.y is released, ``scene.release(phi, A, A.y)``.
    """
    x, y, z, psi, theta = dynamicsymbols("x y z psi theta")
    m, A, B, C, h, g = symbols("m A B C h g", positive=True)
    F = symbols("F", real=True)

    N, O = ReferenceFrame("N"), Point("O")
    E = N.orientnew("A", "Axis", (psi, N.z))
    S = E.orientnew("S", "Axis", (theta, E.x))
    G = O.locatenew("G", x * N.x + y * N.y + z * N.z)
    H = G.locatenew("H", -h * S.y)

    scene = Scene("edge_plate", frame=N, origin=O, coordinates=[x, y, z, psi, theta])
    scene.add_bodies(RigidBody("plate", G, S, m, (inertia(S, A, B, C, F, 0, 0), G)))
    scene.apply_uniform_gravity(-g * N.z)
    X, Y, Z, L, M, N_H = unknowns("X Y Z L M N")
    force = X * N.x + Y * N.y + Z * N.z
    scene.add_joints(Joint("edge", body="plate", at=H, force=force, torque=L * E.x + M * E.y + N_H * N.z))
    scene.add_holonomic_constraints(z - h * sin(theta))
    return scene


def chaplygin_sleigh() -> Scene:
    r"""Build the scene of example 13.4.6, a rigid body on a blade that slides over a horizontal plane.

    Its coordinates are

    - x, y: position of the blade's contact point C [m];
    - theta: angle from N.x to the sleigh's axis S.x [rad];

    its parameters

    - m: mass [kg];
    - b: distance from C to the mass centre G, along S.x [m];
    - I_C: moment of inertia about the vertical through C, more than m b^2 [kg m^2];

    its unknowns

    - X, Y: horizontal force of the plane on the blade, along N.x and N.y [N];
    - N: vertical moment of the plane on the blade [N m].

    Returns
    -------
    Scene
        Three coordinates, one nonholonomic constraint.

    Notes
    -----
    The blade keeps the velocity of C along S.x, equation (1) of the example:

    .. math:: -\dot x \sin\theta + \dot y \cos\theta = 0

    The joint is ideal when N = 0 and X cos(theta) + Y sin(theta) = 0, equations (2-3). With v the velocity
    of C along S.x, and omega the rate of theta, equations (1) to (6) then reduce to

    .. math::

        \dot v = b\,\omega^2, \qquad I_C\,\dot\omega = -m b\,v\,\omega, \qquad
        \dot x = v\cos\theta, \quad \dot y = v\sin\theta, \quad \dot\theta = \omega,

    which are regular for every theta, where the form of the text in the rates of x and y divides by
    cos(theta). They conserve m v^2 + I_C omega^2. The reaction of the blade is along S.y:

    .. math:: (X, Y) = m\,v\,\omega\,(1 - m b^2 / I_C)\,(-\sin\theta, \cos\theta)
    """
    x, y, theta = dynamicsymbols("x y theta")
    m, b, I_C = symbols("m b I_C", positive=True)

    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    G = C.locatenew("G", b * S.x)

    scene = Scene("chaplygin_sleigh", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("sleigh", G, S, m, (inertia(S, 0, 0, I_C - m * b**2), G)))
    X, Y, N_z = unknowns("X Y N")
    scene.add_joints(Joint("blade", body="sleigh", at=C, force=X * N.x + Y * N.y, torque=N_z * N.z))
    scene.add_nonholonomic_constraints(-x.diff() * sin(theta) + y.diff() * cos(theta))
    return scene
