"""Runs of exports in C with steps of a fixed size, for tests: models, states at the ends of steps, compilers."""

import shutil
import sys
from functools import cache

import numpy as np
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import built, output
from hard_cases import hard_case

SLEIGH = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}, {"m": 1, "b": 0.3, "I_C": 0.5}
HARD = ("pendulum, Cartesian (IFToMM A01)", "double pendulum, angles", "rolling disk", "slider-crank")

STATES = """
#include "{0}.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{{
    {0}_run run;
    {2} values[64];
    int i, k;
    for (i = 2; i < argc; i++) {{
        values[i - 2] = ({2})atof(argv[i]);
    }}
    {0}_start(&run, 0, values, values + {1}_INITIAL);
    for (k = 0; k <= atoi(argv[1]) && run.status < 0; k++) {{
        for (i = 0; i < {1}_STATES; i++) {{
            printf("%a ", (double)run.state[i]);
        }}
        printf("\\n");
        {0}_step(&run);
    }}
    return run.status > 0;
}}
"""
"""A program that prints the states at the ends of so many steps, from initial values and parameters."""


@cache
def example(name):
    """Return a model with an example: initial values and parameters."""
    if name == "sleigh":
        return da.compile_model(da.scenes.chaplygin_sleigh()), *SLEIGH
    case = hard_case(name)
    return case.compile("projected" if "Cartesian" in name else "auto"), case.initial, case.parameters


def states(folder, name, step, count, *options, **further):
    """Return the states (count + 1, n_y) of an export at the ends of its steps."""
    model, initial, parameters = example(name)
    given = {"initial": initial, "parameters": parameters, "method": "rk4", "step": step, **further}
    path = model.export(folder / f"export {step}", **given)
    (header,) = path.glob("*.h")
    real = "float" if further.get("precision") == "single" else "double"
    (path / "states.c").write_text(STATES.format(header.stem, header.stem.upper(), real))
    known = {**model.read_initial(initial), **model.read_parameters(parameters)}
    marks = tuple(f"{header.stem}_{kind}_" for kind in ("initial", "parameter"))
    lines = [line for line in header.read_text().splitlines() if line.strip().startswith(marks)]
    values = [repr(float(known[line.split("/* ")[1][:-3]])) for line in lines]
    text = output(built(path, ["states.c", f"{header.stem}.c"], *options), count, *values)
    return np.array([[float.fromhex(number) for number in line.split()] for line in text.splitlines()])


def oscillator(force=None):
    """Return a mass on a spring with an input, and further forces."""
    x, u = dynamicsymbols("x u")
    m, k = symbols("m k", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("oscillator", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("mass", P, m))
    scene.add_inputs(u)
    scene.add_loads((P, (u - k * x + (force(x) if force else 0)) * N.x))
    return scene


def compilers():
    """Return the commands of the C compilers of this machine."""
    found = [[name] for name in ("gcc", "clang") if shutil.which(name)]
    try:
        import ziglang  # noqa: F401
    except ImportError:
        return found
    return [*found, [sys.executable, "-m", "ziglang", "cc"]]
