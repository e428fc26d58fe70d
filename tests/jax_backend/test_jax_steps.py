"""Steps of fixed size as pure functions: values, order, derivatives, batches, faults."""

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import OptionError, UnknownNameError

jax = pytest.importorskip("jax")
jnp = jax.numpy

pytestmark = pytest.mark.usefixtures("quick_xla")

PARAMETERS = {"M": 1.0, "m": 0.1, "l": 0.5, "g": 9.81}
START = {"x": 0.0, "theta": 0.3, "x_dot": 0.1, "theta_dot": 0.0}


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module")
def cart_pole():
    """Return a mass on a rod that is hinged to a cart, pushed by an input u."""
    x, theta, u = dynamicsymbols("x theta u")
    M, m, l, g = symbols("M m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x)
    P = C.locatenew("P", l * A.y)
    scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, theta])
    scene.add_bodies(Particle("cart", C, M), Particle("bob", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_inputs(u)
    scene.add_loads((C, u * N.x))
    return da.compile_model(scene, backend="jax")


def test_steps_follow_the_motion_with_their_order(cart_pole):
    run = cart_pole.simulate((0.0, 0.2), START, PARAMETERS, inputs={"u": 1.5}, t_eval=[0.0, 0.2], rtol=1e-12)
    y = jnp.asarray(run.y[0])
    step = jax.jit(cart_pole.functions.step, static_argnames=("method", "substeps"))

    def error(method, substeps):
        after = step(y, {"u": 1.5}, 0.2, PARAMETERS, method=method, substeps=substeps)
        return np.abs(np.asarray(after) - run.y[-1]).max()

    by_symbol = step(y, {dynamicsymbols("u"): 1.5}, 0.2, PARAMETERS, method="euler", substeps=4)
    assert np.abs(np.asarray(by_symbol) - run.y[-1]).max() == error("euler", 4)
    assert 1.7 < error("euler", 4) / error("euler", 8) < 2.4
    assert 12.0 < error("rk4", 4) / error("rk4", 8) < 22.0
    assert error("tsit5", 8) < 2e-9 and error("dopri8", 8) < 1e-11


def test_batches_and_derivatives(cart_pole):
    step, p = cart_pole.functions.step, cart_pole.parameter_vector(PARAMETERS, inputs={"u": 0.0})
    once = jax.jit(step)
    y = jnp.asarray(cart_pole.state(START, PARAMETERS, inputs={"u": 0.0}))
    controls = jnp.linspace(-1.0, 1.0, 5)[:, None]
    rows = jax.jit(jax.vmap(lambda u: step(y, u, 0.02, p)))(controls)
    np.testing.assert_allclose(rows[3], once(y, {"u": 0.5}, 0.02, PARAMETERS), rtol=1e-13, atol=1e-14)
    twice = lambda u: step(y, u, 0.02, p, substeps=2)  # noqa: E731
    slope = jax.jit(jax.jacrev(twice))(controls[3])[:, 0]
    push = jax.jit(lambda u: jax.jvp(twice, (u,), (jnp.ones(1),))[1])(controls[3])
    np.testing.assert_allclose(slope, push, rtol=1e-12)
    difference = (once(y, controls[3] + 1e-5, 0.02, p) - once(y, controls[3] - 1e-5, 0.02, p)) / 2e-5
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-9)


def test_states_end_on_the_constraints():
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", formulation="projected")
    y = jnp.asarray(model.state(initial, parameters))
    after = model.functions.step(y, (), 0.1, parameters)
    q, qdot = model.functions.expand(0.1, after, parameters)
    assert abs(float(-qdot[0] * jnp.sin(q[2]) + qdot[1] * jnp.cos(q[2]))) < 1e-14
    exact = model.simulate((0.0, 0.1), initial, parameters, rtol=1e-12).y[-1]
    np.testing.assert_allclose(after, exact, atol=1e-5)


def test_precision_is_that_of_the_state(cart_pole):
    y = jnp.asarray(cart_pole.state(START, PARAMETERS, inputs={"u": 0.0}), dtype=jnp.float32)
    assert cart_pole.functions.step(y, {"u": 0.5}, 0.02, PARAMETERS).dtype == jnp.float32


def test_faults(cart_pole):
    y, step = cart_pole.state(START, PARAMETERS, inputs={"u": 0.0}), cart_pole.functions.step
    with pytest.raises(OptionError, match=r"'leapfrog'.*rk4, euler"):
        step(y, {"u": 0.0}, 0.1, PARAMETERS, method="leapfrog")
    with pytest.raises(OptionError, match="substeps must be a whole number from 1 on, not 0"):
        step(y, {"u": 0.0}, 0.1, PARAMETERS, substeps=0)
    with pytest.raises(OptionError, match=r"inputs must have shape \(1,\), for u, not \(2,\)"):
        step(y, jnp.zeros(2), 0.1, PARAMETERS)
    for wrapped in (step, jax.jit(step)):
        with pytest.raises(OptionError, match=r"the state must have shape"):
            wrapped(jnp.ones(len(y) + 1), {"u": 0.0}, 0.1, PARAMETERS)
        with pytest.raises(OptionError, match=r"dt must be one number, not of shape \(2,\)"):
            wrapped(y, {"u": 0.0}, jnp.ones(2), PARAMETERS)
    with pytest.raises(UnknownNameError, match=r"'v'(.|\n)*missing inputs: u"):
        step(y, {"v": 0.0}, 0.1, PARAMETERS)
    with pytest.raises(UnknownNameError, match="missing parameters: l"):
        step(y, {"u": 0.0}, 0.1, {name: 1.0 for name in PARAMETERS if name != "l"})
