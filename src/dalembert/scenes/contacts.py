"""Scenes with friction and contacts."""

from sympy import Rational, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from ..scene import CoulombFriction, Joint, Scene, UnilateralContact, unknowns


def belt_oscillator() -> Scene:
    r"""Build the scene of a block on a spring and a moving belt, which sticks and slips in turn.

    Its coordinates are

    - x: position of the block, zero where the spring is at rest [m];
    - y: height of the block above the belt, zero [m];

    its parameters

    - m: mass [kg];
    - k: stiffness of the spring [N/m];
    - v_b: speed of the belt [m/s];
    - mu, mu_s: coefficients of friction in slip and in stick, mu_s not less than mu;
    - g: acceleration of gravity [m/s^2];

    its unknowns

    - N, F: force of the belt on the block, upwards and along the belt [N].

    Returns
    -------
    Scene
        Two coordinates, one holonomic constraint, one contact with friction, "belt".

    Notes
    -----
    With w^2 = k/m, the block sticks until x = mu_s m g / k and then slips for

    .. math:: T = \frac{2}{w}\Bigl(\pi - \arctan\frac{(\mu_s - \mu) m g w}{k v_b}\Bigr),

    where it catches up with the belt at x = (2 mu - mu_s) m g / k.
    """
    x, y = dynamicsymbols("x y")
    m, k, v_b, mu, mu_s, g = symbols("m k v_b mu mu_s g", positive=True)

    N, O = ReferenceFrame("N"), Point("O")
    B = O.locatenew("B", x * N.x + y * N.y)

    scene = Scene("belt_oscillator", frame=N, origin=O, coordinates=[x, y])
    block = Particle("block", B, m)
    block.potential_energy = k * x**2 / 2
    scene.add_bodies(block)
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((B, -k * x * N.x))
    normal, friction = unknowns("N F")
    scene.add_joints(Joint("belt", body="block", at=B, force=friction * N.x + normal * N.y))
    scene.add_holonomic_constraints(y)
    scene.add_friction(CoulombFriction(normal, friction, slip=x.diff() - v_b, mu=mu, mu_static=mu_s, name="belt"))
    return scene


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


def bouncing_ball() -> Scene:
    r"""Build the scene of a ball over the ground.

    Its coordinates are

    - x, y: horizontal position, and height above the ground [m];

    its parameters

    - m: mass [kg];
    - e: coefficient of restitution, between 0 and 1;
    - g: acceleration of gravity [m/s^2];

    its unknowns

    - N: force of the ground on the ball [N].

    Returns
    -------
    Scene
        Two coordinates, one contact, "ground", closed or open.

    Notes
    -----
    Dropped from rest at the height H, the ball hits the ground at

    .. math:: t_n = \sqrt{2 H / g}\,\Bigl(1 + 2 e \frac{1 - e^{n-1}}{1 - e}\Bigr), \qquad n = 1, 2, \ldots,

    infinitely often before it rests at sqrt(2 H / g) (1 + e) / (1 - e).
    """
    x, y = dynamicsymbols("x y")
    m, e, g = symbols("m e g", positive=True)

    N, O = ReferenceFrame("N"), Point("O")
    B = O.locatenew("B", x * N.x + y * N.y)

    scene = Scene("bouncing_ball", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("ball", B, m))
    scene.apply_uniform_gravity(-g * N.y)
    normal = unknowns("N")
    scene.add_joints(Joint("ground", body="ball", at=B, force=normal * N.y))
    scene.add_contacts(UnilateralContact(normal, gap=y, restitution=e, name="ground"))
    return scene
