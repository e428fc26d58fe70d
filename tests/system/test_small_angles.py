"""Outputs, rates and constraints near points where other forms of them cancel, against 50 digits."""

from functools import cache

import mpmath
import pytest
import sympy as sp
from sympy import cos, cosh, sin, sinh, sqrt, tan
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

pytestmark = pytest.mark.filterwarnings("ignore:no coordinate or rate:dalembert.errors.PrecisionWarning")

x, y = dynamicsymbols("x y")
m, g, l = sp.symbols("m g l", positive=True)
VALUES = {m: 1.3, g: 9.81, l: 0.7}
SIZES = (1e-3, 1e-6, 1e-8, 1e-12)

# each can be computed to the last digits as it is written, and loses them in a form that is cheaper or was there before
ACCURATE = [
    2 * sin(x / 2) ** 2,
    m * g * l * 2 * sin(x / 2) ** 2 + m * g * l * 2 * sin(y / 2) ** 2,
    tan(x) ** 2,
    sin(x) ** 2 / (1 + cos(x)),
    sin(x) / (1 + cos(x)),
    (x - y) * (x + y),
    2 * sinh(x / 2) ** 2,
    x / (sqrt(1 + x) + 1),
    sin(x - y),
    2 * l * sin((x - y) / 2),
]
LOSSY = [cos(x), 1 - cos(x), cos(x) - 1, 1 - cos(x) ** 2, sp.sec(x) ** 2 - 1, x**2 - y**2, cosh(x) - 1, sqrt(1 + x) - 1]


def exact(expression, size):
    with mpmath.workdps(60):
        values = {x: 1.234 * size, y: 0.777 * size, **VALUES}
        function = sp.lambdify(list(values), expression, "mpmath")
        return function(*(mpmath.mpf(value) for value in values.values()))


def close(found, right, share=1e-14):
    with mpmath.workdps(60):
        return abs(found - right) <= share * abs(right)


def pendulum(name):
    """A double pendulum, whose second angle is relative to the first."""
    N, O = ReferenceFrame("N"), Point("O")
    F, H = (N.orientnew(n, "Axis", (angle, N.z)) for n, angle in (("F", x), ("H", x + y)))
    P = O.locatenew("P", -l * F.y)
    Q = P.locatenew("Q", -l * H.y)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", P, m), Particle("q", Q, m))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def start(size):
    return {x: 1.234 * size, y: 0.777 * size, x.diff(): 0.0, y.diff(): 0.0}


@cache
def with_outputs(backend):
    return da.compile_model(pendulum("two angles"), backend=backend, outputs=[*LOSSY, *ACCURATE])


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_outputs_are_as_accurate_as_they_are_written(backend, size):
    run = with_outputs(backend).simulate((0.0, 1e-9), start(size), VALUES, t_eval=[0.0])
    for expression in ACCURATE:
        assert close(run[str(expression)][0], exact(expression, size)), expression


@cache
def pulled(place):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene(f"pulled {place}", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", P, m))
    # of 1 - cos(x) and sin(x)**2 / (1 + cos(x)) either loses digits that the other has, at 0 and at a straight angle
    scene.add_loads((P, LOSSY[1 if place != 3 else 0] * 1e-9 * N.x + ACCURATE[place] * N.y))
    return da.compile_model(scene, backend="llvm")


@pytest.mark.parametrize("place", [0, 2, 3, 5])
def test_rates_are_as_accurate_as_forces_are_written(place):
    """By the kernel of Taylor steps, whose form is chosen anew; a step of no length has moved by nothing else."""
    for size in SIZES:
        run = pulled(place).simulate(
            (0.0, 1e-3), start(size), {m: VALUES[m]}, t_eval=[0.0, 1e-6], rtol=1e-12, atol=1e-60
        )
        rate, right = run["y_dot"][-1] / 1e-6, exact(ACCURATE[place] / m, size)
        assert close(rate, right, 1e-8), ACCURATE[place]


def test_a_constraint_keeps_its_digits():
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("cycloid", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, (cos(x) - 1) * N.x))
    scene.add_holonomic_constraints(y - l * 2 * sin(x / 2) ** 2)
    model = da.compile_model(scene, formulation="minimal")
    for size in SIZES:
        run = model.simulate((0.0, 1e-9), {x: size, x.diff(): 0.0}, {m: 1.3, l: 0.7}, t_eval=[0.0])
        with mpmath.workdps(60):
            assert close(run["y"][0], 2 * mpmath.mpf(0.7) * mpmath.sin(mpmath.mpf(size) / 2) ** 2)


def test_a_double_pendulum_near_rest():
    """Its accelerations are linear in the angles there, to the square of their size."""
    model = da.compile_model(pendulum("small swings"))
    for size in SIZES[2:]:
        s = start(size)
        found = model.accelerations(0.0, [s[x], s[y]], [0.0, 0.0], VALUES)
        with mpmath.workdps(60):
            a, b = mpmath.mpf(s[x]), mpmath.mpf(s[y])
            # M = l^2 [[5, 2], [2, 1]] m, forcing -m g l [2 a + (a + b), a + b]
            ratio = mpmath.mpf(9.81) / mpmath.mpf(0.7)
            top, bottom = -ratio * (3 * a + b), -ratio * (a + b)
            right = (top - 2 * bottom, 5 * bottom - 2 * top)
            assert all(close(value, each, 1e-13) for value, each in zip(found, right, strict=True))
