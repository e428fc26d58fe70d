"""A plate whose straight edge slides on a smooth horizontal plane: example 13.4.4."""

from sympy import sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from ..scene import Joint, Scene, unknowns


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
