"""A plate that slides on the ground and leans on a corner: example 13.4.2."""

from sympy import Rational, cot, sin, symbols
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
