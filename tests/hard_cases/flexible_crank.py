"""Slider-crank with a flexible connecting rod, of the test set for IVP solvers, from its Lagrangian.

B. Simeon, Modelling a flexible slider crank mechanism by a mixed system of DAEs and PDEs, Math. Modelling of Systems 2
(1996) 1-18. The rod bends in two sine functions, q1 and q2, and stretches in a quadratic element, q3 and q4.
"""

from sympy import Float, Matrix, cos, diag, pi, sin
from sympy.physics.mechanics import LagrangesMethod, ReferenceFrame, dynamicsymbols

import dalembert as da
from hard_cases.case import HardCase, published_reference

PI = Float("3.1415927")
"""The value of the test set, which its stiffness and mass constants contain."""


def lagrangian():
    """Return the Lagrangian, the coordinates and the constraints, in numbers."""
    entry = published_reference("ivp_test_set_crank")["parameters"]
    M2, M3, L1, L2, J1, J2, E, B, H, rho, omega = (
        Float(entry[key]) for key in ("M2", "M3", "L1", "L2", "J1", "J2", "EE", "BB", "HH", "RHO", "OMEGA")
    )
    assert abs(PI - pi) < 1e-7
    phi1, phi2, x3, *q = coordinates = dynamicsymbols("phi1 phi2 x3 q1:5")
    t = dynamicsymbols._t
    volume, thin = B * H * L2, (H / L2) ** 2
    mass = rho * volume * diag(Float("0.5"), Float("0.5"), Matrix([[8, 1], [1, 2]]))
    stretch = Matrix([[16, -8], [-8, 7]]) / 3
    stiffness = E * B * H / L2 * diag(PI**4 / 24 * thin, 2 * PI**4 / 3 * thin, stretch)
    turn = volume * Matrix([[-16 / PI**3, 8 / PI**3 - 1 / PI], [0, 1 / (2 * PI)]])
    Q, v = Matrix(q), Matrix(coordinates).diff(t)
    along = volume * (2 * Q[2] / 3 + Q[3] / 6)
    aside = volume * 2 / PI * Q[0]
    moment = L2 * volume * (Q[2] / 3 + Q[3] / 6)
    swept = L2 * volume / PI * (v[3] - v[4] / 2)
    bend, axial = Q[:2, :], Q[2:, :]
    crossed = (bend.T * turn * v[5:, :] - v[3:5, :].T * turn * axial)[0]
    angle = phi1 - phi2
    tip = cos(angle) * (L2 * M2 / 2 + rho * along) + sin(angle) * rho * aside
    rate = rho * (cos(angle) * aside.diff(t) - sin(angle) * along.diff(t))
    kinetic = (
        (J1 + M2 * L1**2) * v[0] ** 2 / 2
        + L1 * v[0] * (tip * v[1] + rate)
        + (J2 + (Q.T * mass * Q)[0] + 2 * rho * moment) * v[1] ** 2 / 2
        + rho * v[1] * (swept + crossed)
        + M3 * v[2] ** 2 / 2
        + (v[3:, :].T * mass * v[3:, :])[0] / 2
    )
    length = L2 + q[3]
    constraints = [
        L1 * sin(phi1) + length * sin(phi2),
        x3 - L1 * cos(phi1) - length * cos(phi2),
        phi1 - omega * t,
    ]
    return kinetic - (Q.T * stiffness * Q)[0] / 2, coordinates, constraints


def flexible_crank_scene():
    """Read the Lagrangian."""
    L, coordinates, constraints = lagrangian()
    method = LagrangesMethod(L, coordinates, hol_coneqs=constraints, frame=ReferenceFrame("N"))
    return da.Scene.from_sympy(method, name="flexible_crank")


def flexible_crank():
    """Slider-crank with a flexible rod: elastic modes of 1e3 to 1e5 rad/s, a prescribed angle, 2.4 turns in 0.1 s."""
    entry = published_reference("ivp_test_set_crank")
    names = ["phi1", "phi2", "x3", "q1", "q2", "q3", "q4"]
    names += [f"{name}_dot" for name in names]
    return HardCase(
        scene=flexible_crank_scene(),
        parameters={},
        initial={name: float(x) for name, x in zip(names, entry["initial"], strict=True)},
        quantity="angles, slider, elastic coordinates, and their rates",
        observed=names,
        values={0.1: entry["values"]},
        source=entry["source"],
        bound=2e-8,
        scale=[1.0] * 3 + [1e-3] * 4 + [150.0] * 3 + [100.0] * 4,
        conserved=(),
        rtol=1e-10,
        atol=1e-14,
    )
