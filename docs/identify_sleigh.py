"""Identify b and I_C of a Chaplygin sleigh, with their uncertainty, from a noisy path; then a thousand such fits.

``python docs/identify_sleigh.py`` takes about a minute and prints what ``identify_sleigh.md`` quotes.
"""

from __future__ import annotations

import time

import jax
import jax.numpy as jnp
import numpy as np
import optimistix

import dalembert as da

jax.config.update("jax_enable_x64", True)

TIMES = np.linspace(0.0, 4.0, 41)
START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": float(np.cos(0.2)), "theta_dot": 2.0}
TRUE = {"b": 0.3, "I_C": 0.5}
SIGMA = 0.01
FITS = 1000


def main() -> None:
    """Fit one path, then many."""
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")
    solve = model.solve_fn(START, method="tsit5", rtol=1e-6, atol=1e-8, max_steps=1024)

    def path(theta):
        # Only m / I_C enters the motion: the mass is known, and sets the scale.
        motion = solve(TIMES, START, {"m": 1.0, "b": theta[0], "I_C": theta[1]})
        return motion.q[:, :2].ravel()

    def residuals(theta, measured):
        return (path(theta) - measured) / SIGMA

    def fit(measured):
        """Return estimates (2,), and their covariance (2, 2) by the Gauss-Newton approximation."""
        solver = optimistix.LevenbergMarquardt(rtol=1e-6, atol=1e-6)
        first = jnp.array([0.2, 0.7])
        found = optimistix.least_squares(residuals, solver, first, measured, max_steps=50, throw=False).value
        jacobian = jax.jacfwd(residuals)(found, measured)
        return found, jnp.linalg.inv(jacobian.T @ jacobian)

    exact = np.asarray(path(jnp.array([TRUE["b"], TRUE["I_C"]])))
    noise = np.random.default_rng(7).normal(scale=SIGMA, size=(FITS, len(exact)))
    begin = time.perf_counter()
    estimate, covariance = jax.jit(fit)(exact + noise[0])
    sigma = np.sqrt(np.diag(covariance))
    for name, value, error in zip(TRUE, estimate, sigma, strict=True):
        print(f"{name} = {value:.4f} +- {error:.4f} (true: {TRUE[name]})")
    print(
        f"correlation {covariance[0, 1] / sigma.prod():.2f}; {time.perf_counter() - begin:.1f} s, compilation included"
    )

    begin = time.perf_counter()
    estimates, covariances = jax.block_until_ready(jax.jit(jax.vmap(fit))(exact + noise))
    seconds = time.perf_counter() - begin
    spread, claimed = np.std(estimates, axis=0), np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)).mean(axis=0)
    print(f"{FITS} fits in {seconds:.1f} s, compilation included")
    for i, name in enumerate(TRUE):
        print(f"{name}: mean {np.mean(estimates[:, i]):.4f}, spread {spread[i]:.4f}, mean claimed {claimed[i]:.4f}")


if __name__ == "__main__":
    main()
