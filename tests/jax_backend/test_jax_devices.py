"""Batches over two devices: the bits of one device at the same number of cases on each."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("jax")

SLEIGH = """
import jax, jax.numpy as jnp, numpy as np
from jax.sharding import AxisType, NamedSharding, PartitionSpec as P
import dalembert as da
jax.config.update("jax_enable_x64", True)
model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")
parameters = {"m": 1.0, "b": 0.3, "I_C": 0.5}
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
y, p = (jnp.asarray(v) for v in (model.state(start, parameters), model.parameter_vector(parameters)))
rows = y * (1.0 + 0.01 * jnp.arange(8.0)[:, None])
automatic = jax.make_mesh((2,), ("cases",), axis_types=(AxisType.Auto,))
explicit = jax.make_mesh((2,), ("cases",), axis_types=(AxisType.Explicit,))


def on_two(function, rows, kinds):
    for kind in kinds:
        if kind in ("checked", "unchecked"):
            yield kind, jax.jit(
                jax.shard_map(
                    function, mesh=automatic, in_specs=P("cases"), out_specs=P("cases"), check_vma=kind == "checked"
                )
            )(rows)
        elif kind == "automatic":
            yield kind, jax.jit(function)(jax.device_put(rows, NamedSharding(automatic, P("cases"))))
        elif kind == "explicit":
            yield kind, jax.jit(function)(jax.device_put(rows, NamedSharding(explicit, P("cases"))))
        elif kind == "set":
            with jax.set_mesh(explicit):
                yield kind, function(jax.device_put(rows, P("cases")))
        else:
            yield kind, jax.pmap(function)(rows.reshape(2, 4, *rows.shape[1:]))


def check(function, rows, kinds=("checked", "explicit"), tolerance=0.0):
    one = np.concatenate([jax.jit(function)(rows[:4]), jax.jit(function)(rows[4:])])
    assert np.isfinite(one).all()
    for kind, found in on_two(function, rows, kinds):
        assert len(found.sharding.device_set) == 2, kind
        found = np.asarray(found).reshape(one.shape)
        np.testing.assert_allclose(found, one, rtol=tolerance, atol=tolerance, err_msg=kind)
"""

EVERYWHERE = """
solve = model.solve_fn(method="tsit5", rtol=1e-6, max_steps=64)
end = lambda y: solve(jnp.array([0.0, 1.0]), y, p).y[-1]
everywhere = "automatic", "mapped", "unchecked", "checked", "explicit", "set"
for function in (jax.vmap(end), jax.vmap(jax.grad(lambda y: end(y).sum()))):
    check(function, rows, everywhere)
"""

KINDS = """
times = jnp.linspace(0.0, 1.0, 4)
dense = model.solve_fn(method="tsit5", rtol=1e-6, max_steps=64, dense=True)
check(jax.vmap(lambda y: dense(times, y, p).dense(jnp.array([0.7, 0.2])).q), rows)
strict = model.solve_fn(method="tsit5", rtol=1e-6, max_steps=64, throw=True)
ends = jax.vmap(lambda y: strict(jnp.array([0.0, 1.0]), y, p).y[-1])
check(ends, rows, ("checked",))
try:
    jax.jit(ends)(jax.device_put(rows, NamedSharding(explicit, P("cases"))))
except da.errors.OptionError as error:
    assert "jax.shard_map" in str(error)
else:
    raise AssertionError("a failed run would stop all devices")
check(jax.vmap(lambda y: model.functions.step(y, (), 0.1, p, substeps=2)), rows, tolerance=1e-14)
check(jax.vmap(lambda y: model.functions.energy(0.0, y, p)), rows, ("checked", "explicit", "set"))
"""

SHARED = """
solve = model.solve_fn(method="tsit5", rtol=1e-6, max_steps=64)
end = lambda y, p: solve(jnp.array([0.0, 1.0]), y, p).y[-1]
gradient = jax.grad(lambda rows, p: jnp.sum(jax.vmap(end, (0, None))(rows, p) ** 2), 1)
one = jax.jit(gradient)(rows, p)
checked = jax.shard_map(gradient, mesh=automatic, in_specs=(P("cases"), P()), out_specs=P())
np.testing.assert_allclose(jax.jit(checked)(rows, p), one, rtol=1e-14)
laid = jax.device_put(rows, NamedSharding(explicit, P("cases")))
np.testing.assert_allclose(jax.jit(gradient)(laid, p), one, rtol=1e-14)
many = 0.3 * (1.0 + 0.1 * jnp.arange(3.0))
check(jax.vmap(lambda y: jax.vmap(lambda b: end(y, dict(parameters, b=b)))(many)), rows)
"""

INPUTS = """
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols
z, u = dynamicsymbols("z u")
N, O = ReferenceFrame("N"), Point("O")
block = O.locatenew("block", z * N.x)
scene = da.Scene("pushed", frame=N, origin=O, coordinates=[z])
scene.add_bodies(Particle("block", block, 1))
scene.add_loads((block, (u - z) * N.x))
scene.add_inputs(u)
solve = da.compile_model(scene, backend="jax").solve_fn(["z", "z_dot"], method="tsit5", rtol=1e-6, max_steps=64)


def squares(given):
    solved = solve([0.0, 1.0, 2.0], {"z": 0.4, "z_dot": 0.1}, {}, inputs={u: given})
    return jnp.sum(solved.y ** 2)


def law(t, q, qdot, theta):
    return -theta[0] * qdot[0] - theta[1] * qdot[0] ** 3


values = jnp.ones(5) * (1.0 + 0.1 * jnp.arange(8.0)[:, None])
knots = np.linspace(0, 2, 5)
check(jax.vmap(jax.grad(lambda v: squares(da.samples(knots, v, "hold")))), values)
check(jax.vmap(jax.grad(lambda v: squares(da.feedback(law, v)))), values[:, :2], tolerance=1e-13)
"""

EVENTS = """
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols
h, level = dynamicsymbols("h"), symbols("level")
N, O = ReferenceFrame("N"), Point("O")
ball = O.locatenew("ball", h * N.x)
scene = da.Scene("fall", frame=N, origin=O, coordinates=[h])
scene.add_bodies(Particle("ball", ball, 1))
scene.add_loads((ball, -9.81 * N.x))
stop = da.Event(h - level, direction=-1, terminal=True, name="stop")
solve = da.compile_model(scene, backend="jax").solve_fn(["h", "h_dot"], events=[stop])
end = lambda height: solve([0.0, 2.0], {"h": height, "h_dot": 0.0}, {"level": 0.2}).end.t
heights = jnp.linspace(1.0, 2.0, 8)
check(jax.vmap(end), heights)
check(jax.vmap(jax.grad(end)), heights, ("checked",))


def total(heights, level):
    return jnp.sum(jax.vmap(lambda h: solve([0.0, 2.0], {"h": h, "h_dot": 0.0}, {"level": level}).end.t)(heights))


by_level = jax.jit(jax.grad(total, 1))
laid = jax.device_put(heights, NamedSharding(explicit, P("cases")))
np.testing.assert_allclose(by_level(laid, 0.2), by_level(heights, 0.2), rtol=1e-14)
"""

IMPLICIT = """
solve = model.solve_fn(method="kvaerno5", rtol=1e-5)
check(jax.vmap(lambda y: solve(jnp.array([0.0, 0.2]), y, p).y[-1]), rows, ("checked", "explicit"), 1e-13)
"""


@pytest.mark.matrix
@pytest.mark.parametrize(
    "program",
    [EVERYWHERE, KINDS, SHARED, INPUTS, EVENTS, IMPLICIT],
    ids=["meshes", "kinds of runs", "what cases share", "inputs", "events", "implicit steps"],
)
def test_runs_and_gradients_over_two_devices(program):
    flags = "--xla_force_host_platform_device_count=2 --xla_backend_optimization_level=0"
    environment = {**os.environ, "XLA_FLAGS": flags}
    command = [sys.executable, "-c", SLEIGH + program]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
