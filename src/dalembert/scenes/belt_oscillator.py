"""A block on a spring and a moving belt: stick-slip oscillation."""

from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

from ..scene import CoulombFriction, Joint, Scene, unknowns


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
