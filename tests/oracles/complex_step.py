"""Derivatives of motions by complex steps: the program run on complex numbers, by an integrator of SciPy."""

import cmath

import numpy as np
from scipy.integrate import solve_ivp

from dalembert.ir.interpret import interpret

STEP = 1e-40

COMPLEX = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": cmath.sqrt,
    "sin": cmath.sin,
    "cos": cmath.cos,
    "tan": cmath.tan,
    "abs": lambda a: a if a.real >= 0 else -a,
    "max": lambda a, b: a if a.real >= b.real else b,
    "less": lambda a, b: complex(a.real < b.real),
    "select": lambda c, a, b: a if c != 0 else b,
}


def run_complex(kernel, **arguments):
    return interpret(kernel, arguments, COMPLEX, complex)


def derivatives(model, t, initial, parameters, wrt, of):
    """Return values (n_t, n_of) at times t and their derivatives (n_t, n_of, n_wrt)."""
    program, layout = model.stages.program, model.layout
    start = model.derived.start(initial)
    columns = []
    for varied in wrt:
        p = [parameters[name] + 1j * STEP * (name == varied) for name in layout.parameters]
        given = [initial[name] + 1j * STEP * (name == varied) for name in start.given]
        c = run_complex(program.kernel("prepare"), p=p)
        y0 = run_complex(start.kernel, t=t[0], y=given, c=p)[: len(layout.state)]
        # a real problem of twice the size, so that both parts are integrated to the tolerance
        n = len(y0)

        def rhs(time, z, c=c, n=n):
            rates = np.array(run_complex(program.kernel("rhs"), t=time, y=z[:n] + 1j * STEP * z[n:], c=c))
            return np.concatenate([rates.real, rates.imag / STEP])

        y0 = np.array(y0)
        first = np.concatenate([y0.real, y0.imag / STEP])
        run = solve_ivp(rhs, (t[0], t[-1]), first, method="DOP853", t_eval=t, rtol=1e-13, atol=1e-14)
        rows = []
        for time, z in zip(t, run.y.T, strict=True):
            y = z[:n] + 1j * STEP * z[n:]
            x = run_complex(program.kernel("expand"), t=time, y=y, c=c)
            names = dict(zip((*layout.coordinates, *layout.rates), x, strict=True))
            if layout.outputs:
                outputs = run_complex(program.kernel("outputs"), t=time, y=y, c=c)
                names |= dict(zip(layout.outputs, outputs, strict=True))
            rows.append([names[name] for name in of])
        columns.append(np.array(rows, dtype=complex))
    table = np.stack([column.imag / STEP for column in columns], axis=2)
    return columns[0].real, table
