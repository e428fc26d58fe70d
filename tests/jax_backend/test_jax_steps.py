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
    return pole_on_cart("jax")


def pole_on_cart(backend):
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
    return da.compile_model(scene, backend=backend)


def test_steps_follow_the_motion_with_their_order(cart_pole):
    inputs, times = {"u": 1.5}, [0.0, 0.2]
    run = pole_on_cart("llvm").simulate((0.0, 0.2), START, PARAMETERS, inputs=inputs, t_eval=times, rtol=1e-12)
    y, by_symbol = jnp.asarray(run.y[0]), {dynamicsymbols("u"): 1.5}
    taken = [("euler", 4), ("euler", 8), ("rk4", 4), ("rk4", 8), ("tsit5", 8), ("dopri8", 8)]

    @jax.jit
    def ends(y, dt):
        def step(control, method, substeps):
            return cart_pole.functions.step(y, control, dt, PARAMETERS, method=method, substeps=substeps)

        return step(by_symbol, "euler", 4), [step(inputs, *each) for each in taken]

    same, found = ends(y, 0.2)
    np.testing.assert_array_equal(same, found[0])
    error = {each: np.abs(np.asarray(end) - run.y[-1]).max() for each, end in zip(taken, found, strict=True)}
    assert 1.7 < error["euler", 4] / error["euler", 8] < 2.4
    assert 12.0 < error["rk4", 4] / error["rk4", 8] < 22.0
    assert error["tsit5", 8] < 2e-9 and error["dopri8", 8] < 1e-11


def test_batches_and_derivatives(cart_pole):
    step, p = cart_pole.functions.step, cart_pole.parameter_vector(PARAMETERS, inputs={"u": 0.0})
    once = jax.jit(step)
    y = jnp.asarray(cart_pole.state(START, PARAMETERS, inputs={"u": 0.0}))
    controls = jnp.linspace(-1.0, 1.0, 5)[:, None]
    rows = jax.jit(jax.vmap(lambda u: step(y, u, 0.02, p)))(controls)
    np.testing.assert_allclose(rows[3], once(y, {"u": 0.5}, 0.02, PARAMETERS), rtol=1e-13, atol=1e-14)
    twice = lambda u: step(y, u, 0.02, p, substeps=2)  # noqa: E731
    both = jax.jit(lambda u: (jax.jacrev(twice)(u)[:, 0], jax.jvp(twice, (u,), (jnp.ones(1),))[1]))
    slope, push = both(controls[3])
    np.testing.assert_allclose(slope, push, rtol=1e-12)
    difference = (once(y, controls[3] + 1e-5, 0.02, p) - once(y, controls[3] - 1e-5, 0.02, p)) / 2e-5
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-9)


def test_states_end_on_the_constraints():
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model, reference = (
        da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend, formulation="projected")
        for backend in ("jax", "llvm")
    )

    @jax.jit
    def end(y):
        after = model.functions.step(y, (), 0.1, parameters)
        return after, *model.functions.expand(0.1, after, parameters)

    after, q, qdot = map(np.asarray, end(model.state(initial, parameters)))
    assert abs(float(-qdot[0] * np.sin(q[2]) + qdot[1] * np.cos(q[2]))) < 1e-14
    exact = reference.simulate((0.0, 0.1), initial, parameters, rtol=1e-12).y[-1]
    np.testing.assert_allclose(after, exact, atol=1e-5)


def test_precision_is_that_of_the_state(cart_pole):
    y = jnp.asarray(cart_pole.state(START, PARAMETERS, inputs={"u": 0.0}), dtype=jnp.float32)
    shape = jax.eval_shape(lambda y: cart_pole.functions.step(y, {"u": 0.5}, 0.02, PARAMETERS), y)
    assert shape.dtype == jnp.float32


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
