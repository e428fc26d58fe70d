"""Constraints whose velocities would jump in a configuration: refused by name; smooth ones with switches are not."""

import pytest
from sympy import Abs, Heaviside, Max, Min, Piecewise, cos, floor, sign, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import SceneError

x, y = dynamicsymbols("x y")
m, k, L = symbols("m k L", positive=True)
TIME = dynamicsymbols._t


def compiled(holonomic=(), nonholonomic=()):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", O.locatenew("P", x * N.x + y * N.y), m))
    scene.add_holonomic_constraints(*holonomic)
    scene.add_nonholonomic_constraints(*nonholonomic)
    return da.compile_model(scene)


@pytest.mark.parametrize(
    ("constraint", "what"),
    [
        (Abs(x) - y, "Abs"),
        (Abs(x - 1000 * L) - y, "Abs"),
        (Abs(cos(x)) - y, "Abs"),
        (Max(x, L) - y, "Max"),
        (Min(k * x, L) - y, "Min"),
        (Piecewise((x**2, x < 1), (3 * x - 2, True)) - y, "a condition"),
        (sign(x) - y, "sign"),
        (floor(x) - y, "floor"),
        (sqrt(x**2) - y, "the root of a square"),
        (sqrt((x - L) ** 2 * y**2) - k, "the root of a square"),
        (sqrt(3 * (x - y) ** 2) - L, "the root of a square"),
    ],
)
def test_holonomic_constraints_with_a_kink_are_refused(constraint, what):
    with pytest.raises(SceneError, match=rf"holonomic constraint 1, .* = 0: its gradient jumps .* of {what} in"):
        compiled([constraint])


@pytest.mark.parametrize("coefficient", [sign(x), Heaviside(x - L), Piecewise((1, x < L), (2, True))])
def test_nonholonomic_constraints_whose_coefficients_jump_are_refused(coefficient):
    with pytest.raises(SceneError, match=r"nonholonomic constraint 1, .* = 0: its coefficients jump"):
        compiled(nonholonomic=[coefficient * y.diff() - x.diff()])


@pytest.mark.parametrize(
    "constraint",
    [
        x * Abs(x) - y,
        Abs(x) ** 3 - y,
        Max(0, x) ** 2 - y,
        Abs(x**2 + 1) - y,
        sqrt(x**4) - y,
        sqrt(x**6) - y,
        sqrt(x**2 + y**2) - L,
        Piecewise((x**2, x < 1), (2 * x - 1, True)) - y,
        y - Max(0, TIME - 1),
    ],
)
def test_smooth_constraints_and_kinks_in_time_are_compiled(constraint):
    assert compiled([constraint]).layout.holonomic == 1


def test_continuous_coefficients_are_compiled():
    assert compiled(nonholonomic=[Abs(x) * y.diff() - x.diff()]).layout.constraints
