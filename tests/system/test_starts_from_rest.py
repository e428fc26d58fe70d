"""Forces whose rates at rest are finite and have no power series: drag by the magnitude of a velocity."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sympy import Max, Rational, sqrt, symbols
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


def test_drag_relative_to_wind_from_the_velocity_of_the_wind():
    """The root vanishes at velocities other than zero: "auto" took Taylor steps, which end there with NON_FINITE."""
    w, u = symbols("w u")

    def wind(position, frame):
        relative = position.dt(frame) - w * frame.x - u * frame.z
        return -c * relative * relative.magnitude()

    model = da.compile_model(scene(wind))
    values, start = {**P, w: 2, u: 1}, {x: 0, z: 0, x.diff(): 2, z.diff(): 1}
    assert "roots vanish at rest" in model.explain()
    # relative to the wind the fall is the one from rest
    exact = 3 - FALL**2 / 9.81 * np.log(np.cosh(3 * 9.81 / FALL))
    for method in ("auto", "dop853", "tsit5", "radau"):
        run = model.simulate((0, 3), start, values, method=method, rtol=1e-9)
        sweep = model.sweep((0, 3), start, {**values, g: [9.81, 0]}, method=method, rtol=1e-9)
        assert run.success and sweep.success.all()
        assert abs(run["z"][-1] - exact) < 1e-7
        np.testing.assert_allclose(sweep["z"], [exact, 3], atol=1e-7)
        np.testing.assert_allclose(sweep["x"], 6, atol=1e-9)
    assert (
        da.compile_model(scene(lambda p, N: -c * p * p.magnitude() ** -3)).choose_method("auto", 1e-8, 1e-10)
        == "taylor"
    )


def test_drag_along_a_line_relative_to_wind():
    """c |v - w| (v - w) from v = w: a kink, and a closed form for each of wind that stays and wind that rises."""
    frame, origin = ReferenceFrame("N"), Point("O")
    t = dynamicsymbols._t
    for gust, exact in ((0, 6 + np.log(np.cosh(3))), (Max(t - 1, 0), 8 - np.log(np.cosh(2)))):
        made = da.Scene("wind", frame=frame, origin=origin, coordinates=[x])
        place = origin.locatenew("P", x * frame.x)
        made.add_bodies(Particle("ball", place, 1))
        v = x.diff() - 2 - gust
        made.add_loads((place, ((1 if gust == 0 else 0) - abs(v) * v) * frame.x))
        model = da.compile_model(made)
        for method in ("auto", "taylor", "dop853", "tsit5", "radau"):
            run = model.simulate((0, 3), {x: 0, x.diff(): 2}, {}, method=method, rtol=1e-10, atol=1e-12)
            sweep = model.sweep((0, 3), {x: 0, x.diff(): 2}, {}, method=method, rtol=1e-10, atol=1e-12)
            assert abs(run["x"][-1] - exact) < 1e-9
            assert abs(sweep["x"][0] - exact) < 1e-9
