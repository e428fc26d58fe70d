"""Problems with known solutions, as kernels for every backend."""

import math
from functools import cache

import numpy as np

from dalembert.codegen.llvm.loops import loop_named
from dalembert.codegen.numpy import solvers
from dalembert.methods.tableaus import TABLEAUS
from dalembert.steps import explicit_loop as explicit
from dalembert.steps import implicit_loop as implicit
from dalembert.steps.problem import IntegrationProblem, Kernels, Solution
from dalembert.steps.recorded_runs import RunCodes
from dalembert.subset.arguments import NO_CODE, OwnedAddress

NO_CONSTANTS = np.zeros(0)
NUMBA_METHODS = tuple(tableau.name for tableau in TABLEAUS)
COMPILED = (*(f"llvm-{name}" for name in NUMBA_METHODS), "llvm-radau")
METHODS = (*COMPILED, *(f"scipy-{name}" for name in solvers.METHODS))
PROJECTABLE = (*COMPILED, *(f"scipy-{name}" for name in solvers.PROJECTABLE))


def mixed(t, y, c, out):
    """y0 = exp(sin t), y1 = 1/(1 + t), and a rotation of (y2, y3)."""
    out[0] = y[0] * math.cos(t)
    out[1] = -y[1] * y[1]
    out[2] = y[3]
    out[3] = -y[2]


MIXED_START = np.array([1.0, 1.0, 0.0, 1.0])


def mixed_solution(t):
    t = np.asarray(t)
    return np.stack([np.exp(np.sin(t)), 1.0 / (1.0 + t), np.sin(t), np.cos(t)], axis=-1)


def blow_up(t, y, c, out):
    """y = 1/(1 - t)."""
    out[0] = y[0] * y[0]


def square_root(t, y, c, out):
    """Becomes NaN after t = 1."""
    out[0] = math.nan if t > 1.0 else 1.0


def not_a_number(t, y, c, out):
    out[0] = math.nan


def pendulum(t, y, c, out):
    """A unit mass on a unit circle, gravity c[0], with the multiplier solved for from the accelerations."""
    tension = (y[2] * y[2] + y[3] * y[3] - c[0] * y[1]) / (y[0] * y[0] + y[1] * y[1])
    out[0] = y[2]
    out[1] = y[3]
    out[2] = -tension * y[0]
    out[3] = -tension * y[1] - c[0]


def pendulum_position(t, y, c, out):
    square = y[0] * y[0] + y[1] * y[1]
    factor = -0.5 * (square - 1.0) / square
    out[0] = factor * y[0]
    out[1] = factor * y[1]
    out[2] = 0.0
    out[3] = 0.0


def pendulum_velocity(t, y, c, out):
    factor = -(y[0] * y[2] + y[1] * y[3]) / (y[0] * y[0] + y[1] * y[1])
    out[0] = 0.0
    out[1] = 0.0
    out[2] = factor * y[0]
    out[3] = factor * y[1]


PENDULUM_START = np.array([1.0, 0.0, 0.0, 0.0])
PENDULUM_CONSTANTS = np.array([9.81])


def pendulum_violation(y):
    position = np.abs(y[:, 0] ** 2 + y[:, 1] ** 2 - 1.0)
    velocity = np.abs(y[:, 0] * y[:, 2] + y[:, 1] * y[:, 3])
    return max(position.max(), velocity.max())


@cache
def machine_code(function, sizes):
    """Return code of the arguments of a step that calls a function of (t, y, c, out), of so many entries each."""
    from numba import carray, cfunc, njit, types

    inner, (n, n_c, n_out) = njit(error_model="numpy")(function), sizes
    pointer = types.CPointer(types.float64)

    @cfunc(types.void(*(pointer,) * 5), error_model="numpy")
    def kernel(t, y, c, s, out):
        inner(t[0], carray(y, (n,)), carray(c, (n_c,)), carray(out, (n_out,)))

    return OwnedAddress(kernel.address, kernel)


@cache
def differences(function):
    """Return a Jacobian of a right-hand side by central differences, good to ten digits."""
    from numba import njit

    rhs = njit(error_model="numpy")(function)

    def jacobian(t, y, c, out):
        n = int(math.sqrt(out.size) + 0.5)
        state, high, low = y[:n].copy(), np.empty(n), np.empty(n)
        for k in range(n):
            h = 1e-5 * max(1.0, abs(y[k]))
            state[k] = y[k] + h
            rhs(t, state, c, high)
            state[k] = y[k] - h
            rhs(t, state, c, low)
            state[k] = y[k]
            for i in range(n):
                out[i * n + k] = (high[i] - low[i]) / (2 * h)

    return jacobian


def solve(method, rhs, y0, *, projections=(None, None), constants=NO_CONSTANTS, **options) -> Solution:
    """Integrate with ``backend-method``."""
    backend, name = method.split("-")
    problem = IntegrationProblem(y0=np.asarray(y0, dtype=float), constants=constants, **options)
    functions = (rhs, *projections)
    if backend == "scipy":
        return solvers.integrate(Kernels(*functions), name, problem)
    n, n_c = len(problem.y0), len(problem.constants)
    rhs_, position, velocity = (NO_CODE if f is None else machine_code(f, (n, n_c, n)) for f in functions)
    if name == "radau":
        jacobian = machine_code(differences(rhs), (n, n_c, n * n))
        codes = RunCodes(rhs_, position, velocity, jacobian=jacobian)
        return implicit.integrate(loop_named("implicit_loop"), codes, problem)
    tableau = next(tableau for tableau in TABLEAUS if tableau.name == name)
    return explicit.integrate(loop_named("explicit_loop"), RunCodes(rhs_, position, velocity), tableau, problem)
