"""A ball that slides on a table until it rolls: friction in two directions."""

from sympy import Rational, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from ..scene import CoulombFriction, Joint, Scene, unknowns


def billiard_ball() -> Scene:
    r"""Build the scene of a homogeneous ball on a rough table, its attitude as a quaternion.

    Its coordinates are

    - x, y, z: position of the centre G [m];
    - e0, e1, e2, e3: quaternion of unit norm from the ball to space, scalar first;

    its parameters

    - m: mass [kg];
    - r: radius [m];
    - mu: coefficient of friction;
    - g: acceleration of gravity [m/s^2];

    its unknowns

    - N: normal force of the table on the ball [N];
    - F_x, F_y: friction force of the table on the ball, along N.x and N.y [N].

    Returns
    -------
    Scene
        Seven coordinates, two holonomic constraints, one friction, "table", in two directions.

    Notes
    -----
    The slip velocity u at the contact point keeps its direction and falls at the rate (7/2) mu g, so that the ball
    rolls from t = 2 |u| / (7 mu g) on, with constant velocity (L. Euler, 1758; G. Coriolis, 1835).
    """
    x, y, z = dynamicsymbols("x y z")
    e = dynamicsymbols("e0:4")
    m, r, mu, g = symbols("m r mu g", positive=True)

    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Quaternion", e)
    G = O.locatenew("G", x * N.x + y * N.y + z * N.z)
    I = G.locatenew("I", -r * N.z)

    scene = Scene("billiard_ball", frame=N, origin=O, coordinates=[x, y, z, *e])
    J = Rational(2, 5) * m * r**2
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, J, J, J), G)))
    scene.apply_uniform_gravity(-g * N.z)
    normal, F_x, F_y = unknowns("N F_x F_y")
    scene.add_joints(Joint("table", body="ball", at=I, force=F_x * N.x + F_y * N.y + normal * N.z))
    scene.add_holonomic_constraints(z - r, sum(component**2 for component in e) - 1)
    scene.add_friction(CoulombFriction(normal, (F_x, F_y), mu=mu, name="table"))
    return scene
