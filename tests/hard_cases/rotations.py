"""Attitudes without singularities: a frame oriented by a quaternion whose norm is a constraint."""

from sympy.physics.mechanics import Point, ReferenceFrame, dynamicsymbols

__all__ = ["NO_CLOSED_FORM", "UNIT", "matrix_entries", "quaternion_frame", "spin"]

E = dynamicsymbols("e0:4")
UNIT = sum(e**2 for e in E) - 1
"""The expression that vanishes."""

NO_CLOSED_FORM = {"minimal": "gives no coordinate in closed form"}


def quaternion_frame():
    """Return N, O, the frame S of the body and the quaternion, scalar first, from the body to space."""
    N, O = ReferenceFrame("N"), Point("O")
    return N, O, N.orientnew("S", "Quaternion", E), list(E)


def spin(e, omega):
    """Return the initial quaternion and its rates at an angular velocity in the body: e_dot = e o omega / 2."""
    e0, e1, e2, e3 = e
    w1, w2, w3 = omega
    rates = (
        (-e1 * w1 - e2 * w2 - e3 * w3) / 2,
        (e0 * w1 + e2 * w3 - e3 * w2) / 2,
        (e0 * w2 + e3 * w1 - e1 * w3) / 2,
        (e0 * w3 + e1 * w2 - e2 * w1) / 2,
    )
    return {**{f"e{i}": float(x) for i, x in enumerate(e)}, **{f"e{i}_dot": float(x) for i, x in enumerate(rates)}}


def matrix_entries(space, body):
    """Return the rotation matrix from body to space components, row by row."""
    return list(space.dcm(body))
