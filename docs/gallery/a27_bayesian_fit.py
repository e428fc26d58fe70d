"""
How sure is a damping coefficient that was fitted to a noisy record?
====================================================================

Bayes' theorem gives a distribution in place of one number. numpyro takes
samples of it: the motion is a function that JAX differentiates (`solve_fn`),
and the sampler NUTS follows the gradients. The most probable values come
first.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import numpyro
import numpyro.distributions as dist
from numpyro.infer import MCMC, NUTS, SVI, Trace_ELBO
from numpyro.infer.autoguide import AutoDelta
from sympy import cos, sin, symbols
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    dynamicsymbols,
)

import dalembert as da

jax.config.update("jax_enable_x64", True)

# %%
# A pendulum in air. Its length and the damping coefficient are unknown; the
# angle was recorded 60 times in 6 s, with an error of 0.05 rad.

theta = dynamicsymbols("theta")
m, l, g, c = symbols("m l g c", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P = O.locatenew("P", l * sin(theta) * N.x - l * cos(theta) * N.y)
scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[theta])
scene.add_bodies(Particle("bob", P, m))
scene.apply_uniform_gravity(-g * N.y)
scene.add_loads((P, -c * P.pos_from(O).dt(N)))
model = da.compile_model(scene, backend="jax")

start, times = {"theta": 1.0, "theta_dot": 0.0}, np.linspace(0, 6, 61)
solve = model.solve_fn(
    start, method="tsit5", rtol=1e-6, atol=1e-8, max_steps=512
)


def angle(length, damping):
    """Return the angle at the times of the record."""
    return solve(
        times, start, {"m": 0.5, "l": length, "g": 9.81, "c": damping}
    ).q[1:, 0]


true = {"length": 0.7, "damping": 0.08}
record = np.asarray(angle(**true)) + 0.05 * np.random.default_rng(
    3
).standard_normal(60)

# %%
# What is assumed before the record is seen, and how the record comes about.


def pendulum(record):
    length = numpyro.sample("length", dist.LogNormal(0.0, 0.5))
    damping = numpyro.sample("damping", dist.LogNormal(jnp.log(0.1), 1.0))
    sigma = numpyro.sample("sigma", dist.HalfNormal(0.2))
    numpyro.sample(
        "record", dist.Normal(angle(length, damping), sigma), obs=record
    )


# %%
# The most probable values (MAP): an optimizer looks for the peak of the
# distribution.

begin = {"length": 0.75, "damping": 0.1, "sigma": 0.1}
at_begin = numpyro.infer.init_to_value(values=begin)
guide = AutoDelta(pendulum, init_loc_fn=at_begin)
svi = SVI(pendulum, guide, numpyro.optim.Adam(0.05), Trace_ELBO())
found = svi.run(jax.random.key(0), 100, record, progress_bar=False)
peak = {
    name: float(value) for name, value in guide.median(found.params).items()
}

# %%
# NUTS draws samples of the whole distribution.

sampler = NUTS(
    pendulum, init_strategy=numpyro.infer.init_to_value(values=peak)
)
mcmc = MCMC(sampler, num_warmup=60, num_samples=120, progress_bar=False)
mcmc.run(jax.random.key(1), record)
samples = {
    name: np.asarray(values) for name, values in mcmc.get_samples().items()
}
for name in ("length", "damping"):
    mean, spread = samples[name].mean(), samples[name].std()
    print(
        f"{name}: most probable {peak[name]:.4f}, mean {mean:.4f} +-"
        f" {spread:.4f}, true {true[name]}"
    )
    assert (
        abs(mean - true[name]) < 4 * spread and abs(peak[name] - mean) < spread
    )

# %%
# sphinx_gallery_thumbnail_number = 1
_, left = plt.subplots()
left.plot(times[1:], record, ".", ms=4, color="black", label="record")
for k in range(0, 120, 6):
    left.plot(
        times[1:],
        angle(samples["length"][k], samples["damping"][k]),
        color="C0",
        alpha=0.15,
    )
left.set(xlabel="t [s]", ylabel="theta [rad]")
left.legend()
_, right = plt.subplots()
right.plot(samples["length"], samples["damping"], ".", ms=3, alpha=0.5)
right.plot(peak["length"], peak["damping"], "o", label="most probable")
right.plot(true["length"], true["damping"], "k*", ms=10, label="true")
right.set(xlabel="length [m]", ylabel="damping [N s/m]")
right.legend()
