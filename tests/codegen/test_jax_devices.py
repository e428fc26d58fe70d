"""Batches over two devices: the bits of one device at the same number of cases on each."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("jax")

PROGRAM = """
import jax, jax.numpy as jnp, numpy as np
from jax.sharding import AxisType, NamedSharding, PartitionSpec as P
import dalembert as da
jax.config.update("jax_enable_x64", True)
model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")
parameters = {"m": 1.0, "b": 0.3, "I_C": 0.5}
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
y, p = (jnp.asarray(v) for v in (model.state(start, parameters), model.parameter_vector(parameters)))
rows = y * (1.0 + 0.01 * jnp.arange(8.0)[:, None])
solve = model.solve_fn(method="tsit5", rtol=1e-6)
end = lambda y: solve(jnp.array([0.0, 1.0]), y, p).y[-1]
mesh = jax.make_mesh((2,), ("cases",), axis_types=(AxisType.Auto,))
for function in (jax.vmap(end), jax.vmap(jax.grad(lambda y: end(y).sum()))):
    one = np.concatenate([jax.jit(function)(rows[:4]), jax.jit(function)(rows[4:])])
    spread = jax.device_put(rows, NamedSharding(mesh, P("cases")))
    sharded = jax.shard_map(function, mesh=mesh, in_specs=P("cases"), out_specs=P("cases"), check_vma=False)
    for found in (jax.jit(function)(spread), jax.pmap(function)(rows.reshape(2, 4, -1)), jax.jit(sharded)(rows)):
        assert len(found.sharding.device_set) == 2
        np.testing.assert_array_equal(np.asarray(found).reshape(8, -1), one)
"""


def test_runs_and_gradients_over_two_devices():
    environment = {**os.environ, "XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
