"""
Which mass offset has a sleigh whose noisy path was recorded?
=============================================================

A least-squares fit with exact derivatives: `model.sensitivity` integrates the
variational equations along the motion.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

import dalembert as da

model = da.compile_model(da.scenes.chaplygin_sleigh())
start = {"x": 0, "y": 0, "theta": 0.0, "x_dot": 1.0, "theta_dot": 1.5}
times = np.linspace(0, 6, 60)[1:]
true = {"m": 1.0, "b": 0.25, "I_C": 0.4}
rng = np.random.default_rng(1)
record = model.simulate((0, 6), start, true, t_eval=times).q[
    :, :2
] + 0.02 * rng.standard_normal((59, 2))


# %%
# The motion depends on b and on I_C / m alone, so m is fixed.


def run(theta):
    """Return the motion and its derivatives by b and I_C."""
    p = {"m": 1.0, "b": theta[0], "I_C": theta[1]}
    return model.sensitivity(
        (0, 6), start, p, wrt=["b", "I_C"], of=["x", "y"], t_eval=times
    )


def residual(theta):
    motion = run(theta)
    return (np.stack([motion["x"], motion["y"]], axis=1) - record).ravel()


def jacobian(theta):
    motion = run(theta)
    return np.stack(
        [
            np.stack(
                [motion.jacobian("x", n), motion.jacobian("y", n)], axis=1
            ).ravel()
            for n in ("b", "I_C")
        ],
        axis=1,
    )


fit = least_squares(residual, [0.4, 0.8], jac=jacobian)
deviation = 0.02 * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
for name, value, sigma in zip(("b", "I_C"), fit.x, deviation, strict=True):
    print(f"{name} = {value:.4f} +- {sigma:.4f}, true {true[name]}")

# %%
fitted = model.simulate(
    (0, 6), start, {"m": 1.0, "b": fit.x[0], "I_C": fit.x[1]}, rtol=1e-9
)
fine = fitted(np.linspace(0, 6, 400))
_, panel = plt.subplots()
panel.plot(*record.T, "k.", label="record")
panel.plot(fine["x"], fine["y"], label="fit")
panel.set(xlabel="x [m]", ylabel="y [m]")
panel.legend()
