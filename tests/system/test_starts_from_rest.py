"""Forces whose rates at rest are finite and have no power series: drag by the magnitude of a velocity."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sympy import Rational, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

x, z = dynamicsymbols("x z")
m, c, g = symbols("m c g", positive=True)
P = {m: 1.0, c: 0.1, g: 9.81}
FALL = np.sqrt(98.1)  # the speed at which drag balances weight
REST = {x: 0, z: 0, x.diff(): 0, z.diff(): 0}


def scene(force):
    frame, origin = ReferenceFrame("N"), Point("O")
    made = da.Scene("drag", frame=frame, origin=origin, coordinates=[x, z])
    place = origin.locatenew("P", x * frame.x + z * frame.z)
    made.add_bodies(Particle("ball", place, m))
    made.apply_uniform_gravity(-g * frame.z)
    made.add_loads((place, force(place.pos_from(origin), frame)))
    return made


def drag(position, frame):
    velocity = position.dt(frame)
    return -c * velocity * velocity.magnitude()


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_a_ball_dropped_with_quadratic_drag(backend):
    model = da.compile_model(scene(drag), backend=backend)
    run = model.simulate((0, 3), REST, P, rtol=1e-9)
    assert run.success
    np.testing.assert_allclose(run["z_dot"], -FALL * np.tanh(9.81 * run.t / FALL), atol=1e-7)
    up = np.array([0.0, 10.0])
    sweep = model.sweep((0, 3), {**REST, z.diff(): up}, P, rtol=1e-9)
    top = FALL / 9.81 * np.arctan(up / FALL)
    assert sweep.success.all()
    np.testing.assert_allclose(sweep.final["z_dot"], -FALL * np.tanh(9.81 * (3 - top) / FALL), atol=1e-7)


def test_a_stiffening_spring_from_its_centre():
    model = da.compile_model(scene(lambda position, frame: -c * sqrt(x**2 + z**2) * position + m * g * frame.z))
    assert "roots vanish at rest" in model.explain()
    run = model.simulate((0, 2), {**REST, x.diff(): 1}, P, rtol=1e-9)
    assert run.success
    np.testing.assert_allclose(run["x_dot"] ** 2 / 2 + 0.1 * np.abs(run["x"]) ** 3 / 3, 0.5, atol=1e-7)


def test_drag_by_another_power_of_the_speed():
    model = da.compile_model(scene(lambda p, N: -c * p.dt(N) * p.dt(N).dot(p.dt(N)) ** Rational(1, 4)))
    run = model.simulate((0, 2), REST, P, rtol=1e-9)
    assert run.success
    exact = solve_ivp(lambda t, v: -9.81 - 0.1 * v * abs(v) ** 0.5, (0, 2), [0.0], rtol=1e-12, atol=1e-12)
    assert abs(run["z_dot"][-1] - exact.y[0, -1]) < 1e-7
