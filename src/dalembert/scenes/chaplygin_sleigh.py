"""The Chaplygin sleigh: example 13.4.6."""

from sympy import cos, sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from ..scene import Joint, Scene, unknowns


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
