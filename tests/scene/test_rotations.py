"""Matrices that orient frames are rotations, or refused by name."""

import numpy as np
import pytest
import sympy as sp
from sympy import cos, sin
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import SceneError
from dalembert.scene.reading import read

theta, phi = dynamicsymbols("theta phi")
J, m, a, b = sp.symbols("J m a b", positive=True)
THIRD = sp.Rational(1, 3)
SLANTED = sp.Matrix([[2, -2, 1], [1, 2, 2], [-2, -1, 2]]) * THIRD


def scene(matrix, method="orient_dcm", coordinates=(theta,), constraints=()):
    N, O = ReferenceFrame("N"), Point("O")
    A, B = ReferenceFrame("A"), ReferenceFrame("B")
    getattr(A, method)(N, sp.Matrix(matrix))
    B.orient_axis(A, theta, A.z)
    made = da.Scene("turned", frame=N, origin=O, coordinates=list(coordinates))
    made.add_bodies(RigidBody("body", O.locatenew("G", a * B.x), B, m, (inertia(B, J, J, J), O)))
    made.add_holonomic_constraints(*constraints)
    return made


def turned(angle):
    return sp.Matrix([[cos(angle), sin(angle), 0], [-sin(angle), cos(angle), 0], [0, 0, 1]])


@pytest.mark.parametrize("method", ["orient_dcm", "orient_explicit"])
@pytest.mark.parametrize(
    ("matrix", "what"),
    [
        (sp.diag(1, 2, 1), r"row 2 has the length 2 \(determinant 2\)"),
        (sp.diag(1, 1, -1), r"it is a reflection.* \(determinant -1\)"),
        (sp.Matrix([[1, 0, 0], [0, 1, 1], [0, 0, 1]]), r"the length 1\.41421356"),
        (sp.Matrix([[1, 0, 0], [sp.S.Half, sp.sqrt(3) / 2, 0], [0, 0, 1]]), "rows 1 and 2 have the product 0.5, which"),
        (sp.diag(1, 1 + 1e-7, 1), "row 2 has the length 1.0000001"),
        (sp.diag(2, 2, 2), "row 1 has the length 2"),
        (turned(theta) * sp.diag(1, 1 + a, 1), "at random values of its symbols"),
        (2 * turned(theta) * SLANTED, "has the length 2"),
        (2 * turned(a) * SLANTED * turned(b), "has the length 2"),
        (sp.Matrix([[a, b, 0], [-b, a, 0], [0, 0, 1]]), "at random values of its symbols"),
    ],
    ids=str,
)
def test_what_is_no_rotation_is_refused_by_name(matrix, what, method):
    matrix = matrix if method == "orient_dcm" else matrix.T
    opening = r"frame 'A' is oriented in 'N' by the matrix A.dcm\(N\), which is no rotation: "
    with pytest.raises(SceneError, match=opening) as caught:
        read(scene(matrix, method))
    assert len(caught.value.faults) == 1
    with pytest.raises(SceneError, match=what):
        read(scene(matrix, method))


@pytest.mark.parametrize(
    "matrix",
    [
        sp.eye(3),
        SLANTED,
        turned(theta) * SLANTED,
        turned(a) * turned(b * theta).subs(theta, theta**2),
        sp.Matrix(np.round(np.array(turned(0.7).evalf(), dtype=float), 10).tolist()),
        sp.Matrix(
            [
                [(1 - a**2) / (1 + a**2), 2 * a / (1 + a**2), 0],
                [-2 * a / (1 + a**2), (1 - a**2) / (1 + a**2), 0],
                [0, 0, 1],
            ]
        ),
    ],
    ids=["unit", "fractions", "angle", "parameters", "decimals", "half tangents"],
)
def test_rotations_pass(matrix):
    read(scene(matrix))


def test_what_the_scene_keeps_a_rotation_passes():
    """Direction cosines with their constraint; quaternions, whose matrix is a rotation times their length squared."""
    u, v = dynamicsymbols("u v")
    cosines = sp.Matrix([[u, v, 0], [-v, u, 0], [0, 0, 1]])
    read(scene(cosines, coordinates=(theta, u, v), constraints=[u**2 + v**2 - 1]))
    with pytest.raises(SceneError, match="no rotation"):
        read(scene(cosines, coordinates=(theta, u, v)))
    with pytest.raises(SceneError, match="row 3 has the length 2"):
        read(scene(sp.diag(1, 1, 2) * cosines, coordinates=(theta, u, v), constraints=[u**2 + v**2 - 1]))
    N, O, e = ReferenceFrame("N"), Point("O"), dynamicsymbols("e:4")
    B = N.orientnew("B", "Quaternion", list(e))
    made = da.Scene("free", frame=N, origin=O, coordinates=list(e))
    made.add_bodies(RigidBody("body", O, B, m, (inertia(B, J, J, J), O)))
    made.add_holonomic_constraints(sum(x**2 for x in e) - 1)
    read(made)
