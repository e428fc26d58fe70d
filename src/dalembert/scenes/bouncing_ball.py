"""A ball that bounces on the ground, its impacts by a coefficient of restitution."""

from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

from ..scene import Joint, Scene, UnilateralContact, unknowns


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
